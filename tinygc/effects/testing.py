"""Test an effect, from the catalogue or your own: ``tinygc.effects.testing.check(EFFECT)``.

    from tinygc.effects.testing import check

    def test_my_effect():
        check(EFFECT).require()

The test simulates sessions, fits, draws, runs live and compiles C, which are layers above this one.  So this module contains only the
name, and imports the test when it is called, and the movement by which it and the search for laws try an effect.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from session.base import features
from session.base.errors import CalibrationError
from tinygc.effects.effect import Effect, ReferenceConditions
from tinygc.effects.movement import Movement

LENGTH_S, WARMING_C_PER_S = 20.0, 0.8


def hand_movement(odr_hz: float, at: ReferenceConditions, length_s: float = LENGTH_S) -> Movement:
    """A hand movement: rest, movement up to two fifths of full scale and 2 Hz, rest; with all inputs, each of its own shape."""
    from scipy.interpolate import BSpline  # late: few load this with effects

    t_s = np.arange(0, length_s, 1 / odr_hz)
    window = BSpline.basis_element(np.linspace(0.2, 0.8, 9) * length_s, extrapolate=False)  # six times differentiable
    waves = np.stack([np.sin(2 * np.pi * f * t_s + p) for f, p in ((0.5, 0.3), (0.9, 1.1), (2.0, 2.0))], axis=-1)
    rate = at.fs_rps * np.nan_to_num(window(t_s))[:, None] * waves
    gravity = np.stack([np.sin(0.7 * t_s), np.cos(0.7 * t_s) * np.sin(0.4 * t_s), -np.cos(0.7 * t_s) * np.cos(0.4 * t_s)], axis=-1)
    force_g = (1 + 0.2 * np.sin(1.9 * t_s))[:, None] * gravity  # up to a fifth of it is the hand's acceleration
    shaken_g2, temp_c = 0.2 * np.exp(-(((t_s / length_s - 0.5) * 10) ** 2)), at.first_temp_c + WARMING_C_PER_S * t_s
    return Movement(t_s, 1 / odr_hz, rate, force_g, temp_c, shaken_g2, length_s, at.fs_rps, at.first_temp_c)


def check(effect: Effect, **how: Any) -> Any:
    """Return a ``Report`` of the parts, each passed, failed or not checked with its reason: ``.ok``, ``.failed`` (names),
    ``["columns"].text``, ``.require()`` which raises AssertionError; its string has a line for each part.

    columns: they are the finite differences of ``distort`` (to 0.5 % of the greatest); inverse: ``correct`` inverts ``distort`` (to 0.5 %
    of its change); recover: injected into three simulated sessions and fitted, with its scanned number as injected, no parameter's error is
    beyond 4.5 times its stated sigma and 1 % of the size, and their rms is not below a tenth of the sigmas; units: the sentence, the
    units' sizes in SI, the names and numbers in JSON and back; picture: both panels are drawn, labelled, not empty; live: results sample by
    sample, in pieces and whole agree, or live use is refused because later samples are needed; c: the C equals its NumPy bit for bit in its
    self-test, and the NumPy ``correct`` to 1e-5, or there is a stated reason why there is none.

    Not proven, as the line states: anything but units of an effect of another kind than rate; recover and picture of one of vibration, of
    a derived number, or of other reference conditions.

    how: size, SI, of the injected parameters (a twentieth of the plausible); value, SI, of the scanned shape; parts: names of those to run
    (all).  Raises EffectError for an object that is no effect, and a size that is not positive.
    """
    if (report := features.first("proof of an effect", effect, **how)) is None:
        raise CalibrationError("no feature is installed that proves an effect")
    return report
