"""Test an effect, from the catalogue or your own: ``tinygc.effects.testing.check(EFFECT)``.

    from tinygc.effects.testing import check

    def test_my_effect():
        check(EFFECT).require()

The test simulates sessions, fits, draws, runs live and compiles C, which are layers above this one.  So this module contains only the
name and imports the test when it is called; nothing in this layer depends on it.
"""

from __future__ import annotations

from typing import Any

from session.base import features
from session.base.errors import CalibrationError
from tinygc.effects.effect import Effect


def check(effect: Effect, **how: Any) -> Any:
    """Return a ``Report`` of the parts, each passed, failed or not checked with its reason: ``.ok``, ``.failed`` (names),
    ``["columns"].says``, ``.require()`` which raises AssertionError; its string has a line for each part.

    columns: they are the finite differences of ``distort`` (to 0.5 % of the greatest); undo: ``correct`` inverts ``distort`` (to 0.5 % of
    its change); recover: injected into three simulated sessions and fitted, with its scanned number as injected, no parameter's error is
    beyond 4.5 times its stated sigma and 1 % of the size, and their rms is not below a tenth of the sigmas; units: the sentence, the
    units' sizes in SI, the names and numbers in JSON and back; picture: both panels are drawn, labelled, not empty; live: results sample by
    sample, in pieces and whole agree, or live use is refused because later samples are needed; c: the C equals its NumPy bit for bit in its
    self-test, and the NumPy ``correct`` to 1e-5, or there is a stated reason why there is none.

    Not proven, which the line says: anything but units of an effect of another kind than rate; recover and picture of one of vibration, of
    a derived number, or of other reference conditions.

    how: size, SI, of the injected parameters (a twentieth of the plausible); value, SI, of the scanned shape; parts: names of those to run
    (all).  Raises EffectError for an object that is no effect, and a size that is not positive.
    """
    if (report := features.first("proof of an effect", effect, **how)) is None:
        raise CalibrationError("no feature is installed that proves an effect")
    return report
