"""Recognise a log: from a file's first lines to its columns and units, or one line that names the option that is missing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches

from session.io.clock import find_clock
from session.io.dialects import DELIMITERS, DIALECTS, Answers, Column, Dialect, Layout, Triad, from_columns, split, three
from session.io.errors import FormatError
from session.io.rows import FORMAT_WORD, Form, Rows, Wanted, Watch, refuse_kinds
from session.io.units import STAMP_NS, Unit, endings, known, parse_unit

# The header line of a standard log (FORMATS): raw registers, or units in the names.

OWN = "TinyGC"
TEMPERATURES = {f"temp{ending}": unit for ending, unit in endings("temp").items()}
#: a temperature that says it is in another unit
OTHER_TEMPERATURES = ("temp_f", "temp_k", "temp_degf", "temp_fahrenheit", "temp_kelvin", "temperature_f", "temperature_k")
KNOWN = {
    "time": tuple(STAMP_NS),
    "gyroscope": tuple(f"g{axis}{ending}" for ending in endings("gyro") for axis in "xyz"),
    "accelerometer": tuple(f"a{axis}{ending}" for ending in endings("accel") for axis in "xyz"),
}
#: columns that are looked at for a name that was meant
MOST_NAMES = 200
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}


def standard_layout(lines: list[str], name: str, gyro_alone: bool = False) -> Layout:
    """The layout of a file whose first line that is neither blank nor a comment is a standard header.  FormatError where it is not.

    gyro_alone: whether it may lack an accelerometer.
    """
    number, line = next(
        ((number, line) for number, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), (0, "")
    )
    return parse_header(line, f"{name} line {number + 1}", number + 1, gyro_alone)


#: columns that say of all rows what a comment may say as well: {name: (key, what it adds)}; each row holds 1, so that other programs read
#: nothing but numbers
FLAGS = {"gyro_calibrated": ("calibrated", "gyro"), "accel_calibrated": ("calibrated", "accel"), "stamps_counted": ("stamps", "counted")}


def flagged(names: Iterable[str]) -> dict[str, str]:
    """What the flag columns among these names say, as comments say it: ``{"calibrated": "gyro,accel"}``."""
    said: dict[str, list[str]] = {}
    for name in names:
        if name in FLAGS:
            said.setdefault(FLAGS[name][0], []).append(FLAGS[name][1])
    return {key: ",".join(dict.fromkeys(values)) for key, values in said.items()}


def flags_of(said: Mapping[str, str]) -> list[str]:
    """The flag columns that say what these comments say."""
    return [name for name, (key, word) in FLAGS.items() if word in said.get(key, "").split(",")]


def parse_header(line: str, where: str, first: int = 1, gyro_alone: bool = False) -> Layout:
    """Read the header line, behind which the rows begin as line ``first`` from 0; gyro_alone: it may lack an accelerometer.

    FormatError (with ``where``) says which column is missing, doubled or in an unknown unit.
    """
    names = tuple(name.strip() for name in line.rstrip(",\r\n").split(","))
    expected = "expected t_us,gx,gy,gz,ax,ay,az,temp or units in the names (t_s, gx_dps, gx_rps, ax_g, ax_mps2, temp_c)"
    fewest = 4 if gyro_alone else 7
    for separator, called in SEPARATORS.items():
        if len(names) < fewest and line.count(separator) >= fewest - 1:
            raise FormatError(f"{where}: separated by {called}; expected commas")
    if len(names) < fewest or all(re.fullmatch(r"[-+.\deE]*", name) for name in names):
        raise FormatError(f"{where}: no header line but {line.strip()[:60]!r}; {expected}")
    _refuse_doubled_names(names, where)
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
        dialect=OWN,
        delimiter=",",
        first=first,
        time=names.index(times[0]),
        time_ns=STAMP_NS[times[0]],
        clock=False,
        gyro=gyro,
        accel=accel,
        temp=names.index(temps[0]) if temps else None,
        temp_unit=TEMPERATURES[temps[0]] if temps else None,
        names=names,
        header_line=line.strip(),
        standard=True,
    )


def _refuse_doubled_names(names: tuple[str, ...], where: str) -> None:
    """Refuse two columns of one name; columns that are not read may repeat."""
    read = {*TEMPERATURES, *(name for known in KNOWN.values() for name in known)}
    if twice := [name for name in dict.fromkeys(names) if name in read and names.count(name) > 1]:
        raise FormatError(f"{where}: the column {twice[0]} stands {names.count(twice[0])} times; keep one, or rename the other")


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


# From a file's first lines to a layout: which column is what, in which unit; or one line that names the missing option.

NUMBER = r"[-+]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?"
#: stands where one of our own headers lacks the time
NO_STAMPS = "t_us"
#: how well a header fits (the more the better), its line, delimiter, dialect or None for our own, {what: column}, names
Match = tuple[tuple[int, int], int, str | None, Dialect | None, dict[str, Column], tuple[str, ...]]


def recognise(lines: list[str], name: str, answers: Answers) -> Layout:
    """The layout of a file that begins with these lines.  Raises FormatError, which names the option to give."""
    if answers.rows is None:
        refuse_kinds([line for line in lines if line.strip()], Form(name, None, (), (), header_line="not known yet"))
    if answers.columns is not None:
        delimiter, first, names, wanted = from_columns(answers.columns, lines, name)
        return _layout(name, "other", delimiter, first, names, wanted, answers, "", lines)
    found = max(_matches(lines), key=lambda match: match[0], default=None)
    if found is None:
        own = _own_header(lines)
        if own is not None:
            number, names = own
            parse_header(",".join(names), f"{name} line {number + 1}")  # says what is wrong with it
        _refuse_headless(lines, name)
        known_ones = ", ".join(dialect.name for dialect in DIALECTS)
        raise FormatError(
            f"{name}: no header of a log that is known ({known_ones}); it begins {_first(lines)!r}: "
            "name its columns, --columns t_us=NAME,gx_dps=NAME,…,az_g=NAME"
        )
    _, number, delimiter, dialect, columns, names = found
    if dialect is not None:
        _refuse_doubled(names, columns, f"{name} line {number + 1}")
    else:
        columns = _own_columns(names, f"{name} line {number + 1}")
    return _layout(
        name, dialect.name if dialect else OWN, delimiter, number + 1, names, columns, answers, dialect.frame if dialect else "", lines
    )


def _refuse_headless(lines: list[str], name: str) -> None:
    """FormatError for rows of numbers without a header, in the words of the option that names them."""
    row = next((line.strip().rstrip(",;") for line in lines if line.strip() and not line.lstrip().startswith("#")), "")
    for delimiter in DELIMITERS:
        cells = [cell.strip() for cell in row.split(delimiter)]
        if len(cells) >= 6 and all(re.fullmatch(NUMBER, cell) for cell in cells):
            option = "--columns t_us=1,gx_dps=2,…,az_g=7 (in its own order and units), or without stamps gx_dps=1,…,az_g=6 and --odr HZ"
            raise FormatError(f"{name}: no header, {len(cells)} columns of numbers; name them by number, {option}")


def _first(lines: list[str]) -> str:
    return next((line.strip()[:60] for line in lines if line.strip()), "")


def _matches(lines: list[str]) -> Iterator[Match]:
    """Every header that fits, with every delimiter and dialect that it fits with."""
    for number, line in enumerate(lines):
        if not re.search(r"[A-Za-z]", line):
            continue
        for delimiter in DELIMITERS:
            names = split(line, delimiter)
            if len(names) < 2 or names[0] == FORMAT_WORD:
                continue
            if not line.lstrip().startswith("#") and _is_own(names):
                yield (9, -number), number, delimiter, None, {}, names
            cells = [_name_and_unit(text) for text in names]
            for dialect in DIALECTS:
                columns = _columns_of(dialect, cells)
                if columns:
                    yield (len(columns), -number), number, delimiter, dialect, columns, names


def _name_and_unit(text: str) -> tuple[str, str]:
    """``Gyro X (deg/s)``: the name, and what its last brackets hold if there is a letter in it.  By hand: a pattern would look at a long
    cell from each of its brackets."""
    if text.endswith(("]", ")")):
        begin = max(text.rfind(shut, 0, -1) for shut in "])") + 1
        opens = [place for place in (text.find(bracket, begin) for bracket in "[(") if place >= 0]
        unit = text[min(opens) + 1 : -1] if opens else ""
        if any(letter.isalnum() and not letter.isdecimal() for letter in unit):
            return text[: min(opens)].strip().lower(), unit
    return text.strip().lower(), ""


def _columns_of(dialect: Dialect, names: list[tuple[str, str]]) -> dict[str, Column]:
    """{t: column, gx: …, temp: …} where the header is of this dialect; empty where it is not."""
    at: dict[str, tuple[int, str]] = {}
    for column, (name, unit) in enumerate(names):
        at.setdefault(name, (column, unit))
    time = next((at[name] for name in dialect.time if name in at), None)
    if time is None or not all(name in at for name in dialect.signature):
        return {}
    found: dict[str, Column] = {}
    for letter, pattern, unit in (("g", dialect.gyro, dialect.gyro_unit), ("a", dialect.accel, dialect.accel_unit)):
        triad = [pattern.format(axis) for axis in dialect.axes]
        if all(name in at for name in triad):
            found |= {f"{letter}{axis}": (at[name][0], at[name][1] or unit, 1) for axis, name in zip("xyz", triad, strict=True)}
    if dialect.temp in at:
        found["temp"] = at[dialect.temp][0], at[dialect.temp][1] or "degc", 1
    return {"t": (time[0], time[1] or dialect.time_unit, 1), **found} if found else {}


def _refuse_doubled(names: tuple[str, ...], columns: dict[str, Column], where: str) -> None:
    """Refuse two columns of one name; what is not read may repeat."""
    known = [_name_and_unit(text)[0] for text in names]
    for column, _, _ in columns.values():
        if (times := known.count(known[column])) > 1:
            raise FormatError(f"{where}: the column {names[column]} stands {times} times; keep one, or say which by number, --columns")


def _is_own(names: tuple[str, ...]) -> bool:
    if sum(name in STAMP_NS for name in names) == 1:
        return any(name.startswith("gx") for name in names)
    return _without_stamps(names)


def _without_stamps(names: tuple[str, ...]) -> bool:
    """Whether a header is one of ours but for the time."""
    try:
        parse_header(",".join((NO_STAMPS, *names)), "")
    except FormatError:
        return False
    return True


def _own_header(lines: list[str]) -> tuple[int, tuple[str, ...]] | None:
    """A line, and its names, that names one of our columns, though it is no whole header."""
    ours = {*STAMP_NS, "gx", "gx_dps", "gx_rps"}
    named = ((number, split(line, delimiter)) for number, line in enumerate(lines) for delimiter in DELIMITERS)
    return next((found for found in named if len(found[1]) > 1 and ours & set(found[1])), None)


def _own_columns(names: tuple[str, ...], where: str) -> dict[str, Column]:
    stamped = any(name in STAMP_NS for name in names)
    own = parse_header(",".join(names if stamped else (NO_STAMPS, *names)), where, gyro_alone=True)
    columns: dict[str, Column] = {"t": (own.time_column, own.name(own.time_column).removeprefix("t_"), 1)} if stamped else {}
    for kind, places, unit in own.kinds:
        keys = ("temp",) if kind == "temp" else tuple(f"{kind[0]}{axis}" for axis in "xyz")
        columns |= {key: (column - (not stamped), unit.word, 1) for key, column in zip(keys, places, strict=True)}
    return columns


def _layout(
    name: str,
    dialect: str,
    delimiter: str | None,
    first: int,
    names: tuple[str, ...],
    columns: dict[str, Column],
    answers: Answers,
    frame: str,
    lines: list[str],
) -> Layout:
    """columns: {t, gx, …, temp: column}.  FormatError names the option for a missing unit."""
    time_column, time_unit = columns["t"][:2] if "t" in columns else (None, "none")
    time_unit = answers.time_unit or time_unit
    clock = None
    if time_column is None and answers.time_unit != "none":
        read = {column for column, _, _ in columns.values()}
        form = Form(name, delimiter, names, read, lines[first - 1].strip() if first else "")
        mine = Rows(Wanted(answers.rows, answers.where), form)(lines[first:])
        Watch(mine, form)  # two sensors in turn have no clock that rises steadily
        rows = [line.split(delimiter) for line in mine if line.split("#")[0].strip()]
        clock = find_clock(rows, names, read, answers.odr_hz, answers.time_unit, name)
    if clock is not None:
        time_column, time_unit = clock.column, clock.unit
    if time_column is None or time_unit == "none":
        time_column, unit = None, Unit(0, "")
        if answers.odr_hz is None and ("gx" in columns or "ax" in columns):
            raise FormatError(f"{name}: it has no time stamps; give the true data rate, --odr HZ")
    else:
        row = next((line for line in lines[first:] if line.strip()), "").split(delimiter)
        is_clock = time_column < len(row) and ":" in row[time_column]  # a time of day
        unit = Unit(1, "clock") if is_clock else _unit("time", time_unit, "--time-unit", name, dialect)
    triads = {
        letter: _triad(columns, letter, kind, option, unit, axes, name, dialect)
        for letter, kind, option, unit, axes in (
            ("g", "gyro", "--gyro-unit", answers.gyro_unit, answers.gyro_axes),
            ("a", "accel", "--accel-unit", answers.accel_unit, answers.accel_axes),
        )
    }
    temp = columns.get("temp")
    return Layout(
        dialect=dialect,
        delimiter=delimiter,
        first=first,
        time=time_column,
        time_ns=int(unit.si or 1),
        clock=unit.word == "clock",
        gyro=triads["g"],
        accel=triads["a"],
        temp=None if temp is None else temp[0],
        temp_unit=None if temp is None else _unit("temp", temp[1], "--columns temp_c=", name, dialect),
        names=names,
        frame=frame,
        header_line=lines[first - 1].strip() if first else "",
        finer=None if clock is None else clock.finer,
        remark="" if clock is None else clock.says,
    )


def _triad(
    columns: dict[str, Column], letter: str, kind: str, option: str, stated: str | None, axes: str, name: str, dialect: str
) -> Triad | None:
    if f"{letter}x" not in columns:
        return None
    found = [columns[f"{letter}{axis}"] for axis in "xyz"]
    units = {entry[1] for entry in found}
    if len(units) > 1 and not stated:
        raise FormatError(f"{name}: the three axes are in different units ({', '.join(sorted(units))}); expected one")
    unit = _unit(kind, stated or found[0][1], option, name, dialect)
    order, turned = parse_axes(axes, f"--{kind}-axes")
    return Triad(three(found[i][0] for i in order), three(found[i][2] * sign for i, sign in zip(order, turned, strict=True)), unit)


def parse_axes(text: str, option: str) -> tuple[list[int], list[int]]:
    """``y,-x,z``: which of the log's axes becomes x, y, z, and its sign."""
    words = [word.strip().lower() for word in text.split(",")]
    order = ["xyz".find(word.lstrip("+-")) if len(word.lstrip("+-")) == 1 else -1 for word in words]
    if sorted(order) != [0, 1, 2]:
        raise FormatError(f"{option} is {text!r}; expected the log's axes that become x, y, z, such as y,-x,z")
    return order, [-1 if word.startswith("-") else 1 for word in words]


def _unit(kind: str, text: str, option: str, name: str, dialect: str) -> Unit:
    what = {"time": "time stamps", "gyro": "gyroscope", "accel": "accelerometer", "temp": "temperature"}[kind]
    if not text:
        raise FormatError(f"{name} ({dialect}) does not say the unit of the {what}; give {option} ({known(kind)}, or one count: 0.061dps)")
    unit = parse_unit(kind, text)
    if unit is None:
        raise FormatError(f"{name}: {text[:30]!r} is no unit of the {what} that is known; give {option} ({known(kind)})")
    return unit
