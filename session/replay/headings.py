"""Headings that state by themselves what their columns are: by quantities' names in several languages, or by the units that they state.

People print ``accX``, ``gyro_y``, ``wz``, ``imu.rate.x``; programs export ``Drehrate X [°/s]`` and ``X (rad/s)``.  A new word is one entry.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import product

from session.base.errors import FormatError
from session.base.units import COUNTS, parse_unit
from session.replay.columns import Column
from session.replay.named import ENDINGS

#: what stands before or behind an axis, of a name in small letters without accents and without what is no letter
USUAL = {
    "g": (
        *("g", "gy", "gyr", "gyro", "gyros", "giro", "gyrorate", "gyroscope", "gyroraw", "rawgyro", "w", "omega", "rate", "rot", "angular"),
        *("angularvelocity", "angvel", "angularrate", "rotationrate", "rotation", "rotations"),
        *("drehrate", "winkelgeschwindigkeit", "gyroskop", "vitesseangulaire", "velocidadangular", "velocidadeangular"),
        *("velocitaangolare", "giroscopio", "hoeksnelheid", "角速度", "陀螺仪"),
    ),
    "a": (
        *(
            "a",
            "ac",
            "acc",
            "acce",
            "accl",
            "accelero",
            "accel",
            "accels",
            "accelerometer",
            "accelraw",
            "rawaccel",
            "f",
            "force",
            "specificforce",
            "gforce",
        ),
        *("acceleration", "accelerations", "linearacceleration"),
        *("beschl", "beschleunigung", "beschleunigungssensor", "accelerometre", "accelerometro", "acelerometro"),
        *("aceleracion", "aceleracao", "accelerazione", "versnelling", "加速度", "加速度计"),
    ),
}
USUAL_TEMPERATURES = ("temp", "temperature", "tempc", "tmp")
#: words of a unit behind a name, as ``gyro_x_dps`` or ``accXmss``; rad alone is an angle's
UNIT_ENDINGS = {
    kind[0]: {"".join(words): unit for words, unit in ENDINGS[kind].items() if unit not in COUNTS and words != ("rad",)}
    for kind in ("gyro", "accel")
}
#: what an axis is called, and where it stands in the triad
AXES = {"x": 0, "y": 1, "z": 2, "roll": 0, "pitch": 1, "yaw": 2, "wank": 0, "nick": 1, "gier": 2}
#: of a name whose unit is an accelerometer's: another quantity, where one is there that is not called so
OTHERS = ("mag", "lin", "user", "grav")
#: ends the word of axes that are numbers: ``Force1`` alone is no axis
NUMBERED = "#"
#: quantities that a unit shows
BY_UNIT = {"g": "gyro", "a": "accel"}
#: how names of angles of each sample begin
ANGLES = ("dtheta", "dθ", "deltatheta", "dang", "deltaang", "delang", "angleincrement", "angularincrement", "winkelinkrement")


def name_and_unit(text: str) -> tuple[str, str]:
    """``Gyro X (deg/s)``: the name, and what its last brackets hold if there is a letter in it; also ``a / (m/s²)`` and ``a in m/s²``.  By
    hand: a pattern would look at a long cell from each of its brackets."""
    if text.endswith(("]", ")")):
        begin = max(text.rfind(shut, 0, -1) for shut in "])") + 1
        opens = [place for place in (text.find(bracket, begin) for bracket in "[(") if place >= 0]
        unit = text[min(opens) + 1 : -1] if opens else ""
        if any(letter.isalnum() and not letter.isdecimal() for letter in unit):
            return text[: min(opens)].rstrip(" /").strip().lower(), unit
    for between in (" in ", " / ", ", "):
        name, found, unit = text.partition(between)
        if found and any(parse_unit(kind, unit) for kind in ("time", "gyro", "accel", "temp")):
            return name.strip().lower(), unit.strip()
    return text.strip().lower(), ""


def plain(name: str) -> str:
    """A name's letters and digits, without accents."""
    return "".join(each for each in unicodedata.normalize("NFKD", name.lower()) if each.isalnum())


#: ``Gyroscope (z,x,y) [rad/s]``: one name for three columns
ONE_NAME = re.compile(r"([^(\[]{1,60})(?:\((-?[xyz]), ?(-?[xyz]), ?(-?[xyz])\))?\s*([\[(][^\])]{1,20}[\])])?", re.IGNORECASE)


def spread(names: Sequence[str]) -> tuple[str, ...]:
    """Names in which one that stands for three columns, the next two of which are called 1 and 2, is a name for each."""
    whole = list(names)
    for place in range(len(names) - 2):
        found = ONE_NAME.fullmatch(names[place]) if tuple(names[place + 1 : place + 3]) == ("1", "2") else None
        if found is not None:
            axes = found.group(2, 3, 4) if found[2] else ("x", "y", "z")
            whole[place : place + 3] = [f"{found[1].strip()} {axis} {found[5] or ''}".strip() for axis in axes]
    return tuple(whole)


def usual_columns(names: Sequence[str], file: str) -> dict[str, Column]:
    """{gx: column, …, temp: …} of the headings that state it; only a whole triad, and only where one column alone states it.

    file: whose name states which sensor it is of where its columns are called x, y, z.
    """
    columns: dict[str, Column] = {}
    # of each sensor, by the word that names it, or by the unit and the rest of the name: axis, column
    stated: dict[str, dict[str, dict[int, Column]]] = {letter: {} for letter in USUAL}
    by_unit: dict[str, dict[str, dict[int, Column]]] = {letter: {} for letter in USUAL}
    of_file = _of_file(file)
    for column, text in enumerate(names):
        name, unit = name_and_unit(text)
        if name in ("x", "y", "z") and not unit and of_file:
            found: tuple[str, str, int, str] | None = of_file, "", "xyz".index(name), ""
        else:
            found = _written().get(BEFORE.sub("", plain(name)))
        if found is not None:
            letter, word, place, own = found
            if letter not in USUAL:
                columns.setdefault(letter, (column, unit or own, 1))
            elif place in stated[letter].setdefault(word, {}):  # two sensors: a person states which
                return {}
            else:
                stated[letter][word][place] = column, unit or own, 1
            continue
        for letter, kind in BY_UNIT.items():
            if unit and unit.lower() not in COUNTS and parse_unit(kind, unit) is not None:
                rest, axis = _axis(plain(name))
                by_unit[letter].setdefault(rest, {}).setdefault(-1 if axis is None else axis, (column, unit, 1))
    triads = 0
    for letter in USUAL:
        named = {word: axes for word, axes in stated[letter].items() if len(axes) == 3 or not word.endswith(NUMBERED)}
        by_word = named or by_unit[letter]
        whole = [word for word, axes in by_word.items() if {0, 1, 2} <= set(axes)]
        mine = [word for word in whole if not any(other in word for other in OTHERS)] or whole
        if len(mine) == 1 and len(whole) >= len(named):
            triads += 1
            columns |= {f"{letter}{axis}": by_word[mine[0]][place] for place, axis in enumerate("xyz")}
        elif named:
            return {}
    return columns if triads else {}


def _of_file(file: str) -> str:
    """Which sensor the name of a file states: ``Gyroscope.csv``, ``imu_acc_2.json``; not ``rotation_vector.csv``."""
    words = re.findall(r"[^\W\d_]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", file.split(".")[0]).lower())
    called = {plain(word) for word in (*words, "".join(words)) if len(word) > 2}
    letters = [letter for letter, known in USUAL.items() if called & set(known)]
    return letters[0] if len(letters) == 1 and not any(word.startswith(("vector", *OTHERS)) for word in words) else ""


def _axis(name: str) -> tuple[str, int | None]:
    """The rest of a plain name, and its axis."""
    for word, axis in AXES.items():
        if name.endswith(word):
            return name.removesuffix(word), axis
        if name.startswith(word):
            return name.removeprefix(word), axis
    return name, None


@cache
def _written() -> dict[str, tuple[str, str, int, str]]:
    """Every plain name that means an axis of a sensor, and perhaps its unit: {gyroxdps: (g, gyro, 0, dps)}."""
    found: dict[str, tuple[str, str, int, str]] = {word: ("temp", word, 0, "degc") for word in USUAL_TEMPERATURES}
    for letter, words in USUAL.items():
        endings = {"": "", **UNIT_ENDINGS[letter]}
        for word, place in product(words, range(3)):
            axis, bare = "xyz"[place], "g" if word == "gforce" else ""
            for ending, unit in endings.items():
                for name in (f"{word}{axis}{ending}", f"{axis}{word}{ending}", f"{word}{axis}axis{ending}", f"{word}{ending}{axis}"):
                    found.setdefault(name, (letter, word, place, unit or bare))
                for name in (f"{word}{place}{ending}", f"{word}{ending}{place}"):
                    found.setdefault(name, (letter, word + NUMBERED, place, unit or bare))
    return found


#: what means no more than that a column is of a sensor
BEFORE = re.compile(r"^(?:imu|raw|data|scaled|sensor|msg|field)+")


def refuse_angles(headers: Iterator[Sequence[str]], file: str) -> None:
    """FormatError where a header has the angle of each sample in the place of the rate."""
    for names in headers:
        if (angle := next((name for name in names if plain(name_and_unit(name)[0]).startswith(ANGLES)), None)) is not None:
            what = f"{angle!r} is the angle of each sample, not a rate"
            raise FormatError(f"{file}: {what}; divide it by the time since the sample before, or log the rates")
