"""Sensor noise: white, and the flicker that a datasheet calls bias instability.  Terms and Allan floor: IEEE 952, annex C."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

FLICKER_KNOTS_HZ = 16.0  #: flicker is drawn at this rate and interpolated; faster than that it drowns in white noise
FLICKER_TIMES_S = 2.0 ** np.arange(-1, 12)  #: time constants by octaves, 0.5 s to 2048 s: flat Allan floor from about 1 s to 2000 s


def white(density: float, rate_hz: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """White noise (count, 3) of one-sided ``density`` (unit/sqrt(Hz)) sampled at rate_hz: standard deviation N sqrt(fs/2)."""
    return density * np.sqrt(rate_hz / 2) * rng.standard_normal((count, 3))


def bias_instability(coefficient: float, rate_hz: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Flicker noise (count, 3) in the unit of ``coefficient`` B, sampled at rate_hz.

    Its one-sided density is ``B^2 / (pi f)``, its Allan deviation flat at ``sqrt(2 ln 2 / pi) B = 0.664 B``.  It is the sum of
    stationary Gauss-Markov processes with time constants an octave apart.  Each has the density 4 sigma^2 T / (1 + (2 pi f T)^2);
    summed over octaves that is sigma^2 / (ln 2 f), so sigma = B sqrt(ln 2 / pi).  All together scatter by 1.7 B (1 sigma), most
    of it slower than a session and so no more than a little turn-on bias.
    """
    duration_s = count / rate_hz
    knots = int(duration_s * FLICKER_KNOTS_HZ) + 2
    sigma = coefficient * np.sqrt(np.log(2) / np.pi)
    total = np.zeros((3, knots))
    for time_s in FLICKER_TIMES_S:
        keep = np.exp(-1 / (FLICKER_KNOTS_HZ * time_s))
        drive = sigma * rng.standard_normal((3, knots))
        drive[:, 1:] *= np.sqrt(1 - keep**2)  # not the first: it has the stationary spread already
        total += lfilter([1.0], [1.0, -keep], drive)
    t_s, knots_s = np.arange(count) / rate_hz, np.arange(knots) / FLICKER_KNOTS_HZ
    return np.stack([np.interp(t_s, knots_s, axis) for axis in total], axis=-1)
