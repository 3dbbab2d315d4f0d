"""The method ``pso``: the paper's rival, a particle swarm on the 12 linear parameters (``tinygc/methods/pso.py``)."""

from __future__ import annotations

from typing import cast

from tinygc.methods.held_out import Seen, held_out
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.methods.pso import fit_pso
from tinygc.methods.registry import Progress
from tinygc.models.linear import LinearModel
from tinygc.problem.problem import Problem


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """E and B; the same answer for the same ``options.seed``."""
    # The swarm's windows are exact, and so it is judged.
    return held_out("pso", _fit, problem, options, progress, integrator="exact")


def _fit(seen: Seen) -> tuple[LinearModel, dict]:
    # A fold's optimum is near the whole's: its swarm starts in a twentieth of the box, around it, and still converges by itself.
    around, box = (seen.start, 1.0) if seen.whole is None else (cast(LinearModel, seen.whole), 0.05)
    # A few turns of known angle may be all there is; a swarm would wander along what they do not show.
    prior = None if seen.batch.turns is None else seen.start
    options, rates = seen.options, seen.still_rates
    model = fit_pso(seen.batch, seen.sigma, around, seed=options.seed, still_rates=rates, box=box, prior=prior, progress=seen.progress)
    return model, {}
