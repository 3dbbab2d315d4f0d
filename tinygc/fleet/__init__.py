"""Hundreds to hundreds of thousands of session folders: each is computed once, here or on a cluster, and kept in one table.

May import: session, attitude, effects, models, closure, problem, methods, explanation, fitting, library, lot.
"""
