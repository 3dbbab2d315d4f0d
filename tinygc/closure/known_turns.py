"""The third angle of a turn whose angle is known beforehand: how far the gyro's angle about the turn's axis is from it.

With q = (w, v) the gyro's rotation from the start of a turn to its end, (w, c) = (cos a/2, sin a/2) holds the angle a that it turned by
about its axis u: c = ±|v|, the sign that of v.u, or c = v.u where the angle is nearly whole circles, so that v has no direction of its own.
Neither needs the axis better than it is known: the first not at all, the second errs by sin(angle) times half the square of its error.
The known angle is taken off as the rotation (cos angle/2, sin angle/2) is; what is left is an error within half a circle, and r is as in
``residual.py``, 2 sin(error/4).  Gravity is not in it, so it shares no noise with the tilt but the gyro's.

A small rotation phi of the end attitude, in the table frame, changes the angle by u_t.phi, u_t = R_tb u.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.common.units import DEG
from tinygc.attitude import rotation
from tinygc.attitude.rotation import Array

#: an angle nearer than this to whole circles leaves no direction to take the axis from
NEAR_CIRCLE_RAD = 10 * DEG
#: keeps the derivative of a length finite at zero
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class KnownTurns:
    """Of S segments: angle_rad (S,), NaN where it is not known; sigma_rad (S,) of the stop, NaN there, too; axis (S, 3) unit, body, in
    whose sense the angle is positive, as well as it is known."""

    angle_rad: np.ndarray
    sigma_rad: np.ndarray
    axis: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """(S,) bool."""
        return np.isfinite(self.angle_rad)

    @property
    def near_circle(self) -> np.ndarray:
        """(S,) bool: whether the turn ends nearly where it began."""
        angle = np.nan_to_num(self.angle_rad)
        return np.abs(angle - np.round(angle / (2 * np.pi)) * 2 * np.pi) < NEAR_CIRCLE_RAD

    def pick(self, which: np.ndarray | slice) -> KnownTurns:
        """Some of the segments."""
        return replace(self, angle_rad=self.angle_rad[which], sigma_rad=self.sigma_rad[which], axis=self.axis[which])

    def residual(self, turn: Array) -> Array:
        """(..., S) of the gyro's rotations (..., S, 4) from start to end, body axes; 0 where the angle is not known.  NumPy or torch."""
        xp = rotation.namespace(turn)
        angle, known = np.nan_to_num(self.angle_rad) / 2, self.known
        cos, sin, axis, circle, used = (
            _like(turn, x) for x in (np.cos(angle), np.sin(angle), self.axis, self.near_circle * 1.0, known * 1.0)
        )
        w, x, y, z = rotation.split(turn)
        along = x * axis[..., 0] + y * axis[..., 1] + z * axis[..., 2]
        length = xp.sqrt(x * x + y * y + z * z + _TINY)
        about = xp.where(circle > 0, along, xp.where(along < 0, -length, length))
        size = xp.sqrt(w * w + about * about + _TINY)
        left_w, left = (w * cos + about * sin) / size, (about * cos - w * sin) / size
        sign = xp.where(left_w < 0, -xp.ones_like(left_w), xp.ones_like(left_w))
        return used * left * sign * xp.sqrt(2 / (1 + left_w * sign))

    def directions(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(S, 3) u_t of segments from q_tb (S, 4) to q_tb (S, 4), as the gyro predicts it; 0 where the angle is not known."""
        vector = rotation.multiply(rotation.conjugate(start), end)[:, 1:]
        own = vector * np.where(np.einsum("si,si->s", vector, self.axis) < 0, -1.0, 1.0)[:, None]
        own = own / np.maximum(np.linalg.norm(own, axis=1, keepdims=True), _TINY)
        axis = np.where(self.near_circle[:, None], self.axis, own) * self.known[:, None]
        return np.einsum("sij,sj->si", rotation.matrix(start), axis)

    def turned(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """End attitudes q_tb (S, 4) by the gyro, set right to the known angle about the axis; as they are where it is not known."""
        miss = 4 * np.arcsin(self.residual(rotation.multiply(rotation.conjugate(start), end)) / 2)
        return rotation.multiply(rotation.exp(-miss[:, None] * self.directions(start, end)), end)


def _like(model: Array, array: np.ndarray) -> Array:
    xp = rotation.namespace(model)
    return array if isinstance(model, np.ndarray) else xp.as_tensor(array, dtype=model.dtype, device=model.device)
