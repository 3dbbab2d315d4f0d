"""Columns that many effects share, and words about their parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tinygc.effects.movement import Movement


def diagonal(values: np.ndarray) -> np.ndarray:
    """(N, 3, 3) columns of a per-axis parameter from what one unit of it adds to each axis (N, 3) or to all (N,)."""
    columns = np.zeros((len(values), 3, 3))
    columns[:, range(3), range(3)] = values[:, None] if values.ndim == 1 else values
    return columns


def per_axis(basis: Callable[[Movement], np.ndarray]) -> Callable[[Movement], np.ndarray]:
    """``columns`` of a ``basis``."""
    return lambda movement: np.concatenate([diagonal(curve) for curve in basis(movement).T], axis=-1)


def full(inputs: np.ndarray) -> np.ndarray:
    """(N, 3, 9) columns of a 3x3 parameter, row by row, that multiplies inputs (N, 3)."""
    columns = np.zeros((len(inputs), 3, 3, 3))
    for axis in range(3):
        columns[:, axis, axis] = inputs
    return columns.reshape(len(inputs), 3, 9)


def nothing(size: int) -> Callable[[Movement], np.ndarray]:
    """``columns`` (N, 3, size) of what adds nothing to the rate: it bends the reference, or is found in the registers."""
    return lambda movement: np.zeros((*movement.rate.shape, size))


def largest(theta: np.ndarray) -> float:
    """The parameter of the greatest size, with its sign."""
    return float(theta.ravel()[np.argmax(np.abs(theta))])


def axis_of(theta: np.ndarray) -> str:
    """The axis (row) whose parameter is greatest."""
    return "xyz"[int(np.argmax(np.abs(theta).reshape(3, -1).max(axis=1)))]
