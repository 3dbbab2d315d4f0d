"""Several units on one rigid body: their clocks, mountings and parameters together, what they have in common and what each has alone.

May import: session, attitude, effects, models, closure, problem, methods, explanation, fitting.
"""
