"""The twin of a recording with a truth file: the closure between moments of truth, with the truth's clock and smoothing."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from session.base import rotation
from tinygc.closure.floor import Floor, gyro_variance
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch, RateMap, attitudes
from tinygc.effects import AppliedEffect, Effect
from tinygc.effects.signals import derivative
from tinygc.features.truth.errors import OFFSET, SMOOTHED_S, SMOOTHING, wander
from tinygc.features.truth.reading import GIVEN
from tinygc.noise.twin import Channels, State, Twin

# The twin of a recording with a truth file: the closure between moments of truth alone, with the truth's clock among its effects.
#
# Stills of such a recording are not rows of it.  Their attitudes are estimated from truth and gyro together, and in a vehicle the zero-rate
# level at rest differs from that in motion (``zero_at_rest`` measures it), so a joint fit would describe neither.

#: s: spacing of the knots of a slow bias; the evidence penalizes their number
WANDER_S = 20.0
#: times ``Parameter.plausible``: impossible for a gyroscope
IMPLAUSIBLE = 2.0
#: most steps in which a clock is set back; with more, each step is longer than two samples
MOST_STEPS = 100


class TruthTwin(Twin):
    """A problem between moments of truth, ready to be replayed.

    Its floor is the gyro's white noise alone: the truth's noise is a component, whose size is estimated from the recording.
    """

    def __init__(self, problem: Problem):
        at = attitudes(problem.batch, problem.first(problem.batch.rate))
        own = gyro_variance(problem.batch, at, [problem.logs[segment.log].noise for segment in problem.used])
        own, wider = own[:, : problem.batch.angles, : problem.batch.angles], problem.floor.wider
        floor = Floor(own, np.zeros_like(problem.floor.shared))
        super().__init__(replace(problem, floor=floor if wider is None else floor.widened(wider)))
        self.original = problem
        alignment = problem.session.reference.alignment
        self.clock = OFFSET if alignment is None or alignment.source["offset_s"] != GIVEN else None
        self.errors = OFFSET, SMOOTHING
        # A drifting bias, so that an unnamed drift is not taken for one of the catalogue's effects.
        duration, segments = float(problem.began_s[-1]), len(self.segments)
        self.slow = (wander(np.linspace(0, duration, max(3, min(round(duration / WANDER_S) + 1, segments // 6)))),)

    def is_impossible(self, claim: AppliedEffect) -> bool:
        """Whether the effect is larger than any gyroscope has, or a truth's smoothing that would sharpen."""
        theta = claim.theta
        return bool(np.abs(theta).max() > IMPLAUSIBLE * claim.effect.parameter.plausible or (claim.effect is SMOOTHING and theta[0] < 0))

    def batch_at(self, state: State) -> Batch:
        """The batch with the truth's attitudes corrected for its clock and its smoothing, and the state's Earth rate."""
        batch = super().batch_at(state)
        for claim in state.claims:
            if claim.effect.id == OFFSET.id:
                batch = self.later(batch, state, float(claim.theta[0]))
            elif claim.effect.id == SMOOTHING.id:
                start, end = (-float(claim.theta[0]) / 2 * change for change in self._changes)
                batch = replace(
                    batch,
                    start=rotation.multiply(batch.start, rotation.exp(start)),
                    end=rotation.multiply(batch.end, rotation.exp(end)),
                )
        return batch

    @cached_property
    def _changes(self) -> tuple[np.ndarray, np.ndarray]:
        """(S, 3) rad/s^2 at both ends of the segments."""
        by_log = [derivative(movement.rate, movement, SMOOTHED_S) for movement in self.movements]
        start, end = np.swapaxes([by_log[s.log][[s.start, s.stop - 1]] for s in self.segments], 0, 1)
        return start, end

    def later(self, batch: Batch, state: State, seconds: float) -> Batch:
        """Treat the truth's attitudes as those of ``seconds`` later: integrate each back along the calibrated rate, in steps of about two
        samples, each with the rate at its midpoint."""
        period_s = float(np.median([self.problem.logs[s.log].samples.period_s for s in self.segments]))
        steps = min(int(np.ceil(abs(seconds) / (2 * period_s))), MOST_STEPS) or 1
        turned, step_s = [], seconds / steps
        # (S, 3) of each segment's last sample, of values (S, T, 3).
        last = np.sum(self.batch.dt > 0, axis=1)
        for q, samples_at, earth in (
            (batch.start, [s.start for s in self.segments], batch.earth[:, 0]),
            (batch.end, [s.stop - 1 for s in self.segments], np.take_along_axis(batch.earth, last[:, None, None], axis=1)[:, 0]),
        ):
            for number in reversed(range(steps)):
                half_s = (number + 0.5) * step_s
                gyro = np.array([self._gyro(s.log, at, half_s) for s, at in zip(self.segments, samples_at, strict=True)])
                q = rotation.multiply(q, rotation.exp(-step_s * (state.model(gyro) - earth)))
            turned.append(q)
        return replace(batch, start=turned[0], end=turned[1])

    def _gyro(self, log: int, at: int, later_s: float) -> np.ndarray:
        """(3,) rad/s as read ``later_s`` after a sample, interpolated linearly."""
        samples = self.problem.logs[log].samples
        where = np.clip(at + later_s / samples.period_s, 0, len(samples) - 1.001)
        share, first = where % 1.0, int(where)
        return (1 - share) * samples.gyro[first] + share * samples.gyro[first + 1]

    def effect_columns(self, effect: Effect, state: State, sensitivity: np.ndarray, rates: list[np.ndarray]) -> Channels:
        """The columns of any twin; for the truth's clock and smoothing, the rotation of the attitudes at both ends."""
        if effect.kind != "reference":
            return super().effect_columns(effect, state, sensitivity, rates)
        batch = self.batch_at(state)
        if effect.id == OFFSET.id:
            columns = offset_columns(batch, state.model)
        else:
            ends = zip((batch.start, batch.end), self._changes, strict=True)
            start, end = (np.einsum("sij,sj->si", rotation.matrix(q), change) / 2 for q, change in ends)
            columns = end - start
        return Channels(columns[..., None], np.zeros((0, 3, 1)), np.zeros((0, 1)))


def offset_columns(batch: Batch, model: RateMap) -> np.ndarray:
    """(S, 3) rad/s: derivative of the residual with respect to the truth's clock offset.  Truth stamped s late shows the attitude of s
    earlier."""
    rate = model(batch.rate) - batch.earth
    counts = np.sum(batch.dt > 0, axis=1)
    last = np.take_along_axis(rate, counts[:, None, None], axis=1)[:, 0]
    ends = [np.einsum("sij,sj->si", rotation.matrix(q), w) for q, w in ((batch.start, rate[:, 0]), (batch.end, last))]
    # The truth's attitude is that at t + s: taken back to t, the start turns back by s w_start, and so does the end.
    return ends[1] - ends[0]
