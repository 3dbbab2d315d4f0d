"""Text that is no table yet, as lines of a table: ``ax:1 ay:2``, JSON lines, hexadecimal, a serial monitor's clock.

Each form turns lines into lines, one for one, so that a complaint still names the line of the file.  Where the form brings names of its
own, it has a header, which the reader of tables then recognises like any other.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from functools import lru_cache, reduce
from itertools import pairwise
from operator import xor

from session.base.errors import FormatError
from session.base.units import parse_unit
from session.log.one_sensor import SENSORS
from session.replay.clock import CLOCKS, UNITS

#: lines that are looked at, and the share of them that must be of a form
LOOKED_AT, SHARE = 200, 0.5
#: numbers of a line, or of a record, from which on it may be a sensor's: three axes
LEAST_PAIRS = 3
#: of the name that comes most often: a name that comes as often belongs to the record
OFTEN = 0.8
#: of a record: a phone's with everything switched on has some dozens
MOST_PAIRS = 200
#: characters of a name behind its first
LONGEST_NAME = 60
NUMBER = r"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?"
DIGITS = re.compile(NUMBER)


#: a row that no reader of tables takes: it is refused by its line, with what is wrong with it
TORN, TORN_RECORD = "torn", "the record is torn, or in another unit than before"


class TextForm:
    """name: in words; header: the names of its columns, with commas, or empty where the lines have one of their own;
    left_out: how many lines so far held nothing of it; torn: what is wrong with a line that it calls torn."""

    name = header = ""
    left_out = 0
    torn = TORN_RECORD

    def __call__(self, lines: list[str]) -> list[str]:
        """As many lines: rows of the table, and blanks where no row ends."""
        return list(map(self.row, lines))

    def row(self, line: str) -> str:
        """The row that ends with a line, a blank, or ``TORN``."""
        raise NotImplementedError

    def _no_row(self, line: str, torn: bool) -> str:
        """What stands for a line that holds none, or a torn one."""
        self.left_out += bool(line.strip()) and not torn
        return TORN if torn else ""


def form_of(lines: list[str], packed: str | None, name: str) -> TextForm | None:
    """The form of a log that begins with these lines; None where it is a table already.

    packed: what is known of registers that are written as one hexadecimal word.  FormatError where they are, and it is not known.
    """
    some = [line for line in lines if line.strip()][:LOOKED_AT]
    if sum(MONITOR.match(line) is not None for line in some) > SHARE * len(some):
        without = [bare for line in some if (bare := MONITOR.sub("", line)).strip()]
        return _Monitor(form_of(without, packed, name), without)
    for kind in (_Sentences, _JsonLines, _Labelled, _Pairs):
        if (form := kind.found(some, name)) is not None:
            return form
    return _packed(some, packed, name) or _hexadecimal(some)


# The clock that a serial monitor puts before each line: ``12:30:01.123 -> 1,2,3`` of the Arduino IDE, ``12:30:01.123 > `` of PlatformIO,
# ``[2026-05-03 12:30:01.123] `` of Tera Term, the same without brackets of CoolTerm.

_DATE, _TIME = r"\d{4}-\d\d-\d\d[ T]", r"(\d{1,2}:\d\d:\d\d[.:]\d+)"
MONITOR = re.compile(
    rf"^\s*(?:(?:\[(?:{_DATE})?{_TIME}\]|(?:{_DATE})?{_TIME} -?>) ?|{_DATE}{_TIME}(?: (?=\S*[,;:=\t])|, ?(?=[A-Za-z][\w() ]{{0,40}}[:=])))"
)


class _Monitor(TextForm):
    """The clock becomes the last column: what the board itself states of the time comes before it."""

    name = "a serial monitor's lines"

    def __init__(self, inner: TextForm | None, lines: list[str]):
        """lines: without the clock."""
        self._inner, self._delimiter = inner, next((sign for sign in ",;\t" if any(line.count(sign) >= 2 for line in lines)), " ")
        if inner is not None:
            self.header, self._delimiter = f"{inner.header},monitor_time" if inner.header else "", ","
            self.name = f"{inner.name}, with a serial monitor's clock"

    def row(self, line: str) -> str:
        """With the clock."""
        clock, bare = MONITOR.match(line), MONITOR.sub("", line)
        names = self._inner is None and re.match(r"\s*[A-Za-z_]", bare) is not None
        if self._inner is not None:
            bare, self.left_out = self._inner.row(bare), self._inner.left_out
        end = "" if clock is None or not bare.strip() else f"{self._delimiter}{'monitor_time' if names else clock[clock.lastindex or 0]}"
        return bare.rstrip("\r") + end


# Names and numbers in turn, on one line or on several: ``ax:1 ay:2``, ``Accel X: 0.1, Y: 0.2, Z: 9.8 m/s^2``.

# Names have an end: from each of a long line's letters a pattern would look at all that follow.
PAIR = re.compile(
    rf"(?P<name>[A-Za-z_°](?:[A-Za-z_°0-9.\[\]() ]|-(?=[A-Za-z])){{0,{LONGEST_NAME}}}+)"
    rf"\s{{0,9}}+[:=]\s{{0,9}}+(?P<value>{NUMBER})(?![\w.:])",
)
UNIT = re.compile(r"[ \t]*([A-Za-z°µ%][\w°/^²µ%]*)(?![\w°/^²µ%]|\s*[:=])")
AXES = ("x", "y", "z")


class _Record(TextForm):
    """Rows of names and numbers: of one line each, or gathered over several, from the name that a record begins with."""

    def __init__(self, parsed: list[list[tuple[str, str, str]]], begins: str | None = None):
        """parsed: what the first lines hold, each (name, number, unit); begins: the name that stands first in a record of several lines."""
        counts: dict[str, int] = {}
        units: dict[str, str] = {}
        for pairs in parsed:
            for name, _, unit in pairs:
                counts[name] = counts.get(name, 0) + 1
                units.setdefault(name, unit)
        most = max(counts.values(), default=0)
        self.names = [name for name, count in counts.items() if count >= OFTEN * most]
        clock = next((name for name in self.names if set(re.findall(r"[a-z]+", name.lower())) & {*CLOCKS, *UNITS}), None)
        if (begins or clock) in self.names:  # people print the time first
            first = self.names.index(begins or clock or "")
            self.names = self.names[first:] + self.names[:first]
        self.header = ",".join(f"{name} [{units[name]}]" if units.get(name) else name for name in self.names)
        self.is_one = 2 * LEAST_PAIRS <= len(self.names) <= MOST_PAIRS and most > 1
        self._known, self._have, self._begun = set(self.names), dict[str, str](), False
        self._units = units
        whole = sum(self._known <= {name for name, _, _ in pairs} for pairs in parsed)
        self._on_one_line = whole > SHARE * len(parsed)

    def completed(self, pairs: list[tuple[str, str, str]]) -> str:
        """The row that a line's pairs complete, or one that cannot be read where they show it to be torn; else empty.  What stands before
        the first whole record, as a capture begins anywhere, is left out."""
        mine = [(name, value) for name, value, _ in pairs if name in self._known]
        if any(unit and name in self._known and unit != self._units[name] for name, _, unit in pairs):
            return TORN  # in another unit than before
        torn = False
        if self._on_one_line:
            torn = bool(mine) and not len(mine) == len(dict(mine)) == len(self.names)
            self._have = {} if torn else dict(mine)
        else:
            for name, value in mine:
                if self._have and (name in self._have or name == self.names[0]):
                    self._have, torn = {}, True
                if self._have or name == self.names[0]:
                    self._have[name] = value
                else:  # of a record whose beginning is not there
                    torn = True
        if torn and self._begun:
            return TORN
        self.left_out += torn
        if len(self._have) < len(self.names):
            return ""
        text, self._have, self._begun = ",".join(self._have[name] for name in self.names), {}, True
        return text


class _Pairs(_Record):
    name = "names and numbers in turn"

    def __init__(self, parsed: list[list[tuple[str, str, str]]], begins: str | None, stamped: bool, commas: bool):
        super().__init__(parsed, begins)
        self._stamped, self._commas, self._heading = stamped, commas, ""

    @classmethod
    def found(cls, lines: list[str], name: str) -> _Pairs | None:
        """Where most lines hold them."""
        mine = _under_headings([line for line in lines if not line.lstrip().startswith("#")])[0]
        commas = sum(WITH_COMMA.search(line) is not None for line in mine) > SHARE * len(mine)
        stamped = sum(LEADING.match(line) is not None for line in mine) > SHARE * len(mine)
        parsed = [pairs for line in mine if (pairs := _pairs(line, stamped, commas))]
        if len(parsed) <= SHARE * len(lines) or not parsed:
            return None
        _refuse_labels(mine, name)
        gap = next((i for i, line in enumerate(lines) if not line.strip()), None)
        behind = next((pairs for line in mine[gap:] if (pairs := _pairs(line, stamped, commas))), []) if gap is not None else []
        form = cls(parsed, behind[0][0] if behind else None, stamped, commas)
        return form if form.is_one else None

    def row(self, line: str) -> str:
        """Of names and numbers, perhaps over several lines."""
        (headed,), self._heading = _under_headings([line], self._heading)
        pairs = _pairs(headed, self._stamped, self._commas)
        return self.completed(pairs) if pairs else self._no_row(line, torn=False)


#: a line of its own above ``X = 1``, ``Y = 2``: ``Accelerometer:``
HEADING = re.compile(r"\s*+([A-Za-z][\w ]{0,40}?)\s*:\s*+")
BARE_AXIS = re.compile(r"\s*+[XYZxyz]\s*+[:=]")


def _under_headings(lines: list[str], heading: str = "") -> tuple[list[str], str]:
    """Lines in which an axis alone has the heading above it before it, and the last heading."""
    found = []
    for line in lines:
        match = HEADING.fullmatch(line)
        heading = heading if match is None else match[1]
        found.append(f"{heading} {line.strip()}" if heading and BARE_AXIS.match(line) else line)
    return found, heading


#: ``IMU0: ax=1 …``, ``dev=left, ax=1 …``: which sensor a line is of, in words
OF_SENSOR = re.compile(r"\s*+(?:([A-Za-z_]\w*+)\s*+[:>]\s++(?=[A-Za-z_]\w*+\s*+[:=])|.*?\b(\w++)\s*+[:=]\s*+([A-Za-z]\w*+)(?!\s*+[:=]))")


def _refuse_labels(lines: list[str], name: str) -> None:
    """FormatError where whole lines are of several sensors, by words that stand before their names."""
    found = []
    for line in lines:
        match = OF_SENSOR.match(line)
        if match is not None and line.count("=") + line.count(":") > 2 * LEAST_PAIRS:
            of = match[1] or (match[3] if re.sub(r"[^a-z]", "", match[2].lower()) in SENSORS else None)
            found += [of] if of else []
    several = [word for word in dict.fromkeys(found) if found.count(word) > 1]
    if len(several) > 1 and len(found) > SHARE * len(lines):
        raise FormatError(f"{name}: lines of several sensors ({', '.join(several[:4])}), by words; keep the lines of one")


# Rows of numbers behind a label: ``a/g:\t-120\t…``, ``IMU: 1, 2, …``.

ROW = re.compile(
    rf"\s*+([A-Za-z][A-Za-z0-9_/ .-]{{0,{LONGEST_NAME}}}?)\s*[:=>]\s*+({NUMBER}(?:[,;\s]++{NUMBER}){{5,{MOST_PAIRS}}}+)[,;\s]*+"
)
#: what the labels of well-known sketches stand for
LABELS = {"a/g": "ax,ay,az,gx,gy,gz", "a/g/m": "ax,ay,az,gx,gy,gz,mx,my,mz"}


class _Labelled(TextForm):
    name = "rows of numbers behind a label"

    def __init__(self, label: str):
        self._label, self.header = label, LABELS.get(label, "")

    @classmethod
    def found(cls, lines: list[str], name: str) -> _Labelled | None:
        """Where most lines have one and the same label."""
        labels = Counter(match[1] for line in lines if (match := ROW.fullmatch(line)) is not None)
        label, count = labels.most_common(1)[0] if labels else ("", 0)
        return cls(label) if count > SHARE * len(lines) else None

    def row(self, line: str) -> str:
        """The numbers, with commas."""
        match = ROW.fullmatch(line)
        if match is None or match[1] != self._label:
            return self._no_row(line, torn=False)
        return ",".join(re.split(r"[,;\s]+", match[2]))


#: ``acc: x=1 y=2``; ``Accel: 1, 2, 3``; ``ax: 8,06 ay: …``; a number before the names, ``1234 ax: …``, ``I (1234) IMU: …``
LABEL = re.compile(rf"\b([A-Za-z_]\w{{0,{LONGEST_NAME}}})\s{{0,9}}[:=]\s{{0,9}}(?=[xyzXYZ]\s{{0,9}}[:=])")
_THREE = rf"({NUMBER})[,;\s]{{1,9}}+({NUMBER})[,;\s]{{1,9}}+({NUMBER})(?![\w.]|\s*[:=])"
_OF = rf"\b([A-Za-z_][\w ]{{0,{LONGEST_NAME}}}?)"
LIST = re.compile(rf"{_OF}(?:\s{{0,9}}\(([^()]{{1,20}})\))?\s{{0,9}}+(?:[:=]\s{{0,9}}+[\[(]?|\[)\s{{0,9}}+{_THREE}")
WITH_COMMA = re.compile(r"[:=]\s*[-+]?\d+,\d+(?=\s*(?:[A-Za-z;|]|$))")
LEADING = re.compile(r"\s*+(?:[IWEDV]\s*+\()?(\d++(?:\.\d++)?)\)?(?:\s*+[,:;])?\s++(?=[A-Za-z])")
STAMP = "stamp"


def _pairs(line: str, stamped: bool, commas: bool) -> list[tuple[str, str, str]]:
    """``(name, number, unit)``; a bare axis has the name before it, and the unit behind the last axis is that of all three."""
    if commas:
        line = re.sub(r"(?<=\d),(?=\d)", ".", line)
    lead = LEADING.match(line) if stamped else None
    line = LABEL.sub(r"\1 ", line if lead is None else line[lead.end() :])
    line = LIST.sub(r"\1 x: \3, \1 y: \4, \1 z: \5 \2", line)
    before, named, at = "", [], 0
    while (match := PAIR.search(line, at)) is not None:
        name, value, at = match["name"].strip(), match["value"], match.end()
        behind = UNIT.match(line, at)
        unit = "" if behind is None or not _is_unit(behind[1]) else behind[1]
        at = behind.end() if unit and behind is not None else at
        bare = name.lower() in AXES
        name = f"{before} {name}" if bare and before else name
        if not bare and name[-1:].lower() in AXES:
            before = name[:-1].rstrip(" _.")
        named.append((name, value, unit))
    found = [(STAMP, lead[1], "")] if lead is not None else []
    for place, (name, value, unit) in enumerate(named):
        later = next((each[2] for each in named[place : place + 3] if each[2]), "")
        found.append((name, value, unit or (later if name[-1:].lower() in AXES else "")))
    return found


@lru_cache(maxsize=64)
def _is_unit(word: str) -> bool:
    return any(parse_unit(kind, word) is not None for kind in ("time", "gyro", "accel", "temp"))


# Sentences of a sensor with firmware of its own: ``$VNYMR,…*5A``, checked by the checksum behind the asterisk.

SENTENCE = re.compile(r"\$([A-Za-z]{2,10}),([^*$]*+)\*([0-9A-Fa-f]{2}|[0-9A-Fa-f]{4}|XX)\s*+")
_MEASURED = ",".join(f"{what}{axis}{unit}" for what, unit in (("mag", ""), ("acc", " [m/s2]"), ("gyro", " [rad/s]")) for axis in "XYZ")
#: what the makers' manuals state that a sentence holds behind its word; of several kinds in one log the first is taken
SENTENCES = {
    "VNIMU": f"{_MEASURED},temp [c],pressure",
    "VNMAR": _MEASURED,
    "VNQMR": f"q0,q1,q2,q3,{_MEASURED}",
    "VNYMR": f"yaw,pitch,roll,{_MEASURED}",
    "VNDTV": "dt,dthetaX,dthetaY,dthetaZ,dvX,dvY,dvZ",
}


class _Sentences(TextForm):
    torn = "its checksum is wrong"

    def __init__(self, word: str):
        self.name, self.header, self._word, self._begun = f"sentences ${word}", SENTENCES.get(word, ""), word, False

    @classmethod
    def found(cls, lines: list[str], name: str) -> _Sentences | None:
        """Where most lines are sentences, of a word that is known or of one alone."""
        words = [match[1] for line in lines if (match := SENTENCE.fullmatch(line.strip())) is not None]
        known = next((word for word in SENTENCES if words.count(word) > 1), words[0] if len(set(words)) == 1 else None)
        return None if len(words) <= SHARE * len(lines) or known is None else cls(known)

    def row(self, line: str) -> str:
        """What stands behind the word."""
        match, mine = SENTENCE.fullmatch(line.strip()), line.lstrip().startswith(f"${self._word},")
        if mine and match is not None and _sum_is_right(match):
            self._begun = True
            return match[2]
        return self._no_row(line, bool(line.strip()) and self._begun and (mine or not line.lstrip().startswith("$")))


def _sum_is_right(sentence: re.Match[str]) -> bool:
    """Whether the two digits are the exclusive or of all letters; other sums are taken as they are."""
    total = reduce(xor, f"{sentence[1]},{sentence[2]}".encode())
    return len(sentence[3]) != 2 or sentence[3] == "XX" or total == int(sentence[3], 16)


# JSON, an object a line: ``{"t": 1, "gyro": {"x": 0.1, …}}``.


class _JsonLines(_Record):
    name = "JSON, an object a line"

    @classmethod
    def found(cls, lines: list[str], name: str) -> _JsonLines | None:
        """Where most lines are objects that hold numbers."""
        objects = [list(found) for line in lines if (found := flattened(line))]
        if len(objects) <= SHARE * len(lines) or not objects:
            return None
        form = cls(objects)
        return form if form.is_one else None

    def row(self, line: str) -> str:
        """Of an object's numbers."""
        found = flattened(line)
        return self.completed(found) if found else self._no_row(line, line.strip().startswith(("{", "[{")))


def flattened(record: object) -> list[tuple[str, str, str]]:
    """Numbers of an object, or of a line that holds one: path, ``gyro.x``, ``gyro[0]``, number as it was written, and no unit; empty where
    it is none."""
    if isinstance(record, str):
        line = record.strip().removeprefix("[").removesuffix("]").rstrip(", ")
        if not line.startswith("{"):
            return []
        try:
            record = json.loads(line, parse_float=Number, parse_int=Number)
        except (ValueError, RecursionError):
            return []
    found: dict[str, str] = {}

    def walk(value: object, name: str, depth: int) -> None:
        if isinstance(value, Number) or (isinstance(value, str) and DIGITS.fullmatch(value)):
            found[name] = str(value)
        elif isinstance(value, str) and re.sub(r"[^a-z]", "", name.split(".")[-1].lower()) in SENSORS:
            found[name] = re.sub(r"[\s,]+", "_", value)[:40]  # which sensor it is of
        elif isinstance(value, dict) and depth:
            for key, inner in value.items():
                walk(inner, f"{name}.{key}".lstrip(".").replace(",", " "), depth - 1)
        elif isinstance(value, list) and depth:
            for place, inner in enumerate(value[:MOST_PAIRS]):
                walk(inner, f"{name}[{place}]", depth - 1)

    walk(record, "", 4)
    return [(name, value, "") for name, value in found.items()]


class Number(str):
    """A number of JSON as it was written: no digit of a stamp is lost."""

    __slots__ = ()


# Registers in hexadecimal: cells of their own, or one word a sample.

FOUR = re.compile(r"[0-9A-Fa-f]{4}")
PREFIXED = re.compile(r"(?<![\w.])0[xX]([0-9A-Fa-f]+)(?![\w.])")
BETWEEN = re.compile(r"([,;\s]+)")


class _Hexadecimal(TextForm):
    name = "registers in hexadecimal"

    def __init__(self, columns: frozenset[int] | None):
        """columns: those whose cells are hexadecimal; None: cells that begin with 0x."""
        self._columns = columns

    def row(self, line: str) -> str:
        """In decimals."""
        if self._columns is None:
            return PREFIXED.sub(lambda match: _decimal(match[1]), line)
        return "".join(self._cell(i, cell) for i, cell in enumerate(BETWEEN.split(line.strip())))

    def _cell(self, place: int, cell: str) -> str:
        """Cells have even places, what is between them odd ones."""
        return _decimal(cell) if self._columns and place % 2 == 0 and place // 2 in self._columns and FOUR.fullmatch(cell) else cell


def _decimal(digits: str) -> str:
    """Sixteen bits are a register with a sign, more are a stamp or a counter."""
    value = int(digits, 16)
    return str(value - 0x10000 if len(digits) == 4 and value >= 0x8000 else value)


def _hexadecimal(lines: list[str]) -> _Hexadecimal | None:
    if sum(len(PREFIXED.findall(line)) >= LEAST_PAIRS for line in lines) > SHARE * len(lines):
        return _Hexadecimal(None)
    rows = [BETWEEN.split(line.strip())[::2] for line in lines]
    rows = [row for row in rows if sum(FOUR.fullmatch(cell) is not None for cell in row) >= 2 * LEAST_PAIRS]
    if len(rows) <= SHARE * len(lines):
        return None
    width = min(map(len, rows))
    whole = [place for place in range(width) if all(FOUR.fullmatch(row[place]) for row in rows)]
    lettered = any(not row[place].isdigit() for row in rows for place in whole)
    # A stamp that happens to have four decimal digits is no register: no letter, no leading zero, and it rises.
    columns = frozenset(place for place in whole if not _is_stamp([row[place] for row in rows]))
    return _Hexadecimal(columns) if lettered and len(whole) >= 2 * LEAST_PAIRS else None


def _is_stamp(cells: list[str]) -> bool:
    return all(cell.isdigit() and cell[0] != "0" for cell in cells) and all(int(a) < int(b) for a, b in pairwise(cells))


#: what a sensor's burst of registers holds, and which byte of a register comes first
PRESETS = {
    "st": ("little", ("gx", "gy", "gz", "ax", "ay", "az")),
    "st-temp": ("little", ("temp", "gx", "gy", "gz", "ax", "ay", "az")),
    "mpu": ("big", ("ax", "ay", "az", "temp", "gx", "gy", "gz")),
    "icm42688": ("big", ("temp", "ax", "ay", "az", "gx", "gy", "gz")),
}
FIELDS = ("gx", "gy", "gz", "ax", "ay", "az", "temp", "-")
EXPECTED_PACKED = f"expected {', '.join(PRESETS)}, or the order by hand: little:gx,gy,gz,ax,ay,az or big:ax,ay,az,temp,gx,gy,gz (- skips)"
WORD = re.compile(r"(?<![\w.])(?:0x)?((?:[0-9A-Fa-f]{4}){6,16})(?![\w.])")


class _Packed(TextForm):
    name = "registers, packed in hexadecimal"

    def __init__(self, order: str, fields: tuple[str, ...], stamped: bool):
        self._order, self._fields, self._stamped, self._begun = order, fields, stamped, False
        self.header = ",".join((*(["time"] if stamped else []), *(field for field in fields if field != "-")))

    def row(self, line: str) -> str:
        """Of the word's registers."""
        match = WORD.search(line)
        if match is None or len(match[1]) != 4 * len(self._fields):
            return self._no_row(line, match is not None or (self._begun and bool(line.strip()) and not line.lstrip().startswith("#")))
        self._begun = True
        data = bytes.fromhex(match[1])
        values = [int.from_bytes(data[at : at + 2], self._order, signed=True) for at in range(0, len(data), 2)]  # type: ignore[arg-type]
        kept = [str(value) for value, field in zip(values, self._fields, strict=True) if field != "-"]
        return ",".join((*([re.split(r"[,;\s]", line.strip())[0]] if self._stamped else []), *kept))


def _packed(lines: list[str], stated: str | None, name: str) -> _Packed | None:
    # An unasked word stands alone or after a stamp: a column of hashes or IDs is no burst.
    bare = [line for line in lines if stated or len(re.split(r"[,;\s]+", line.strip())) <= 2]
    words = [match[1] for line in bare if (match := WORD.search(line)) is not None and not match[1].isdigit()]
    if len(words) <= SHARE * len(lines) or not words:
        if stated:
            raise FormatError(f"{name}: --packed is {stated!r}, but its lines hold no words of hexadecimal registers; leave it out")
        return None
    registers = len(words[0]) // 4
    if stated is None:
        what = f"{registers} registers a line, packed in hexadecimal, and it does not state their order"
        raise FormatError(f"{name}: {what}; give --packed, {EXPECTED_PACKED}")
    order, fields = _fields(stated)
    if len(fields) != registers:
        raise FormatError(f"{name}: {registers} registers a line, but --packed {stated} has {len(fields)}; {EXPECTED_PACKED}")
    stamped = sum(re.match(rf"\s*{NUMBER}[,;\s]", line) is not None for line in lines) > SHARE * len(lines)
    return _Packed(order, fields, stamped)


def _fields(stated: str) -> tuple[str, tuple[str, ...]]:
    if stated in PRESETS:
        return PRESETS[stated]
    order, colon, listed = stated.partition(":")
    fields = tuple(field.strip() for field in listed.split(","))
    known = order in ("little", "big") and colon and all(field in FIELDS for field in fields)
    if not known or any(fields.count(field) != 1 for field in FIELDS[:6]):
        raise FormatError(f"--packed is {stated[:60]!r}; {EXPECTED_PACKED}")
    return order, fields


#: of each form: what begins such a log
EXAMPLES = {
    _Pairs.name: "t:1000 ax:12 ay:-7 az:4096 gx:3 gy:0 gz:-2",
    _JsonLines.name: '{"t_ms": 1000, "gyro": [0.1, 0.2, 0.3], "accel": [0.0, 0.0, 9.8]}',
    "sentences": "$VNYMR,+100.000,-006.000,…,+00.000123*5A",
    _Hexadecimal.name: "1000,0x000C,0xFFF9,0x1000,0x0003,0x0000,0xFFFE",
    _Packed.name: "1000,0C00F9FF00100300000000FE   (--packed st)",
}
