"""Recognise a log: from a file's first lines to its columns and units, or one line that names the option that is missing."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from session.base.errors import FormatError
from session.base.numeric import median_length
from session.base.questions import Question, QuestionsError
from session.base.texts import letters_of, shell_word
from session.base.units import COUNTS, ENDINGS, NS_PER_S, STAMP_NS, TIME, WORDS, G, Unit, known, parse_unit
from session.log.layout import Triad, three
from session.log.one_sensor import MOST_SENSORS, Form
from session.log.standard import MOST_NAMES, parse_header, with_degrees
from session.replay.clock import CLOCKS, GIVEN, SENSORS_HZ, exact_ns, find_clock, holds_intervals, is_named_clock, rate_in
from session.replay.columns import DELIMITERS, Column, from_columns, split
from session.replay.dialects import DIALECTS, OTHER, OWN, Dialect, TableLayout
from session.replay.headings import OTHERS, name_and_unit, plain, refuse_angles, spread, usual_columns
from session.replay.options import Answers
from session.replay.rows import FORMAT_WORD, Rows, Watch, place_of, refuse_kinds

# From a file's first lines to a layout: which column is what, in which unit; or all that the file does not state.

#: the option for any table
HOW = "t_us=NAME,gx_dps=NAME,…,az_g=NAME"
NUMBER = r"[-+]?(?:[0-9]++[.,]?[0-9]*+|[.,][0-9]++)(?:[eE][-+]?[0-9]++)?"
#: stands where one of our own headers has no time
NO_STAMPS = "t_us"
NO_TIME = "its data rate, as it has no time stamps"
#: where a unit is from, in words
BY_HEADER, DOCUMENTED = "header", "as that program documents"
#: how well a header fits (the more the better), its line, delimiter, dialect or None for our own, {what: column}, names
Match = tuple[tuple[int, int], int, str | None, Dialect | None, dict[str, Column], tuple[str, ...]]


class UnknownColumnsError(FormatError):
    """A table that does not state what its columns are: as its numbers look, ``--columns`` without units, or ""; stamped: whether one of
    them is a clock; time_units: that are plausible for it, none for a time of day."""

    def __init__(self, where: str, text: str, columns: str = "", stamped: bool = False, time_units: tuple[str, ...] = ()):
        super().__init__(f"{where}: {text}")
        self.file, _, form = where.partition(", ")
        self.dialect, self.columns, self.stamped, self.time_units = form or "no header", columns, stamped, time_units

    rate = Question(NO_TIME, "--odr HZ")


def recognise(lines: list[str], name: str, answers: Answers, picking: str | None = None, form: str = "") -> TableLayout:
    """The layout of a file that begins with these lines; picking: a column that separates several sensors; form: of lines that were
    made a table.

    Raises FormatError, which names the option to give, and QuestionsError of all that the file does not state.
    """
    if answers.rows is None:
        refuse_kinds([line for line in lines if line.strip()], Form(name, None, (), (), header_line="not known yet"))
    if answers.columns is not None:
        delimiter, first, names, wanted = from_columns(answers.columns, lines, name)
        return _layout(name, OTHER, delimiter, first, names, wanted, answers, lines, picking=picking)
    like = None if answers.like is None else _like(answers.like)
    found = max(_matches(lines, name, like), key=lambda match: match[0], default=None)
    if found is None and like is not None:
        example = like.example if isinstance(like, Dialect) else "t_us,gx,gy,gz,ax,ay,az,temp"
        raise FormatError(f"{name}: no header of {answers.like} (--like), such as {example}; it begins {_first(lines)!r}")
    usual = None if like is not None else max(_usual_matches(lines, name), key=lambda match: match[0], default=None)
    if found is None:
        # A line, and its names, that names one of our columns, though it is no whole header.
        ours = {*STAMP_NS, "gx_dps", "gx_rps"}
        named = ((number, split(line, delimiter)) for number, line in enumerate(lines) for delimiter in DELIMITERS)
        own = next((found for found in named if len(found[1]) > 1 and ours & set(found[1])), None)
        if usual is None:
            refuse_angles((names[:MOST_NAMES] for _, _, _, names in _headers(lines)), name)
        if own is not None and (usual is None or any(own[1].count(name) > 1 for name in own[1])):
            number, names = own
            parse_header(",".join(names), f"{name} line {number + 1}")  # raises what is wrong with it
        if usual is None:
            raise _unknown(lines, name, form)
    if found is None or (usual is not None and usual[0] > found[0]):  # which may have one of the sensors, or a temperature, alone
        found = usual
    assert found is not None  # or it is not known
    _, number, delimiter, dialect, columns, names = found
    if dialect is not None:
        # Refuse two columns of one name; what is not read may repeat.
        where = f"{name} line {number + 1}"
        known = [name_and_unit(text)[0] for text in names]
        for column, _, _ in columns.values():
            if (times := known.count(known[column])) > 1:
                raise FormatError(f"{where}: the column {names[column]} stands {times} times; keep one, or give its number, --columns")
    elif not columns:
        columns = _own_columns(names, f"{name} line {number + 1}")
        called = OWN if "t" in columns else OTHER  # its registers may be anyone's
        return with_degrees(_layout(name, called, delimiter, number + 1, names, columns, answers, lines, picking=picking), lines)
    return _layout(name, dialect.name if dialect else OTHER, delimiter, number + 1, names, columns, answers, lines, dialect, picking)


def _like(text: str) -> Dialect | str:
    """The dialect, or our own header."""
    if text.lower() == OWN.lower():
        return OWN
    # The dialect that a text names, however it is written; None for another.
    plain = letters_of(text)
    dialect = next((dialect for dialect in DIALECTS if letters_of(dialect.name).startswith(plain)), None)
    if dialect is None:
        known_ones = ", ".join((OWN, *(each.name for each in DIALECTS)))
        raise FormatError(f"--like is {text[:40]!r}; expected one of {known_ones}, or another name of `import --list`")
    return dialect


def _unknown(lines: list[str], name: str, form: str) -> UnknownColumnsError:
    """The refusal of a log that states nothing of its columns, with the option that names them, ready to edit; form: of its lines."""
    where = f"{name}{f', {form}' if form else ''}"
    table = _suggested(lines)
    known = "no header of a log that is known (import --list)"
    if table is None:
        return UnknownColumnsError(where, f"{known}; it begins {_first(lines)!r}: name its columns, --columns {HOW}")
    count, entries, names, units = table
    called = {column: _called(names, column) for _, _, column in entries}
    stamped = entries[0][0] == "t"
    listed = ",".join(f"{key}{'_' * bool(unit)}{unit}={called[column]}" for key, unit, column in entries)
    rates = "" if stamped else " and --odr HZ, as it has no stamps"
    edit = f"--columns {shell_word(listed)} (as its numbers look; put the units, and correct it){rates}"
    begins = f"no header, {count} columns of numbers; name them by number,"
    if re.search("[A-DF-Za-df-z]", _first(lines)):  # an exponent is no name
        begins = f"{known}; it begins {_first(lines)!r}: give"
    by_name = not any(name.isdigit() for name in called.values())
    bare = ",".join(f"{key}={called[column] if by_name else column + 1}" for key, _, column in entries)
    both = len(entries) - stamped == 6
    return UnknownColumnsError(where, f"{begins} {edit}", bare if both else "", stamped, units)


def _first(lines: list[str]) -> str:
    return next((line.strip()[:60] for line in lines if line.strip()), "")


# Which line is the header, and of which dialect.


def _headers(lines: list[str]) -> Iterator[tuple[int, bool, str | None, tuple[str, ...]]]:
    """Each line that may be a header, with every delimiter; of two lines of names, one below the other, the second with both: then True."""
    for number, line in enumerate(lines):
        if not re.search(r"[A-Za-z]", line):
            continue
        for delimiter in DELIMITERS:
            names = split(line, delimiter)
            if len(names) < 2 or names[0] == FORMAT_WORD:
                continue
            if len(names) > LEAST_OF_TWO and _are_names(lines[number + 1 : number + 2], delimiter, names):
                # Names with the units, or the axes, that stand below them; an empty name goes on from the one before it.
                whole, before = [], ""
                for name, under in zip(names, split(lines[number + 1], delimiter), strict=True):
                    before = name or before
                    unit = under.strip("[]() ")
                    is_unit = unit and any(parse_unit(kind, unit) is not None for kind in ("time", "gyro", "accel", "temp"))
                    both = f"{name or before} [{unit}]" if is_unit else f"{before} {under}".strip()
                    whole.append(both if name or under else "")
                yield number + 1, True, delimiter, tuple(whole)
            yield number, False, delimiter, spread(names)


def _are_names(lines: list[str], delimiter: str | None, names: tuple[str, ...]) -> bool:
    """Whether a line that follows is of as many other names or units, and of no number."""
    cells = split(lines[0], delimiter) if lines and lines[0].strip() else ()
    return len(cells) == len(names) and cells != names and not any(re.fullmatch(NUMBER, cell) for cell in cells if cell)


#: columns of a table with two lines of names: fewer may be words
LEAST_OF_TWO = 5
#: names of which every dialect's header has one
STAMPED = frozenset(part for dialect in DIALECTS for each in dialect.time for part in each.split("+"))


def _matches(lines: list[str], name: str, like: Dialect | str | None) -> Iterator[Match]:
    """Every header that fits, with every delimiter and dialect that it fits with; like: the one that is meant."""
    for number, both, delimiter, names in _headers(lines):
        own = like in (None, OWN) and not lines[number].lstrip().startswith("#") and _is_own(names)
        if own and not _are_names(lines[number + 1 : number + 2], delimiter, names):
            yield (18, -number), number, delimiter, None, {}, names
        cells = [name_and_unit(text) for text in names]
        if STAMPED.isdisjoint(cell.replace(" -", " ") for cell, _ in cells):
            continue  # as nearly every row of a log is, at once
        for dialect in DIALECTS if like is None else (like,):
            if not isinstance(dialect, Dialect) or (dialect.begins and dialect.begins != lines[0].strip().lstrip("\ufeff")):
                continue
            columns = _columns_of(dialect, cells, name)
            if columns:
                yield (2 * len(columns) + 20 * bool(dialect.begins) + both, -number), number, delimiter, dialect, columns, names


def _columns_of(dialect: Dialect, names: list[tuple[str, str]], file: str) -> dict[str, Column]:
    """{t: column, gx: …, temp: …} where the header is of this dialect; empty where it is not."""
    at: dict[str, tuple[int, str]] = {}
    turned = {column for column, (name, _) in enumerate(names) if " -" in name}  # ``gyroscope -x``
    for column, (name, unit) in enumerate(names):
        at.setdefault(name.replace(" -", " "), (column, unit))
    time = next((parts for parts in (each.split("+") for each in dialect.time) if all(part in at for part in parts)), None)
    if time is None or not all(name in at for name in dialect.signature):
        return {}
    found: dict[str, Column] = {}
    for letter, pattern, unit in (("g", dialect.gyro, dialect.gyro_unit), ("a", dialect.accel, dialect.accel_unit)):
        triad = [pattern.format(axis) for axis in dialect.axes]
        begins = "gyro" if letter == "g" else ("accel", "totalaccel")  # of the telephone, not of a watch or a headphone
        if all(name in at for name in triad) and not (dialect.by_file and not file.lower().startswith(begins)):
            places = {f"{letter}{axis}": at[name] for axis, name in zip("xyz", triad, strict=True)}
            found |= {key: (column, own or unit, -1 if column in turned else 1) for key, (column, own) in places.items()}
    if dialect.both and ("gx" in found) != ("ax" in found):
        return {}
    if dialect.temp and dialect.temp in at:
        found["temp"] = at[dialect.temp][0], at[dialect.temp][1] or "degc", 1
    stamp = {"t": (at[time[0]][0], at[time[0]][1] or dialect.time_unit, 1)}
    if len(time) == 2:
        stamp |= {"t": (at[time[0]][0], "s", 1), "t2": (at[time[1]][0], "ns", 1)}
    return {**stamp, **found} if found else {}


#: further columns, but for times, of a file that is taken for one sensor's: a counter, a name
MOST_BESIDE = 2


def _usual_matches(lines: list[str], name: str) -> Iterator[Match]:
    """Headers of no dialect that state what their columns are."""
    for number, both, delimiter, names in _headers(lines):
        columns = usual_columns(names[:MOST_NAMES], name)
        alone = bool(columns) and ("gx" in columns) != ("ax" in columns)
        beside = sum(name != "" and not is_named_clock(name) for name in names) - len(columns)
        if columns and not (alone and beside > MOST_BESIDE):  # the other sensor may be among the rest
            yield (2 * len(columns) + both, -number), number, delimiter, None, columns, names


# One of our own headers, perhaps without stamps, or nearly one.


def _is_own(names: tuple[str, ...]) -> bool:
    if "gx" not in ",".join(names):
        return False  # as nearly every row of a log is, at once
    if sum(name in STAMP_NS for name in names) == 1:
        return any(name.startswith("gx") for name in names)
    # Whether a header is one of ours but for the time.
    try:
        parse_header(",".join((NO_STAMPS, *names)), "")
    except FormatError:
        return False
    return True


def _own_columns(names: tuple[str, ...], where: str) -> dict[str, Column]:
    stamped = any(name in STAMP_NS for name in names)
    own = parse_header(",".join(names if stamped else (NO_STAMPS, *names)), where, gyro_alone=True)
    columns: dict[str, Column] = {"t": (own.time_column, own.name(own.time_column).removeprefix("t_"), 1)} if stamped else {}
    for kind, places, unit in own.kinds:
        keys = ("temp",) if kind == "temp" else tuple(f"{kind[0]}{axis}" for axis in "xyz")
        columns |= {key: (column - (not stamped), unit.word, 1) for key, column in zip(keys, places, strict=True)}
    return columns


# The layout of what was found, with the person's answers in the place of what the file states.


def _layout(
    name: str,
    called: str,
    delimiter: str | None,
    first: int,
    names: tuple[str, ...],
    columns: dict[str, Column],
    answers: Answers,
    lines: list[str],
    dialect: Dialect | None = None,
    picking: str | None = None,
) -> TableLayout:
    """columns: {t, gx, …, temp: column}; first: lines before the rows.  QuestionsError for the units that are not known."""
    columns = {
        key: (column, "", sign) if _is_no_register(word, column, delimiter, lines[first:]) else (column, word, sign)
        for key, (column, word, sign) in columns.items()
    }
    # What ``key,value`` lines before the header state, quoted or not.
    pairs = [[part.strip().strip('"') for part in line.split(",", 1)] for line in lines[: first - 1]]
    header = {pair[0].lower(): pair[1] for pair in pairs if len(pair) == 2}
    facts = dialect.facts(header) if dialect is not None and dialect.facts is not None else {}
    questions: list[Question] = []
    row = _first_row(lines[first:], delimiter)
    time_column, time_unit = columns["t"][:2] if "t" in columns else (None, "none")
    time_unit = answers.time_unit or facts.get("time_unit") or time_unit
    clock = None
    if time_column is None and answers.time_unit != "none":
        read = {column for column, _, _ in columns.values()}
        form = Form(name, delimiter, names, read, lines[first - 1].strip() if first else "")
        mine = Rows(answers.rows, answers.where, form)(lines[first:])
        if picking is not None:  # the clock of one of them
            place, row_of = place_of(picking, form), _first_row(lines[first:], delimiter)
            value = row_of[place].strip().strip('"') if place < len(row_of) else ""
            mine = Rows(answers.rows, f"{picking}={value or 0}", form)(lines[first:])
            if sum(bool(line.strip()) for line in mine) < 2 and len(lines) > first + MOST_SENSORS:
                what = f"the column {picking!r} holds more than {MOST_SENSORS} values"
                raise FormatError(f"{name}: {what}; give the column that separates the sensors")
        Watch(mine, form)  # two sensors in turn have no clock that rises steadily
        rows = _rows(mine, delimiter)
        try:
            clock = find_clock(rows, names, read, answers.odr_hz, answers.time_unit, name, lines[:first])
        except QuestionsError as unknown:
            questions += unknown.questions
    if clock is not None:
        time_column, time_unit = clock.column, clock.unit
    if time_column is None or time_unit == "none":
        time_column, unit = None, Unit(0, "")
        if answers.odr_hz is None and ("gx" in columns or "ax" in columns) and not questions:
            if (rate_hz := rate_in(lines[:first])) is None:
                questions.append(Question(NO_TIME, "--odr HZ"))
            else:
                facts |= {"odr_hz": f"{rate_hz:.9g}"}
    else:
        is_clock = time_column < len(row) and ":" in row[time_column]  # a time of day
        unit = Unit(1, "clock") if is_clock else unit_of("time", time_unit, "--time-unit", name, questions)
    finer: tuple[tuple[int, int], ...] = () if clock is None or clock.finer is None else (clock.finer,)
    if time_column is not None and not answers.time_unit:
        terms = [columns[key] for key in sorted(columns) if re.fullmatch(r"t\d", key)]
        finer += tuple((column, int(unit_of("time", word, "--columns t=", name, questions).si or 1)) for column, word, _ in terms)
    given_units = {"gyro": answers.gyro_unit, "accel": answers.accel_unit}
    triads = {
        kind: _triad(columns, kind, given_units[kind] or facts.get(f"{kind}_unit"), axes, name, questions)
        for kind, axes in (("gyro", answers.gyro_axes), ("accel", answers.accel_axes))
    }
    temp = columns.get("temp")
    temp_unit = None if temp is None else unit_of("temp", temp[1], "--columns temp_c=", name, questions)
    if questions:
        raise QuestionsError(name, called, questions)
    return TableLayout(
        dialect=called,
        delimiter=delimiter,
        first=first,
        time=time_column,
        time_ns=unit.si or 1,
        clock=unit.word == "clock",
        gyro=triads["gyro"],
        accel=triads["accel"],
        temp=None if temp is None else temp[0],
        temp_unit=temp_unit,
        names=names,
        frame="" if dialect is None else dialect.frame,
        header_line=lines[first - 1].strip() if first else "",
        finer=finer,
        remark="" if clock is None else clock.description,
        sources=({} if clock is None else {"time": clock.known}) | _sources(columns, names, answers, facts, given_units, dialect),
        intervals=time_column is not None and holds_intervals(_rows(lines[first:], delimiter), time_column, names),
        facts={key: value for key, value in facts.items() if not key.endswith("_unit")},
    )


def _rows(lines: list[str], delimiter: str | None) -> list[list[str]]:
    return [line.split(delimiter) for line in lines if line.split("#")[0].strip()]


def _sources(
    columns: dict[str, Column],
    names: tuple[str, ...],
    answers: Answers,
    facts: Mapping[str, str],
    given_units: Mapping[str, str | None],
    dialect: Dialect | None,
) -> dict[str, str]:
    """Where each unit is from."""
    found = {}
    for kind, key, stated in (("time", "t", answers.time_unit), ("gyro", "gx", given_units["gyro"]), ("accel", "ax", given_units["accel"])):
        if key not in columns:
            continue
        column, word, _ = columns[key]
        written = column < len(names) and (word in names[column] or word in COUNTS) and bool(word)
        origin = GIVEN if stated or answers.columns else "its own lines before the header" if f"{kind}_unit" in facts else ""
        found[kind] = origin or (BY_HEADER if written or dialect is None else DOCUMENTED)
    return found


def _is_no_register(word: str, column: int, delimiter: str | None, lines: list[str]) -> bool:
    """Whether a column that is taken for registers has fractions: it is in a unit that no one named."""
    if word not in COUNTS:
        return False
    cells = [row[column] for line in lines[:MOST_NAMES] if column < len(row := line.split("#")[0].split(delimiter))]
    return any(re.fullmatch(NUMBER, cell.strip()) and not re.fullmatch(r"[-+]?\d+(?:[.,]0*)?", cell.strip()) for cell in cells)


def _first_row(lines: list[str], delimiter: str | None) -> list[str]:
    return next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), "").split(delimiter)


def _triad(columns: dict[str, Column], kind: str, stated: str | None, axes: str, name: str, questions: list[Question]) -> Triad | None:
    letter = kind[0]
    if f"{letter}x" not in columns:
        return None
    found = [columns[f"{letter}{axis}"] for axis in "xyz"]
    units = {entry[1] for entry in found}
    if len(units) > 1 and not stated:
        raise FormatError(f"{name}: the three axes are in different units ({', '.join(sorted(units))}); expected one")
    unit = unit_of(kind, stated or found[0][1], f"--{kind}-unit", name, questions)
    order, turned = parse_axes(axes, f"--{kind}-axes")
    return Triad(three(found[i][0] for i in order), three(found[i][2] * sign for i, sign in zip(order, turned, strict=True)), unit)


def parse_axes(text: str, option: str) -> tuple[list[int], list[int]]:
    """``y,-x,z``: which of the log's axes becomes x, y, z, and its sign."""
    words = [word.strip().lower() for word in text.split(",")]
    order = ["xyz".find(word.lstrip("+-")) if len(word.lstrip("+-")) == 1 else -1 for word in words]
    if sorted(order) != [0, 1, 2]:
        raise FormatError(f"{option} is {text!r}; expected the log's axes that become x, y, z, such as y,-x,z")
    return order, [-1 if word.startswith("-") else 1 for word in words]


def unit_of(kind: str, text: str, option: str, name: str, questions: list[Question]) -> Unit:
    """The unit; where there is none, a question, and any unit."""
    what = {"time": "time stamps", "gyro": "gyroscope", "accel": "accelerometer", "temp": "temperature"}[kind]
    if not text:
        questions.append(Question(f"the unit of the {what}", option, CHOICES[kind]))
        return Unit(1, "")
    unit = parse_unit(kind, text)
    if unit is None:
        raise FormatError(f"{name}: {text[:30]!r} is no unit of the {what} that is known; give {option} ({known(kind)})")
    return unit


#: of a question, in the words that people use most
CHOICES = {
    "time": "s, ms, us, ns, or one count: 25us",
    "gyro": "dps, mdps, rad/s, lsb, or one count: 0.061dps",
    "accel": "g, mg, m/s2, lsb, or one count: g/2048",
    "temp": "c, lsb, or one count: 0.01c",
}


# ``--columns`` ready to edit, for a table that does not state what its columns are: filled with its own names, or its columns' numbers.

#: stands where a person puts the unit; nothing stands for registers
UNIT = "UNIT"
#: columns of a table: a triad, and stamps or not
FEWEST, MOST = 3, 200
#: what a resting accelerometer shows, in the words of ``--columns``; of registers, 1 g of the usual full scales
GRAVITY = (("mps2", G), ("g", 1.0), ("mg", 1e3), ("", 16384.0), ("", 8192.0), ("", 4096.0), ("", 2048.0))
#: of it, how far the median length may be from it
NEAR = 0.1


def _suggested(lines: Sequence[str]) -> tuple[int, list[tuple[str, str, int]], list[str], tuple[str, ...]] | None:
    """Of a log that begins with these lines: how many columns, the entries of ``--columns`` (``gx``, ``UNIT``, column), the columns' names,
    and plausible units of the clock; None where they are no table.

    Where names do not state it, the accelerometer is the triad that is as long as gravity, the gyroscope one next to it: a person looks at
    it and corrects it.
    """
    values, clocks, names = max((_table(lines, delimiter) for delimiter in DELIMITERS), key=lambda table: table[0].size)
    count = values.shape[1]
    rises = [c for c in range(count) if (np.diff(values[:, c]) >= 0).all() and np.ptp(values[:, c]) > 0]
    named = [c for c in rises if set(re.findall("[a-z]+", names[c].lower())) & set(CLOCKS)]
    # A board's own time before a time of day, which is the computer's, and both before what counts the rows.
    time = next(
        iter((*named, *(c for c in rises if c not in clocks and (np.diff(values[:, c]) != 1).any()), *sorted(clocks), *rises)), None
    )
    sensors = ["-" if is_named_clock(name) else _sensor(name) for name in names]
    left = [c for c in range(count) if c not in (time, *clocks) and sensors[c] != "-" and np.isfinite(values[:, c]).all()]
    triads = [c for c in left if {c + 1, c + 2} <= set(left)]
    of: dict[str, list[int]] = {}
    for letter, other in ("ga", "ag"):
        named = [c for c in triads if set(sensors[c : c + 3]) == {letter}]
        of[letter] = named or [c for c in triads if other not in sensors[c : c + 3]]
    lengths = {c: median_length(values[:, c : c + 3]) for c in of["a"]}
    # Triads fill a row from its beginning, or to its end; the accelerometer's own reading comes before what a program makes of it.
    uneven = {c: 0 if (place := left.index(c)) % 3 == 0 else 1 + ((len(left) - place) % 3 > 0) for c in triads}
    near = [(uneven[c], c, off, word) for c, length in lengths.items() for word, g in GRAVITY if (off := abs(length / g - 1)) < NEAR]
    _, accel, _, unit = min(near, default=(0, None, 0.0, UNIT))
    apart = [c for c in of["g"] if accel is None or abs(c - accel) >= 3]
    gyro = min(apart, key=lambda c: (uneven[c], abs(c - accel) if accel is not None else 0, c), default=None)
    accel = next((c for c in of["a"] if gyro is not None and abs(c - gyro) >= 3), None) if accel is None else accel
    if gyro is None and accel is None:
        return None
    entries = [] if time is None else [("t", "" if time in clocks else _unit("time", names[time], UNIT), time)]
    for kind, first, word in (("gyro", gyro, unit and UNIT), ("accel", accel, unit)):
        columns = range(first, first + 3) if first is not None else ()
        entries += [(f"{kind[0]}{axis}", _unit(kind, names[column], word), column) for axis, column in zip("xyz", columns, strict=False)]
    step = 0.0 if time is None or time in clocks else float(np.median(np.diff(values[:, time])))
    hz = {word: NS_PER_S / (step * TIME[word]) for word in ("s", "ms", "us", "ns") if step > 0}
    return count, entries, names, tuple(word for word in hz if SENSORS_HZ[0] <= hz[word] <= SENSORS_HZ[1])


def _sensor(name: str) -> str:
    """The sensor that a column's name may mean, ``g`` or ``a``, ``-`` for another, empty for a name that does not show it."""
    name = plain(name_and_unit(name)[0])
    if any(word in name for word in (*OTHERS, "quat", "euler")) or re.fullmatch("q[wxyz0-3]", name):
        return "-"
    return "g" if re.search("gy|gir|omega|rate|rot", name) else "a" if re.search("acc|force", name) else ""


def _table(lines: Sequence[str], delimiter: str | None) -> tuple[np.ndarray, set[int], list[str]]:
    """Numbers (N, C) of the rows of the width that most have, NaN where there are none; which columns are clocks; names, or numbers."""
    rows: list[tuple[list[float], list[bool]]] = []
    before = header = ""
    for line in lines:
        cells = [cell.strip().strip('"') for cell in line.split("#")[0].strip().split(delimiter)]
        numbers = [_number(cell.replace(",", ".") if delimiter != "," else cell) for cell in cells[:MOST]]
        if sum(number == number for number in numbers) >= FEWEST:
            header = header if rows else before
            rows.append((numbers, [":" in cell for cell in cells]))
        before = line
    width = Counter(len(numbers) for numbers, _ in rows).most_common(1)[0][0] if rows else 0
    mine = [row for row in rows if len(row[0]) == width]
    names = split(header, delimiter)
    clocks = {c for c in range(width) if mine[0][1][c]}
    values = np.array([numbers for numbers, _ in mine]).reshape(len(mine), width)
    return values, clocks, list(names) if len(names) == width else [""] * width


def _number(cell: str) -> float:
    try:
        return exact_ns(cell, NS_PER_S) / NS_PER_S
    except ValueError:
        return float("nan")


def _unit(kind: str, name: str, otherwise: str) -> str:
    """The unit that a heading states, in the words of ``--columns``."""
    unit = parse_unit(kind, name_and_unit(name)[1])
    if unit is None:
        return otherwise
    return next((word for word in (*ENDINGS[kind], "ms", "mdps", "mg") if WORDS[kind].get(word) == unit.si), otherwise)


def _called(names: Sequence[str], column: int) -> str:
    """The name of a column, where ``--columns`` can take it, else its number."""
    name = names[column]
    plain = name and names.count(name) == 1 and not re.search("[,=+*]", name) and not name.startswith("-") and not name.isdigit()
    return name if plain else f"{column + 1}"
