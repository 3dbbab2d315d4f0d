"""Units of quantities and of what is made of them: powers of g, °C, s and rad, and the text that a person reads."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

#: power of each base unit; a unitless number has none
Unit = Mapping[str, Fraction]

BASES = ("g", "°C", "s", "rad")
RAISED = {Fraction(2): "²", Fraction(3): "³", Fraction(4): "⁴", Fraction(6): "⁶"}
NUMBERS = {sign: power for power, sign in RAISED.items()}
#: rad/s, a coefficient's own unit before what it multiplies
RATE = "dps"


class UnitError(ValueError):
    """A form in which units do not fit."""


def unit_of(text: str) -> Unit:
    """Of a quantity: products of bases with ² or ³, and one slash: ``°C/s``, ``1/s²``, ``g²``, ``1``.  UnitError for any other text."""
    found: dict[str, Fraction] = {}
    above, _, below = text.partition("/")
    for part, sign in ((above, 1), (below, -1)):
        for word in part.strip("()").split("·"):
            base = word.rstrip("".join(NUMBERS))
            if base not in ("", "1", *BASES):
                raise UnitError(f"{text!r} is no unit of a quantity: expected products of {', '.join(BASES)} with ² or ³, and one slash")
            if base in BASES:
                found[base] = found.get(base, Fraction(0)) + sign * NUMBERS.get(word[len(base) :], Fraction(1))
    return {base: power for base, power in found.items() if power}


def product(*parts: tuple[Unit, Fraction]) -> Unit:
    """Of units, each raised to a power."""
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
