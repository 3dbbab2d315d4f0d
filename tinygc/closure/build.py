"""Build the fit problem of a session: segments, references, known turns, impacts, bias from adjoining stills."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from session.base import rotation
from session.base.errors import DataError, FitError, SegmentError
from session.base.numeric import running_sum
from session.base.progress import Reporter, no_report
from session.base.rotation import angle_between
from session.base.texts import command_line
from session.base.units import DEG, EARTH_RATE_RPS, NS
from session.detect.accelerometer import times_of
from session.detect.dials import without_wrong_dials
from session.detect.events import Impact, find_impacts
from session.detect.segments import FEWEST_SEGMENTS, FoundTurn, Segment, known_turns, session_segments, why_too_few
from session.detect.stamp_errors import stamp_errors
from session.detect.stills import SessionStills, Still, references
from session.log.folder import Session
from tinygc.closure import residual
from tinygc.closure.earth import EarthRate, contradicts, earths_in_body, estimate_heading, no_earth, vertical_only, with_heading
from tinygc.closure.floor import Floor, closure_floor
from tinygc.closure.least_squares import PriorOf, StillRates, fit_least_squares, naming_segments
from tinygc.closure.problem import CLIPPED, LEFT_OUT, NOT_TAKEN, Problem, Widening, bridged_sigma, widened_by_bridges
from tinygc.closure.residual import TOGETHER, Batch, KnownTurns, attitudes, closure_angles, directions
from tinygc.closure.stills import StillSet, carry_yaw
from tinygc.models import linear
from tinygc.models.linear import PARAMETERS, LinearModel, bias_only

# Known turns of a session as the third angle of its batch (``session/detect/segments.py``, ``tinygc/closure/residual.py``).


def known_turns_of(session: Session, found: SessionStills, segments: Sequence[Segment]) -> tuple[FoundTurn, ...]:
    """Match the session's known turns to its segments.

    Turns are numbered as ``check`` numbers them.  Where a still was rejected since, two turns become one segment; neither angle is used.
    """
    if not session.turns:
        return ()
    now = {(s.log, s.stills[0].start, s.stills[1].start): s for s in segments}
    turns = []
    for turn in known_turns(session, session_segments(session, found)):
        if turn.segment is None:
            turns.append(turn)
            continue
        first, last = turn.segment.stills
        segment = now.get((turn.segment.log, first.start, last.start))
        if segment is None:
            turns.append(replace(turn, segment=None, problem="a still at one of its ends is none"))
        else:
            problem = turn.problem or (None if segment.accepted else f"the turn is not used: {segment.problem}")
            turns.append(replace(turn, segment=segment, problem=problem))
    return tuple(turns)


def as_reference(turns: Sequence[FoundTurn], count: int, segments: Sequence[Segment]) -> KnownTurns | None:
    """Known angles of ``count`` segments as a reference; None if no angle is known."""
    used = [turn for turn in turns if turn.problem is None]
    if not used:
        return None
    rows = {segment.number: row for row, segment in enumerate(segments)}
    angle, sigma, axis = np.full(count, np.nan), np.full(count, np.nan), np.tile([1.0, 0.0, 0.0], (count, 1))
    for turn in used:
        assert turn.segment is not None
        if (row := rows.get(turn.segment.number)) is None:  # of the turns that are looked at it is none
            continue
        angle[row], sigma[row], axis[row] = turn.known.angle_rad, turn.known.sigma_rad, turn.axis
    return KnownTurns(angle, sigma, axis)


def tilt_excess(batch: Batch, floor: Floor, start: LinearModel, at_rest: StillRates | None) -> float:
    """Factor, 1 or more, by which the tilt residuals exceed their floor, due to the hand, the data rate or the accelerometer.

    The model is fitted to the tilt alone, so that errors of the stops do not count.  1 if there are no more residuals than parameters.
    """
    angles = 2 * len(batch)
    if angles <= PARAMETERS:
        return 1.0
    tilt, sigma = replace(batch, turns=None), floor.sigma[:, :2]
    model = fit_least_squares(tilt, sigma, start, still_rates=at_rest).model
    missed = closure_angles(tilt, model) / sigma
    return max(1.0, float(np.sqrt(np.sum(missed**2) / (angles - PARAMETERS))))


def rates_at_rest(logs: Sequence[StillSet]) -> StillRates:
    """Mean rates of the stills as measurements of the bias; the Earth's rate, not yet known in direction, widens their sigma.

    A single turn about one axis does not separate scale error from bias.
    """
    _, rate, sigma, _ = reference_stills(logs)
    return StillRates(rate, np.zeros_like(rate), np.hypot(sigma, EARTH_RATE_RPS))


# Turns with an impact: their extra uncertainty, estimated from their own closure residuals.
#
# An impact of j g makes a turn's end uncertain by s j, and every turn misses its floor by a common factor.  Both are estimated together
# with the calibration, from all turns (restricted likelihood): an effect that is not in it bends every turn, and the fewer of them
# are calm, the more it would pass for what the impacts did.  s is the median of its posterior under a flat prior if that is significantly
# better than none and than of the same impacts in other turns, else 0.  Some sensors filter an impact without loss, others lose degrees
# (docs/real-recordings.md), so a constant would be wrong for both.

#: twice the logarithm of the likelihood by which s must be better than none: by chance once in a hundred (Self & Liang 1987: s cannot be
#: negative), as a weight that is wrong throws turns away, and one that is missed costs little
CONFIRMED = 5.41
#: share of the shuffles of the impacts among the turns that may do as well, their number, and the step of the grid that is tried for them
BY_CHANCE, SHUFFLES, COARSE = 0.05, 99, 10
#: grid of s over that factor, rad per g: from a thousandth of a degree to ten degrees
GRID = np.concatenate([[0.0], np.geomspace(1e-3, 10.0, 120)]) * DEG


def widened_by_impacts(
    segments: Sequence[Segment], impacts: Sequence[Sequence[Impact]], batch: residual.Batch, floor: Floor, start: LinearModel
) -> tuple[np.ndarray, list[Widening]]:
    """(S, 3, 3) rad^2 that impacts, given by log, add to the ends of S segments, and the widened segments; the fit starts at a model."""
    inside = [[each for each in impacts[s.log] if s.start <= each.row < s.stop - 1] for s in segments]
    jump_g = np.array([np.sqrt(sum(each.jump_g**2 for each in own)) for own in inside])
    hit = jump_g > 0
    more = np.zeros((len(batch), 3, 3))
    if not hit.any():
        return more, []
    per_g = _per_g(jump_g, batch, floor, start)
    if not per_g:
        return more, []
    more[hit] = np.square(per_g * jump_g[hit])[:, None, None] * np.eye(3)
    widenings = [
        Widening(segment.number, "impact", float(np.sqrt(2) * per_g * jump), _words(own))
        for segment, jump, own in zip(segments, jump_g, inside, strict=True)
        if jump > 0
    ]
    return more, widenings


def _per_g(jump_g: np.ndarray, batch: residual.Batch, floor: Floor, start: LinearModel) -> float:
    """Estimate s, rad per g and angle."""
    rate = fit_least_squares(batch, floor.sigma, start).model(batch.rate)
    angles = residual.error_angles(residual.segment_residuals(batch, rate))[:, :2]
    design = linear.columns(residual.sensitivity(batch, rate), batch.rate)[:, :2] * linear.PRIOR_SIGMA

    def at(grid: np.ndarray, jump_g: np.ndarray) -> np.ndarray:
        white = floor.sigma[:, :2] ** 2
        return np.array([restricted(angles, design, white + np.square(s * jump_g)[:, None]) for s in grid]).T

    likelihood, excess = at(GRID, jump_g)
    if 2 * (likelihood.max() - likelihood[0]) < CONFIRMED:
        return 0.0
    # An effect that some turns have more of makes tails, which a likelihood of normal errors takes for impacts: do other turns do as well?
    rng, some = np.random.default_rng(0), GRID[::COARSE]
    others = [at(some, rng.permutation(jump_g))[0].max() for _ in range(SHUFFLES)]
    if np.mean(np.array(others) >= likelihood[::COARSE].max()) > BY_CHANCE:
        return 0.0
    weight = np.exp(likelihood - likelihood.max()) * np.gradient(GRID)
    return float(np.interp(0.5, np.cumsum(weight) / weight.sum(), GRID * np.sqrt(excess)))


def restricted(angles: np.ndarray, design: np.ndarray, variance: np.ndarray) -> tuple[float, float]:
    """Restricted log-likelihood of angles (S, 2) whose calibration, with columns (S, 2, P) in units of its priors, is estimated with them,
    and the factor, at least 1, on their variance (S, 2) rad^2 that is the most likely."""
    root = np.sqrt(variance)
    J, r = (design / root[..., None]).reshape(angles.size, -1), (angles / root).ravel()
    seen, pull = J.T @ J, J.T @ r
    normal = seen + np.eye(len(seen))
    freedom = len(r) - float(np.trace(np.linalg.solve(normal, seen)))
    square = float(r @ r - pull @ np.linalg.solve(normal, pull))
    excess = max(1.0, square / freedom)
    return -(freedom * np.log(excess) + square / excess + np.sum(np.log(variance)) + np.linalg.slogdet(normal)[1]) / 2, excess


def _words(impacts: list[Impact]) -> str:
    if not impacts:
        return ""
    worst = max(impacts, key=lambda each: each.jump_g)
    count = f"{len(impacts)} impacts, the hardest" if len(impacts) > 1 else "an impact"
    return f"{count} of {worst.jump_g:.1f} g from one reading to the next at {worst.at_s:.2f} s"


# The bias of each turn from the adjoining stills, instead of from the ends of all turns.
#
# A body at rest turns with the Earth, so the rest of its measured rate is the bias: b = m - E^-1 R_bt w_earth, in measured units.  The bias
# is interpolated linearly between the middles of the stills before and after a turn.


def rest_biases(problem: Problem) -> np.ndarray:
    """(Q, 3) rad/s, in measured units: the bias of each reference still.

    E is that of the first linear fit; its error of a percent scales only the Earth's rate.
    """
    rates = problem.still_rates
    return rates.rate - np.linalg.solve(problem.first.E, rates.earth.T).T


def bias_shares(problem: Problem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices (S,) of the reference stills before and after each used segment, and the weight (S, T) of the latter at each sample."""
    rates = problem.still_rates
    assert rates.middle_s is not None
    number = {id(still): q for q, still in enumerate(references(problem.stills))}
    first = np.array([number[id(segment.first)] for segment in problem.used])
    last = np.array([number[id(segment.last)] for segment in problem.used])
    began = problem.began_s
    start = np.array([began[segment.log] + segment.start_s for segment in problem.used])
    at_s = start[:, None] + running_sum(problem.batch.dt, axis=1)
    before, after = rates.middle_s[first][:, None], rates.middle_s[last][:, None]
    return first, last, np.clip((at_s - before) / (after - before), 0.0, 1.0)


def bias_apart(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean bias (3,) rad/s, as measured, and the deviation from it at each sample of each used turn (S, T, 3), by its stills."""
    bias = rest_biases(problem)
    mean = bias.mean(axis=0)
    first, last, share = bias_shares(problem)
    return mean, bias[first][:, None] * (1 - share[..., None]) + bias[last][:, None] * share[..., None] - mean


def with_still_bias(problem: Problem) -> Problem:
    """Fix the bias of every turn from its stills: ``rest_rps`` is the session's mean bias, and only E is left to fit.

    The difference of a turn's bias from the mean is subtracted like the Earth's rate, so the input of the model does not change.
    Raises FitError where the turns do not lie between stills (a further reference).
    """
    if problem.session.reference is not None or not len(problem.still_rates.rate):
        raise FitError("the turns of this session do not lie between stills, so these show no bias of theirs; fit without --bias stills")
    mean, apart = bias_apart(problem)
    batch = replace(problem.batch, earth=problem.batch.earth + apart @ problem.first.E.T)
    return replace(problem, batch=batch, rest_rps=mean, folds=tuple(map(with_still_bias, problem.folds)))


# From a session to the problem that every method solves, with the same segments, references, Earth and floor.

DIAL_LIMIT_RAD = 1.0 * DEG
#: sigma of a segment before its floor is known
FIRST_SIGMA_RAD = 1e-3
#: variance factor of the prior in the first fit, which only carries the yaw: three times the sigma
FIRST_WIDER = 9.0
#: runs of turns that stand for a longer session: a quarter of them at its first turn, a quarter at its last
RUNS = 4


def build_problem(
    session: Session,
    *,
    use_earth: bool = True,
    exclude: tuple[int, ...] = (),
    moving: tuple[int, ...] = (),
    clipped: tuple[int, ...] = (),
    found: SessionStills | None = None,
    near: LinearModel | None = None,
    prior: PriorOf | None = None,
    most: int | None = None,
    progress: Reporter = no_report,
) -> Problem:
    """Find stills, cut segments, carry the attitude through each log, and compute the Earth's rate and the floor.

    exclude: numbers of segments to leave out; moving: numbers of stills, over all logs, that are known not to be at rest; clipped: numbers
    of segments with wrong rates, through which no attitude is carried; found: the session's stills, if already detected; near: a model
    near the gyroscope's, at which the first fit starts; prior: of the unit, used here if its turns are too few for a fit without one;
    most: turns that are used of a longer session (``spread``).
    Raises SegmentError (no stills, nothing accepted, too few) and DataError.
    """
    found = found or SessionStills(session)
    if session.reference is not None:
        return session.reference.problem(session, found, use_earth=use_earth, exclude=exclude, progress=progress)
    session, logs, segments = _stills_and_segments(session, found, exclude, moving, clipped, progress)
    turns = known_turns_of(session, found, segments)
    stills = [still for log in logs for still in log.stills]
    too_few = why_too_few(stills, segments, turns, session.config.protocol.still_s)
    if too_few and (prior is None or not any(segment.accepted for segment in segments)):
        raise SegmentError(f"{session.folder}: {too_few}")
    every, segments = segments, spread(segments, most)
    if len(segments) < len(every):
        logs, every = _without_others(logs, every, segments)
    chain = replace(_batch(session, logs, segments), turns=as_reference(turns, len(segments), segments))
    used = np.array([segment.accepted for segment in segments])
    sigma = np.hypot(FIRST_SIGMA_RAD, bridged_sigma([s for s in segments if s.accepted], [log.bridges for log in logs]))
    start = bias_only(reference_stills(logs).rate[0])
    few = np.count_nonzero(used) < FEWEST_SEGMENTS
    beforehand = None if prior is None or not few else prior(start.vector).scaled(FIRST_WIDER)
    at_rest = rates_at_rest(logs) if chain.turns is not None else None
    # Two passes: yaw and Earth need a calibration, and the calibration improves with the Earth.
    for _ in range(2):
        batch = chain.pick(used).trimmed()
        with naming_segments([segment for segment in segments if segment.accepted]):
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
    stamps = [stamp_errors(log.samples, session.config.protocol.segment_s) for log in logs]
    floor = closure_floor(
        batch,
        at,
        [segment.stills for segment in accepted],
        [logs[segment.log].noise for segment in accepted],
        session.config.protocol.dial_sigma_deg * DEG,
        [stamps[segment.log] for segment in accepted],
    )
    more, widened = widened_by_bridges(accepted, [log.bridges for log in logs], at)
    about = directions(batch, at[:, -1])
    floor = floor.widened(about @ more @ about.transpose(0, 2, 1)) if widened else floor
    more, hit = widened_by_impacts(accepted, [find_impacts(log.samples) for log in logs], batch, floor, fit.model)
    if hit:  # and a first fit that impacts do not bias
        floor, widened = floor.widened(about @ more @ about.transpose(0, 2, 1)), widened + hit
        sigma = np.hypot(FIRST_SIGMA_RAD, np.sqrt(np.trace(floor.own[:, :2, :2], axis1=1, axis2=2)))
        fit = fit_least_squares(batch, sigma, fit.model, still_rates=at_rest, prior=beforehand)
    _require_axes(session, fit.model)
    if batch.turns is not None:
        floor = replace(floor, tilt_excess=tilt_excess(batch, floor, fit.model, at_rest))
    rates = still_rates(logs, earths)
    return Problem(session, every, batch, floor, earths, logs, fit.model, rates, found, known_turns=turns, widened=tuple(widened))


def _stills_and_segments(
    session: Session,
    found: SessionStills,
    exclude: Collection[int],
    moving: Collection[int],
    clipped: Collection[int],
    progress: Reporter,
) -> tuple[Session, list[StillSet], list[Segment]]:
    session, parts, _ = without_wrong_dials(session, session_segments(session, found, moving, progress))
    logs = [
        StillSet.of(part.found.samples, part.stills, part.found.noise, part.log.bridges) for part in parts if part.found.noise is not None
    ]
    segments = [segment for part in parts for segment in part.segments]
    segments = [replace(s, problem=CLIPPED, breaks_yaw=True) if s.number in clipped else s for s in segments]
    excluded = [replace(s, problem=LEFT_OUT) if s.number in exclude else s for s in segments]
    if session.config.protocol.reference == "table":
        excluded = [_with_dials(session, logs, segment) for segment in excluded]
        _require_agreement(session, logs)
    unknown = sorted(set(exclude) - {segment.number for segment in segments})
    if unknown and segments:
        raise SegmentError(f"{session.folder}: no segment {unknown[0]} to leave out; there are 0 to {len(segments) - 1}")
    return session, logs, excluded


def spread(segments: list[Segment], most: int | None) -> list[Segment]:
    """Of a session with more than ``most`` turns that can be used, so many of these, in ``RUNS`` runs from its first to its last.

    Neighbours, since a run of attitudes that follow each other separates the Earth's rate from the bias, and turns far apart do not.
    """
    used = [segment for segment in segments if segment.accepted]
    if most is None or len(used) <= most:
        return segments
    begins = np.linspace(0, len(used) - most // RUNS, RUNS).round().astype(int)
    return [used[row] for begin in begins for row in range(begin, begin + most // RUNS)]


def _without_others(logs: list[StillSet], segments: list[Segment], taken: list[Segment]) -> tuple[list[StillSet], list[Segment]]:
    """Logs and segments in which turns that were not taken, and stills at the end of none that were, have a problem."""
    numbers, ends = {segment.number for segment in taken}, {id(still) for segment in taken for still in segment.stills}
    logs = [
        replace(log, stills=[still if id(still) in ends else replace(still, problem=still.problem or NOT_TAKEN) for still in log.stills])
        for log in logs
    ]
    return logs, [s if s.number in numbers else replace(s, problem=s.problem or NOT_TAKEN) for s in segments]


def _require_axes(session: Session, model: LinearModel) -> None:
    """Require that no axis turns against itself: a least-squares fit takes any sign for a very large misalignment."""
    axis = int(np.argmin(np.diag(model.E)))
    if model.E[axis, axis] <= 0:
        name = "xyz"[axis]
        raise FitError(
            f"{session.folder}: the turns require rates of {name} times {model.E[axis, axis]:.3f}, expected about 1: "
            f"gyro {name} has the wrong sign, or axes are exchanged; correct the columns "
            f"(`{command_line('check', session.folder)}` tries every order)"
        )


def _require_agreement(session: Session, logs: list[StillSet]) -> None:
    """Require that dials and gravity agree on the tilt."""
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
    """Reject a segment without dial readings at its ends if reference = "table"."""
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


def _batch(session: Session, logs: list[StillSet], segments: list[Segment]) -> Batch:
    """Batch of all segments, accepted or not, with reference attitudes; unknown yaw is 0, and the Earth's rate is not yet set."""
    dials = session.config.protocol.reference == "table"
    ends = np.stack([rotation.from_gravity(np.array([segment.stills[end].accel_mean for segment in segments])) for end in (0, 1)])
    for i, segment in enumerate(segments):
        for end, still in zip(ends, segment.stills, strict=True):
            if dials and (reading := _dial(session, logs, segment.log, still)) is not None:
                # Gravity gives the tilt to a hundredth of a degree, a dial to a twentieth: tilt from gravity, yaw from the dial.
                end[i] = rotation.nearest_yaw(rotation.from_euler(*reading), end[i])
    return batch_between(logs, segments, ends[0], ends[1], dials)


def batch_between(logs: list[StillSet], segments: list[Segment], start: np.ndarray, end: np.ndarray, yaw_known: bool) -> Batch:
    """Batch of segments between attitudes start and end (S, 4); the Earth's rate is not yet set."""
    longest = max(segment.stop - segment.start for segment in segments)
    rate = np.moveaxis(np.zeros((3, len(segments), longest)), 0, -1)  # each component contiguous in memory: faster to compute with
    dt = np.zeros((len(segments), longest - 1))
    for i, segment in enumerate(segments):
        samples = logs[segment.log].samples
        count = segment.stop - segment.start
        rate[i, :count] = samples.gyro[segment.start : segment.stop]
        rate[i, count:] = rate[i, count - 1]
        dt[i, : count - 1] = np.diff(samples.t_ns[segment.start : segment.stop]) * NS
    return Batch(rate, dt, np.zeros_like(rate), start, end, yaw_known)


def _earths(session: Session, logs: list[StillSet], model: LinearModel) -> dict[int, EarthRate]:
    """The Earth's rate in the frame of each yaw group."""
    site = session.config.site
    q_tb, rate, sigma, group = reference_stills(logs)
    groups = np.unique(group).tolist()
    if site.latitude_deg is None:
        return {g: no_earth() for g in groups}
    found = {}
    for g in groups:
        mine = group == g
        found[g] = vertical_only(site.latitude_deg)
        if mine.sum() > 2:
            found[g] = estimate_heading(site.latitude_deg, q_tb[mine], model(rate[mine]), sigma[mine])
    if site.heading_deg is not None:
        # By protocol the first still is at the table's index.  This heading holds unless the stills contradict it.
        given = with_heading(site.latitude_deg, site.heading_deg)
        if not contradicts(found[0], given):
            found[0] = given
    return found


class ReferenceStills(NamedTuple):
    """All stills that are references: attitudes q_tb (Q, 4), mean rates and their sigmas (Q, 3) rad/s, and yaw groups (Q,)."""

    q_tb: np.ndarray
    rate: np.ndarray
    sigma: np.ndarray
    group: np.ndarray


def reference_stills(logs: Sequence[StillSet]) -> ReferenceStills:
    """Collect the stills that are references."""
    kept = [log.references for log in logs]
    q_tb, group = np.concatenate([log.q_tb for log in kept]), np.concatenate([log.group for log in kept])
    rows = [(still.gyro_mean, log.noise.angle_random_walk / np.sqrt(still.duration_s)) for log in kept for still in log.stills]
    rate, sigma = np.array(rows).reshape(-1, 2, 3).transpose(1, 0, 2)
    return ReferenceStills(q_tb, rate, sigma, group)


def still_rates(logs: list[StillSet], earths: dict[int, EarthRate]) -> StillRates:
    """Mean rates of the stills that are references, and the Earth's there.  Raises DataError for a gyro that shows no noise."""
    q_tb, rate, sigma, group = reference_stills(logs)
    if not (sigma > 0).all():
        raise DataError("the gyro shows no noise at all in the stills; is the log made of registers, not of smoothed values?")
    middle_s, _ = times_of([references(log.stills) for log in logs], [log.samples for log in logs])
    return StillRates(rate, earths_in_body(earths, group, q_tb), sigma, q_tb, middle_s)
