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


def rows(values: np.ndarray) -> np.ndarray:
    """(N, 3, 3 K) columns of a (3, K) parameter, a row for each axis, from what one unit of each adds to its axis: values (N, 3, K), or
    (N, 1, K) where they are the same for all axes."""
    count, _, each = values.shape
    columns = np.zeros((count, 3, 3, each))
    columns[:, range(3), range(3)] = values
    return columns.reshape(count, 3, 3 * each)


def full(inputs: np.ndarray) -> np.ndarray:
    """(N, 3, 9) columns of a 3x3 parameter, row by row, that multiplies inputs (N, 3)."""
    return rows(inputs[:, None, :])


def behind(values: np.ndarray) -> np.ndarray:
    """(N, 3, …) at each axis what the axis behind it has: at x that of y, at y that of z, at z that of x."""
    return values[:, [1, 2, 0]]


def before(values: np.ndarray) -> np.ndarray:
    """(N, 3, …) at each axis what the axis before it has: at x that of z, at y that of x, at z that of y."""
    return values[:, [2, 0, 1]]


def cross(inputs: np.ndarray) -> np.ndarray:
    """(N, 3, 6) columns of a (3, 2) parameter: for each axis the shares of inputs (N, 3) of the axis behind and the one before."""
    return rows(np.stack([behind(inputs), before(inputs)], axis=-1))


def nothing(size: int) -> Callable[[Movement], np.ndarray]:
    """``columns`` (N, 3, size) of what adds nothing to the rate: it bends the reference, or is found in the registers."""
    return lambda movement: np.zeros((*movement.rate.shape, size))


def largest(theta: np.ndarray) -> float:
    """The parameter of the greatest size, with its sign."""
    return float(theta.ravel()[np.argmax(np.abs(theta))])


def axis_of(theta: np.ndarray) -> str:
    """The axis (row) whose parameter is greatest."""
    return "xyz"[int(np.argmax(np.abs(theta).reshape(3, -1).max(axis=1)))]
