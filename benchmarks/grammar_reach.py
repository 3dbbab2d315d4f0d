"""What the search's grammar can say at all: the form that comes nearest to each law that ``challenge --discover`` writes from physics.

    python benchmarks/grammar_reach.py [--draws 1] [--segments 16] [--only dead_zone …]

No noise and no judge: each law's true added rate, on a simulated movement, is fitted by least squares with every form of the grammar,
beyond a bias and a 3x3 of the rate; the constants of the nearest forms are then sharpened.  The correlation is that of the examination:
above 0.99 one form can say the law, below it no recording helps.  A law is drawn anew for each draw, so that widths and times differ
between its axes as in the examination; the table has the best form of the middle draw, and the least and the largest correlation.  Two laws
together, or a name of the catalogue, are not asked.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from common import markdown, progress

from tinygc.annexes.challenge.cases import Case
from tinygc.annexes.challenge.law_examination import SAME, AddedRate, added_rate
from tinygc.annexes.challenge.laws import BY_HAND
from tinygc.annexes.discovery.enumeration import bits, enumerated
from tinygc.annexes.discovery.equivalence import columns_of
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.quantities import largest_of
from tinygc.annexes.discovery.words import equation
from tinygc.effects import Movement
from tinygc.simulation.options import SimulationOptions

#: Hz and degC: tremor and a suspension pass, and a law of the temperature has what it needs
ODR_HZ, WARM_UP_C = 208.0, 10.0
#: samples by which all forms are looked at, and forms of other shape whose constants are then sharpened on ``SHARPENED`` of them
ROWS, NEAREST, SHARPENED = 800, 8, 6000
#: columns below this share of the longest direction of their form are its rounding
FAINT = 1e-9
#: of the search for constants: evaluations for each, ln of a constant's first step and of its precision
EVALUATIONS, STEP, PRECISION = 40, 0.2, 1e-3
#: a correlation that needs no sharper constants, and of those that have it the plainest form is said
EXACT = 0.9999


@dataclass(frozen=True)
class Reach:
    """The nearest form to one draw of a law, and the correlation of the rates that they add."""

    law: str
    equation: str
    correlation: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=1, help="of each law")
    parser.add_argument("--segments", type=int, default=16, help="turns of the movement")
    parser.add_argument("--only", nargs="+", default=[], metavar="LAW", help="some laws, without their law.")
    args = parser.parse_args()
    laws = [law for law in BY_HAND if not args.only or law.removeprefix("law.") in args.only]
    truths = [(law, added_rate(case)) for law in laws for case in cases(law, args.segments, args.draws)]
    near = nearest(truths)
    found = [near[i : i + args.draws] for i in range(0, len(near), args.draws)]
    rows = sorted((row(each) for each in found), key=lambda cells: -float(cells[3]))
    print(markdown(("law", "nearest form", "least", "largest"), rows))
    draws = [one.correlation for each in found for one in each]
    every = sum(min(one.correlation for one in each) > SAME for each in found)
    some = sum(max(one.correlation for one in each) > SAME for each in found)
    print(f"\nOf {len(found)} laws, {every} are within reach in every draw, {some} in at least one;", end=" ")
    print(f"of {len(draws)} draws, {sum(each > SAME for each in draws)} (correlation above {SAME:g}).")


def row(draws: Sequence[Reach]) -> tuple[str, str, str, str]:
    """Of one law; a bar within an equation ends no cell."""
    ordered = sorted(draws, key=lambda one: one.correlation)
    said = ordered[len(ordered) // 2].equation.replace("|", "\\|")
    return draws[0].law.removeprefix("law."), said, f"{ordered[0].correlation:.4f}", f"{ordered[-1].correlation:.4f}"


def cases(law: str, segments: int, draws: int) -> list[Case]:
    """The draws of a law, on one movement."""
    options = SimulationOptions(segments=segments, closure_s=0.0, warm_up_c=WARM_UP_C, odr_hz=ODR_HZ, seed=1)
    return [Case("reach", (law,), (1.0,), options, draw) for draw in range(draws)]


def nearest(truths: Sequence[tuple[str, AddedRate]]) -> list[Reach]:
    """The nearest form to each; laws of one movement are looked at together."""
    groups: list[list[int]] = []
    for number, (_, truth) in enumerate(truths):
        home = next((each for each in groups if np.array_equal(truths[each[0]][1].movement.force_g, truth.movement.force_g)), None)
        if home is None:
            groups.append([number])
        else:
            home.append(number)
    found: dict[int, Reach] = {}
    for group in groups:
        movement = truths[group[0]][1].movement
        forms = enumerated(largest_of([movement]))
        rows, many = _some(len(movement.rate), ROWS), _some(len(movement.rate), SHARPENED)
        held = _held(movement, rows)
        targets = np.stack([_beyond(held, truths[number][1].law[rows]) for number in group], axis=2)
        every = _correlations(forms, movement, rows, held, targets)
        for number, correlations in zip(group, every.T, strict=True):
            law, truth = truths[number]
            progress(f"law {len(found) + 1} of {len(truths)}")
            fit = _Fit(movement, truth.law, many)
            best, correlation = max((_sharpened(form, fit) for form in _shapes(forms, correlations)), key=lambda one: one[1])
            found[number] = Reach(law, equation(best), correlation)
    progress("")
    return [found[number] for number in range(len(truths))]


def _shapes(forms: Sequence[LawForm], correlations: np.ndarray) -> list[LawForm]:
    """The nearest, each of another shape; of those that say the law exactly as they are the plainest alone."""
    exact = np.flatnonzero(correlations > EXACT)
    if len(exact):
        return [min((forms[number] for number in exact.tolist()), key=bits)]
    shapes: dict[LawForm, LawForm] = {}
    for number in np.argsort(-correlations, kind="stable").tolist():
        shapes.setdefault(forms[number].shape, forms[number])
        if len(shapes) == NEAREST:
            break
    return list(shapes.values())


def _some(samples: int, count: int) -> np.ndarray:
    """Rows spread over a recording, the same each time, at random so that they miss no rhythm."""
    return np.sort(np.random.default_rng(count).choice(samples, min(count, samples), replace=False))


def _held(movement: Movement, rows: np.ndarray) -> np.ndarray:
    """(R, 4) orthonormal: what a calibration says of one axis."""
    return np.linalg.qr(np.column_stack([np.ones(len(rows)), movement.rate[rows]]))[0]


def _beyond(held: np.ndarray, values: np.ndarray) -> np.ndarray:
    for _ in range(2):  # the second takes off what rounding left of the first
        values = values - held @ (held.T @ values)
    return values


def _correlations(forms: Sequence[LawForm], movement: Movement, rows: np.ndarray, held: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """(F, T) with every coefficient free; targets (R, 3, T) are beyond a calibration already."""

    @cache
    def values(factor: Factor) -> np.ndarray:
        return factor.values(movement)[rows]

    explained = np.zeros((len(forms), targets.shape[2]))
    for number, form in enumerate(forms):
        by_axis: list[list[np.ndarray]] = [[], [], []]
        for term in form.terms():
            parts = [values(factor)[:, component] for factor, component in term.parts]
            by_axis[term.axis].append(parts[0] if len(parts) == 1 else parts[0] * parts[1])
        explained[number] = sum(_explained(np.column_stack(columns), held, targets[:, axis]) for axis, columns in enumerate(by_axis))
    return np.sqrt(explained / np.sum(targets**2, axis=(0, 1)))


def _explained(columns: np.ndarray, held: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """(T,) squares of what (R, P) columns take up of (R, T)."""
    size = np.linalg.norm(columns, axis=0)
    columns = _beyond(held, columns)
    left = np.linalg.norm(columns, axis=0)
    seen = left > FAINT * np.maximum(size, 1e-300)
    if not seen.any():
        return np.zeros(targets.shape[1])
    unit = columns[:, seen] / left[seen]
    weight, turn = np.linalg.eigh(unit.T @ unit)
    along = turn.T @ (unit.T @ targets)
    told = weight > FAINT * weight[-1]
    return np.sum(along[told] ** 2 / weight[told, None], axis=0)


class _Fit:
    """A form's correlation with what a law adds, over many rows of a movement."""

    def __init__(self, movement: Movement, added: np.ndarray, rows: np.ndarray):
        self.movement, self.rows, self.held = movement, rows, _held(movement, rows)
        self.target = _beyond(self.held, added[rows])

    def correlation(self, form: LawForm) -> float:
        """With every coefficient free."""
        columns = columns_of(form, self.movement)[self.rows]
        own = [columns[:, axis][:, np.abs(columns[:, axis]).max(axis=0) > 0] for axis in range(3)]
        explained = sum(_explained(each, self.held, self.target[:, axis, None])[0] for axis, each in enumerate(own) if each.shape[1])
        return float(np.sqrt(explained / np.sum(self.target**2)))


def _sharpened(form: LawForm, fit: _Fit) -> tuple[LawForm, float]:
    """With its best constants, by the simplex method, and its correlation."""
    from scipy.optimize import minimize

    begin = np.log(form.constants)
    there = fit.correlation(form)
    if not len(begin) or there > EXACT:
        return form, there
    simplex = np.vstack([begin, begin + STEP * np.eye(len(begin))])
    options = {"maxfev": EVALUATIONS * len(begin), "xatol": PRECISION, "fatol": 1e-7, "initial_simplex": simplex}
    found = minimize(lambda logs: -fit.correlation(form.with_constants(np.exp(logs))), begin, method="Nelder-Mead", options=options)
    return form.with_constants(np.exp(found.x)), -float(found.fun)


if __name__ == "__main__":
    main()
