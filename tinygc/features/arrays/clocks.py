"""Clock of each unit relative to the first unit's: offset and rate, by maximum likelihood from the measured rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import CubicSpline

from session.base.errors import CalibrationError
from session.base.numeric import later_row, new_readings, rms_of, running_sum, sigma_of
from session.base.records import Size
from session.base.results import Number
from session.base.units import DEG, NS
from session.detect.events import register_end_dps
from session.log.folder import Session
from session.log.samples import Samples
from tinygc.inference.solve import inverse
from tinygc.models.model import SECONDS

# Extrinsics of a unit: clock, mounting and position relative to the array's first unit.


@dataclass(frozen=True, eq=False)
class UnitClock:
    """Linear clock model ``t_array = t_unit + offset_s + rate (t_unit - about_s)``, all in s, with the sigmas of offset and rate.

    rate is positive where the unit's own clock is slow.  The array's clock is the clock of its first unit, whose offset and rate are 0.
    """

    offset_s: Annotated[float, SECONDS] = 0.0
    rate: Annotated[float, Number(-0.5, 0.5)] = 0.0
    about_s: Annotated[float, SECONDS] = 0.0
    offset_sigma_s: Size = 0.0
    rate_sigma: Size = 0.0

    def array_time(self, t_unit_s: np.ndarray) -> np.ndarray:
        """Convert times (N,) s of the unit's clock to the array's clock."""
        return t_unit_s + self.offset_s + self.rate * (t_unit_s - self.about_s)


@dataclass(frozen=True, eq=False)
class UnitPlace:
    """Extrinsics of one unit.

    number; clock; mounting (3, 3), the rotation that takes vectors from the unit's body frame (its accelerometer's triad, or the frame
    given in session.toml) to the array's, and its covariance (3, 3) rad^2, of a turn about the array's axes; position (3,) m of its
    accelerometer from the first unit's, in the array's frame, and its covariance (3, 3) m^2, both None where the motion does not determine
    it.
    """

    number: int
    clock: UnitClock = field(default_factory=UnitClock)
    mounting: np.ndarray = field(default_factory=lambda: np.eye(3))
    mounting_covariance: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    position_m: np.ndarray | None = None
    position_covariance: np.ndarray | None = None


# Measured rates of a unit's gyroscope, log by log, on its own clock, without saturated readings.

#: samples on either side of a clipped one that a spline through it would distort
NEIGHBOURS = 3
#: periods; a longer step is a gap, and readings are not interpolated across it
GAP_PERIODS = 1.6
#: s of identical readings on all axes after which a sensor counts as stuck (as in fault detection)
STUCK_S = 0.5


@dataclass(frozen=True, eq=False)
class Rates:
    """Rates of one log of one unit.

    t_s (N,) s of its own clock, rate (N, 3) rad/s in its gyroscope's axes, good (N,) bool: neither clipped nor stuck, nor next to such a
    reading or a gap; period_s of its stamps.
    """

    t_s: np.ndarray
    rate: np.ndarray
    good: np.ndarray
    period_s: float

    def between_good(self) -> Rates:
        """Trim to the span from the first good reading to the last, which drops the tail of a log whose sensor failed."""
        good = np.flatnonzero(self.good)
        if len(good) < 2:
            return self
        part = slice(good[0], good[-1] + 1)
        return replace(self, t_s=self.t_s[part], rate=self.rate[part], good=self.good[part])

    @property
    def speed(self) -> np.ndarray:
        """(N,) |rate| without the zero-rate offset."""
        return np.linalg.norm(self.rate - np.median(self.rate, axis=0), axis=1)

    def spline(self) -> CubicSpline:
        """Return the rate as a cubic spline over the unit's time."""
        return CubicSpline(self.t_s, self.rate)

    def covers(self, t_s: np.ndarray) -> np.ndarray:
        """Return (M,) bool: which times lie between two adjacent good readings."""
        after = np.searchsorted(self.t_s, t_s)
        inside = (after > 0) & (after < len(self.t_s))
        after = np.clip(after, 1, len(self.t_s) - 1)
        return np.asarray(inside & self.good[after] & self.good[after - 1])


def rates_of(samples: Samples, end_dps: float) -> Rates:
    """Return the rates of one log; end_dps: rate above which a reading is saturated (``register_end_dps``)."""
    t_s, rate = samples.t_ns * NS, np.asarray(samples.gyro)
    bad = (np.abs(rate) >= end_dps * DEG).any(axis=1)
    step, period_s = np.diff(t_s), samples.period_s
    # Readings in runs of identical values on all axes, of at least this length
    begins = np.flatnonzero(new_readings(rate))
    count = np.diff(np.append(begins, len(rate)))
    bad |= np.repeat(count >= max(round(STUCK_S / period_s), 4), count)
    gaps = step > GAP_PERIODS * period_s
    bad[:-1] |= gaps
    bad[1:] |= gaps
    near = np.convolve(bad, np.ones(2 * NEIGHBOURS + 1), mode="same") > 0.5 if len(bad) > 2 * NEIGHBOURS else np.full(len(bad), bad.any())
    return Rates(t_s, rate, ~near, period_s)


def session_rates(session: Session) -> tuple[Rates, ...]:
    """Return the rates of every log, then of every closure run, of a unit."""
    found = [log.samples for log in (*session.logs, *session.closures)]
    return tuple(rates_of(samples, register_end_dps(session.config.sensor, np.asarray(samples.gyro))) for samples in found)


# Coarse clock of a unit: the offset and rate that maximise the correlation of its speed of turning with the first unit's.
#
# The speed, ``|rate|``, is the same in any axes, so the mounting need not be known. A clock that runs up to 1 % fast or slow smears the
# correlation of a long recording, so the grid of rates is finer for longer recordings.

#: largest difference of a clock's rate from the first unit's: an RC oscillator's trimming, and half as much again
MOST_RATE = 0.015
#: s, step of the grid; the speed of a turn by hand bends over some tenths of a second
STEP_S = 0.05
#: factor by which the step is longer in the first search over all rates
COARSER = 4
#: share of the shorter log that has to overlap the longer one
LEAST_OVERLAP = 0.5
#: most grid points used for one speed
MOST_POINTS = 400_000


def rough_clock(first: Rates, unit: Rates) -> tuple[UnitClock, float]:
    """Estimate the clock of one log of a unit from the first unit's log of the same time, and the correlation of the speeds there."""
    first, unit = first.between_good(), unit.between_good()
    length_s = max(float(rates.t_s[-1] - rates.t_s[0]) for rates in (first, unit))
    fine_s = max(STEP_S, first.period_s, unit.period_s, length_s / MOST_POINTS)
    best, likeness, reach = UnitClock(), -2.0, MOST_RATE
    for step_s in (COARSER * fine_s, fine_s):
        # At this grid step the smear at the ends of the recording lowers the peak only a little.
        rate_step = min(MOST_RATE, 2 * step_s / max(float(unit.t_s[-1] - unit.t_s[0]), step_s))
        count = int(np.ceil(reach / rate_step))
        rates = np.clip(best.rate + rate_step * np.arange(-count, count + 1), -MOST_RATE, MOST_RATE)
        best, likeness = _search(first, unit, step_s, rates)
        reach = 2 * rate_step
    return best, likeness


def _search(first: Rates, unit: Rates, step_s: float, rates: np.ndarray) -> tuple[UnitClock, float]:
    """Return the best of these rates (R,), at any offset; speeds are averaged over steps of this length in s."""
    grid = first.t_s[0] + step_s * np.arange(int((first.t_s[-1] - first.t_s[0]) / step_s) + 1)
    about_s = float(unit.t_s[0] + unit.t_s[-1]) / 2
    count = int((unit.t_s[-1] - unit.t_s[0]) * (1 + MOST_RATE) / step_s) + 2
    ours = _speed(first, first.t_s, grid)
    size = next_fast_len(len(ours) + count, real=True)

    def sums(speed: np.ndarray) -> np.ndarray:
        """Fourier transforms of one, the speed less its mean, and the square of that."""
        speed = speed - speed.mean()
        return rfft([np.ones(len(speed)), speed, speed**2], size)

    def correlation(theirs: np.ndarray) -> tuple[float, int]:
        """The largest coefficient over all lags with enough overlap, and its lag: theirs[0] is aligned with ours[lag]."""
        other = np.conj(sums(theirs))
        n, x, xx, y, yy, xy = irfft(whole[[0, 1, 2, 0, 0, 1]] * other[[0, 0, 0, 1, 2, 1]], size)
        n = np.round(n)
        enough = n >= max(2, LEAST_OVERLAP * min(len(ours), len(theirs)))
        with np.errstate(divide="ignore", invalid="ignore"):
            spread = (xx - x * x / n) * (yy - y * y / n)
            likeness = np.where(enough & (spread > 0), (xy - x * y / n) / np.sqrt(spread), -1.0)
        lag = int(np.argmax(likeness))
        return float(likeness[lag]), lag - size if lag >= len(ours) else lag

    whole = sums(ours)
    best, highest = UnitClock(0.0, 0.0, about_s), -2.0
    for rate in rates:
        moved = about_s + (1 + rate) * (unit.t_s - about_s)
        likeness, lag = correlation(_speed(unit, moved, moved[0] + step_s * np.arange(int((moved[-1] - moved[0]) / step_s) + 1)))
        if likeness > highest:
            best, highest = UnitClock(float(grid[0] + lag * step_s - moved[0]), float(rate), about_s), likeness
    return best, highest


def _speed(rates: Rates, t_s: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return |rate| without the zero-rate offset, averaged over the steps of a grid that lies within the log."""
    speed = rates.speed
    turned = running_sum((speed[1:] + speed[:-1]) / 2 * np.diff(t_s))
    edges = np.append(grid, grid[-1] + (grid[-1] - grid[-2] if len(grid) > 1 else 1.0))
    return np.diff(np.interp(edges, t_s, turned))


# Fine clock of a unit: offset and rate, by the likelihood of its rates given the first unit's.
#
# The unit's gyroscope reads ``g(t) = A g_1(tau(t)) + b + noise`` with ``tau = t + offset + rate (t - about)`` and g_1 the first unit's.
# A is any linear map: mounting, scales and misalignments of both units, so none of them can bias the clock. All are estimated together by
# Gauss-Newton, starting at the coarse clock (``rough_clock``).
#
# The first unit's noise is in the regressors as well. Its mean contribution is subtracted from the normal equations: an interpolated
# reading is less noisy between two readings than at one, and least squares would shift the clock towards there.

#: s; readings of one block share their errors, such as those of one hand movement
CLOCK_BLOCK_S = 2.0
ROUNDS = 25
#: s and 1; a smaller step ends the search
ENOUGH_S, ENOUGH_RATE = 1e-8, 1e-10
#: share of the mean square of a turning unit's rates that the first unit's have to explain: units of one body reach 0.99 and more, others
#: 0.4 at most (benchmarks/array_clocks.py)
SAME_BODY = 0.9
#: s, difference of one log's clock from that of all logs above which the clock was reset between them
RESET_S = 0.5
#: sigmas of the unit's noise; a reading that turns by less has no information on time
MOVING_SIGMAS = 20.0
#: one sigma of the map between two units' rates; above it, the body has not turned about all three axes
KNOWN_MAP = 0.1


@dataclass(frozen=True, eq=False)
class ClockFit:
    """Estimated clock of a unit.

    clock; matrix (3, 3): its rates from the first unit's, both in their own gyroscopes' axes, and bias (logs, 3) rad/s; agreement: share of
    the mean square of its turning that these explain; rms_rps of what is left.
    """

    clock: UnitClock
    matrix: np.ndarray
    matrix_sigma: np.ndarray
    bias: np.ndarray
    agreement: float
    rms_rps: float

    @property
    def map_is_known(self) -> bool:
        """Return whether the body has turned about all three axes, so that the map between the units' rates is determined."""
        return bool(self.matrix_sigma.max() < KNOWN_MAP)


def fit_clock(first: Sequence[Rates], unit: Sequence[Rates], name: str = "the unit") -> ClockFit:
    """Estimate a unit's clock; first, unit: logs of the same times.  Raises CalibrationError where the two did not feel the same motion."""
    fit, likeness = nearest_clock(first, unit, name)
    if fit is None or fit.agreement < SAME_BODY:
        found = "no turn that both felt" if fit is None else f"its rates follow the first unit's by {max(fit.agreement, 0.0):.2f} of 1"
        raise CalibrationError(
            f"{name} did not feel the motion of the array's first unit: {found}, the correlation of their speeds is {likeness:.2f}; "
            "an array's units are fixed to one rigid body and recorded together: take that unit out"
        )
    return fit


def nearest_clock(first: Sequence[Rates], unit: Sequence[Rates], name: str = "the unit") -> tuple[ClockFit | None, float]:
    """Return the best clock, however well it fits, and the correlation of speeds at its start; None where nothing turns.

    Raises CalibrationError for a clock that was reset between two logs.
    """
    each = [rough_clock(one, other) for one, other in zip(first, unit, strict=True)]
    rough, likeness = max(each, key=lambda one: one[1])
    for number, (other, alike) in enumerate(each):
        apart_s = abs(rough.offset_s + rough.rate * (other.about_s - rough.about_s) - other.offset_s)
        if alike > SAME_BODY and apart_s > RESET_S + 0.01 * abs(other.about_s - rough.about_s):
            raise CalibrationError(
                f"{name}: its clock was reset between two logs: in log {number + 1} it is {apart_s:.2f} s from where the other has it; "
                "give each log an array's folder of its own"
            )
    about_s = rough.about_s
    splines = [rates.spline() for rates in first]
    slopes = [spline.derivative() for spline in splines]
    noise = np.mean([noise_of(rates.rate) ** 2 for rates in first], axis=0)
    bar = MOVING_SIGMAS * max(float(np.mean([noise_of(rates.rate).max() for rates in unit])), float(np.sqrt(noise.max())))
    moving = [rates.good & _moves(rates, bar) for rates in unit]
    x, fit = np.array([rough.offset_s, rough.rate]), None
    for _ in range(ROUNDS):
        rows = _clock_rows(first, unit, moving, splines, slopes, x, about_s)
        if not rows.enough_for(len(first)):
            break
        try:
            fit = _stepped(rows, len(first), noise, None if fit is None else fit.matrix, x, about_s)
        except np.linalg.LinAlgError:  # the first unit's rates do not determine this one's
            return None, likeness
        before, x = x, np.array([fit.clock.offset_s, fit.clock.rate])
        if abs(x[0] - before[0]) < ENOUGH_S and abs(x[1] - before[1]) < ENOUGH_RATE:
            break
    return fit, likeness


def noise_of(rate: np.ndarray) -> np.ndarray:
    """Return (3,) scatter of single readings, from third differences, in which smooth turning cancels."""
    if len(rate) < 8:
        return np.zeros(3)
    return np.asarray(sigma_of(np.diff(rate, 3, axis=0)) / np.sqrt(20.0))


def _moves(rates: Rates, bar: float) -> np.ndarray:
    """Return (N,) bool: readings that turn, and those within half a second of them."""
    speed = rates.speed
    reach = max(1, round(0.25 / rates.period_s))
    return np.asarray(np.convolve(speed > bar, np.ones(2 * reach + 1), mode="same")[: len(speed)] > 0.5)


class _ClockRows(NamedTuple):
    """Readings (N,) of a unit that turns, next to the first unit's at the same times, for one clock.

    log (N,): its number; read (N, 3) rad/s; ours (N, 3) rad/s and slope (N, 3) rad/s^2: the first unit's rate there; since (N,) s from
    ``about_s``; block (N,): number of the block whose readings share their errors; variance (N,): of the first unit's interpolated
    reading, relative to a reading's own, and variance_slope (N,) 1/s.
    """

    log: np.ndarray
    read: np.ndarray
    ours: np.ndarray
    slope: np.ndarray
    since: np.ndarray
    block: np.ndarray
    variance: np.ndarray
    variance_slope: np.ndarray

    def enough_for(self, logs: int) -> bool:
        """Return whether there are more than ten rows for each number of an axis: its row of the map, and a bias for each log."""
        return len(self.since) > 10 * (3 + logs)


def _clock_rows(
    first: Sequence[Rates],
    unit: Sequence[Rates],
    moving: Sequence[np.ndarray],
    splines: Sequence[CubicSpline],
    slopes: Sequence[CubicSpline],
    x: np.ndarray,
    about_s: float,
) -> _ClockRows:
    """Return the first unit's rates and their slopes at the unit's sample times, for one clock."""
    parts = []
    for number, (one, other, moves) in enumerate(zip(first, unit, moving, strict=True)):
        tau = other.t_s + x[0] + x[1] * (other.t_s - about_s)
        rows = np.flatnonzero(moves & one.covers(tau))
        at = tau[rows]
        after = later_row(one.t_s, at)
        phase = (at - one.t_s[after - 1]) / (one.t_s[after] - one.t_s[after - 1])
        parts.append(
            _ClockRows(
                log=np.full(len(rows), number),
                read=other.rate[rows],
                ours=splines[number](at),
                slope=slopes[number](at),
                since=other.t_s[rows] - about_s,
                block=np.floor(other.t_s[rows] / CLOCK_BLOCK_S) + 1e7 * number,
                variance=_VARIANCE(phase),
                variance_slope=_VARIANCE_SLOPE(phase) / one.period_s,
            )
        )
    return _ClockRows(*map(np.concatenate, zip(*parts, strict=True)))


def _stepped(rows: _ClockRows, logs: int, noise: np.ndarray, matrix: np.ndarray | None, x: np.ndarray, about_s: float) -> ClockFit:
    """Take one Gauss-Newton step from a clock x (2,) by its rows; noise (3,): variance of the first unit's readings."""
    ours, read, since, log = rows.ours, rows.read, rows.since, rows.log
    count = len(since)
    design = np.hstack([ours, (log[:, None] == np.arange(logs)).astype(float)])
    if matrix is None:
        matrix = np.linalg.lstsq(design, read, rcond=None)[0][:3].T
    size = 3 + logs
    whole = np.zeros((3 * size + 2, 3 * size + 2))
    right = np.zeros(3 * size + 2)
    gram = design.T @ design
    gram[:3, :3] -= np.diag(noise) * rows.variance.sum()
    turned = rows.slope @ matrix.T  # (N, 3)
    clock = np.stack([turned, turned * since[:, None]], axis=2)  # (N, 3, 2)
    for axis in range(3):
        part = slice(axis * size, (axis + 1) * size)
        whole[part, part] = gram
        whole[part, -2:] = design.T @ clock[:, axis]
        # E[n n'] of an interpolated reading: half the slope of its variance.
        for column, weight in ((-2, np.ones(count)), (-1, since)):
            whole[axis * size : axis * size + 3, column] -= matrix[axis] * noise * (rows.variance_slope * weight).sum() / 2
        whole[-2:, part] = whole[part, -2:].T
        right[part] = design.T @ read[:, axis]
        right[-2:] += clock[:, axis].T @ read[:, axis]
    whole[-2:, -2:] = np.einsum("nai,naj->ij", clock, clock)
    solution = np.linalg.solve(whole, right)
    coefficients = solution[:-2].reshape(3, size)
    residual = read - (design @ coefficients.T + clock @ solution[-2:])
    sigma = np.sqrt(np.diag(_covariance(rows.block, whole, design, clock, residual)))
    means = [read[log == each].mean(axis=0) if (log == each).any() else np.zeros(3) for each in range(logs)]
    about = read - np.array(means)[log]
    total = float(np.square(about).sum())
    (offset_s, rate), (offset_sigma_s, rate_sigma) = (x + solution[-2:]).tolist(), sigma[-2:].tolist()
    return ClockFit(
        UnitClock(offset_s, rate, about_s, offset_sigma_s, rate_sigma),
        coefficients[:, :3],
        sigma[:-2].reshape(3, size)[:, :3],
        coefficients[:, 3:].T,
        1 - float(np.square(residual).sum()) / total if total > 0 else 0.0,
        rms_of(residual),
    )


def _covariance(blocks: np.ndarray, whole: np.ndarray, design: np.ndarray, clock: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Covariance of all coefficients from the scatter of the blocks' scores, which includes all errors shared within a block.

    An axis about which nothing turns, whose sum of squares the correction for noise may make negative, has infinite variances.
    """
    blocks, index = np.unique(blocks, return_inverse=True)
    size = design.shape[1]
    scores = np.zeros((len(blocks), whole.shape[0]))
    for axis in range(3):
        np.add.at(scores[:, axis * size : (axis + 1) * size], index, design * residual[:, axis, None])
        np.add.at(scores[:, -2:], index, clock[:, axis] * residual[:, axis, None])
    spread = inverse(whole)
    is_open = np.isinf(np.diag(spread))
    spread[is_open], spread[:, is_open] = 0.0, 0.0
    few = len(blocks) / max(len(blocks) - whole.shape[0] / 3, 1.0)
    return spread @ (scores.T @ scores) @ spread * few + np.diag(np.where(is_open, np.inf, 0.0))


def _cardinal() -> tuple[np.ndarray, np.ndarray]:
    """Return the variance of a cubic spline through white noise of variance 1, between two readings, at phases 0 to 1."""
    knots = np.arange(-12, 13.0)
    phase = np.linspace(0, 1, 101)
    weights = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")(phase)
    return phase, np.square(weights).sum(axis=1)


_VARIANCE = CubicSpline(*_cardinal())
_VARIANCE_SLOPE = _VARIANCE.derivative()
