"""A form's constants where its linear columns take up most, and how well that tells them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.alike import basis_of
from tinygc.discovery.screen.looks import Look
from tinygc.discovery.screen.responses import Responses
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.twin.whitening import Whitener

#: a constant is looked for up to so many times its value, where its neighbours on a grid are not known
REACH = 2.5
#: columns of one form that may be made, all in all, and those of each constant that are spread over its reach before
MOST_EVALUATIONS, SCANNED = 40, 9
#: those of a constant on which a few moments hang: with thirty turns its gain stands level over a fifteenth of it or so
DECIDED_SCANNED = 81
#: ln of a constant: a peak is found to this, which is a tenth of a sigma for constants that are known to a per cent
PRECISION = 1e-3
#: a curvature is taken where the gain has fallen by one, a sigma; how near is near enough, and steps towards it
FALLEN, STEPS = (0.3, 3.0), 5
#: ln of a constant: the first step, and those that are sensible
FIRST_STEP, LEAST_STEP, MOST_STEP = 0.02, 1e-5, 1.0


@dataclass(frozen=True, eq=False)
class Sharpened:
    """form with its best constants; gain: chi-square; constants_sigma: of each, in its unit, one sigma with all others free; inf where the
    gain does not tell."""

    form: Form
    gain: float
    constants_sigma: tuple[float, ...]


def sharpened(form: Form, whiten: Whitener, fit: Refit, replay: Replay, reach: float | np.ndarray = REACH) -> Sharpened:
    """Beside one hypothesis; reach (constants,): how far each may go, as a factor either way: to its neighbours on a grid."""
    return sharpened_in(form, Responses(replay), Look(replay.twin, whiten, fit), reach)


def sharpened_in(form: Form, responses: Responses, look: Look, reach: float | np.ndarray = REACH) -> Sharpened:
    """The same, of a look that is there already."""
    begin = np.log(form.constants)

    def gain(logs: np.ndarray) -> float:
        basis = basis_of(form.with_constants(np.exp(logs)), responses, look)
        return float(np.sum((basis.T @ look.residual) ** 2))

    if not len(begin):
        return Sharpened(form, gain(begin), ())
    scanned = DECIDED_SCANNED if any(factor.through.decided for factor in form.factors) else SCANNED
    at = _highest(gain, begin, np.broadcast_to(np.log(reach), begin.shape), scanned)
    sigma = _sigmas(gain, at) * np.exp(at)
    return Sharpened(form.with_constants(np.exp(at)), gain(at), tuple(sigma.tolist()))


def _highest(gain: Callable[[np.ndarray], float], begin: np.ndarray, reach: np.ndarray, scanned: int) -> np.ndarray:
    """(constants,) ln: each is scanned over its reach, then all are followed uphill together."""
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
    """(constants,) ln: one sigma of each, where chi-square has risen by one, from the curvature there."""
    top, count = gain(at), len(at)
    steps = np.array([_step(gain, at, top, unit) for unit in np.eye(count)])
    moves = np.diag(steps)
    fallen = np.zeros((count, count))
    for i in range(count):
        fallen[i, i] = 2 * top - gain(at + moves[i]) - gain(at - moves[i])
        for j in range(i):
            corners = (gain(at + a * moves[i] + b * moves[j]) * a * b for a in (1, -1) for b in (1, -1))
            fallen[i, j] = fallen[j, i] = -sum(corners) / 4
    # In steps: chi-square rises by x' fallen x / 2.
    if np.linalg.eigvalsh(fallen)[0] <= 0:
        return np.full(count, np.inf)
    return np.sqrt(2 * np.diag(np.linalg.inv(fallen))) * steps


def _step(gain: Callable[[np.ndarray], float], at: np.ndarray, top: float, unit: np.ndarray) -> float:
    """How far along one constant the gain falls by one or so."""
    step = FIRST_STEP
    for _ in range(STEPS):
        fallen = top - (gain(at + step * unit) + gain(at - step * unit)) / 2
        if FALLEN[0] < fallen < FALLEN[1]:
            break
        step = float(np.clip(step / np.sqrt(max(fallen, 1e-2)), LEAST_STEP, MOST_STEP))
    return step
