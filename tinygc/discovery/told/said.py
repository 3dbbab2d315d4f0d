"""What a written file says of a form: its name, its equation, its unit, where it is seen and what tells it from others."""

from __future__ import annotations

import re

from tinygc.discovery.grammar.form import Factor, Form
from tinygc.discovery.told.constants import Constant, constants_of

#: unit of a quantity -> how a unit's denominator and a name of JSON have it; a rate is a share of full scale
PER = {"°C": "c", "°C/s": "c_per_s", "g": "g", "g²": "g2", "s": "s", "1/s": "fs_per_s", "1/s²": "fs_per_s2", "rad": "rad", "1": ""}
#: function -> power of the quantity's unit that it has; 0 where it gives a number without a unit
POWERS = {"itself": 1, "size": 1, "square": 2, "signed_square": 2, "cube": 3, "size_cube": 3, "root": 0.5, "signed_root": 0.5}
POWERS |= {"root_cube": 1.5, "dead_zone": 1, "within": 1}
#: quantity -> the variable of a picture, with its unit
REGIMES = {
    "rate": ("rate", "dps"),
    "rate_size": ("rate", "dps"),
    "force": ("attitude", "g"),
    "acceleration": ("angular acceleration", "rad/s²"),
    "jerk": ("angular acceleration", "rad/s²"),
    "temperature": ("temperature", "°C"),
    "vibration": ("vibration", "g²"),
}
#: quantities that are zero at rest
OF_TURNS = ("rate", "rate_size", "acceleration", "jerk")


def what(form: Form) -> str:
    """Its name, fit for an id and a file."""
    words = []
    for factor in form.factors:
        words += ["lag"] if factor.lag_s is not None else []
        words += [factor.quantity] if factor.function == "itself" else [factor.quantity, factor.function]
    words += [] if form.pattern == "each" else [form.pattern]
    return "_".join(words)


def equation(form: Form) -> str:
    """In symbols, its constants in people's units."""
    constants = constants_of(form)
    shown = "·".join(_shown(factor, [c for c in constants if c.of == number]) for number, factor in enumerate(form.factors))
    axes = {"full": "Σ_j C_ij ", "cross": "Σ_j≠i C_ij ", "leant": "Σ_j C_ij "}.get(form.pattern, "c_i ")
    return f"ω_i += {axes}{shown.replace('{i}', 'j' if form.pattern in ('full', 'cross') else 'i')}"


def _shown(factor: Factor, constants: list[Constant]) -> str:
    own = {c.lag: f"{c.number:g} {c.unit}".strip() for c in constants}
    text = factor.through.shown.replace("{x}", factor.of.symbol).replace("{c}", own.get(False, ""))
    return f"lag({text}, {own[True]})" if True in own else text


def in_words(form: Form) -> str:
    """What the error follows."""
    constants = constants_of(form)
    return ", times ".join(_words(factor, [c for c in constants if c.of == number]) for number, factor in enumerate(form.factors))


def _words(factor: Factor, constants: list[Constant]) -> str:
    own = {c.lag: f"{c.number:g} {c.unit}".strip() for c in constants}
    text = factor.through.words.replace("{x}", factor.of.words).replace("{c}", own.get(False, ""))
    return f"{text}, through a lag of {own[True]}" if True in own else text


def unit_of(form: Form) -> tuple[str, str]:
    """(unit of a coefficient, its name in the JSON)."""
    shown, names, full_scale = [], [], False
    for factor in form.factors:
        power = POWERS.get(factor.function, 0)
        if not power:
            continue
        if factor.of.unit == "1" or factor.of.unit.startswith("1/s"):
            full_scale |= factor.quantity in ("rate", "rate_size", "acceleration", "jerk")
        if PER.get(factor.of.unit, ""):
            raised = {1: "", 2: "²", 3: "³", 0.5: "^½", 1.5: "^1½"}[power]
            shown.append(
                f"({factor.of.unit}){raised}"
                if raised and not factor.of.unit.isalpha() and factor.of.unit != "°C"
                else factor.of.unit + raised
            )
            names.append(PER[factor.of.unit] + {1: "", 2: "2", 3: "3", 0.5: "_root", 1.5: "_root3"}[power])
    unit = "dps" if not shown else f"dps/{shown[0]}" if len(shown) == 1 else f"dps/({' '.join(shown)})"
    name = "dps" + "".join(f"_per_{each}" for each in names)
    return unit, re.sub(r"_per_per_", "_per_", name) + ("_at_fs" if full_scale and not names else "")


def regime(form: Form) -> tuple[str, str]:
    """The variable it is drawn against: that of its factor of conditions, rather than of the rate that this multiplies."""
    found = [REGIMES.get(factor.quantity, ("time", "s")) for factor in form.factors]
    return found[0] if len(set(found)) == 1 or found[0] != ("rate", "dps") else found[1]


def seen_in(form: Form) -> tuple[str, ...]:
    """Turns alone, where a factor is zero at rest and remembers nothing."""
    of_turns = any(f.quantity in OF_TURNS and f.lag_s is None and f.function not in ("decay", "wave") for f in form.factors)
    return ("turn",) if of_turns else ("still", "turn")


def splits(form: Form) -> str:
    """The movement that tells it from its lookalikes."""
    ways = [WAYS.get(factor.quantity, f"let {factor.of.words} vary, all else alike") for factor in form.factors]
    return " and ".join(dict.fromkeys(ways))


WAYS = {
    "rate": "turn about each axis slowly and fast",
    "rate_size": "turn about each axis slowly and fast",
    "force": "hold each axis up, down and level, and turn it there",
    "acceleration": "start and stop turns gently and hard",
    "jerk": "start and stop turns gently and hard",
    "temperature": "warm the sensor up and let it cool, twice",
    "temperature_rate": "warm the sensor up and let it cool, twice",
    "time": "repeat the session an hour after switching on",
    "rest": "rest for a second and for a minute between turns",
    "vibration": "turn with and without vibration",
    "turned": "turn to and fro, and on and on the same way",
    "sense": "come to the same rest from either sense of turning",
    "level": "begin the same turns at four headings of the table",
}
