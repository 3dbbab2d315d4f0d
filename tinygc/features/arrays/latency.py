"""Read latency: the age of each unit's readings when they are read, for units that sample by clocks of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.special import gammainccinv, ndtr

from session.base.numeric import nearest_row, rms_of, sigma_of
from session.base.units import NS
from session.log.logfile import Log
from tinygc.features.arrays.clocks import ClockFit, Rates, UnitClock, noise_of, session_rates
from tinygc.features.arrays.recording import ArraySession
from tinygc.inference.choose import chance_of_any, chi_square_above

# Detection of a beat in the age of a unit's readings: the sum of periodograms of short stretches, over all frequencies a reader can
# resolve.
#
# A sensor that samples by its own clock and is read by another gives readings of an age between zero and its own period. The age grows or
# falls linearly and jumps back, at the difference of the sensor's rate and the nearest multiple of the reader's.

#: s, length of a stretch over which an RC oscillator at rest keeps its phase well enough
STRETCH_S = 10.0
#: frequencies per width of a stretch's peak
FINENESS = 5
#: time points per reading
GRID = 8
#: least weight of a reading, relative to the strongest one
LEAST_WEIGHT = 1e-3
#: Hz; width over which the background level is taken as constant
LEVEL_HZ = 3.0
#: false-alarm probability of a beat, over all frequencies together
FALSE_ALARM = 1e-3


@dataclass(frozen=True, eq=False)
class AgeReadings:
    """Ages as measured by single readings.

    t_s (N,) s, age_s (N,) s, each of a variance (N,) s^2, with spread_s^2 of it common to all; reader_s: the reader's period.
    """

    t_s: np.ndarray
    age_s: np.ndarray
    variance: np.ndarray
    reader_s: float
    spread_s: float = 0.0


def age_readings(t_s: np.ndarray, excess: np.ndarray, slope: np.ndarray, noise: float, reader_s: float) -> AgeReadings:
    """Estimate ages from excess and slope (N, 3), rad/s and rad/s^2, as of ``_differences``.

    noise: scatter of one excess component, rad/s.

    A reading that is old by a is short of a times the angular acceleration.  Other scatter proportional to the acceleration is estimated
    from the strongest readings themselves, including their ages.
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


def find_beat(readings: AgeReadings) -> tuple[float, float, float]:
    """Return the highest peak of a unit's ages: its frequency, Hz, without its sign; the amplitude, s, of the sinusoid there; the p-value
    over all frequencies searched, 1 where there are too few readings."""
    stretches = _spans(readings.t_s - readings.t_s[:1], STRETCH_S, 8)
    if not stretches:
        return 0.0, 0.0, 1.0
    # fast Fourier transform of readings on a grid much finer than the reader's period
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
    # the background of a coloured residual is the median of the periodogram around a frequency
    count = len(stretches)
    half = max(1, round(LEVEL_HZ * FINENESS * STRETCH_S))
    padded = np.pad(power, half, mode="reflect")
    level = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1) / float(gammainccinv(count, 0.5))
    ratio = power / np.maximum(level, 1.0)
    best = int(np.argmax(ratio))
    p_value = chance_of_any(chi_square_above(2 * float(ratio[best]), 2 * count), len(frequency))
    return float(frequency[best]), float(amplitude[best] / weight.sum()), p_value


def _spans(t_s: np.ndarray, length_s: float, fewest: int) -> list[np.ndarray]:
    """Rows of times (N,) in spans of this length, of those that hold enough of them."""
    index = np.floor(t_s / length_s).astype(np.int64)
    return [rows for rows in (np.flatnonzero(index == each) for each in np.unique(index)) if len(rows) >= fewest]


# Phase of a beat through a recording in which only some readings determine it.
#
# States are a grid of phase and frequency. Between windows the phase advances by the frequency, and the frequency wanders as an
# oscillator's does while it warms up. Each window's readings give a likelihood of every phase. The forward and backward pass (Rabiner,
# Proc. IEEE 77, 1989) give phase and frequency of every window with their sigmas, and the probability of all readings, which decides the
# sign.

PHASES = 64
#: Hz; range around the detected frequency, and step
REACH_HZ, STEP_HZ = 0.09, 0.0015
#: Hz per root second, of the frequency's random walk: an oscillator of 1 kHz that changes by some 20 ppm in ten minutes
WALK_HZ = 1e-3
#: s; a window's phase advances by the frequency at its middle
WINDOW_S = 1.0
#: share of readings assumed to be outliers, and the number of periods over which these scatter
SPOILT, SPOILT_PERIODS = 0.02, 8.0


@dataclass(frozen=True, eq=False)
class PhaseTrack:
    """Phase and frequency of a beat over time.

    t_s (W,) s: middles of the windows; cycles (W,): phase, not wrapped; frequency_hz (W,), positive where the phase grows; sigma_cycles and
    sigma_hz (W,); log_probability of all readings, relative to no beat.
    """

    t_s: np.ndarray
    cycles: np.ndarray
    frequency_hz: np.ndarray
    sigma_cycles: np.ndarray
    sigma_hz: np.ndarray
    log_probability: float

    @property
    def beat(self) -> tuple[float, float]:
        """Return the frequency and its sigma, Hz, where it is known best."""
        best = int(np.argmin(self.sigma_hz))
        return float(self.frequency_hz[best]), float(self.sigma_hz[best])

    def at(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the phase in cycles, not wrapped, and its sigma at times (N,) s."""
        if len(self.t_s) == 1:
            return self.cycles[0] + self.frequency_hz[0] * (t_s - self.t_s[0]), np.full(len(t_s), self.sigma_cycles[0])
        inside = np.clip(t_s, self.t_s[0], self.t_s[-1])
        phase = CubicHermiteSpline(self.t_s, self.cycles, self.frequency_hz)(inside)
        phase = phase + np.where(t_s < inside, self.frequency_hz[0], self.frequency_hz[-1]) * (t_s - inside)
        nearest = np.abs(t_s - self.t_s[nearest_row(self.t_s, t_s)])
        sigma = np.interp(t_s, self.t_s, self.sigma_cycles)
        return phase, np.sqrt(sigma**2 + WALK_HZ**2 * nearest**3 / 3)


def sawtooth(cycles: np.ndarray, sigma_cycles: np.ndarray) -> np.ndarray:
    """Return the expected fraction of a phase in cycles with a given sigma: between 0 and 1, its edge smoothed by the sigma."""
    x = cycles - np.floor(cycles)
    sigma = np.maximum(sigma_cycles, 1e-9)
    below = sum(ndtr((x - n) / sigma) for n in (1, 2))
    above = sum(ndtr((n - x) / sigma) for n in (0, -1))
    return np.clip(x - below + above, 0.0, 1.0)


def track(readings: AgeReadings, beat_hz: float, period_s: float, offset_s: float) -> PhaseTrack:
    """Track the phase of ages ``offset + period frac(phase)``; beat_hz with its sign."""
    windows = _spans(readings.t_s, WINDOW_S, 3)
    middle = np.array([np.average(readings.t_s[w], weights=1 / readings.variance[w]) for w in windows])
    likelihood, none = np.zeros((len(windows), PHASES)), 0.0
    grid = np.arange(PHASES) / PHASES
    for number, rows in enumerate(windows):
        phase = grid[:, None] + beat_hz * (readings.t_s[rows] - middle[number])
        ages = offset_s + period_s * (phase - np.floor(phase))
        likelihood[number] = _log_likelihood(readings, rows, ages, period_s).sum(axis=1)
        none += float(_log_likelihood(readings, rows, np.full((1, len(rows)), offset_s + period_s / 2), period_s).sum())
    return _passes(middle, likelihood, beat_hz, none)


def _log_likelihood(readings: AgeReadings, rows: np.ndarray, ages: np.ndarray, period_s: float) -> np.ndarray:
    variance, square = readings.variance[rows], (readings.age_s[rows] - ages) ** 2
    both = (variance, variance + (SPOILT_PERIODS * period_s) ** 2)
    good, spoilt = (np.exp(-0.5 * square / each) / np.sqrt(2 * np.pi * each) for each in both)
    return np.asarray(np.log((1 - SPOILT) * good + SPOILT * spoilt))


def _passes(middle: np.ndarray, likelihood: np.ndarray, beat_hz: float, none: float) -> PhaseTrack:
    frequency = beat_hz + STEP_HZ * np.arange(-round(REACH_HZ / STEP_HZ), round(REACH_HZ / STEP_HZ) + 1)
    count = len(middle)
    shape = (len(frequency), PHASES)
    weight = np.exp(likelihood - likelihood.max(axis=1, keepdims=True))

    def passed(order: Sequence[int]) -> dict[int, np.ndarray]:
        """Of each window its state by those before it in this order."""
        state, found = np.full(shape, 1 / (shape[0] * shape[1])), {}
        for before, k in zip((None, *order), order, strict=False):
            if before is not None:
                state = _moved(state * weight[before], frequency, middle[k] - middle[before])
                state = state / state.sum()
            found[k] = state
        return found

    forward, backward = passed(range(count)), passed(range(count)[::-1])
    total = float(likelihood.max(axis=1).sum()) + sum(float(np.log((forward[k] * weight[k]).sum())) for k in range(count))
    both = np.array([forward[k] * weight[k] * backward[k] for k in range(count)])
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
    """Propagate the distribution (F, P) forwards or backwards in time: half the drift, the frequency's random walk, the other half."""
    half = np.exp(-2j * np.pi * np.outer(frequency * seconds / 2, np.arange(PHASES // 2 + 1)))
    spectrum = np.fft.rfft(state, axis=1) * half
    width = WALK_HZ * np.sqrt(abs(seconds)) / STEP_HZ
    reach = max(1, min(int(np.ceil(4 * width)), len(frequency) // 2))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(width, 0.3)) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(spectrum, ((reach, reach), (0, 0)))
    walked = sum(weight * padded[i : i + len(frequency)] for i, weight in enumerate(kernel))
    return np.maximum(np.fft.irfft(walked * half, PHASES, axis=1), 1e-15 / state.size)


# Motion common to all units of an array, and each unit's rates beyond it.
#
# Each unit is compared with the mean of the others, so that its own error is not in its reference. Rates are in the gyroscope's axes of the
# first unit; a linear map takes each unit's there, with its scales and misalignments.


#: of each unit and log
_Logs = list[list[Rates]]


#: one unit's difference from the others, over all its logs, at readings that all units cover: t_s (N,) s array clock, as stamped; excess
#: (N, 3) rad/s, the unit's rate in the first unit's axes minus the others' mean at that time; slope (N, 3) rad/s^2 of that mean
_Difference = tuple[np.ndarray, np.ndarray, np.ndarray]


def _differences(
    stamped: _Logs, moved: _Logs, maps: list[np.ndarray], offsets: list[np.ndarray]
) -> tuple[list[_Difference], list[np.ndarray], list[np.ndarray]]:
    """Return every unit's difference from the others with its map refitted, and the new maps and offsets.

    stamped, moved: rates on one clock, as stamped and at the times of the readings; maps (3, 3) and offsets (logs, 3) rad/s of each unit.
    """
    splines = [[each.spline() for each in unit] for unit in moved]
    slopes = [[spline.derivative() for spline in unit] for unit in splines]
    found, new_maps, new_offsets = [], [], []
    for unit, own in enumerate(moved):
        others = [each for each in range(len(moved)) if each != unit]
        parts = []
        for number, mine in enumerate(own):
            covered = mine.good & np.all([moved[other][number].covers(mine.t_s) for other in others], axis=0)
            rows = np.flatnonzero(covered)
            at = stamped[unit][number].t_s[rows]
            # compared with the motion at the stamp, so that the whole age shows
            rate = np.mean([(splines[o][number](at) - offsets[o][number]) @ maps[o].T for o in others], axis=0)
            slope = np.mean([slopes[o][number](at) @ maps[o].T for o in others], axis=0)
            parts.append((at, np.full(len(rows), number), at - mine.t_s[rows], mine.rate[rows], rate, slope))
        t_s, log, age, read, rate, slope = (np.concatenate(each) for each in zip(*parts, strict=True))
        design = np.hstack([read, (log[:, None] == np.arange(len(own))).astype(float)])
        target = rate - age[:, None] * slope  # the others' rate at the time of the reading
        coefficients = np.linalg.lstsq(design, target, rcond=None)[0]
        found.append((t_s, design @ coefficients - rate, slope))
        new_maps.append(coefficients[:3].T)
        new_offsets.append(-np.linalg.solve(coefficients[:3].T, coefficients[3:].T).T)
    return found, new_maps, new_offsets


# Age of each unit's readings when they are read: a sawtooth, for a unit that samples by its own clock and waits for the reader.
#
# A sensor of 1 kHz that is read 62.5 times a second returns its newest sample, which is between 0 and 1 ms old. The age drifts and jumps
# back with a beat. A turn of 200 deg/s in progress at a jump is wrong by 0.2 deg. One unit alone cannot detect that. Units that felt the
# same motion can: the old reading is short of the age times the angular acceleration.
#
# Each unit is compared with the mean of the others. Their ages are in that mean, so all are estimated again with the others' ages
# subtracted. A constant common to all ages is equivalent to an offset of the array's clock. Two units determine only the difference of
# their ages.

#: fewest units: with two, the ages cannot be attributed
LEAST_UNITS = 3
#: iterations over all units' ages, each with the others' subtracted; a fourth moves half of the ages of mimu's first experiment by less
#: than 0.003 ms
ROUNDS = 3
#: share of a period; a reading nearer to the jump may be on its other side
NEAR_JUMP = 0.1
#: fewest jumps in a recording; the ages by a wandering clock are no sawtooth
LEAST_CYCLES = 2.0
#: harmonics of a sawtooth that may show in another unit; distance from one within which a beat is taken for it, the width of a stretch's
#: peak
HARMONICS, ECHO_HZ = 5, 1 / STRETCH_S
#: periods; a reading farther off is an outlier
WILD = 2.0


@dataclass(frozen=True, eq=False)
class SampleAges:
    """Latency of one unit.

    clock of the unit; p_value: chance of so strong a beat without one, over all frequencies searched; track: the phase of its readings'
    ages over time on the array's clock, None where they do not beat, whose frequency is the rate of its samples less the nearest multiple
    of the reader's; period_s of its samples, and its sigma; scatter_s: of single readings' ages about these.
    """

    number: int
    clock: UnitClock
    p_value: float = 1.0
    track: PhaseTrack | None = None
    period_s: float = 0.0
    period_sigma_s: float = 0.0
    scatter_s: float = 0.0

    def age_s(self, t_s: np.ndarray) -> np.ndarray:
        """Return the expected ages (N,) s of readings with these stamps, s of the unit's own clock; 0 where no beat was found."""
        if self.track is None:
            return np.zeros(len(t_s))
        return np.asarray(self.period_s * sawtooth(*self.track.at(self.clock.array_time(t_s))))


def ages_of(array: ArraySession, fits: Sequence[ClockFit]) -> tuple[SampleAges, ...]:
    """Estimate the ages of every unit's readings; fits: of every unit (``clock_fits``).  With fewer than three units none is found."""
    clocks = [fit.clock for fit in fits]
    ages = [SampleAges(number, clock) for number, clock in zip(array.numbers, clocks, strict=True)]
    if len(array) < LEAST_UNITS:
        return tuple(ages)
    rates = [session_rates(unit) for unit in array.units]
    stamped = [[replace(each, t_s=clock.array_time(each.t_s)) for each in mine] for mine, clock in zip(rates, clocks, strict=True)]
    _, maps, offsets = _differences(stamped, stamped, [np.linalg.inv(fit.matrix) for fit in fits], [fit.bias for fit in fits])
    moved = stamped
    for _ in range(ROUNDS):
        found, maps, offsets = _differences(stamped, moved, maps, offsets)
        ages = [_aged(before, difference, mine[0].period_s) for before, difference, mine in zip(ages, found, rates, strict=True)]
        ages = [replace(each, track=None) if _is_echo(each, ages) else each for each in ages]
        moved = [
            [replace(one, t_s=one.t_s - each.age_s(log.t_s)) for one, log in zip(unit, mine, strict=True)]
            for each, unit, mine in zip(ages, stamped, rates, strict=True)
        ]
    return tuple(ages)


def _is_echo(one: SampleAges, ages: Sequence[SampleAges]) -> bool:
    """Return whether a beat is another unit's, or one of its harmonics, seen through the mean of the others.

    In that mean each of the others has its share of the weight, and no more.
    """
    for other in ages:
        if one.track is None or other.track is None or one.period_s > other.period_s / (len(ages) - 1):
            continue
        (hz, sigma_hz), (own_hz, own_sigma_hz) = other.track.beat, one.track.beat
        near = max(ECHO_HZ, 4 * np.hypot(own_sigma_hz, sigma_hz))
        if (np.abs(abs(hz) * np.arange(1, HARMONICS + 1) - abs(own_hz)) < near).any():
            return True
    return False


def _aged(before: SampleAges, difference: _Difference, reader_s: float) -> SampleAges:
    """Estimate one unit's ages relative to the others' current ones."""
    t_s, excess, slope = difference
    readings = age_readings(t_s, excess, slope, rms_of(noise_of(excess)), reader_s)
    beat_hz, amplitude_s, p_value = find_beat(readings)
    none = SampleAges(before.number, before.clock, p_value)
    if p_value > FALSE_ALARM:
        return none
    period, beats = np.pi * amplitude_s, [beat_hz, -beat_hz]
    offset = float(np.average(readings.age_s, weights=1 / readings.variance)) - period / 2
    for _ in range(2):
        phases = max((track(readings, hz, period, offset) for hz in beats), key=lambda way: way.log_probability)
        period, sigma, offset, scatter = _sized(readings, phases)
        few = abs(phases.cycles[-1] - phases.cycles[0]) < LEAST_CYCLES
        if few or not 0 < period < reader_s or phases.log_probability < -np.log(FALSE_ALARM):
            return none
        # with known ages, the remaining scatter is smaller than first assumed
        least = np.maximum(readings.variance - readings.spread_s**2, 0.0)
        readings, beats = replace(readings, variance=least + scatter**2, spread_s=scatter), [phases.beat[0]]
    return SampleAges(before.number, before.clock, p_value, phases, period, sigma, scatter)


def _sized(readings: AgeReadings, phases: PhaseTrack) -> tuple[float, float, float, float]:
    """Return the height of the sawtooth and its sigma, the offset added to it, and the scatter of single readings about it, s."""
    cycles, blur = phases.at(readings.t_s)
    part = cycles - np.floor(cycles)
    height, weight = sawtooth(cycles, blur), 1 / readings.variance
    period, offset = 1e-3, 0.0
    kept = (part > NEAR_JUMP) & (part < 1 - NEAR_JUMP) & (blur < NEAR_JUMP)
    near = kept
    for _ in range(3):
        design = np.column_stack([height[near], np.ones(np.count_nonzero(near))])
        scaled = design * weight[near, None]
        period, offset = np.linalg.lstsq(scaled.T @ design, scaled.T @ readings.age_s[near], rcond=None)[0]
        miss = readings.age_s - offset - period * height
        near = kept & (np.abs(miss) < WILD * max(period, 1e-9))
    scatter = float(np.sqrt(np.average(miss[near] ** 2, weights=weight[near]))) if near.any() else 0.0
    spread = np.average((height[near] - np.average(height[near], weights=weight[near])) ** 2, weights=weight[near])
    apart = height[near] - np.average(height[near], weights=weight[near])
    sigma = float(np.sqrt(np.sum((weight[near] * miss[near] * apart) ** 2)) / np.sum(weight[near]) / spread)
    return float(period), sigma, float(offset), scatter


def corrected(array: ArraySession, ages: Sequence[SampleAges]) -> ArraySession:
    """Return the same readings stamped when they were measured: each unit's own clock less the age."""

    def earlier(each: SampleAges, log: Log) -> Log:
        t_ns = log.samples.t_ns - np.rint(each.age_s(log.samples.t_ns * NS) / NS).astype(np.int64)
        return replace(log, samples=replace(log.samples, t_ns=t_ns))

    units = [unit.with_logs(partial(earlier, each)) for unit, each in zip(array.units, ages, strict=True)]
    return replace(array, units=tuple(units))
