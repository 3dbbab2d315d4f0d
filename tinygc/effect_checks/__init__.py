"""Proofs of an effect, part by part: what ``tinygc.effects.testing.check`` runs.

May import: everything below cli (it simulates, fits, draws, goes live and compiles, which the effects' own layer must not know of).
Nothing in ``tinygc`` imports it but ``tinygc.effects.testing``, by name, when it is called.
"""
