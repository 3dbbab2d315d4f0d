"""A form's constants as a file has them: by name, in a person's unit, to as many digits as they are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, isfinite, log10

from session.common.units import DEG
from tinygc.discovery.grammar.form import Form

#: digits behind the first of a sigma: what rounding takes off is a thousandth of it
BEYOND_SIGMA = 2
#: digits of a constant whose sigma nobody knows
DIGITS = 5
#: unit of a quantity -> that of a person, its size in the quantity's unit, Python of that size, ending of a name
PEOPLES = {
    "rad": ("deg", DEG, " * DEG", "deg"),
    "1": ("", 1.0, "", "share"),
    "g": ("g", 1.0, "", "g"),
    "g²": ("g²", 1.0, "", "g2"),
    "s": ("s", 1.0, "", "s"),
    "°C": ("°C", 1.0, "", "c"),
    "°C/s": ("°C/s", 1.0, "", "c_per_s"),
    "1/s": ("1/s", 1.0, "", "per_s"),
    "1/s²": ("1/s²", 1.0, "", "per_s2"),
}


@dataclass(frozen=True)
class Constant:
    """One of ``Form.constants``.  word: what it is, such as ``threshold`` or ``lag``; python: its name in capitals; json: its name there;
    number: in its unit, rounded; sigma: likewise, None unknown; unit: a person's; si: the size of that unit; times: Python of the same;
    of: number of its factor, lag: whether it is a lag."""

    word: str
    python: str
    json: str
    number: float
    sigma: float | None
    unit: str
    si: float
    times: str
    of: int
    lag: bool

    @property
    def value(self) -> float:
        """In the quantity's own unit, as ``Form.constants`` has it."""
        return self.number * self.si

    @property
    def source(self) -> str:
        """Python of its value."""
        return f"{self.number!r}{self.times}"


def constants_of(form: Form, sigmas: Sequence[float] = ()) -> list[Constant]:
    """In the order of ``form.constants``; sigmas: theirs, in the quantities' own units."""
    known = list(sigmas) or [float("nan")] * len(form.constants)
    given = iter(known)
    found = []
    for number, factor in enumerate(form.factors):
        before = f"{factor.quantity}_" if len(form.factors) > 1 and form.factors[0].quantity != form.factors[1].quantity else ""
        before = before or (f"{('first', 'second')[number]}_" if len(form.factors) > 1 else "")
        if factor.constant is not None:
            word = factor.through.constant or "constant"
            found.append(_constant(word, before, factor.constant, next(given), factor.of.unit, number, False))
        if factor.lag_s is not None:
            found.append(_constant("lag", before, factor.lag_s, next(given), "s", number, True))
    return found


def _constant(word: str, before: str, value: float, sigma: float, unit: str, of: int, lag: bool) -> Constant:
    shown, si, times, ending = PEOPLES.get(unit, (unit, 1.0, "", ""))
    name = f"{before}{word}_{ending}".rstrip("_")
    spread = sigma / si if isfinite(sigma) and sigma > 0 else None
    return Constant(word, f"{before}{word}".upper(), name, _rounded(value / si, spread), spread, shown, si, times, of, lag)


def _rounded(value: float, sigma: float | None) -> float:
    if sigma is not None and sigma < abs(value):
        return round(value, BEYOND_SIGMA - floor(log10(sigma)))
    return float(f"{value:.{DIGITS}g}")


def rounded(form: Form, sigmas: Sequence[float] = ()) -> Form:
    """The form with its constants as a file has them."""
    return form.with_constants(tuple(constant.value for constant in constants_of(form, sigmas)))
