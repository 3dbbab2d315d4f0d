"""What a written file says of a form beside its words: the parameter's name, what one number of it means, and where it is seen."""

from __future__ import annotations

from functools import cache

import numpy as np

from tinygc.discovery.grammar.form import Factor, Form
from tinygc.discovery.grammar.functions import FUNCTIONS
from tinygc.discovery.grammar.words import equation, in_words

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


def unit_of(form: Form) -> tuple[str, str]:
    """Of a coefficient, as a person reads it, and the coefficients' name in the JSON: dps/°C, ``dps_per_c``."""
    unit = name = form.coefficient_unit
    for sign, letters in LETTERS:
        name = name.replace(sign, letters)
    return unit, name.replace(".", "_")


def follows(form: Form) -> str:
    """What the error does, in a part of a sentence."""
    words = in_words(form).rstrip(".")
    words = words if len(words) <= LONGEST else equation(form).split(", ")[0]
    return words.replace("The error of", "the error of", 1)


def seen_in(form: Form) -> tuple[str, ...]:
    """Turns alone, where a factor is zero at rest and remembers nothing."""
    of_turns = any(
        f.quantity in OF_TURNS and f.lag_s is None and not f.through.memory and f.function not in NOT_AT_ZERO for f in form.factors
    )
    return ("turn",) if of_turns else ("still", "turn")


def known_to(form: Form) -> float:
    """Share to which what it follows can be known, which no residual shows."""
    return round(sum(VIBRATION_KNOWN_TO * float(factor.through.power) for factor in form.factors if factor.quantity == "vibration"), 3)


def jumps(form: Form) -> bool:
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
