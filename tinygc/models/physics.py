"""The model goes on: a calibration that undoes the physics that `explain` named, or that was asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from session.log.samples import Samples
from tinygc.effects import AppliedEffect, Conditions, movement_of
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.linear import PARAMETERS, LinearModel
from tinygc.models.model import BaseModel


@dataclass(frozen=True, eq=False)
class PhysicsModel(BaseModel):
    """omega = (effects undone)(E m + B): linear model, claims in the order in which they are undone, and what they refer to."""

    kind: ClassVar[str] = "physics"
    pointwise: ClassVar[bool] = False
    rates_only: ClassVar[bool] = False

    linear: LinearModel
    claims: tuple[AppliedEffect, ...]
    known: Conditions

    @property
    def parameters(self) -> int:
        """12 and the effects'."""
        return PARAMETERS + sum(len(claim.theta) for claim in self.claims)

    @property
    def undone(self) -> tuple[AppliedEffect, ...]:
        """The claims."""
        return self.claims

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log; samples with the pre-calibrated force; began_s of the session when it began;
        live: only the past is known, and the temperature is taken as it comes."""
        rate = self.linear(samples.gyro)
        movement = movement_of(samples, rate, self.known, began_s, live)
        for claim in self.claims:
            rate = claim.effect.correct(rate, movement.with_rate(rate), claim.theta)
        return rate

    def equivalent_rate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """The rates (N, 3) that the sensor would have measured without the effects: what a network can be trained on."""
        return (self.calibrate(samples, began_s, live) - self.linear.B) @ np.linalg.inv(self.linear.E).T


@dataclass(frozen=True, eq=False)
class CarriedNet(BaseModel):
    """TinyGC-Net behind the named physics: the net calibrates what the sensor would have measured without the effects."""

    kind: ClassVar[str] = "tinygc_physics"
    pointwise: ClassVar[bool] = False
    rates_only: ClassVar[bool] = False

    physics: PhysicsModel
    net: CalibrationNet

    @property
    def parameters(self) -> int:
        """The net's, and the effects'."""
        return len(self.net.vector) + self.physics.parameters - PARAMETERS

    @property
    def undone(self) -> tuple[AppliedEffect, ...]:
        """The claims of the physics."""
        return self.physics.claims

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log; samples with the pre-calibrated force."""
        return self.net(self.physics.equivalent_rate(samples, began_s, live))
