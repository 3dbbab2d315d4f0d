"""``rates --discover``: the equation of a curve, searched among all functions of the grammar of laws, whatever the catalogue says.

    output = V0 + K w + c1 f1(w) [+ c2 f2(w)]

f: any function of a rate that ``explain --discover`` knows, with its constant on the grid and then refined.  Points at a limit of the
output are left out, and the limits stand in the equation.  The rules are those of that search: a description costs its bits; a curve must
be more crooked than chance (``choice.chance``); a third of the points that the search never saw must be predicted better with the equation
than with a straight line; rivals that fit as well are named.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from session.io.texts import probability
from tinygc.annexes.discovery.enumeration import ALONE, bits, constant_at, places
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.quantities import FUNCTIONS
from tinygc.annexes.rates.choice import FALSE_ALARM, Choice, chance
from tinygc.annexes.rates.fitting import floor, weight_sigma
from tinygc.annexes.rates.points import Points
from tinygc.annexes.rates.terms import size

#: every third point, by rate, is kept from the search
THIRD = 3
#: share of the straight line's mean square on the untouched third that an equation may leave
MOST_LEFT = 0.7
#: -2 log evidence within which another equation is a rival
NEAR = 6.0
#: equations of one term that a second one is added to
MOST_FIRST = 3
#: rivals that are named
MOST_RIVALS = 3
#: of a curve besides: where one of two straight pieces begins; periods of a sine of which a table shows a part, places as ``constant_at``
BESIDES, LONG_WAVES = ("hinge",), (0.15, 0.25, 0.4, 0.6, 0.8)
#: functions that look back at earlier samples, or write steps of a register
NOT_OF_POINTS = ("play", "latch", "saw")


@dataclass(frozen=True)
class Equation:
    """functions: names and constants °/s of the terms beside the line; coefficients: of V0 of each curve, of w, of the terms; score: -2 log
    evidence with the bits of its description; straight: whether it keeps the line K w."""

    functions: tuple[tuple[str, float | None], ...]
    coefficients: tuple[float, ...]
    score: float
    straight: bool

    def text(self, curves: int) -> str:
        """``V = 0.19 − 14.6 sin(2π w / 1610 + 0.2)``; V0 is the mean of the curves'."""
        values = list(self.coefficients)
        parts = [_number(float(np.mean(values[:curves])))]
        left = values[curves:]
        if self.straight:
            parts.append(f"{_number(left.pop(0))} w")
        for name, constant in self.functions:
            count = FUNCTIONS[name].phases
            own, left = left[:count], left[count:]
            shown = size(constant) if constant is not None else ""
            if name == "wave":
                parts.append(
                    f"{_number(float(np.hypot(own[0], own[1])))} sin(2π w / {shown} {_number(float(np.arctan2(own[0], own[1])), True)})"
                )
            else:
                parts.append(f"{_number(own[0])} {FUNCTIONS[name].shown.format(x='w', c=shown)}")
        return "V = " + " + ".join(parts).replace("+ −", "− ")


def _number(value: float, signed: bool = False) -> str:
    text = f"{abs(value):.4g}".replace("e-0", "e-") if value else "0"
    if "e" in text:
        mantissa, _, exponent = text.partition("e")
        text = f"{mantissa}×10^{int(exponent)}".replace("^-", "^−")
    sign = "−" if value < 0 else "+ " if signed else ""
    return f"{sign if not signed else sign.strip() + ' '}{text}"


@dataclass(frozen=True, eq=False)
class Discovery:
    """What the search says of one sensor: the equation, or None where there is none; its share of the line's mean square on the points that
    it never saw; rivals; p_value: of the departures from a line; best: the best equation, found or not."""

    equation: Equation | None
    best: Equation | None
    text: str
    untouched: float
    rivals: tuple[str, ...]
    p_value: float

    @property
    def lines(self) -> tuple[str, ...]:
        """The answer in words."""
        if self.equation is None:
            if self.p_value > FALSE_ALARM:
                return (f"discover: a straight line; as crooked by chance: {probability(self.p_value)}",)
            return ("discover: not a straight line within its limits, and no equation predicts the points that were kept from the search",)
        if not self.equation.functions:
            return (f"discover: {self.text}: a straight line within its limits, as crooked by chance: {probability(self.p_value)}",)
        said = [
            f"discover: {self.text}",
            f"it leaves {100 * self.untouched:.2g} % of a line's mean square on points that the search never saw",
        ]
        return (*said, *(f"or {rival}" for rival in self.rivals))

    def to_json(self) -> dict[str, Any]:
        """Part of ``tinygc-rates/1``."""
        return {
            "equation": self.text if self.equation else None,
            "untouched": self.untouched,
            "rivals": list(self.rivals),
            "p_value": self.p_value,
        }


def discover(choice: Choice) -> Discovery:
    """Search the equation of a sensor's points."""
    limited = choice.fit.hypothesis.lower or choice.fit.hypothesis.upper
    points = choice.points.part(~choice.fit.is_limited) if limited else choice.points
    p_value = chance(points) if limited else choice.p_value
    if p_value > FALSE_ALARM:
        straight = _fitted(points, (), True) if limited else None
        text = "" if straight is None else _limited(choice, straight.text(len(points.curves)))
        return Discovery(straight, straight, text, float("nan"), (), p_value)
    kept = np.zeros(len(points), dtype=bool)
    kept[np.argsort(points.rate_dps, kind="stable")[1::THIRD]] = True
    seen = points.part(~kept)
    names = [name for name in (*ALONE["rate"].split(), *BESIDES) if name not in ("itself", *NOT_OF_POINTS)]
    largest = float(np.abs(points.rate_dps).max())
    line = _fitted(seen, (), True)
    if line is None:
        return Discovery(None, None, "", float("nan"), (), p_value)
    found = [each for name in names for straight in (True, False) if (each := _best_place(seen, (), name, largest, straight)) is not None]
    found.sort(key=lambda each: each.score)
    for first in found[:MOST_FIRST]:
        found += [each for name in names if (each := _best_place(seen, first.functions, name, largest, first.straight)) is not None]
    found.sort(key=lambda each: each.score)
    best = found[0] if found else None
    if best is None or best.score > line.score:
        return Discovery(None, best, "", float("nan"), (), p_value)
    untouched = _left(points, kept, best) / max(_left(points, kept, line), 1e-300)
    curves = len(points.curves)
    whole = _fitted(points, best.functions, best.straight) or best
    seen_kinds = {_kinds(best)}
    rivals: list[str] = []
    for each in found[1:]:
        if each.score < best.score + NEAR and _kinds(each) not in seen_kinds and len(rivals) < MOST_RIVALS:
            seen_kinds.add(_kinds(each))
            rivals.append(_limited(choice, (_fitted(points, each.functions, each.straight) or each).text(curves)))
    accepted = whole if untouched < MOST_LEFT else None
    return Discovery(accepted, best, _limited(choice, whole.text(curves)), float(untouched), tuple(rivals), p_value)


def _limited(choice: Choice, text: str) -> str:
    """An equation with the limits of the output that the choice found."""
    of, (low, high) = choice.fit.hypothesis, choice.fit.limits
    if not (of.lower or of.upper):
        return text
    ends = [_number(limit) if there else f"{sign}∞" for limit, there, sign in ((low, of.lower, "−"), (high, of.upper, ""))]
    return f"V = clip({text.removeprefix('V = ')}, {ends[0]}, {ends[1]})"


def _kinds(equation: Equation) -> tuple[str, ...]:
    return tuple(sorted(name for name, _ in equation.functions))


def _columns(points: Points, functions: tuple[tuple[str, float | None], ...], straight: bool) -> np.ndarray:
    """(N, k) columns of V0 of each curve, of w, of each term."""
    rate = points.rate_dps
    terms = [np.reshape(FUNCTIONS[name].of(rate, constant or 1.0), (len(rate), -1)) for name, constant in functions]
    return np.column_stack([np.eye(len(points.curves))[points.curve], *([rate] if straight else []), *terms])


def _fitted(points: Points, functions: tuple[tuple[str, float | None], ...], straight: bool) -> Equation | None:
    """Coefficients and score; None where the points do not determine them."""
    from scipy.special import gammaln

    sigma = weight_sigma(points)
    columns = _columns(points, functions, straight) / sigma[:, None]
    size = np.linalg.norm(columns, axis=0)
    constants = sum(constant is not None for _, constant in functions)
    freedom = len(points) - columns.shape[1] - constants
    if freedom < 2 or (size == 0).any() or not np.isfinite(columns).all():
        return None
    solved, _, rank, _ = np.linalg.lstsq(columns / size, points.output / sigma, rcond=1e-11)
    if rank < columns.shape[1]:
        return None
    left = points.output / sigma - columns / size @ solved
    line = np.column_stack([np.eye(len(points.curves))[points.curve], points.rate_dps]) / sigma[:, None]
    crooked = points.output / sigma - line @ np.linalg.lstsq(line, points.output / sigma, rcond=None)[0]
    unit = max(float(crooked @ crooked), floor(points)) / len(points)
    chi_square = max(float(left @ left), floor(points))
    price = 2 * np.log(2) * sum(bits(LawForm((Factor("rate", name, constant),))) for name, constant in functions)
    parameters = (columns.shape[1] + constants) * np.log(len(points) * unit)
    score = freedom * np.log(chi_square / 2) - 2 * gammaln(freedom / 2) + parameters + price
    return Equation(functions, tuple((solved / size).tolist()), float(score), straight)


def _best_place(points: Points, before: tuple[tuple[str, float | None], ...], name: str, largest: float, straight: bool) -> Equation | None:
    """The best equation with one more function, its constant on the grid and then refined between the neighbours."""
    from scipy.optimize import minimize_scalar

    if FUNCTIONS[name].constant is None:
        return None if (name, None) in before else _fitted(points, (*before, (name, None)), straight)
    on_grid = (*LONG_WAVES, *places("rate", name)) if name == "wave" else places("rate", name)
    grid = [constant_at("rate", name, place, 1.0) * largest for place in on_grid]
    tried = [each for constant in grid if (each := _fitted(points, (*before, (name, constant)), straight)) is not None]
    if not tried:
        return None
    best = min(tried, key=lambda each: each.score)
    constant = best.functions[-1][1]
    assert constant is not None  # of a function with one

    def score(log: float) -> float:
        each = _fitted(points, (*before, (name, float(np.exp(log)))), straight)
        return 1e9 if each is None else each.score

    refined = minimize_scalar(score, bounds=(np.log(constant / 1.6), np.log(constant * 1.6)), method="bounded", options={"xatol": 1e-6})
    better = _fitted(points, (*before, (name, float(np.exp(refined.x)))), straight)
    return best if better is None or better.score > best.score else better


def _left(points: Points, kept: np.ndarray, equation: Equation) -> float:
    """Mean square that an equation leaves on the points that it was not fitted to."""
    part = points.part(kept)
    columns = _columns(part, equation.functions, equation.straight)
    return float(np.mean(((part.output - columns @ np.array(equation.coefficients)) / weight_sigma(part)) ** 2))
