"""``fit --conditions``: the calibration net with conditions as a further method, validated on the same folds as the others."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from tinygc import closure
from tinygc.closure.least_squares import StillRates
from tinygc.closure.problem import Problem, conditions
from tinygc.closure.residual import Batch
from tinygc.estimation.network import TrainableNet, Training, train_second_order
from tinygc.estimation.options import FitOptions, MethodFit, Progress
from tinygc.models.conditions_net import ConditionsModel, ConditionsNet, inputs_of


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """Fit to all segments, then to all but each fold in turn, with ``options.conditions`` as inputs.

    Raises FitError where the log lacks such an input.
    """
    names = options.conditions
    known = conditions(problem)
    inputs = [inputs_of(log.samples, names, known) for log in problem.logs]
    batch = _padded(problem, inputs)
    rates = _still_inputs(problem, inputs) if options.still_rates else None
    sigma, start = problem.floor.sigma, ConditionsNet.identity(names)
    folds = min(options.folds, len(batch))

    def train(which: np.ndarray) -> Training:
        return train_second_order(batch.pick(which), sigma[which], still_rates=rates, integrator=options.integrator, start=start)

    began = time.perf_counter()
    trained = train(np.ones(len(batch), dtype=bool))
    seconds = time.perf_counter() - began
    progress(1, folds + 1)
    held_out, fold = np.zeros((len(batch), batch.angles)), np.arange(len(batch)) % folds
    for k in range(folds):
        held_out[fold == k] = _angles(batch.pick(fold == k), train(fold != k).net, options.integrator)
        progress(k + 2, folds + 1)
    assert isinstance(trained.net, ConditionsNet)  # training keeps the type
    model, notes = ConditionsModel(trained.net, known), {"tie": trained.tie, "loss": list(trained.loss)}
    return MethodFit("tinygc_conditions", model, _angles(batch, trained.net, options.integrator), held_out, seconds, notes)


def _angles(batch: Batch, net: TrainableNet, integrator: str) -> np.ndarray:
    return closure.error_angles(closure.segment_residuals(batch, net(batch.rate), integrator))


def _padded(problem: Problem, inputs: list[np.ndarray]) -> Batch:
    """Return the problem's batch with the net's inputs in place of the measured rates; short segments are padded as there."""
    rate = np.empty((*problem.batch.rate.shape[:2], inputs[0].shape[1]))
    for row, segment in zip(rate, problem.used, strict=True):
        count = segment.stop - segment.start
        row[:count] = inputs[segment.log][segment.start : segment.stop]
        row[count:] = row[count - 1]
    return replace(problem.batch, rate=rate)


def _still_inputs(problem: Problem, inputs: list[np.ndarray]) -> StillRates:
    means = [
        rows[still.start : still.stop].mean(axis=0)
        for rows, log in zip(inputs, problem.logs, strict=True)
        for still in log.stills
        if still.problem is None
    ]
    return replace(problem.still_rates, rate=np.array(means))
