"""Closure runs: a still, a long turn, a still in the same attitude.  They are never fitted (the paper's Table 3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.base import rotation
from session.base.errors import DataError
from session.base.units import DEG, NS
from session.detect.segments import RETURN_RAD, run_ends
from session.detect.stamp_errors import stamp_errors
from session.detect.stills import Still
from session.log.folder import Session
from session.log.logfile import Log
from session.log.samples import Samples
from tinygc.closure import residual
from tinygc.closure.earth import EarthRate, unseen_covariance, vertical_only
from tinygc.closure.floor import gyro_variance, stamp_variance, still_tilt_variance
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch
from tinygc.closure.stills import goes_on
from tinygc.models.model import Model

#: stillness integrated at either end, to allow for the detector's delay
MARGIN_S = 0.1
#: s between session and run where the run's clock began again: longer than the bias remembers anything (``floor.TIMES_S``)
LONG_AFTER_S = 1e6


@dataclass(frozen=True, eq=False)
class ClosureRun:
    """One run ready to be integrated.

    file; duration_s of the movement; batch of one segment with three known angles; floor_rad (3,): one sigma from noise alone; earth:
    whether the horizontal part of the Earth's rate is included; heading_covariance (3, 3) rad^2: of what its uncertain heading leaves;
    samples of the whole log; rows of the batch in it; began_s: session time at the log's start, long after the session where the clocks do
    not known (``time_known``); yaw_carried: whether its yaw continues that at the end of the last log.
    """

    file: str
    duration_s: float
    batch: Batch
    floor_rad: np.ndarray
    earth: EarthRate
    heading_covariance: np.ndarray
    samples: Samples
    rows: slice
    began_s: float
    time_known: bool
    yaw_carried: bool

    def errors(self, model: Model) -> np.ndarray:
        """Roll, pitch, yaw error (3,) rad: the error rotation about the table's x, y and the vertical."""
        return self.errors_at(model(self.batch.rate[0]) if model.pointwise else self.rates(model))

    def rates(self, model: Model) -> np.ndarray:
        """Calibrated rates (N, 3) rad/s of the batch's rows, by a model that may need the whole log.

        A net with memory starts at the log's beginning; physics may use samples around the run.  The run was recorded after the session:
        effects that depend on the session's time keep their final value.
        """
        return model.at_end().calibrate(self.samples)[self.rows]

    def with_earth(self, more_t: np.ndarray, rate: np.ndarray) -> ClosureRun:
        """Add a correction (3,) rad/s of the Earth's rate in table axes, at the attitudes given by calibrated rates (N, 3)."""
        if self.earth.source in ("none", "unknown") and not self.yaw_carried:
            return self
        turn = rotation.matrix(residual.attitudes(self.batch, rate[None]))
        return replace(self, batch=replace(self.batch, earth=self.batch.earth + np.einsum("stji,j->sti", turn, more_t)))

    def errors_at(self, rate: np.ndarray) -> np.ndarray:
        """As ``errors``, for calibrated rates (N, 3) of the batch's rows."""
        return residual.error_angles(residual.segment_residuals(self.batch, rate[None]))[0]


def read_closure_runs(problem: Problem) -> list[ClosureRun]:
    """Read the session's closure runs; raises DataError for a run without two stills, or that does not return."""
    return [_prepare(problem, log) for log in problem.session.closures]


def _prepare(problem: Problem, log: Log) -> ClosureRun:
    session, name = problem.session, log.path.name
    found = problem.found.of(log)
    samples, noise = found.samples, found.noise
    ends = run_ends(samples, found.stills, session.config.sensor, log.put_in)
    if noise is None or ends is None:
        stills = sum(still.problem is None for still in found.stills)
        raise DataError(f"{name}: {stills} still phases, expected one before and one after the turn; record still - long turn - still")
    if not ends.returned:
        raise DataError(
            f"{name}: does not return: gravity at its end is {ends.away_rad / DEG:.2f} deg from where it began, expected at most "
            f"{RETURN_RAD / DEG:g}; set the table back to the same marks, or name the file log*.csv to fit it"
        )
    if ends.broken:
        raise DataError(f"{name}: {ends.broken}; a closure run must be whole: record it again, or remove the file")
    first, last = ends.first, ends.last
    margin = round(MARGIN_S / samples.period_s)
    rows = slice(max(first.stop - 1 - margin, first.start), min(last.start + margin, last.stop) + 1)
    part = samples.between(rows.start, rows.stop)
    # By protocol the yaw is the same; the tilt comes from gravity, since a hand does not return to a hundredth of a degree.
    earth, start, carried = _earth_and_start(problem, session, samples, first)
    end = rotation.nearest_yaw(start, rotation.from_gravity(last.accel_mean))
    bare = Batch(part.gyro[None], part.dt_s[None], np.zeros_like(part.gyro[None]), start[None], end[None], yaw_known=True)
    attitudes = residual.attitudes(bare, problem.first(bare.rate))
    batch = Batch(bare.rate, bare.dt, earth.in_body(attitudes), bare.start, bare.end, yaw_known=True)
    variance = np.diagonal(gyro_variance(batch, attitudes, [problem.noise])[0]).copy()
    stamps = stamp_errors(samples, session.config.protocol.segment_s)
    variance += np.diagonal(stamp_variance(batch, attitudes, [stamps])[0])
    variance[:2] += still_tilt_variance(first, problem.noise) + still_tilt_variance(last, problem.noise)
    pause_s = float(samples.t_ns[0] - problem.logs[-1].samples.t_ns[-1]) * NS
    for bridge in (each for each in log.bridges if rows.start <= each.row < rows.stop):
        variance += rotation.matrix(attitudes[0, bridge.row - rows.start]) ** 2 @ bridge.sigma_rad**2
    return ClosureRun(
        file=name,
        duration_s=float(samples.t_ns[last.start] - samples.t_ns[first.stop - 1]) * NS,
        batch=batch,
        floor_rad=np.sqrt(variance),
        earth=earth,
        heading_covariance=unseen_covariance(earth, session.config.site.latitude_deg) * float(part.dt_s.sum()) ** 2,
        samples=samples,
        rows=rows,
        yaw_carried=carried,
        began_s=float(problem.began_s[-1]) + (pause_s if pause_s >= 0 else LONG_AFTER_S),
        time_known=pause_s >= 0,
    )


def _earth_and_start(problem: Problem, session: Session, samples: Samples, first: Still) -> tuple[EarthRate, np.ndarray, bool]:
    """Earth's rate and start of a run: its yaw is known if the table was not touched since the last log; else only the vertical rate."""
    before = problem.logs[-1]
    start = rotation.from_gravity(first.accel_mean)
    references = [i for i, still in enumerate(before.stills) if still.problem is None]
    if references and goes_on(before.samples, before.stills[references[-1]], samples, first):
        earth = problem.earths[int(before.group[references[-1]])]
        return earth, rotation.nearest_yaw(before.q_tb[references[-1]], start), True
    latitude_deg = session.config.site.latitude_deg
    if latitude_deg is None or problem.earth.source == "none":
        return problem.earth, start, False
    return vertical_only(latitude_deg), start, False
