"""An effect's numbers: its parameter, what a person reads instead of it, and one shape number that is searched for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tinygc.effects.movement import Movement


@dataclass(frozen=True)
class Parameter:
    """name in the JSON; shape; unit for a person and its size in SI; plausible: a generous sigma, SI, that keeps a fit from wandering."""

    name: str
    shape: tuple[int, ...]
    unit: str
    si: float = 1.0
    plausible: float = 1.0

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return int(np.prod(self.shape))


@dataclass(frozen=True, eq=False)
class Derived:
    """What the JSON says instead of the parameter: name with its unit, and ``of``, from theta (P,) SI to that number.

    Its std follows from theta's covariance to first order.
    """

    name: str
    unit: str
    of: Callable[[np.ndarray], float]

    def values(self, theta: np.ndarray, covariance: np.ndarray) -> tuple[dict, dict]:
        """JSON parameters and their std, of theta (P,) with covariance (P, P)."""
        small = 1e-3 * np.linalg.norm(theta)
        steps = np.eye(len(theta))
        slope = np.array([(self.of(theta + small * e) - self.of(theta - small * e)) / (2 * small) for e in steps])
        return {self.name: self.of(theta)}, {self.name: float(np.sqrt(slope @ covariance @ slope))}


@dataclass(frozen=True, eq=False)
class Parts:
    """What the JSON says of a parameter whose numbers are of several kinds: names with their units, the size of each unit in SI, and where
    its numbers stand in theta.  told: the projection (P, P) on what any recording tells of theta."""

    parts: tuple[tuple[str, float, tuple[int, ...]], ...]
    told: np.ndarray

    def values(self, theta: np.ndarray, covariance: np.ndarray) -> tuple[dict, dict]:
        """JSON parameters and their std, of theta (P,) with covariance (P, P)."""
        theta, covariance = self.told @ theta, self.told @ covariance @ self.told.T
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0))
        shown, spread = ({name: (x[list(at)] / si).tolist() for name, si, at in self.parts} for x in (theta, sigma))
        return shown, spread

    def theta(self, parameters: dict) -> np.ndarray:
        """(P,) SI of JSON parameters."""
        found = np.zeros(sum(len(at) for _, _, at in self.parts))
        for name, si, at in self.parts:
            found[list(at)] = np.multiply(parameters[name], si)
        return found


@dataclass(frozen=True, eq=False)
class Scan:
    """A shape number beside the parameter that no linear fit can find, such as the moment of a step: it is searched on a grid.

    name in the JSON; unit for a person and its size in SI; make(value) -> the ``Effect`` with that value, SI;
    grid(movements) -> the values (K,), SI, to try on a recording, increasing; without it the middles of its turns, s of the session;
    smooth: what the effect adds changes smoothly with the value, as with a time constant: the value's own uncertainty then widens the
    parameters' stated std.
    """

    name: str
    unit: str
    make: Callable[[float], Any]
    si: float = 1.0
    grid: Callable[[Sequence[Movement]], np.ndarray] | None = None
    smooth: bool = False
