"""How far one unmodelled effect may have moved the parameters, in addition to noise.

A calibration that leaves out an effect absorbs part of it: E by far more than the closure shows, since a scale that follows an effect
closes the turns that it was fitted to.  For each effect of the catalogue, alone, with parameters theta:

    residuals     r = -X theta + J p + noise           X, J: columns of the effect and of the calibration
    theta         given r, and a wide prior of the effect's plausible size: mean m, covariance V (Gauss)
    parameters    moved by -L X theta                   L: response of least squares to the channels' errors
    expected      square of that movement: L X (V + m m') X' L'

The noise is that of the fit, with its inflation: where something is missing, the recording allows larger effects.  An effect with a scanned
shape, such as the time of a step, is the mean over its values, each by its evidence.  Each parameter states the largest movement by any one
effect.  What no residual shows, such as a common clock rate, has its own term (``NominalRate``).

An effect is suspected by the evidence that ``explain`` has of it alone: with the noise estimated again for those that promise most by their
linear columns.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from session.base.numeric import sigmas_in
from tinygc.closure.problem import Problem
from tinygc.effects import Effect
from tinygc.estimation.stated_noise import StatedNoise, stated_response
from tinygc.inference.choose import AS_PROBABLE, SUSPECTED, penalty, promised
from tinygc.inference.solve import solve_lower
from tinygc.models.linear import MATRIX, NAMES, LinearModel
from tinygc.noise.refit import calibration_columns, candidates, prior_sigmas

#: effects of either ranking that are weighed with the noise estimated again
MOST_WEIGHED = 3
#: sigmas by which an effect of the zero alone may move a number of E: it adds 12 % to the sigma
HARMLESS = 0.5


@dataclass(frozen=True, eq=False)
class Systematic:
    """Movements of the 12 parameters (1, rad/s) by one effect that the recording still allows: by_effect: id -> (12, 12) mean of their
    squares and products.  tilts (S, 2, 12): derivative of the segments' tilt by the parameters.  log_odds: id -> natural logarithm of the
    odds that the recording gives the effect, alone, against none.  of_zero: ids of those that move the zero alone, and no number of E by
    more than ``HARMLESS`` of its sigmas: the fit's own drift of the bias has taken them up."""

    by_effect: dict[str, np.ndarray]
    tilts: np.ndarray
    log_odds: dict[str, float] = field(default_factory=dict)
    of_zero: frozenset[str] = frozenset()

    def of(self, slope: np.ndarray) -> np.ndarray:
        """(Q,) the largest movement, by one effect, of quantities with this derivative (Q, 12) by the parameters."""
        return np.sqrt(np.max([np.einsum("qi,ij,qj->q", slope, square, slope) for square in self.by_effect.values()], axis=0))

    @property
    def tilt_rms(self) -> float:
        """Rms tilt, rad, by which the moved parameters would miss turns like these if the effect were not there."""
        return float(np.sqrt(2 * np.mean(self.of(self.tilts.reshape(-1, len(NAMES))) ** 2)))

    @property
    def sigma(self) -> np.ndarray:
        """(12,) the largest movement of each parameter."""
        return self.of(np.eye(len(NAMES)))

    def to_json(self) -> dict:
        """Return ``systematic`` of ``tinygc-fit/2``."""
        ids = list(self.by_effect)
        most = np.argmax([np.diag(square) for square in self.by_effect.values()], axis=0)
        return {
            "parameters": list(NAMES),
            "sigma": self.sigma.tolist(),
            "effects": [ids[number] for number in most],
            "suspected": [{"id": name, "log_odds": self.log_odds[name]} for name in self.suspected],
        }

    @property
    def likeliest(self) -> list[str]:
        """Ids of the most probable effect and of those that the recording does not separate from it, within ``AS_PROBABLE``; none that it
        speaks against."""
        most = max(self.log_odds.values(), default=-np.inf)
        near = [name for name, odds in self.log_odds.items() if odds > max(0.0, most - AS_PROBABLE)]
        return sorted(near, key=lambda name: -self.log_odds[name])

    @property
    def log_odds_of_any(self) -> float:
        """Natural logarithm of the odds of any of the likeliest effects, against none; of the most probable one where the recording speaks
        against all."""
        odds = [self.log_odds[name] for name in self.likeliest] or [max(self.log_odds.values(), default=-np.inf)]
        return float(np.logaddexp.reduce(odds))

    @property
    def share_of_zero(self) -> float:
        """Share of the odds of any of the likeliest effects that those of the zero alone have."""
        odds = [self.log_odds[name] for name in self.likeliest if name in self.of_zero]
        return float(np.exp(np.logaddexp.reduce(odds) - self.log_odds_of_any)) if odds else 0.0

    @property
    def suspected(self) -> list[str]:
        """The likeliest effects, where one of them is probably missing from the model.  ``explain`` compares them properly."""
        return self.likeliest if self.log_odds_of_any > SUSPECTED else []


def systematic_of(problem: Problem, model: LinearModel, noise: StatedNoise, widened: float) -> Systematic:
    """Move the parameters by each effect of the catalogue; problem and model as fitted, widened: variance inflation of the fit."""
    twin = noise.twin
    start = twin.start()
    rates = twin.rates(start)
    sensitivity = twin.sensitivity(start, rates)
    factor = np.linalg.cholesky(widened * noise.covariance)
    linear = calibration_columns(twin, start, sensitivity) * prior_sigmas(twin, [])
    effects = candidates(twin)
    columns = [twin.effect_columns(effect, start, sensitivity, rates).stacked() for effect in effects]
    edges = np.cumsum([0, *(each.shape[1] for each in columns)])
    stacked = np.concatenate(columns, axis=1)
    rows = np.column_stack([stacked, twin.residuals(start, rates).stacked()])
    white, left = _left_of(solve_lower(factor, linear), solve_lower(factor, rows))
    response = stated_response(problem, model)
    moves, sigma = response @ stacked, sigmas_in(response @ (widened * noise.covariance) @ response.T)[MATRIX]
    found: dict[str, list[tuple[float, np.ndarray]]] = {}
    for effect, begin, end in zip(effects, edges[:-1], edges[1:], strict=True):
        own = slice(begin, end)
        information = white[:, own].T @ left[:, own] + np.eye(end - begin) / effect.parameter.plausible**2
        covariance = np.linalg.inv(information)
        mean = -covariance @ (left[:, own].T @ white[:, -1])
        square = moves[:, own] @ (covariance + np.outer(mean, mean)) @ moves[:, own].T
        # Evidence among the shapes of one effect: exp(mean' information mean / 2) / sqrt(det information).
        _, size = np.linalg.slogdet(information)
        found.setdefault(effect.id, []).append(((float(mean @ information @ mean) - size) / 2, square))
    tilts = twin.linear_columns(sensitivity).closure[:, :2]
    assert noise.first is not None  # of a recording
    first = np.linalg.cholesky(noise.first)
    looks = [_promises(effects, edges, *look) for look in ((white, left), _left_of(solve_lower(first, linear), solve_lower(first, rows)))]
    log_odds = {name: promise / 2 for name, (promise, _) in looks[0].items()}
    again: dict[str, float] = {}
    for number in dict.fromkeys(number for look in looks for _, number in sorted(look.values(), reverse=True)[:MOST_WEIGHED]):
        effect = effects[number]
        gain = noise.gain_of(columns[number] * effect.parameter.plausible)
        odds = (gain - penalty(columns[number].shape[1], len(found[effect.id]))) / 2
        again[effect.id] = max(odds, again.get(effect.id, -np.inf))  # the better of two shapes
    log_odds |= again
    by_effect = {name: _mean_by_evidence(values) for name, values in found.items()}
    drifts = {effect.id for effect in effects if effect.kind == "rate" and effect.inputs and set(effect.inputs) <= {"time", "temperature"}}
    of_zero = frozenset(name for name in drifts if (sigmas_in(by_effect[name])[MATRIX] <= HARMLESS * sigma).all())
    return Systematic(by_effect, tilts, log_odds, of_zero)


def _left_of(J: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whitened rows (n, k), and what a calibration with columns J (n, p), within its prior, cannot absorb of them."""
    return rows, rows - J @ np.linalg.solve(J.T @ J + np.eye(J.shape[1]), J.T @ rows)


def _promises(effects: Sequence[Effect], edges: np.ndarray, white: np.ndarray, left: np.ndarray) -> dict[str, tuple[float, int]]:
    """id -> twice the log odds by linear columns that the last of whitened rows gives an effect against none, at its best shape, and the
    number of that; left: as in ``_left_of``."""
    shapes = Counter(effect.id for effect in effects)
    best: dict[str, tuple[float, int]] = {}
    for number, effect in enumerate(effects):
        own, size = slice(*edges[number : number + 2]), edges[number + 1] - edges[number]
        information = white[:, own].T @ left[:, own] + np.eye(size) / effect.parameter.plausible**2
        pull = left[:, own].T @ white[:, -1]
        gain = float(pull @ np.linalg.solve(information, pull))
        promise = promised(gain, size) - penalty(size, shapes[effect.id])
        if effect.id not in best or promise > best[effect.id][0]:
            best[effect.id] = (promise, number)
    return best


def _mean_by_evidence(values: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """Mean of squares (12, 12), each weighted by its evidence, given as a logarithm."""
    weight = np.exp(np.array([evidence for evidence, _ in values]) - max(evidence for evidence, _ in values))
    return np.average([square for _, square in values], axis=0, weights=weight)
