"""Refine a form's constants by the gain of its linear columns, one constant for all axes or one for each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.annexes.discovery.equivalence import added, as_effect
from tinygc.annexes.discovery.form import LawForm
from tinygc.annexes.discovery.projections import Projection, seen_basis
from tinygc.annexes.discovery.responses import Responses
from tinygc.effects import Movement

# A form's constants at the largest gain of its linear columns, and their sigmas.

#: search range of a constant as a factor either way, where its neighbours on a grid are unknown
REACH = 2.5
#: most columns evaluated for one form, and those of each constant that are scanned over its reach first
MOST_EVALUATIONS, SCANNED = 40, 9
#: those scanned for a constant that decides at a few moments: with thirty turns its gain is flat over about a fifteenth of it
DECIDED_SCANNED = 81
#: ln of a constant: tolerance of the maximum, a tenth of a sigma for constants known to a per cent
PRECISION = 1e-3
#: the curvature is computed where the gain has fallen by one (one sigma): tolerance, and steps towards it
FALLEN, STEPS = (0.3, 3.0), 5
#: ln of a constant: the first step, and the range of accepted steps
FIRST_STEP, LEAST_STEP, MOST_STEP = 0.02, 1e-5, 1.0


@dataclass(frozen=True, eq=False)
class RefinedForm:
    """form with its best constants; gain: chi-square; constants_sigma: of each constant in its unit, one sigma with all others free; inf
    where the gain does not determine it."""

    form: LawForm
    gain: float
    constants_sigma: tuple[float, ...]


def refined(form: LawForm, responses: Responses, projection: Projection, reach: float | np.ndarray = REACH) -> RefinedForm:
    """Refine the constants against one hypothesis; reach (constants,): range as a factor either way, up to the neighbours on a grid."""
    begin = np.log(form.constants)

    def gain(logs: np.ndarray) -> float:
        return _gain(responses.columns(form.with_constants(np.exp(logs))), projection)

    if not len(begin):
        return RefinedForm(form, gain(begin), ())
    scanned = DECIDED_SCANNED if any(factor.through.decided for factor in form.factors) else SCANNED
    at = _highest(gain, begin, np.broadcast_to(np.log(reach), begin.shape), scanned)
    sigma = _sigmas(gain, at) * np.exp(at)
    return RefinedForm(form.with_constants(np.exp(at)), gain(at), tuple(sigma.tolist()))


def _highest(gain: Callable[[np.ndarray], float], begin: np.ndarray, reach: np.ndarray, scanned: int) -> np.ndarray:
    """(constants,) ln: scan each constant over its reach, then climb with all of them together."""
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
    return end if -found.fun >= highest else at


def _sigmas(gain: Callable[[np.ndarray], float], at: np.ndarray) -> np.ndarray:
    """(constants,) ln: one sigma of each, where chi-square has risen by one, from the local curvature."""
    top, count = gain(at), len(at)
    steps = np.array([_step(gain, at, top, unit) for unit in np.eye(count)])
    moves = np.diag(steps)
    fallen = np.zeros((count, count))
    for i in range(count):
        fallen[i, i] = 2 * top - gain(at + moves[i]) - gain(at - moves[i])
        for j in range(i):
            corners = (gain(at + a * moves[i] + b * moves[j]) * a * b for a in (1, -1) for b in (1, -1))
            fallen[i, j] = fallen[j, i] = -sum(corners) / 4
    # In steps, chi-square rises by x' fallen x / 2.
    if np.linalg.eigvalsh(fallen)[0] <= 0:
        return np.full(count, np.inf)
    return np.sqrt(2 * np.diag(np.linalg.inv(fallen))) * steps


def _step(gain: Callable[[np.ndarray], float], at: np.ndarray, top: float, unit: np.ndarray) -> float:
    """Distance along one constant at which the gain has fallen by about one."""
    step = FIRST_STEP
    for _ in range(STEPS):
        fallen = top - (gain(at + step * unit) + gain(at - step * unit)) / 2
        if FALLEN[0] < fallen < FALLEN[1]:
            break
        step = float(np.clip(step / np.sqrt(max(fallen, 1e-2)), LEAST_STEP, MOST_STEP))
    return step


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
        axes = np.array([term.parts[place][1] // factor.each for term in form.terms()])
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
        return _highest_of_one(lambda ln: _gain(with_axes(of_these, ln), projection), begin)

    begin, columns = float(np.log(form.constants[number])), responses.columns(form)
    alone = _gain(columns, projection)
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


def _gain(columns: np.ndarray, projection: Projection) -> float:
    return float(np.sum((seen_basis(columns, projection).T @ projection.residual) ** 2))
