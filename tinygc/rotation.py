"""Rotations as unit quaternions (..., 4), scalar first; the same code for NumPy arrays and torch tensors.

``q_ab`` takes vectors in b to a.  Products of many rotations need no loop over time: neighbours are multiplied, halving the
length each time.  Every function here is smooth at zero and, for tensors, differentiable.
"""

from __future__ import annotations

import sys

import numpy as np

#: below this squared half-angle the series is exact to double precision (its next term is 3e-18)
_SERIES_BELOW = 1e-3


def namespace(array):
    """The library an array belongs to, numpy or torch, without importing torch for those who have none."""
    torch = sys.modules.get("torch")
    return torch if torch is not None and isinstance(array, torch.Tensor) else np


def join(parts):
    """Components (...) as one array (..., n), each contiguous in memory: twice as fast to compute with as interleaved ones."""
    xp = namespace(parts[0])
    return xp.moveaxis(xp.stack(parts, 0), 0, -1)


def multiply(p, q):
    """Hamilton product (..., 4): first q, then p."""
    pw, px, py, pz = (p[..., i] for i in range(4))
    qw, qx, qy, qz = (q[..., i] for i in range(4))
    return join(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ]
    )


def conjugate(q):
    """The inverse of a unit quaternion (..., 4)."""
    return join([q[..., 0], -q[..., 1], -q[..., 2], -q[..., 3]])


def exp(vector):
    """Quaternion (..., 4) of a rotation vector (..., 3) rad, exact at any angle."""
    xp = namespace(vector)
    h2 = (vector[..., 0] ** 2 + vector[..., 1] ** 2 + vector[..., 2] ** 2) / 4
    small = h2 < _SERIES_BELOW
    h = xp.sqrt(xp.where(small, xp.ones_like(h2), h2))
    cos = xp.where(small, 1 - h2 / 2 * (1 - h2 / 12 * (1 - h2 / 30)), xp.cos(h))
    half_sinc = xp.where(small, 1 - h2 / 6 * (1 - h2 / 20 * (1 - h2 / 42)), xp.sin(h) / h) / 2
    return join([cos, half_sinc * vector[..., 0], half_sinc * vector[..., 1], half_sinc * vector[..., 2]])


def log(q):
    """Rotation vector (..., 3) rad of the shorter way, |vector| <= pi, of unit quaternions (NumPy only)."""
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1)
    angle = 2 * np.arctan2(sine, q[..., 0])
    ratio = np.where(sine > 1e-9, angle / np.where(sine > 1e-9, sine, 1), 2.0)
    return ratio[..., None] * q[..., 1:]


def matrix(q):
    """Rotation matrix (..., 3, 3) of unit quaternions (..., 4)."""
    xp = namespace(q)
    w, x, y, z = (q[..., i] for i in range(4))
    rows = [
        xp.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
        xp.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
        xp.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
    ]
    return xp.stack(rows, -2)


def from_euler(roll, pitch, yaw):
    """Quaternion (..., 4) of R = Rz(yaw) Ry(pitch) Rx(roll), angles in rad (NumPy only)."""
    zero = np.zeros(np.broadcast_shapes(np.shape(roll), np.shape(pitch), np.shape(yaw)))
    about = [exp(np.stack([*(zero,) * axis, zero + angle, *(zero,) * (2 - axis)], -1)) for axis, angle in enumerate((roll, pitch, yaw))]
    return multiply(about[2], multiply(about[1], about[0]))


def from_gravity(accel):
    """Attitude q_nb (..., 4) with yaw 0 of a still body whose specific force is accel (..., 3): FORMATS, frames and signs."""
    x, y, z = (accel[..., i] for i in range(3))
    return from_euler(np.arctan2(-y, -z), np.arctan2(x, np.hypot(y, z)), 0.0)


def compose(steps):
    """Product q_0 q_1 … q_T-1 (..., 4) of body-frame steps (..., T, 4), in log2(T) vectorised multiplications."""
    tail = None
    while steps.shape[-2] > 1:
        even = steps.shape[-2] // 2 * 2
        if even < steps.shape[-2]:
            last = steps[..., -1, :]
            tail = last if tail is None else multiply(last, tail)
        steps = multiply(steps[..., 0:even:2, :], steps[..., 1:even:2, :])
    first = steps[..., 0, :]
    return first if tail is None else multiply(first, tail)


def accumulate(steps):
    """All partial products q_0 … q_k (..., T, 4) of steps (..., T, 4), by doubling spans (Hillis and Steele 1986)."""
    xp = namespace(steps)
    span = 1
    while span < steps.shape[-2]:
        both = (steps[..., :span, :], multiply(steps[..., :-span, :], steps[..., span:, :]))
        steps = xp.moveaxis(xp.concatenate([xp.moveaxis(part, -1, 0) for part in both], -1), 0, -1)
        span *= 2
    return steps
