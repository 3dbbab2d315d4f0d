"""Rest logs to what temperature does at rest: reading, the first look, each axis' fit, the noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.checks.findings import Finding, stop_at_errors
from session.checks.rests import check_rest
from session.common.errors import DataError
from session.detect.knocks import knocked
from session.log.config import Sensor
from session.log.rests import RestLog, read_rest
from tinygc.closure.allan import AllanCurve
from tinygc.temperature.axis_fit import ORDERS, AxisFit, fit_axis
from tinygc.temperature.knots import Knots, make_knots
from tinygc.temperature.noise import NoiseOverTemperature, ShortTimes, long_times, noise_over_temperature, whole_curve
from tinygc.temperature.sweeps import Sweep, sweeps_of

#: told what is being done, and how many steps of how many are done
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class RestFit:
    """logs as read; knots of what was kept; sweeps; gyro, accel: a fit for each axis; allan: curve of what temperature leaves, or None;
    noise over temperature, or None; findings of the first look."""

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
        """Coldest and warmest block, degC; NaN without temperatures."""
        temp = np.concatenate([log.temp_c for log in self.knots.logs])
        return float(temp.min()), float(temp.max())


def read_rests(paths: list[Path], sensor: Sensor, progress: Progress = lambda what, done, of: None) -> list[tuple[RestLog, ShortTimes]]:
    """Each log, and the sums for its short times."""
    found = []
    for number, path in enumerate(paths):
        progress(path.name, number, len(paths))
        short = ShortTimes()
        found.append((read_rest(path, sensor, short), short))
    return found


def fit_rests(
    read: Sequence[tuple[RestLog, ShortTimes | None]],
    orders: tuple[int, ...] = ORDERS,
    with_accel: bool = True,
    progress: Progress = lambda what, done, of: None,
) -> RestFit:
    """Of one sensor's rest logs, all as one.  DataError where a log cannot be one, or some of them have temperatures and some not."""
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
    for kind in ("gyro", *(["accel"] if with_accel else [])):
        blocks = np.concatenate([getattr(log, kind) for log in kept])
        for axis in range(3):
            progress(f"{kind} {'xyz'[axis]}", axis, 3)
            axes[kind].append(fit_axis(knots, blocks[:, axis], orders))
    residual = np.column_stack([residual_blocks(knots, "gyro", axis, fit) for axis, fit in enumerate(axes["gyro"])])
    short = [curve for (log, sums), mask in zip(read, out, strict=True) if sums is not None and (curve := sums.curve(log, mask))]
    allan = whole_curve(short, long_times(kept, residual))
    noise = noise_over_temperature(kept)
    return RestFit(tuple(logs), knots, tuple(sweeps), tuple(axes["gyro"]), tuple(axes["accel"]), allan, noise, tuple(findings))


def zero_of_blocks(knots: Knots, fit: AxisFit) -> np.ndarray:
    """(B,) what an axis' fit says of each block, SI."""
    if fit.order == 0:
        return np.full(sum(map(len, knots.logs)), fit.terms[0])
    return np.polynomial.polynomial.polyval(knots.element_c(fit.tau_s) - knots.reference_c, fit.terms)


def residual_blocks(knots: Knots, kind: str, axis: int, fit: AxisFit) -> np.ndarray:
    """(B,) block means less the fit; each log has a zero of its own, which goes with it."""
    values = np.concatenate([getattr(log, kind)[:, axis] for log in knots.logs]) - zero_of_blocks(knots, fit)
    edges = np.cumsum([len(log) for log in knots.logs])[:-1]
    return np.concatenate([part - part.mean() for part in np.split(values, edges)])
