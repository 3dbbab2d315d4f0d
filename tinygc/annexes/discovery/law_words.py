"""A law's constants and terms as a person writes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import floor, isfinite, log10

import numpy as np

from session.io.units import DEG
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.quantities import FUNCTIONS
from tinygc.annexes.discovery.words import equation, in_words

# What each number of a law adds to, and what it follows: ``x ← y``.

#: of a function with phases, each of its numbers
PHASES = {2: ("cos", "sin"), 6: ("cos", "sin", "cos 3", "sin 3", "cos 5", "sin 5")}
ARROW = " ← "


def terms_of(form: LawForm) -> list[str]:
    """Of each coefficient, in order: the axis that it adds to, and, of more than one for each axis, what it is of."""
    terms = form.terms()
    if form.size == 3:
        return ["xyz"[term.axis] for term in terms]
    return ["xyz"[term.axis] + ARROW + _followed(form, term.parts) for term in terms]


def _followed(form: LawForm, parts: tuple[tuple[Factor, int], ...]) -> str:
    words = [_component(factor, component) for factor, component in parts]
    if form.pattern == "leant":  # the first is of the axis itself
        words[0] = words[0][1:].strip()
    if form.pattern in ("full", "cross", "each") and len(words) == 2 and words[0][:1] == words[1][:1]:
        words[1] = words[1][1:].strip()  # both are of one axis, which is said once
    return " ".join(word for word in words if word)


def _component(factor: Factor, component: int) -> str:
    """``y``, ``y cos``, ``y 2 sin``: axis, direction in the world, phase; nothing of a scalar."""
    phases, directions = factor.through.phases, factor.of.directions
    axis = "xyz"[component // factor.each] if factor.vector else ""
    direction = str(component % factor.each // phases + 1) if directions > 1 else ""
    phase = PHASES[phases][component % phases] if phases > 1 else ""
    return " ".join(word for word in (axis, direction, phase) if word)


# A form's constants as a file has them: by name, in a person's unit, to as many digits as they are known.

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


def constants_of(form: LawForm, sigmas: Sequence[float] = ()) -> list[Constant]:
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


def rounded(form: LawForm, sigmas: Sequence[float] = ()) -> LawForm:
    """The form with its constants as a file has them."""
    return form.with_constants(tuple(constant.value for constant in constants_of(form, sigmas)))


# What a written file says of a form beside its words: the parameter's name, what one number of it means, and where it is seen.

#: quantities that are zero at rest, and functions that are not zero there
OF_TURNS = ("rate", "rate_size", "acceleration", "acceleration_size", "jerk")
NOT_AT_ZERO = ("decay", "wave", "clock")
#: quantities that follow the rate sample by sample
OF_THE_RATE = ("rate", "rate_size", "acceleration", "acceleration_size", "jerk")
#: of the energy that the accelerometer passes (gyro.vibration_rectification, benchmarks/vibration.py)
VIBRATION_KNOWN_TO = 0.1
#: of all that a function gives between minus and plus three, what it changes by from one of so many steps to the next where it jumps
JUMP, STEPS = 0.1, 30_001
#: quantities that jump, whatever the function, when a turn begins or turns over
JUMPING = ("sense", "rest")
#: signs of a unit and what a name has for them
LETTERS = (
    ("°C", "c"),
    ("(", ""),
    (")", ""),
    ("/", "_per_"),
    ("·", "_"),
    ("√", "root_"),
    ("²", "2"),
    ("³", "3"),
    ("⁴", "4"),
    ("⁶", "6"),
    ("^", "_"),
)
#: signs of a sentence that names a number and what it follows: a check's longest is 300
LONGEST = 230


def unit_of(form: LawForm) -> tuple[str, str]:
    """Of a coefficient, as a person reads it, and the coefficients' name in the JSON: dps/°C, ``dps_per_c``."""
    unit = name = form.coefficient_unit
    for sign, letters in LETTERS:
        name = name.replace(sign, letters)
    return unit, name.replace(".", "_")


def follows(form: LawForm) -> str:
    """What the error does, in a part of a sentence."""
    words = in_words(form).rstrip(".")
    words = words if len(words) <= LONGEST else equation(form).split(", ")[0]
    return words.replace("The error of", "the error of", 1)


def seen_in(form: LawForm) -> tuple[str, ...]:
    """Turns alone, where a factor is zero at rest and remembers nothing."""
    of_turns = any(
        f.quantity in OF_TURNS and f.lag_s is None and not f.through.memory and f.function not in NOT_AT_ZERO for f in form.factors
    )
    return ("turn",) if of_turns else ("still", "turn")


def known_to(form: LawForm) -> float:
    """Share to which what it follows can be known, which no residual shows."""
    return round(sum(VIBRATION_KNOWN_TO * float(factor.through.power) for factor in form.factors if factor.quantity == "vibration"), 3)


def jumps(form: LawForm) -> bool:
    """Whether a rate that changes a little may change what it adds by much."""
    return any(_jumps(factor) for factor in form.factors)


def _jumps(factor: Factor) -> bool:
    if factor.lag_s is not None:
        return False
    return factor.quantity in JUMPING or (factor.quantity in OF_THE_RATE and function_jumps(factor.function))


@cache
def function_jumps(name: str) -> bool:
    """Whether a function jumps somewhere: a threshold, a sign, a rounding."""
    values = FUNCTIONS[name].of(np.linspace(-3.0, 3.0, STEPS), 1.0)
    return bool(np.abs(np.diff(values, axis=0)).max() > JUMP * np.ptp(values))
