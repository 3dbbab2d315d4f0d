"""What the output of a gyroscope may be at a constant rate: the laws that compete, and what may be added to each.

    output = clip(offset of the curve + sum of coefficients times columns of the rate + extras, lower limit, upper limit)

The coefficients enter linearly; a law has up to three further shape parameters, each in its own unit.  Sources: IEEE 1431 (scale,
asymmetry, dead band, hysteresis); Lefevre, The Fiber-Optic Gyroscope, chapters 2 and 5 (Sagnac phase, modulation depth, demodulation).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from tinygc.features.tables.rates.points import Points

#: columns (N, K) at rates (N,) °/s, for the shape parameters of a law
ColumnsOf = Callable[[np.ndarray, tuple[float, ...]], np.ndarray]


@dataclass(frozen=True)
class Shape:
    """A parameter that enters a law nonlinearly: name, unit, where a fit starts (of the largest rate where it is a rate) and its bounds."""

    name: str
    unit: str
    starts: tuple[float, ...]
    bounds: tuple[float, float]

    @property
    def is_rate(self) -> bool:
        """Whether it is a rate, so that starts and bounds are shares of the largest one."""
        return self.unit == "°/s"


@dataclass(frozen=True, eq=False)
class Law:
    """name; words; equation, with the names of its parameters; coefficients: names and powers of °/s in their units; shapes; columns."""

    name: str
    words: str
    equation: str
    coefficients: tuple[tuple[str, int], ...]
    columns: ColumnsOf
    shapes: tuple[Shape, ...] = ()

    def starts(self, largest_dps: float) -> list[tuple[float, ...]]:
        """Where fits of the shape parameters begin."""
        return [tuple(values) for values in product(*([s * (largest_dps if p.is_rate else 1.0) for s in p.starts] for p in self.shapes))]

    def bounds(self, largest_dps: float) -> tuple[np.ndarray, np.ndarray]:
        """(P,) lower and upper bounds of the shape parameters."""
        low, high = ([p.bounds[side] * (largest_dps if p.is_rate else 1.0) for p in self.shapes] for side in (0, 1))
        return np.array(low), np.array(high)


# An open-loop fibre-optic gyroscope.  The detector sees 1 + cos(x + m cos t) over a period t of the modulation, x the Sagnac phase, m the
# depth of modulation; its synchronous demodulation gives sin x.  An amplifier that holds the detector's alternating signal at one size, or
# that saturates, makes another function of x out of it.

#: instants over half a period of the modulation, whose other half mirrors it
_COSINE = np.cos((np.arange(48) + 0.5) * np.pi / 48)


def _demodulated(rate: np.ndarray, shape: tuple[float, ...]) -> np.ndarray:
    """First harmonic, out of a signal of constant size whose upper side saturates at ``limit`` of its rms."""
    rate_per_rad, depth, limit = shape
    sizes, which = np.unique(np.abs(rate), return_inverse=True)
    signal = np.cos((sizes / rate_per_rad)[:, None] + depth * _COSINE)
    signal = signal - signal.mean(axis=1, keepdims=True)
    signal /= np.sqrt(np.mean(signal**2, axis=1, keepdims=True))
    harmonic = -2 * np.minimum(signal, limit) @ _COSINE / len(_COSINE)
    return (harmonic[which] * np.sign(rate))[:, None]


def _overloaded(rate: np.ndarray, shape: tuple[float, ...]) -> np.ndarray:
    """A sine whose amplifier loses its gain where the signal is beyond ``limit`` of its amplitude."""
    rate_per_rad, limit, order = shape
    sine = np.sin(rate / rate_per_rad)
    return (sine / (1 + (np.abs(sine) / limit) ** order))[:, None]


def _columns(*of: Callable[..., np.ndarray]) -> ColumnsOf:
    return lambda rate, shape: np.stack([each(rate, *shape) for each in of], axis=1)


def _rate(rate: np.ndarray, *shape: float) -> np.ndarray:
    return rate


_BEND = Shape("w0", "°/s", (0.4, 0.8, 2.0), (0.1, 20.0))
_PHASE = Shape("w0", "°/s", (0.4, 0.6, 1.0, 2.0), (0.2, 20.0))

LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        Law("line", "a straight line", "K w", (("K", 1),), _columns(_rate)),
        Law("asymmetry", "two slopes, one for each sense", "K w + a |w|", (("K", 1), ("a", 1)), _columns(_rate, lambda w: np.abs(w))),
        Law("quadratic", "a parabola", "K w + q w²", (("K", 1), ("q", 2)), _columns(_rate, lambda w: w**2)),
        Law("cubic", "a cubic", "K w + c w³", (("K", 1), ("c", 3)), _columns(_rate, lambda w: w**3)),
        Law(
            "polynomial",
            "a polynomial of the third order",
            "K w + q w² + c w³",
            (("K", 1), ("q", 2), ("c", 3)),
            _columns(_rate, lambda w: w**2, lambda w: w**3),
        ),
        Law("tanh", "soft saturation (tanh)", "A tanh(w / w0)", (("A", 0),), _columns(lambda w, c: np.tanh(w / c)), (_BEND,)),
        Law("arctan", "soft saturation (arctan)", "A arctan(w / w0)", (("A", 0),), _columns(lambda w, c: np.arctan(w / c)), (_BEND,)),
        Law(
            "root",
            "soft saturation (root)",
            "K w / √(1 + (w / w0)²)",
            (("K", 1),),
            _columns(lambda w, c: w / np.sqrt(1 + (w / c) ** 2)),
            (_BEND,),
        ),
        Law("sine", "a sine: an open-loop interferometer", "A sin(w / w0)", (("A", 0),), _columns(lambda w, c: np.sin(w / c)), (_PHASE,)),
        Law(
            "sine_of_any_phase",
            "a sine whose phase at rest is not zero",
            "A sin(w / w0) + B (cos(w / w0) − 1)",
            (("A", 0), ("B", 0)),
            _columns(lambda w, c: np.sin(w / c), lambda w, c: np.cos(w / c) - 1),
            (_PHASE,),
        ),
        Law(
            "normalised_sine",
            "an interferometer whose mean light is held constant",
            "A sin x / (1 + j cos x); x = w / w0",
            (("A", 0),),
            _columns(lambda w, c, j: np.sin(w / c) / (1 + j * np.cos(w / c))),
            (_PHASE, Shape("j", "1", (-0.2, 0.25), (-0.41, 0.9))),
        ),
        Law(
            "overloaded_sine",
            "an interferometer whose amplifier loses gain in overload",
            "A s / (1 + (|s| / b)^n); s = sin(w / w0)",
            (("A", 0),),
            _overloaded,
            (_PHASE, Shape("b", "1", (0.8, 1.05), (0.2, 3.0)), Shape("n", "1", (4.0, 10.0), (1.0, 40.0))),
        ),
        Law(
            "demodulator",
            "an interferometer whose detector signal is held at one size and saturates",
            "A H1[min(s / rms(s), b)]; s = cos(x + m cos t) less its mean, x = w / w0, H1 the harmonic of cos t",
            (("A", 0),),
            _demodulated,
            (_PHASE, Shape("m", "rad", (1.8, 2.7, 3.1), (0.5, 4.5)), Shape("b", "1", (-0.4, 0.7), (-1.0, 3.0))),
        ),
        Law(
            "dead_band",
            "a dead band about rest",
            "K (w − clip(w, ±d))",
            (("K", 1),),
            _columns(lambda w, d: w - np.clip(w, -d, d)),
            (Shape("d", "°/s", (0.02, 0.1, 0.3), (0.0, 0.8)),),
        ),
        Law(
            "pieces",
            "two straight pieces",
            "K w + h max(w − w1, 0)",
            (("K", 1), ("h", 1)),
            _columns(_rate, lambda w, c: np.maximum(w - c, 0.0)),
            (Shape("w1", "°/s", (-0.5, -0.2, 0.2, 0.5), (-0.9, 0.9)),),
        ),
    )
}


#: the smooth curve that no law names (``curve.py``)
CURVE = "curve"
_CURVE = Law(CURVE, "a smooth curve of no law in the list", "K w + f(w); f smooth", (("K", 1),), _columns(_rate))


@dataclass(frozen=True, eq=False)
class Extra:
    """One more column beside a law: words; power of °/s in its coefficient's unit; column of rate, direction and order, each (N,)."""

    words: str
    symbol: str
    power: int
    column: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


EXTRAS: dict[str, Extra] = {
    "asymmetry": Extra("asymmetry", "a |w|", 1, lambda rate, direction, order: np.abs(rate)),
    "hysteresis": Extra("hysteresis", "h direction / 2", 0, lambda rate, direction, order: direction / 2),
    "drift": Extra("a drift in the order of the rows", "u order", 0, lambda rate, direction, order: order),
    "turning": Extra("an offset while the table turns", "t [w ≠ 0]", 0, lambda rate, direction, order: (rate != 0).astype(float)),
    "bend": Extra("a cubic term", "c w³", 3, lambda rate, direction, order: rate**3),
    "sense": Extra("a step with the sense", "z sign(w)", 0, lambda rate, direction, order: np.sign(rate)),
}

#: extras that compete; the others are only probed for, where nothing shows
COMPETING = ("asymmetry", "hysteresis", "drift", "turning")
#: which ends of the output have a limit
LIMITS: tuple[tuple[bool, bool], ...] = ((False, False), (True, True), (False, True), (True, False))


@dataclass(frozen=True)
class Hypothesis:
    """A law with limits of the output (lower, upper) and extras; apart: row of one reading that does not follow them, -1 for none."""

    law: str
    lower: bool = False
    upper: bool = False
    extras: tuple[str, ...] = ()
    apart: int = -1

    @property
    def of(self) -> Law:
        """Its law."""
        return _CURVE if self.law == CURVE else LAWS[self.law]

    @property
    def clipped(self) -> str:
        """Which ends of the output have a limit, in words; empty where none has."""
        ends = ["below"] * self.lower + ["above"] * self.upper
        return f"clipped {' and '.join(ends)}" if ends else ""

    @property
    def name(self) -> str:
        """``sine, clipped below and above, turning``."""
        return ", ".join(filter(None, (self.law, self.clipped, *self.extras, "one reading off" * (self.apart >= 0))))

    @property
    def equation(self) -> str:
        """The output, with the names of its parameters."""
        law, _, rest = self.of.equation.partition("; ")
        added = [EXTRAS[name].symbol for name in self.extras] + ["r [one reading]"] * (self.apart >= 0)
        inside = " + ".join(["V0", law, *added])
        low, high = "V−" if self.lower else "−∞", "V+" if self.upper else "∞"
        return (f"V = clip({inside}, {low}, {high})" if self.lower or self.upper else f"V = {inside}") + (f"; {rest}" if rest else "")

    @property
    def added(self) -> int:
        """How many columns there are beside the law's own."""
        return len(self.extras) + (self.apart >= 0)

    def columns(self, rate: np.ndarray, shape: tuple[float, ...], points: Points | None = None) -> np.ndarray:
        """(N, K + E) columns of the law's coefficients and of the extras, at rates (N,); points: which these are, None where they are none.

        Where they are none, nothing is known of their direction and order, and none is the reading apart.
        """
        none = np.zeros(len(rate))
        direction, order = (none, none) if points is None else (points.direction, points.order)
        extras = [EXTRAS[name].column(rate, direction, order) for name in self.extras]
        if self.apart >= 0:
            extras.append(none if points is None else (np.arange(len(rate)) == self.apart).astype(float))
        return np.column_stack([self.of.columns(rate, shape), *extras])
