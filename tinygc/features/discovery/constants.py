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
#: columns that are scanned over that range first
SCANNED = 9
#: those scanned for a constant that decides at a few moments: with thirty turns its gain is flat over about a fifteenth of it
DECIDED_SCANNED = 81
#: columns evaluated for the maximum of one constant, and rounds over several, which hardly affect one another
EVALUATIONS, ROUNDS = 16, 2
#: ln of a constant: tolerance of the maximum, a tenth of a sigma for constants known to a per cent
PRECISION = 1e-3


def refined(form: LawForm, responses: Responses, projection: Projection) -> LawForm:
    """The form with its constants refined against one hypothesis."""
    scanned = DECIDED_SCANNED if any(factor.through.decided for factor in form.factors) else SCANNED
    for _ in range(min(len(form.constants), ROUNDS)):
        for number in range(len(form.constants)):
            begin = float(np.log(form.constants[number]))

            def gain(ln: float, form: LawForm = form, number: int = number) -> float:
                return gain_of(responses.columns(_with(form, number, ln)), projection)

            steps = np.linspace(begin - np.log(REACH), begin + np.log(REACH), scanned)
            at = steps[np.argmax([gain(ln) for ln in steps])]
            ln, found = _highest(gain, at, steps[1] - steps[0])
            form = _with(form, number, ln) if found > gain(begin) else form
    return form


def _with(form: LawForm, number: int, ln: float) -> LawForm:
    """The form with another of its constants."""
    values = list(form.constants)
    values[number] = float(np.exp(ln))
    return form.with_constants(tuple(values))


def _highest(gain: Callable[[float], float], begin: float, reach: float) -> tuple[float, float]:
    """ln of a constant within reach of its start, and its gain."""
    from scipy.optimize import minimize_scalar

    bounds, options = (begin - reach, begin + reach), {"maxiter": EVALUATIONS, "xatol": PRECISION}
    found = minimize_scalar(lambda ln: -gain(ln), bounds=bounds, method="bounded", options=options)
    return float(found.x), -float(found.fun)


# A form with one constant per axis: the grammar has one for all axes, but a gyroscope has three structures.

#: largest ratio of one axis' constant to the common one, either way
AXIS_REACH = 5.0


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
        """Added rate (N, 3) rad/s over all logs concatenated, as ``law_effect.added``."""
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
        return _with(form, number, ln)

    def with_axes(of_these: np.ndarray, ln: float) -> np.ndarray:
        return np.where(of_these, responses.columns(of(ln)), columns)

    def highest(of_these: np.ndarray) -> tuple[float, float]:
        return _highest(lambda ln: gain_of(with_axes(of_these, ln), projection), begin, np.log(AXIS_REACH))

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


def gain_of(columns: np.ndarray, projection: Projection) -> float:
    """Chi-square that stacked columns (n, P) remove from what a hypothesis leaves."""
    return float(np.sum((seen_basis(columns, projection).T @ projection.residual) ** 2))
