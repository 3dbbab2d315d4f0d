"""The quantities that an error may follow, and the functions of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from tinygc.effects import Movement, Reach, signals, without_vibration
from tinygc.effects.movement import HAND_S, NOWHERE

# Functions of one quantity: what a law makes of it before it multiplies.

#: of a square wave with any phase, the first three of its harmonics have 97 % of its size
HARMONICS = (1, 3, 5)


@dataclass(frozen=True, eq=False)
class Function:
    """name; shown: an equation's text, ``{x}`` the quantity and ``{c}`` its constant; words about it, likewise.

    of(x, c) -> the same shape, or with ``phases`` numbers for each as a further last axis; source: Python of ``x`` and ``c``;
    constant: the constant's name in JSON where it has one, which has the quantity's unit; odd: whether it changes sign with x;
    power: of the quantity's unit, that of what it makes: 0 where it divides by its constant or asks for a sign; memory: whether it
    looks back over the whole log, whose samples are the first axis; decided: whether the constant decides at a few moments alone, so that
    what it makes changes by steps with it.
    """

    name: str
    shown: str
    words: str
    of: Callable[[np.ndarray, float], np.ndarray]
    source: str
    constant: str | None = None
    odd: bool = True
    phases: int = 1
    power: Fraction = Fraction(0)
    memory: bool = False
    decided: bool = False


def _wave(x: np.ndarray, c: float) -> np.ndarray:
    phase = 2 * np.pi * x / c
    return np.stack([np.cos(phase), np.sin(phase)], axis=-1)


def _clock(x: np.ndarray, c: float) -> np.ndarray:
    return np.concatenate([_wave(x, c / harmonic) for harmonic in HARMONICS], axis=-1)


def _saw(x: np.ndarray, c: float) -> np.ndarray:
    return x / c - np.round(x / c)


_HALF = Fraction(1, 2)
_PLAIN = (
    Function("itself", "{x}", "{x}", lambda x, c: x, "x", power=Fraction(1)),
    Function("size", "|{x}|", "the size of {x}", lambda x, c: np.abs(x), "np.abs(x)", odd=False, power=Fraction(1)),
    Function("square", "{x}²", "the square of {x}", lambda x, c: x**2, "x**2", odd=False, power=Fraction(2)),
    Function("signed_square", "{x}|{x}|", "{x} times its own size", lambda x, c: x * np.abs(x), "x * np.abs(x)", power=Fraction(2)),
    Function("cube", "{x}³", "the cube of {x}", lambda x, c: x**2 * x, "x**2 * x", power=Fraction(3)),
    Function(
        "size_cube",
        "|{x}|³",
        "the cube of the size of {x}",
        lambda x, c: x**2 * np.abs(x),
        "x**2 * np.abs(x)",
        odd=False,
        power=Fraction(3),
    ),
    Function(
        "root",
        "√|{x}|",
        "the square root of the size of {x}",
        lambda x, c: np.sqrt(np.abs(x)),
        "np.sqrt(np.abs(x))",
        odd=False,
        power=_HALF,
    ),
    Function(
        "signed_root",
        "sign({x})√|{x}|",
        "the square root of the size of {x}, with its sign",
        lambda x, c: np.sign(x) * np.sqrt(np.abs(x)),
        "np.sign(x) * np.sqrt(np.abs(x))",
        power=_HALF,
    ),
    Function(
        "root_cube",
        "{x}√|{x}|",
        "{x} times the square root of its own size",
        lambda x, c: x * np.sqrt(np.abs(x)),
        "x * np.sqrt(np.abs(x))",
        power=3 * _HALF,
    ),
    Function(
        "size_root_cube",
        "|{x}|√|{x}|",
        "the size of {x} times its own square root",
        lambda x, c: np.abs(x) * np.sqrt(np.abs(x)),
        "np.abs(x) * np.sqrt(np.abs(x))",
        odd=False,
        power=3 * _HALF,
    ),
    Function("sign", "sign({x})", "the sign of {x}", lambda x, c: np.sign(x), "np.sign(x)"),
)
_WITH_CONSTANT = (
    Function(
        "dead_zone",
        "dz({x}, {c})",
        "what {x} has beyond a dead zone of ±{c}",
        lambda x, c: x - np.clip(x, -c, c),
        "x - np.clip(x, -c, c)",
        constant="width",
        power=Fraction(1),
    ),
    Function(
        "excess",
        "max(|{x}| − {c}, 0)",
        "how far the size of {x} is above {c}",
        lambda x, c: np.maximum(np.abs(x) - c, 0.0),
        "np.maximum(np.abs(x) - c, 0.0)",
        constant="threshold",
        odd=False,
        power=Fraction(1),
    ),
    Function(
        "within",
        "clip({x}, ±{c})",
        "{x}, held within ±{c}",
        lambda x, c: np.clip(x, -c, c),
        "np.clip(x, -c, c)",
        constant="limit",
        power=Fraction(1),
    ),
    Function(
        "soft",
        "tanh({x} / {c})",
        "{x}, which saturates softly at about {c}",
        lambda x, c: np.tanh(x / c),
        "np.tanh(x / c)",
        constant="limit",
    ),
    Function(
        "beyond",
        "[|{x}| > {c}]",
        "a step that is there while the size of {x} is above {c}",
        lambda x, c: (np.abs(x) > c).astype(float),
        "(np.abs(x) > c).astype(float)",
        constant="threshold",
        odd=False,
    ),
    Function(
        "signed_beyond",
        "sign({x})[|{x}| > {c}]",
        "a step with the sign of {x} that is there while its size is above {c}",
        lambda x, c: np.sign(x) * (np.abs(x) > c),
        "np.sign(x) * (np.abs(x) > c)",
        constant="threshold",
    ),
    Function(
        "above",
        "[{x} > {c}]",
        "a step that is there while {x} is above {c}",
        lambda x, c: (x > c).astype(float),
        "(x > c).astype(float)",
        constant="threshold",
        odd=False,
    ),
    Function(
        "hinge",
        "max({x} − {c}, 0)",
        "how far {x} is above {c}",
        lambda x, c: np.maximum(x - c, 0.0),
        "np.maximum(x - c, 0.0)",
        constant="threshold",
        odd=False,
        power=Fraction(1),
    ),
    Function(
        "band",
        "{x}[|{x}| < {c}]",
        "{x} where its size is below {c}, and nothing elsewhere",
        lambda x, c: x * (np.abs(x) < c),
        "x * (np.abs(x) < c)",
        constant="width",
        power=Fraction(1),
    ),
    Function(
        "decay",
        "exp(−|{x}| / {c})",
        "what fades as {x} grows, by a factor e in each {c}",
        lambda x, c: np.exp(-np.abs(x) / c),
        "np.exp(-np.abs(x) / c)",
        constant="scale",
        odd=False,
    ),
    Function(
        "signed_decay",
        "sign({x}) exp(−|{x}| / {c})",
        "the sign of {x}, fading as {x} grows by a factor e in each {c}",
        lambda x, c: np.sign(x) * np.exp(-np.abs(x) / c),
        "np.sign(x) * np.exp(-np.abs(x) / c)",
        constant="scale",
    ),
    Function(
        "settle",
        "(1 − exp(−|{x}| / {c}))",
        "what settles as {x} grows, by a factor e in each {c}",
        lambda x, c: -np.expm1(-np.abs(x) / c),
        "-np.expm1(-np.abs(x) / c)",
        constant="scale",
        odd=False,
    ),
    Function(
        "wave",
        "wave({x}, {c})",
        "a sine over {x}, of any phase, with a period of {c}",
        _wave,
        "np.stack([np.cos(2 * np.pi * x / c), np.sin(2 * np.pi * x / c)], axis=-1)",
        constant="period",
        odd=False,
        phases=2,
    ),
    Function(
        "clock",
        "clock({x}, {c})",
        "a square wave over {x} (its first three harmonics), of any phase, with a period of {c}",
        _clock,
        "np.stack([f(2 * np.pi * k * x / c) for k in (1, 3, 5) for f in (np.cos, np.sin)], axis=-1)",
        constant="period",
        odd=False,
        phases=2 * len(HARMONICS),
    ),
    Function(
        "saw",
        "saw({x}, {c})",
        "the part of a step that rounding {x} to steps of {c} leaves",
        _saw,
        "x / c - np.round(x / c)",
        constant="step",
    ),
    Function(
        "play",
        "play({x}, {c})",
        "{x}, followed with a play of ±{c} as a loose gear follows, so that it lags on the way up and on the way down",
        signals.play,
        "signals.play(x, c)",
        constant="play",
        power=Fraction(1),
        memory=True,
    ),
    Function(
        "latch",
        "latch({x}, {c})",
        "the sign that {x} had when its size was last above {c}",
        signals.latched,
        "signals.latched(x, c)",
        constant="threshold",
        memory=True,
        decided=True,
    ),
)
FUNCTIONS: dict[str, Function] = {function.name: function for function in _PLAIN + _WITH_CONSTANT}


# The quantities that an error may follow: each with its unit, and how it comes from a log's movement.


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


# How large each quantity is in a recording, and whether it varies enough to be asked.

#: degC: at a data sheet's 0.005 dps/degC that is 2.5 mdps, a still's own noise
LEAST_CHANGE_C = 0.5
#: g^2: below this nothing but the accelerometer's own noise vibrates (a thousandth of g, of a part of 100 ug/rtHz at 100 Hz)
LEAST_VIBRATION_G2 = 1e-6


def largest_of(movements: Sequence[Movement]) -> dict[str, float]:
    """Quantity -> its largest finite size over all logs of two rows or more; 0 where it is missing in one, or varies too little.

    Readers refuse a reading that is no number, so a temperature is missing in a whole log or nowhere.  It is then not asked for, as
    ``candidates`` asks no effect of the catalogue; ``learnable`` says of it that no law would be found.
    """
    movements = [movement for movement in movements if len(movement.t_s) > 1]
    if not movements:
        return dict.fromkeys(QUANTITIES, 0.0)
    return {name: _largest(quantity, movements) for name, quantity in QUANTITIES.items()}


def _largest(quantity: Quantity, movements: Sequence[Movement]) -> float:
    if "temperature" in quantity.inputs:
        temps = np.concatenate([movement.temp_c for movement in movements])
        if not np.isfinite(temps).all() or np.ptp(temps) < LEAST_CHANGE_C:
            return 0.0
    values = np.concatenate([quantity.of(movement) for movement in movements])
    if not np.isfinite(values).all() or not np.ptp(values, axis=0).max(initial=0.0) > 0:
        return 0.0
    size = float(np.abs(values).max())
    return 0.0 if quantity.name == "vibration" and size < LEAST_VIBRATION_G2 else size
