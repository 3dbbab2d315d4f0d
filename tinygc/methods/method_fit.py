"""What each method gives: a model, and the closure that it leaves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tinygc.methods.names import PARAMETERS
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.denoiser import DenoisedNet
from tinygc.models.linear import LinearModel
from tinygc.models.published_net import PublishedNet

Model = LinearModel | CalibrationNet | PublishedNet | DenoisedNet


@dataclass(frozen=True, eq=False)
class MethodFit:
    """One method's model; angles (S, d) rad it leaves on the segments it was fitted to, and held_out (S, d) on those it never saw;
    seconds that the fit to all segments took; parts: the model of each fold."""

    name: str
    model: Model
    angles: np.ndarray
    held_out: np.ndarray
    seconds: float
    notes: dict = field(default_factory=dict)
    parts: tuple[Model, ...] = ()

    @property
    def parameters(self) -> int:
        if self.name == "tinygc":
            return len(self.model.vector)
        return PARAMETERS.get(self.name) or getattr(self.model, "parameters", 0)
