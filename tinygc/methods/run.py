"""Run a method by its name.  All minimise the same residual on the same segments, and all give a model: measured rates in, rates out."""

from __future__ import annotations

import importlib

from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.methods.registry import METHODS, Progress
from tinygc.problem.problem import Problem


def run_method(
    name: str,
    problem: Problem,
    options: FitOptions,
    progress: Progress = lambda done, of: None,
    before: dict[str, MethodFit] | None = None,
) -> MethodFit:
    """Fit to all segments, and to all but each fold in turn; ``before``: what was fitted already, of use to what builds upon it.

    Raises ValueError for a name that is no method, or not one that is fitted by itself, and FitError where the fit does not settle.
    """
    if name not in METHODS:
        raise ValueError(f"method is {name!r}, expected one of {', '.join(METHODS)}")
    module = METHODS[name].module
    if module is None:
        raise ValueError(f"{name} is fitted with the physics (FitOptions.physics), not by itself")
    return importlib.import_module(module).run(problem, options, progress, before or {})
