"""Attitudes of a sensor on a table, from the angles of its axes.

    R_tb = Rot(a_1, alpha_1) Rot(a_2, alpha_2) ... M

a_k: direction of axis k at angles of zero, from the ground outwards; M: mounting, from the body to the innermost stage.  A rate of axis k
turns the body about ``R_tb^T Rot(a_1, alpha_1) ... Rot(a_k-1, alpha_k-1) a_k``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tinygc.features.tables.machines.description import Description


def rotations(direction: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """(N, 3, 3) right-handed rotations by angles (N,) rad about a unit direction (3,)."""
    x, y, z = direction
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.asarray(angle, dtype=float)[..., None, None]
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)


def attitudes(table: Description, angles: np.ndarray) -> np.ndarray:
    """``R_tb`` (N, 3, 3) of angles (N, K) rad, one column for each axis."""
    return stage_attitudes([axis.direction for axis in table.axes], angles) @ table.mounting


def stage_attitudes(directions: Sequence[np.ndarray], angles: np.ndarray) -> np.ndarray:
    """(N, 3, 3): the innermost stage to the table frame."""
    product = np.broadcast_to(np.eye(3), (len(angles), 3, 3))
    for direction, angle in zip(directions, np.asarray(angles, dtype=float).T, strict=True):
        product = product @ rotations(direction, angle)
    return product


def body_axes(table: Description, angles: np.ndarray) -> np.ndarray:
    """(N, K, 3): the body's rate, rad/s per rad/s of each axis, at angles (N, K) rad."""
    outside, found = np.broadcast_to(np.eye(3), (len(angles), 3, 3)), []
    for axis, angle in zip(table.axes, np.asarray(angles, dtype=float).T, strict=True):
        found.append(outside @ axis.direction)
        outside = outside @ rotations(axis.direction, angle)
    return np.einsum("nij,nki->nkj", outside @ table.mounting, np.stack(found, axis=1))


def roll_pitch_yaw(matrix: np.ndarray) -> np.ndarray:
    """(N, 3) rad of ``R = Rz(yaw) Ry(pitch) Rx(roll)`` (N, 3, 3)."""
    pitch = np.arctan2(-matrix[:, 2, 0], np.hypot(matrix[:, 0, 0], matrix[:, 1, 0]))
    level = np.cos(pitch) > 1e-9  # else roll and yaw are one: roll is 0
    roll = np.where(level, np.arctan2(matrix[:, 2, 1], matrix[:, 2, 2]), 0.0)
    yaw = np.where(level, np.arctan2(matrix[:, 1, 0], matrix[:, 0, 0]), np.arctan2(-matrix[:, 0, 1], matrix[:, 1, 1]))
    return np.stack([roll, pitch, yaw], axis=1)
