"""One motion, and the attitude error that an error of the calibration has made at its end.

A rate error d_omega turns the end attitude by phi = integral of R_start,body d_omega dt, axes of the start.  For omega = E m + B that
is linear in the 12 parameters (docs/model.md, first-order sensitivity); ``error`` integrates both models and is exact.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from session.base import rotation
from session.base.errors import DataError
from session.base.numeric import running_sum
from session.base.rotation import sample_weights, steps
from session.base.units import NS
from session.log.logfile import Log
from session.log.samples import Samples
from tinygc.closure.residual import Batch, sensitivity
from tinygc.inference.noise import wander_covariance
from tinygc.models import linear
from tinygc.models.linear import LinearModel
from tinygc.models.model import Model

#: s of the motion that a calibration's errors are stated for
MINUTE_S = 60.0
#: degrees that such a motion may miss before it matters
LIMIT_DEG = 1.0
#: blocks over which the drift within a motion is taken as constant: a second each, longer ones in more than 33 minutes
MOST_BLOCKS = 2000
#: sine of half an angle whose axis is known
SEEN = 1e-6


@dataclass(frozen=True, eq=False)
class Motion:
    """measured (N, 3) rad/s, as the sensor gave them; dt (N - 1,) s; words: which motion it is."""

    measured: np.ndarray
    dt: np.ndarray
    words: str

    @property
    def duration_s(self) -> float:
        """Its duration."""
        return float(self.dt.sum())

    def _sensitivity(self, model: LinearModel) -> np.ndarray:
        """(N, 3, 3) s: rotation of the end attitude per small rate error at each sample, axes of the start."""
        none = np.array([[1.0, 0.0, 0.0, 0.0]])
        batch = Batch(self.measured[None], self.dt[None], np.zeros((1, *self.measured.shape)), none, none, yaw_known=True)
        return sensitivity(batch, model(batch.rate))[0]

    def slope(self, model: LinearModel) -> np.ndarray:
        """(3, 12) rad per unit: error of the end attitude by each parameter of ``LinearModel.vector``, axes of the start."""
        return linear.columns(self._sensitivity(model)[None], self.measured[None])[0]

    def error(self, model: Model, other: Model) -> np.ndarray:
        """(3,) rad: rotation vector from the end attitude by one model to that by another, axes of the start; exact.

        Both need rates alone (``rates_only``).
        """
        ends = [rotation.compose(steps(each.undelayed(self.measured)[None], self.dt[None]))[0] for each in (model, other)]
        return rotation.log(rotation.multiply(ends[1], rotation.conjugate(ends[0])))

    def largest_error(self, model: Model, other: Model) -> tuple[Motion, np.ndarray]:
        """The cost of a change: the part of the motion up to where the attitude by ``other`` is farthest from that by ``model``, and the
        rotation vector (3,) rad between them there, axes of the start; exact.

        The angle is followed along the motion, past half a turn and more: at rest a zero that is off by w costs |w| t, however long.
        Both need rates alone (``rates_only``).
        """
        paths = [rotation.accumulate(steps(each.undelayed(self.measured)[None], self.dt[None]))[0] for each in (model, other)]
        q = np.concatenate([[[1.0, 0, 0, 0]], rotation.multiply(paths[1], rotation.conjugate(paths[0]))])
        q = q * _unbroken(q)[:, None]  # q and -q are one attitude: the nearer to the one before
        size = np.linalg.norm(q[:, 1:], axis=1) * _unbroken(q[:, 1:])
        half = np.unwrap(np.arctan2(size, q[:, 0]))
        worst = int(np.argmax(np.abs(half)))
        seen = worst if abs(size[worst]) > SEEN else max(worst - 1, 0)  # after whole turns the axis is that of a moment before
        axis = np.divide(q[seen, 1:], size[seen], out=np.zeros(3), where=size[seen] != 0)
        stop = max(worst, 1)
        return Motion(self.measured[: stop + 1], self.dt[:stop], self.words), 2 * half[worst] * axis

    def noise_covariance(self, model: LinearModel, density: np.ndarray, instability_rps: float) -> np.ndarray:
        """(3, 3) rad^2 of the end attitude from the gyroscope's white noise, of two-sided density (3,) rad/s/sqrt(Hz), and from its flicker
        noise of this bias instability within the motion."""
        turn = self._sensitivity(model) @ model.E
        weight = sample_weights(self.dt)
        white = turn * np.sqrt(np.divide(1, weight, out=np.zeros_like(weight), where=weight > 0))[:, None, None] * density
        found = np.einsum("tik,tjk->ij", white, white)
        if instability_rps > 0:
            blocks = np.array_split(np.arange(len(turn)), max(1, min(len(turn), MOST_BLOCKS, round(self.duration_s))))
            time = running_sum(self.dt)
            each = np.array([turn[block].sum(axis=0) for block in blocks])
            middle = np.array([time[block].mean() for block in blocks])
            wander = wander_covariance(middle, self.duration_s / len(blocks), instability_rps=instability_rps)
            found = found + np.einsum("aik,ab,bjk->ij", each, wander, each, optimize=True)
        return found


def _unbroken(vectors: np.ndarray) -> np.ndarray:
    """(N,) of 1 and -1: signs with which each of vectors (N, k) points as the one before it does, the first as it is."""
    flips = np.where(np.sum(vectors[1:] * vectors[:-1], axis=1) < 0, -1.0, 1.0)
    return np.concatenate([[1.0], np.cumprod(flips)])


def at_rest(model: LinearModel, seconds: float = MINUTE_S, rate_hz: float = 10.0) -> Motion:
    """The sensor lies still: it measures what the model calibrates to no rate."""
    count = max(2, round(seconds * rate_hz) + 1)
    reading = -np.linalg.solve(model.E, model.B)
    return Motion(np.tile(reading, (count, 1)), np.full(count - 1, seconds / (count - 1)), f"{seconds:g} s at rest")


def motion_of(logs: Sequence[Log] | Samples, seconds: float = MINUTE_S, from_s: float = 0.0) -> Motion:
    """The first ``seconds`` of a recording from a moment on, one log after the other; shorter where there is no more.

    Raises DataError where fewer than two samples are left.
    """
    pieces, left = ([logs] if isinstance(logs, Samples) else [log.samples for log in logs]), seconds
    rates, dt = [], []
    for number, samples in enumerate(pieces):
        begin_s, every = from_s if number == 0 else 0.0, range(len(samples))
        kept = slice(bisect_left(every, begin_s, key=samples.at_s), bisect_right(every, begin_s + left, key=samples.at_s))
        if kept.stop - kept.start < 2:
            continue
        own = np.diff((samples.t_ns[kept] - samples.t_ns[0]) * NS)
        gyro = samples.gyro[kept]
        rates.append(gyro[:-1])
        dt.append(own)
        last = gyro[-1]
        left -= float(own.sum())
        if left <= 0:
            break
    if not rates:
        raise DataError("the motion has fewer than two samples; give a longer recording, or begin earlier")
    steps_s = np.concatenate(dt)
    found = f"the first {steps_s.sum():.0f} s of the recording" if from_s == 0 else f"{steps_s.sum():.0f} s of the recording"
    return Motion(np.concatenate([*rates, last[None]]), steps_s, found)
