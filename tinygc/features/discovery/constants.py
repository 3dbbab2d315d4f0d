"""Refine a form's constants by the gain of its linear columns, one constant for all axes or one for each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.effects import Movement
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_effect import added, as_effect
from tinygc.features.discovery.projections import Projection, seen_basis
from tinygc.features.discovery.responses import Responses

# A form's constants at the largest gain of its linear columns.

#: search range of a constant as a factor either way, where its neighbours on a grid are unknown
REACH = 2.5
#: most columns evaluated for one form, and those of each constant that are scanned over its reach first
MOST_EVALUATIONS, SCANNED = 40, 9
#: those scanned for a constant that decides at a few moments: with thirty turns its gain is flat over about a fifteenth of it
DECIDED_SCANNED = 81
#: ln of a constant: tolerance of the maximum, a tenth of a sigma for constants known to a per cent
PRECISION = 1e-3


def refined(form: LawForm, responses: Responses, projection: Projection) -> LawForm:
    """The form with its constants refined against one hypothesis."""
    begin = np.log(form.constants)

    def gain(logs: np.ndarray) -> float:
        return gain_of(responses.columns(form.with_constants(np.exp(logs))), projection)

    if not len(begin):
        return form
    scanned = DECIDED_SCANNED if any(factor.through.decided for factor in form.factors) else SCANNED
    # (constants,) ln: scan each constant over its reach, then climb with all of them together
    reach = np.full(begin.shape, np.log(REACH))
    from scipy.optimize import minimize, minimize_scalar

    at, highest = begin.copy(), gain(begin)
    spacing = 2 * reach / (scanned - 1)
    for number in range(len(begin)):
        for shift in np.linspace(-reach[number], reach[number], scanned):
            trial = at.copy()
            trial[number] = begin[number] + shift
            found = gain(trial)
            if found > highest:
                at, highest = trial, found
    low, high = np.maximum(at - spacing, begin - reach), np.minimum(at + spacing, begin + reach)
    left = MOST_EVALUATIONS - 1 - SCANNED * len(begin)
    if len(begin) == 1:
        options = {"maxiter": left, "xatol": PRECISION}
        found = minimize_scalar(lambda x: -gain(np.array([x])), bounds=(low[0], high[0]), method="bounded", options=options)
        end = np.array([found.x])
    else:
        simplex = np.vstack([at, at + np.diag(np.where(at + spacing / 2 < high, spacing, -spacing) / 2)])
        simplex_options = {"maxfev": max(left, len(begin) + 1), "xatol": PRECISION, "fatol": PRECISION, "initial_simplex": simplex}
        found = minimize(lambda x: -gain(x), at, method="Nelder-Mead", bounds=list(zip(low, high, strict=True)), options=simplex_options)
        end = found.x
    return form.with_constants(np.exp(end if -found.fun >= highest else at))


# A form with one constant per axis: the grammar has one for all axes, but a gyroscope has three structures.

#: largest ratio of one axis' constant to the common one, either way
AXIS_REACH = 5.0
#: columns evaluated for the constant of one axis, and rounds over the axes, which hardly affect one another
EVALUATIONS, ROUNDS = 16, 2
#: ln of a constant: tolerance
AXIS_PRECISION = 0.01


@dataclass(frozen=True, eq=False)
class ByAxis:
    """constant: its number among the form's constants; values (3,): of x, y, z; more: chi-square gained over one constant for all axes;
    forms: of each axis; axes (P,): the axis whose constant each coefficient uses; theta (P,) SI, by the linear approximation."""

    constant: int
    values: np.ndarray
    more: float
    forms: tuple[LawForm, LawForm, LawForm]
    axes: np.ndarray
    theta: np.ndarray

    def added(self, movements: Sequence[Movement]) -> np.ndarray:
        """Added rate (N, 3) rad/s over all logs concatenated, as ``equivalence.added``."""
        thetas = (np.where(self.axes == axis, self.theta, 0.0) for axis in range(3))
        return np.sum([added(as_effect(form), theta, movements) for form, theta in zip(self.forms, thetas, strict=True)], axis=0)


def by_axis(form: LawForm, responses: Responses, projection: Projection) -> list[ByAxis]:
    """Fit each of a form's constants by axis, the others held; empty for a quantity without an axis."""
    found = []
    places = [place for place, factor in enumerate(form.factors) for value in (factor.constant, factor.lag_s) if value is not None]
    for number, place in enumerate(places):
        factor = form.factors[place]
        axes = np.array([parts[place][1] // factor.each for _, parts in form.terms()])
        if factor.vector and len(np.unique(axes)) > 1:
            found.append(_by_axis(form, number, axes, responses, projection))
    return found


def linear_coefficients(columns: np.ndarray, projection: Projection) -> np.ndarray:
    """Coefficients (P,) of stacked columns (n, P), by linear least squares against a hypothesis."""
    return np.linalg.lstsq(projection.seen(columns), projection.residual, rcond=None)[0]


def _by_axis(form: LawForm, number: int, axes: np.ndarray, responses: Responses, projection: Projection) -> ByAxis:
    def of(ln: float) -> LawForm:
        values = list(form.constants)
        values[number] = float(np.exp(ln))
        return form.with_constants(tuple(values))

    def with_axes(of_these: np.ndarray, ln: float) -> np.ndarray:
        return np.where(of_these, responses.columns(of(ln)), columns)

    def highest(of_these: np.ndarray) -> tuple[float, float]:
        return _highest_of_one(lambda ln: gain_of(with_axes(of_these, ln), projection), begin)

    begin, columns = float(np.log(form.constants[number])), responses.columns(form)
    alone = gain_of(columns, projection)
    # The common constant is refined first; otherwise its error would count in favour of the axes.
    ln, found = highest(axes >= 0)
    if found > alone:
        begin, alone, columns = ln, found, with_axes(axes >= 0, ln)
    at, top = [begin] * 3, alone
    for _ in range(ROUNDS):
        for axis in range(3):
            ln, found = highest(axes == axis)
            if found > top:
                at[axis], top, columns = ln, found, with_axes(axes == axis, ln)
    return ByAxis(number, np.exp(at), top - alone, (of(at[0]), of(at[1]), of(at[2])), axes, linear_coefficients(columns, projection))


def _highest_of_one(gain: Callable[[float], float], begin: float) -> tuple[float, float]:
    """ln of a constant, within ``REACH`` of its start, and its gain."""
    from scipy.optimize import minimize_scalar

    bounds, options = (begin - np.log(AXIS_REACH), begin + np.log(AXIS_REACH)), {"maxiter": EVALUATIONS, "xatol": AXIS_PRECISION}
    found = minimize_scalar(lambda ln: -gain(ln), bounds=bounds, method="bounded", options=options)
    return float(found.x), -float(found.fun)


def gain_of(columns: np.ndarray, projection: Projection) -> float:
    """Chi-square that stacked columns (n, P) remove from what a hypothesis leaves."""
    return float(np.sum((seen_basis(columns, projection).T @ projection.residual) ** 2))
