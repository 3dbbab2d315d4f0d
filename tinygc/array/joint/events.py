"""What stands beyond an array's usual errors: a reading of one unit that the others contradict, a turn that all miss alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tinygc.array.joint.rows import RowMap, UnitRows
from tinygc.array.joint.same_stills import SameStills
from tinygc.array.joint.system import Solution

#: family-wise, of all blocks of rows of an array
RARE_P = 0.01

OWN_TURN, OWN_STILL, COMMON_TURN, COMMON_STILL = "turn", "still", "common turn", "common still"


@dataclass(frozen=True, eq=False)
class ArrayEvent:
    """what: ``turn`` or ``still`` of one unit, ``common turn`` or ``common still`` of all; unit: its place among the units, None of all;
    rival: of two units, the other one where it contradicts as much, so that nobody knows which of them errs; first, last: the array's
    stills around it; size: rad or m/s^2; p_value: of one as large by chance, family-wise; rows of the system."""

    what: str
    unit: int | None
    first: int
    last: int
    size: float
    p_value: float
    rows: np.ndarray
    rival: int | None = None

    def together(self, events: Sequence[ArrayEvent]) -> tuple[ArrayEvent, ...]:
        """Of these, those of single units in the same turn or still: of more than one unit at once, none is a sensor's own reading."""
        return tuple(e for e in events if e.unit is not None and (e.what, e.first, e.last) == (self.what, self.first, self.last))


@dataclass(frozen=True, eq=False)
class Blocks:
    """Rows (B, d) that stand or fall together, by whose they are; spans (B, 2) stills."""

    what: str
    unit: int | None
    rows: np.ndarray
    spans: np.ndarray


def blocks_of(rows: list[UnitRows], same: SameStills, where: RowMap) -> list[Blocks]:
    """Of every unit's turns and stills, and of what is common."""
    found = []
    for i, unit in enumerate(rows):
        found.append(Blocks(OWN_TURN, i, where.closure[i], np.column_stack([unit.first, unit.last])))
    for i, unit in enumerate(rows):
        found.append(Blocks(OWN_STILL, i, where.force[i], np.column_stack([unit.stills, unit.stills])))
    q = np.arange(len(same))
    found.append(Blocks(COMMON_TURN, None, where.common, np.column_stack([q[:-1], q[1:]])))
    found.append(Blocks(COMMON_STILL, None, where.level, np.column_stack([q, q])))
    return found


def candidates(solution: Solution, blocks: list[Blocks]) -> list[ArrayEvent]:
    """Of each block its event, with the probability, of all blocks together, that chance makes one as large.

    A block's part in the estimate of its own component is taken off: F of what it misses by against what the others do.
    """
    from scipy.stats import f

    total = sum(len(part.rows) for part in blocks)
    found = []
    for part in blocks:
        chi, error = solution.blocks(part.rows)
        d = part.rows.shape[1]
        counted = ~solution.system.out[part.rows].any(axis=1)
        m = int(counted.sum())
        for b in range(len(chi)):
            others = m - counted[b]
            left = d * m - chi[b] if counted[b] else d * m
            ratio = (chi[b] / d) / (max(left, 0.05 * d) / (d * max(others, 1)))
            p = float(f.sf(min(ratio, chi[b] / d * 10), d, d * max(others, 1)))
            size = float(np.linalg.norm(error[b]))
            first, last = (int(q) for q in part.spans[b])
            found.append(ArrayEvent(part.what, part.unit, first, last, size, min(1.0, p * total), part.rows[b]))
    return found


def worst_of_each_turn(found: list[ArrayEvent], out: np.ndarray) -> list[ArrayEvent]:
    """New events, one of each turn or still: what one reading does shows a little in all that share its turn."""
    best: dict[tuple[bool, int], ArrayEvent] = {}
    for event in found:
        if event.p_value > RARE_P or out[event.rows].all():
            continue
        key = (event.first == event.last, event.first)
        if key not in best or event.p_value < best[key].p_value or (event.p_value == best[key].p_value and event.size > best[key].size):
            best[key] = event
    units = {event.unit for event in found if event.unit is not None}
    return [_with_rival(event, found) if len(units) == 2 else event for event in best.values()]


def _with_rival(event: ArrayEvent, found: list[ArrayEvent]) -> ArrayEvent:
    """Of an array of two: in yaw each is the only witness against the other."""
    same = [e for e in found if e.unit not in (None, event.unit) and (e.what, e.first, e.last) == (event.what, event.first, event.last)]
    rival = next((other.unit for other in same if other.p_value <= RARE_P), None)
    return replace(event, rival=rival) if event.unit is not None else event
