"""Proofs of an effect, part by part: what ``tinygc.effects.testing.check`` runs.

It simulates, fits, draws, goes live and compiles, which the effects' own layer must not know of: nothing in ``tinygc`` imports it but
``tinygc.effects.testing``, by name, when it is called.

May import: session, attitude, effects, models, closure, problem, methods, explanation, fitting, plan, simulation,
challenge, deploy, report.
"""
