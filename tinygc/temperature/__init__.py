"""A gyroscope over temperature: its zero from rest logs, and with sessions at several temperatures its whole calibration, E(T) and b(T).

``rest_fit.py`` puts the rest logs' part together, ``sessions_fit.py`` the sessions'.

May import: session, effects, models, closure, problem, methods, explanation, fitting.
"""
