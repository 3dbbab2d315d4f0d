"""The method ``raw``: the rates as they were measured, which every other method must beat."""

from __future__ import annotations

from tinygc.methods.held_out import Seen, held_out
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.methods.registry import Progress
from tinygc.models.linear import LinearModel, bias_only
from tinygc.problem.problem import Problem


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """Nothing is fitted."""
    return held_out("raw", _fit, problem, options, progress)


def _fit(seen: Seen) -> tuple[LinearModel, dict]:
    return bias_only(), {}
