"""Segments with the samples before and after them, on which a denoiser is trained and its closure computed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tinygc.closure import residual
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch
from tinygc.models.denoiser import REACH, DenoisedNet

#: number of segments, and of stills, that is enough for 56 weights an axis (benchmarks/whole_process.py)
ENOUGH = 400
#: samples at rest used for the noise, an hour of them: of longer rests the first samples of each, and never fewer than a few seconds
MOST_AT_REST, FEWEST_OF_EACH = 1 << 20, 1 << 10


@dataclass(frozen=True, eq=False)
class Material:
    """Training data: batch and sigma as for the calibration; context (S, REACH + T + REACH, 3) rad/s, the measured rates of the batch with
    their surroundings; counts (S,) samples of each segment; stills: measured rates (n, 3) of each; rate_hz."""

    batch: Batch
    sigma: np.ndarray
    context: np.ndarray
    counts: np.ndarray
    stills: list[np.ndarray]
    rate_hz: float

    @property
    def stretches(self) -> list[np.ndarray]:
        """Return the measured rates (n, 3) of each segment, with its surroundings."""
        return [rate[: 2 * REACH + count] for rate, count in zip(self.context, self.counts, strict=True)]

    def pick(self, which: np.ndarray) -> Material:
        """Select segments by index or mask; the stills, which only show noise, stay."""
        return replace(self, batch=self.batch.pick(which), sigma=self.sigma[which], context=self.context[which], counts=self.counts[which])

    def enough(self) -> Material:
        """Return a sufficient subset: segments and stills spaced evenly over the session."""
        every, apart = (-(-len(each) // ENOUGH) for each in (self.counts, self.stills))
        if every <= 1 and apart <= 1:
            return self
        return replace(self.pick(np.arange(0, len(self.counts), max(every, 1))), stills=self.stills[:: max(apart, 1)])

    def rate(self, model: DenoisedNet) -> np.ndarray:
        """Return the whole net's rates (S, T, 3) rad/s of the segments, each corrected for the delay."""
        return model.undelayed(self.context)[:, REACH : REACH + self.batch.rate.shape[1]]


def of_problem(problem: Problem) -> Material:
    """Take the accepted segments of a session in their logs; beyond a log's ends the end values are repeated."""
    longest = problem.batch.rate.shape[1]
    context = np.empty((len(problem.batch), longest + 2 * REACH, 3))
    for row, segment in zip(context, problem.used, strict=True):
        gyro = problem.logs[segment.log].samples.gyro
        row[:] = gyro[np.clip(np.arange(segment.start - REACH, segment.start + longest + REACH), 0, len(gyro) - 1)]
    counts = np.array([segment.stop - segment.start for segment in problem.used])
    stills = [(log.samples.gyro, still) for log in problem.logs for still in log.stills if still.problem is None]
    each = max(MOST_AT_REST // max(len(stills), 1), FEWEST_OF_EACH)
    long = sum(still.stop - still.start for _, still in stills) > MOST_AT_REST
    at_rest = [gyro[still.start : min(still.stop, still.start + each) if long else still.stop] for gyro, still in stills]
    period_s = float(np.median([log.samples.period_s for log in problem.logs]))
    return Material(problem.batch, problem.floor.sigma, context, counts, at_rest, 1 / period_s)


def denoised_angles(material: Material, model: DenoisedNet, integrator: str = "exact") -> np.ndarray:
    """Return error angles (S, d) rad of the whole net, corrected for its delay."""
    return residual.error_angles(residual.segment_residuals(material.batch, material.rate(model), integrator))
