"""Models in use: live streams, logs of any length, exports for other programs, C for a microcontroller.

May import: session, attitude, effects, models, closure, problem, methods, explanation, fitting, array.
"""
