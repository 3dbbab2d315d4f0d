"""Figures that several sections share: spread of gravity's length, spectrum of the stills."""

from __future__ import annotations

import numpy as np
from scipy.signal import welch

from session.io.units import MG
from tinygc.reporting.html.evidence import ReportData
from tinygc.reporting.html.markup import significant

# Spread of gravity's length over the stills, before and after: shown in the answer's card and charted in the accelerometer section.


def spread_text(misses: np.ndarray) -> str:
    """Standard deviation of the residuals, as text in mg."""
    return f"{significant(float(np.std(misses)) / MG, 2)} mg"


def misses_of(evidence: ReportData) -> tuple[np.ndarray | None, np.ndarray]:
    """Residuals of gravity's length in the reference stills, m/s^2, before (None if there is no other calibration) and after."""
    found = evidence.fit.accelerometer
    if found.misses_mps2 is not None:
        return found.misses_mps2
    gravity = evidence.problem.session.config.site.expected_gravity_mps2
    return None, np.array([np.linalg.norm(s.accel_mean) - gravity for s in evidence.problem.stills if s.problem is None])


# Spectrum of the stills: one-sided amplitude densities, averaged over windows that each lie within one still.

#: window length in seconds, short enough for stills of a second or two; it sets the lowest frequency
WINDOW_S = 1.0
FEWEST_SAMPLES = 16


def density(pieces: list[np.ndarray], period_s: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Frequencies (F,) Hz and densities (F, 3) in the unit of the pieces (N_i, 3) per sqrt(Hz); None if no piece holds a window."""
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
