"""What the registers and the stills themselves tell, proposed by detectors and decided by the closure of the segments concerned."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from session.common.errors import CalibrationError
from session.common.units import DEG
from session.detect import interpolation
from session.detect.segments import Segment
from session.detect.session_stills import SessionStills
from session.log.folder import Session
from tinygc.closure.residual import closure_angles
from tinygc.effects import Effect
from tinygc.explanation.mends import lost_samples
from tinygc.explanation.mends.clipping import FEWEST_WHOLE, Clipping, find_clipping
from tinygc.explanation.mends.common_count import common_count
from tinygc.explanation.mends.creeping import about_the_vertical, chance_of_creep
from tinygc.explanation.mends.events import FALSE, LOST, Event, bridged, proposed
from tinygc.explanation.mends.left_open import left_open
from tinygc.explanation.mends.trial import Trial, Verdict
from tinygc.explanation.naming.candidates import candidates
from tinygc.explanation.naming.evidence import Evidence, Hypothesis
from tinygc.explanation.naming.search import search
from tinygc.explanation.twin.twin import Twin
from tinygc.problem.build import build_problem
from tinygc.problem.problem import Problem
from tinygc.problem.rejections import CLIPPED, LEFT_OUT

#: found by a detector, which gives the chance of its bar and no smaller one
FROM_THE_BAR = frozenset({"gyro.saturation", "reference.not_still"})


@dataclass(frozen=True, eq=False)
class Mended:
    """What was mended.

    problem: what is left to explain; found: effect id -> parameters for the JSON, with their std, in people's units; p_value: effect
    id -> upper bound of the chance that noise alone does it in this recording; misfit: chi-square of the closure before, 0 where nothing
    was mended; reference: effects that the segments without any event ask for;
    verdicts: on what was proposed, borne out or not; clipping likewise."""

    problem: Problem
    found: dict[str, tuple[dict, dict]]
    p_value: dict[str, float]
    misfit: float = 0.0
    reference: tuple[Effect, ...] = ()
    verdicts: list[Verdict] = field(default_factory=list)
    clipping: Clipping | None = None


@dataclass(frozen=True)
class Gap:
    """Where samples were put back: log, row of the first, and the rotation (rad per axis) that nobody can know."""

    log: int
    row: int
    missed_rad: float


def mend(problem: Problem, progress: Callable[[str], None] = lambda what: None) -> Mended:
    """Clipping, then false readings and losses, then creeping stills: each is proposed, tried, and mended where it is borne out."""
    found: dict[str, tuple[dict, dict]] = {}
    chances: dict[str, float] = {}
    original = problem
    progress("registers")
    clipping = find_clipping(problem)
    if clipping is not None and clipping.borne_out:
        found["gyro.saturation"] = ({"dps": clipping.level / DEG}, {"dps": clipping.known_to / DEG})
        chances["gyro.saturation"] = clipping.chance
        with suppress(CalibrationError):  # too few are left: they stay, and are known to be clipped
            problem = _again(problem, problem.session, clipped=tuple(clipping.numbers))
    verdicts, reference = _tried(problem, clipping, progress)
    problem, gaps = _with_accepted(problem, verdicts, found, chances)
    progress("stills")
    problem = _with_gaps(_without_creeping(problem, found, chances), gaps)
    return Mended(problem, found, chances, _misfit(original) if found else 0.0, reference, verdicts, clipping)


def _tried(problem: Problem, clipping: Clipping | None, progress: Callable[[str], None]) -> tuple[list[Verdict], tuple[Effect, ...]]:
    """Verdicts on false readings and losses, in this order; of events in turns that are clipped nothing can be said; and
    the effects of the physics that judged them."""
    clipped = [] if clipping is None else [s for s in problem.segments if s.number in clipping.numbers]
    events = [e for e in proposed(problem.session) if not any(s.log == e.log and s.start <= e.row < s.stop for s in clipped)]
    if not events:
        return [], ()
    progress("events on trial")
    false, lost = ([e for e in events if e.id == name] for name in (FALSE, LOST))
    quiet = _again(problem, bridged(problem.session, false)) if false else problem
    reference = _reference(problem, quiet, false, lost)
    trial = Trial(problem, reference, quiet)
    verdicts = [trial.judge(FALSE, false, [])] if false else []
    if lost:
        verdicts.append(trial.judge(LOST, lost, [e for v in verdicts for e in v.accepted]))
    return verdicts, reference.effects


def _reference(problem: Problem, quiet: Problem, false: list[Event], lost: list[Event]) -> Hypothesis:
    """The physics by which events are judged: of the segments that close, with or without any.  Where those are few, or do not close as a
    sensor's do, also of all, as they are and with everything mended; whichever has the greater evidence for each of its values."""
    inside = {e: [s.number for s in problem.used if s.log == e.log and s.start <= e.row < s.stop] for e in (*false, *lost)}
    touched = {number for numbers in inside.values() for number in numbers}
    in_rests = [e for e in false if not inside[e]]
    tried = []
    with suppress(CalibrationError):  # what is left does not hold together
        is_open = left_open(problem, np.array([s.number in touched for s in problem.used]))
        if (~is_open).sum() >= FEWEST_WHOLE:
            open_ones = tuple(s.number for s, each in zip(problem.used, is_open, strict=True) if each)
            tried.append(_searched(_again(problem, bridged(problem.session, in_rests), left_out=open_ones)))
    if not tried or tried[0].noise.unusual:
        session, count = quiet.session, common_count(quiet, lost) if lost else 0
        if count:
            session, _ = _with_lost(session, lost, count)
        tried += [_searched(problem), _searched(_again(problem, session))]
    return min(tried, key=lambda h: h.score / max(len(h.fit.r), 1))


def _searched(problem: Problem) -> Hypothesis:
    evidence = Evidence(Twin(problem))
    return search(evidence, candidates(evidence.twin), evidence.nothing)


def _with_accepted(problem: Problem, verdicts: list[Verdict], found: dict, chances: dict) -> tuple[Problem, list[Gap]]:
    """The problem with what was borne out mended, and where samples were put back."""
    false, lost = ([e for v in verdicts if v.id == name for e in v.accepted] for name in (FALSE, LOST))
    if not false and not lost:
        return problem, []
    if false:
        at = [sum(len(log.samples) for log in problem.session.logs[: e.log]) + e.row for e in false]  # counted over all logs
        found[FALSE] = ({"at": at, "samples": int(np.median([e.samples for e in false]))}, {})  # counted, not measured: no std
    gaps: list[Gap] = []
    session = bridged(problem.session, false)
    if lost:
        (length,) = (v.length for v in verdicts if v.id == LOST)
        began, times = 0.0, []
        for number, log in enumerate(problem.session.logs):
            rows = [e.row for e in lost if e.log == number]
            times += [began + float(log.samples.t_s[row]) + i * length * log.samples.period_s for i, row in enumerate(rows)]
            began += log.samples.duration_s + len(rows) * length * log.samples.period_s  # with what was put back
        found[LOST] = ({"at_s": [round(time, 3) for time in times], "length": length}, {"length": 0.5})  # whole samples: half a step
        session, gaps = _with_lost(session, lost, length)
    for v in verdicts:
        if v.accepted:
            chances[v.id] = min(1.0, len(v.events) * float(chi2.sf(max(2 * v.log_ratio, 0.0), len(v.accepted))))
    return _again(problem, session), gaps


def _with_lost(session: Session, lost: list[Event], length: int) -> tuple[Session, list[Gap]]:
    """The session with ``length`` samples put back after each of the events."""
    logs, gaps = [], []
    for number, log in enumerate(session.logs):
        rows = np.array([e.row for e in lost if e.log == number], dtype=int)
        if len(rows):
            orders, missed_rad = zip(*(interpolation.best_order(log.samples, np.array([row]), length) for row in rows), strict=True)
            gaps += [Gap(number, int(row) + 1 + i * length, missed) for i, (row, missed) in enumerate(zip(rows, missed_rad, strict=True))]
            moved = tuple(replace(each, row=each.row + length * int(np.sum(rows < each.row))) for each in log.bridges)
            log = replace(log, samples=lost_samples.with_lost(log.samples, rows, length, np.array(orders)), bridges=moved)
        logs.append(log)
    return replace(session, logs=tuple(logs)), gaps


def _misfit(problem: Problem) -> float:
    """Chi-square of the closure."""
    return float(np.sum((closure_angles(problem.batch, problem.first) / problem.floor.sigma) ** 2))


def _again(
    problem: Problem, session: Session, *, clipped: tuple[int, ...] = (), moving: tuple[int, ...] = (), left_out: tuple[int, ...] = ()
) -> Problem:
    """The problem of a mended session, or with clipped segments or moving stills, without what was left out before."""
    out = {why: [segment for segment in problem.segments if segment.problem == why] for why in (LEFT_OUT, CLIPPED)}
    found = SessionStills(session, problem.found)
    if moving:  # a still less joins two turns, and shifts the numbers behind it
        segments = build_problem(session, use_earth=False, moving=moving, found=found).segments
        out = {why: [new for new in segments if any(_inside(old, new) for old in gone)] for why, gone in out.items()}
    asked, at_level = (tuple(segment.number for segment in out[why]) for why in (LEFT_OUT, CLIPPED))
    use_earth = problem.earth.source != "none"
    return build_problem(session, use_earth=use_earth, exclude=asked + left_out, clipped=clipped + at_level, moving=moving, found=found)


def _inside(old: Segment, new: Segment) -> bool:
    return old.log == new.log and new.start <= (old.start + old.stop) // 2 < new.stop


def _with_gaps(problem: Problem, gaps: list[Gap]) -> Problem:
    """The floor of each segment, wider by what its gaps may hide."""
    if not gaps:
        return problem
    added = [sum(gap.missed_rad**2 for gap in gaps if gap.log == s.log and s.start <= gap.row < s.stop) for s in problem.used]
    own = problem.floor.own + np.array(added)[:, None, None] * np.eye(problem.batch.angles)
    return replace(problem, floor=replace(problem.floor, own=own))


def _without_creeping(problem: Problem, found: dict, chances: dict) -> Problem:
    """Stills in which gravity moves were found by the detector; those that turn about the vertical stand out by their rate."""
    numbers = [i for i, still in enumerate(problem.stills) if still.problem is not None]
    if not numbers:
        return problem
    turning = about_the_vertical(problem)
    found["reference.not_still"] = ({"stills": sorted(numbers + turning)}, {})
    chances["reference.not_still"] = chance_of_creep(problem)
    return _again(problem, problem.session, moving=tuple(turning)) if turning else problem
