"""The command line: arguments, and a file for each command.

May import: session, attitude, effects, models, closure, problem, methods, explain, fit, plan, simulation, challenge, deploy, report.
"""
