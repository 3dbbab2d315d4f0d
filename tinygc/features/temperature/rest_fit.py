"""Fit of rest logs: the effect of temperature at rest, and the gyroscope's noise over temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from session.base.errors import DataError
from session.base.progress import Progress, no_report
from session.detect.check_stills import check_rest
from session.detect.events import knocked
from session.detect.findings import Finding, stop_at_errors
from session.log.rests import RestLog
from tinygc.closure.floor import SEEN_SIGMAS, AllanCurve, allan_curve
from tinygc.features.temperature.axis_fit import ORDERS, AxisFit, Knots, estimate_noise, fit_axis, make_knots, priced, white_of
from tinygc.features.temperature.sweeps import Sweep, sweeps_of
from tinygc.inference.noise import where_risen

# A gyroscope's noise from rest logs: its components, the Allan deviation of what temperature leaves, its change with temperature.

#: averaging times per octave; fewest blocks of a piece
PER_OCTAVE, SHORTEST_PIECE = 2, 4
#: of the temperature's range
BINS = 8
#: rise of -2 log L at the limit of a flicker that is not seen: it has been drawn low, and the limits of 1.645 sigma hold in 43 of 50 rests
#: that walk, those of 2 in 48 (benchmarks/temperature.py, nulls)
AT_LIMIT = 2.0**2
#: relative sigma of white noise by the median of second differences of blocks, times the root of their number
BY_STEPS = 1.40
#: Hadamard variance of flicker noise of instability 1: half the logarithm of 256 / 27, over pi
HADAMARD_FLICKER = np.log(256 / 27) / 2 / np.pi


class AtRest(NamedTuple):
    """Angle random walk, rad/s/sqrt(Hz), and bias instability, rad/s, of one axis, with their sigmas; at_most: upper limit (95 %) of a bias
    instability that is not seen, else NaN."""

    walk: float
    walk_sigma: float
    instability: float
    instability_sigma: float
    at_most: float


def noise_at_rest(knots: Knots, blocks: np.ndarray, fit: AxisFit) -> AtRest:
    """Noise of the blocks (B,) about an axis' fit: flicker with white noise and a random walk, as the fit's own sigmas have it.

    White noise shows in how the steps between blocks differ, less what the others add to their Hadamard variance.
    """
    step_s, unit = knots.logs[0].block_s, float(np.std(blocks)) or 1.0
    y, V = knots.mean(blocks) / unit, knots.covariances()
    J = priced(knots, y, fit.tau_s, fit.order)
    steps, square = knots.of_steps(y, fit.tau_s, fit.order), white_of(knots, blocks / unit) ** 2
    found = estimate_noise(y, J, V, np.sqrt(square), steps, with_sigma=True)
    slow = step_s * np.array([HADAMARD_FLICKER, step_s / 6])
    white = max(square - float(slow @ found.sizes[1:] ** 2), 0.0) ** 0.5
    sigma = np.hypot(BY_STEPS * square / np.sqrt(len(blocks)), slow[0] * found.sizes[1] * found.sigmas[1]) / max(white, 1e-300)

    def rise(size: float) -> float:
        """Of -2 log L at a given flicker, the others estimated again."""
        scaled = [V[0], np.zeros_like(V[1]), V[2]]
        return estimate_noise(y, J, scaled, np.sqrt(square), steps + size**2 * V[1]).value - found.value

    size, most = found.sizes[1], np.nan
    if not size > SEEN_SIGMAS * found.sigmas[1]:
        most = where_risen(rise, size, float(np.std(y)) / 10, AT_LIMIT, 0.03)
    return AtRest(*(value * unit for value in (white, sigma, size, found.sigmas[1], most)))


def _allan(logs: list[RestLog], residual: np.ndarray) -> AllanCurve | None:
    """Allan deviation of block means after the temperature fit, residual (B, 3) rad/s of all logs' kept blocks; None where all pieces are
    short."""
    pieces, at = [], 0
    for log in logs:
        edges = np.flatnonzero(np.diff(log.number) > 1) + 1
        pieces += [part for part in np.split(residual[at : at + len(log)], edges) if len(part) >= SHORTEST_PIECE]
        at += len(log)
    return allan_curve(pieces, logs[0].block_s, PER_OCTAVE) if pieces else None


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
    """logs: as read; knots: of the kept blocks; sweeps; gyro, accel: a fit for each axis; at_rest: the gyroscope's noise by
    axis; allan: curve of the residuals, or None; noise: over temperature, or None; findings: of the first examination."""

    logs: tuple[RestLog, ...]
    knots: Knots
    sweeps: tuple[Sweep, ...]
    gyro: tuple[AxisFit, ...]
    accel: tuple[AxisFit, ...]
    at_rest: tuple[AtRest, ...]
    allan: AllanCurve | None
    noise: NoiseOverTemperature | None
    findings: tuple[Finding, ...]

    @property
    def range_c(self) -> tuple[float, float]:
        """Lowest and highest temperature of a block, degC; NaN without temperatures."""
        temp = np.concatenate([log.temp_c for log in self.knots.logs])
        return float(temp.min()), float(temp.max())


def fit_rests(
    logs: Sequence[RestLog],
    orders: tuple[int, ...] = ORDERS,
    progress: Progress = no_report,
) -> RestFit:
    """Fit one sensor's rest logs together.  Raises DataError for a log that is not a rest log, or where only some have temperatures."""
    findings = [finding for log in logs for finding in check_rest(log)]
    stop_at_errors(findings)
    with_temperature = {log.has_temperature for log in logs}
    if len(with_temperature) > 1:
        without = next(log for log in logs if not log.has_temperature)
        raise DataError(f"{without.path.name} has no temperature, and other rest logs have; leave it out, or give it the column")
    out = [knocked(log) for log in logs]
    kept = [log.pick(~mask) for log, mask in zip(logs, out, strict=True)]
    sweeps = [sweep for index, log in enumerate(kept) for sweep in sweeps_of(log.temp_c, index)]
    if with_temperature == {False}:
        orders = (0,)
    knots = make_knots(kept, sweeps)
    axes: dict[str, list[AxisFit]] = {"gyro": [], "accel": []}
    for kind in axes:
        blocks = np.concatenate([getattr(log, kind) for log in kept])
        for axis in range(3):
            progress(f"{kind} {'xyz'[axis]}", axis, 3)
            axes[kind].append(fit_axis(knots, blocks[:, axis], orders))
    residual = np.column_stack([_residual_blocks(knots, "gyro", axis, fit) for axis, fit in enumerate(axes["gyro"])])
    gyro = np.concatenate([log.gyro for log in kept])
    at_rest = tuple(noise_at_rest(knots, gyro[:, axis], fit) for axis, fit in enumerate(axes["gyro"]))
    allan, noise = _allan(kept, residual), _noise_over_temperature(kept)
    return RestFit(tuple(logs), knots, tuple(sweeps), tuple(axes["gyro"]), tuple(axes["accel"]), at_rest, allan, noise, tuple(findings))


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
