"""``--columns t_us=NAME,gx_dps=NAME,…``: any table at all, in the words of the headers of docs/formats.md."""

from __future__ import annotations

import csv
import re

from session.base.errors import FormatError
from session.base.units import NUMBER

EXPECTED = (
    "expected t_us=NAME,gx_dps=NAME,…,az_g=NAME,temp_c=NAME; NAME is the header's, or the column's number from 1, with - for a wrong sign; "
    "t may be a sum, t_s=secs+nsecs*1e-9"
)
#: a cell of a row, not of a header
NUMERIC = re.compile(r"[-+]?[\d.,:eE+-]+")
KEY = re.compile(r"(t|g[xyz]|a[xyz]|temp)(?:_(\S+))?")
#: one column of a log: its position, its unit as text, its sign
Column = tuple[int, str, int]
#: None: any run of white space
DELIMITERS = (",", ";", "\t", None)
#: of which a file holds one or both
TRIADS = {letter: tuple(f"{letter}{axis}" for axis in "xyz") for letter in "ga"}
#: further terms of the time, ``secs + nsecs * 1e-9``
MOST_TERMS = 4
TERM = re.compile(rf"(.*\S)\s*+\*\s*+({NUMBER}(?:[eE][-+]?[0-9]++)?)")


def from_columns(text: str, lines: list[str], name: str) -> tuple[str | None, int, tuple[str, ...], dict[str, Column]]:
    """``(delimiter, lines before the rows, names, {t, gx, …: (column, unit, sign)})``."""
    wanted = parse_columns(text)
    headless = all(what.isdigit() for what, _, _ in wanted.values())
    for keys in TRIADS.values():
        if 0 < len(missing := [key for key in keys if key not in wanted]) < 3:
            raise FormatError(f"--columns: {', '.join(missing)} missing; {EXPECTED}")
    if not any(keys[0] in wanted for keys in TRIADS.values()):
        raise FormatError(f"--columns: {', '.join(key for keys in TRIADS.values() for key in keys)} missing; {EXPECTED}")
    for number, line in enumerate(lines):
        for delimiter in DELIMITERS:
            names = split(line, delimiter)
            looked_up = {key: _place(what, names, headless) for key, (what, _, _) in wanted.items()}
            places = {key: place for key, place in looked_up.items() if place is not None}
            if len(places) < len(wanted) or (headless and not all(NUMERIC.fullmatch(names[place]) for place in places.values())):
                continue
            if twice := [what for what, _, _ in wanted.values() if not what.isdigit() and names.count(what) > 1]:
                raise FormatError(
                    f"{name}: {twice[0]!r} stands {names.count(twice[0])} times in the header; give --columns its number, from 1"
                )
            if len(set(places.values())) < len(places):
                doubled = [wanted[key][0] for key, place in places.items() if list(places.values()).count(place) > 1]
                raise FormatError(f"{name}: --columns takes the column {doubled[0]} for two things; each is one axis of one sensor")
            columns = {key: (places[key], unit, sign) for key, (_, unit, sign) in wanted.items()}
            if headless:
                return delimiter, number, tuple(f"column {place + 1}" for place in range(len(names))), columns
            return delimiter, number + 1, names, columns
    missing = [what for what, _, _ in wanted.values() if not any(what in line for line in lines) and not what.isdigit()]
    problem = f"no column {missing[0]!r}" if missing else "no line with all of these columns"
    first = next((line.strip()[:60] for line in lines if line.strip()), "")
    raise FormatError(f"{name}: {problem} (--columns); it begins {first!r}")


def split(line: str, delimiter: str | None) -> tuple[str, ...]:
    """A header's names, whatever stands around them."""
    line = line.strip().lstrip("\ufeff#").strip()
    if delimiter is None:
        line = re.sub(r"(?<!\s)\s++(?=[\[(])", "", line)
    # A name in quotation marks may have the delimiter in it.
    parts = line.split(delimiter)
    if delimiter is not None and '"' in line:
        parts = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    return tuple(part.strip().strip('"').strip() for part in parts)


def parse_columns(text: str, pattern: re.Pattern[str] = KEY, expected: str = EXPECTED) -> dict[str, tuple[str, str, int]]:
    """{gx: (name or number, unit, sign)} of the text of ``--columns``; further terms of the time are t2, t3 and so on.

    pattern: of its keys, with the quantity and the unit as groups.  FormatError, which states what is expected, for another key and for one
    that is given twice.
    """
    wanted: dict[str, tuple[str, str, int]] = {}
    for entry in text.split(","):
        key, equals, what = entry.strip().partition("=")
        match = pattern.fullmatch(key.strip())
        if not match or not equals or not what.strip().lstrip("-"):
            raise FormatError(f"--columns: {entry.strip()!r} is no column; {expected}")
        kind, unit = match[1], match[2] or ""
        if kind in wanted:
            raise FormatError(f"--columns: {kind} is given twice; {expected}")
        what, sign = what.strip(), 1
        if what.startswith("-"):
            what, sign = what[1:].strip(), -1
        if not unit and kind[0] in "ga":
            unit = "lsb"
        wanted[kind] = what, unit or ("lsb" if kind == "temp" else ""), sign
        if kind == "t" and ("+" in what or "*" in what):
            wanted |= _sum(what, unit)
    return wanted


def _sum(text: str, unit: str) -> dict[str, tuple[str, str, int]]:
    """``secs+nsecs*1e-9`` in s: {t: (secs, s, 1), t2: (nsecs, 1e-9s, 1)}."""
    terms = [term.strip() for term in text.split("+")]
    if not all(terms) or len(terms) > MOST_TERMS or not unit:
        raise FormatError(f"--columns: {text!r} is no sum of columns in a unit, such as t_s=secs+nsecs*1e-9")
    parsed = [(match[1].strip(), match[2]) if (match := TERM.fullmatch(term)) else (term, "") for term in terms]
    return {f"t{place + 1}" if place else "t": (name, f"{factor}{unit}", 1) for place, (name, factor) in enumerate(parsed)}


def _place(what: str, names: tuple[str, ...], headless: bool) -> int | None:
    """The column of a name, or of a number from 1; headless: they are all numbers, and the names are a row's cells."""
    if what in names and not headless:
        return names.index(what)
    if what.isdigit() and 1 <= int(what) <= len(names):
        return int(what) - 1
    lower = [name.lower() for name in names]
    return lower.index(what.lower()) if what.lower() in lower else None
