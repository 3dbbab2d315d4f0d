"""A calibration over several days: one matrix for all, a bias for each log."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tinygc.closure import residual
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch, RateMap
from tinygc.inference.solve import solve

# A calibration over several days: one E for all, a bias for each log, and the spread of the biases.
#
# E is stable, the bias is not.  A single bias for logs of several days distorts E (on the EuRoC windows by 0.4 %).  Here each log has a
# bias of its own, E is common, and the stored bias is the logs' median: an outlying day affects neither.  Weights by
# distance make a squared loss a sum of distances (Weiszfeld 1937), in which outlying segments, or days, have less weight.

#: iterations of the weights by distance, each with Gauss-Newton steps of three nearly linear parameters
PASSES = 25
STEPS = 3
#: below this share of the median distance a segment's weight grows no further
LEAST = 0.05


@dataclass(frozen=True, eq=False)
class Levelled:
    """Segments with the bias of each log shifted to the median: batch, its sigma (S, d) rad with the distances' weights; offsets (L, 3)
    rad/s of each log's bias from the median, NaN where a log has too few segments; sigma_rps (3,) their spread."""

    batch: Batch
    sigma: np.ndarray
    offsets: np.ndarray
    sigma_rps: np.ndarray


def level_days(problem: Problem) -> Levelled:
    """Estimate each log's bias together with the linear model, and subtract its difference from the median from its segments."""
    owner = np.array([segment.log for segment in problem.used])
    batch, sigma, model = problem.batch, problem.floor.sigma, problem.first
    offsets = np.zeros((len(problem.logs), 3))
    for _ in range(PASSES):
        offsets = _bias_by_log(problem, model, sigma)
        offsets = offsets - np.nanmedian(offsets, axis=0)
        # A log's bias difference is subtracted like the Earth's rate: this works for any model, and leaves its input unchanged.
        each = np.nan_to_num(offsets)[owner]
        batch = replace(problem.batch, earth=problem.batch.earth - each[:, None])
        model = fit_least_squares(batch, sigma, model).model
        # Factors (S,) on the segments' sigmas that make a squared loss a sum of distances at the model.
        distance = np.linalg.norm(residual.segment_residuals(batch, model(batch.rate)), axis=1)
        typical = max(float(np.median(distance)), 1e-12)
        sigma = problem.floor.sigma * np.sqrt(np.maximum(distance / typical, LEAST))[:, None]
    known = offsets[np.isfinite(offsets).all(axis=1)]
    return Levelled(batch, sigma, offsets, np.sqrt(np.sum(known**2, axis=0) / max(len(known) - 1, 1)))


def _bias_by_log(problem: Problem, model: RateMap, sigma: np.ndarray | None = None) -> np.ndarray:
    """Estimate (L, 3) rad/s to add to a model's calibrated rate for the best closure of each log, NaN where not determined."""
    sigma = problem.floor.sigma if sigma is None else sigma
    changes = np.full((len(problem.logs), 3), np.nan)
    owner = np.array([segment.log for segment in problem.used])
    for log in range(len(changes)):
        batch = problem.batch.pick(owner == log)
        if len(batch) < 2:
            continue
        weight, rate = 1 / sigma[owner == log][..., None], np.asarray(model(batch.rate))
        columns = residual.sensitivity(batch, rate)[:, :, : batch.angles].sum(axis=1)
        changes[log] = 0
        for _ in range(STEPS):
            angles = 2 * residual.segment_residuals(batch, rate + changes[log])[..., None]
            changes[log] -= solve((columns * weight).reshape(-1, 3), (angles * weight).ravel()).value
    return changes
