"""The header line of a standard log (docs/formats.md): raw registers, or units in the names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from typing import TypeVar

from session.base.errors import FormatError
from session.base.units import STAMP_NS, endings
from session.log.layout import Layout, Triad, three
from session.log.thermometer import degrees_by

Kind = TypeVar("Kind", bound=Layout)
TEMPERATURES = {f"temp{ending}": unit for ending, unit in endings("temp").items()}
#: a temperature stated to be in another unit
OTHER_TEMPERATURES = ("temp_f", "temp_k", "temp_degf", "temp_fahrenheit", "temp_kelvin", "temperature_f", "temperature_k")
KNOWN = {
    "time": tuple(STAMP_NS),
    "gyroscope": tuple(f"g{axis}{ending}" for ending in endings("gyro") for axis in "xyz"),
    "accelerometer": tuple(f"a{axis}{ending}" for ending in endings("accel") for axis in "xyz"),
}
#: columns that are looked at for a name that was meant
MOST_NAMES = 200
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}


def standard_layout(lines: list[str], name: str, gyro_alone: bool, instead: str) -> Layout:
    """The layout of a file whose first line that is neither blank nor a comment is a standard header.  FormatError where it is not.

    gyro_alone: whether it may lack an accelerometer; instead: what reads other logs.
    """
    number, line = next(((n, line) for n, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), (0, ""))
    return with_degrees(parse_header(line, f"{name} line {number + 1}", number + 1, gyro_alone, instead), lines)


def with_degrees(layout: Kind, lines: list[str]) -> Kind:
    """The layout, with degC for a ``temp`` that holds whole degrees, as its first lines show, where all other columns state their units."""
    triads = [triad.unit for triad in (layout.gyro, layout.accel) if triad is not None]
    if layout.temp is None or layout.temp_unit is None or layout.temp_unit.si is not None or any(unit.si is None for unit in triads):
        return layout
    rows = (line.split("#")[0].split(layout.delimiter) for line in lines[layout.first :])
    if (unit := degrees_by([row[layout.temp] for row in rows if layout.temp < len(row)])) is None:
        return layout
    remark = f"{layout.name(layout.temp)} states no unit, where all other columns do: whole degrees, taken as °C"
    return replace(layout, temp_unit=unit, remark="; ".join(filter(None, (layout.remark, remark))))


#: columns that state of all rows what a comment may: {name: (key, what it adds)}; each row holds 1, so that other programs read
#: nothing but numbers
FLAGS = {"gyro_calibrated": ("calibrated", "gyro"), "accel_calibrated": ("calibrated", "accel"), "stamps_counted": ("stamps", "counted")}


def flagged(names: Iterable[str]) -> dict[str, str]:
    """What the flag columns among these names state, as comments have it: ``{"calibrated": "gyro,accel"}``."""
    stated: dict[str, list[str]] = {}
    for name in names:
        if name in FLAGS:
            stated.setdefault(FLAGS[name][0], []).append(FLAGS[name][1])
    return {key: ",".join(dict.fromkeys(values)) for key, values in stated.items()}


def flags_of(stated: Mapping[str, str]) -> list[str]:
    """The flag columns that state what these comments do."""
    return [name for name, (key, word) in FLAGS.items() if word in stated.get(key, "").split(",")]


def parse_header(line: str, where: str, first: int = 1, gyro_alone: bool = False, instead: str = "") -> Layout:
    """Read the header line, behind which the rows begin as line ``first`` from 0; gyro_alone: it may lack an accelerometer; instead: what
    reads other logs.

    FormatError (with ``where``) names the column that is missing, doubled or in an unknown unit.
    """
    names = tuple(name.strip() for name in line.rstrip(",\r\n").split(","))
    expected = "expected t_us,gx,gy,gz,ax,ay,az,temp or units in the names (t_s, gx_dps, gx_rps, ax_g, ax_mps2, temp_c)"
    expected += f"; {instead}" if instead else ""
    fewest = 4 if gyro_alone else 7
    for separator, called in SEPARATORS.items():
        if len(names) < fewest and line.count(separator) >= fewest - 1:
            raise FormatError(f"{where}: separated by {called}; expected commas")
    if len(names) < fewest or all(re.fullmatch(r"[-+.\deE]*", name) for name in names):
        raise FormatError(f"{where}: no header line but {line.strip()[:60]!r}; {expected}")
    # Refuse two columns of one name; columns that are not read may repeat.
    read = {*TEMPERATURES, *(name for known in KNOWN.values() for name in known)}
    if twice := [name for name in dict.fromkeys(names) if name in read and names.count(name) > 1]:
        raise FormatError(f"{where}: the column {twice[0]} stands {names.count(twice[0])} times; keep one, or rename the other")
    times = [name for name in names if name in STAMP_NS]
    if len(times) != 1:
        raise FormatError(f"{where}: {_problem('time', names, times)}; {expected}")
    gyro = _named_triad(names, "gyro", where, expected)
    accel = None if gyro_alone and not set(KNOWN["accelerometer"]) & set(names) else _named_triad(names, "accel", where, expected)
    temps = [name for name in names if name in TEMPERATURES]
    if not temps and (other := next((name for name in names if name.lower() in OTHER_TEMPERATURES), None)) is not None:
        raise FormatError(
            f"{where}: {other!r}: a temperature is in degC; convert it and call it temp_c, or call it otherwise to leave it out"
        )
    if len(temps) > 1:
        raise FormatError(f"{where}: two temperature columns ({', '.join(temps)[:80]}); keep one")
    return Layout(
        first=first,
        time=names.index(times[0]),
        time_ns=STAMP_NS[times[0]],
        gyro=gyro,
        accel=accel,
        temp=names.index(temps[0]) if temps else None,
        temp_unit=TEMPERATURES[temps[0]] if temps else None,
        names=names,
        header_line=line.strip(),
    )


def _named_triad(names: tuple[str, ...], kind: str, where: str, expected: str) -> Triad:
    """The three columns of one sensor, all in one unit; kind: gyro or accel."""
    letter, units = kind[0], endings(kind)
    found = {ending: [names.index(f"{letter}{axis}{ending}") for axis in "xyz" if f"{letter}{axis}{ending}" in names] for ending in units}
    whole = [ending for ending, columns in found.items() if len(columns) == 3]
    if len(whole) == 1 and sum(map(len, found.values())) == 3:
        return Triad(three(found[whole[0]]), (1, 1, 1), units[whole[0]])
    sensor = {"g": "gyroscope", "a": "accelerometer"}[letter]
    strangers = [name for name in names if re.fullmatch(rf"{letter}[xyz]_\w+", name) and name[2:] not in units]
    if strangers:
        known = ", ".join(f"{letter}x{ending}" for ending in units)
        raise FormatError(f"{where}: unknown unit in {strangers[0]!r}; known are {known}")
    raise FormatError(f"{where}: {_problem(sensor, names, [names[i] for columns in found.values() for i in columns])}; {expected}")


def _problem(what: str, names: tuple[str, ...], found: list[str]) -> str:
    near = "" if len(found) > 1 and what == "time" else _near(what, names, found)
    if not found:
        return f"no {what} column among {', '.join(names)[:80]}{near}"
    return f"the {what} columns are {', '.join(found)[:80]}{near}"


def _near(what: str, names: tuple[str, ...], found: list[str]) -> str:
    """The first name that is a known one in other letters, or nearly one: `` (is 'GX' meant as 'gx'?)``."""
    taken = {*found, *TEMPERATURES, *(name for known in KNOWN.values() for name in known)}
    for name in names[:MOST_NAMES]:
        close = [] if name in taken else get_close_matches(name.lower(), KNOWN[what], n=1, cutoff=0.75)
        if close:
            return f" (is {name[:40]!r} meant as {close[0]!r}?)"
    return ""
