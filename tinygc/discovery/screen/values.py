"""Values of factors over all samples of a recording, each quantity computed once."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tinygc.discovery.grammar.form import Factor
from tinygc.discovery.grammar.quantities import QUANTITIES
from tinygc.effects import signals
from tinygc.explanation.twin.replay import Replay


class Values:
    """Of a replay's movement: its logs one behind the other, as the twin sees them."""

    def __init__(self, replay: Replay):
        self.movements = [movement.with_rate(rate) for movement, rate in zip(replay.twin.movements, replay.rates, strict=True)]
        #: samples of all logs together
        self.samples = sum(len(movement.t_s) for movement in self.movements)
        self._quantities: dict[str, list[np.ndarray]] = {}

    def quantity(self, name: str) -> list[np.ndarray]:
        """(N, components) of each log."""
        if name not in self._quantities:
            self._quantities[name] = [QUANTITIES[name].of(movement) for movement in self.movements]
        return self._quantities[name]

    @cached_property
    def calibration(self) -> np.ndarray:
        """(N, 4) orthonormal: what a bias and a matrix of one axis can say."""
        rates = np.concatenate([movement.rate for movement in self.movements])
        return np.linalg.qr(np.concatenate([rates, np.ones((len(rates), 1))], axis=1))[0]

    def of(self, factor: Factor | None) -> np.ndarray:
        """(components, N), float64, as ``Factor.values`` has it; of None, which is ``plan.ONE``, ones."""
        if factor is None:
            return np.ones((1, self.samples))
        parts = []
        for movement, values in zip(self.movements, self.quantity(factor.quantity), strict=True):
            found = factor.through.of(values, factor.constant or 1.0).reshape(len(values), -1)
            parts.append(found if factor.lag_s is None else signals.lagged(found, factor.lag_s, movement.t_s))
        return np.concatenate(parts).T

    def single(self, factor: Factor | None) -> tuple[np.ndarray, float]:
        """(components, N) float32 as shares of the largest, and the largest: 0, and zeros, where there is none or one that is no number."""
        values = self.of(factor)
        largest = float(np.abs(values).max(initial=0.0))
        if not np.isfinite(largest) or largest == 0:
            return np.zeros(values.shape, dtype=np.float32), 0.0
        return (values / largest).astype(np.float32, order="C"), largest
