"""Candidates: each error that a table may have, and each that its sensor may have beyond the linear calibration, as columns of the rows.

A table's errors are those of ``tinygc.features.tables.machines.description``; a sensor's are the catalogue's
(``tinygc/effects/entries``), by their own columns.  What the recording cannot show of a candidate (its sigma is larger than the size that
it may plausibly have) takes no part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from session.base.units import DEG, G
from tinygc.effects import Effect, Movement
from tinygc.effects.catalogue import catalogue
from tinygc.features.tables.machines.description import TableErrors
from tinygc.features.tables.observed import Observed
from tinygc.features.tables.rows import Comparison, harmonic

TABLE, SENSOR = "table", "sensor"

INDEX, WOBBLE, RIPPLE, SKEW = "table.index", "table.wobble", "table.rate_ripple", "table.nonorthogonal"
TILT, BACKLASH, LOST, LATENCY, DROPPED = "table.tilt", "table.backlash", "table.lost_steps", "table.latency", "timing.dropped_samples"
#: sizes that a table's errors may have, one sigma, SI
PLAUSIBLE = {
    INDEX: 0.2 * DEG,
    WOBBLE: 0.1 * DEG,
    RIPPLE: 0.1 * DEG,
    SKEW: 0.3 * DEG,
    TILT: 0.5 * DEG,
    BACKLASH: 0.3 * DEG,
    LOST: 2 * DEG,
    DROPPED: 2 * DEG,
}
#: a play that is negative cannot be
ONE_SIDED = (BACKLASH,)
#: cycles a turn from which an angle's error is a ripple; up to which it is looked for; of those that a turn's blocks resolve
FIRST_RIPPLE, LAST_RIPPLE, RESOLVED = 3, 100, 0.8
#: degC: temperatures that range over less say nothing
LEAST_WARMED_C = 1.0

Added = Callable[[TableErrors, np.ndarray], TableErrors]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One form of an error: id; whose it is; where (an axis, a turn); make: its columns; plausible (P,) SI; parts: JSON name,
    unit's size in SI and indices of each quantity; shape: numbers that are no parameters; tried: how many forms of this id are weighed;
    added: other errors of the table with this one of theta (P,), however large, None where only the columns are known; one_sided: none is
    negative."""

    id: str
    whose: str
    where: str
    make: Callable[[], np.ndarray]
    plausible: np.ndarray
    parts: tuple[tuple[str, float, tuple[int, ...]], ...]
    shape: dict[str, float | int | str]
    tried: int = 1
    added: Added | None = None
    one_sided: bool = False

    @cached_property
    def columns(self) -> np.ndarray:
        """(n, P) per SI unit."""
        return self.make()

    def values(self, theta: np.ndarray) -> dict[str, float | list[float]]:
        """JSON quantities of theta (P,), or of its sigmas."""
        found: dict[str, float | list[float]] = {}
        for name, si, at in self.parts:
            some = (theta[list(at)] / si).tolist()
            found[name] = some[0] if len(some) == 1 else some
        return found


def candidates_of(comparison: Comparison) -> list[Candidate]:
    """All of one comparison."""
    found = [*_of_table(comparison), *_lost_in_turns(comparison), *_of_sensor(comparison)]
    count = {id: sum(each.id == id for each in found) for id in {each.id for each in found}}
    return [replace(each, tried=count[each.id]) for each in found]


def _of_table(comparison: Comparison) -> Iterator[Candidate]:
    axes, said = comparison.observed.table.axes, comparison.observed.said

    def candidate(
        id: str, where: str, make: Callable[[], np.ndarray], added: Added, *parts: tuple[str, float, tuple[int, ...]], **shape: float | str
    ) -> Candidate:
        size = sum(len(at) for _, _, at in parts)
        return Candidate(id, TABLE, where, make, np.full(size, PLAUSIBLE[id]), parts, dict(shape), added=added, one_sided=id in ONE_SIDED)

    yield candidate(TILT, "base", comparison.of_tilt, _tilted, ("tilt_deg", DEG, (0, 1)))
    for number, axis in enumerate(axes):
        at, angle = f"axis {axis.name}", said[:, number]
        quantities = ("once_deg", DEG, (0, 1)), ("twice_deg", DEG, (2, 3))
        index = partial(comparison.of_harmonic, number, 1, 2), partial(_beside, number, harmonic(angle, 1, 2))
        yield candidate(INDEX, at, *index, *quantities, axis=axis.name)
        wobble = partial(comparison.of_wobble, number), partial(_wobbling, number)
        yield candidate(WOBBLE, at, *wobble, ("wobble_deg", DEG, (0, 1, 2, 3)), axis=axis.name)
        play = partial(comparison.of_backlash, number), partial(_beside, number, comparison.play_at_rest(number))
        yield candidate(BACKLASH, at, *play, ("backlash_deg", DEG, (0,)), axis=axis.name)
        if number and np.linalg.norm(np.cross(axes[number - 1].direction, axis.direction)) > 0.1:
            between = f"axes {axes[number - 1].name}, {axis.name}"
            away = np.cross(np.cross(axes[number - 1].direction, axis.direction), axis.direction)
            skew = partial(comparison.of_skew, number), partial(_skewed, number, away / np.linalg.norm(away))
            yield candidate(SKEW, between, *skew, ("skew_deg", DEG, (0,)), axis=axis.name)
        for cycles in range(FIRST_RIPPLE, _most_cycles(comparison.observed, number) + 1):
            ripple = partial(comparison.of_harmonic, number, cycles), partial(_beside, number, harmonic(angle, cycles))
            yield candidate(RIPPLE, at, *ripple, ("ripple_deg", DEG, (0, 1)), axis=axis.name, cycles=cycles)


def _tilted(errors: TableErrors, theta: np.ndarray) -> TableErrors:
    return replace(errors, tilt=errors.tilt + np.append(theta, 0.0))


def _of_axis(errors: TableErrors, axis: int, **changed: np.ndarray) -> TableErrors:
    return replace(errors, axes=(*errors.axes[:axis], replace(errors.axes[axis], **changed), *errors.axes[axis + 1 :]))


def _beside(axis: int, function: np.ndarray, errors: TableErrors, theta: np.ndarray) -> TableErrors:
    """With angles at rest beside the said ones, function (Q, P) rad per rad."""
    return _of_axis(errors, axis, lost=errors.axes[axis].lost + function @ theta)


def _wobbling(axis: int, errors: TableErrors, theta: np.ndarray) -> TableErrors:
    return _of_axis(errors, axis, wobble=errors.axes[axis].wobble + theta)


def _skewed(axis: int, away: np.ndarray, errors: TableErrors, theta: np.ndarray) -> TableErrors:
    return _of_axis(errors, axis, skew=errors.axes[axis].skew + np.tan(theta[0]) * away)


def _most_cycles(observed: Observed, axis: int) -> int:
    """The fastest ripple, cycles a turn, that the blocks of most turns of an axis resolve; 0 where it never turns alone."""
    own = observed.alone == axis
    if not own.any():
        return 0
    steps = np.abs(np.diff(observed.said_edges[own, :, axis], axis=1))
    return int(min(LAST_RIPPLE, RESOLVED * np.pi / np.median(steps.max(axis=1))))


def _lost_in_turns(comparison: Comparison) -> Iterator[Candidate]:
    seen = comparison.observed
    plausible = np.array([PLAUSIBLE[LOST]])
    for turn, alone in enumerate(seen.alone.tolist()):
        moved = np.flatnonzero(np.abs(seen.turned[turn]) > 0.5 * DEG) if alone < 0 else [alone]
        for axis in map(int, moved):
            shape: dict[str, float | int | str] = {"axis": seen.table.axes[axis].name, "turn": turn}
            parts = (("lost_deg", DEG, (0,)),)
            added = partial(_beside, axis, comparison.lost_at_rest(axis, turn))
            yield Candidate(LOST, TABLE, f"turn {turn}", partial(comparison.of_lost, axis, turn), plausible, parts, shape, added=added)
            if alone >= 0:
                yield Candidate(DROPPED, SENSOR, f"turn {turn}", partial(comparison.of_dropped, turn), plausible, parts, shape)


def _of_sensor(comparison: Comparison) -> Iterator[Candidate]:
    rests, turns = _movements(comparison)
    warmed = np.ptp(rests.temp_c) if np.isfinite(rests.temp_c).all() else 0.0
    for effect in catalogue().values():
        if effect.kind not in ("rate", "force") or effect.scan is not None or "vibration" in effect.inputs:
            continue
        if "temperature" in effect.inputs and warmed < LEAST_WARMED_C:
            continue
        make = partial(_columns, comparison, effect, rests, turns)
        of = effect.parameter
        parts = ((of.name, of.si, tuple(range(of.size))),)
        yield Candidate(effect.id, SENSOR, "", make, np.full(of.size, of.plausible), parts, {})


def _columns(comparison: Comparison, effect: Effect, rests: Movement, turns: list[Movement]) -> np.ndarray:
    if effect.kind == "force":
        return comparison.of_forces(effect.bent(rests) / G)
    seen = comparison.observed
    in_turns = np.zeros((*seen.rates.shape, effect.parameter.size))
    for number, turn in enumerate(turns):
        in_turns[number, : len(turn.t_s)] = effect.columns(effect.shown(turn))
    # A rest has no neighbours to look at.
    at_rest = np.zeros((len(seen.said), 3, effect.parameter.size)) if effect.reach else effect.columns(effect.shown(rests))
    return comparison.of_rates(in_turns, at_rest).stacked()


def _movements(comparison: Comparison) -> tuple[Movement, list[Movement]]:
    """The rests, and the blocks of each turn, as movements that the catalogue reads."""
    seen = comparison.observed
    first_c, duration_s = float(seen.temp_c[0]), float(seen.rest_s[-1] + seen.rest_span_s[-1])

    def movement(t_s: np.ndarray, dt_s: float, rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray) -> Movement:
        return Movement(t_s, dt_s, rate, force, temp_c, np.zeros(len(t_s)), duration_s, seen.fs_rps, first_c)

    rests = movement(seen.rest_s, float(np.median(seen.rest_span_s)), np.zeros_like(seen.rate), seen.force, seen.temp_c)
    turns = []
    for number, count in enumerate(seen.blocks.tolist()):
        block_s = float(seen.block_s[number])
        t_s = seen.turn_s[number] + (np.arange(count) - (count - 1) / 2) * block_s
        force = -comparison.earth_in_blocks[number, :count, :, 2]
        temp_c = np.interp(t_s, seen.rest_s, seen.temp_c)
        turns.append(movement(t_s, block_s, comparison.turning[number, :count], force, temp_c))
    return rests, turns
