"""The method ``raw``: the rates as they were measured, which every other method must beat."""

from __future__ import annotations

from tinygc.closure.problem import Problem
from tinygc.estimation.held_out import Seen, held_out
from tinygc.estimation.options import FitOptions, MethodFit, Progress
from tinygc.models.linear import LinearModel, bias_only


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """Nothing is fitted."""
    return held_out("raw", _fit, problem, options, progress)


def _fit(seen: Seen) -> tuple[LinearModel, dict]:
    return bias_only(), {}
