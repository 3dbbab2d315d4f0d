"""Which stills and turns of the units are the same: those that share their time on the array's clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.errors import FitError
from session.common.units import NS
from session.detect.excluded import moments_of
from session.detect.stills import Still
from tinygc.array.joint.units import ArrayUnit
from tinygc.problem.problem import Problem

#: of the shorter of two stills: those that share less are not the same
LEAST_SHARED = 0.5


@dataclass(frozen=True, eq=False)
class SameStills:
    """The array's stills are those of the unit with the most used turns, ``anchor`` among the units.

    time_s (Q, 2): when each begins and ends; log (Q,); group (Q,): yaw goes on from still to still within one.  Of each unit: stills, its
    own still for each of these or None; turns: rows of its problem's batch; first, last: the array's stills at their ends.
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
        """(S, 2): stills at the ends of each turn that any unit has, in order."""
        pairs = {(int(a), int(b)) for first, last in zip(self.first, self.last, strict=True) for a, b in zip(first, last, strict=True)}
        return np.array(sorted(pairs), dtype=int).reshape(-1, 2)


def same_stills(units: list[ArrayUnit]) -> SameStills:
    """Raises FitError where a unit has no turn in common with the others."""
    anchor = int(np.argmax([len(unit.problem.used) for unit in units]))
    log, time_s, theirs, group = _references(units[anchor].problem)
    del theirs
    left_out = [moment for unit in units for moment in _left_out(unit.problem)]
    stills, turns, firsts, lasts = [], [], [], []
    for unit in units:
        own_log, own_s, own, _ = _references(unit.problem)
        match = {id(still): _match(where, span, log, time_s) for still, where, span in zip(own, own_log, own_s, strict=True)}
        mine: list[Still | None] = [None] * len(time_s)
        for still in own:
            if (q := match[id(still)]) >= 0:
                mine[q] = still
        ends = [tuple(match.get(id(still), -1) for still in segment.stills) for segment in unit.problem.used]
        rows = [row for row, (a, b) in enumerate(ends) if 0 <= a < b and not _holds(time_s[a, 1], time_s[b, 0], log[a], left_out)]
        if not rows:
            raise FitError(f"unit {unit.number}: none of its {len(ends)} turns lies between stills of the others; are they of one time?")
        stills.append(tuple(mine))
        turns.append(np.array(rows))
        firsts.append(np.array([ends[row][0] for row in rows]))
        lasts.append(np.array([ends[row][1] for row in rows]))
    return SameStills(anchor, time_s, log, group, tuple(stills), tuple(turns), tuple(firsts), tuple(lasts))


def _references(problem: Problem) -> tuple[np.ndarray, np.ndarray, list[Still], np.ndarray]:
    """Of each still that is a reference: its log, its span in s of the array's clock, itself, and its yaw group."""
    rows = [
        (number, log.samples.t_ns[0] * NS + still.start_s, still, group)
        for number, log in enumerate(problem.logs)
        for still, group in zip(log.stills, log.group, strict=True)
        if still.problem is None
    ]
    logs, starts, stills, groups = (list(column) for column in zip(*rows, strict=True))
    spans = [(start, start + still.duration_s) for start, still in zip(starts, stills, strict=True)]
    return np.array(logs), np.array(spans), stills, np.array(groups)


def _left_out(problem: Problem) -> list[tuple[int, float]]:
    """Log and s of the array's clock of moments whose turns session.toml leaves out: of one unit, so of all."""
    logs = [log for log in problem.session.logs if problem.found.of(log).noise is not None]
    return [(number, at_s) for number, log in enumerate(logs) for at_s in moments_of(log.path, problem.session.config.exclude)]


def _holds(start_s: float, stop_s: float, log: int, moments: list[tuple[int, float]]) -> bool:
    return any(number == log and start_s <= at_s <= stop_s for number, at_s in moments)


def _match(log: int, span: np.ndarray, logs: np.ndarray, spans: np.ndarray) -> int:
    """The still that shares most of its time, or -1."""
    shared = np.minimum(spans[:, 1], span[1]) - np.maximum(spans[:, 0], span[0])
    least = LEAST_SHARED * np.minimum(spans[:, 1] - spans[:, 0], span[1] - span[0])
    shared = np.where((shared > least) & (logs == log), shared, -1.0)
    return int(np.argmax(shared)) if shared.max() > 0 else -1
