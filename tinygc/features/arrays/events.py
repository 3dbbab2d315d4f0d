"""Events of an array, beyond its usual errors: a turn or still of one unit that the others contradict, one that all miss alike, steps
in the readings of one unit, which the others feel or not.

A block of rows, a turn's closure or a still's force, is tested by F against the others of its component, its own share in the estimate of
that component removed; the probability is family-wise, over all blocks of an array.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import fdtrc

from session.base.texts import probability, significant
from session.base.units import DEG, MG
from tinygc.features.arrays.system import Layout, Solution, UnitRows
from tinygc.features.arrays.units import SameStills
from tinygc.inference.choose import chance_of_any

#: family-wise probability of an event
RARE_P = 0.01
#: least share of a component's expected size that the other blocks are taken to have
QUIETEST = 0.1

OWN_TURN, OWN_STILL, COMMON_TURN, COMMON_STILL = "turn", "still", "common turn", "common still"
#: a step in one unit's register, by whether the other units feel it
FALSE_READING, KNOCK = "false reading", "knock"


@dataclass(frozen=True, eq=False)
class ArrayEvent:
    """Something at a moment, at_s of the array's clock.

    unit: number of the unit, None of all, of a knock the one with the largest step; size: rad, m/s^2 or, of a step, rad/s, 0 for a knock
    that only accelerometers show; p_value: of one as large by chance, family-wise; first, last: the array's stills around it; rows of the
    system; rival: of two units, the other one where it contradicts as much, so that the faulty one is unknown; felt: share of a step that
    the other units feel; units: those in which a detector found it.
    """

    what: str
    unit: int | None
    at_s: float
    size: float
    p_value: float = np.nan
    first: int = -1
    last: int = -1
    rows: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    rival: int | None = None
    felt: float = np.nan
    units: tuple[int, ...] = ()

    @property
    def size_text(self) -> str:
        """Return the size with its unit."""
        if self.what in (FALSE_READING, KNOCK):
            return f"{significant(self.size / DEG)}°/s"
        return f"{significant(self.size / DEG, 2)}°" if "turn" in self.what else f"{significant(self.size / MG, 2)} mg"

    def together(self, events: Iterable[ArrayEvent]) -> tuple[ArrayEvent, ...]:
        """Return the events of single units in the same turn or still; with more than one unit, none is a sensor's own."""
        return tuple(e for e in events if e.unit is not None and (e.what, e.first, e.last) == (self.what, self.first, self.last))

    def words(self, events: Iterable[ArrayEvent], units: int) -> str:
        """Return the units that it belongs to, of so many, and its treatment, next to the other events."""
        size, where = self.size_text, "turn" if "turn" in self.what else "still"
        if self.what == FALSE_READING:
            return f"unit {self.unit} alone leaps by {size}, the others feel {100 * max(self.felt, 0.0):.0f} % of it: a false reading"
        if self.what == KNOCK and self.size:
            return f"unit {self.unit} leaps by {size}, and the others feel {100 * self.felt:.0f} % of it: a knock, no false reading"
        if self.what == KNOCK:
            return f"{len(self.units)} units' specific force jumps at once: a knock that all felt"
        if self.what == COMMON_TURN:
            return f"all units miss this turn by {size}: a knock or the motion, not a unit's reading"
        if self.what == COMMON_STILL:
            return f"all units feel {size} in this still: the body was not at rest"
        if self.rival is not None:
            both = f"units {self.unit} and {self.rival} differ by {size} in this {where}"
            return f"{both}, and two cannot show which one is wrong; unit {self.unit}'s does not count"
        deviating = self.together(events)
        others = units - len(deviating)
        lost = "turn" if where == "turn" else "gravity there"
        if len(deviating) > 1:
            who = ", ".join(f"unit {number} by {by}" for number, by in sorted((each.unit or 0, each.size_text) for each in deviating))
            return (
                f"{len(deviating)} of {units} units stand out in this {where}, each in its own way ({who}): several at once are hardly "
                f"their own readings: a blow that each unit feels or samples otherwise is more probable; their {lost} does not count"
            )
        missed = f"misses this turn by {size}" if where == "turn" else f"feels {size} too much in this still"
        tested = f"against the other{'s' * (others > 1)} (F test, {probability(self.p_value)})"
        return f"unit {self.unit} {missed} {tested}: its own readings; its {lost} does not count"

    def table(self, begins_s: float) -> dict:
        """Return one of ``events``, turns in degrees and stills in mg, or of ``moments`` where it is a step; times from begins_s."""
        table = {"what": self.what, "unit": self.unit, "at_s": self.at_s - begins_s}
        if self.what in (FALSE_READING, KNOCK):
            step = {"units": self.units, "size_dps": self.size / DEG, "felt_by_others": self.felt}
            return table | step | {"description": self.words((), 0)}
        unit, si = ("deg", DEG) if "turn" in self.what else ("mg", MG)
        return table | {"rival": self.rival, "size": self.size / si, "unit_of_size": unit, "p_value": self.p_value}


#: what rows are of, and the number of their unit; rows (B, d) that are kept or rejected together; spans (B, 2) stills; times (B,) s
Blocks = tuple[str, int | None, np.ndarray, np.ndarray, np.ndarray]


def blocks_of(numbers: Sequence[int], rows: list[UnitRows], same: SameStills, layout: Layout) -> list[Blocks]:
    """Return the blocks of every unit's turns and stills, and of the common part."""
    q = np.arange(len(same))
    parts = [
        *((OWN_TURN, n, at, (unit.first, unit.last)) for n, at, unit in zip(numbers, layout.closure, rows, strict=True)),
        *((OWN_STILL, n, at, (unit.stills, unit.stills)) for n, at, unit in zip(numbers, layout.force, rows, strict=True)),
        (COMMON_TURN, None, layout.of_common, (q[:-1], q[1:])),
        (COMMON_STILL, None, layout.of_level, (q, q)),
    ]
    return [(what, n, at, np.column_stack(span), same.time_s[span[0], int("turn" in what)]) for what, n, at, span in parts]


def candidates(solution: Solution, blocks: list[Blocks]) -> list[ArrayEvent]:
    """Return each block's event, with the family-wise probability that chance makes one as large."""
    total = sum(len(rows) for _, _, rows, _, _ in blocks)
    found = []
    for what, unit, rows, spans, at_s in blocks:
        chi, error = solution.blocks(rows)
        d = rows.shape[1]
        counted = ~solution.system.out[rows].any(axis=1)
        freedom = d * np.maximum(counted.sum() - counted, 1)
        left = d * counted.sum() - np.where(counted, chi, 0.0)
        p = fdtrc(d, freedom, chi / d / np.maximum(left / freedom, QUIETEST))
        for b, (first, last) in enumerate(spans.tolist()):
            size = float(np.linalg.norm(error[b]))
            found.append(ArrayEvent(what, unit, float(at_s[b]), size, chance_of_any(float(p[b]), total), first, last, rows[b]))
    return found


def worst_of_each_turn(found: list[ArrayEvent], out: np.ndarray) -> list[ArrayEvent]:
    """Return the new events, at most one of each turn or still, since one bad reading also shows in the rows that share its turn; in an
    array of two units with the rival, where in yaw each is the only reference of the other."""
    best: dict[tuple[bool, int], ArrayEvent] = {}
    for event in sorted(found, key=lambda each: (each.p_value, -each.size)):
        if event.p_value <= RARE_P and not out[event.rows].all():
            best.setdefault((event.first == event.last, event.first), event)
    if len({event.unit for event in found} - {None}) != 2:
        return list(best.values())
    rivals = [[e.unit for e in each.together(found) if e.unit != each.unit and e.p_value <= RARE_P] for each in best.values()]
    return [
        replace(event, rival=mine[0]) if mine and event.unit is not None else event
        for event, mine in zip(best.values(), rivals, strict=True)
    ]
