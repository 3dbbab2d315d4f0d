"""The main job: fit the methods to a session, close the runs, save the models; physics and the bias of the day with it.

May import: session, attitude, effects, models, lot, closure, problem, methods, explanation.
"""
