"""The C of a law that a device can undo, with the NumPy that does the same in single precision; or the reason why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.told.constants import Constant

#: quantity -> why a device cannot follow it
WHY_NOT = {
    "level": "it follows the heading, which the device does not know",
    "world": "it follows the heading, which the device does not know",
    "acceleration": "it needs samples that are yet to come",
    "jerk": "it needs samples that are yet to come",
    "vibration": "it needs samples that are yet to come",
    "time": "it belongs to the time of that one session",
    "turned": "it follows the angle turned since its session began",
    "rest": "it follows its session from the beginning",
    "sense": "it follows its session from the beginning",
    "force": "it follows the force without its vibration, a mean to which samples belong that are yet to come",
    "temperature_rate": "it follows the last ten seconds of the temperature, and C is not told the data rate",
}


@dataclass(frozen=True)
class DeviceCode:
    """source: Python of the effect's ``device``; functions: what it uses, to stand above."""

    source: str
    functions: str = ""


def device_code(form: Form, constants: Sequence[Constant], name: str) -> DeviceCode:
    """Of a form whose constants have these names."""
    return DeviceCode(f'NoC("{why_not(form) or "no C has been written for it"}")')


def why_not(form: Form) -> str:
    """Why a device cannot undo it, or nothing."""
    for factor in form.factors:
        if factor.quantity in WHY_NOT:
            return WHY_NOT[factor.quantity]
    if any(factor.lag_s is not None for factor in form.factors):
        return "it remembers by a lag, and C is not told the data rate"
    if any(getattr(factor.through, "memory", False) for factor in form.factors):
        return "it follows its session from the beginning"
    return ""
