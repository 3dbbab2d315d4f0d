"""What the output of a gyroscope may be at a constant rate: the laws that compete, and what may be added to each.

    output = clip(offset of the curve + sum of coefficients times columns of the rate + extras, lower limit, upper limit)

The coefficients enter linearly; a law has up to three further shape parameters, each in its own unit.  Sources: IEEE 1431 (scale,
asymmetry, dead band, hysteresis); Lefevre, The Fiber-Optic Gyroscope, chapters 2 and 5 (Sagnac phase, modulation depth, demodulation).

A law is no ``tinygc.effects.effect.Effect``: it is the whole output in the output's own unit, its zero and scale not known, where an
effect corrects a rate in rad/s; its shape parameters bound a search; and nothing is corrected by it, so that no C follows.  The writer of C
knows sums, products and magnitudes, and no sine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from tinygc.features.tables.rates.points import Points


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
class Column:
    """What a coefficient multiplies: symbol, as the equation has it, the coefficient's name first; power of °/s in its unit; at(rate (N,)
    °/s, *shape) -> (N,); words, where it may be added to a law."""

    symbol: str
    power: int
    at: Callable[..., np.ndarray]
    words: str = ""

    @property
    def name(self) -> str:
        """Of its coefficient."""
        return self.symbol.split()[0]


@dataclass(frozen=True, eq=False)
class Law:
    """words; equation, with the names of its parameters; coefficients: their columns; shapes."""

    words: str
    equation: str
    coefficients: tuple[Column, ...]
    shapes: tuple[Shape, ...] = ()

    def columns(self, rate: np.ndarray, shape: tuple[float, ...]) -> np.ndarray:
        """(N, K) at rates (N,) °/s, for the shape parameters."""
        return np.stack([each.at(rate, *shape) for each in self.coefficients], axis=1)

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


def _demodulated(rate: np.ndarray, rate_per_rad: float, depth: float, limit: float) -> np.ndarray:
    """First harmonic, out of a signal of constant size whose upper side saturates at ``limit`` of its rms."""
    sizes, which = np.unique(np.abs(rate), return_inverse=True)
    signal = np.cos((sizes / rate_per_rad)[:, None] + depth * _COSINE)
    signal = signal - signal.mean(axis=1, keepdims=True)
    signal /= np.sqrt(np.mean(signal**2, axis=1, keepdims=True))
    harmonic = -2 * np.minimum(signal, limit) @ _COSINE / len(_COSINE)
    return harmonic[which] * np.sign(rate)


def _overloaded(rate: np.ndarray, rate_per_rad: float, limit: float, order: float) -> np.ndarray:
    """A sine whose amplifier loses its gain where the signal is beyond ``limit`` of its amplitude."""
    sine = np.sin(rate / rate_per_rad)
    found: np.ndarray = sine / (1 + (np.abs(sine) / limit) ** order)
    return found


_BEND = Shape("w0", "°/s", (0.4, 0.8, 2.0), (0.1, 20.0))
_PHASE = Shape("w0", "°/s", (0.4, 0.6, 1.0, 2.0), (0.2, 20.0))
_K = Column("K w", 1, lambda w: w)
_q = Column("q w²", 2, lambda w: w**2)
_c = Column("c w³", 3, lambda w: w**3, "a cubic term")
_a = Column("a |w|", 1, np.abs, "asymmetry")


def _A(at: Callable[..., np.ndarray]) -> tuple[Column]:
    return (Column("A", 0, at),)


LAWS: dict[str, Law] = {
    "line": Law("a straight line", "K w", (_K,)),
    "asymmetry": Law("two slopes, one for each sense", "K w + a |w|", (_K, _a)),
    "quadratic": Law("a parabola", "K w + q w²", (_K, _q)),
    "cubic": Law("a cubic", "K w + c w³", (_K, _c)),
    "polynomial": Law("a polynomial of the third order", "K w + q w² + c w³", (_K, _q, _c)),
    "tanh": Law("soft saturation (tanh)", "A tanh(w / w0)", _A(lambda w, c: np.tanh(w / c)), (_BEND,)),
    "arctan": Law("soft saturation (arctan)", "A arctan(w / w0)", _A(lambda w, c: np.arctan(w / c)), (_BEND,)),
    "root": Law(
        "soft saturation (root)",
        "K w / √(1 + (w / w0)²)",
        (Column("K", 1, lambda w, c: w / np.sqrt(1 + (w / c) ** 2)),),
        (_BEND,),
    ),
    "sine": Law("a sine: an open-loop interferometer", "A sin(w / w0)", _A(lambda w, c: np.sin(w / c)), (_PHASE,)),
    "sine_of_any_phase": Law(
        "a sine whose phase at rest is not zero",
        "A sin(w / w0) + B (cos(w / w0) − 1)",
        (*_A(lambda w, c: np.sin(w / c)), Column("B", 0, lambda w, c: np.cos(w / c) - 1)),
        (_PHASE,),
    ),
    "normalised_sine": Law(
        "an interferometer whose mean light is held constant",
        "A sin x / (1 + j cos x); x = w / w0",
        _A(lambda w, c, j: np.sin(w / c) / (1 + j * np.cos(w / c))),
        (_PHASE, Shape("j", "1", (-0.2, 0.25), (-0.41, 0.9))),
    ),
    "overloaded_sine": Law(
        "an interferometer whose amplifier loses gain in overload",
        "A s / (1 + (|s| / b)^n); s = sin(w / w0)",
        _A(_overloaded),
        (_PHASE, Shape("b", "1", (0.8, 1.05), (0.2, 3.0)), Shape("n", "1", (4.0, 10.0), (1.0, 40.0))),
    ),
    "demodulator": Law(
        "an interferometer whose detector signal is held at one size and saturates",
        "A H1[min(s / rms(s), b)]; s = cos(x + m cos t) less its mean, x = w / w0, H1 the harmonic of cos t",
        _A(_demodulated),
        (_PHASE, Shape("m", "rad", (1.8, 2.7, 3.1), (0.5, 4.5)), Shape("b", "1", (-0.4, 0.7), (-1.0, 3.0))),
    ),
    "dead_band": Law(
        "a dead band about rest",
        "K (w − clip(w, ±d))",
        (Column("K", 1, lambda w, d: w - np.clip(w, -d, d)),),
        (Shape("d", "°/s", (0.02, 0.1, 0.3), (0.0, 0.8)),),
    ),
    "pieces": Law(
        "two straight pieces",
        "K w + h max(w − w1, 0)",
        (Column("K", 1, lambda w, c: w), Column("h", 1, lambda w, c: np.maximum(w - c, 0.0))),
        (Shape("w1", "°/s", (-0.5, -0.2, 0.2, 0.5), (-0.9, 0.9)),),
    ),
}


#: the smooth curve that no law names (``curve.py``)
CURVE = "curve"
_CURVE = Law("a smooth curve of no law in the list", "K w + f(w); f smooth", (_K,))

#: columns next to a law; those of the points' direction and order, and of one of them, are zero at other rates
EXTRAS: dict[str, Column] = {
    "asymmetry": _a,
    "hysteresis": Column("h direction / 2", 0, np.zeros_like, "hysteresis"),
    "drift": Column("u order", 0, np.zeros_like, "a drift in the order of the rows"),
    "turning": Column("t [w ≠ 0]", 0, lambda rate: (rate != 0).astype(float), "an offset while the table turns"),
    "bend": _c,
    "sense": Column("z sign(w)", 0, np.sign, "a step with the sense"),
    "apart": Column("r [one reading]", 0, np.zeros_like, "one reading off"),
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
        inside = " + ".join(["V0", law, *(EXTRAS[name].symbol for name in self.all_extras)])
        low, high = "V−" if self.lower else "−∞", "V+" if self.upper else "∞"
        return (f"V = clip({inside}, {low}, {high})" if self.lower or self.upper else f"V = {inside}") + (f"; {rest}" if rest else "")

    def columns(self, rate: np.ndarray, shape: tuple[float, ...], points: Points | None = None) -> np.ndarray:
        """(N, K + E) columns of the law's coefficients and of the extras, at rates (N,); points: which these are, None where they are none.

        Where they are none, nothing is known of their direction and order, and none is the reading apart.
        """
        own = {}
        if points is not None:
            own = {"hysteresis": points.direction / 2, "drift": points.order, "apart": (np.arange(len(rate)) == self.apart).astype(float)}
        extras = [own[name] if name in own else EXTRAS[name].at(rate) for name in self.all_extras]
        return np.column_stack([self.of.columns(rate, shape), *extras])

    @property
    def all_extras(self) -> tuple[str, ...]:
        """Its extras, and the reading that is apart."""
        return (*self.extras, *["apart"] * (self.apart >= 0))

    @property
    def coefficients(self) -> tuple[Column, ...]:
        """What is fitted next to the offsets."""
        return (*self.of.coefficients, *map(EXTRAS.__getitem__, self.all_extras))
