"""What each method gives: a model, and the closure that it leaves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tinygc.methods.registry import METHODS
from tinygc.models.model import Model


@dataclass(frozen=True, eq=False)
class MethodFit:
    """One method's model; angles (S, d) rad it leaves on the segments it was fitted to, and held_out (S, d) on those it never saw;
    seconds that the fit to all segments took; notes on how it was found; fold_models: the model of each fold."""

    name: str
    model: Model
    angles: np.ndarray
    held_out: np.ndarray
    seconds: float
    notes: dict = field(default_factory=dict)
    fold_models: tuple[Model, ...] = ()

    @property
    def parameters(self) -> int:
        """Numbers that were fitted."""
        own = METHODS[self.name].parameters
        return self.model.parameters if own is None else own
