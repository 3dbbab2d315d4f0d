"""What happens at each moment, in sizes of one, as leaves of a drawn law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from session.common.units import DEG, G
from tinygc.challenge.discover.laws.shapes import next_axis, previous_axis, size_of, slope

#: a hand's usual sizes: rad/s, rad/s², degC of warm-up, rad turned in a session, g²
RATE, ACCELERATION, WARM_C, TURNED, VIBRATION = 100 * DEG, 300 * DEG, 10.0, 8000 * DEG, 0.16


@dataclass(frozen=True, eq=False)
class Signals:
    """At even times: t (N,) s; share (N,) of the session; rate, force (N, 3) and warm (N,) degC since the start, SI; vibration (N,) g²."""

    t: np.ndarray
    share: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    warm: np.ndarray
    vibration: np.ndarray


#: values (N, 3), or (N, 1) where they are the same for all axes
Curve = Callable[[Signals], np.ndarray]


def _turned(s: Signals) -> np.ndarray:
    """Angle turned so far, whatever the sense."""
    return np.cumsum(size_of(s.rate), axis=0) * (s.t[1] - s.t[0]) / TURNED


def _angle(s: Signals) -> np.ndarray:
    """Integral of the rate about each axis, rad."""
    return np.cumsum(s.rate, axis=0) * (s.t[1] - s.t[0])


LEAVES: dict[str, Curve] = {
    "w": lambda s: s.rate / RATE,
    "w_next": lambda s: next_axis(s.rate) / RATE,
    "w_prev": lambda s: previous_axis(s.rate) / RATE,
    "|w|": lambda s: size_of(s.rate) / RATE,
    "f": lambda s: s.force / G,
    "f_next": lambda s: next_axis(s.force) / G,
    "f_prev": lambda s: previous_axis(s.force) / G,
    "a": lambda s: slope(s.t, s.rate) / ACCELERATION,
    "a_next": lambda s: next_axis(slope(s.t, s.rate)) / ACCELERATION,
    "|a|": lambda s: size_of(slope(s.t, s.rate)) / ACCELERATION,
    "T": lambda s: s.warm[:, None] / WARM_C,
    "t": lambda s: s.share[:, None],
    "turned": _turned,
    "angle": _angle,
    "v": lambda s: s.vibration[:, None] / VIBRATION,
}
#: how often each is drawn; rate and force are what a hand gives most of
WEIGHTS = {"w": 4, "w_next": 2, "w_prev": 2, "|w|": 3, "f": 3, "f_next": 2, "f_prev": 2, "a": 1, "a_next": 1, "|a|": 1, "T": 3, "t": 2}
WEIGHTS |= {"turned": 1, "angle": 1, "v": 1}
