"""What names of columns, arrays and message fields mean: which quantity, which axis, in which unit, of which of several sensors.

A name counts where it ends in a word for the quantity: ``imu0/gyr_x [deg/s]``, ``angular_velocity.x``, ``acc_mps2``, ``wx``.  ``gyro_bias``
and ``mag_x`` are none.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from session.base.units import parse_unit
from session.replay.clock import CLOCKS, UNITS

#: words of a quantity, the last ones of a name
WORDS = {
    "gyro": ("gyro", "gyr", "gyros", "gyroscope", "omega", "w", "angvel", "angrate"),
    "accel": ("acc", "accel", "accels", "accelerometer", "acceleration", "f", "linacc", "specforce", "a"),
    "temp": ("temp", "temperature"),
    "time": CLOCKS,
}
KIND = {word: kind for kind, words in WORDS.items() for word in words}
#: two words, the last ones of a name; None: another quantity
PAIRS: dict[tuple[str, str], str | None] = {
    **dict.fromkeys([(a, b) for a in ("angular", "ang") for b in ("velocity", "vel", "rate", "rates")], "gyro"),
    **dict.fromkeys([(a, b) for a in ("linear", "lin", "specific", "spec") for b in ("acceleration", "accel", "acc", "force")], "accel"),
    **dict.fromkeys([(a, b) for a in ("angular", "ang") for b in ("acceleration", "accel", "acc")], None),
}
#: words that mean no more than that a column holds readings
FILLERS = (
    "data",
    "xyz",
    "values",
    "meas",
    "measured",
    "measurement",
    "measurements",
    "raw",
    "adc",
    "smooth",
    "readings",
    "samples",
    "signal",
)
AXES = {**{axis: place for place, axis in enumerate("xyz")}, "0": 0, "1": 1, "2": 2}
#: letters that stand for a quantity only with an axis behind them
LETTERS = {"g": "gyro", "w": "gyro", "a": "accel", "f": "accel"}
#: how units end a name, as words that a name is cut into -> the unit; of the quantities
ENDINGS: dict[str, dict[tuple[str, ...], str]] = {
    "gyro": {
        **dict.fromkeys([("rad", "s"), ("rad", "sec"), ("rads",), ("rps",), ("radps",), ("rad", "per", "s"), ("rad",)], "rad/s"),
        **dict.fromkeys([("deg", "s"), ("deg", "sec"), ("dps",), ("degs",), ("degps",), ("deg", "per", "s")], "dps"),
        ("mdps",): "mdps",
        ("rpm",): "rpm",
        **dict.fromkeys([("lsb",), ("counts",)], "lsb"),
    },
    "accel": {
        **dict.fromkeys([("m", "s", "2"), ("mps", "2"), ("ms", "2"), ("m", "s", "s"), ("m", "per", "s", "2")], "m/s2"),
        **dict.fromkeys([("mg",)], "mg"),
        **dict.fromkeys([("g",)], "g"),
        **dict.fromkeys([("lsb",), ("counts",)], "lsb"),
    },
    "temp": {**dict.fromkeys([("c",), ("degc",), ("deg", "c"), ("celsius",)], "degc"), **dict.fromkeys([("lsb",), ("counts",)], "lsb")},
    "time": {(word,): unit for word, unit in UNITS.items()},
}
#: of each quantity the longest first, by which a name is cut
ORDERED = [(kind, ending) for kind, endings in ENDINGS.items() for ending in sorted(endings, key=len, reverse=True)]


@dataclass(frozen=True)
class Meaning:
    """kind: gyro, accel, temp or time; axis: 0, 1, 2, or None of all three; unit: a word of ``units``, or ``""``; of: the rest of the
    name, which separates one sensor from another."""

    kind: str
    axis: int | None
    unit: str
    of: str


def meaning(name: str, unit: str = "") -> Meaning | None:
    """What a name means; unit: what is stated next to it.  None where it means no quantity that is known."""
    bare, _, bracket = name.rstrip("])").rpartition("[") if name.endswith("]") else name.rstrip(")").rpartition("(")
    stated = bracket if bare and not bracket.strip().isdigit() else ""
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]", bare if stated else name)]
    for kind, ending in ORDERED:
        if ending[-1] not in words[-2:]:
            continue
        for axis_last in (False, True):
            rest = words[:-1] if axis_last and words[-1] in AXES else words
            if axis_last == (rest is words) or tuple(rest[-len(ending) :]) != ending:
                continue
            found = _plain(rest[: -len(ending)] + ([words[-1]] if axis_last else []))
            if found is not None and found.kind == kind:
                return Meaning(kind, found.axis, _unit(kind, unit, stated) or ENDINGS[kind][ending], found.of)
    plain = _plain(words)
    return None if plain is None else Meaning(plain.kind, plain.axis, _unit(plain.kind, unit, stated), plain.of)


def _unit(kind: str, *texts: str) -> str:
    """The first of these texts that is a unit of this quantity."""
    return next((text.strip() for text in texts if text.strip() and parse_unit(kind, text) is not None), "")


def _plain(words: list[str]) -> Meaning | None:
    """Of a name without a unit, cut into words."""
    axis = None
    if words and words[-1] in AXES and len(words) > 1:
        *words, last = words
        axis = AXES[last]
    words, number = list(words), []
    if axis is not None and len(words) > 1 and words[-1].isdigit():  # gyro0_x: of the first sensor
        number = [words.pop()]
    while len(words) > 1 and words[-1] in FILLERS:
        words.pop()
    if axis is None and words and len(words[-1]) > 1 and words[-1][-1] in "xyz" and (words[-1][:-1] in KIND or words[-1][:-1] in LETTERS):
        axis, words = AXES[words[-1][-1]], [*words[:-1], words[-1][:-1]]
    if not words:
        return None
    pair = (words[-2], words[-1]) if len(words) > 1 else ("", "")
    if pair in PAIRS:
        kind, rest = PAIRS[pair], words[:-2]
    elif axis is not None and words[-1] in LETTERS:
        kind, rest = LETTERS[words[-1]], words[:-1]
    else:
        kind, rest = KIND.get(words[-1]), words[:-1]
    if kind is None or (kind in ("temp", "time") and axis is not None):
        return None
    return Meaning(kind, axis, "", ".".join([*rest, *number]))


def triads(names: Iterable[str]) -> dict[tuple[str, str], tuple[str, str, str]]:
    """{(gyro or accel, of): names of x, y, z} of single columns; only where all three are there, once each."""
    found: dict[tuple[str, str], dict[int, list[str]]] = {}
    for name in names:
        parsed = meaning(name)
        if parsed is not None and parsed.axis is not None:
            found.setdefault((parsed.kind, parsed.of), {}).setdefault(parsed.axis, []).append(name)
    return {
        key: (axes[0][0], axes[1][0], axes[2][0])
        for key, axes in found.items()
        if sorted(axes) == [0, 1, 2] and all(len(named) == 1 for named in axes.values())
    }
