"""From a session to the problem that every method solves: the same segments, references, Earth and floor for all."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from session.common.errors import DataError, SegmentError
from session.common.units import DEG, NS
from session.detect.excluded import without_excluded
from session.detect.impacts import find_impacts
from session.detect.known_turns import FoundTurn
from session.detect.segments import Segment, cut_segments
from session.detect.session_stills import SessionStills
from session.detect.stills import Still
from session.log.folder import Session
from session.log.samples import start_times
from tinygc.attitude import rotation
from tinygc.attitude.earth import EarthRate, contradicts, estimate_heading, no_earth, vertical_only, with_heading
from tinygc.closure.floor import closure_floor
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import TOGETHER, Batch, attitudes, directions, nearest_yaw
from tinygc.closure.still_rates import StillRates
from tinygc.lot.lot import Lot
from tinygc.lot.prior import prior_of
from tinygc.models.linear import LinearModel, bias_only
from tinygc.problem.impacts import hits_of, widened_by_impacts
from tinygc.problem.known_turns import as_reference, known_turns_of, rates_at_rest, span_space, tilt_excess
from tinygc.problem.problem import Problem
from tinygc.problem.rejections import CLIPPED, LEFT_OUT
from tinygc.problem.still_set import StillSet
from tinygc.problem.truth import build_truth_problem
from tinygc.problem.widened import bridged_sigma, widened_by_bridges
from tinygc.problem.yaw import angle_between, carry_yaw

#: how well a person reads a dial
DIAL_SIGMA_RAD = 0.05 * DEG
DIAL_LIMIT_RAD = 1.0 * DEG
#: of a segment, before its floor is known
FIRST_SIGMA_RAD = 1e-3
#: a linear fit with 12 parameters and two angles a segment needs at least this many
FEWEST_SEGMENTS = 7
#: what a lot tells of a unit's first fit, which only carries the yaw of so few turns: as a variance, three sigmas for one
FIRST_WIDER = 9.0


def build_problem(
    session: Session,
    *,
    use_earth: bool = True,
    exclude: tuple[int, ...] = (),
    moving: tuple[int, ...] = (),
    clipped: tuple[int, ...] = (),
    found: SessionStills | None = None,
    near: LinearModel | None = None,
    lot: Lot | None = None,
    progress: Callable[[str], None] = lambda what: None,
) -> Problem:
    """Find stills, cut segments, carry the attitude through each log, and put the Earth and the floor beside them.

    exclude: numbers of segments to leave out; moving: numbers of stills, over all logs, that are known to be none; clipped: numbers of
    segments whose rates are not the true ones, so that no attitude can be carried through them either; found: the session's stills,
    where somebody has asked for them before; near: a model near the gyroscope's, where the first search then begins; lot: that
    the unit is taken to be of where its turns are too few for a fit of their own.
    Raises SegmentError (no stills, nothing accepted, too few) and DataError.
    """
    found = found or SessionStills(session)
    if session.truths is not None:
        return build_truth_problem(session, found, use_earth=use_earth, exclude=exclude, progress=progress)
    logs, segments = _stills_and_segments(session, found, exclude, moving, clipped, progress)
    turns = known_turns_of(session, found, segments)
    _require_enough(session, logs, segments, turns, lot)
    chain = replace(_batch(session, logs, segments), turns=as_reference(turns, len(segments), segments))
    used = np.array([segment.accepted for segment in segments])
    sigma = np.hypot(FIRST_SIGMA_RAD, bridged_sigma([s for s in segments if s.accepted], [log.bridges for log in logs]))
    start = bias_only(next(still for log in logs for still in log.stills if still.problem is None).gyro_mean)
    few = np.count_nonzero(used) < FEWEST_SEGMENTS
    beforehand = None if lot is None or not few else prior_of(lot, start.vector).scaled(FIRST_WIDER)
    at_rest = rates_at_rest(logs) if chain.turns is not None else None
    # Twice: the yaw, and with it the Earth, needs a calibration, and the calibration is a little better with the Earth.
    for _ in range(2):
        batch = chain.pick(used).trimmed()
        fit = fit_least_squares(batch, sigma, start, still_rates=at_rest, begin=near, prior=beforehand)
        near = fit.model
        logs, chain = carry_yaw(logs, segments, chain, fit.model)
        earths = _earths(session, logs, fit.model)
        if not use_earth:
            earths = dict.fromkeys(earths, no_earth())
        at = attitudes(chain, fit.model(chain.rate))
        group_of = {id(still): int(group) for log in logs for still, group in zip(log.stills, log.group, strict=True)}
        groups = np.array([group_of[id(segment.stills[0])] for segment in segments])
        earth = np.empty_like(chain.rate)
        for group in np.unique(groups):
            for some in np.array_split(rows := np.flatnonzero(groups == group), -(-len(rows) // TOGETHER)):
                earth[some] = earths[group].in_body(at[some])
        chain = replace(chain, earth=earth)
    batch = chain.pick(used).trimmed()
    accepted = [segment for segment in segments if segment.accepted]
    at = attitudes(batch, fit.model(batch.rate))
    floor = closure_floor(
        batch,
        at,
        [segment.stills for segment in accepted],
        [logs[segment.log].noise for segment in accepted],
        DIAL_SIGMA_RAD,
    )
    more, widened = widened_by_bridges(accepted, [log.bridges for log in logs], at)
    about = directions(batch, at[:, -1])
    floor = floor.widened(about @ more @ about.transpose(0, 2, 1)) if widened else floor
    more, hit = widened_by_impacts(accepted, hits_of(accepted, [find_impacts(log.samples) for log in logs]), batch, floor, fit.model)
    if hit:  # and a first fit that they do not bend
        floor, widened = floor.widened(about @ more @ about.transpose(0, 2, 1)), widened + hit
        sigma = np.hypot(FIRST_SIGMA_RAD, np.sqrt(np.trace(floor.own[:, :2, :2], axis1=1, axis2=2)))
        fit = fit_least_squares(batch, sigma, fit.model, still_rates=at_rest, prior=beforehand)
    if batch.turns is not None:
        floor = replace(floor, tilt_excess=tilt_excess(batch, floor, fit.model, at_rest))
    rates = _still_rates(logs, earths)
    return Problem(session, segments, batch, floor, earths, logs, fit.model, rates, found, known_turns=turns, widened=tuple(widened))


def _stills_and_segments(
    session: Session,
    found: SessionStills,
    exclude: Collection[int],
    moving: Collection[int],
    clipped: Collection[int],
    progress: Callable[[str], None],
) -> tuple[list[StillSet], list[Segment]]:
    logs: list[StillSet] = []
    segments: list[Segment] = []
    number = 0
    for log in session.logs:
        progress(f"stills of {log.path.name}")
        here = found.of(log)
        samples, noise = here.samples, here.noise
        if noise is None:
            continue
        stills = [replace(s, problem="turns about the vertical") if number + i in moving else s for i, s in enumerate(here.stills)]
        number += len(stills)
        sensor, protocol, numbered = session.config.sensor, session.config.protocol, len(segments)
        cut = cut_segments(samples, stills, sensor, protocol, log=len(logs), number=numbered, put_in=log.put_in)
        segments += without_excluded(cut, samples, log.path, session.config.exclude)
        logs.append(StillSet(samples, stills, noise, np.zeros((0, 4)), np.zeros(0, dtype=int), log.bridges))
    segments = [replace(s, problem=CLIPPED, breaks_yaw=True) if s.number in clipped else s for s in segments]
    excluded = [replace(s, problem=LEFT_OUT) if s.number in exclude else s for s in segments]
    if session.config.protocol.reference == "table":
        excluded = [_with_dials(session, logs, segment) for segment in excluded]
        _require_agreement(session, logs)
    unknown = sorted(set(exclude) - {segment.number for segment in segments})
    if unknown and segments:
        raise SegmentError(f"{session.folder}: no segment {unknown[0]} to leave out; there are 0 to {len(segments) - 1}")
    return logs, excluded


def _require_agreement(session: Session, logs: list[StillSet]) -> None:
    """The dials and gravity see the same tilt, or their numbers do not belong together."""
    apart = []
    for number, log in enumerate(logs):
        for still in log.stills:
            if still.problem is None and (reading := _dial(session, logs, number, still)) is not None:
                down = rotation.matrix(rotation.from_euler(*reading))[2]
                apart.append(angle_between(-still.accel_mean, down))
    if apart and np.median(apart) > DIAL_LIMIT_RAD:
        raise DataError(
            f"attitudes.csv: the dials' tilt differs from gravity's by {np.median(apart) / DEG:.1f} deg (median of {len(apart)} stills); "
            f"the log has {sum(len(log.stills) for log in logs)} stills, counted from 0: does the numbering match?"
        )


def _with_dials(session: Session, logs: list[StillSet], segment: Segment) -> Segment:
    """A segment whose ends have no dial reading cannot be used with reference = "table"."""
    dials = [_dial(session, logs, segment.log, still) for still in segment.stills]
    missing = any(dial is None for dial in dials)
    return replace(segment, problem="no dial reading in attitudes.csv for one of its stills") if missing and segment.accepted else segment


def _dial(session: Session, logs: list[StillSet], log: int, still: Still) -> np.ndarray | None:
    """Roll, pitch, yaw (3,) rad of a still, counted over all logs, or None."""
    number = sum(len(before.stills) for before in logs[:log]) + logs[log].stills.index(still)
    table = session.attitudes
    if table is None or number >= len(table) or np.isnan(table[number]).any():
        return None
    return table[number]


def _require_enough(session: Session, logs: list[StillSet], segments: list[Segment], turns: tuple[FoundTurn, ...], lot: Lot | None) -> None:
    where = session.folder
    still_s = session.config.protocol.still_s
    if not logs:
        raise SegmentError(f"{where}: no still phase of {still_s:g} s found; was the table ever left alone? See `calibrate.py check`")
    if not segments:
        stills = [still for log in logs for still in log.stills]
        bad = next((still.problem for still in stills if still.problem), None)
        raise SegmentError(
            f"{where}: {len(stills)} still phase{'s' * (len(stills) != 1)} but no turn between two that are usable"
            + (f" ({bad})" if bad else "")
            + "; record still - turn - still"
        )
    used = [segment for segment in segments if segment.accepted]
    if not used:
        raise SegmentError(f"{where}: all {len(segments)} segments are rejected, the first because {segments[0].problem}")
    if len(used) < FEWEST_SEGMENTS and lot is None and not span_space(turns):
        raise SegmentError(
            f"{where}: {len(used)} usable segments, expected at least {FEWEST_SEGMENTS} (40 is good, fewer with the lot's --lot): "
            "12 parameters, 2 angles a segment"
            + next((f"; turns.csv, {turn.known.name}: {turn.problem}" for turn in turns if turn.problem), "")
        )


def _batch(session: Session, logs: list[StillSet], segments: list[Segment]) -> Batch:
    """All segments, accepted or not, with attitudes from the reference; yaw 0 where it is not known, no Earth yet."""
    dials = session.config.protocol.reference == "table"
    longest = max(segment.stop - segment.start for segment in segments)
    rate = np.moveaxis(np.zeros((3, len(segments), longest)), 0, -1)  # each component contiguous in memory: faster to compute with
    dt = np.zeros((len(segments), longest - 1))
    ends = np.stack([rotation.from_gravity(np.array([segment.stills[end].accel_mean for segment in segments])) for end in (0, 1)])
    for i, segment in enumerate(segments):
        samples = logs[segment.log].samples
        count = segment.stop - segment.start
        rate[i, :count] = samples.gyro[segment.start : segment.stop]
        rate[i, count:] = rate[i, count - 1]
        dt[i, : count - 1] = np.diff(samples.t_ns[segment.start : segment.stop]) * NS
        for end, still in zip(ends, segment.stills, strict=True):
            if dials and (reading := _dial(session, logs, segment.log, still)) is not None:
                # A dial is read to a twentieth of a degree, gravity to a hundredth: the tilt is gravity's, the yaw the dial's.
                end[i] = nearest_yaw(rotation.from_euler(*reading), end[i])
    return Batch(rate, dt, np.zeros_like(rate), ends[0], ends[1], dials)


def _earths(session: Session, logs: list[StillSet], model: LinearModel) -> dict[int, EarthRate]:
    """The Earth's rate in the frame of each yaw group."""
    site = session.config.site
    groups = sorted({int(g) for log in logs for g, still in zip(log.group, log.stills, strict=True) if still.problem is None})
    if site.latitude_deg is None:
        return {g: no_earth() for g in groups}
    q_tb, rate, sigma, group = _reference_stills(logs)
    found = {}
    for g in groups:
        mine = group == g
        found[g] = vertical_only(site.latitude_deg)
        if mine.sum() > 2:
            found[g] = estimate_heading(site.latitude_deg, q_tb[mine], model(rate[mine]), sigma[mine])
    if site.heading_deg is not None:
        # The table's index: where the first still is, by protocol.  Believed unless the stills contradict it.
        given = with_heading(site.latitude_deg, site.heading_deg)
        if not contradicts(found[0], given):
            found[0] = given
    return found


def _reference_stills(logs: list[StillSet]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Attitudes (Q, 4), mean rates (Q, 3), their sigmas (Q, 3) and yaw groups (Q,) of all stills that are references."""
    rows = [
        (q, still.gyro_mean, log.noise.angle_random_walk / np.sqrt(still.duration_s), group)
        for log in logs
        for q, still, group in zip(log.q_tb, log.stills, log.group, strict=True)
        if still.problem is None
    ]
    q_tb, rate, sigma, group = (np.array(column) for column in zip(*rows, strict=True))
    return q_tb, rate, sigma, group


def _still_rates(logs: list[StillSet], earths: dict[int, EarthRate]) -> StillRates:
    q_tb, rate, sigma, group = _reference_stills(logs)
    if not (sigma > 0).all():
        raise DataError("the gyro shows no noise at all in the stills; is the log made of registers, not of smoothed values?")
    began = start_times(log.samples for log in logs)
    middle_s = [
        began[number] + still.start_s + still.duration_s / 2
        for number, log in enumerate(logs)
        for still in log.stills
        if still.problem is None
    ]
    return StillRates(
        rate, np.array([earths[int(g)].in_body(q) for g, q in zip(group, q_tb, strict=True)]), sigma, q_tb, np.array(middle_s)
    )
