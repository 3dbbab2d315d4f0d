"""The command line: arguments, and a file for each command.

May import: session, attitude, effects, models, closure, problem, methods, explanation, fitting, temperature, plan, simulation,
challenge, deploy, report, library, array, lot, fleet.
"""
