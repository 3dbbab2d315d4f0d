"""The method ``pso``: particle swarm on the 12 linear parameters, with which the paper compares its net."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from session.base.progress import Steps, no_report
from session.base.units import DEG
from tinygc.closure import residual
from tinygc.closure.least_squares import Nearby
from tinygc.closure.problem import Problem
from tinygc.estimation.held_out import FitInput, held_out, report
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.models.linear import PRIOR_SIGMA, LinearModel

# Global-best swarm with Clerc and Kennedy's constriction (2002): v <- chi (v + c1 r1 (own best - x) + c2 r2 (swarm's best - x)).
# ``minimise`` is general; ``fit_pso`` gives it the residual that every method minimises, to second order about where a
# swarm begins (``Nearby``), and repeats the swarm until that is exact.  Integrating every sample would cost ten times as much.

#: of the swarm: particles, and the largest number of steps
PARTICLES, STEPS = 48, 500
#: with both attractions (Clerc and Kennedy, phi = 4.1)
CONSTRICTION, ATTRACTION = 0.7298, 1.49618
#: steps over which the best has improved by less than this, relative, at the end of a search: a swarm that begins around its best must
#: contract before it finds a better one
PATIENCE, TOLERANCE = 80, 1e-6
#: largest number of successive swarms; the box of each, as a share of the one before
LEGS, NEARER = 6, 0.05
#: half angles in sigmas: difference below which the quadratic closure equals the exact one
AS_SEEN = 1e-4
#: half-width of the box the swarm starts in: 5 % for each element of E, 2 dps for the bias
START_BOX = np.array([0.05] * 9 + [2 * DEG] * 3)


def minimise(
    cost: Callable[[np.ndarray], np.ndarray],
    centre: np.ndarray,
    half_width: np.ndarray,
    rng: np.random.Generator,
    progress: Steps = no_report,
) -> np.ndarray:
    """Return the best position (D,) found for ``cost``, which maps (P, D) to (P,), from a box around ``centre``."""
    shape = (PARTICLES, len(centre))
    x = centre + half_width * rng.uniform(-1, 1, shape)
    x[0] = centre
    v = half_width * rng.uniform(-0.5, 0.5, shape)
    own, own_cost = x.copy(), cost(x)
    history = []
    for step in range(STEPS):
        best = own[np.argmin(own_cost)]
        pull = rng.uniform(0, ATTRACTION / CONSTRICTION, (2, *shape))
        v = CONSTRICTION * (v + pull[0] * (own - x) + pull[1] * (best - x))
        x = x + v
        now = cost(x)
        better = now < own_cost
        own[better], own_cost[better] = x[better], now[better]
        history.append(own_cost.min())
        progress(step + 1, STEPS)
        if step > PATIENCE and history[-1 - PATIENCE] - history[-1] < TOLERANCE * history[-1]:
            break
    return own[np.argmin(own_cost)]


def search(
    nearby: Nearby,
    centre: LinearModel,
    sigma: np.ndarray,
    box: float,
    *,
    seed: int,
    prior: LinearModel | None = None,
    progress: Steps = no_report,
) -> tuple[LinearModel, Nearby]:
    """Find the swarm's best linear model from a box, in shares of ``START_BOX``, around a model ``centre``.

    The swarm uses the closure to second order about a model near it, ``nearby``.  If that is not accurate at its best model, it begins
    again there, in a box of a twentieth, until it is.  Returns the expansion as well in which the model was found.
    """
    batch, rng = nearby.batch, np.random.default_rng(seed)
    sigma = sigma.reshape(len(batch), -1)

    def cost(gathered: Callable[[np.ndarray], np.ndarray], vectors: np.ndarray) -> np.ndarray:
        total = gathered(vectors)
        if prior is not None:
            total = total + np.sum(((vectors - prior.vector) / PRIOR_SIGMA) ** 2, axis=1)
        return total

    for leg in range(LEGS):
        of_all, total = partial(report, progress, leg, LEGS), partial(cost, nearby.gathered((2 / sigma) ** 2))
        centre = LinearModel.from_vector(minimise(total, centre.vector, box * START_BOX, rng, progress=of_all))
        exact, seen = residual.segment_residuals(batch, centre(batch.rate)), nearby.residuals(centre.vector[None])[0]
        if np.abs((exact - seen) / sigma).max() < AS_SEEN:
            break
        nearby, box = Nearby.about(centre, batch), box * NEARER
    progress(1, 1)
    return centre, nearby


def run(problem: Problem, options: FitOptions, progress: Steps, before: dict[str, MethodFit]) -> MethodFit:
    """Fit E and B; the result depends only on the data and ``options.seed``."""
    return held_out("pso", _SwarmFits(), problem, options, progress)


class _SwarmFits:
    """The fit to all segments, then to folds of them: the swarm of a fold begins around the optimum of the whole, which is near."""

    nearby: Nearby | None = None

    def __call__(self, seen: FitInput) -> tuple[LinearModel, dict]:
        # There may be only a few turns of known angle; a swarm would drift along unobserved directions.
        prior = None if seen.batch.turns is None else seen.start
        how: dict[str, Any] = {"seed": seen.options.seed, "prior": prior, "progress": seen.progress}
        if self.nearby is None or not isinstance(seen.whole, LinearModel) or seen.among is None:
            model, self.nearby = search(Nearby.about(seen.start, seen.batch), seen.start, seen.sigma, 1.0, **how)
            return model, {}
        nearby = self.nearby.pick(seen.among)
        if not seen.same:
            nearby = nearby.with_references(seen.batch)
        return search(nearby, seen.whole, seen.sigma, NEARER, **how)[0], {}
