"""Functions of one quantity: what a law makes of it before it multiplies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Function:
    """name; shown: an equation's text, ``{x}`` the quantity and ``{c}`` its constant; words about it, likewise.

    of(x, c) -> the same shape, or with ``phases`` numbers for each as a further last axis; source: Python of ``x`` and ``c``;
    constant: the constant's name in JSON where it has one, which has the quantity's unit; odd: whether it changes sign with x; of_one:
    whether it makes a unitless number of any quantity.
    """

    name: str
    shown: str
    words: str
    of: Callable[[np.ndarray, float], np.ndarray]
    source: str
    constant: str | None = None
    odd: bool = True
    phases: int = 1


def _wave(x: np.ndarray, c: float) -> np.ndarray:
    return np.stack([np.cos(2 * np.pi * x / c), np.sin(2 * np.pi * x / c)], axis=-1)


def _clock(x: np.ndarray, c: float) -> np.ndarray:
    return np.sign(_wave(x, c))


def _saw(x: np.ndarray, c: float) -> np.ndarray:
    return x / c - np.round(x / c)


_ALL = (
    Function("itself", "{x}", "{x}", lambda x, c: x, "x"),
    Function("size", "|{x}|", "the size of {x}", lambda x, c: np.abs(x), "np.abs(x)", odd=False),
    Function("square", "{x}²", "the square of {x}", lambda x, c: x**2, "x**2", odd=False),
    Function("signed_square", "{x}|{x}|", "{x} times its size", lambda x, c: x * np.abs(x), "x * np.abs(x)"),
    Function("cube", "{x}³", "the cube of {x}", lambda x, c: x**3, "x**3"),
    Function("size_cube", "|{x}|³", "the cube of the size of {x}", lambda x, c: np.abs(x) ** 3, "np.abs(x) ** 3", odd=False),
    Function("root", "√|{x}|", "the root of the size of {x}", lambda x, c: np.sqrt(np.abs(x)), "np.sqrt(np.abs(x))", odd=False),
    Function(
        "signed_root",
        "sign({x})√|{x}|",
        "the root of {x}, with its sign",
        lambda x, c: np.sign(x) * np.sqrt(np.abs(x)),
        "np.sign(x) * np.sqrt(np.abs(x))",
    ),
    Function(
        "root_cube",
        "{x}√|{x}|",
        "{x} times the root of its size",
        lambda x, c: x * np.sqrt(np.abs(x)),
        "x * np.sqrt(np.abs(x))",
    ),
    Function("sign", "sign({x})", "the sign of {x}", lambda x, c: np.sign(x), "np.sign(x)"),
    Function(
        "dead_zone",
        "dz({x}, {c})",
        "{x} beyond a dead zone of {c}",
        lambda x, c: x - np.clip(x, -c, c),
        "x - np.clip(x, -c, c)",
        constant="width",
    ),
    Function("within", "clip({x}, {c})", "{x}, held within {c}", lambda x, c: np.clip(x, -c, c), "np.clip(x, -c, c)", constant="limit"),
    Function(
        "beyond",
        "[|{x}| > {c}]",
        "whether the size of {x} is above {c}",
        lambda x, c: (np.abs(x) > c).astype(float),
        "(np.abs(x) > c).astype(float)",
        constant="threshold",
        odd=False,
    ),
    Function(
        "decay",
        "exp(−|{x}|/{c})",
        "what fades with {x} within {c}",
        lambda x, c: np.exp(-np.abs(x) / c),
        "np.exp(-np.abs(x) / c)",
        constant="scale",
        odd=False,
    ),
    Function(
        "wave",
        "wave({x}, {c})",
        "a wave over {x} of period {c}",
        _wave,
        "np.stack([np.cos(2 * np.pi * x / c), np.sin(2 * np.pi * x / c)], axis=-1)",
        constant="period",
        odd=False,
        phases=2,
    ),
    Function(
        "clock",
        "clock({x}, {c})",
        "a load that switches with {x}, with a period of {c}",
        _clock,
        "np.sign(np.stack([np.cos(2 * np.pi * x / c), np.sin(2 * np.pi * x / c)], axis=-1))",
        constant="period",
        odd=False,
        phases=2,
    ),
    Function("saw", "saw({x}, {c})", "what rounding {x} to steps of {c} leaves", _saw, "x / c - np.round(x / c)", constant="step"),
)
FUNCTIONS: dict[str, Function] = {function.name: function for function in _ALL}
