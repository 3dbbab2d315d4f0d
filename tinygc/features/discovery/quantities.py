"""The quantities that an error may follow, and the functions of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from tinygc.effects import Movement, Reach, signals, without_vibration
from tinygc.effects.movement import HAND_S, NOWHERE

# Functions of one quantity, applied before it multiplies.  The Python of each is its one definition: the search evaluates it, and its C is
# written by it.

#: names that the Python of a function or a quantity may use
_NAMES = {"np": np, "signals": signals, "without_vibration": without_vibration}
HALF = Fraction(1, 2)


@dataclass(frozen=True, eq=False)
class Function:
    """name; shown: an equation's text, ``{x}`` the quantity and ``{c}`` its constant; words about it, likewise; source: Python of ``x``
    and ``c``.

    constant: the constant's name in JSON where it has one, in the quantity's unit; odd: whether it changes sign with x; phases: values for
    each x, a further last axis where there are several; power: of the quantity's unit in the values, 0 for a function that divides by its
    constant or takes a sign; memory: whether it depends on the whole log, whose samples are the first axis; decided: whether the constant
    acts at a few moments alone, so that the values are stepwise in it.
    """

    name: str
    shown: str
    words: str
    source: str
    constant: str | None = None
    odd: bool = True
    phases: int = 1
    power: int | Fraction = 0
    memory: bool = False
    decided: bool = False

    @cached_property
    def of(self) -> Callable[[np.ndarray, float], np.ndarray]:
        """``of(x, c)``: values of the shape of x, with several phases as a further last axis."""
        return eval(f"lambda x, c: {self.source}", dict(_NAMES))

    def on(self, x: Any, c: Any, numpy: Any) -> Any:
        """The same by other functions than NumPy's, such as those that write C."""
        return eval(self.source, _NAMES | {"np": numpy, "x": x, "c": c})


FUNCTIONS: dict[str, Function] = {
    function.name: function
    for function in (
        Function("itself", "{x}", "{x}", "x", power=1),
        Function("size", "|{x}|", "the size of {x}", "np.abs(x)", odd=False, power=1),
        Function("square", "{x}²", "the square of {x}", "x**2", odd=False, power=2),
        Function("signed_square", "{x}|{x}|", "{x} times its own size", "x * np.abs(x)", power=2),
        Function("cube", "{x}³", "the cube of {x}", "x**2 * x", power=3),
        Function("size_cube", "|{x}|³", "the cube of the size of {x}", "x**2 * np.abs(x)", odd=False, power=3),
        Function("root", "√|{x}|", "the square root of the size of {x}", "np.sqrt(np.abs(x))", odd=False, power=HALF),
        Function(
            "signed_root",
            "sign({x})√|{x}|",
            "the square root of the size of {x}, with its sign",
            "np.sign(x) * np.sqrt(np.abs(x))",
            power=HALF,
        ),
        Function("root_cube", "{x}√|{x}|", "{x} times the square root of its own size", "x * np.sqrt(np.abs(x))", power=3 * HALF),
        Function(
            "size_root_cube",
            "|{x}|√|{x}|",
            "the size of {x} times its own square root",
            "np.abs(x) * np.sqrt(np.abs(x))",
            odd=False,
            power=3 * HALF,
        ),
        Function("sign", "sign({x})", "the sign of {x}", "np.sign(x)"),
        Function(
            "dead_zone", "dz({x}, {c})", "what {x} has beyond a dead zone of ±{c}", "x - np.clip(x, -c, c)", constant="width", power=1
        ),
        Function(
            "excess",
            "max(|{x}| − {c}, 0)",
            "how far the size of {x} is above {c}",
            "np.maximum(np.abs(x) - c, 0.0)",
            constant="threshold",
            odd=False,
            power=1,
        ),
        Function("within", "clip({x}, ±{c})", "{x}, held within ±{c}", "np.clip(x, -c, c)", constant="limit", power=1),
        Function("soft", "tanh({x} / {c})", "{x}, which saturates softly at about {c}", "np.tanh(x / c)", constant="limit"),
        Function(
            "beyond",
            "[|{x}| > {c}]",
            "a step that is there while the size of {x} is above {c}",
            "np.where(np.abs(x) > c, 1.0, 0.0)",
            constant="threshold",
            odd=False,
        ),
        Function(
            "signed_beyond",
            "sign({x})[|{x}| > {c}]",
            "a step with the sign of {x} that is there while its size is above {c}",
            "np.sign(x) * (np.abs(x) > c)",
            constant="threshold",
        ),
        Function(
            "above",
            "[{x} > {c}]",
            "a step that is there while {x} is above {c}",
            "np.where(x > c, 1.0, 0.0)",
            constant="threshold",
            odd=False,
        ),
        Function(
            "hinge", "max({x} − {c}, 0)", "how far {x} is above {c}", "np.maximum(x - c, 0.0)", constant="threshold", odd=False, power=1
        ),
        Function("above_point", "({x} − {c})", "{x}, counted from {c}", "x - c", constant="point", odd=False, power=1),
        Function("below_point", "({x} + {c})", "{x}, counted from −{c}", "x + c", constant="point", odd=False, power=1),
        Function(
            "band",
            "{x}[|{x}| < {c}]",
            "{x} where its size is below {c}, and nothing elsewhere",
            "x * (np.abs(x) < c)",
            constant="width",
            power=1,
        ),
        Function(
            "decay",
            "exp(−|{x}| / {c})",
            "what fades as {x} grows, by a factor e in each {c}",
            "np.exp(-np.abs(x) / c)",
            constant="scale",
            odd=False,
        ),
        Function(
            "signed_decay",
            "sign({x}) exp(−|{x}| / {c})",
            "the sign of {x}, fading as {x} grows by a factor e in each {c}",
            "np.sign(x) * np.exp(-np.abs(x) / c)",
            constant="scale",
        ),
        Function(
            "settle",
            "(1 − exp(−|{x}| / {c}))",
            "what settles as {x} grows, by a factor e in each {c}",
            "-np.expm1(-np.abs(x) / c)",
            constant="scale",
            odd=False,
        ),
        Function(
            "wave",
            "wave({x}, {c})",
            "a sine over {x}, of any phase, with a period of {c}",
            "np.stack([np.cos(2 * np.pi * x / c), np.sin(2 * np.pi * x / c)], axis=-1)",
            constant="period",
            odd=False,
            phases=2,
        ),
        Function(
            "clock",
            "clock({x}, {c})",
            "a square wave over {x} (its first three harmonics), of any phase, with a period of {c}",
            "np.stack([f(2 * np.pi * x / (c / k)) for k in (1, 3, 5) for f in (np.cos, np.sin)], axis=-1)",
            constant="period",
            odd=False,
            phases=6,
        ),
        Function(
            "saw",
            "saw({x}, {c})",
            "the part of a step that rounding {x} to steps of {c} leaves",
            "x / c - np.round(x / c)",
            constant="step",
        ),
        Function(
            "play",
            "play({x}, {c})",
            "{x}, followed with a play of ±{c} as a loose gear follows, so that it lags on the way up and on the way down",
            "signals.play(x, c)",
            constant="play",
            power=1,
            memory=True,
        ),
        Function(
            "latch",
            "latch({x}, {c})",
            "the sign that {x} had when its size was last above {c}",
            "signals.latched(x, c)",
            constant="threshold",
            memory=True,
            decided=True,
        ),
    )
}


# The quantities that an error may follow: each with its unit and its source in a log's movement.


@dataclass(frozen=True, eq=False)
class SignalQuantity:
    """name; symbol in an equation, ``{i}`` where an axis stands; words; unit of its values.

    components: 3 for a vector of the sensor's axes, 6 for one with two directions for each axis (axis * 2 + direction), 1 for a scalar;
    source: Python over a movement ``m``, (N,) or (N, 3, …); inputs and reach: as an ``Effect`` declares them; memory: whether it is summed
    over the log, so that it cannot be predicted for a later movement; positive: whether it is never below zero.
    """

    name: str
    symbol: str
    words: str
    unit: str
    components: int
    source: str
    inputs: tuple[str, ...] = ()
    reach: Reach = NOWHERE
    memory: bool = False
    positive: bool = False

    @cached_property
    def _values(self) -> Callable[[Movement], np.ndarray]:
        return eval(f"lambda m: {self.source}", dict(_NAMES))

    def of(self, movement: Movement) -> np.ndarray:
        """Values in a movement, (N, components)."""
        return self._values(movement).reshape(len(movement.rate), -1)

    @property
    def vector(self) -> bool:
        """Whether it has an axis."""
        return self.components > 1

    @property
    def directions(self) -> int:
        """Components of each axis."""
        return max(self.components // 3, 1)


QUANTITIES: dict[str, SignalQuantity] = {
    quantity.name: quantity
    for quantity in (
        SignalQuantity("rate", "u_{i}", "the rate, as a share of full scale", "1", 3, "signals.moving_rate(m) / m.fs_rps"),
        SignalQuantity(
            "rate_size",
            "|u|",
            "the size of the rate, as a share of full scale",
            "1",
            1,
            "np.linalg.norm(signals.moving_rate(m), axis=1) / m.fs_rps",
            positive=True,
        ),
        SignalQuantity(
            "force",
            "f_{i}",
            "the specific force",
            "g",
            3,
            "without_vibration(m.force_g, m.dt_s)",
            ("force",),
            Reach.around(samples=2, seconds=HAND_S / 2),
        ),
        SignalQuantity(
            "acceleration",
            "u′_{i}",
            "the angular acceleration, in full scales a second",
            "1/s",
            3,
            "signals.angular_acceleration(m) / m.fs_rps",
            reach=signals.DERIVATIVE,
        ),
        SignalQuantity(
            "acceleration_size",
            "|u′|",
            "the size of the angular acceleration, in full scales a second",
            "1/s",
            1,
            "np.linalg.norm(signals.angular_acceleration(m), axis=1) / m.fs_rps",
            reach=signals.DERIVATIVE,
            positive=True,
        ),
        SignalQuantity(
            "speed_slope",
            "|u|′",
            "the rate of change of the size of the rate, in full scales a second",
            "1/s",
            1,
            "signals.derivative(np.linalg.norm(m.rate, axis=1), m) / m.fs_rps",
            reach=signals.DERIVATIVE,
        ),
        SignalQuantity(
            "jerk",
            "u″_{i}",
            "the angular jerk, in full scales a second squared",
            "1/s²",
            3,
            "signals.angular_jerk(m) / m.fs_rps",
            reach=signals.DERIVATIVE.times(2),
        ),
        SignalQuantity(
            "temperature", "(T − T₀)", "the temperature since the first sample", "°C", 1, "m.temp_c - m.first_temp_c", ("temperature",)
        ),
        SignalQuantity(
            "temperature_rate",
            "T′",
            "the rate of the temperature",
            "°C/s",
            1,
            "signals.temperature_rate(m)",
            ("temperature",),
            signals.SLOPE,
        ),
        SignalQuantity("time", "t", "the time since the session began", "s", 1, "m.t_s", ("time",), positive=True),
        SignalQuantity(
            "rest",
            "t_r",
            "the time since the sensor last turned",
            "s",
            1,
            "signals.seconds_at_rest(m)",
            ("time",),
            signals.WHOLE,
            memory=True,
            positive=True,
        ),
        SignalQuantity("vibration", "v²", "the vibration's energy", "g²", 1, "m.vibration_g2", ("vibration",), positive=True),
        SignalQuantity(
            "turned",
            "α_{i}",
            "the angle turned since the log began",
            "rad",
            3,
            "signals.angle_turned(m)",
            ("time",),
            signals.WHOLE,
            memory=True,
        ),
        SignalQuantity(
            "sense",
            "s_{i}",
            "the sense in which the axis turned last",
            "1",
            3,
            "signals.last_sense(m)",
            ("time",),
            signals.WHOLE,
            memory=True,
        ),
        SignalQuantity(
            "level",
            "n_{i}",
            "two level directions fixed in the world",
            "1",
            6,
            "signals.level_directions(m)",
            ("force", "time"),
            signals.WHOLE,
            memory=True,
        ),
        SignalQuantity(
            "world",
            "e_{i}",
            "three directions fixed in the world, one of them upright",
            "1",
            9,
            "signals.world_directions(m)",
            ("force", "time"),
            signals.WHOLE,
            memory=True,
        ),
    )
}


# The size of each quantity in a recording, and whether it varies enough to be searched.

#: degC: at a data sheet's 0.005 dps/degC that is 2.5 mdps, a still's own noise
LEAST_CHANGE_C = 0.5
#: g^2: less is the accelerometer's own noise (a thousandth of g, for 100 ug/rtHz at 100 Hz)
LEAST_VIBRATION_G2 = 1e-6


def largest_of(movements: Sequence[Movement]) -> dict[str, float]:
    """Quantity -> its largest finite size over all logs of two rows or more; 0 where it is missing in one, or varies too little.

    Readers reject non-finite readings, so a temperature is missing in a whole log or nowhere.  It is then excluded from the search, as
    ``candidates`` excludes catalogue effects; ``learnable`` reports that no law of it would be found.
    """
    movements = [movement for movement in movements if len(movement.t_s) > 1]
    if not movements:
        return dict.fromkeys(QUANTITIES, 0.0)
    return {name: _largest(quantity, movements) for name, quantity in QUANTITIES.items()}


def _largest(quantity: SignalQuantity, movements: Sequence[Movement]) -> float:
    if "temperature" in quantity.inputs:
        temps = np.concatenate([movement.temp_c for movement in movements])
        if not np.isfinite(temps).all() or np.ptp(temps) < LEAST_CHANGE_C:
            return 0.0
    values = np.concatenate([quantity.of(movement) for movement in movements])
    if not np.isfinite(values).all() or not np.ptp(values, axis=0).max(initial=0.0) > 0:
        return 0.0
    size = float(np.abs(values).max())
    return 0.0 if quantity.name == "vibration" and size < LEAST_VIBRATION_G2 else size
