"""Units in which people state the terms of a gyroscope's and an accelerometer's noise."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from session.base.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MDPS, MG

UG = 1e-3 * MG  #: m/s^2 per ug
CALLED = {"gyro": "gyroscope", "accel": "accelerometer"}


@dataclass(frozen=True)
class TermUnit:
    """A unit of a term: its words and its value in SI."""

    words: str
    si: float


#: of N, as one-sided density, which data sheets state: sqrt(2) times the two-sided one
ONE_SIDED = {"gyro": TermUnit("mdps/√Hz", MDPS / sqrt(2)), "accel": TermUnit("µg/√Hz", UG / sqrt(2))}
#: by sensor and term; those of N are two-sided
TERM_UNITS = {
    "gyro": {
        "Q": TermUnit("µrad", 1e-6),
        "N": TermUnit("°/√h", DEG_PER_SQRT_HOUR),
        "G": TermUnit("°/h", DEG_PER_HOUR),
        "B": TermUnit("°/h", DEG_PER_HOUR),
        "K": TermUnit("°/h/√h", DEG_PER_HOUR / 60),
        "R": TermUnit("°/h/h", DEG_PER_HOUR / 3600),
    },
    "accel": {
        "Q": TermUnit("µm/s", 1e-6),
        "N": TermUnit("m/s/√h", 1 / 60),
        "G": TermUnit("µg", UG),
        "B": TermUnit("µg", UG),
        "K": TermUnit("µg/√h", UG / 60),
        "R": TermUnit("µg/h", UG / 3600),
    },
}


def duration_words(duration_s: float) -> str:
    """``45 s``, ``12 min``, ``3.1 h``, ``5.2 days``; ``never`` where it is infinite."""
    if duration_s == float("inf"):
        return "never"
    for size, most, unit in ((1, 100, "s"), (60, 100 * 60, "min"), (3600, 48 * 3600, "h")):
        if duration_s < most:
            return f"{duration_s / size:.2g} {unit}" if duration_s < 10 * size else f"{duration_s / size:.0f} {unit}"
    return f"{duration_s / 86400:.2g} days"
