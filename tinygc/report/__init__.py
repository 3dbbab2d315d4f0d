"""Results for people: the terminal's tables, the HTML report, the comparison.

May import: session, attitude, effects, models, closure, problem, methods, explanation, fitting, temperature, plan, discovery, deploy,
array, lot, fleet.
"""
