"""How many samples were lost each time, where hardly a turn is without a loss: each count with the linear model that suits it best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.common.errors import CalibrationError
from tinygc import closure
from tinygc.closure.least_squares import fit_least_squares
from tinygc.explanation.mends.events import Event
from tinygc.explanation.mends.trial import LONGEST_LOSS_S, lowest
from tinygc.problem.problem import Problem


def common_count(problem: Problem, losses: list[Event]) -> int:
    """Samples missing after each of the events, the same for all, by the closure of all segments.

    For this search a loss is one long step.
    """
    batch, sigma = problem.batch, problem.floor.sigma
    steps = [
        [e.row - segment.start for e in losses if e.log == segment.log and segment.start <= e.row < segment.stop - 1]
        for segment in problem.used
    ]
    period_s = float(np.median([log.samples.period_s for log in problem.session.logs]))

    def cost(count: int) -> float:
        dt = batch.dt.copy()
        for row, inside in zip(dt, steps, strict=True):
            row[inside] += count * period_s
        trial = replace(batch, dt=dt)
        try:  # an absurd count has no model
            fitted = fit_least_squares(trial, sigma, problem.first).model
        except CalibrationError:
            return np.inf
        angles = closure.error_angles(closure.segment_residuals(trial, fitted(trial.rate)))
        return float(np.sum((angles / sigma) ** 2))

    return lowest(cost, round(LONGEST_LOSS_S / period_s)) if any(steps) else 0
