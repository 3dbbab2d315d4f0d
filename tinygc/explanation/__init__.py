"""Why the recording differs from the simulation (DESIGN, explaining a mismatch): detect, locate, name, refuse, refit, prove.

May import: session, attitude, effects, models, closure, problem.
"""
