"""A fit's movement, sample by sample: of a day with 400 turns 50 MB, so that no fit keeps its own."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tinygc.effects import Effect
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.state import Channels
from tinygc.explanation.twin.twin import Twin


class Replay:
    """What columns of effects beside a fit rest on; made where they are asked for, of the states that the fit keeps."""

    def __init__(self, twin: Twin, fit: Refit):
        self.twin, self.fit = twin, fit

    @cached_property
    def rates(self) -> list[np.ndarray]:
        """True rates (N, 3) rad/s of each log, where the fit stands."""
        return self.twin.rates(self.fit.state)

    @cached_property
    def sensitivity(self) -> np.ndarray:
        """(S, T, d, 3) s, that the fit's own columns rest on."""
        at, state = self.fit.columns_at, self.fit.state
        return self.twin.sensitivity(at, self.rates if at is state else self.twin.rates(at))

    def columns(self, effect: Effect) -> Channels:
        """Of an effect's parameters, as ``Twin.effect_columns``."""
        return self.twin.effect_columns(effect, self.fit.state, self.sensitivity, self.rates)
