"""The closure residual: integrated attitude against the reference; the third angle of a known turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from session.base import rotation
from session.base import rotation as pairs
from session.base.rotation import identities, sample_weights, step_vectors
from session.base.units import DEG

# The third angle of a turn of known angle: the gyro's angle about the turn's axis minus the known one.
#
# With q = (w, v) the gyro's rotation from the start of a turn to its end, (w, c) = (cos a/2, sin a/2) holds the angle a about the turn's
# axis u: c = ±|v|, with the sign of v.u, or c = v.u near whole circles, where v has no direction of its own.  The first form does not need
# the axis; the error of the second is sin(angle) times half the square of the axis error.  Subtracting the known angle, as the rotation
# (cos angle/2, sin angle/2), leaves an error within half a circle, and r is 2 sin(error/4), as below.  Gravity does not enter, so only
# the gyro's noise is shared with the tilt.
#
# A small rotation phi of the end attitude, in the table frame, changes the angle by u_t.phi, u_t = R_tb u.

#: closer than this to whole circles, the gyro's rotation does not define the axis
NEAR_CIRCLE_RAD = 10 * DEG
#: keeps the derivative of a length finite at zero
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class KnownTurns:
    """Known turn angles of S segments.

    angle_rad (S,), NaN if unknown; sigma_rad (S,) of the stop, NaN likewise; axis (S, 3): approximate unit vector in body axes, about
    which the angle is positive.
    """

    angle_rad: np.ndarray
    sigma_rad: np.ndarray
    axis: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """Whether each angle is known, (S,) bool."""
        return np.isfinite(self.angle_rad)

    @property
    def near_circle(self) -> np.ndarray:
        """(S,) bool: whether the angle is nearly a whole number of circles."""
        angle = np.nan_to_num(self.angle_rad)
        return np.abs(angle - np.round(angle / (2 * np.pi)) * 2 * np.pi) < NEAR_CIRCLE_RAD

    def pick(self, which: np.ndarray | slice) -> KnownTurns:
        """Some of the segments."""
        return replace(self, angle_rad=self.angle_rad[which], sigma_rad=self.sigma_rad[which], axis=self.axis[which])

    def residual(self, turn: np.ndarray) -> np.ndarray:
        """Residual (..., S) of the gyro's rotations (..., S, 4) from start to end, body axes; 0 if unknown."""
        angle, axis = np.nan_to_num(self.angle_rad) / 2, self.axis
        cos, sin = np.cos(angle), np.sin(angle)
        w, x, y, z = rotation.split(turn)
        along = x * axis[..., 0] + y * axis[..., 1] + z * axis[..., 2]
        length = np.sqrt(x * x + y * y + z * z + _TINY)
        about = np.where(self.near_circle, along, np.where(along < 0, -length, length))
        size = np.sqrt(w * w + about * about + _TINY)
        left_w, left = (w * cos + about * sin) / size, (about * cos - w * sin) / size
        sign = np.where(left_w < 0, -1.0, 1.0)
        return self.known * left * sign * np.sqrt(2 / (1 + left_w * sign))

    def directions(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Axis u_t (S, 3) of segments from q_tb (S, 4) to q_tb (S, 4), as the gyro predicts it; 0 if the angle is unknown."""
        vector = rotation.multiply(rotation.conjugate(start), end)[:, 1:]
        own = vector * np.where(np.einsum("si,si->s", vector, self.axis) < 0, -1.0, 1.0)[:, None]
        own = own / np.maximum(np.linalg.norm(own, axis=1, keepdims=True), _TINY)
        axis = np.where(self.near_circle[:, None], self.axis, own) * self.known[:, None]
        return np.einsum("sij,sj->si", rotation.matrix(start), axis)

    def turned(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """The gyro's end attitudes q_tb (S, 4), corrected to the known angle about the axis; unchanged if it is unknown."""
        miss = 4 * np.arcsin(self.residual(rotation.multiply(rotation.conjugate(start), end)) / 2)
        return rotation.multiply(rotation.exp(-miss[:, None] * self.directions(start, end)), end)


# The closure residual: the rotation between the attitude predicted by the gyro and the reference.
#
# Integrating from ``start`` gives q_pred; the error rotation, in the table frame, is d = q_pred q_end^-1 = (w, x, y, z).  q and -q
# are the same attitude, so the nearer sign counts.  Where yaw is unknown, the reference is first rotated about the vertical to be nearest
# to the prediction; the remaining rotation is the tilt, in the frame of the prediction, with cosine c = sqrt(w^2 + z^2) of half its angle.
# The loss is the paper's squared Euclidean distance of the two quaternions,
#
#     D^2 = 2 - 2c = 2 s^2 / (1 + c),   s the length of the vector part,
#
# written so that it loses no digits near zero and is smooth there.  As a least-squares residual it is r = vector part x
# sqrt(2 / (1 + c)), |r| = D; for small errors r is half the error's rotation vector.

#: function from measured rates (..., 3) rad/s to calibrated ones
RateMap = Callable[[Any], Any]
#: segments processed at once: intermediate results stay in the processor's cache, which halves the time
TOGETHER = 40


@dataclass(frozen=True, eq=False)
class Batch:
    """S segments of up to T samples; shorter ones are padded with steps of zero duration.

    rate (S, T, 3) rad/s measured; dt (S, T-1) s; earth (S, T, 3) rad/s, the Earth's rate in body axes, to be subtracted from the calibrated
    rate; start, end (S, 4) q_tb from the reference; yaw_known: whether the reference gives three angles or two.  turns: with two, the known
    turn angles: the third component is then about each turn's own axis, and 0 if its angle is unknown.
    """

    rate: np.ndarray
    dt: np.ndarray
    earth: np.ndarray
    start: np.ndarray
    end: np.ndarray
    yaw_known: bool
    turns: KnownTurns | None = None

    def __len__(self) -> int:
        return len(self.rate)

    @property
    def duration_s(self) -> np.ndarray:
        """Duration of each segment, (S,) s."""
        return self.dt.sum(-1)

    @cached_property
    def angles(self) -> int:
        """Residual components per segment: 2 where only gravity is known, else 3."""
        return 3 if self.yaw_known or self.turns is not None else 2

    @property
    def known(self) -> np.ndarray:
        """(S, d) bool: the components observed by the reference; the others are 0 for any model."""
        known = np.ones((len(self), self.angles), dtype=bool)
        if self.turns is not None:
            known[:, 2] = self.turns.known
        return known

    def pick(self, which: np.ndarray | slice) -> Batch:
        """Select segments by index or mask."""
        arrays = {name: getattr(self, name)[which] for name in ("dt", "start", "end")}
        # Each component contiguous in memory, as ``rotation.join`` has them.
        arrays |= {name: np.moveaxis(np.moveaxis(getattr(self, name), -1, 0)[:, which], 0, -1) for name in ("rate", "earth")}
        return replace(self, **arrays, turns=None if self.turns is None else self.turns.pick(which))

    def trimmed(self) -> Batch:
        """Remove the trailing columns in which no segment has a sample."""
        lasting = np.flatnonzero(self.dt.any(axis=0))
        count = int(lasting[-1]) + 2 if len(lasting) else self.rate.shape[1]
        return replace(self, rate=self.rate[:, :count], dt=self.dt[:, : count - 1], earth=self.earth[:, :count])


def end_attitude(batch: Batch, rate: np.ndarray) -> np.ndarray:
    """Predicted q_tb (S, 4) at the end from calibrated rates (S, T, 3), which include the Earth's rate."""
    return rotation.multiply(batch.start, turned(batch, rate))


def turned(batch: Batch, rate: np.ndarray) -> np.ndarray:
    """Rotation (S, 4) of the body over each segment, in body axes at its start."""
    if len(rate) > TOGETHER:
        return np.concatenate([turned(batch.pick(some), rate[some]) for some in parts(len(rate))])
    return pairs.quaternions(pairs.compose_pairs(_steps(rate - batch.earth, batch.dt)))


def _steps(rate: np.ndarray, dt: np.ndarray, start: np.ndarray | None = None) -> pairs.Pairs:
    """The steps as pairs (S, T-1); with a start (S, 4), preceded by it: (S, T)."""
    before = int(start is not None)
    shape = (len(dt), dt.shape[1] + before)
    found = np.empty(shape, dtype=complex), np.empty(shape, dtype=complex)
    after = found[0][:, before:], found[1][:, before:]
    vectors = step_vectors(rate, dt)
    if not pairs.exp_small(vectors, after):
        for part, of in zip(after, pairs.of(rotation.exp(vectors)), strict=True):
            part[:] = of
    if start is not None:
        for part, of in zip(found, pairs.of(start), strict=True):
            part[:, 0] = of
    return found


def _along(batch: Batch, rate: np.ndarray) -> pairs.Pairs:
    """``attitudes`` as pairs (S, T)."""
    return pairs.accumulate_pairs(_steps(rate - batch.earth, batch.dt, batch.start))


def residual(q_pred: np.ndarray, q_end: np.ndarray, yaw_known: bool) -> np.ndarray:
    """Residual (S, 2) or (S, 3), |r|^2 the squared quaternion distance; components about the table's x, y (and z)."""
    d = rotation.multiply(q_pred, rotation.conjugate(q_end))
    w, x, y, z = rotation.split(d)
    if yaw_known:
        sign = np.where(w < 0, -1.0, 1.0)
        vector, c = np.stack([x * sign, y * sign, z * sign], -1), w * sign
    else:
        # For a tilt of half a circle no yaw is nearest; the tiny term keeps the quotient finite.
        c = np.sqrt(w**2 + z**2 + 1e-300)
        vector = np.stack([(w * x - z * y) / c, (w * y + z * x) / c], -1)
    return vector * np.sqrt(2 / (1 + c))[..., None]


def batch_residual(batch: Batch, q_pred: np.ndarray, turn: np.ndarray | None = None) -> np.ndarray:
    """Residual (..., S, d) of predicted ends q_tb (..., S, 4); turn: the gyro's rotations (S, 4), where they are known already."""
    tilt = residual(q_pred, batch.end, batch.yaw_known)
    if batch.turns is None:
        return tilt
    if turn is None:
        turn = rotation.multiply(rotation.conjugate(batch.start), q_pred)
    return np.concatenate([tilt, batch.turns.residual(turn)[..., None]], -1)


def segment_residuals(batch: Batch, rate: np.ndarray) -> np.ndarray:
    """``batch_residual`` of each segment for calibrated rates (S, T, 3)."""
    return batch_residual(batch, end_attitude(batch, rate))


def error_angles(r: np.ndarray) -> np.ndarray:
    """Rotation vectors (S, 2 or 3) rad of residuals: D = 2 sin(angle/4)."""
    distance = np.linalg.norm(r, axis=-1, keepdims=True)
    angle = 4 * np.arcsin(np.minimum(distance / 2, 1))
    return r * np.where(distance > 1e-12, angle / np.where(distance > 1e-12, distance, 1), 2.0)


def attitudes(batch: Batch, rate: np.ndarray) -> np.ndarray:
    """Attitudes q_tb (S, T, 4) at every sample, from the start and calibrated rates."""
    if len(rate) > TOGETHER:
        q_tb = np.moveaxis(np.empty((4, *rate.shape[:-1])), 0, -1)  # each component contiguous, as ``rotation.join`` has them
        for some in parts(len(rate)):
            q_tb[some] = attitudes(batch.pick(some), rate[some])
        return q_tb
    return pairs.quaternions(_along(batch, rate))


def directions(batch: Batch, q_end: np.ndarray) -> np.ndarray:
    """Axes (S, 3, 3) of the residual, in the table frame, of segments that end at q_tb (S, 4).

    x, y and z; with known turns, each turn's axis instead of z, or 0 if its angle is unknown.
    """
    axes = identities(len(batch)).copy()
    if batch.turns is not None:
        axes[:, 2] = batch.turns.directions(batch.start, q_end)
    return axes


def sensitivity(batch: Batch, rate: np.ndarray) -> np.ndarray:
    """(S, T, 3, 3) s: rotation of the end attitude per small rate error at each sample, about the axes of ``directions``.

    phi = sum_k sensitivity_k @ d_omega_k (docs/model.md, first-order sensitivity; in table axes instead of the end's body axes).
    The residual is half of phi, its first two or all three components.
    """
    return end_and_sensitivity(batch, rate)[1]


def end_and_sensitivity(batch: Batch, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``end_attitude`` (S, 4), and ``sensitivity``: both follow from the attitudes at all samples."""
    segments, samples = rate.shape[:2]
    end = np.empty((segments, 4))
    found = np.empty((segments, 3, 3, samples))  # samples contiguous in memory, for sums over them
    for some in parts(segments):
        part = batch.pick(some)
        q_tb = _along(part, rate[some])
        end[some] = pairs.quaternions((q_tb[0][:, -1], q_tb[1][:, -1]))
        pairs.matrices_into(found[some], q_tb, sample_weights(part.dt))
        if part.turns is not None:
            found[some, 2] = np.einsum("sj,sjkt->skt", directions(part, end[some])[:, 2], found[some])
    return end, found.transpose(0, 3, 1, 2)


def parts(count: int) -> list[slice]:
    """Slices of ``count`` segments that are processed together."""
    return [slice(first, first + TOGETHER) for first in range(0, count, TOGETHER)]


def closure_angles(batch: Batch, model: RateMap) -> np.ndarray:
    """Error angles (S, d) rad under a model."""
    return error_angles(segment_residuals(batch, model(batch.rate)))
