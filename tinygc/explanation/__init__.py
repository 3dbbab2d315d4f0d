"""Why the recording differs from the simulation (docs/explain.md): detect, locate, name, refuse, refit, prove.

From below: twin; noise; naming; mends; verdict; truth and pictures; ``save.py`` writes what they found.

May import: session, attitude, effects, models, lot, closure, problem.
"""
