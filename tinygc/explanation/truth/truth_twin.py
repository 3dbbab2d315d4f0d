"""The twin of a recording beside a truth file: the closure between moments of truth alone, and the truth's clock among what it replays.

Stills that such a recording may have are no rows of it: their attitudes come from truth and gyro together, and in a vehicle the zero at
rest is another than in motion (``zero_at_rest`` says by how much), so a fit of both would be one of neither.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.log.truth_reading import GIVEN
from tinygc.attitude import rotation
from tinygc.closure.floor import Floor, gyro_variance
from tinygc.closure.residual import Batch, attitudes
from tinygc.effects import Effect
from tinygc.explanation.truth.evidence import offset_columns
from tinygc.explanation.twin.state import Channels, State
from tinygc.explanation.twin.twin import Twin
from tinygc.problem.problem import Problem

#: of a clock that is set back; beyond, each is longer than two samples
MOST_STEPS = 100


class TruthTwin(Twin):
    """A problem between moments of truth, ready to be replayed.

    Its floor is the gyro's white noise alone: the truth's noise is a component, whose size the recording tells (``noise.truth``).
    """

    def __init__(self, problem: Problem):
        at = attitudes(problem.batch, problem.first(problem.batch.rate))
        own = gyro_variance(problem.batch, at, [problem.logs[segment.log].noise for segment in problem.used])
        own, wider = own[:, : problem.batch.angles, : problem.batch.angles], problem.floor.wider
        floor = Floor(own, np.zeros_like(problem.floor.shared))
        super().__init__(replace(problem, floor=floor if wider is None else floor.widened(wider)))
        alignment = problem.session.alignment
        self.clock_free = alignment is None or alignment.source["offset_s"] != GIVEN

    def batch_at(self, state: State) -> Batch:
        """The batch with the truth's attitudes as its clock has them, and the state's Earth."""
        batch = super().batch_at(state)
        for claim in state.claims:
            if claim.effect.kind == "truth":
                batch = self.later(batch, state, float(claim.theta[0]))
        return batch

    def later(self, batch: Batch, state: State, seconds: float) -> Batch:
        """The truth's attitudes are those of so many seconds later: each taken back along the calibrated rate, in steps of about a
        segment's sample, each with the rate of its half way."""
        period_s = float(np.median([self.problem.logs[s.log].samples.period_s for s in self.segments]))
        steps = min(int(np.ceil(abs(seconds) / (2 * period_s))), MOST_STEPS) or 1
        turned, step_s = [], seconds / steps
        for q, samples_at, earth in (
            (batch.start, [s.start for s in self.segments], batch.earth[:, 0]),
            (batch.end, [s.stop - 1 for s in self.segments], self._last_of(batch.earth)),
        ):
            for number in reversed(range(steps)):
                half_s = (number + 0.5) * step_s
                gyro = np.array([self._gyro(s.log, at, half_s) for s, at in zip(self.segments, samples_at, strict=True)])
                q = rotation.multiply(q, rotation.exp(-step_s * (state.model(gyro) - earth)))
            turned.append(q)
        return replace(batch, start=turned[0], end=turned[1])

    def _gyro(self, log: int, at: int, later_s: float) -> np.ndarray:
        """(3,) rad/s as it was read so long after a sample, straight between its neighbours."""
        samples = self.problem.logs[log].samples
        where = np.clip(at + later_s / samples.period_s, 0, len(samples) - 1.001)
        share, first = where % 1.0, int(where)
        return (1 - share) * samples.gyro[first] + share * samples.gyro[first + 1]

    def _last_of(self, values: np.ndarray) -> np.ndarray:
        """(S, 3) of each segment's last sample, of values (S, T, 3)."""
        last = np.sum(self.batch.dt > 0, axis=1)
        return np.take_along_axis(values, last[:, None, None], axis=1)[:, 0]

    def effect_columns(self, effect: Effect, state: State, sensitivity: np.ndarray, rates: list[np.ndarray]) -> Channels:
        """As every twin's; of the truth's clock, how the attitudes at both ends turn."""
        if effect.kind != "truth":
            return super().effect_columns(effect, state, sensitivity, rates)
        columns = offset_columns(self.batch_at(state), state.model)
        return Channels(columns[..., None], np.zeros((0, 3, 1)), np.zeros((0, 1)))
