"""What products of factors do to the channels: the columns of all forms at once, as ``Twin.effect_columns`` makes those of one effect.

A product's rate, added to an axis, moves the closure of a segment by the sum over its samples of sensitivity times product, the mean rate
of a still by its mean there, and no length of gravity.  Sums over all forms are single precision, which is enough to rank by: they are
right to some 1e-6 of the largest, where ``selection.UNSEEN`` leaves out what is below 1e-4 (tests/test_discovery_screen.py: gains to 1e-3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.plan import planned
from tinygc.discovery.screen.values import Values
from tinygc.explanation.twin.replay import Replay


@dataclass(frozen=True, eq=False)
class Block:
    """Responses of a hub's components times partners' components: closure (S, d, 3, H, K), the third the axis that is added to; still
    (Q, H, K), which is the same for whatever axis."""

    closure: np.ndarray
    still: np.ndarray


class Responses:
    """Of one replay; segments, stills: numbers of those that are looked at, all where None; values: of the replay, where they are known."""

    def __init__(self, replay: Replay, segments: np.ndarray | None = None, stills: np.ndarray | None = None, values: Values | None = None):
        twin = self.twin = replay.twin
        self.values = Values(replay) if values is None else values
        self.angles = twin.batch.angles
        self.segments = np.arange(len(twin.segments)) if segments is None else segments
        self.stills = np.arange(len(twin.stills)) if stills is None else stills
        starts = np.concatenate([[0], np.cumsum([len(movement.t_s) for movement in twin.movements])])
        self._turns, self._sensitivity, self._rests, self._weights = [], [], [], []
        for number in self.segments:
            segment = twin.segments[number]
            count, begin = segment.stop - segment.start, starts[segment.log] + segment.start
            self._turns.append(slice(begin, begin + count))
            # -: of what is corrected, as the twin has it
            turn = -replay.sensitivity[number, :count].reshape(count, -1).T
            self._sensitivity.append(np.ascontiguousarray(turn))
        for number in self.stills:
            log, still = twin.stills[number]
            begin = starts[log] + still.start
            counts = twin.counts(log)
            weight = np.ones(still.stop - still.start) if counts is None else counts[still.start : still.stop]
            self._rests.append(slice(begin, begin + still.stop - still.start))
            self._weights.append(-weight / weight.sum())
        self._single = [each.astype(np.float32) for each in self._sensitivity], [each.astype(np.float32) for each in self._weights]

    @property
    def channels(self) -> int:
        """Rows of the stacked channels that are looked at."""
        return len(self.segments) * self.angles + 4 * len(self.stills)

    def block(self, hub: np.ndarray, partners: np.ndarray) -> Block:
        """Of every product of hub (H, N) and partners (K, N), in their precision."""
        sensitivity, weights = self._single if partners.dtype == np.float32 else (self._sensitivity, self._weights)
        closure = np.empty((len(self._turns), 3 * self.angles * len(hub), len(partners)), dtype=partners.dtype)
        for row, rows, turn in zip(closure, self._turns, sensitivity, strict=True):
            own = (turn[:, None] * hub[None, :, rows]).reshape(-1, turn.shape[1])
            np.matmul(own, partners[:, rows].T, out=row)
        still = np.empty((len(self._rests), len(hub), len(partners)), dtype=partners.dtype)
        for row, rows, weight in zip(still, self._rests, weights, strict=True):
            np.matmul(hub[:, rows] * weight, partners[:, rows].T, out=row)
        return Block(closure.reshape(-1, self.angles, 3, len(hub), len(partners)), still)

    def columns(self, form: Form) -> np.ndarray:
        """(n, P) stacked, in double precision, of one form."""
        plan = planned([form])
        (wiring,) = plan.wirings
        block = self.block(*(self.values.of(plan.factors[which[0]]) for which in (plan.hub, plan.partner)))
        s, q = len(self.segments), len(self.stills)
        closure = block.closure[:, :, wiring.axis, wiring.hub, wiring.partner].reshape(s * self.angles, wiring.size)
        still = np.zeros((q, 3, wiring.size))
        still[:, wiring.axis, np.arange(wiring.size)] = block.still[:, wiring.hub, wiring.partner]
        return np.concatenate([closure, still.reshape(3 * q, wiring.size), np.zeros((q, wiring.size))])
