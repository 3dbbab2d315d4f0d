"""A calibration over several days: one E for all, a bias for each log, and how far the next day's may be.

E lasts, the bias does not.  A single bias for logs of several days bends E towards whatever mixes with it (on the EuRoC windows by 0.4 %).
Here each log has a bias of its own, E is common, and the stored bias is the logs' median: the day that is unlike the others pulls on
neither.  Weights follow the distances, as in ``distance_loss.py``, for the same reason.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tinygc import closure
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import Batch, RateMap
from tinygc.methods.network.distance_loss import distance_weights
from tinygc.problem.problem import Problem

#: iterations, not bars: of weights by distance; Gauss-Newton steps of three numbers, nearly linear
PASSES = 25
STEPS = 3


@dataclass(frozen=True, eq=False)
class Levelled:
    """Segments as if all logs had the bias of the middle one: batch, its sigma (S, d) rad with the distances' weights; offsets (L, 3) rad/s
    of each log's bias from the middle one's, NaN where a log has too few segments; sigma_rps (3,) their spread."""

    batch: Batch
    sigma: np.ndarray
    offsets: np.ndarray
    sigma_rps: np.ndarray


def level_days(problem: Problem) -> Levelled:
    """Find each log's bias together with the linear model, and take the difference from the median off its segments."""
    owner = np.array([segment.log for segment in problem.used])
    batch, sigma, model = problem.batch, problem.floor.sigma, problem.first
    offsets = np.zeros((len(problem.logs), 3))
    for _ in range(PASSES):
        offsets = bias_by_log(problem, model, sigma)
        offsets = offsets - np.nanmedian(offsets, axis=0)
        # What a log's calibrated rate lacks is taken off as the Earth's rate is: for any model, without touching what it is given.
        each = np.nan_to_num(offsets)[owner]
        batch = replace(problem.batch, earth=problem.batch.earth - each[:, None])
        model = fit_least_squares(batch, sigma, model).model
        sigma = problem.floor.sigma * distance_weights(batch, model)[:, None]
    known = offsets[np.isfinite(offsets).all(axis=1)]
    return Levelled(batch, sigma, offsets, np.sqrt(np.sum(known**2, axis=0) / max(len(known) - 1, 1)))


def levelled(problem: Problem) -> tuple[Problem, np.ndarray]:
    """The problem with each log's bias levelled, for any method to be fitted to, and the biases' spread (3,) rad/s."""
    days = level_days(problem)
    factor = (days.sigma / problem.floor.sigma)[:, 0]
    own, shared = problem.floor.own * factor[:, None, None] ** 2, problem.floor.shared * (factor[:-1] * factor[1:])[:, None, None]
    floor = replace(problem.floor, own=own, shared=shared)
    return replace(problem, batch=days.batch, floor=floor), days.sigma_rps


def bias_by_log(problem: Problem, model: RateMap, sigma: np.ndarray | None = None) -> np.ndarray:
    """(L, 3) rad/s: what must be added to a model's calibrated rate for each log's segments to close best, NaN where a log has but one."""
    sigma = problem.floor.sigma if sigma is None else sigma
    changes = np.full((len(problem.logs), 3), np.nan)
    owner = np.array([segment.log for segment in problem.used])
    for log in range(len(changes)):
        batch = problem.batch.pick(owner == log)
        if len(batch) < 2:
            continue
        weight, rate = 1 / sigma[owner == log][..., None], np.asarray(model(batch.rate))
        columns = closure.sensitivity(batch, rate)[:, :, : batch.angles].sum(axis=1)
        changes[log] = 0
        for _ in range(STEPS):
            angles = 2 * closure.segment_residuals(batch, rate + changes[log])[..., None]
            changes[log] -= np.linalg.lstsq((columns * weight).reshape(-1, 3), (angles * weight).ravel(), rcond=None)[0]
    return changes
