"""A form one of whose constants differs by axis: the grammar has one for all, and a gyroscope has three structures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.discovery.grammar.as_effect import as_effect
from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.alike import seen_basis
from tinygc.discovery.screen.looks import Look
from tinygc.discovery.screen.responses import Responses
from tinygc.effects import Movement

#: how far the constant of an axis may be from that of all, as a factor either way
REACH = 5.0
#: columns that are made for the constant of one axis, and how often each axis has its turn: what one axis has hardly moves another's
EVALUATIONS, ROUNDS = 16, 2
#: ln of a constant: near enough
PRECISION = 0.01


@dataclass(frozen=True, eq=False)
class ByAxis:
    """constant: its number in ``Form.constants``; values (3,): of x, y, z; more: chi-square that it takes up beyond what one constant
    for all does; forms: of each axis; axes (P,): whose constant each coefficient has; theta (P,) SI, seen linearly."""

    constant: int
    values: np.ndarray
    more: float
    forms: tuple[Form, Form, Form]
    axes: np.ndarray
    theta: np.ndarray

    def added(self, movements: Sequence[Movement]) -> np.ndarray:
        """(N, 3) rad/s over all logs, one after the other, as ``judge.added`` has it."""
        own = [added_by(form, np.where(self.axes == axis, self.theta, 0.0), movements) for axis, form in enumerate(self.forms)]
        return np.sum(own, axis=0)


def by_axis(form: Form, responses: Responses, look: Look) -> list[ByAxis]:
    """Each of a form's constants in its turn, the others as they are; none of a quantity without an axis."""
    return [
        _best(form, number, axes, responses, look)
        for number, factor in enumerate(_factors(form))
        if form.factors[factor].vector and len(np.unique(axes := _axes(form, factor))) > 1
    ]


def linear(form: Form, responses: Responses, look: Look) -> np.ndarray:
    """(P,) the coefficients of a form, as a look sees them linearly."""
    return _theta(responses.columns(form), look)


def added_by(form: Form, theta: np.ndarray, movements: Sequence[Movement]) -> np.ndarray:
    """(N, 3) rad/s that a form adds over all logs."""
    effect = as_effect(form)
    return np.concatenate([effect.columns(effect.shown(movement)) @ theta for movement in movements])


def _factors(form: Form) -> list[int]:
    """Number of the factor of each of a form's constants."""
    pairs = ((number, value) for number, factor in enumerate(form.factors) for value in (factor.constant, factor.lag_s))
    return [number for number, value in pairs if value is not None]


def _axes(form: Form, factor: int) -> np.ndarray:
    """(P,) the axis of a factor's component in each term."""
    return np.array([term.parts[factor][1] // form.factors[factor].each for term in form.terms()])


def _best(form: Form, number: int, axes: np.ndarray, responses: Responses, look: Look) -> ByAxis:
    def of(ln: float) -> Form:
        values = list(form.constants)
        values[number] = float(np.exp(ln))
        return form.with_constants(tuple(values))

    def with_axes(of_these: np.ndarray, ln: float) -> np.ndarray:
        return np.where(of_these, responses.columns(of(ln)), columns)

    def highest(of_these: np.ndarray) -> tuple[float, float]:
        return _highest(lambda ln: _gain(with_axes(of_these, ln), look), begin)

    begin, columns = float(np.log(form.constants[number])), responses.columns(form)
    alone = _gain(columns, look)
    # The one for all is as good as it can be seen here, or what it lacks would count for the axes.
    ln, found = highest(axes >= 0)
    if found > alone:
        begin, alone, columns = ln, found, with_axes(axes >= 0, ln)
    at, top = [begin] * 3, alone
    for _ in range(ROUNDS):
        for axis in range(3):
            ln, found = highest(axes == axis)
            if found > top:
                at[axis], top, columns = ln, found, with_axes(axes == axis, ln)
    return ByAxis(number, np.exp(at), top - alone, (of(at[0]), of(at[1]), of(at[2])), axes, _theta(columns, look))


def _highest(gain: Callable[[float], float], begin: float) -> tuple[float, float]:
    """ln of a constant, within ``REACH`` of where it begins, and its gain."""
    from scipy.optimize import minimize_scalar

    bounds, options = (begin - np.log(REACH), begin + np.log(REACH)), {"maxiter": EVALUATIONS, "xatol": PRECISION}
    found = minimize_scalar(lambda ln: -gain(ln), bounds=bounds, method="bounded", options=options)
    return float(found.x), -float(found.fun)


def _gain(columns: np.ndarray, look: Look) -> float:
    return float(np.sum((seen_basis(columns, look).T @ look.residual) ** 2))


def _theta(columns: np.ndarray, look: Look) -> np.ndarray:
    return np.linalg.lstsq(look.seen(columns), look.residual, rcond=None)[0]
