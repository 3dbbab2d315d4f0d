"""Prove an effect: ``tinygc.effects.testing.check(EFFECT)``, of the catalogue, of yours, of anybody's.

    from tinygc.effects.testing import check

    def test_my_effect():
        check(EFFECT).require()

The proof simulates sessions, fits, draws, goes live and compiles C: parts of the tool that lie above this layer and know it.  So this
module holds no more than the name, and finds the proof by its address when it is called; nothing in this layer depends on it.
"""

from __future__ import annotations

from typing import Any

from session.io.annexes import need
from tinygc.effects.effect import Effect


def check(effect: Effect, **how: Any) -> Any:
    """A ``Report`` of the parts, each passed, failed or not checked with its reason: ``.ok``, ``.failed`` (names), ``["columns"].says``,
    ``.require()`` which raises AssertionError; printed, a line for each part.

    columns: are the finite differences of ``distort`` (to 0.5 % of the greatest); undo: ``correct`` undoes ``distort`` (to 0.5 % of
    what it did); recover: injected into simulated sessions and fitted, the parameters miss the true ones by what their stated sigmas
    and 1 % of the size allow, and not by much less than the sigmas (chance 1e-4 each); units: the sentence, the units' sizes in SI,
    the names and numbers in JSON and back; picture: both panels are drawn, labelled, not empty; live: sample by sample, in pieces and
    whole agree, or live use is refused in one line because it looks ahead, and nothing beyond the declared reach matters; c: the C
    equals its NumPy bit for bit, and ``correct`` to 1e-5, or there is a stated reason why there is none.

    how: size, SI, of the injected parameters (a twentieth of the plausible); value, SI, of the scanned shape; seeds: sessions (3);
    parts: names of those to run (all); explanation: an ``Explanation`` that claims the effect, to be drawn, for one that is found
    before any fit, or that adds variance alone (of kind "motion" no more is proved without it than columns of zero, sentence and units).
    Raises EffectError for what is no effect at all, a size that is not positive, and less than one session.
    """
    return need("the proof of an effect").check(effect, **how)
