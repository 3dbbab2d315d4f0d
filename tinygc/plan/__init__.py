"""Which movements to record next: the plan of a session, and the coach at the table.

May import: session, attitude, effects, models, lot, closure, problem, methods, explanation, fitting.
"""
