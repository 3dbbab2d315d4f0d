"""Fit of rest logs: the effect of temperature at rest, and the gyroscope's noise over temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from session.base.errors import DataError
from session.base.progress import Progress, untold
from session.base.units import NS
from session.detect.check_stills import check_rest
from session.detect.events import knocked
from session.detect.findings import Finding, stop_at_errors
from session.log.config import Sensor
from session.log.rests import RestLog, read_rest
from session.log.samples import Samples
from tinygc.closure.floor import AllanCurve, AllanSums, averaging_factors, curve_of, joined_curves
from tinygc.features.temperature.axis_fit import ORDERS, AxisFit, Knots, fit_axis, make_knots
from tinygc.features.temperature.sweeps import Sweep, sweeps_of

# A gyroscope's noise from rest logs: Allan deviation over all averaging times, and its dependence on temperature.

#: samples of a chunk of short averaging times: a knock invalidates one chunk
CHUNK = 2048
#: averaging times per octave
PER_OCTAVE = 2
#: of the temperature's range
BINS = 8


class _ShortTimes:
    """Sums for the Allan deviation up to a block's length, chunk by chunk, while a log is read (``read_rest``'s watch)."""

    def __init__(self) -> None:
        self._factors: tuple[int, ...] | None = None
        self._period_s = np.nan
        self._first_ns = 0
        self._chunks: list[tuple[float, float, AllanSums]] = []

    def __call__(self, samples: Samples) -> None:
        """Add the next piece of the log."""
        if len(samples) < 8:
            return
        if self._factors is None:
            self._period_s, self._first_ns = samples.period_s, int(samples.t_ns[0])
            self._factors = averaging_factors(max(round(4.0 / self._period_s), 16), PER_OCTAVE)
        t_s = (samples.t_ns - self._first_ns) * NS
        longest = 2 * self._factors[-1]
        size = max(CHUNK, 2 * longest)
        # A gap ends a chunk, so that no second difference spans it.
        gaps = np.flatnonzero(np.diff(t_s) > 1.5 * self._period_s) + 1
        for start, stop in zip(np.append(0, gaps), np.append(gaps, len(t_s)), strict=True):
            for begin in range(int(start), int(stop), size):
                end = min(begin + size, int(stop))
                if end - begin >= 8:
                    # Less a parabola, the effect of temperature within a chunk, which is far longer than the averaging times
                    rates = samples.gyro[begin:end]
                    x = np.linspace(-1, 1, len(rates))
                    Q = np.linalg.qr(np.column_stack([np.ones_like(x), x, x**2]))[0]
                    self._chunks.append((t_s[begin], t_s[end - 1], AllanSums.of(rates - Q @ (Q.T @ rates), self._factors)))

    def curve(self, log: RestLog, left_out: np.ndarray) -> AllanCurve | None:
        """Return the curve without the chunks that contain a block of ``left_out`` (B,); None where none remains."""
        bad_s = log.t_s[left_out]
        first, last = (np.array([chunk[k] for chunk in self._chunks]) for k in (0, 1))
        hit = np.searchsorted(bad_s, first - log.block_s / 2) != np.searchsorted(bad_s, last + log.block_s / 2)
        kept = [chunk[2] for chunk, out in zip(self._chunks, hit, strict=True) if not out]
        return curve_of(kept, self._period_s, log.duration_s) if kept else None


def _long_times(logs: list[RestLog], residual: np.ndarray) -> AllanCurve | None:
    """Allan deviation of block means after the temperature fit, residual (B, 3) rad/s of all logs' kept blocks; None where all pieces are
    short."""
    pieces, at = [], 0
    for log in logs:
        edges = np.flatnonzero(np.diff(log.number) > 1) + 1
        pieces += [part for part in np.split(residual[at : at + len(log)], edges) if len(part) >= 4]
        at += len(log)
    if not pieces:
        return None
    longest = max(map(len, pieces))
    factors = averaging_factors(longest, PER_OCTAVE)
    return curve_of([AllanSums.of(piece, factors) for piece in pieces], logs[0].block_s, longest * logs[0].block_s)


def whole_curve(short: list[AllanCurve], long: AllanCurve | None) -> AllanCurve | None:
    """Combine the short times of the first log that has them (all logs are of one sensor, at one rate) with the long ones."""
    if not short or long is None:
        return short[0] if short else long
    return joined_curves(short[0], long)


@dataclass(frozen=True, eq=False)
class NoiseOverTemperature:
    """at_c (n,) degC; rms (n, 3) rad/s of single readings there; per_c, sigma (3,): change of the rms, share per degC, and its sigma."""

    at_c: np.ndarray
    rms: np.ndarray
    per_c: np.ndarray
    sigma: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))


def _noise_over_temperature(logs: list[RestLog]) -> NoiseOverTemperature | None:
    """Regress the scatter within the blocks on temperature; None without a range of temperatures."""
    if not all(log.has_temperature for log in logs):
        return None
    temp, sd = (np.concatenate([getattr(log, name) for log in logs]) for name in ("temp_c", "gyro_sd"))
    low, high = float(temp.min()), float(temp.max())
    mean = (sd**2).mean(axis=0)
    if high - low < 1.0 or not (mean > 0).all():
        return None
    edges = np.linspace(low, high, BINS + 1)
    where = np.clip(np.digitize(temp, edges) - 1, 0, BINS - 1)
    here = [where == k for k in range(BINS) if (where == k).sum() >= 10]
    centred = temp - temp.mean()
    # Variances are unbiased however few samples a block holds; the relative slope of the rms is half of theirs.
    level = sd**2 / mean / 2
    spread = float(centred @ centred)
    per_c = centred @ level / spread
    left = level - level.mean(axis=0) - centred[:, None] * per_c
    # White scatter has no autocorrelation; disturbances (a person in the room) correlate neighbours, and widen the sigma.
    alike = 1 + 2 * np.clip((left[1:] * left[:-1]).mean(axis=0) / (left**2).mean(axis=0), 0, 0.95)
    sigma = np.sqrt((left**2).mean(axis=0) / spread * alike)
    at_c = np.array([temp[mask].mean() for mask in here])
    rms = np.array([np.sqrt((sd[mask] ** 2).mean(axis=0)) for mask in here])
    return NoiseOverTemperature(at_c, rms, per_c, sigma)


# Rest logs to the effect of temperature at rest: reading, the first examination, each axis' fit, the noise.


@dataclass(frozen=True, eq=False)
class RestFit:
    """logs: as read; knots: of the kept blocks; sweeps; gyro, accel: a fit for each axis; allan: curve of the residuals, or None;
    noise: over temperature, or None; findings: of the first examination."""

    logs: tuple[RestLog, ...]
    knots: Knots
    sweeps: tuple[Sweep, ...]
    gyro: tuple[AxisFit, ...]
    accel: tuple[AxisFit, ...]
    allan: AllanCurve | None
    noise: NoiseOverTemperature | None
    findings: tuple[Finding, ...]

    @property
    def range_c(self) -> tuple[float, float]:
        """Lowest and highest temperature of a block, degC; NaN without temperatures."""
        temp = np.concatenate([log.temp_c for log in self.knots.logs])
        return float(temp.min()), float(temp.max())


def read_rests(paths: list[Path], sensor: Sensor, progress: Progress) -> list[tuple[RestLog, _ShortTimes]]:
    """Return each log, and the sums for its short averaging times."""
    found = []
    for number, path in enumerate(paths):
        progress(path.name, number, len(paths))
        short = _ShortTimes()
        found.append((read_rest(path, sensor, short), short))
    return found


def fit_rests(
    read: Sequence[tuple[RestLog, _ShortTimes | None]],
    orders: tuple[int, ...] = ORDERS,
    progress: Progress = untold,
) -> RestFit:
    """Fit one sensor's rest logs together.  Raises DataError for a log that is not a rest log, or where only some have temperatures."""
    logs = [log for log, _ in read]
    findings = [finding for log in logs for finding in check_rest(log)]
    stop_at_errors(findings)
    told = {log.has_temperature for log in logs}
    if len(told) > 1:
        without = next(log for log in logs if not log.has_temperature)
        raise DataError(f"{without.path.name} has no temperature, and other rest logs have; leave it out, or give it the column")
    out = [knocked(log) for log in logs]
    kept = [log.pick(~mask) for log, mask in zip(logs, out, strict=True)]
    sweeps = [sweep for index, log in enumerate(kept) for sweep in sweeps_of(log.temp_c, index)]
    if told == {False}:
        orders = (0,)
    knots = make_knots(kept, sweeps)
    axes: dict[str, list[AxisFit]] = {"gyro": [], "accel": []}
    for kind in axes:
        blocks = np.concatenate([getattr(log, kind) for log in kept])
        for axis in range(3):
            progress(f"{kind} {'xyz'[axis]}", axis, 3)
            axes[kind].append(fit_axis(knots, blocks[:, axis], orders))
    residual = np.column_stack([_residual_blocks(knots, "gyro", axis, fit) for axis, fit in enumerate(axes["gyro"])])
    short = [curve for (log, sums), mask in zip(read, out, strict=True) if sums is not None and (curve := sums.curve(log, mask))]
    allan = whole_curve(short, _long_times(kept, residual))
    noise = _noise_over_temperature(kept)
    return RestFit(tuple(logs), knots, tuple(sweeps), tuple(axes["gyro"]), tuple(axes["accel"]), allan, noise, tuple(findings))


def zero_of_blocks(knots: Knots, fit: AxisFit) -> np.ndarray:
    """Zero of an axis' fit at each block (B,), SI."""
    if fit.order == 0:
        return np.full(sum(map(len, knots.logs)), fit.terms[0])
    return np.polynomial.polynomial.polyval(knots.element_c(fit.tau_s) - knots.reference_c, fit.terms)


def _residual_blocks(knots: Knots, kind: str, axis: int, fit: AxisFit) -> np.ndarray:
    """Block means (B,) less the fit; each log's own zero is removed too."""
    values = np.concatenate([getattr(log, kind)[:, axis] for log in knots.logs]) - zero_of_blocks(knots, fit)
    edges = np.cumsum([len(log) for log in knots.logs])[:-1]
    return np.concatenate([part - part.mean() for part in np.split(values, edges)])


# What the noise at rest asks of the temperature: what of a rest goes with it.


def knots_of(logs: Sequence[RestLog]) -> Knots:
    """Return the blocks of rests over temperature."""
    return make_knots(list(logs), [sweep for index, log in enumerate(logs) for sweep in sweeps_of(log.temp_c, index)])


def part_of(knots: Knots, means: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Fit the zero of a channel over temperature, with its lag, to the means (B,) of the blocks.

    Returns the zero (B,) of each, and its columns (B, order); None where it does not depend on the temperature.
    """
    found = fit_axis(knots, means)
    if not found.order:
        return None
    element = knots.element_c(found.tau_s) - knots.reference_c
    return zero_of_blocks(knots, found), element[:, None] ** np.arange(1, found.order + 1)
