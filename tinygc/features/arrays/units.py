"""Units of an array, each prepared as a session on the array's clock, and their common stills."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.base.errors import CalibrationError, FitError
from session.base.progress import Reporter, no_report
from session.base.units import NS
from session.detect.segments import moments_of
from session.detect.stills import Still
from session.log.folder import Session
from session.log.logfile import Log
from tinygc.closure.prepared import AUTO, Prepared, prepare
from tinygc.closure.problem import Problem
from tinygc.features.arrays.clocks import UnitClock, UnitPlace
from tinygc.features.arrays.extrinsics import best_overlap
from tinygc.features.arrays.recording import ArraySession

# Units of an array, each prepared like a session of its own, but on the array's clock.

#: fewest units: with less there is no reference
FEWEST_UNITS = 2


@dataclass(frozen=True, eq=False)
class ArrayUnit:
    """One prepared unit: number; session as recorded; place, if known beforehand; prepared: on the array's clock, by itself."""

    number: int
    session: Session
    place: UnitPlace
    prepared: Prepared

    @property
    def problem(self) -> Problem:
        """Return this unit's own problem."""
        return self.prepared.problem


def on_array_clock(session: Session, clock: UnitClock) -> Session:
    """Return the session with its stamps converted to the array's clock."""
    if clock.offset_s == 0 and clock.rate == 0:
        return session

    def moved(log: Log) -> Log:
        samples = log.samples
        t_ns = samples.t_ns - samples.t_ns[0]  # whole nanoseconds, for any epoch of the stamps
        begins_s = float(samples.t_ns[0]) * NS
        first_ns = round(float(clock.array_time(np.array([begins_s]))[0]) / NS)
        stretched = first_ns + np.rint(t_ns * (1 + clock.rate)).astype(np.int64)
        return replace(log, samples=replace(samples, t_ns=stretched))

    # what a person named is on the log's clock as well
    return replace(session.with_logs(moved), config=session.config.on_time(lambda at_s: float(clock.array_time(np.array([at_s]))[0])))


def prepare_units(
    array: ArraySession,
    places: tuple[UnitPlace, ...],
    *,
    use_earth: bool = True,
    accelerometer: str = AUTO,
    progress: Reporter = no_report,
) -> tuple[list[ArrayUnit], dict[int, str]]:
    """Prepare each unit's problem; of those without one the reason, by number.

    places: of each unit, in the array's order.  Raises FitError where fewer than two units can be used, or the first cannot, whose body
    frame and clock are the array's.
    """
    found: list[ArrayUnit] = []
    left: dict[int, str] = {}
    for number, session, place in zip(array.numbers, array.units, places, strict=True):
        progress(f"unit {number}")
        try:
            prepared = prepare(on_array_clock(session, place.clock), use_earth=use_earth, accelerometer=accelerometer)
        except CalibrationError as error:
            left[number] = str(error)
            continue
        found.append(ArrayUnit(number, session, place, prepared))
    if (first := array.numbers[0]) in left:
        raise FitError(f"{array.name}: unit {first}, whose axes and clock are the array's, cannot be used: {left[first]}")
    if len(found) < FEWEST_UNITS:
        number, why = next(iter(left.items()))
        raise FitError(f"{array.name}: {len(found)} of {len(array)} units can be used; unit {number}: {why}")
    return found, left


# Common stills and turns of the units: those that overlap on the array's clock.


@dataclass(frozen=True, eq=False)
class SameStills:
    """Stills of the array: those of the unit with the most used turns, ``anchor`` among the units.

    time_s (Q, 2): when each begins and ends; log (Q,); group (Q,): yaw is continuous from still to still within one.  Of each unit: stills,
    its own still for each of these or None; turns: rows of its problem's batch; first, last: the array's stills at their ends.
    """

    anchor: int
    time_s: np.ndarray
    log: np.ndarray
    group: np.ndarray
    stills: tuple[tuple[Still | None, ...], ...]
    turns: tuple[np.ndarray, ...]
    first: tuple[np.ndarray, ...]
    last: tuple[np.ndarray, ...]

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def spans(self) -> np.ndarray:
        """Return (S, 2): stills at the ends of each turn that any unit has, in order."""
        pairs = {(int(a), int(b)) for first, last in zip(self.first, self.last, strict=True) for a, b in zip(first, last, strict=True)}
        return np.array(sorted(pairs), dtype=int).reshape(-1, 2)


def same_stills(units: list[ArrayUnit]) -> SameStills:
    """Match the units' stills.  Raises FitError where a unit has no turn in common with the others."""
    anchor = int(np.argmax([len(unit.problem.used) for unit in units]))
    log, time_s, _, group = _references(units[anchor].problem)
    left_out = [moment for unit in units for moment in _left_out(unit.problem)]
    stills, turns, first, last = [], [], [], []
    for unit in units:
        own_log, own_s, own, _ = _references(unit.problem)
        match = {id(still): best_overlap(where, span, log, time_s) for still, where, span in zip(own, own_log, own_s, strict=True)}
        mine: list[Still | None] = [None] * len(time_s)
        for still in own:
            if (q := match[id(still)]) >= 0:
                mine[q] = still
        ends = [tuple(match.get(id(still), -1) for still in segment.stills) for segment in unit.problem.used]
        rows = [
            row
            for row, (a, b) in enumerate(ends)
            if 0 <= a < b and not any(number == log[a] and time_s[a, 1] <= at_s <= time_s[b, 0] for number, at_s in left_out)
        ]
        if not rows:
            raise FitError(f"unit {unit.number}: none of its {len(ends)} turns lies between stills of the others; are they of one time?")
        stills.append(tuple(mine))
        turns.append(np.array(rows))
        first.append(np.array([ends[row][0] for row in rows]))
        last.append(np.array([ends[row][1] for row in rows]))
    return SameStills(anchor, time_s, log, group, tuple(stills), tuple(turns), tuple(first), tuple(last))


def _references(problem: Problem) -> tuple[np.ndarray, np.ndarray, list[Still], np.ndarray]:
    """Return for each reference still: its log, its span in s of the array's clock, itself, and its yaw group."""
    logs, stills = zip(*problem.references, strict=True)
    starts = [problem.logs[log].samples.t_ns[0] * NS + still.start_s for log, still in problem.references]
    spans = [(start, start + still.duration_s) for start, still in zip(starts, stills, strict=True)]
    return np.array(logs), np.array(spans), list(stills), np.concatenate([log.references.group for log in problem.logs])


def _left_out(problem: Problem) -> list[tuple[int, float]]:
    """Return log and s of the array's clock of turns that session.toml leaves out: for one unit, hence for all."""
    logs = [log for log in problem.session.logs if problem.found.of(log).noise is not None]
    return [(number, at_s) for number, log in enumerate(logs) for at_s in moments_of(log.path, problem.session.config.exclude)]
