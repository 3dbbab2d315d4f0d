"""Live evaluation of a stream: stillness, turns, health of the stream, warm-up."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from session.base.numeric import median_length, sigma_of
from session.base.units import DEG, MDPS, MG, NS, STANDARD_GRAVITY_MPS2, G
from session.bench.clocks import ClockRatio
from session.bench.messages import AcceptedTurn
from session.detect.stills import (
    BUMP_RAD,
    BUMP_S,
    MEAN_SIGMAS,
    QUIET_ACCEL_RATIO,
    QUIET_VARIANCE_RATIO,
    TURNING_RPS,
    Still,
    block_moments,
    block_size,
    noise_variance,
)
from session.log.samples import Samples
from session.log.stamps import GAP_PERIODS, Pace

# Stillness as it happens, in blocks of 0.1 s, by the limits of ``session.detect.stills``.  It guides the operator; whether a still counts
# is decided by ``find_stills`` (``Window``), as it will be for the recorded log.

#: largest noise of the sensor before a first still is known: three times the data sheet's, one-sided densities
GYRO_CEILING, ACCEL_CEILING = 15 * MDPS, 180e-3 * MG
CEILING_S = 60.0  #: a table without a rest for so long trembles; then the noise is that of its calmest blocks
MEMORY_BLOCKS = 12_000  #: 20 min
NOISE_EVERY = 10  #: blocks between two estimates of the noise
UNKNOWN_ZERO_RPS = 10.0 * DEG  #: larger than any gyro's bias


@dataclass(frozen=True, eq=False)
class MotionBlock:
    """Mean rate (3,) and peak of one block, rad/s; quiet: whether it could be part of a still; why not, with number and limit."""

    duration_s: float
    gyro_mean: np.ndarray
    peak_rps: float
    quiet: bool
    why: str


class Stillness:
    """Classifies one block after the other.  period_s: the usual sample interval; memory: blocks whose calmest show the noise."""

    def __init__(self, period_s: float, memory: int = MEMORY_BLOCKS):
        self._period_s = period_s
        self.size = block_size(period_s)
        self._gyro_var: deque[np.ndarray] = deque(maxlen=memory)
        self._accel_var: deque[np.ndarray] = deque(maxlen=memory)
        self._blocks = 0
        self._steps: deque[np.ndarray] = deque(maxlen=200)
        self._noise: tuple[np.ndarray, np.ndarray] | None = None
        self._run: list[np.ndarray] = []
        self.zero_rps: np.ndarray | None = None  #: the gyro's reading at rest, once a still is known
        self._block_s = self.size * period_s

    def feed(self, samples: Samples) -> MotionBlock:
        """Classify a block of ``size`` samples."""
        moments = block_moments(samples, self.size)
        gyro_mean, gyro_var, accel_var = moments.gyro_mean[0], moments.gyro_var[0], moments.accel_var[0]
        self._gyro_var.append(gyro_var)
        self._accel_var.append(accel_var)
        self._blocks += 1  # a memory that is full grows no more
        why = self._why_not_quiet(gyro_mean, gyro_var, accel_var)
        if why:
            self._run = []
        else:
            if self._run:
                self._steps.append(np.abs(gyro_mean - self._run[-1]))
            self._run = [*self._run[-100:], gyro_mean]
        return MotionBlock(self._block_s, gyro_mean, float(np.abs(samples.gyro).max()), not why, why)

    def _why_not_quiet(self, gyro_mean: np.ndarray, gyro_var: np.ndarray, accel_var: np.ndarray) -> str:
        # Variances (3,) of the sensor's noise.
        if self._noise is None or self._blocks % NOISE_EVERY == 0 or self._blocks < 50:
            gyro, accel = noise_variance(np.array(self._gyro_var)), noise_variance(np.array(self._accel_var))
            if self.zero_rps is None and len(self._gyro_var) * self._block_s < CEILING_S:
                band_hz = 0.5 / self._period_s
                gyro, accel = np.minimum(gyro, GYRO_CEILING**2 * band_hz), np.minimum(accel, ACCEL_CEILING**2 * band_hz)
            self._noise = gyro, accel
        gyro_noise, accel_noise = self._noise
        rate = gyro_mean - (0.0 if self.zero_rps is None else self.zero_rps)
        bar = UNKNOWN_ZERO_RPS if self.zero_rps is None else TURNING_RPS
        if np.abs(rate).max() > bar:
            axis = int(np.argmax(np.abs(rate)))
            return f"turning at {abs(rate[axis]) / DEG:.1f} > {bar / DEG:.0f} dps about {'xyz'[axis]}"
        if words := _scatter(gyro_var, gyro_noise, QUIET_VARIANCE_RATIO, DEG, "rate scatter", "dps"):
            return words
        if words := _scatter(accel_var, accel_noise, QUIET_ACCEL_RATIO, MG, "it trembles:", "mg"):
            return words
        if len(self._run) >= 3:
            away = np.abs(gyro_mean - np.median(self._run, axis=0)) / (MEAN_SIGMAS * self._spread(gyro_noise))
            axis = int(np.argmax(away))
            if away[axis] > 1:
                rate = abs(gyro_mean - np.median(self._run, axis=0))[axis] / DEG
                return f"rate moved by {rate:.3f} > {rate / away[axis]:.3f} dps on {'xyz'[axis]}"
        return ""

    def _spread(self, gyro_noise: np.ndarray) -> np.ndarray:
        """(3,) standard deviation of a block's mean.  Noise behind a low-pass is not white, so means of blocks are better than samples."""
        if len(self._steps) < 20:
            return 2 * np.sqrt(gyro_noise / self.size)
        return sigma_of(np.array(self._steps)) / np.sqrt(2)


def _scatter(variance: np.ndarray, noise: np.ndarray, ratio: float, unit: float, what: str, unit_name: str) -> str:
    """Whether a block's scatter exceeds the noise, in words: "rate scatter 0.31 > 0.20 dps on z"; empty if not."""
    share = np.maximum(variance / (2 * ratio * noise), (variance / noise).mean() / ratio * (variance == variance.max()))
    axis = int(np.argmax(share))
    if share[axis] < 1:
        return ""
    found = np.sqrt(variance[axis]) / unit
    return f"{what} {found:.2f} > {found / np.sqrt(share[axis]):.2f} {unit_name} on {'xyz'[axis]}"


# The check of the first second of a stream: an accelerometer and a gyroscope at the stated data rate.

CHECK_S = 1.0
FEWEST = 50
GRAVITY_RATIO = (0.75, 1.33)  #: of the median specific force to gravity; a wrong full scale is a factor of 2
#: the same of an uncalibrated accelerometer: an MPU-9250 with a zero of 0.5 g in z reads 0.5 or 1.5 g when level
UNCALIBRATED_RATIO = (0.3, 2.5)
ODR_RATIO = 0.10  #: true rates are off by up to 5 %


def stream_problem(samples: Samples, odr_hz: float, accel_fs_g: float, calibrated: bool = True) -> str:
    """What is wrong with samples of a second or so, with number and limit; empty if nothing is.  calibrated: the accelerometer."""
    steps = samples.dt_s
    if len(steps) == 0 or not (steps > 0).all():
        return "the stamps do not increase: device time in microseconds is expected"
    found_hz = 1 / samples.period_s
    if abs(found_hz / odr_hz - 1) > ODR_RATIO:
        return f"data rate {found_hz:.1f} Hz by the stamps, {odr_hz:g} Hz expected (bar {100 * ODR_RATIO:.0f} %): --odr {found_hz:.0f}?"
    if not (samples.accel.any() and np.ptp(samples.accel, axis=0).any()):
        return "the accelerometer does not change at all: is it on?"
    if not np.ptp(samples.gyro, axis=0).all():
        axis = "xyz"[int(np.argmin(np.ptp(samples.gyro, axis=0)))]
        return f"the gyro's {axis} does not change at all: is it on?"
    force = median_length(samples.accel)
    low, high = GRAVITY_RATIO if calibrated else UNCALIBRATED_RATIO
    if not low < force / STANDARD_GRAVITY_MPS2 < high:
        return f"specific force {force / G:.2f} g, {low:g} to {high:g} g expected: was the range really ±{accel_fs_g:g} g?"
    return ""


BUMP_SLACK_RAD = 2 * BUMP_RAD  #: the angle resolution of blocks of 0.1 s


class TurnInProgress:
    """The table's present motion, and that since the last reference still.

    As in ``find_stills``, a short bump that leaves the attitude as it was does not end a still.
    """

    def __init__(self) -> None:
        self.still_s = 0.0  #: of the present still, bumps included
        self.moving_s = self.restless_s = 0.0  #: of the present motion, and its last part without turning (a hand rests on the table)
        self.path_rad = self.peak_rps = 0.0  #: of the motion since the last reference still
        self._bump, self._bump_path = np.zeros(3), 0.0
        self._in_bump = False

    @property
    def moving(self) -> bool:
        """Whether the table moves, or has just been touched."""
        return self.still_s == 0.0 or self._in_bump

    def feed(self, block: MotionBlock, zero_rps: np.ndarray | None) -> float:
        """Take a block; returns the length of the still that it ends, or 0."""
        if block.quiet:
            if self._in_bump:
                self.still_s += self.moving_s
            self._calm()
            self.still_s += block.duration_s
            return 0.0
        rate = block.gyro_mean if zero_rps is None else block.gyro_mean - zero_rps
        self.moving_s += block.duration_s
        turning = np.abs(rate).max() > (UNKNOWN_ZERO_RPS if zero_rps is None else TURNING_RPS)
        self.restless_s = 0.0 if turning else self.restless_s + block.duration_s
        self._bump = self._bump + rate * block.duration_s
        angle = float(np.linalg.norm(rate)) * block.duration_s
        if self.still_s > 0.0:
            self._bump_path += angle
            self._in_bump = self.moving_s <= BUMP_S and float(np.linalg.norm(self._bump)) < BUMP_SLACK_RAD
            if self._in_bump:
                return 0.0
            ended_s, self.still_s = self.still_s, 0.0
            self._count(self._bump_path, block)
            return ended_s
        self._count(angle, block)
        return 0.0

    def accepted_still(self) -> None:
        """The still is a reference: motion from now on is the next turn.  If the still has just ended, that turn has begun already."""
        self.path_rad, self.peak_rps = (self._bump_path, self.peak_rps) if self.still_s == 0.0 else (0.0, 0.0)

    def interrupted(self) -> None:
        """The motion since is unknown: the table has to come to rest again."""
        self.still_s = self.moving_s = 0.0
        self._calm()

    def _calm(self) -> None:
        self.moving_s = self.restless_s = 0.0
        self._in_bump = False
        self._bump, self._bump_path = np.zeros(3), 0.0

    def _count(self, angle_rad: float, block: MotionBlock) -> None:
        self.path_rad += angle_rad
        self.peak_rps = max(self.peak_rps, block.peak_rps)


# The warm-up: a session begins at once, and this is what waiting for a warm board would gain, by the drift of its bias over the session.
#
# One calibration has one bias, and the fit counts its drift.  The drift is the spread of the bias over all turns of the session, recorded
# ones included: after half of it was recorded cold, a warm second half gains nothing.  The temperature is assumed to settle exponentially,
# as in the last minutes; the stills determine the bias per degree, and until they do, it is that of a data sheet.

#: rad/s rms: a drift that moves no parameter by more than its target in 9 of 10 sessions (``benchmarks/warm_up.py``)
_BAR_RPS = 4 * MDPS
#: rad/s per °C, from data sheets of siblings; sigma of the bias from one still's rate, which includes the Earth's rotation
_TYPICAL_RPS_PER_C, STILL_SIGMA_RPS = 5 * MDPS, 4 * MDPS
WAITS_MIN = range(1, 11)  #: a longer wait is no better than a second recording
SETTLES_S = np.geomspace(30.0, 2400.0, 25)  #: candidate time constants
USUALLY_S, USUALLY_FACTOR = 150.0, 2.5  #: prior time constant of a small board that heats itself
_SEGMENT_S = 8.0  #: from still to still, at the table
EVERY_S, OVER_S = 2.0, 300.0
LEAST_S = 20.0
LEAST_SIGMA_C = 0.005  #: of a mean over some hundred readings


@dataclass(frozen=True)
class Wait:
    """The gain of waiting: minutes; rms drift of the bias over the session, rad/s, without and with the wait."""

    minutes: int
    now_rps: float
    then_rps: float

    @property
    def words(self) -> str:
        """Both choices, in figures."""
        drifts = f"from {self.now_rps / MDPS:.1f} to {self.then_rps / MDPS:.1f} mdps"
        return f"waiting {self.minutes} min would lower the bias's drift {drifts}"


class Settling(NamedTuple):
    """An exponential temperature: present value, °C; remaining change, °C; time constant, s."""

    now_c: float
    to_come_c: float
    settles_s: float

    def at(self, later_s: np.ndarray) -> np.ndarray:
        """Temperature in °C after later_s (N,)."""
        return self.now_c - self.to_come_c * np.expm1(-later_s / self.settles_s)


def settling(temps: np.ndarray) -> Settling:
    """Fit an exponential to temps (N, 2), s and °C."""
    t_s, temp_c = temps.T
    x = np.exp(-(t_s - t_s[-1]) / SETTLES_S[:, None])
    x_mean, mean_c = x.mean(axis=1, keepdims=True), temp_c.mean()
    slope = (x - x_mean) @ (temp_c - mean_c) / np.sum((x - x_mean) ** 2, axis=1)
    misses = temp_c - mean_c - slope[:, None] * (x - x_mean)
    squares = np.sum(misses**2, axis=1)
    variance = max(LEAST_SIGMA_C**2, float(squares.min()) / max(len(temps) - 2, 1))
    best = int(np.argmin(squares / variance + (np.log(SETTLES_S / USUALLY_S) / np.log(USUALLY_FACTOR)) ** 2))
    return Settling(float(mean_c + slope[best] * (1 - x_mean[best, 0])), float(-slope[best]), float(SETTLES_S[best]))


def rps_per_c(stills: Sequence[Still]) -> float:
    """Bias per degree of the most sensitive axis, rad/s per °C: from the stills, with the typical value as a prior."""
    stills = [still for still in stills if np.isfinite(still.temp_c)]
    temp_c = np.array([still.temp_c for still in stills])
    rate = np.array([still.gyro_mean for still in stills]).reshape(-1, 3)
    moved_c = temp_c - temp_c.mean() if len(temp_c) else temp_c
    information = float(moved_c @ moved_c) / STILL_SIGMA_RPS**2
    variance = 1 / (information + _TYPICAL_RPS_PER_C**-2)
    mean = variance * (moved_c @ rate) / STILL_SIGMA_RPS**2
    return float(np.sqrt(np.max(np.abs(mean)) ** 2 + variance))


def worth_waiting(temperature: Settling, turned_c: np.ndarray, each_rps: float, segments_left: int) -> Wait | None:
    """The fewest whole minutes after which the drift is within the limit, or halved; None where it is anyhow, or none is enough.

    turned_c (N,): temperature of each turn that counts; each_rps: bias per degree.
    """
    turned_c = turned_c[np.isfinite(turned_c)]
    later_s = _SEGMENT_S * np.arange(1, segments_left + 1)

    def drift(minutes: float) -> float:
        return each_rps * float(np.std(np.concatenate([turned_c, temperature.at(60 * minutes + later_s)])))

    now_rps = drift(0.0)
    if now_rps <= _BAR_RPS:
        return None
    then_rps = np.array([drift(minutes) for minutes in WAITS_MIN])
    enough = then_rps <= (_BAR_RPS if then_rps.min() <= _BAR_RPS else now_rps / 2)
    if not enough.any():
        return None
    first = int(np.argmax(enough))
    return Wait(WAITS_MIN[first], now_rps, float(then_rps[first]))


SLOPE_OVER_S = 60.0
LEAST_SLOPE_S = 10.0


#: kinds of trouble, in words
FAULTS = {"lost": "lost", "crc": "CRC", "garbage": "garbage", "implausible": "implausible", "reset": "resets"}


class StreamHealth:
    """Health of a session's stream: losses, the true data rate, the temperature and its slope."""

    def __init__(self) -> None:
        self.samples = self.gaps = 0
        self.troubles: Counter[str] = Counter()  #: by kind, as in ``Event``
        self._extra = 0  # periods that the steps hold beyond one each
        self.temp_c: float | None = None
        self.info_odr_hz: float | None = None  #: from the board's info
        self.clock: ClockRatio | None = None  #: of the device, by the host's
        self._periods, self._periods_s = 0, 0.0
        self._last_ns: int | None = None
        self._temps: deque[tuple[float, float]] = deque(maxlen=round(OVER_S / EVERY_S))
        self._waited: tuple[tuple[float, int, int], Wait | None] | None = None

    def feed(self, samples: Samples, pace: Pace) -> None:
        """Add samples of the log with this pace; those that were added before do not count again."""
        t_ns = samples.t_ns
        if self._last_ns is not None:
            samples = samples.between(int(np.searchsorted(t_ns, self._last_ns, "right")), len(samples))
            t_ns = np.concatenate([[self._last_ns], samples.t_ns])
        if len(samples) == 0:
            return
        steps = np.diff(t_ns) * NS
        steps = steps[steps > 0]
        periods, whole = pace.periods(steps), steps <= GAP_PERIODS * pace.period_s
        self.gaps += int(np.sum(~whole))
        self._extra += int(np.sum(periods - 1))
        self._periods += int(periods[whole].sum())
        self._periods_s += float(steps[whole].sum())
        self.samples, self._last_ns = self.samples + len(samples), int(samples.t_ns[-1])
        if samples.temp_c is not None:
            t_s, temp_c = samples.t_ns[-1] * NS, float(np.mean(samples.temp_c[-200:]))
            self.temp_c = temp_c if self.temp_c is None else 0.9 * self.temp_c + 0.1 * temp_c
            self.warms(t_s, temp_c)

    def warms(self, t_s: float, temp_c: float) -> None:
        """Add a mean temperature over some readings."""
        if not self._temps or t_s - self._temps[-1][0] >= EVERY_S:
            self._temps.append((t_s, temp_c))

    def wait(self, turns: Sequence[AcceptedTurn], stills: Sequence[Still], segments_left: int) -> Wait | None:
        """The gain of waiting; None where it does not matter, or too little is known.  The result is kept until the data change."""
        if len(self._temps) < 3 or self._temps[-1][0] - self._temps[0][0] < LEAST_S or segments_left <= 0:
            return None
        about = (self._temps[-1][0], len(stills), segments_left)
        if self._waited is None or self._waited[0] != about:
            turned_c = np.array([np.mean([still.temp_c for still in turn.segment.stills]) for turn in turns])
            self._waited = about, worth_waiting(settling(np.array(self._temps)), turned_c, rps_per_c(stills), segments_left)
        return self._waited[1]

    def new_log(self) -> None:
        """The device's clock has restarted."""
        self._last_ns = None
        self._temps.clear()
        self._waited = None

    @property
    def faults(self) -> dict[str, int]:
        """What went wrong, in words, and how often."""
        return {words: self.troubles[kind] for kind, words in FAULTS.items()} | {"gaps": self.gaps}

    @property
    def missing(self) -> int:
        """Number of samples missing by the stamps."""
        return max(self._extra, 0)

    @property
    def odr_hz(self) -> float | None:
        """True data rate by the stamps, without gaps."""
        return self._periods / self._periods_s if self._periods else None

    @property
    def odr_by_host_hz(self) -> float | None:
        """The same by the host's clock."""
        return self.odr_hz * self.clock.ratio if self.odr_hz and self.clock else None

    @property
    def temp_slope(self) -> float | None:
        """°C per minute over the last minute; None until there is enough of it."""
        if len(self._temps) < 3 or self._temps[-1][0] - self._temps[0][0] < LEAST_SLOPE_S:
            return None
        t_s, temp_c = np.array(self._temps)[-round(SLOPE_OVER_S / EVERY_S) :].T
        centred = t_s - t_s.mean()
        return float(60 * (centred @ temp_c) / (centred @ centred))
