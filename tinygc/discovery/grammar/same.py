"""Forms that are the same whatever the movement: on a drawn one their columns span the same, beside what a calibration holds.

A bias and a matrix hold a constant and the three rates: what differs by these alone is one form (a rate held within a limit, and what it
has beyond that), and what is made of these alone is none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tinygc.discovery.grammar.form import Factor, Form
from tinygc.effects import Movement

#: rows of the movement that are looked at: a form has up to 36 columns beside the four of a calibration
ROWS = 96
#: of a column's size, from which on what a calibration leaves is more than rounding; likewise of its neighbours
LEFT = 1e-9
#: of a look's size, within which two are the same: a hundred times what rounding makes of columns that are nearly alike
SAME = 1e-6
#: forms at once
AT_ONCE = 2048


def told_apart(forms: Sequence[Form], movement: Movement) -> list[Form]:
    """Of forms in the order of preference, the first of each that are the same; those that a calibration holds are left out."""
    looks = looked_at(forms, movement)
    there = np.flatnonzero(np.linalg.norm(looks, axis=1) > SAME)
    order = there[np.argsort(looks[there, 0], kind="stable")]
    edges = np.flatnonzero(np.diff(looks[order, 0]) > SAME) + 1
    kept: list[int] = []
    for group in np.split(order, edges):
        own: list[int] = []
        for number in np.sort(group).tolist():
            if not own or np.abs(looks[own] - looks[number]).max(axis=1).min() > SAME:
                own.append(number)
        kept += own
    return [forms[number] for number in sorted(kept)]


def looked_at(forms: Sequence[Form], movement: Movement) -> np.ndarray:
    """(F, ROWS): a drawn vector as the span of the first axis' columns projects it; zero where a calibration holds them all.

    The patterns treat all axes alike, so the first stands for all.
    """
    rng = np.random.default_rng(len(movement.rate))
    rows = np.sort(rng.choice(len(movement.rate), ROWS, replace=False))
    drawn = rng.standard_normal(ROWS)
    return projections(forms, movement, rows, 0, drawn / np.linalg.norm(drawn))


def projections(forms: Sequence[Form], movement: Movement, rows: np.ndarray, axis: int, drawn: np.ndarray) -> np.ndarray:
    """(F, R): drawn (R,), in these rows (R,) of a movement, as the span of an axis' columns projects it beside what a calibration holds."""
    rate = movement.rate[rows] / movement.fs_rps
    held = np.linalg.qr(np.concatenate([rate, np.ones((len(rows), 1))], axis=1))[0]
    numbers: dict[Factor, int] = {}
    values: list[np.ndarray] = []
    for form in forms:
        for factor in form.factors:
            if factor not in numbers:
                numbers[factor] = len(values)
                values.append(factor.values(movement)[rows].T)
    found = np.zeros((len(forms), len(rows)))
    for members, parts in _alike_built(forms, axis):
        for first in range(0, len(members), AT_ONCE):
            some = members[first : first + AT_ONCE]
            columns = np.ones((len(some), len(parts[0]), len(rows)))
            for place, components in enumerate(parts):
                columns *= np.stack([values[numbers[forms[number].factors[place]]][components] for number in some])
            found[some] = _projected(columns, held, drawn)
    return found


def _alike_built(forms: Sequence[Form], axis: int) -> list[tuple[list[int], list[list[int]]]]:
    """Numbers of forms whose terms are the same components, and these of each factor, of one axis."""
    groups: dict[tuple, list[int]] = {}
    for number, form in enumerate(forms):
        key = (form.pattern, *((factor.of.components, factor.through.phases) for factor in form.factors))
        groups.setdefault(key, []).append(number)
    found = []
    for members in groups.values():
        terms = [term for term in forms[members[0]].terms() if term.axis == axis]
        found.append((members, [[term.parts[place][1] for term in terms] for place in range(len(terms[0].parts))]))
    return found


def _projected(columns: np.ndarray, held: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """(F, R), of columns (F, P, R), beside held (R, 4)."""
    size = np.linalg.norm(columns, axis=2, keepdims=True)
    for _ in range(2):  # the second takes off what rounding left of the first
        columns = columns - (columns @ held) @ held.T
    left = np.linalg.norm(columns, axis=2, keepdims=True)
    unit = np.divide(columns, left, out=np.zeros_like(columns), where=left > LEFT * np.maximum(size, 1e-300))
    if columns.shape[1] == 1:
        return unit[:, 0] * (unit @ drawn)
    weight, turn = np.linalg.eigh(unit @ unit.transpose(0, 2, 1))
    along = turn.transpose(0, 2, 1) @ (unit @ drawn)[:, :, None]
    share = np.divide(along[:, :, 0], weight, out=np.zeros_like(weight), where=weight > LEFT * weight[:, -1:])
    return ((turn @ share[:, :, None]).transpose(0, 2, 1) @ unit)[:, 0]
