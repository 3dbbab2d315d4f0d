"""How old each unit's readings are when they are read: a sawtooth, where the unit samples by its own clock and waits for the reader.

A sensor of 1 kHz that is asked 62.5 times a second answers with its newest sample, which is between 0 and 1 ms old.  The age drifts and
jumps back with a beat.  A turn of 200 deg/s that is under way at a jump is wrong by 0.2 deg.  One unit alone cannot know that.  Units that
felt the same motion can: the old reading lacks the age times the angular acceleration.

Each unit is held against the mean of the others.  Their ages are in that mean, so all are found again with the others' taken off.  A
constant that all ages share is the same thing as the array's clock.  Two units tell only the difference of their ages, and not whose it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from session.common.units import NS
from session.log.array_session import ArraySession
from session.log.folder import Session
from session.log.logfile import Log
from tinygc.array.ages.beats import FALSE_ALARM, STRETCH_S, AgeReadings, age_readings, find_beat
from tinygc.array.ages.phase_track import PhaseTrack, sawtooth, track
from tinygc.array.ages.shared_motion import Difference, SharedMotion
from tinygc.array.places.clocks import ClockFit, noise_of
from tinygc.array.places.place import UnitClock
from tinygc.array.places.rates import session_rates

#: with fewer nobody knows whose the difference is
LEAST_UNITS = 3
#: of finding all units' ages with the others' taken off; a fourth moves half of the ages of mimu's first experiment by less than 0.003 ms
ROUNDS = 3
#: of a period; nearer to the jump a reading may be on its other side
NEAR_JUMP = 0.1
#: jumps that a recording has to hold; a clock that wanders makes ages that are no sawtooth
LEAST_CYCLES = 2.0
#: of a sawtooth, that may show elsewhere; and how near to one a beat is taken for it, the width of a stretch's peak
HARMONICS, ECHO_HZ = 5, 1 / STRETCH_S
#: periods; farther off a reading is spoilt
WILD = 2.0


@dataclass(frozen=True, eq=False)
class SampleAges:
    """Of one unit: whether its readings' ages beat (found) and, where they do, with what.

    beat_hz: by how much its samples come faster than the next multiple of the reader's rate, where the recording tells it best, and its
    sigma; period_s of its samples, and its sigma; p_value: chance of so strong a beat without one, over all frequencies looked at; gain:
    logarithm of how much likelier the readings are with these ages; scatter_s: of single readings' ages about them; track: the phase, over
    time on the array's clock; clock of the unit.
    """

    number: int
    found: bool
    p_value: float
    beat_hz: float = 0.0
    beat_sigma_hz: float = 0.0
    period_s: float = 0.0
    period_sigma_s: float = 0.0
    gain: float = 0.0
    scatter_s: float = 0.0
    track: PhaseTrack | None = None
    clock: UnitClock = field(default_factory=UnitClock)

    def age_s(self, t_s: np.ndarray) -> np.ndarray:
        """Expected ages (N,) s of readings with these stamps, s of the unit's own clock; 0 where no beat was found."""
        if self.track is None:
            return np.zeros(len(t_s))
        return np.asarray(self.period_s * sawtooth(*self.track.at(self.clock.array_time(t_s))))


def ages_of(array: ArraySession, fits: Sequence[ClockFit]) -> tuple[SampleAges, ...]:
    """fits: of every unit (``places.clock_fits``).  Of fewer than three units none is found."""
    clocks = [fit.clock for fit in fits]
    ages = [SampleAges(number, False, 1.0, clock=clock) for number, clock in zip(array.numbers, clocks, strict=True)]
    if len(array) < LEAST_UNITS:
        return tuple(ages)
    rates = [session_rates(unit) for unit in array.units]
    motion = SharedMotion(rates, fits)
    motion.differences()  # the maps, each unit's on the mean of the others
    for _ in range(ROUNDS):
        found = motion.differences()
        ages = [_aged(before, difference, mine[0].period_s) for before, difference, mine in zip(ages, found, rates, strict=True)]
        ages = [SampleAges(a.number, False, a.p_value, clock=a.clock) if _is_echo(a, ages) else a for a in ages]
        motion.correct([[each.age_s(log.t_s) for log in mine] for each, mine in zip(ages, rates, strict=True)])
    return tuple(ages)


def _is_echo(one: SampleAges, ages: Sequence[SampleAges]) -> bool:
    """Whether a beat is another unit's, or one of its harmonics, as it shows in the mean that this unit is held against: each unit of the
    others has its share in that, and no more."""
    for other in ages:
        if not one.found or not other.found or one.period_s > other.period_s / (len(ages) - 1):
            continue
        harmonics = abs(other.beat_hz) * np.arange(1, HARMONICS + 1)
        near = max(ECHO_HZ, 4 * np.hypot(one.beat_sigma_hz, other.beat_sigma_hz))
        if (np.abs(harmonics - abs(one.beat_hz)) < near).any():
            return True
    return False


def _aged(before: SampleAges, difference: Difference, reader_s: float) -> SampleAges:
    """One unit's ages, as the others see them now."""
    noise = float(np.sqrt(np.mean(noise_of(difference.excess) ** 2)))
    readings = age_readings(difference.t_s, difference.excess, difference.slope, noise, reader_s)
    beat = find_beat(readings)
    none = SampleAges(before.number, False, beat.p_value, clock=before.clock)
    if beat.p_value > FALSE_ALARM:
        return none
    period, middle = np.pi * beat.amplitude_s, float(np.average(readings.age_s, weights=1 / readings.variance))
    ways = [track(readings, sign * beat.frequency_hz, period, middle - period / 2) for sign in (1, -1)]
    phases = max(ways, key=lambda way: way.log_probability)
    period, sigma, offset, scatter = _sized(readings, phases)
    best = int(np.argmin(phases.sigma_hz))
    few = abs(phases.cycles[-1] - phases.cycles[0]) < LEAST_CYCLES
    if few or not 0 < period < reader_s or phases.log_probability < -np.log(FALSE_ALARM):
        return none
    # What scatters beside the ages is less than what was taken for it before they were known.
    sharper = replace(readings, variance=np.maximum(readings.variance - readings.spread_s**2, 0.0) + scatter**2)
    phases = track(sharper, float(phases.frequency_hz[best]), period, offset)
    period, sigma, offset, scatter = _sized(sharper, phases)
    best = int(np.argmin(phases.sigma_hz))
    return SampleAges(
        before.number,
        True,
        beat.p_value,
        float(phases.frequency_hz[best]),
        float(phases.sigma_hz[best]),
        period,
        sigma,
        phases.log_probability,
        scatter,
        phases,
        before.clock,
    )


def _sized(readings: AgeReadings, phases: PhaseTrack) -> tuple[float, float, float, float]:
    """Height of the sawtooth and its sigma, what is added to it, and the scatter of single readings about it, s."""
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
    """The same readings with the stamps of when they were made: each unit's own clock less the age."""
    units = [_corrected(unit, each) if each.found else unit for unit, each in zip(array.units, ages, strict=True)]
    return replace(array, units=tuple(units))


def _corrected(unit: Session, ages: SampleAges) -> Session:
    def earlier(log: Log) -> Log:
        t_ns = log.samples.t_ns - np.rint(ages.age_s(log.samples.t_ns * NS) / NS).astype(np.int64)
        return replace(log, samples=replace(log.samples, t_ns=t_ns))

    return replace(unit, logs=tuple(map(earlier, unit.logs)), closures=tuple(map(earlier, unit.closures)))
