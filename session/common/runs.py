"""Runs of rows that a mask marks."""

from __future__ import annotations

import numpy as np


def runs_of(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First rows (R,), and rows behind the last (R,), of each run of True in a mask (N,) bool, in order: ``start <= i < stop``."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.view(np.int8), [0]])))
    return edges[::2], edges[1::2]
