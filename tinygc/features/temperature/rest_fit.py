"""Fit of rest logs: the effect of temperature at rest, and how the gyroscope's scatter changes with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from session.base.errors import DataError
from session.base.progress import Progress, no_report
from session.detect.check_stills import check_rest
from session.detect.events import knocked
from session.detect.findings import Finding, stop_at_errors
from session.log.rests import RestLog
from tinygc.features.temperature.axis_fit import ORDERS, AxisFit, Knots, fit_axis, make_knots
from tinygc.features.temperature.sweeps import Sweep, sweeps_of

# How the gyroscope's scatter changes with temperature; its terms at rest are those of the command ``noise``.

#: of the temperature's range
BINS = 8


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
    """logs: as read; knots: of the kept blocks; sweeps; gyro, accel: a fit for each axis; noise: over temperature, or None; findings: of
    the first examination."""

    logs: tuple[RestLog, ...]
    knots: Knots
    sweeps: tuple[Sweep, ...]
    gyro: tuple[AxisFit, ...]
    accel: tuple[AxisFit, ...]
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
    return RestFit(
        tuple(logs), knots, tuple(sweeps), tuple(axes["gyro"]), tuple(axes["accel"]), _noise_over_temperature(kept), tuple(findings)
    )


def zero_of_blocks(knots: Knots, fit: AxisFit) -> np.ndarray:
    """Zero of an axis' fit at each block (B,), SI."""
    if fit.order == 0:
        return np.full(sum(map(len, knots.logs)), fit.terms[0])
    return np.polynomial.polynomial.polyval(knots.element_c(fit.tau_s) - knots.reference_c, fit.terms)


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
