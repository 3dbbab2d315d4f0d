"""The method ``least_squares``: Gauss-Newton on the closure, 12 parameters (``tinygc/closure/least_squares.py``)."""

from __future__ import annotations

from tinygc.closure.least_squares import fit_least_squares
from tinygc.methods.held_out import Seen, held_out
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.methods.registry import Progress
from tinygc.models.linear import LinearModel
from tinygc.problem.problem import Problem


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """E and B.  Raises FitError where the search does not settle."""
    return held_out("least_squares", _fit, problem, options, progress)


def _fit(seen: Seen) -> tuple[LinearModel, dict]:
    options, rest = seen.options, seen.rest_rps
    rates = seen.still_rates if rest is None else None  # the stills are in the readings already
    fit = fit_least_squares(seen.batch, seen.sigma, seen.start, still_rates=rates, integrator=options.integrator, rest_rps=rest)
    return fit.model, {"steps": fit.steps, "unobserved": list(fit.unobserved)}
