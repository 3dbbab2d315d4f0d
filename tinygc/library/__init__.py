"""What a Python user calls, and the command line as well: a session in, a result out.  ``tinygc/__init__.py`` hands the names on.

May import: session, attitude, effects, models, closure, problem, methods, explanation, fitting, temperature, plan, simulation,
challenge, deploy, report, array, lot, discovery.
"""
