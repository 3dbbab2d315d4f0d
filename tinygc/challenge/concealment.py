"""One thing that is hidden in a simulated session, by what it does to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from tinygc.simulation.simulate import Distort, Disturb, Recording
from tinygc.simulation.table_movement import Plan


@dataclass(frozen=True, eq=False)
class Concealment:
    """id; truth, its parameters by the names and units of docs/formats.md; and what it does, each None where it does nothing.

    distort: to the true rate; disturb: to the force that the accelerometer feels; movement: plan -> plan;
    spoil: to the recorded log, (recording) -> (recording, further truth); without_latitude: whether session.toml keeps it to itself.
    """

    id: str
    truth: dict = field(default_factory=dict)
    distort: Distort | None = None
    disturb: Disturb | None = None
    movement: Callable[[Plan], Plan] | None = None
    spoil: Callable[[Recording], tuple[Recording, dict]] | None = None
    without_latitude: bool = False


class Place(Protocol):
    """What a concealment may ask of sensor and site: of a simulated session its options, of a recording what it shows."""

    @property
    def gyro_fs_dps(self) -> float:
        """Full scale, dps."""

    @property
    def odr_hz(self) -> float:
        """Data rate."""

    @property
    def temperature_start_c(self) -> float:
        """At the first sample, degC."""

    @property
    def warm_up_c(self) -> float:
        """How far it goes from there, degC."""

    @property
    def latitude_deg(self) -> float:
        """North positive."""


class Course(Protocol):
    """What a concealment may ask of the movement."""

    @property
    def turns(self) -> tuple[tuple[float, float], ...]:
        """(start, stop) of each, s of the session."""

    @property
    def log_s(self) -> float:
        """How long the session is, s."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What a concealment is drawn for: rng; strength, a factor of the strong size; the session's sensor and site, and its movement."""

    rng: np.random.Generator
    strength: float
    options: Place
    plan: Course

    def signed(self, size: float, shape: tuple[int, ...] = (3,)) -> np.ndarray:
        """Values of either sign, 0.5 to 1.5 times strength times size."""
        return self.strength * size * self.rng.uniform(0.5, 1.5, shape) * self.rng.choice((-1.0, 1.0), shape)


Maker = Callable[[Scene], Concealment]
