"""The model goes on: a calibration that undoes the physics that `explain` named, or that was asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.log.samples import Samples
from tinygc.effects import Claim, Conditions, movement_of
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.linear import LinearModel


@dataclass(frozen=True, eq=False)
class PhysicsModel:
    """omega = (effects undone)(E m + B): linear model, claims in the order in which they are undone, and what they refer to."""

    linear: LinearModel
    claims: tuple[Claim, ...]
    known: Conditions

    @property
    def parameters(self) -> int:
        return 12 + sum(len(claim.theta) for claim in self.claims)

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(claim.effect.id for claim in self.claims)

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
class CarriedNet:
    """TinyGC-Net behind the named physics: the net calibrates what the sensor would have measured without the effects."""

    physics: PhysicsModel
    net: CalibrationNet

    @property
    def parameters(self) -> int:
        return len(self.net.vector) + self.physics.parameters - 12

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log; samples with the pre-calibrated force."""
        return self.net(self.physics.equivalent_rate(samples, began_s, live))
