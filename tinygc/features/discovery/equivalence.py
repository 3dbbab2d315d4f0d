"""Find forms that are the same for every movement.

A law that is the same beside a calibration may differ from another by the rate itself (a dead zone, and what is held within it), and some
forty thousand forms are compared: so they are compared by their values on a movement.  A computer algebra system would sort each
expression, take minutes, and see no calibration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from session.base.rotation import unit_vectors
from session.base.units import DEG
from tinygc.effects import Movement, signals
from tinygc.features.discovery.form import Factor, LawForm

# A simulated movement that distinguishes all forms that differ for any movement.
#
# Every quantity takes values over its whole range and of both signs, independent of the others, so that steps at neighbouring thresholds
# differ in a few samples.

SAMPLES, RATE_HZ, FULL_SCALE = 2400, 10.0, 500 * DEG
#: jitter of samples in sampling periods, so that no time is a multiple of it; samples of the shortest and the longest turn or rest
STRAY, SHORTEST, LONGEST = 0.2, 10, 240
#: share of a turn's size: 1 to 10 dps is slower than what ends a rest, and above noise
CREEP = 0.015


def some_movement(seed: int) -> Movement:
    """Four minutes of turns, rests and creeps of many lengths, with warming, cooling and vibration."""
    rng = np.random.default_rng(seed)
    t_s = (np.arange(SAMPLES) + rng.uniform(0, STRAY, SAMPLES)) / RATE_HZ
    force = _wandering(rng, 3)
    return Movement(
        t_s=rng.uniform(0.1, 0.5) + t_s,
        dt_s=1 / RATE_HZ,
        rate=0.8 * FULL_SCALE * _turning(rng)[:, None] * _wandering(rng, 3),
        force_g=unit_vectors(force) * rng.uniform(0.8, 1.2, (SAMPLES, 1)),
        temp_c=25 + 10 * _wandering(rng, 1)[:, 0],
        vibration_g2=rng.uniform(0.0, 0.2, SAMPLES),
        duration_s=SAMPLES / RATE_HZ + 1.0,
        fs_rps=FULL_SCALE,
        first_temp_c=25.0,
    )


def _turning(rng: np.random.Generator) -> np.ndarray:
    """(SAMPLES,) a swell up to 1 in turns and to ``CREEP`` in every other rest, 0 in the others.

    It begins with a short turn and the longest rest, so that settling with time is not yet complete there.
    """
    found, first, number = np.zeros(SAMPLES), 0, 0
    while first < SAMPLES:
        length = (SHORTEST, LONGEST)[number] if number < 2 else int(np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST))))
        phase = (np.arange(length) + 0.5) / length
        swell = np.cos(np.pi / 2 * phase) if number == 0 else np.sin(np.pi * phase)
        found[first : first + length] = ((1.0, 0.0, 1.0, CREEP)[number % 4] * swell)[: SAMPLES - first]
        first, number = first + length, number + 1
    return found


def _wandering(rng: np.random.Generator, axes: int) -> np.ndarray:
    """(SAMPLES, axes) smooth over about a second, uniform over −1 to 1."""
    noise = rng.standard_normal((SAMPLES + 20, axes))
    smooth = np.stack([np.convolve(column, np.hanning(22)[1:], mode="valid") for column in noise.T], axis=1)
    return 2 * np.argsort(np.argsort(smooth, axis=0), axis=0) / (SAMPLES - 1) - 1


# Forms that are the same for every movement: on a simulated one their columns span the same space beyond a calibration's.
#
# A bias and a matrix span a constant and the three rates: forms that differ by these alone are one form (the rate within a limit, and the
# rate beyond it), and a form made of these alone is none.

#: rows of the first comparison: a form has up to 36 columns of an axis, a calibration four
ROWS = 96
#: share of a column's size above which the part beyond a calibration exceeds rounding; likewise beyond its neighbours
LEFT = 1e-9
#: two projections of size near one within this distance are the same: rounding leaves less for all but the faintest columns
SAME = 1e-6
#: axes of the first and of the second comparison: another axis may pass a threshold that one axis never reaches
FIRST, EVERY = (0,), (0, 1, 2)
#: most numbers held at once in columns of forms
MOST_NUMBERS = 2_000_000


def distinct_forms(forms: Sequence[LawForm], movements: Sequence[Movement]) -> list[LawForm]:
    """Return the first of each group of equal forms, in order of preference, without those that a calibration spans.

    All forms are compared in some rows of the first movement on one axis.  Those that equal others or vanish there are compared in every
    row of every movement on all three axes, as few samples pass a high threshold and the agreement may be chance.
    """
    values = [_values_in(movement) for movement in movements]
    groups = _groups(drawn_projections(forms, values[0], ROWS, FIRST))
    found = [group[0] for group in groups if len(group) == 1]
    doubtful = np.sort(np.setdiff1d(np.arange(len(forms)), found))
    left = [forms[number] for number in doubtful]
    again = np.concatenate([drawn_projections(left, every, len(every[0]), EVERY) for every in values], axis=1)
    found += [int(doubtful[group[0]]) for group in _groups(again)]
    return [forms[number] for number in sorted(found)]


def _groups(projections: np.ndarray) -> list[list[int]]:
    """Numbers, rising, of projections (F, R) that are the same; those that vanish are in no group."""
    there = np.flatnonzero(np.linalg.norm(projections, axis=1) > SAME)
    order = there[np.argsort(projections[there, 0], kind="stable")]
    edges = np.flatnonzero(np.diff(projections[order, 0]) > SAME) + 1
    found: list[list[int]] = []
    for near in np.split(order, edges):
        own: list[list[int]] = []
        for number in np.sort(near).tolist():
            home = next((group for group in own if np.abs(projections[group[0]] - projections[number]).max() < SAME), None)
            if home is None:
                own.append([number])
            else:
                home.append(number)
        found += own
    return found


#: of a movement: rate and one (N, 4), which a calibration spans, and a factor's values (components, N)
_Values = tuple[np.ndarray, Callable[[Factor], np.ndarray]]


def _values_in(movement: Movement) -> _Values:
    """Values of factors in a movement, each computed once."""

    @cache
    def of(factor: Factor) -> np.ndarray:
        return np.ascontiguousarray(factor.values(movement).T)

    # Forms use the moving rate: below a turn's threshold the rate is noise.
    rate = signals.moving_rate(movement) / movement.fs_rps
    return np.concatenate([rate, np.ones((len(rate), 1))], axis=1), of


def drawn_projections(forms: Sequence[LawForm], values: _Values, count: int, axes: Sequence[int]) -> np.ndarray:
    """(F, axes · count): a random vector in ``count`` rows, projected onto the span of each axis' columns.

    It is zero where a calibration spans all columns.
    """
    rng = np.random.default_rng(count)
    rows = np.sort(rng.choice(len(values[0]), count, replace=False))
    drawn = rng.standard_normal(count) * np.sqrt(count)
    return np.concatenate([_span_projections(forms, values, rows, axis, drawn) for axis in axes], axis=1)


def _span_projections(forms: Sequence[LawForm], values: _Values, rows: np.ndarray, axis: int, drawn: np.ndarray) -> np.ndarray:
    """(F, R): drawn (R,), in these rows (R,) of a movement, projected onto the span of an axis' columns beyond a calibration's."""
    calibration, of = values
    held = np.linalg.qr(calibration[rows])[0]
    own = {factor: of(factor)[:, rows] for factor in dict.fromkeys(factor for form in forms for factor in form.factors)}
    found = np.zeros((len(forms), len(rows)))
    for members, parts in _same_components(forms, axis):
        at_once = max(MOST_NUMBERS // (len(parts[0]) * len(rows)), 1)
        for first in range(0, len(members), at_once):
            some = members[first : first + at_once]
            columns = np.ones((len(some), len(parts[0]), len(rows)))
            for place, components in enumerate(parts):
                columns *= np.stack([own[forms[number].factors[place]][components] for number in some])
            found[some] = _projected(columns, held, drawn)
    return found


def _same_components(forms: Sequence[LawForm], axis: int) -> list[tuple[list[int], list[list[int]]]]:
    """Numbers of forms whose terms use the same components, and these components of each factor, for one axis."""
    groups: dict[tuple, list[int]] = {}
    for number, form in enumerate(forms):
        key = (form.pattern, *((factor.of.components, factor.through.phases) for factor in form.factors))
        groups.setdefault(key, []).append(number)
    found = []
    for members in groups.values():
        terms = [parts for own, parts in forms[members[0]].terms() if own == axis]
        found.append((members, [[parts[place][1] for parts in terms] for place in range(len(terms[0]))]))
    return found


def _projected(columns: np.ndarray, held: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """(F, R), of columns (F, P, R), orthogonal to held (R, 4)."""
    size = np.linalg.norm(columns, axis=2, keepdims=True)
    for _ in range(2):  # the second pass removes the rounding left by the first
        columns = columns - (columns @ held) @ held.T
    left = np.linalg.norm(columns, axis=2, keepdims=True)
    unit = np.divide(columns, left, out=np.zeros_like(columns), where=left > LEFT * np.maximum(size, 1e-300))
    if columns.shape[1] == 1:
        return unit[:, 0] * (unit @ drawn)
    weight, turn = np.linalg.eigh(unit @ unit.transpose(0, 2, 1))
    along = turn.transpose(0, 2, 1) @ (unit @ drawn)[:, :, None]
    share = np.divide(along[:, :, 0], weight, out=np.zeros_like(weight), where=weight > LEFT * weight[:, -1:])
    return ((turn @ share[:, :, None]).transpose(0, 2, 1) @ unit)[:, 0]
