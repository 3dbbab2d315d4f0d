"""Does the age of a unit's readings beat?  The sum of periodograms of short stretches, over every frequency that a reader can see.

A sensor that samples by its own clock and is read by another gives readings of an age between nothing and its own period.  The age grows
or falls evenly and jumps back, with the difference of the sensor's rate and the next multiple of the reader's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc, gammainccinv

from session.common.robust import sigma_of

#: s; over which an RC oscillator at rest keeps its phase, well enough
STRETCH_S = 10.0
#: frequencies per width of a stretch's peak
FINENESS = 5
#: points of time per reading
GRID = 8
#: of the strongest reading's weight; weaker ones add nothing
LEAST_WEIGHT = 1e-3
#: Hz; over which the level of what is no beat is taken to be one
LEVEL_HZ = 3.0
#: chance, over all frequencies together, with which a unit without any beat is said to have one
FALSE_ALARM = 1e-3


@dataclass(frozen=True, eq=False)
class AgeReadings:
    """What single readings say of a unit's age: t_s (N,) s, age_s (N,) s, each of a variance (N,) s^2, with spread_s^2 of it common
    to all; reader_s: the reader's period."""

    t_s: np.ndarray
    age_s: np.ndarray
    variance: np.ndarray
    reader_s: float
    spread_s: float = 0.0


@dataclass(frozen=True)
class Beat:
    """frequency_hz: without its sign; amplitude_s of the sinusoid there; p_value over all frequencies that were looked at."""

    frequency_hz: float
    amplitude_s: float
    p_value: float


def age_readings(t_s: np.ndarray, excess: np.ndarray, slope: np.ndarray, noise: float, reader_s: float) -> AgeReadings:
    """excess, slope (N, 3) rad/s and rad/s^2, as of a ``Difference``; noise: scatter of one component of the excess, rad/s.

    A reading that is old by a lacks a times the angular acceleration.  What else scatters with the acceleration is taken from the strongest
    readings themselves, ages and all.
    """
    power = np.square(slope).sum(axis=1)
    power = np.maximum(power, 1e-12 * max(float(power.max(initial=0.0)), 1e-300))
    age = -(excess * slope).sum(axis=1) / power
    white = noise**2 / power
    kept = white < np.quantile(white, 0.01) / LEAST_WEIGHT if len(white) else np.zeros(0, bool)
    t_s, age, white = t_s[kept], age[kept], white[kept]
    strong = white < np.median(white) if len(white) else white > 0
    if not strong.any():
        return AgeReadings(t_s, age, white, reader_s)
    spread_s = float(sigma_of(age[strong] - np.median(age[strong])))
    return AgeReadings(t_s, age, white + spread_s**2, reader_s, spread_s)


def find_beat(readings: AgeReadings) -> Beat:
    """The frequency that stands out most; p_value 1 where there are too few readings to say."""
    stretches = _stretches(readings)
    if not stretches:
        return Beat(0.0, 0.0, 1.0)
    # A fast Fourier transform of readings on a grid that is much finer than their reader's.
    step_s = readings.reader_s / GRID
    points = round(FINENESS * STRETCH_S / step_s)
    frequency = np.arange(round(0.5 * points / GRID)) / (points * step_s)
    weight = 1 / readings.variance
    middle = float(np.sum(weight * readings.age_s) / np.sum(weight))
    limit = 4 * np.sqrt(readings.variance)
    value = np.clip(readings.age_s - middle, -limit, limit)
    power, amplitude = np.zeros(len(frequency)), np.zeros(len(frequency))
    for part in stretches:
        gridded = np.zeros(points)
        np.add.at(gridded, np.rint((readings.t_s[part] - readings.t_s[part][0]) / step_s).astype(int), weight[part] * value[part])
        summed = np.abs(np.fft.rfft(gridded)[: len(frequency)])
        power += summed**2 / weight[part].sum()
        amplitude += 2 * summed
    # The level of a residual that is no white noise, where it has no line, is the median around.
    count = len(stretches)
    half = max(1, round(LEVEL_HZ * FINENESS * STRETCH_S))
    padded = np.pad(power, half, mode="reflect")
    level = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1) / float(gammainccinv(count, 0.5))
    ratio = power / np.maximum(level, 1.0)
    best = int(np.argmax(ratio))
    p_value = min(1.0, len(frequency) * float(gammaincc(count, ratio[best])))
    return Beat(float(frequency[best]), float(amplitude[best] / weight.sum()), p_value)


def _stretches(readings: AgeReadings) -> list[np.ndarray]:
    """Readings by stretches of time that hold enough of them."""
    if not len(readings.t_s):
        return []
    index = np.floor((readings.t_s - readings.t_s[0]) / STRETCH_S).astype(int)
    return [rows for rows in (np.flatnonzero(index == each) for each in np.unique(index)) if len(rows) >= 8]
