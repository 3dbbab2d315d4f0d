"""The quantities that an error may follow: each with its unit, and how it comes from a log's movement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tinygc.effects import Movement, Reach, signals, without_vibration
from tinygc.effects.conditions import HAND_S
from tinygc.effects.reach import NOWHERE


@dataclass(frozen=True, eq=False)
class Quantity:
    """name; symbol in an equation, ``{i}`` where an axis stands; words; unit that its values have.

    components: 3 for a vector of the sensor's axes, 6 for one with two directions for each axis (axis * 2 + direction), 1 for a scalar;
    of(movement) -> (N, components); source: the same as Python over ``m``, (N,) or (N, 3); inputs and reach: as an ``Effect`` declares
    them; memory: whether it is summed over the log, so that no later movement knows it; positive: whether it is never below zero.
    """

    name: str
    symbol: str
    words: str
    unit: str
    components: int
    of: Callable[[Movement], np.ndarray]
    source: str
    inputs: tuple[str, ...] = ()
    reach: Reach = NOWHERE
    memory: bool = False
    positive: bool = False

    @property
    def vector(self) -> bool:
        """Whether it has an axis."""
        return self.components > 1

    @property
    def directions(self) -> int:
        """Numbers of each axis."""
        return max(self.components // 3, 1)


def _scalar(values: np.ndarray) -> np.ndarray:
    return values[:, None]


def _force(movement: Movement) -> np.ndarray:
    return without_vibration(movement.force_g, movement.dt_s)


_ALL = (
    Quantity(
        "rate",
        "u_{i}",
        "the rate, as a share of full scale",
        "1",
        3,
        lambda m: signals.moving_rate(m) / m.fs_rps,
        "signals.moving_rate(m) / m.fs_rps",
    ),
    Quantity(
        "rate_size",
        "|u|",
        "the size of the rate, as a share of full scale",
        "1",
        1,
        lambda m: _scalar(np.linalg.norm(signals.moving_rate(m), axis=1) / m.fs_rps),
        "np.linalg.norm(signals.moving_rate(m), axis=1) / m.fs_rps",
        positive=True,
    ),
    Quantity(
        "force",
        "f_{i}",
        "the specific force",
        "g",
        3,
        _force,
        "without_vibration(m.force_g, m.dt_s)",
        ("force",),
        Reach.around(samples=2, seconds=HAND_S / 2),
    ),
    Quantity(
        "acceleration",
        "u′_{i}",
        "the angular acceleration, in full scales a second",
        "1/s",
        3,
        lambda m: signals.angular_acceleration(m) / m.fs_rps,
        "signals.angular_acceleration(m) / m.fs_rps",
        reach=signals.DERIVATIVE,
    ),
    Quantity(
        "acceleration_size",
        "|u′|",
        "the size of the angular acceleration, in full scales a second",
        "1/s",
        1,
        lambda m: _scalar(np.linalg.norm(signals.angular_acceleration(m), axis=1) / m.fs_rps),
        "np.linalg.norm(signals.angular_acceleration(m), axis=1) / m.fs_rps",
        reach=signals.DERIVATIVE,
        positive=True,
    ),
    Quantity(
        "jerk",
        "u″_{i}",
        "the angular jerk, in full scales a second squared",
        "1/s²",
        3,
        lambda m: signals.angular_jerk(m) / m.fs_rps,
        "signals.angular_jerk(m) / m.fs_rps",
        reach=signals.DERIVATIVE.times(2),
    ),
    Quantity(
        "temperature",
        "(T − T₀)",
        "the temperature since the first sample",
        "°C",
        1,
        lambda m: _scalar(m.temp_c - m.first_temp_c),
        "m.temp_c - m.first_temp_c",
        ("temperature",),
    ),
    Quantity(
        "temperature_rate",
        "T′",
        "the rate of the temperature",
        "°C/s",
        1,
        lambda m: _scalar(signals.temperature_rate(m)),
        "signals.temperature_rate(m)",
        ("temperature",),
        signals.SLOPE,
    ),
    Quantity("time", "t", "the time since the session began", "s", 1, lambda m: _scalar(m.t_s), "m.t_s", ("time",), positive=True),
    Quantity(
        "rest",
        "t_r",
        "the time since the sensor last turned",
        "s",
        1,
        lambda m: _scalar(signals.seconds_at_rest(m)),
        "signals.seconds_at_rest(m)",
        ("time",),
        signals.WHOLE,
        memory=True,
        positive=True,
    ),
    Quantity(
        "vibration",
        "v²",
        "the vibration's energy",
        "g²",
        1,
        lambda m: _scalar(m.vibration_g2),
        "m.vibration_g2",
        ("vibration",),
        positive=True,
    ),
    Quantity(
        "turned",
        "α_{i}",
        "the angle turned since the log began",
        "rad",
        3,
        signals.angle_turned,
        "signals.angle_turned(m)",
        ("time",),
        signals.WHOLE,
        memory=True,
    ),
    Quantity(
        "sense",
        "s_{i}",
        "the sense in which the axis turned last",
        "1",
        3,
        signals.last_sense,
        "signals.last_sense(m)",
        ("time",),
        signals.WHOLE,
        memory=True,
    ),
    Quantity(
        "level",
        "n_{i}",
        "two level directions fixed in the world",
        "1",
        6,
        lambda m: signals.level_directions(m).reshape(-1, 6),
        "signals.level_directions(m)",
        ("force", "time"),
        signals.WHOLE,
        memory=True,
    ),
    Quantity(
        "world",
        "e_{i}",
        "three directions fixed in the world, one of them upright",
        "1",
        9,
        lambda m: signals.world_directions(m).reshape(-1, 9),
        "signals.world_directions(m)",
        ("force", "time"),
        signals.WHOLE,
        memory=True,
    ),
)
QUANTITIES: dict[str, Quantity] = {quantity.name: quantity for quantity in _ALL}
