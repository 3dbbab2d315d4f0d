"""The rate that a law adds, sample by sample, beside what a calibration takes up: by this, two laws are the same or not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tinygc.effects import Effect, Movement

#: of the rates that two laws add, from which on they are one law in numbers
EQUAL = 0.99


def added(effect: Effect, theta: np.ndarray, movements: Sequence[Movement]) -> np.ndarray:
    """(N, 3) rad/s over all logs, one after the other."""
    return np.concatenate([effect.columns(effect.shown(movement)) @ theta for movement in movements])


def beside_calibration(rate: np.ndarray, movements: Sequence[Movement]) -> np.ndarray:
    """What of an added rate (N, 3) no E m + B gives: each axis less its regression on one and the three rates."""
    measured = np.concatenate([movement.rate for movement in movements])
    q, _ = np.linalg.qr(np.column_stack([np.ones(len(measured)), measured]))
    return rate - q @ (q.T @ rate)


def correlation(first: np.ndarray, second: np.ndarray) -> float:
    """Of two added rates (N, 3), about zero, all axes together; 0 where one of them adds nothing."""
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.sum(first * second)) / size if size > 0 else 0.0
