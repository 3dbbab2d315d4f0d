"""Units: conversion factors, the units that people write in headers and options, and what no sensor measures."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

# The only conversion factors in the project.

STANDARD_GRAVITY_MPS2 = 9.80665  #: one g of an accelerometer's datasheet
EARTH_RATE_RPS = 7.292115e-5  #: WGS 84

DEG = pi / 180  #: rad per degree; also rad/s per dps
MDPS = 1e-3 * DEG  #: rad/s per mdps
G = STANDARD_GRAVITY_MPS2  #: m/s^2 per g
MG = 1e-3 * G  #: m/s^2 per mg
PPM = 1e-6  #: per part in a million
DEG_PER_SQRT_HOUR = DEG / 60  #: rad/sqrt(s) per deg/sqrt(h), the unit of angle random walk
DEG_PER_HOUR = DEG / 3600  #: rad/s per deg/h, the unit of bias instability
NS = 1e-9  #: s per nanosecond
NS_PER_S = 10**9  #: exact, unlike 1 / NS


# Limits that no sensor exceeds: a value beyond is a fault of the file, or is in another unit.

#: the fastest gyroscopes end at some 5 000 dps, shock sensors at some thousand g; generous, in SI
BEYOND = {"gyro": 1e5 * DEG, "accel": 1e4 * G, "temp": 1e4}
#: units of the same in memory
SI = {"gyro": "rad/s", "accel": "m/s^2", "temp": "degC"}
LIMITS = {"gyro": "100000 dps", "accel": "10000 g", "temp": "10000 degC"}


def beyond_any_sensor(values: np.ndarray, si: float, kind: str) -> np.ndarray:
    """Which of values (…), finite and in units of si, no sensor can have measured; kind: gyro, accel or temp."""
    return abs(values) > BEYOND[kind] / si


def complaint(name: str, value: float, kind: str) -> str:
    """The complaint about such a value in a column."""
    return f"{name} is {value:g}, beyond any sensor ({LIMITS[kind]}); is its unit right? correct or remove that line"


#: of its full scale, what no gyroscope reads: beyond it the unit is another, most often degrees; and the largest usual full scale, dps
BEYOND_FULL_SCALE, LARGEST_DPS = 1.2, 4000.0


# The one table of units: as people write them in headers and options, and what they are in SI.

#: words of each kind of quantity -> SI per unit (time: nanoseconds, exact)
TIME = {"ns": 1, "us": 1_000, "µs": 1_000, "μs": 1_000, "ms": 1_000_000, "s": 1_000_000_000, "sec": 1_000_000_000}
GYRO = {"mdps": MDPS, "dps": DEG, "deg/s": DEG, "°/s": DEG, "deg s^-1": DEG, "rps": 1.0, "rad/s": 1.0, "rad s^-1": 1.0}
GYRO |= dict.fromkeys(("rpm", "r/min", "rev/min", "u/min"), 6 * DEG)
_ANGLES = {**dict.fromkeys(("deg", "degree", "degrees", "grad", "grados", "gradi", "graus", "degrés"), DEG)}
_ANGLES |= dict.fromkeys(("rad", "radian", "radians"), 1.0)
GYRO |= {f"{angle}/{time}": si for time in ("s", "sec", "second", "sek", "seg") for angle, si in _ANGLES.items()}
ACCEL = {"mg": MG, "g": G, "mps2": 1.0, "m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "m/s/s": 1.0, "m s^-2": 1.0, "m/sec^2": 1.0}
TEMPERATURE = {"c": 1.0, "degc": 1.0, "°c": 1.0, "℃": 1.0}
#: how signs of a unit are written otherwise: powers, products, a degree's sign by another letter or from a code of DOS
SPELLINGS = (("**", ""), ("^", ""), ("²", "2"), ("ý", "2"), ("⁻", "-"), ("¹", "1"), ("℃", "degc"), *((sign, "deg") for sign in "°º˚ø¡"))
SPELLINGS += tuple((sign, " ") for sign in "·⋅*")
WORDS: Mapping[str, Mapping[str, float]] = {"time": TIME, "gyro": GYRO, "accel": ACCEL, "temp": TEMPERATURE}
#: what registers are called
COUNTS = ("lsb", "raw", "counts")
#: the words that a standard log's names end in (``t_us``, ``gx_dps``); no ending: registers
ENDINGS = {"time": ("ns", "us", "s"), "gyro": ("dps", "rps"), "accel": ("g", "mps2"), "temp": ("c",)}
#: a standard log's or truth file's time column -> nanoseconds per unit
STAMP_NS = {f"t_{word}": TIME[word] for word in ENDINGS["time"]}


@dataclass(frozen=True)
class Unit:
    """si per unit, or None for registers whose sensitivity the full scale decides; word as it was written."""

    si: float | int | None
    word: str


REGISTER = Unit(None, "lsb")
#: of time stamps: a year, beyond which no unit is one
LONGEST_NS = 365 * 86_400 * NS_PER_S
#: characters of a unit: ``degrees per second`` has 18
LONGEST = 100
#: a factor before or under one, and behind ``--columns``' asterisk
NUMBER = r"(?:[0-9]++(?:\.[0-9]++)?|\.[0-9]++)"


def endings(kind: str) -> dict[str, Unit]:
    """What stands behind a gyroscope's or accelerometer's axis, or ``temp``, in a standard log's names: ``""``, ``"_dps"``."""
    return {"": REGISTER} | {f"_{word}": Unit(WORDS[kind][word], word) for word in ENDINGS[kind]}


def parse_unit(kind: str, text: str) -> Unit | None:
    """``dps``, ``[mg]``'s inside, ``lsb``, or a number before or under a unit: ``25us``, ``0.061dps``, ``g/2048``; None if it is none.

    kind: time, gyro, accel or temp.
    """
    if len(text) > LONGEST:
        return None
    word = re.sub(r"\s+", " ", text.strip().lower())
    if word in COUNTS and kind != "time":
        return Unit(None, word)
    if (si := SPELT[kind].get(_spelt(word))) is not None:
        return Unit(si, word)
    if match := re.fullmatch(rf"({NUMBER}(?:e[-+]?[0-9]++)?) ?(\D.*)", word):
        return _scaled(kind, float(match[1]), match[2], word)
    if match := re.fullmatch(rf"(.*\D) ?/ ?({NUMBER})", word):
        return _scaled(kind, 1 / float(match[2]) if float(match[2]) else 0.0, match[1], word)
    return None


def _spelt(word: str) -> str:
    for sign, plain in SPELLINGS:
        word = word.replace(sign, plain)
    return " ".join(word.split())


SPELT = {kind: {_spelt(word): si for word, si in words.items()} for kind, words in WORDS.items()}


def _scaled(kind: str, factor: float, unit: str, word: str) -> Unit | None:
    if (one := SPELT[kind].get(_spelt(unit))) is None or not factor > 0:
        return None
    si = factor * one
    if kind == "time":
        return Unit(round(si) if abs(si - round(si)) < 1e-6 else si, word) if 1e-3 <= si < LONGEST_NS else None
    return Unit(si, word) if math.isfinite(si) else None


def known(kind: str) -> str:
    """The words of a kind, for a complaint."""
    return ", ".join([*(word for word in WORDS[kind] if word.isascii()), *(["lsb"] if kind != "time" else [])])
