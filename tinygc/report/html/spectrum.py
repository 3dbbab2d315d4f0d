"""The spectrum of what stands still: one-sided amplitude densities, averaged over windows that all lie within a still."""

from __future__ import annotations

import numpy as np
from scipy.signal import welch

#: a window of so many seconds: the lowest frequency that a still of a second or two has
WINDOW_S = 1.0
FEWEST_SAMPLES = 16


def density(pieces: list[np.ndarray], period_s: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Frequencies (F,) Hz and densities (F, 3) in the unit of the pieces (N_i, 3) per sqrt(Hz); None where no piece is a window long."""
    shortest = max((len(piece) for piece in pieces), default=0)
    size = min(round(WINDOW_S / period_s), shortest)
    if size < FEWEST_SAMPLES:
        return None
    total, count = 0.0, 0
    for piece in pieces:
        if len(piece) < size:
            continue
        windows = 2 * len(piece) // size - 1
        frequency, power = welch(piece, 1 / period_s, nperseg=size, axis=0, detrend="constant")
        total, count = total + power * windows, count + windows
    return frequency[1:], np.sqrt(total / count)[1:]
