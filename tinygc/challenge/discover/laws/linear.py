"""What a linear calibration, a bias and a 3x3 of the rate, cannot take up."""

from __future__ import annotations

import numpy as np


def beyond_linear(rate: np.ndarray, added: np.ndarray) -> np.ndarray:
    """(N, 3): what is left of ``added`` (N, 3) when a constant and the rate (N, 3), or further columns, are regressed out, axis by axis."""
    known = np.column_stack([np.ones(len(rate)), rate])
    # Normal equations: a few columns of like size, and hundreds of thousands of rows.
    scale = np.abs(known).max(axis=0)
    known = known / np.where(scale > 0, scale, 1.0)
    return added - known @ np.linalg.lstsq(known.T @ known, known.T @ added, rcond=1e-12)[0]


def rms(values: np.ndarray) -> float:
    """Of all numbers."""
    return float(np.sqrt(np.mean(np.square(values))))
