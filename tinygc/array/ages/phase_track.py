"""The phase of a beat through a recording whose readings tell it only here and there.

States are a grid of phase and frequency.  From window to window the phase goes on by the frequency, and the frequency wanders as an
oscillator's does while it warms up.  Each window's readings give a likelihood of every phase.  Both passes together (Rabiner, Proc. IEEE
77, 1989) give phase and frequency of every window with their sigmas, and the probability of all readings, by which the sign is decided.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.special import ndtr

from tinygc.array.ages.beats import AgeReadings

PHASES = 64
#: Hz; how far around where the beat stands out, and how finely
REACH_HZ, STEP_HZ = 0.09, 0.0015
#: Hz per root second, of the frequency's walk: an oscillator of 1 kHz that changes by some 20 ppm in ten minutes
WALK_HZ = 1e-3
#: s; a window's phase goes on by the frequency at its middle
WINDOW_S = 1.0
#: share of the readings that anything may have spoilt, and over how many periods they then scatter
SPOILT, SPOILT_PERIODS = 0.02, 8.0


@dataclass(frozen=True, eq=False)
class PhaseTrack:
    """t_s (W,) s: middles of the windows; cycles (W,): phase, not wrapped; frequency_hz (W,), positive where the phase grows; sigma_cycles
    and sigma_hz (W,); log_probability of all readings, beyond the one without any beat."""

    t_s: np.ndarray
    cycles: np.ndarray
    frequency_hz: np.ndarray
    sigma_cycles: np.ndarray
    sigma_hz: np.ndarray
    log_probability: float

    def at(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Phase in cycles, not wrapped, and its sigma at moments (N,) s."""
        if len(self.t_s) == 1:
            return self.cycles[0] + self.frequency_hz[0] * (t_s - self.t_s[0]), np.full(len(t_s), self.sigma_cycles[0])
        inside = np.clip(t_s, self.t_s[0], self.t_s[-1])
        phase = CubicHermiteSpline(self.t_s, self.cycles, self.frequency_hz)(inside)
        phase = phase + np.where(t_s < inside, self.frequency_hz[0], self.frequency_hz[-1]) * (t_s - inside)
        nearest = np.abs(t_s - self.t_s[np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1) - 1])
        nearest = np.minimum(nearest, np.abs(self.t_s[np.clip(np.searchsorted(self.t_s, t_s), 0, len(self.t_s) - 1)] - t_s))
        sigma = np.interp(t_s, self.t_s, self.sigma_cycles)
        return phase, np.sqrt(sigma**2 + WALK_HZ**2 * nearest**3 / 3)


def sawtooth(cycles: np.ndarray, sigma_cycles: np.ndarray) -> np.ndarray:
    """Expected fraction of a phase in cycles, known to a sigma: between 0 and 1, its edge as blunt as the phase is uncertain."""
    x = cycles - np.floor(cycles)
    sigma = np.maximum(sigma_cycles, 1e-9)
    below = sum(ndtr((x - n) / sigma) for n in (1, 2))
    above = sum(ndtr((n - x) / sigma) for n in (0, -1))
    return np.clip(x - below + above, 0.0, 1.0)


def track(readings: AgeReadings, beat_hz: float, period_s: float, offset_s: float) -> PhaseTrack:
    """Of ages ``offset + period frac(phase)``; beat_hz with its sign."""
    windows = _windows(readings)
    middle = np.array([np.average(readings.t_s[w], weights=1 / readings.variance[w]) for w in windows])
    likelihood, none = np.zeros((len(windows), PHASES)), 0.0
    grid = np.arange(PHASES) / PHASES
    for number, rows in enumerate(windows):
        phase = grid[:, None] + beat_hz * (readings.t_s[rows] - middle[number])
        ages = offset_s + period_s * (phase - np.floor(phase))
        likelihood[number] = _log_likelihood(readings, rows, ages, period_s).sum(axis=1)
        none += float(_log_likelihood(readings, rows, np.full((1, len(rows)), offset_s + period_s / 2), period_s).sum())
    return _passes(middle, likelihood, beat_hz, none)


def _windows(readings: AgeReadings) -> list[np.ndarray]:
    index = np.floor(readings.t_s / WINDOW_S).astype(np.int64)
    return [rows for rows in (np.flatnonzero(index == each) for each in np.unique(index)) if len(rows) >= 3]


def _log_likelihood(readings: AgeReadings, rows: np.ndarray, ages: np.ndarray, period_s: float) -> np.ndarray:
    variance = readings.variance[rows]
    good = np.exp(-0.5 * (readings.age_s[rows] - ages) ** 2 / variance) / np.sqrt(2 * np.pi * variance)
    wide = variance + (SPOILT_PERIODS * period_s) ** 2
    spoilt = np.exp(-0.5 * (readings.age_s[rows] - ages) ** 2 / wide) / np.sqrt(2 * np.pi * wide)
    return np.asarray(np.log((1 - SPOILT) * good + SPOILT * spoilt))


def _passes(middle: np.ndarray, likelihood: np.ndarray, beat_hz: float, none: float) -> PhaseTrack:
    frequency = beat_hz + STEP_HZ * np.arange(-round(REACH_HZ / STEP_HZ), round(REACH_HZ / STEP_HZ) + 1)
    count = len(middle)
    shape = (len(frequency), PHASES)
    weight = np.exp(likelihood - likelihood.max(axis=1, keepdims=True))
    forward, backward = np.empty((count, *shape)), np.empty((count, *shape))
    state, total = np.full(shape, 1 / (shape[0] * shape[1])), float(likelihood.max(axis=1).sum())
    for k in range(count):
        if k:
            state = _moved(state, frequency, middle[k] - middle[k - 1])
        state = state * weight[k]
        total += float(np.log(state.sum()))
        state = state / state.sum()
        forward[k] = state
    state = np.ones(shape) / (shape[0] * shape[1])
    backward[-1] = state
    for k in range(count - 1, 0, -1):
        state = _moved(state * weight[k], frequency, middle[k - 1] - middle[k])
        state = state / state.sum()
        backward[k - 1] = state
    both = forward * backward
    both /= both.sum(axis=(1, 2), keepdims=True)
    mean_hz = both.sum(axis=2) @ frequency
    sigma_hz = np.sqrt(np.maximum(both.sum(axis=2) @ frequency**2 - mean_hz**2, STEP_HZ**2 / 12))
    vector = both.sum(axis=1) @ np.exp(2j * np.pi * np.arange(PHASES) / PHASES)
    wrapped = np.angle(vector) / (2 * np.pi)
    sigma = np.sqrt(-2 * np.log(np.clip(np.abs(vector), 1e-9, 1 - 1e-12))) / (2 * np.pi)
    cycles = wrapped.copy()
    for k in range(1, count):
        ahead = cycles[k - 1] + (mean_hz[k] + mean_hz[k - 1]) / 2 * (middle[k] - middle[k - 1])
        cycles[k] = wrapped[k] + round(float(ahead - wrapped[k]))
    return PhaseTrack(middle, cycles, mean_hz, sigma, sigma_hz, total - none)


def _moved(state: np.ndarray, frequency: np.ndarray, seconds: float) -> np.ndarray:
    """The distribution (F, P) so many seconds later, or earlier: half the way, the frequency's walk, the other half."""
    half = np.exp(-2j * np.pi * np.outer(frequency * seconds / 2, np.arange(PHASES // 2 + 1)))
    spectrum = np.fft.rfft(state, axis=1) * half
    width = WALK_HZ * np.sqrt(abs(seconds)) / STEP_HZ
    reach = max(1, min(int(np.ceil(4 * width)), len(frequency) // 2))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(width, 0.3)) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(spectrum, ((reach, reach), (0, 0)))
    walked = sum(weight * padded[i : i + len(frequency)] for i, weight in enumerate(kernel))
    return np.maximum(np.fft.irfft(walked * half, PHASES, axis=1), 1e-15 / state.size)
