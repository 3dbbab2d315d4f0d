"""Unit quaternions, scalar first, for a picture: plain numbers, since numpy is slow on four of them."""

from __future__ import annotations

import math

import numpy as np

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]
NONE: Quaternion = (1.0, 0.0, 0.0, 0.0)
UP = np.array([0.0, 0.0, 1.0])


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton's product: first b, then a."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def exp(x: float, y: float, z: float) -> Quaternion:
    """Of a rotation vector, rad."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return NONE
    by = math.sin(angle / 2) / angle
    return (math.cos(angle / 2), x * by, y * by, z * by)


def normalised(q: Quaternion) -> Quaternion:
    """Of length one again."""
    length = math.sqrt(sum(part * part for part in q))
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def rotated(q: Quaternion, vector: np.ndarray) -> np.ndarray:
    """A vector (3,) of the body, in the frame that q takes it to."""
    w, v = q[0], np.array(q[1:])
    return vector + 2 * w * np.cross(v, vector) + 2 * np.cross(v, np.cross(v, vector))


def inverse(q: Quaternion) -> Quaternion:
    """The way back."""
    return (q[0], -q[1], -q[2], -q[3])


def levelled(q: Quaternion, force: np.ndarray, part: float = 1.0) -> Quaternion:
    """q, turned on the shortest way, or a part of it, so that the specific force (3,) of a rest points up; the heading stays as it was."""
    up = rotated(q, force / max(float(np.linalg.norm(force)), 1e-9))
    axis, cosine = np.cross(up, UP), float(up @ UP)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return q if cosine > 0 else normalised(multiply((0.0, 1.0, 0.0, 0.0), q))
    x, y, z = axis * part * math.atan2(sine, cosine) / sine
    return normalised(multiply(exp(x, y, z), q))
