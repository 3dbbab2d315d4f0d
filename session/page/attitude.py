"""How the board lies now: gravity says it in rests, the gyro carries it through turns.  For a picture, not for a result."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG, NS
from session.guide.messages import AcceptedTurn
from session.log.samples import Samples
from session.page.turning import NONE, UP, Quaternion, exp, inverse, levelled, multiply, normalised, rotated

STEP_S = 0.002  #: in which the rate counts as constant: coning inside it stays below 0.01°
SETTLES_S = 0.2  #: in which a rest's gravity takes the gyro's place: the noise of single samples is not to be seen
HEAD_OVER: Quaternion = (0.0, 1.0, 0.0, 0.0)  #: z down: of all ways to stand on the head always the same


class Attitude:
    """q: takes the board's axes to a frame with z up, whose heading is the one of the first sample; rate (3,) rad/s and its largest
    part of the last samples; zero_rps: what the gyro reads at rest, None before the first rest that counts."""

    def __init__(self) -> None:
        self.q: Quaternion = NONE
        self.rate = np.zeros(3)
        self.peak_rps = 0.0
        self.zero_rps: np.ndarray | None = None
        self._last_ns: int | None = None
        self._level = False

    def feed(self, samples: Samples, resting: bool) -> None:
        """Samples, SI, as they come; resting: whether the table is at rest, so that the accelerometer reads gravity alone."""
        if len(samples) == 0:
            return
        t_ns, gyro = np.asarray(samples.t_ns), np.asarray(samples.gyro)
        if self._last_ns is not None and self._last_ns < t_ns[0]:
            if self.zero_rps is not None or not resting:  # a bias that nobody knows yet is no turn
                zero_rps = 0.0 if self.zero_rps is None else self.zero_rps
                self.q = carried(self.q, gyro - zero_rps, np.diff(t_ns, prepend=self._last_ns) * NS)
        else:  # the first samples, or a clock that has begun anew: how it was turned meanwhile nobody knows
            self._level = False
        gap_s = float(t_ns[-1] - (t_ns[0] if self._last_ns is None else self._last_ns)) * NS
        self._last_ns = int(t_ns[-1])
        self.rate, self.peak_rps = gyro.mean(axis=0), float(np.abs(gyro).max())
        lately = t_ns > t_ns[-1] - SETTLES_S / NS  # of a recording that is taken in again, a portion holds many seconds
        force = np.asarray(samples.accel)[lately].mean(axis=0)
        if not self._level:
            self.q, self._level = levelled(NONE if force[2] >= 0 else HEAD_OVER, force), True
        elif resting:
            self.q = levelled(self.q, force, 1 - float(np.exp(-max(gap_s, 0.0) / SETTLES_S)))


def carried(q: Quaternion, rate: np.ndarray, dt_s: np.ndarray) -> Quaternion:
    """Through rates (N, 3) rad/s, each of them for dt_s (N,)."""
    steps = np.floor(np.cumsum(dt_s) / STEP_S)
    first = np.flatnonzero(np.diff(steps, prepend=-1.0))
    for x, y, z in np.add.reduceat(rate * dt_s[:, None], first).tolist():
        q = multiply(q, exp(x, y, z))
    return normalised(q)


def closure_deg(turn: AcceptedTurn) -> float:
    """By how much gravity misses, at a turn's end, where the gyro as measured carries it from the turn's beginning."""
    first, last = turn.segment.stills
    rate = np.asarray(turn.samples.gyro) - (first.gyro_mean + last.gyro_mean) / 2
    q = carried(levelled(NONE, first.accel_mean), (rate[1:] + rate[:-1]) / 2, turn.samples.dt_s)
    expected, found = rotated(inverse(q), UP), last.accel_mean / np.linalg.norm(last.accel_mean)
    return float(np.arctan2(np.linalg.norm(np.cross(expected, found)), expected @ found) / DEG)
