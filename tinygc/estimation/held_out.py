"""Run a method on all segments, then on all but each fold, for its closure on held-out segments."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from session.base.progress import Steps, no_report
from tinygc.closure.least_squares import GaussianPrior, naming_segments
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch, closure_angles
from tinygc.estimation.options import METHODS, FitOptions, MethodFit
from tinygc.models.linear import LinearModel, bias_only
from tinygc.models.model import Model

# Run a method by its name.  All minimise the same residual on the same segments, and all return a model from measured to calibrated rates.


def run_method(
    name: str,
    problem: Problem,
    options: FitOptions,
    progress: Steps = no_report,
    before: dict[str, MethodFit] | None = None,
) -> MethodFit:
    """Fit to all segments, and to all but each fold in turn; ``before``: the methods fitted already, which a method may build upon.

    Raises ValueError for a name that is no method, or not one that is fitted by itself, and FitError where the fit does not converge.
    """
    if name not in METHODS:
        raise ValueError(f"method is {name!r}, expected one of {', '.join(METHODS)}")
    if (where := METHODS[name].function) is None:
        raise ValueError(f"{name} is fitted with the physics (FitOptions.physics), not by itself")
    module, _, function = where.partition(":")
    return getattr(importlib.import_module(module), function)(problem, options, progress, before or {})


# Fit to all segments, then to all but each fold in turn, for the closure on held-out segments.


@dataclass(frozen=True, eq=False)
class FitInput:
    """Input of one fit: some of the segments, or all.

    batch of S segments; sigma (S, d) rad; start: the model that removes the first still's bias; whole:
    the model fitted to all segments, for a fold; among (S all,) bool: the segments of a fold; same: whether their references are
    those of the fit to all; rest_rps: the bias (3,) rad/s from the stills, where it is not fitted;
    prior: of the problem.
    """

    batch: Batch
    sigma: np.ndarray
    options: FitOptions
    start: LinearModel
    progress: Steps
    whole: Model | None = None
    among: np.ndarray | None = None
    same: bool = True
    rest_rps: np.ndarray | None = None
    prior: GaussianPrior | None = None

    def fold(self, batch: Batch, seen: np.ndarray, whole: Model, progress: Steps, same_rates: bool = True) -> FitInput:
        """Select the segments of a batch of all where ``seen`` (S,) is set; same_rates: whether its readings are those
        of the fit to all, whose work may be used."""
        same, among = same_rates and batch is self.batch, seen if same_rates else None
        return replace(self, batch=batch.pick(seen), sigma=self.sigma[seen], whole=whole, among=among, same=same, progress=progress)


def _input(problem: Problem, options: FitOptions, progress: Steps) -> FitInput:
    return FitInput(
        batch=problem.batch,
        sigma=problem.floor.sigma,
        options=options,
        # A session with a further reference may never rest: then the bias that closes it replaces the first still's.
        start=bias_only(problem.still_rates.rate[0] if len(problem.still_rates.rate) else -problem.first.B),
        progress=progress,
        rest_rps=problem.rest_rps,
        prior=problem.prior,
    )


#: a model, and notes on how it was found
FitOnce = Callable[[FitInput], tuple[Model, dict]]


def held_out(name: str, fit: FitOnce, problem: Problem, options: FitOptions, progress: Steps) -> MethodFit:
    """Run ``fit`` as the method of that name."""
    batch = problem.batch
    folds = min(options.folds, len(batch))
    steps = folds + 1
    everything = _input(problem, options, lambda done, of: progress(done, of * steps))
    began = time.perf_counter()
    with naming_segments(problem.used):
        model, notes = fit(everything)
    seconds = time.perf_counter() - began
    angles, models = np.zeros((len(batch), batch.angles)), []
    fold = np.arange(len(batch)) % folds
    for k in range(folds):
        seen = fold != k
        own = problem.folds[k] if problem.folds else problem
        # The accelerometer, too, is estimated without the held-out turns.
        apart = own.batch if own.joint is None else own.joint.without(~seen, own.batch)
        of_all = _input(own, options, progress) if problem.folds else everything
        with naming_segments([segment for segment, kept in zip(problem.used, seen, strict=True) if kept]):
            part, _ = fit(of_all.fold(apart, seen, model, partial(report, progress, k + 1, steps), same_rates=not problem.folds))
        models.append(part)
        angles[~seen] = closure_angles(apart.pick(~seen), part)
    progress(steps, steps)
    return MethodFit(name, model, closure_angles(batch, model), angles, seconds, notes, tuple(models))


def report(progress: Steps, before: int, steps: int, done: int, of: int) -> None:
    """Report progress after ``before`` of the ``steps``, with ``done`` of ``of`` in the current one."""
    progress(before * of + done, of * steps)
