"""What a denoiser learns from: segments with what came before and after them, and the stills."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tinygc.closure.residual import Batch
from tinygc.models.denoiser import DILATIONS, KERNEL, DenoisedNet
from tinygc.problem.problem import Problem

REACH = (KERNEL - 1) * sum(DILATIONS)
#: segments, and stills, that tell 56 weights an axis all that they need (benchmarks/long_sessions.py)
ENOUGH = 400
#: samples at rest that show the noise, an hour of them: of longer rests the first so many of each, and never fewer than a few seconds
MOST_AT_REST, FEWEST_OF_EACH = 1 << 20, 1 << 10


@dataclass(frozen=True, eq=False)
class Material:
    """batch and sigma as for the calibration; context (S, REACH + T + REACH, 3) rad/s, the measured rates of the batch with their
    surroundings; counts (S,) samples of each segment; stills: measured rates (n, 3) of each; rate_hz; held: whether the surroundings
    are not measured, but the ends held."""

    batch: Batch
    sigma: np.ndarray
    context: np.ndarray
    counts: np.ndarray
    stills: list[np.ndarray]
    rate_hz: float
    held: bool = False

    @property
    def stretches(self) -> list[np.ndarray]:
        """Measured rates (n, 3) of each segment, with its surroundings where they are measured."""
        if self.held:
            return [rate[:count] for rate, count in zip(self.batch.rate, self.counts, strict=True)]
        return [rate[: 2 * REACH + count] for rate, count in zip(self.context, self.counts, strict=True)]

    def pick(self, which: np.ndarray) -> Material:
        """Some of the segments, by index or mask; the stills, which only show noise, stay."""
        return replace(self, batch=self.batch.pick(which), sigma=self.sigma[which], context=self.context[which], counts=self.counts[which])

    def enough(self) -> Material:
        """What a denoiser learns as much from: of many segments and stills every so many, evenly over the session."""
        every, apart = (-(-len(each) // ENOUGH) for each in (self.counts, self.stills))
        if every <= 1 and apart <= 1:
            return self
        return replace(self.pick(np.arange(0, len(self.counts), max(every, 1))), stills=self.stills[:: max(apart, 1)])

    def rate(self, model: DenoisedNet) -> np.ndarray:
        """What the whole net makes of the segments, (S, T, 3) rad/s, each answer at the sample that it belongs to."""
        return model.undelayed(self.context)[:, REACH : REACH + self.batch.rate.shape[1]]


def of_problem(problem: Problem) -> Material:
    """The accepted segments of a session in their logs; beyond a log's ends the rate stands."""
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


def of_batch(batch: Batch, sigma: np.ndarray, stills: list[np.ndarray]) -> Material:
    """Of a batch alone: before and after each segment the rate is taken to stand; stills: measured rates (n, 3) of each."""
    before, after = (np.repeat(batch.rate[:, end], REACH, axis=1) for end in (slice(0, 1), slice(-1, None)))
    counts = 1 + np.sum(batch.dt > 0, axis=1)
    context = np.concatenate([before, batch.rate, after], axis=1)
    return Material(batch, sigma, context, counts, stills, float(1 / np.median(batch.dt[batch.dt > 0])), held=True)
