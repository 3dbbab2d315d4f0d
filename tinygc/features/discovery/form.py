"""Forms of a law: the quantities and functions that multiply, the axes that they add to, and their units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import isfinite

import numpy as np

from tinygc.effects import Movement, Reach, signals
from tinygc.features.discovery.quantities import FUNCTIONS, QUANTITIES, Function, SignalQuantity

# Units of quantities and products of them: powers of g, °C, s and rad, and the printed text.

#: power of each base unit; a pure number has none
Unit = Mapping[str, Fraction]

BASES = ("g", "°C", "s", "rad")
RAISED = {Fraction(2): "²", Fraction(3): "³", Fraction(4): "⁴", Fraction(6): "⁶"}
NUMBERS = {sign: power for power, sign in RAISED.items()}
#: rad/s, a coefficient's own unit before division by its product's unit
RATE = "dps"


def unit_of(text: str) -> Unit:
    """Parse a quantity's unit: products of bases with ² or ³, and one slash: ``°C/s``, ``1/s²``, ``g²``, ``1``.  Raises ValueError."""
    found: dict[str, Fraction] = {}
    above, _, below = text.partition("/")
    for part, sign in ((above, 1), (below, -1)):
        for word in part.strip("()").split("·"):
            base = word.rstrip("".join(NUMBERS))
            if base not in ("", "1", *BASES):
                raise ValueError(f"{text!r} is no unit of a quantity: expected products of {', '.join(BASES)} with ² or ³, and one slash")
            if base in BASES:
                found[base] = found.get(base, Fraction(0)) + sign * NUMBERS.get(word[len(base) :], Fraction(1))
    return {base: power for base, power in found.items() if power}


def product(*parts: tuple[Unit, int | Fraction]) -> Unit:
    """The product of units, each raised to a power."""
    found = {base: sum((unit.get(base, Fraction(0)) * power for unit, power in parts), Fraction(0)) for base in BASES}
    return {base: power for base, power in found.items() if power}


def text_of(unit: Unit, over: str = "1") -> str:
    """``over`` divided by the unit: ``dps/(g·°C)``, ``dps·s/°C``, ``dps/√g``."""
    above = [_raised(base, -power) for base, power in unit.items() if power < 0]
    below = [_raised(base, power) for base, power in unit.items() if power > 0]
    first = "·".join([over, *above]) if over != "1" or not above else "·".join(above)
    if not below:
        return first
    return f"{first}/{below[0]}" if len(below) == 1 else f"{first}/({'·'.join(below)})"


def _raised(base: str, power: Fraction) -> str:
    if power == 1:
        return base
    if power == Fraction(1, 2):
        return f"√{base}"
    return base + RAISED.get(power, f"^{float(power):g}")


# A form: the quantities and functions that multiply and the axes that they add to; everything but the coefficients.


@dataclass(frozen=True)
class Factor:
    """A function of a quantity; constant: of the function, in the quantity's unit; lag_s: of a first-order lag after both.

    It has ``len(quantity.components) * function.phases`` components, the phases of one component adjacent.  ValueError where the result has
    no proper unit, such as an exponent without a scale in the quantity's unit.
    """

    quantity: str
    function: str = "itself"
    constant: float | None = None
    lag_s: float | None = None

    def __post_init__(self) -> None:
        for name, known, what in ((self.quantity, QUANTITIES, "quantity"), (self.function, FUNCTIONS, "function")):
            if name not in known:
                raise ValueError(f"{name!r} is no {what}; there are {', '.join(known)}")
        needed, unit = self.through.constant, self.of.unit
        if needed is None and self.constant is not None:
            raise ValueError(f"{self.function} of {self.quantity} takes no constant, got {self.constant}")
        if needed is not None and (self.constant is None or not 0 < self.constant < np.inf):
            expected = "a positive number" if unit == "1" else f"a positive number of {unit}"
            raise ValueError(f"{self.function} of {self.quantity} has no proper unit without its {needed}, {expected}; got {self.constant}")
        if self.lag_s is not None and not (isfinite(self.lag_s) and self.lag_s > 0):
            raise ValueError(f"a lag of {self.quantity} is a positive number of seconds, got {self.lag_s}")

    @property
    def unit(self) -> Unit:
        """The unit of its values."""
        return product((unit_of(self.of.unit), self.through.power))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs that it reads in addition to the rate, as an ``Effect`` declares them."""
        return tuple(dict.fromkeys([*self.of.inputs, *(["time"] if self.through.memory else [])]))

    @property
    def reach(self) -> Reach:
        """How far around a sample it looks, including its lag and its function's memory."""
        late = Reach() if self.lag_s is None else signals.lag_reach(self.lag_s)
        return self.of.reach + late + (signals.WHOLE if self.through.memory else Reach())

    @property
    def of(self) -> SignalQuantity:
        """Its quantity."""
        return QUANTITIES[self.quantity]

    @property
    def through(self) -> Function:
        """Its function."""
        return FUNCTIONS[self.function]

    @property
    def canonical(self) -> tuple:
        """Quantity, function, constant and lag; a function without a constant as its power, and whether that is odd."""
        power = (self.through.power, self.through.odd and not self.of.positive)
        return self.quantity, power if self.constant is None else self.function, self.constant, self.lag_s

    @property
    def vector(self) -> bool:
        """Whether it has an axis."""
        return self.of.vector

    @property
    def each(self) -> int:
        """Components of each axis, or of a scalar: directions times phases."""
        return self.of.directions * self.through.phases

    def values(self, movement: Movement, known: np.ndarray | None = None) -> np.ndarray:
        """Values in a movement, (N, components); known: the values of its quantity, where already computed."""
        known = self.of.of(movement) if known is None else known
        found = self.through.of(known, self.constant or 1.0).reshape(len(known), -1)
        return found if self.lag_s is None else signals.lagged(found, self.lag_s, movement.t_s)


#: one coefficient: the axis to whose rate it adds, in rad/s, the product of these components of factors
Parts = tuple[tuple[Factor, int], ...]
Term = tuple[int, Parts]


#: each: axis i follows axis i; full: any axis follows any axis, by a matrix; cross: any axis follows any other; next, last: the first
#: factor of the axis behind times the second of the one before, or the other way round; leant: own first factor times any axis' second,
#: by a matrix
PATTERNS = ("each", "full", "cross", "next", "last", "leant")


def patterns_of(factors: tuple[Factor, ...]) -> tuple[str, ...]:
    """The patterns that the factors allow: a scalar has no axis, so it adds to all axes alike."""
    vectors = sum(factor.vector for factor in factors)
    return PATTERNS if vectors == 2 else PATTERNS[:3] if vectors else PATTERNS[:1]


@dataclass(frozen=True)
class LawForm:
    """One or two factors and a pattern of axes.  ValueError for a pattern that the factors cannot have."""

    factors: tuple[Factor, ...]
    pattern: str = "each"

    def __post_init__(self) -> None:
        if not 1 <= len(self.factors) <= 2:
            raise ValueError(f"a form has one factor or two, got {len(self.factors)}")
        if self.pattern not in patterns_of(self.factors):
            kinds = " times ".join(f"{factor.quantity} ({'vector' if factor.vector else 'scalar'})" for factor in self.factors)
            raise ValueError(f"{kinds} has no pattern {self.pattern!r}; it may have {', '.join(patterns_of(self.factors))}")

    @property
    def coefficient_unit(self) -> str:
        """Unit of each coefficient as printed: ``dps/(g·°C)``."""
        return text_of(product(*((factor.unit, 1) for factor in self.factors)), RATE)

    def terms(self) -> tuple[Term, ...]:
        """One term for each coefficient, row by row of its matrix where it has one."""
        found = []
        for axis in range(3):
            for axes in self._axes(axis):
                found += [(axis, parts) for parts in _components(self.factors, axes)]
        return tuple(found)

    def _axes(self, axis: int) -> list[tuple[int, ...]]:
        """For each product that adds to this axis, the axis of every factor (0 for a scalar, which has none)."""
        behind, before = (axis + 1) % 3, (axis + 2) % 3
        if self.pattern == "next":
            return [(behind, before)]
        if self.pattern == "last":
            return [(before, behind)]
        if self.pattern == "leant":
            return [(axis, other) for other in range(3)]
        others = {"each": [axis], "full": [0, 1, 2], "cross": [behind, before]}[self.pattern]
        return [tuple(other for _ in self.factors) for other in others]

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs that an ``Effect`` of it declares."""
        return tuple(dict.fromkeys(name for factor in self.factors for name in factor.inputs))

    @property
    def reach(self) -> Reach:
        """How far around a sample it looks."""
        return sum((factor.reach for factor in dict.fromkeys(self.factors)), Reach())

    @property
    def remembers(self) -> bool:
        """Whether it depends on the whole log."""
        return self.reach.before_s >= signals.WHOLE.before_s

    @property
    def is_scale_law(self) -> bool:
        """Whether each axis has one coefficient that multiplies its own rate, without memory."""
        odd = sum(factor.quantity == "rate" and factor.through.odd for factor in self.factors)
        return self.pattern == "each" and self.size == 3 and not self.reach and odd == 1

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.terms())

    @property
    def parameter_shape(self) -> tuple[int, ...]:
        """Shape of the coefficients: a row for each axis."""
        return (3,) if self.size == 3 else (3, self.size // 3)

    @property
    def constants(self) -> tuple[float, ...]:
        """Constants and lags of its factors, in order."""
        return tuple(value for factor in self.factors for value in (factor.constant, factor.lag_s) if value is not None)

    def with_constants(self, values: tuple[float, ...] | np.ndarray) -> LawForm:
        """The same form with other constants, in the same order."""
        left = [float(value) for value in values][::-1]
        factors = []
        for factor in self.factors:
            constant = None if factor.constant is None else left.pop()
            lag_s = None if factor.lag_s is None else left.pop()
            factors.append(replace(factor, constant=constant, lag_s=lag_s))
        return replace(self, factors=tuple(factors))

    @property
    def canonical(self) -> tuple:
        """The same for forms that are equal by algebra: a product has no order, and powers of one quantity multiply."""
        factors, pattern = [factor.canonical for factor in self.factors], self.pattern
        if pattern == "last":
            factors, pattern = factors[::-1], "next"
        elif pattern in ("each", "full", "cross"):
            factors.sort(key=repr)
            (name, one, *rest), (other, two, *more) = factors[0], factors[-1]
            if len(factors) == 2 and (name, rest) == (other, more) == (name, [None, None]):
                power = one[0] + two[0]
                factors = [(name, (power, one[1] != two[1] and not QUANTITIES[name].positive), None, None)]
        return pattern, *factors

    @cached_property
    def shape(self) -> LawForm:
        """The form without its constants: what forms that differ by constants alone have in common."""
        return self.with_constants(np.ones(len(self.constants)))


def _components(factors: tuple[Factor, ...], axes: tuple[int, ...]) -> list[Parts]:
    """Every combination of directions and phases of the factors at these axes."""
    found: list[Parts] = [()]
    for factor, axis in zip(factors, axes, strict=True):
        first = axis * factor.each if factor.vector else 0
        found = [(*parts, (factor, first + k)) for parts in found for k in range(factor.each)]
    return found
