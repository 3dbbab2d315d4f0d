"""Describe a law: its equation, a sentence, names of files and parameters, its constants and terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import floor, isfinite, log10

import numpy as np

from session.base.texts import significant
from session.base.units import DEG
from tinygc.features.discovery.form import Factor, LawForm
from tinygc.features.discovery.quantities import FUNCTIONS

#: quantities that follow the rate sample by sample, and so are zero at rest
OF_TURNS = ("rate", "rate_size", "acceleration", "acceleration_size", "speed_slope", "jerk")
#: definition of an equation's symbol, where it is not one of the catalogue's
SYMBOLS = {
    **dict.fromkeys(OF_TURNS, "u = ω / FS"),
    "force": "f in g",
    "temperature": "T in °C",
    "temperature_rate": "T′ in °C/s",
    "time": "t since the session began",
    "rest": "t_r since the last turn",
    "vibration": "v² the mean square of the vibration in g²",
    "turned": "α the angle turned",
    "sense": "s the sense of the last turn",
    "level": "n two level directions fixed in the world",
    "world": "e three directions fixed in the world",
}
#: a quantity in a sentence
SHORT = {
    "rate": "the rate",
    "rate_size": "the size of the whole rate",
    "acceleration": "the angular acceleration",
    "acceleration_size": "the size of the whole angular acceleration",
    "speed_slope": "the rate of change of the size of the whole rate",
    "jerk": "the angular jerk",
    "temperature": "the temperature since the session's beginning",
    "time": "the time since the session began",
}
#: a constant by its quantity's unit: the displayed unit in an equation, in a sentence and in the JSON, the size of that, ending of a name
UNITS = {
    "rad": ("°", "°", "deg", DEG, "deg"),
    "1": ("", " of full scale", "", 1.0, "share"),
    "g": (" g", " g", "g", 1.0, "g"),
    "g²": (" g²", " g²", "g²", 1.0, "g2"),
    "s": (" s", " s", "s", 1.0, "s"),
    "°C": (" °C", " °C", "°C", 1.0, "c"),
    "°C/s": (" °C/s", " °C/s", "°C/s", 1.0, "c_per_s"),
    "1/s": ("/s", " full scales a second", "1/s", 1.0, "per_s"),
    "1/s²": ("/s²", " full scales a second squared", "1/s²", 1.0, "per_s2"),
}
#: a quantity in a name
NAMES = {"rate_size": "speed", "acceleration_size": "jolt", "speed_slope": "speeding", "temperature_rate": "warming"}
#: a function and a quantity in a name that would be too long
BRIEF = {
    **{"signed_square": "ssq", "size_cube": "acube", "signed_root": "sroot", "root_cube": "r32", "size_root_cube": "a32"},
    **{"dead_zone": "dz", "signed_beyond": "sstep", "beyond": "step", "square": "sq", "excess": "over"},
    **{"temperature": "temp", "acceleration": "accel", "vibration": "vib", "warming": "warming"},
}
LONGEST = 40
#: what to vary deliberately, for each quantity
SPLITS = {
    "rate": "turn about each axis slowly and fast, in both senses",
    "rate_size": "turn slowly and fast, and look at the axes that do not turn",
    "force": "hold each axis up, down and level, and turn it there",
    **dict.fromkeys(("acceleration", "jerk"), "start and stop turns softly and briskly"),
    **dict.fromkeys(("acceleration_size", "speed_slope"), "start and stop turns softly and briskly, and look at the axes that do not turn"),
    "temperature": "let the sensor warm up, and cool, while you record",
    "temperature_rate": "change the temperature fast, then hold it",
    "time": "record again, begun at another time after switch-on",
    "rest": "rest for a second, for ten, and for a minute between turns",
    "vibration": "repeat the same turns with and without the vibration",
    "turned": "turn one axis on and on in one sense, then back",
    "sense": "come to the same rest from either sense of turning",
    **dict.fromkeys(("level", "world"), "hold the same attitudes at four headings"),
}
#: the catalogue's variables and their units; of two quantities, the first in this order is the plotted variable
REGIMES = {
    **dict.fromkeys(("temperature", "temperature_rate"), ("temperature", "°C")),
    "vibration": ("vibration", "g²"),
    **dict.fromkeys(("time", "rest", "turned", "sense"), ("time", "s")),
    **dict.fromkeys(("level", "world", "force"), ("attitude", "g")),
    **dict.fromkeys(("jerk", "acceleration", "acceleration_size", "speed_slope"), ("angular acceleration", "rad/s²")),
    **dict.fromkeys(("rate_size", "rate"), ("rate", "dps")),
}
NEIGHBOURS = "i, j, k = x, y, z in turn"
#: abbreviation in an equation -> definition
ABBREVIATIONS = {
    "lag": "lag(x, τ) first-order",
    "dz": "dz(x, c) = x beyond ±c",
    "clip": "clip(x, ±c) = x held within ±c",
    "saw": "saw(x, c) = x / c less its nearest whole number",
    "play": "play(x, c) = x followed with a play of ±c",
    "latch": "latch(x, c) = the sign of x when it was last beyond ±c",
}


def equation(form: LawForm) -> str:
    """One line in the catalogue's style: constants in displayed units, then the definitions of its symbols."""
    indices = {"each": "ii", "full": "jj", "cross": "jj", "next": "jk", "last": "kj", "leant": "ij"}[form.pattern]
    shown = [_shown(factor, index) for factor, index in zip(form.factors, indices, strict=False)]
    waves = [factor for factor in form.factors if factor.through.phases > 1]
    weight = "c_i" if indices[0] == "i" or form.pattern in ("next", "last") else "C_ij"
    weight = "" if waves else f"{weight} "
    own = " ".join(shown)
    if form.pattern == "leant":
        first, second = shown
        law = f"{first} Σ_j {weight and 'C_ij '}{second}"
    else:
        law = {"full": "Σ_j ", "cross": "Σ_j≠i "}.get(form.pattern, "") + weight + own
    notes = [SYMBOLS[factor.quantity] for factor in form.factors]
    notes += [NEIGHBOURS] if form.pattern in ("next", "last") else []
    notes += abbreviations(law)
    return ", ".join([f"ω_i += {law}", *dict.fromkeys(notes)])


def abbreviations(text: str) -> list[str]:
    """Definitions of the abbreviations that an equation uses."""
    return [meaning for name, meaning in ABBREVIATIONS.items() if f"{name}(" in text]


def _shown(factor: Factor, index: str) -> str:
    symbol = factor.of.symbol.replace("{i}", index)
    text = factor.through.shown
    if factor.of.positive:
        text = text.replace("|{x}|", "{x}")
    if symbol.endswith("²") and ("{x}²" in text or "{x}√" in text):
        symbol = f"({symbol})"
    if symbol.startswith("(") and "({x}" in text and "({x})" in text:
        symbol = symbol.strip("()")
    constant = _constant(factor, 0)
    if factor.function in ("wave", "clock"):
        matrix = "ij" if index == "j" else "i"
        argument = f"{symbol} / {constant}"
        if factor.function == "wave":
            return f"(a_{matrix} cos 2π{argument} + b_{matrix} sin 2π{argument})"
        return f"Σ_n (a_{matrix}n cos 2πn{argument} + b_{matrix}n sin 2πn{argument}) with n = 1, 3, 5"
    text = text.replace("{x}", symbol).replace("{c}", constant)
    return text if factor.lag_s is None else f"lag({text}, {_number(factor.lag_s)} s)"


def _number(value: float) -> str:
    return f"{value:.3g}" if value == 0 or 1e-4 <= abs(value) < 1000 else significant(value)


def _constant(factor: Factor, place: int) -> str:
    """Its constant with its unit, in an equation or in a sentence."""
    *units, size, _ = UNITS[factor.of.unit]
    return "" if factor.constant is None else f"{_number(factor.constant / size)}{units[place]}"


def constant_of(form: LawForm, number: int) -> tuple[str, float]:
    """One of a form's constants in a sentence, as ``width (of full scale)``; and how many of the displayed unit its own unit has."""
    found = []
    for factor in form.factors:
        _, unit, _, size, _ = UNITS[factor.of.unit]
        found += [] if factor.constant is None else [(f"{factor.through.constant} ({unit.strip()})", 1 / size)]
        found += [] if factor.lag_s is None else [("lag (s)", 1.0)]
    return found[number]


def in_words(form: LawForm) -> str:
    """One sentence in plain words."""
    words = [_words(factor) for factor in form.factors]
    late = ["" if factor.lag_s is None else f" (through a first-order lag of {_number(factor.lag_s)} s)" for factor in form.factors]
    waved = any(factor.through.phases > 1 or factor.of.directions > 1 for factor in form.factors)
    follows = "follows" if waved else "is proportional to"
    product = ", times ".join(map(str.__add__, words, late))
    if not any(factor.vector for factor in form.factors):
        return f"The error of every axis {follows} {product}, each axis with a factor of its own."
    if form.pattern == "each":
        return f"The error of each axis {follows} {product}, all of that axis."
    if form.pattern in ("full", "cross"):
        which = "all three axes" if form.pattern == "full" else "the other two axes"
        return f"The error of each axis is a weighted sum, over {which}, of {product}."
    if form.pattern == "leant":
        own = f"{words[0]} of that axis{late[0]}"
        return f"The error of each axis is {own}, times a weighted sum over all three axes of {words[1]}{late[1]}."
    one, other = ("the next axis", "the one after that") if form.pattern == "next" else ("the axis after the next", "the next one")
    return (
        f"The error of each axis {follows} {words[0]} of {one}{late[0]}, times {words[1]} of {other}{late[1]} "
        "(after x comes y, after y z, after z x)."
    )


def _words(factor: Factor) -> str:
    text = factor.through.words
    if factor.of.positive:
        text = text.replace("the size of {x}", "{x}").replace("its size", "it")
    return text.replace("{x}", SHORT.get(factor.quantity, factor.of.words)).replace("{c}", _constant(factor, 1))


def what(form: LawForm) -> str:
    """A name for an id and a file: snake case, at most ``LONGEST`` characters; forms that differ by constants alone share it."""
    for brief in (False, True):
        words = [word for factor in form.factors for word in _named(factor, brief)]
        words += [] if form.pattern == "each" else [form.pattern]
        name = "_".join(words)
        if len(name) <= LONGEST:
            return name
    return name[:LONGEST].rstrip("_")


def _named(factor: Factor, brief: bool) -> list[str]:
    found = ["late"] if factor.lag_s is not None else []
    found += [] if factor.function == "itself" else [factor.function]
    found.append(NAMES.get(factor.quantity, factor.quantity))
    return [BRIEF.get(word, word) for word in found] if brief else found


def splits(form: LawForm) -> str:
    """The movements or conditions that would show it best: a phrase for each quantity."""
    return "; ".join(dict.fromkeys(SPLITS[factor.quantity] for factor in form.factors))


def regime(form: LawForm) -> tuple[str, str]:
    """Variable and unit that it is plotted against: for a product, the condition rather than the rate that it multiplies."""
    order = list(REGIMES)
    return REGIMES[min((factor.quantity for factor in form.factors), key=order.index)]


# The axis that each coefficient of a law adds to, and what it follows: ``x ← y``.

#: phases of a function, by their number
PHASES = {2: ("cos", "sin"), 6: ("cos", "sin", "cos 3", "sin 3", "cos 5", "sin 5")}
ARROW = " ← "


def terms_of(form: LawForm) -> list[str]:
    """For each coefficient, in order: the axis that it adds to, and, where an axis has several, what it follows."""
    terms = form.terms()
    if form.size == 3:
        return ["xyz"[axis] for axis, _ in terms]
    return ["xyz"[axis] + ARROW + _followed(form, parts) for axis, parts in terms]


def _followed(form: LawForm, parts: tuple[tuple[Factor, int], ...]) -> str:
    words = [_component(factor, component) for factor, component in parts]
    if form.pattern == "leant":  # the first factor has the axis itself
        words[0] = words[0][1:].strip()
    if form.pattern in ("full", "cross", "each") and len(words) == 2 and words[0][:1] == words[1][:1]:
        words[1] = words[1][1:].strip()  # both have the same axis, which is named once
    return " ".join(word for word in words if word)


def _component(factor: Factor, component: int) -> str:
    """``y``, ``y cos``, ``y 2 sin``: axis, direction in the world, phase; empty for a scalar."""
    phases, directions = factor.through.phases, factor.of.directions
    axis = "xyz"[component // factor.each] if factor.vector else ""
    direction = str(component % factor.each // phases + 1) if directions > 1 else ""
    phase = PHASES[phases][component % phases] if phases > 1 else ""
    return " ".join(word for word in (axis, direction, phase) if word)


#: least weight of a coefficient that is named in words
NAMED = 0.15


def combination(form: LawForm, direction: np.ndarray) -> str:
    """``0.58 (x ← x) + 0.58 (y ← y)``: a combination (P,) of a law's coefficients, its largest weight positive."""
    signed = direction * np.sign(direction[np.argmax(np.abs(direction))])
    parts = [(weight, term) for weight, term in zip(signed, terms_of(form), strict=True) if abs(weight) >= NAMED]
    text = "".join(f" {'+' if weight > 0 else '−'} {abs(weight):.2f} ({term})" for weight, term in parts)
    return text.removeprefix(" + ").strip()


# A form's constants in a file: by name, in displayed units, to the digits that are known.

#: digits after the first of a sigma: rounding changes it by a thousandth
BEYOND_SIGMA = 2
#: digits of a constant of unknown sigma
DIGITS = 5


@dataclass(frozen=True)
class Constant:
    """One of a form's constants: its name in JSON; number: in its unit, rounded; sigma: likewise, None unknown; unit: the displayed one;
    si: the size of that unit."""

    json: str
    number: float
    sigma: float | None
    unit: str
    si: float

    @property
    def value(self) -> float:
        """The value in the quantity's own unit, as in the form."""
        return self.number * self.si


def constants_of(form: LawForm, sigmas: Sequence[float] = ()) -> list[Constant]:
    """The constants in the order of ``form.constants``; sigmas: theirs, in the quantities' own units."""
    given = iter(sigmas or [float("nan")] * len(form.constants))
    found = []
    for number, factor in enumerate(form.factors):
        other = {each.quantity for each in form.factors} != {factor.quantity}
        before = "" if len(form.factors) == 1 else f"{factor.quantity}_" if other else f"{('first', 'second')[number]}_"
        for word, value, unit in ((factor.through.constant, factor.constant, factor.of.unit), ("lag", factor.lag_s, "s")):
            if value is not None:
                _, _, shown, si, ending = UNITS[unit]
                sigma = next(given) / si
                spread = sigma if isfinite(sigma) and sigma > 0 else None
                found.append(Constant(f"{before}{word}_{ending}", _rounded(value / si, spread), spread, shown, si))
    return found


def _rounded(value: float, sigma: float | None) -> float:
    if sigma is not None and sigma < abs(value):
        return round(value, BEYOND_SIGMA - floor(log10(sigma)))
    return float(f"{value:.{DIGITS}g}")


def rounded(form: LawForm, sigmas: Sequence[float] = ()) -> LawForm:
    """The form with its constants rounded as in a file."""
    return form.with_constants(tuple(constant.value for constant in constants_of(form, sigmas)))


# Entries of a written file in addition to its sentence: the parameter's name, its meaning, and where it is observable.

#: functions that are not zero at zero
NOT_AT_ZERO = ("decay", "wave", "clock")
#: uncertainty of the energy that the accelerometer passes (gyro.vibration_rectification, benchmarks/vibration.py)
VIBRATION_KNOWN_TO = 0.1
#: a jump: share of a function's range over −3 to 3 by which it changes within one of so many steps
JUMP, STEPS = 0.1, 30_001
#: quantities that jump, whatever the function, when a turn begins or reverses
JUMPING = ("sense", "rest")
#: characters of a unit and their replacement in a name
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
#: characters of a clause: a check allows 300 for the sentence with its number
LONGEST_CLAUSE = 230


def coefficient_unit(form: LawForm) -> tuple[str, str]:
    """A coefficient's printed unit, and the coefficients' name in the JSON: dps/°C, ``dps_per_c``."""
    unit = name = form.coefficient_unit
    for sign, letters in LETTERS:
        name = name.replace(sign, letters)
    return unit, name.replace(".", "_")


def follows(form: LawForm) -> str:
    """What the error does, as part of a sentence."""
    words = in_words(form).rstrip(".")
    words = words if len(words) <= LONGEST_CLAUSE else equation(form).split(", ")[0]
    return words.replace("The error of", "the error of", 1)


def observable_in(form: LawForm) -> tuple[str, ...]:
    """Turns alone, where a factor is zero at rest and has no memory."""
    of_turns = any(
        f.quantity in OF_TURNS and f.lag_s is None and not f.through.memory and f.function not in NOT_AT_ZERO for f in form.factors
    )
    return ("turn",) if of_turns else ("still", "turn")


def known_to(form: LawForm) -> float:
    """Relative uncertainty of the quantity that it follows, which no residual shows."""
    return round(sum(VIBRATION_KNOWN_TO * float(factor.through.power) for factor in form.factors if factor.quantity == "vibration"), 3)


def jumps(form: LawForm) -> bool:
    """Whether a small change of the rate may change the added rate by much."""
    return any(_jumps(factor) for factor in form.factors)


def _jumps(factor: Factor) -> bool:
    if factor.lag_s is not None:
        return False
    return factor.quantity in JUMPING or (factor.quantity in OF_TURNS and function_jumps(factor.function))


@cache
def function_jumps(name: str) -> bool:
    """Whether a function jumps somewhere: a threshold, a sign, a rounding."""
    values = FUNCTIONS[name].of(np.linspace(-3.0, 3.0, STEPS), 1.0)
    return bool(np.abs(np.diff(values, axis=0)).max() > JUMP * np.ptp(values))
