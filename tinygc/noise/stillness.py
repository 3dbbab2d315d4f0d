"""The stills of a session: their Allan deviation, and their spectrum."""

from __future__ import annotations

import numpy as np

from tinygc.closure.floor import AllanCurve, allan_curve
from tinygc.closure.problem import Problem

#: least number of samples in a piece for an Allan deviation
SHORTEST_PIECE = 16


def stillness(problem: Problem) -> AllanCurve | None:
    """Allan deviation of all undisturbed stills with a first calibration applied; None if they are too short."""
    period_s = problem.logs[0].samples.period_s
    pieces = [
        problem.first(log.samples.gyro[still.start : still.stop])
        for log in problem.logs
        if abs(log.samples.period_s / period_s - 1) < 0.01
        for still in log.stills
        if still.problem is None and still.bumps == 0 and still.stop - still.start >= SHORTEST_PIECE
    ]
    return allan_curve(pieces, period_s) if pieces else None


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
    # Welch's method with Hann windows that overlap by half, in NumPy: importing ``scipy.signal`` takes as long as half of a fit.
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(size) / size)
    total, count = np.zeros((size // 2 + 1, 3)), 0
    for piece in pieces:
        if len(piece) < size:
            continue
        windows = 2 * len(piece) // size - 1
        cut = np.lib.stride_tricks.sliding_window_view(piece, size, axis=0)[:: size - size // 2]
        spectrum = np.fft.rfft((cut - cut.mean(axis=-1, keepdims=True)) * hann)
        total, count = total + np.mean(np.abs(spectrum) ** 2, axis=0).T * windows, count + windows
    power = total / count * (2 * period_s / np.sum(hann**2))
    if size % 2 == 0:
        power[-1] /= 2  # the highest frequency is its own mirror image
    return np.fft.rfftfreq(size, period_s)[1:], np.sqrt(power)[1:]
