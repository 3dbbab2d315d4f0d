"""The problem of a session whose reference is a truth file."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from session.base.errors import SegmentError
from session.base.progress import Reporter, no_report
from session.base.units import DEG
from session.detect.segments import Segment, without_excluded
from session.detect.stills import LogStills, Noise, SessionStills
from session.log.folder import Session
from session.log.samples import Samples
from tinygc.closure.build import batch_between, still_rates
from tinygc.closure.earth import EarthRate, no_earth, vertical_only, with_heading
from tinygc.closure.floor import Floor, gyro_variance
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.problem import LEFT_OUT, Problem, widened_by_bridges
from tinygc.closure.residual import Batch, attitudes
from tinygc.closure.stills import StillSet
from tinygc.features.truth.segments import TruthEnds, cut_at_truth
from tinygc.models.linear import LinearModel, bias_only

# The problem of a session whose reference is a truth file: segments between moments of truth, three angles each.
#
# Stills are not needed.  If there are any, they give the sensor's noise and its rate at rest.  The noise of a log without rests is measured
# in the sample-to-sample scatter of its quietest half seconds, and includes vibration.

#: "stills" noisier than this are steady flight: no MEMS gyro has so much noise
STILL_NOISE_RPS_RTHZ = 0.1 * DEG
#: twelve parameters, three angles a segment
FEWEST_SEGMENTS = 5
QUIET_BLOCK_S = 0.5
QUIETEST = 0.05
#: over a much longer time a bias of some dps rotates by more than half a circle, where no search converges
SHORT_S = 2.0


def build_truth_problem(
    session: Session,
    found: SessionStills,
    *,
    use_earth: bool = True,
    exclude: tuple[int, ...] = (),
    progress: Reporter = no_report,
) -> Problem:
    """As ``build_problem``.  Raises SegmentError (too few segments) and DataError (truth and log do not share their times)."""
    logs: list[StillSet] = []
    cut: list[tuple[Segment, TruthEnds]] = []
    protocol, sensor = session.config.protocol, session.config.sensor
    for number, (log, truth) in enumerate(zip(session.logs, session.reference.truths, strict=True)):
        progress(f"truth of {log.path.name}")
        here = found.of(log)
        part = cut_at_truth(here.samples, truth, sensor, protocol, log=number, number=len(cut), put_in=log.put_in)
        kept = without_excluded([segment for segment, _ in part], here.samples, log.path, session.config.exclude)
        cut += [(segment, ends) for segment, (_, ends) in zip(kept, part, strict=True)]
        logs.append(replace(_still_set(here, part), bridges=log.bridges))
    unknown = sorted(set(exclude) - {segment.number for segment, _ in cut})
    if unknown:
        raise SegmentError(f"{session.folder}: no segment {unknown[0]} to leave out; there are 0 to {len(cut) - 1}")
    segments = [replace(s, problem=LEFT_OUT) if s.number in exclude else s for s, _ in cut]
    used = np.array([segment.accepted for segment in segments])
    if used.sum() < FEWEST_SEGMENTS:
        why = next((segment.problem for segment in segments if segment.problem), None)
        raise SegmentError(
            f"{session.folder}: {used.sum()} usable segments between moments of truth, expected at least {FEWEST_SEGMENTS}"
            + (f"; the first that is none: {why}" if why else "; give more moments, or a shorter protocol.segment_s")
        )
    ends = [ends for (_, ends), ok in zip(cut, used, strict=True) if ok]
    accepted = [segment for segment, ok in zip(segments, used, strict=True) if ok]
    batch = batch_of(logs, accepted, ends)
    model = _first_fit(session, logs, batch)
    earth = _earth(session) if use_earth else no_earth()
    at = attitudes(batch, model(batch.rate))
    batch = replace(batch, earth=earth.in_body(at))
    model = fit_least_squares(batch, np.full(len(batch), 1e-3), model).model
    logs = [_with_attitudes(log, number, accepted, at) for number, log in enumerate(logs)]
    floor = _floor(batch, at, accepted, ends, logs, session.reference)
    more, widened = widened_by_bridges(accepted, [log.bridges for log in logs], at)
    floor = floor.widened(more) if widened else floor
    return Problem(session, segments, batch, floor, {0: earth}, logs, model, still_rates(logs, {0: earth}), found, widened=tuple(widened))


def _still_set(found: LogStills, cut: list[tuple[Segment, TruthEnds]]) -> StillSet:
    samples, stills, noise = found.samples, found.stills, found.noise
    if noise is None or noise.gyro.max() > STILL_NOISE_RPS_RTHZ or not (noise.gyro > 0).all():
        stills, noise = [], _noise_in_motion(samples)
    covered = [still for still in stills if any(s.start <= still.middle < s.stop for s, _ in cut if s.accepted)]
    return StillSet(samples, covered, noise, np.tile([1.0, 0, 0, 0], (len(covered), 1)), np.zeros(len(covered), dtype=int))


def _noise_in_motion(samples: Samples) -> Noise:
    """White noise from second differences, which a movement of some Hz hardly reaches, in the quietest half seconds."""
    size = max(4, round(QUIET_BLOCK_S / samples.period_s))

    def density(values: np.ndarray) -> np.ndarray:
        second = np.diff(values, n=2, axis=0)
        second = second[: max(len(second) // size, 1) * size].reshape(-1, min(size, len(second)), 3)
        variance = np.quantile(np.mean(second**2, axis=1), QUIETEST, axis=0) / 6
        return np.sqrt(np.maximum(variance, np.finfo(float).tiny) * 2 * samples.period_s)

    return Noise(density(samples.gyro), density(samples.accel))


def batch_of(logs: list[StillSet], segments: list[Segment], ends: list[TruthEnds]) -> Batch:
    """Batch of the segments with the truth's attitudes at their ends."""
    start, end = (np.array([getattr(one, name) for one in ends]) for name in ("start", "end"))
    return batch_between(logs, segments, start, end, yaw_known=True)


def _first_fit(session: Session, logs: list[StillSet], batch: Batch) -> LinearModel:
    """Fit a linear model without a start value: first to short segments, if the truth is dense enough inside the long ones."""
    still = next((still for log in logs for still in log.stills if still.problem is None), None)
    model = bias_only(None if still is None else still.gyro_mean)
    protocol = session.config.protocol
    if protocol.segment_s > SHORT_S:
        short = replace(protocol, segment_s=SHORT_S)
        cut = [
            pair
            for number, (log, truth) in enumerate(zip(logs, session.reference.truths, strict=True))
            for pair in cut_at_truth(log.samples, truth, session.config.sensor, short, log=number, put_in=session.logs[number].put_in)
            if pair[0].accepted
        ]
        inside = batch_of(logs, [segment for segment, _ in cut], [ends for _, ends in cut])
        model = fit_least_squares(inside, np.full(len(inside), 1e-3), model).model
    return fit_least_squares(batch, np.full(len(batch), 1e-3), model).model


def _earth(session: Session) -> EarthRate:
    site = session.config.site
    if site.latitude_deg is None:
        return no_earth()
    # The heading is that of the truth's x axis.
    return vertical_only(site.latitude_deg) if site.heading_deg is None else with_heading(site.latitude_deg, site.heading_deg)


def _with_attitudes(log: StillSet, number: int, segments: list[Segment], at: np.ndarray) -> StillSet:
    """Set the attitudes of the stills from truth and gyro."""
    q = []
    for still in log.stills:
        i = next(i for i, s in enumerate(segments) if s.log == number and s.start <= still.middle < s.stop)
        q.append(at[i, still.middle - segments[i].start])
    return replace(log, q_tb=np.array(q).reshape(-1, 4))


def _floor(batch: Batch, at: np.ndarray, segments: list[Segment], ends: list[TruthEnds], logs: list[StillSet], reference: Any) -> Floor:
    """Floor from the gyro's noise and the truth's sigma at both ends; neighbours share a moment of truth."""
    own = gyro_variance(batch, at, [logs[segment.log].noise for segment in segments])
    truth = np.eye(3) * (reference.sigma_deg * DEG) ** 2
    shared = np.zeros((len(batch) - 1, 3, 3))
    for i in range(len(batch) - 1):
        if segments[i].log == segments[i + 1].log and ends[i].last == ends[i + 1].first:
            shared[i] = -truth
    of_truth = Floor(np.broadcast_to(2 * truth, own.shape), shared)
    return Floor(own + of_truth.own, shared, references={reference.title: of_truth})
