"""Particle swarm on the 12 linear parameters: the paper's rival.  The whole swarm is one batch.

Global-best swarm with Clerc and Kennedy's constriction (2002): v <- chi (v + c1 r1 (own best - x) + c2 r2 (swarm's best - x)).
``minimise`` knows nothing of gyroscopes; ``fit_pso`` gives it the same residual that every method minimises.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from session.common.units import DEG
from tinygc.closure.preintegration import preintegrate
from tinygc.closure.residual import Batch
from tinygc.closure.still_rates import StillRates
from tinygc.models.linear import BIAS, MATRIX, PRIOR_SIGMA, LinearModel


@dataclass(frozen=True)
class SwarmOptions:
    """particles; steps at most; constriction 0.7298 with both attractions 1.496 (Clerc and Kennedy, phi = 4.1); the search stops
    when the best has improved by less than ``tolerance`` (relative) over ``patience`` steps."""

    particles: int = 48
    steps: int = 500
    constriction: float = 0.7298
    attraction: float = 1.49618
    patience: int = 40
    tolerance: float = 1e-6


#: half-width of the box the swarm starts in: 5 % for each element of E, 2 dps for the bias
START_BOX = np.array([0.05] * 9 + [2 * DEG] * 3)


def minimise(
    cost: Callable[[np.ndarray], np.ndarray],
    centre: np.ndarray,
    half_width: np.ndarray,
    rng: np.random.Generator,
    options: SwarmOptions | None = None,
    progress: Callable[[int, int], None] = lambda step, steps: None,
) -> np.ndarray:
    """Best position (D,) found for ``cost``, which takes (P, D) to (P,), from a box around ``centre``."""
    options = options or SwarmOptions()
    shape = (options.particles, len(centre))
    x = centre + half_width * rng.uniform(-1, 1, shape)
    x[0] = centre
    v = half_width * rng.uniform(-0.5, 0.5, shape)
    own, own_cost = x.copy(), cost(x)
    history = []
    for step in range(options.steps):
        best = own[np.argmin(own_cost)]
        pull = rng.uniform(0, options.attraction / options.constriction, (2, *shape))
        v = options.constriction * (v + pull[0] * (own - x) + pull[1] * (best - x))
        x = x + v
        now = cost(x)
        better = now < own_cost
        own[better], own_cost[better] = x[better], now[better]
        history.append(own_cost.min())
        progress(step + 1, options.steps)
        if step > options.patience and history[-1 - options.patience] - history[-1] < options.tolerance * history[-1]:
            break
    return own[np.argmin(own_cost)]


def fit_pso(
    batch: Batch,
    sigma: np.ndarray,
    start: LinearModel,
    *,
    seed: int,
    still_rates: StillRates | None = None,
    box: float = 1.0,
    prior: LinearModel | None = None,
    progress: Callable[[int, int], None] = lambda step, steps: None,
) -> LinearModel:
    """The swarm's best linear model; ``box`` shrinks the box it starts in (around ``start``).

    prior: where what no segment shows belongs, held as weakly as least squares holds it; None: nowhere.
    """
    windows = preintegrate(batch)
    weight = (2 / sigma.reshape(len(batch), -1)) ** 2

    def cost(vectors: np.ndarray) -> np.ndarray:
        E, B = vectors[:, MATRIX].reshape(-1, 3, 3), vectors[:, BIAS]
        total = np.sum(windows.residuals(E, B) ** 2 * weight, axis=(1, 2))
        if still_rates is not None:
            total = total + [np.sum(still_rates.residuals(LinearModel.from_vector(vector)) ** 2) for vector in vectors]
        if prior is not None:
            total = total + np.sum(((vectors - prior.vector) / PRIOR_SIGMA) ** 2, axis=1)
        return total

    best = minimise(cost, start.vector, box * START_BOX, np.random.default_rng(seed), progress=progress)
    return LinearModel.from_vector(best)
