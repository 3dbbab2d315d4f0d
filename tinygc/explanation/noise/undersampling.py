"""Motion faster than half the data rate: what a sum of readings misses, predicted from the recording alone.

Every k-th reading, taken alone, misses more: the error is the spectrum's share that is folded onto the sum, and of a spectrum that
falls as a power of frequency it grows as a power p of the step.  What all readings miss is contained in what every k-th misses, so

    |end(every k-th) - end(all)|^2 = (k^2p - 1) E^2,

E the closure error of all readings.  p is common to the recording, E is each turn's own.  A sensor that filters below half its data
rate has less of it than this law says; a factor, estimated from the closure, carries that.  What noise or false readings add grows with
p = 0.5 and is no motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.checks.undersampling import LEAST_EXPONENT, STEPS, capped, thinning_exponent, thinning_weights
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.explanation.twin.twin import Twin

#: the exponent where nothing is missed
SMOOTH = 2.0


@dataclass(frozen=True, eq=False)
class Undersampling:
    """predicted_rad (S,) rms per angle that each turn misses at the recording's own data rate; exponent; missed_rad (K,) rms over all turns
    and both angles beyond what all readings give, for every k-th of ``STEPS``; rate_hz of the recording."""

    predicted_rad: np.ndarray
    exponent: float
    missed_rad: np.ndarray
    rate_hz: float

    @property
    def rms_rad(self) -> float:
        """Of tilt, over all turns: both angles together."""
        return float(np.sqrt(2 * np.mean(self.predicted_rad**2)))

    def rate_needed_hz(self, missed_rad: float, allowed_rad: float) -> float:
        """The data rate at which the rms of tilt would be down to this, where it is ``missed_rad`` at the recording's own."""
        return float(self.rate_hz * max(missed_rad / allowed_rad, 1e-12) ** (1 / self.exponent))


def undersampling(twin: Twin) -> Undersampling:
    """Of a session's used segments, by the first linear fit.

    To first order an end's error is the sum of the rates' errors, turned into the table (``Twin.sensitivity``).  So the attitudes are
    needed once, and what every k-th reading gives is a plain sum: within 1 % of integrating it (tests/test_undersampling.py).
    """
    rate, at_s = _turned(twin)
    whole = _sum(rate, at_s)
    walk = np.array([np.mean(twin.problem.logs[s.log].noise.angle_random_walk ** 2) for s in twin.segments]) * twin.batch.duration_s
    missed = []
    for step in STEPS:
        kept = [_every(rate.shape[1], step, offset) for offset in range(step)]
        apart = [np.mean((_sum(rate[:, rows], at_s[:, rows]) - whole) ** 2, axis=-1) for rows in kept]
        # White noise is thinned out as well: its variance grows with the step.
        missed.append(np.maximum(np.mean(apart, axis=0) - (step - 1) * walk, 0.0))
    square = np.array(missed)
    grows = thinning_exponent(square)
    exponent = grows or SMOOTH
    predicted = np.mean(square / thinning_weights(exponent)[:, None], axis=0) * (grows >= LEAST_EXPONENT)
    period = float(np.median([log.samples.period_s for log in twin.problem.logs]))
    return Undersampling(capped(np.sqrt(predicted)), exponent, np.sqrt(np.mean(square, axis=1)), 1 / period)


def _turned(twin: Twin) -> tuple[np.ndarray, np.ndarray]:
    """(S, T, 2) rad/s about the table's level axes, and (S, T) s from each segment's beginning; padded with zeros that last no time."""
    batch = twin.batch
    rate = twin.problem.first(batch.rate)
    level = np.einsum("stij,stj->sti", rotation.matrix(closure.attitudes(batch, rate))[..., :2, :], rate - batch.earth)
    at_s = np.concatenate([np.zeros((len(batch), 1)), np.cumsum(batch.dt, axis=1)], axis=1)
    counts = np.array([segment.stop - segment.start for segment in twin.segments])
    return np.where(np.arange(rate.shape[1])[None, :, None] < counts[:, None, None], level, 0.0), at_s


def _every(count: int, step: int, offset: int) -> np.ndarray:
    """Rows of every ``step``-th reading beginning with ``offset``, and those at both ends, which are at rest."""
    return np.unique(np.concatenate([[0], np.arange(offset, count, step), [count - 1]]))


def _sum(rate: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """(S, 2) rad, by trapezoids."""
    return np.einsum("st,sti->si", np.diff(at_s, axis=1), rate[:, 1:] + rate[:, :-1]) / 2
