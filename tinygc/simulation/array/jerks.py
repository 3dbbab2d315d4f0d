"""Rotation of the body beside the table's: short jerks that come back, about one axis each, exact in rate, attitude and acceleration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.simulation.table_movement import Plan

#: width (sigma) of a jerk in periods of the data rate: two thirds of its power lie above half the rate
WIDTH_PERIODS = 0.4
JERKS_A_TURN = 3
#: of a turn's length: jerks keep off its ends, where the body comes to rest
MARGIN = 0.15
#: widths after which a jerk is over
OVER = 6.0


@dataclass(frozen=True, eq=False)
class Jerks:
    """at_s (J,), size_rad (J,), axis (3,) of unit length, fixed in the body; width_s: a jerk is a Gaussian of the angle."""

    at_s: np.ndarray
    size_rad: np.ndarray
    axis: np.ndarray
    width_s: float

    def angle(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(N,) rad, rad/s, rad/s^2 at moments (N,) s, increasing."""
        angle, rate, acceleration = np.zeros((3, len(t_s)))
        for at, size in zip(self.at_s, self.size_rad, strict=True):
            rows = slice(*np.searchsorted(t_s, [at - OVER * self.width_s, at + OVER * self.width_s]))
            x = (t_s[rows] - at) / self.width_s
            bell = size * np.exp(-(x**2) / 2)
            angle[rows] += bell
            rate[rows] -= bell * x / self.width_s
            acceleration[rows] += bell * (x**2 - 1) / self.width_s**2
        return angle, rate, acceleration

    def rate(self, t_s: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Of the jerked body (N, 3) rad/s, in its axes, from that of the table's."""
        angle, own, _ = self.angle(t_s)
        return self._seen(rate, angle) + own[:, None] * self.axis

    def force(self, t_s: np.ndarray, force: np.ndarray, lever_m: np.ndarray) -> np.ndarray:
        """(N, 3) m/s^2 at a lever from the crossing of the gimbals, about which the jerk turns, too."""
        angle, _, acceleration = self.angle(t_s)
        return self._seen(force, angle) + acceleration[:, None] * np.cross(self.axis, lever_m)

    def _seen(self, vectors: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Vectors (N, 3) from axes that the body has turned out of by angle (N,), Rodrigues."""
        along = (vectors @ self.axis)[:, None] * self.axis
        across = vectors - along
        return along + across * np.cos(angle)[:, None] - np.cross(self.axis, vectors) * np.sin(angle)[:, None]


def jerks_in_turns(plan: Plan, size_rad: float, odr_hz: float, rng: np.random.Generator) -> Jerks:
    """Drawn anew for each turn."""
    turns = np.repeat(np.array(plan.turns), JERKS_A_TURN, axis=0)
    at_s = turns[:, 0] + (turns[:, 1] - turns[:, 0]) * rng.uniform(MARGIN, 1 - MARGIN, len(turns))
    axis = rng.normal(size=3)
    return Jerks(at_s, size_rad * rng.normal(size=len(at_s)), axis / np.linalg.norm(axis), WIDTH_PERIODS / odr_hz)


def knock_in(plan: Plan, turn: int, size_rad: float, odr_hz: float, rng: np.random.Generator) -> Jerks:
    """One knock in one turn."""
    start, stop = plan.turns[turn]
    axis = rng.normal(size=3)
    return Jerks(np.array([(start + stop) / 2]), np.array([size_rad]), axis / np.linalg.norm(axis), WIDTH_PERIODS / odr_hz)
