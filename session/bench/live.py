"""Judge a stream live: stillness, turns, health of the stream, warm-up."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from session.bench.messages import AcceptedTurn
from session.detect.segments import GAP_PERIODS, Pace
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
from session.io.numeric import sigma_of
from session.io.samples import Samples
from session.io.units import DEG, MDPS, MG, NS, STANDARD_GRAVITY_MPS2, G

# Stillness as it happens, a block of 0.1 s at a time, by the bars of ``session.detect.stills``.
#
# What it says is for the person at the table.  Whether a still counts is asked of ``session.detect.stills`` itself (``window``), so that
# the recorded log is judged alike.

#: until a first still is known, no more than this is taken for the sensor's own noise: three times the data sheet's, one-sided densities
GYRO_CEILING, ACCEL_CEILING = 15 * MDPS, 180e-3 * MG
CEILING_S = 60.0  #: a table that has not rested for so long trembles; then its own calmest blocks are the yardstick
MEMORY_BLOCKS = 12_000  #: 20 min
NOISE_EVERY = 10  #: blocks from one look at the noise to the next
UNKNOWN_ZERO_RPS = 10.0 * DEG  #: no gyro reads that much at rest


@dataclass(frozen=True, eq=False)
class MotionBlock:
    """Mean rate (3,) and peak of one block, rad/s; quiet: whether it could be part of a still; why not, with number and bar."""

    duration_s: float
    gyro_mean: np.ndarray
    peak_rps: float
    quiet: bool
    why: str


class Stillness:
    """Judges one block after the other.  period_s: the usual time between two samples."""

    def __init__(self, period_s: float):
        self._period_s = period_s
        self.size = block_size(period_s)
        self._gyro_var: deque[np.ndarray] = deque(maxlen=MEMORY_BLOCKS)
        self._accel_var: deque[np.ndarray] = deque(maxlen=MEMORY_BLOCKS)
        self._steps: deque[np.ndarray] = deque(maxlen=200)
        self._noise: tuple[np.ndarray, np.ndarray] | None = None
        self._run: list[np.ndarray] = []
        self.zero_rps: np.ndarray | None = None  #: what the gyro reads at rest, once a still is known

    @property
    def block_s(self) -> float:
        """Length of a block, s."""
        return self.size * self._period_s

    def feed(self, samples: Samples) -> MotionBlock:
        """What a block of ``size`` samples shows."""
        moments = block_moments(samples, self.size)
        gyro_mean, gyro_var, accel_var = moments.gyro_mean[0], moments.gyro_var[0], moments.accel_var[0]
        self._gyro_var.append(gyro_var)
        self._accel_var.append(accel_var)
        why = self._why_not_quiet(gyro_mean, gyro_var, accel_var)
        if why:
            self._run = []
        else:
            if self._run:
                self._steps.append(np.abs(gyro_mean - self._run[-1]))
            self._run = [*self._run[-100:], gyro_mean]
        return MotionBlock(self.block_s, gyro_mean, float(np.abs(samples.gyro).max()), not why, why)

    def _why_not_quiet(self, gyro_mean: np.ndarray, gyro_var: np.ndarray, accel_var: np.ndarray) -> str:
        gyro_noise, accel_noise = self._noise_now()
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

    def _noise_now(self) -> tuple[np.ndarray, np.ndarray]:
        """Variances (3,) of the sensor's noise."""
        if self._noise is None or len(self._gyro_var) % NOISE_EVERY == 0 or len(self._gyro_var) < 50:
            gyro, accel = noise_variance(np.array(self._gyro_var)), noise_variance(np.array(self._accel_var))
            if self.zero_rps is None and len(self._gyro_var) * self.block_s < CEILING_S:
                band_hz = 0.5 / self._period_s
                gyro, accel = np.minimum(gyro, GYRO_CEILING**2 * band_hz), np.minimum(accel, ACCEL_CEILING**2 * band_hz)
            self._noise = gyro, accel
        return self._noise

    def _spread(self, gyro_noise: np.ndarray) -> np.ndarray:
        """(3,) standard deviation of a block's mean.  Noise behind a low-pass is not white: a few blocks tell better than their samples."""
        if len(self._steps) < 20:
            return 2 * np.sqrt(gyro_noise / self.size)
        return sigma_of(np.array(self._steps)) / np.sqrt(2)


def _scatter(variance: np.ndarray, noise: np.ndarray, ratio: float, unit: float, what: str, unit_name: str) -> str:
    """Whether a block's scatter leaves what the noise allows: "rate scatter 0.31 > 0.20 dps on z"."""
    share = np.maximum(variance / (2 * ratio * noise), (variance / noise).mean() / ratio * (variance == variance.max()))
    axis = int(np.argmax(share))
    if share[axis] < 1:
        return ""
    found = np.sqrt(variance[axis]) / unit
    return f"{what} {found:.2f} > {found / np.sqrt(share[axis]):.2f} {unit_name} on {'xyz'[axis]}"


# The first second of a stream: does it look like an accelerometer and a gyroscope at the data rate that was said?

CHECK_S = 1.0
FEWEST = 50
GRAVITY_RATIO = (0.75, 1.33)  #: of the median specific force to gravity; a wrong full scale is a factor of 2
#: the same of an accelerometer that nobody has calibrated: an MPU-9250 whose z zero is at 0.5 g reads 0.5 or 1.5 g level
UNCALIBRATED_RATIO = (0.3, 2.5)
ODR_RATIO = 0.10  #: true rates are off by up to 5 %


def stream_problem(samples: Samples, odr_hz: float, accel_fs_g: float, calibrated: bool = True) -> str:
    """What is wrong with samples of a second or so, with number and bar; empty where nothing is.  calibrated: the accelerometer."""
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
    force = float(np.median(np.linalg.norm(samples.accel, axis=1)))
    ratio = force / STANDARD_GRAVITY_MPS2
    low, high = GRAVITY_RATIO if calibrated else UNCALIBRATED_RATIO
    if not low < ratio < high:
        return f"specific force {force / G:.2f} g, {low:g} to {high:g} g expected: was the range really ±{accel_fs_g:g} g?"
    return ""


# Rest and movement, block by block: how long it has been still, how far it has turned since.
#
# A bump that is short and leaves the attitude as it was does not end a still, as in ``session.detect.stills``.

BUMP_SLACK_RAD = 2 * BUMP_RAD  #: blocks of 0.1 s see an angle no better; the log's own judgement comes later


class TurnInProgress:
    """What the table does now, and since the last reference still.

    still_s: of the present still, bumps included; moving: whether it is not still now, for moving_s, the last restless_s of it without
    turning (a hand rests on the table); path_rad, peak_rps: of the movement since the last reference still.
    """

    def __init__(self) -> None:
        self.still_s = self.moving_s = self.restless_s = 0.0
        self.path_rad = self.peak_rps = 0.0
        self._bump, self._bump_path = np.zeros(3), 0.0
        self._in_bump = False

    @property
    def moving(self) -> bool:
        """Whether the table moves, or has just been touched."""
        return self.still_s == 0.0 or self._in_bump

    def feed(self, block: MotionBlock, zero_rps: np.ndarray | None) -> float:
        """Take a block; returns how long the still was that it ends, or 0."""
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
        """The still is a reference: what moves from now on is the next turn.  One that has just been left is moving already."""
        path_rad, peak_rps = (self._bump_path, self.peak_rps) if self.still_s == 0.0 else (0.0, 0.0)
        self.path_rad = path_rad
        self.peak_rps = peak_rps

    def interrupted(self) -> None:
        """Nobody saw what happened since: whatever it was, it has to come to rest anew."""
        self.still_s = self.moving_s = 0.0
        self._calm()

    def _calm(self) -> None:
        self.moving_s = self.restless_s = 0.0
        self._in_bump = False
        self._bump, self._bump_path = np.zeros(3), 0.0

    def _count(self, angle_rad: float, block: MotionBlock) -> None:
        self.path_rad += angle_rad
        self.peak_rps = max(self.peak_rps, block.peak_rps)


# Is it worth while to wait until the board is warm?  What its bias would drift by in what is left, going on now or in some minutes.
#
# One calibration has one bias.  What counts is how far the bias spreads over all turns of the session, those that are recorded
# included: who has recorded half of it cold gains nothing by a warm second half.  The temperature is taken to settle exponentially, as its
# own last minutes show; what a degree does to the bias the stills show, and until they do, a data sheet says it.

#: rad/s rms: a drift that moves no parameter by more than its target in 9 of 10 sessions (``benchmarks/warm_up.py``)
BAR_RPS = 4 * MDPS
#: rad/s per °C, as siblings' data sheets have it; what one still's rate says of the bias, the Earth's rotation in it
TYPICAL_RPS_PER_C, STILL_SIGMA_RPS = 5 * MDPS, 4 * MDPS
WAITS_MIN = range(1, 11)  #: who would wait longer records twice instead
SETTLES_S = np.geomspace(30.0, 2400.0, 25)  #: time constants that are tried
USUALLY_S, USUALLY_FACTOR = 150.0, 2.5  #: of a small board that heats itself, until more is seen
SEGMENT_S = 8.0  #: from still to still, at the table
EVERY_S, OVER_S = 2.0, 300.0
LEAST_S = 20.0
LEAST_SIGMA_C = 0.005  #: of a mean over some hundred readings


@dataclass(frozen=True)
class Wait:
    """What waiting gains: minutes of it; rms of the bias' drift over the session, rad/s, going on now and after them; minutes left."""

    minutes: int
    now_rps: float
    then_rps: float
    left_min: float

    @property
    def words(self) -> str:
        """Both ways, in figures."""
        now, then = self.now_rps / MDPS, self.then_rps / MDPS
        return (
            f"wait {self.minutes} min, and the bias drifts by {then:.1f} mdps; going on now ({self.left_min:.0f} min), "
            f"by {now:.1f} (bar {BAR_RPS / MDPS:g})"
        )


@dataclass(frozen=True)
class Settling:
    """The temperature: now, °C; how much is still to come; time constant, s."""

    now_c: float
    to_come_c: float
    settles_s: float

    def at(self, later_s: np.ndarray) -> np.ndarray:
        """°C, so many seconds later."""
        return self.now_c - self.to_come_c * np.expm1(-later_s / self.settles_s)


class WarmUp:
    """Fed with temperatures as they come; ``wait`` says whether it pays."""

    def __init__(self) -> None:
        self._temps: deque[tuple[float, float]] = deque(maxlen=round(OVER_S / EVERY_S))
        self._said: tuple[tuple[float, int, int], Wait | None] | None = None

    def feed(self, t_s: float, temp_c: float) -> None:
        """A mean over some readings."""
        if not self._temps or t_s - self._temps[-1][0] >= EVERY_S:
            self._temps.append((t_s, temp_c))

    def new_log(self) -> None:
        """The device's clock has begun anew."""
        self._temps.clear()
        self._said = None

    def wait(self, turns: Sequence[AcceptedTurn], stills: Sequence[Still], segments_left: int) -> Wait | None:
        """None where waiting gains nothing that matters, or too little is known.  Asked often, it answers anew as temperatures come."""
        if len(self._temps) < 3 or self._temps[-1][0] - self._temps[0][0] < LEAST_S or segments_left <= 0:
            return None
        about = (self._temps[-1][0], len(stills), segments_left)
        if self._said is None or self._said[0] != about:
            turned_c = np.array([np.mean([still.temp_c for still in turn.segment.stills]) for turn in turns])
            self._said = about, worth_waiting(settling(np.array(self._temps)), turned_c, rps_per_c(stills), segments_left)
        return self._said[1]


def settling(temps: np.ndarray) -> Settling:
    """From temps (N, 2), s and °C: the exponential that suits them best."""
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
    """What a degree does to the bias of the axis where it does most: as the stills show it, and as typical where they do not yet."""
    stills = [still for still in stills if np.isfinite(still.temp_c)]
    temp_c = np.array([still.temp_c for still in stills])
    rate = np.array([still.gyro_mean for still in stills]).reshape(-1, 3)
    moved_c = temp_c - temp_c.mean() if len(temp_c) else temp_c
    told = float(moved_c @ moved_c) / STILL_SIGMA_RPS**2
    variance = 1 / (told + TYPICAL_RPS_PER_C**-2)
    mean = variance * (moved_c @ rate) / STILL_SIGMA_RPS**2
    return float(np.sqrt(np.max(np.abs(mean)) ** 2 + variance))


def worth_waiting(temperature: Settling, turned_c: np.ndarray, each_rps: float, segments_left: int) -> Wait | None:
    """The least whole minutes after which the drift stays within the bar, or is half; None where it does anyhow, or none will do.

    turned_c (N,): temperature of each turn that counts; each_rps: what a degree does to the bias.
    """
    turned_c = turned_c[np.isfinite(turned_c)]
    later_s = SEGMENT_S * np.arange(1, segments_left + 1)

    def drift(minutes: float) -> float:
        return each_rps * float(np.std(np.concatenate([turned_c, temperature.at(60 * minutes + later_s)])))

    now_rps = drift(0.0)
    if now_rps <= BAR_RPS:
        return None
    then_rps = np.array([drift(minutes) for minutes in WAITS_MIN])
    enough = then_rps <= (BAR_RPS if then_rps.min() <= BAR_RPS else now_rps / 2)
    if not enough.any():
        return None
    first = int(np.argmax(enough))
    return Wait(WAITS_MIN[first], now_rps, float(then_rps[first]), float(later_s[-1]) / 60)


# How the stream does: what was lost, the true data rate, the temperature and its slope.

SLOPE_OVER_S = 60.0
LEAST_SLOPE_S = 10.0
TEMP_EVERY_S = 1.0


class StreamHealth:
    """Counts over a session.  troubles: by kind, as the stream's decoder names them."""

    def __init__(self) -> None:
        self.samples = self.gaps = 0
        self.troubles: Counter[str] = Counter()
        self._extra = 0  # periods that the steps hold beyond one each
        self.temp_c: float | None = None
        self.warmth = WarmUp()
        self.info_odr_hz: float | None = None  #: what the board says
        self.clock_ratio: float | None = None  #: seconds of device time in one of the host's
        self._periods, self._periods_s = 0, 0.0
        self._last_ns: int | None = None
        self._temps: deque[tuple[float, float]] = deque(maxlen=round(SLOPE_OVER_S / TEMP_EVERY_S))

    def feed(self, samples: Samples, pace: Pace) -> None:
        """Samples of the log, whose pace it is; those that it has had already do not count again."""
        samples = (
            samples if self._last_ns is None else samples.between(int(np.searchsorted(samples.t_ns, self._last_ns, "right")), len(samples))
        )
        if len(samples) == 0:
            return
        t_ns = samples.t_ns if self._last_ns is None else np.concatenate([[self._last_ns], samples.t_ns])
        steps = np.diff(t_ns) * NS
        steps = steps[steps > 0]
        periods, whole = pace.periods(steps), steps <= GAP_PERIODS * pace.period_s
        self.gaps += int(np.sum(~whole))
        self._extra += int(np.sum(periods - 1))
        self._periods += int(periods[whole].sum())
        self._periods_s += float(steps[whole].sum())
        self.samples, self._last_ns = self.samples + len(samples), int(samples.t_ns[-1])
        if samples.temp_c is not None:
            self._feel(samples.t_ns[-1] * NS, float(np.mean(samples.temp_c[-200:])))

    def new_log(self) -> None:
        """The device's clock has begun anew."""
        self._last_ns = None
        self._temps.clear()
        self.warmth.new_log()

    @property
    def missing(self) -> int:
        """Samples that are missing between the stamps, in gaps and singly."""
        return max(self._extra, 0)

    @property
    def odr_hz(self) -> float | None:
        """True data rate by the stamps, gaps left out."""
        return self._periods / self._periods_s if self._periods else None

    @property
    def odr_by_host_hz(self) -> float | None:
        """The same by the host's clock."""
        return self.odr_hz * self.clock_ratio if self.odr_hz and self.clock_ratio else None

    @property
    def temp_slope(self) -> float | None:
        """°C per minute over the last minute; None until there is enough of it."""
        if len(self._temps) < 3 or self._temps[-1][0] - self._temps[0][0] < LEAST_SLOPE_S:
            return None
        t_s, temp_c = np.array(self._temps).T
        centred = t_s - t_s.mean()
        return float(60 * (centred @ temp_c) / (centred @ centred))

    def _feel(self, t_s: float, temp_c: float) -> None:
        self.temp_c = temp_c if self.temp_c is None else 0.9 * self.temp_c + 0.1 * temp_c
        if not self._temps or t_s - self._temps[-1][0] >= TEMP_EVERY_S:
            self._temps.append((t_s, temp_c))
        self.warmth.feed(t_s, temp_c)
