"""The method ``raw_bias_removed``: the measured rates less what the first still shows, as many programs do at switch-on."""

from __future__ import annotations

from tinygc.closure.problem import Problem
from tinygc.estimation.held_out import Seen, held_out
from tinygc.estimation.options import FitOptions, MethodFit, Progress
from tinygc.models.linear import LinearModel


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """Three numbers, from the first still alone."""
    return held_out("raw_bias_removed", _fit, problem, options, progress)


def _fit(seen: Seen) -> tuple[LinearModel, dict]:
    return seen.start, {}
