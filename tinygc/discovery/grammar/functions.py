"""Functions of one quantity: what a law makes of it before it multiplies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from tinygc.effects import signals

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
