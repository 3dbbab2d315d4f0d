"""The method ``pso``: the paper's rival, a particle swarm on the 12 linear parameters (``tinygc/methods/pso.py``)."""

from __future__ import annotations

import numpy as np

from tinygc.closure.nearby import Nearby
from tinygc.methods.held_out import Seen, held_out
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.methods.pso import fit_pso, near_best
from tinygc.methods.registry import Progress
from tinygc.models.linear import LinearModel
from tinygc.problem.problem import Problem


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """E and B; the same answer for the same ``options.seed``."""
    # What a swarm sees of the closure is exact, and so it is judged.
    return held_out("pso", _Fits(), problem, options, progress, integrator="exact")


class _Fits:
    """The fit to all segments, then to folds of them: a fold's optimum is near the whole's, its swarm begins around it."""

    nearby: Nearby | None = None

    def __call__(self, seen: Seen) -> tuple[LinearModel, dict]:
        options, rates = seen.options, seen.still_rates
        # A few turns of known angle may be all there is; a swarm would wander along what they do not show.
        prior = None if seen.batch.turns is None else seen.start
        if self.nearby is None or seen.whole is None or seen.among is None:
            model = fit_pso(seen.batch, seen.sigma, seen.start, seed=options.seed, still_rates=rates, prior=prior, progress=seen.progress)
            self.nearby = Nearby.about(model, seen.batch)
            return model, {}
        rng = np.random.default_rng(options.seed)
        nearby = self.nearby.pick(seen.among)
        if not seen.same:
            nearby = nearby.with_references(seen.batch)
        return near_best(nearby, seen.sigma, rng, still_rates=rates, prior=prior, progress=seen.progress), {}
