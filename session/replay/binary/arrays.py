"""Arrays of any name: which is the gyroscope, the accelerometer, the temperature, the time.

What is clear by names, shapes and units is taken.  What is not is listed with its shape, and ``--columns`` names it: whole arrays,
``t_s=time,gyro_dps=imu_gyr,accel_mps2=imu_acc``, or single columns, ``t_s=t,gx_rps=wx,gy_rps=wy,gz_rps=wz``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.base.budget import current
from session.base.errors import FormatError
from session.base.units import NS_PER_S, TIME
from session.replay.binary.source import Format, Part, Stream, Topic, one_line, require_names
from session.replay.columns import parse_columns
from session.replay.named import Meaning, meaning

#: keys of ``--columns`` here: arrays next to the single columns of a text log
KEY = re.compile(r"(t|gyro|accel|g[xyz]|a[xyz]|temp)(?:_(\S+))?")
EXPECTED = "expected t_s=NAME,gyro_dps=NAME,accel_mps2=NAME of arrays (N, 3), or t_s=NAME,gx_dps=NAME,…,az_g=NAME of columns"
#: names of a rate in Hz next to the arrays
RATES = ("sampling_rate", "sample_rate", "samplingrate", "samplerate", "fs", "odr", "odr_hz", "rate_hz", "sampling_frequency")
#: stamps that are converted at once
AT_ONCE = 1 << 16
#: arrays that a complaint lists
MOST_LISTED = 12


@dataclass(frozen=True)
class Array:
    """One array or column of a file: name with its groups, shape, NumPy's type, unit as an attribute states it."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype
    unit: str = ""

    @property
    def rows(self) -> int:
        """Samples, if it holds some."""
        return max(self.shape) if self.is_triad or self.is_column else 0

    @property
    def is_triad(self) -> bool:
        """Whether it has three rows or three columns."""
        return len(self.shape) == 2 and 3 in self.shape and max(self.shape) > 3

    @property
    def is_column(self) -> bool:
        """Whether it is one column, or one row."""
        return len(self.shape) == 1 or (len(self.shape) == 2 and 1 in self.shape and max(self.shape) > 1)


@dataclass(frozen=True)
class Plan:
    """A stream before it is read: its name, the arrays of each quantity (one of three columns, or three), units, signs; t_unit."""

    name: str
    parts: Mapping[str, tuple[Array, ...]]
    units: Mapping[str, str]
    signs: Mapping[str, tuple[int, ...]]
    t: Array | None
    t_unit: str
    notes: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        """Samples."""
        return next(iter(self.parts.values()))[0].rows

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All that it reads."""
        return (*([self.t] if self.t else []), *(array for part in self.parts.values() for array in part))

    @property
    def columns(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(array.name for array in self.arrays)


@dataclass(frozen=True)
class Opened:
    """An open file: its arrays; values: of the names that are wanted, what reads an array by its name; rate_hz where it states one; notes;
    words: the file, where more is known of it than its format."""

    arrays: Sequence[Array]
    values: Callable[[set[str]], Callable[[str], np.ndarray]]
    rate_hz: float | None = None
    notes: Sequence[str] = ()
    words: str = ""


@dataclass(frozen=True)
class Tables(Format):
    """A format of arrays of any name, of which only those are read that are requested."""

    opened: Callable[[Path], AbstractContextManager[Opened]]

    def topics(self, path: Path, columns: str | None) -> list[Topic]:
        """The streams that the arrays make.  FormatError as ``plans``."""
        with one_line(path, self.what), self.opened(path) as file:
            made = plans(path, file.words or self.what, file.arrays, columns)
        return [Topic(plan.name, plan.rows, tuple(plan.parts), plan.columns) for plan in made]

    def read(self, path: Path, names: Sequence[str], columns: str | None) -> list[Stream]:
        """The streams of these names, all of them for no name.  FormatError as ``plans``."""
        with one_line(path, self.what), self.opened(path) as file:
            made = plans(path, file.words or self.what, file.arrays, columns)
            there = {plan.name: plan for plan in made}
            require_names(path, names, there)
            chosen = [there[name] for name in names] or made
            current().numbers(path, sum(math.prod(array.shape) for plan in chosen for array in plan.arrays))
            values = file.values({name for plan in chosen for name in plan.columns})
            with np.errstate(all="ignore"):  # whatever a damaged file holds as numbers
                return [_stream(path, plan, values, file.rate_hz, file.notes) for plan in chosen]


def plans(path: Path, what: str, arrays: Sequence[Array], columns: str | None) -> list[Plan]:
    """What the arrays mean.  FormatError lists them where that is not clear; what: the file in words, ``an HDF5 file``."""
    arrays = [array for array in arrays if array.dtype.kind in "iufM" and array.rows]
    made = [_stated(path, arrays, columns)] if columns is not None else _clear(path, what, arrays)
    if not made:
        raise FormatError(
            f"{path}: {what} in which no gyroscope and no accelerometer is clear by name; {_listed(arrays)}; --columns names it, {EXPECTED}"
        )
    return made


def _listed(arrays: Iterable[Array]) -> str:
    """Names and shapes, for a complaint."""
    all_of_them = [f"{array.name} ({', '.join(map(str, array.shape))})" for array in arrays]
    more = f" and {len(all_of_them) - MOST_LISTED} more" if len(all_of_them) > MOST_LISTED else ""
    return f"it holds {', '.join(all_of_them[:MOST_LISTED])}{more}" if all_of_them else "it holds no arrays of numbers"


# By names.


def _clear(path: Path, what: str, arrays: Sequence[Array]) -> list[Plan]:
    """The streams that names and shapes make clear."""
    meanings = [(array, found) for array in arrays if (found := meaning(array.name, array.unit)) is not None]
    groups: dict[tuple[str, str], list[tuple[Array, Meaning]]] = {}
    for array, found in meanings:
        if found.kind in ("gyro", "accel") and array.is_triad:
            of = found.of if found.axis is None else f"{found.of}.{found.axis}".strip(".")  # gyro0: the first of several
            groups.setdefault((found.kind, of), []).append((array, found))
        elif found.kind in ("gyro", "accel") and found.axis is not None:
            groups.setdefault((found.kind, found.of), []).append((array, found))
    whole: dict[tuple[str, str], tuple[tuple[Array, ...], str]] = {}
    for key, members in groups.items():
        triads = [(array, found) for array, found in members if array.is_triad]
        singles = sorted((member for member in members if not member[0].is_triad), key=lambda member: member[1].axis or 0)
        if len(triads) > 1:
            named = " and ".join(array.name for array, _ in triads)
            raise FormatError(f"{path}: {what} in which {named} may both be the {key[0]}; state which, --columns {EXPECTED}")
        if triads:
            whole[key] = (triads[0][0],), triads[0][1].unit
        elif [found.axis for _, found in singles] == [0, 1, 2] and len({array.rows for array, _ in singles}) == 1:
            units = {found.unit for _, found in singles}
            if len(units) > 1:
                raise FormatError(
                    f"{path}: {singles[0][0].name} and the other axes are in different units ({', '.join(sorted(units))}); expected one"
                )
            whole[key] = tuple(array for array, _ in singles), units.pop()
    # A gyroscope and an accelerometer of one group and one length are one stream; others are streams of their own
    made, used = [], set()
    for (kind, of), (arrays, unit) in whole.items():
        if (kind, of) in used:
            continue
        other = ("accel" if kind == "gyro" else "gyro", of)
        partner = whole.get(other)
        parts, in_units = {kind: arrays}, {kind: unit}
        if partner is not None and partner[0][0].rows == arrays[0].rows:
            parts[other[0]], in_units[other[0]] = partner
            used.add(other)
        rows = arrays[0].rows
        temps = [
            (array, found)
            for array, found in meanings
            if found.kind == "temp" and array.is_column and array.rows == rows and found.of == of
        ]
        if len(temps) == 1:
            parts["temp"], in_units["temp"] = (temps[0][0],), temps[0][1].unit
        t, t_unit, note = _time(path, what, rows, of, meanings)
        parts = {key: parts[key] for key in ("gyro", "accel", "temp") if key in parts}
        name = of or ("imu" if len(parts) - ("temp" in parts) > 1 else kind)
        made.append(Plan(name, parts, in_units, {key: (1, 1, 1) for key in parts}, t, t_unit, (note,) if note else ()))
    names = [plan.name for plan in made]
    # Of two streams of one name each is called by its array
    return [
        plan
        if names.count(plan.name) == 1
        else Plan(next(iter(plan.parts.values()))[0].name, plan.parts, plan.units, plan.signs, plan.t, plan.t_unit, plan.notes)
        for plan in made
    ]


def _time(path: Path, what: str, rows: int, of: str, meanings: Sequence[tuple[Array, Meaning]]) -> tuple[Array | None, str, str]:
    """The stamps of a stream of this length and group: those of its group, else those of the whole file."""
    there = [(array, found) for array, found in meanings if found.kind == "time" and array.is_column and array.rows == rows]
    near = [entry for entry in there if entry[1].of == of] or [entry for entry in there if not entry[1].of] or there
    stated = [entry for entry in near if entry[1].unit or entry[0].dtype.kind == "M"]
    if not near:
        return None, "", ""
    if len(near) > 1 and len(stated) != 1:
        named = " and ".join(array.name for array, _ in near)
        raise FormatError(f"{path}: {what} in which {named} may both be the time; state which, --columns {EXPECTED}")
    array, found = (stated or near)[0]
    if array.dtype.kind != "M" and not found.unit:
        raise FormatError(
            f"{path}: {what} that does not state the unit of its time {array.name!r}; state it, --columns t_s={array.name},…; {EXPECTED}"
        )
    return (
        array,
        "ns" if array.dtype.kind == "M" else found.unit,
        f"of several times {array.name} is taken, which states its unit" if len(near) > 1 else "",
    )


# By ``--columns``.


def _stated(path: Path, arrays: Sequence[Array], text: str) -> Plan:
    """The stream that a person has named."""
    wanted = parse_columns(text, KEY, EXPECTED)
    there = {array.name: array for array in arrays}

    def array_of(name: str) -> Array:
        if name in there:
            return there[name]
        if name.isdigit() and 1 <= int(name) <= len(arrays):
            return arrays[int(name) - 1]
        raise FormatError(f"{path}: no array {name!r} (--columns); {_listed(arrays)}")

    parts: dict[str, tuple[Array, ...]] = {}
    units: dict[str, str] = {}
    signs: dict[str, tuple[int, ...]] = {}
    for kind, letter in (("gyro", "g"), ("accel", "a")):
        axes = [wanted[key] for key in (f"{letter}x", f"{letter}y", f"{letter}z") if key in wanted]
        if kind in wanted and axes:
            raise FormatError(f"--columns: {kind} is given whole and by its axes; {EXPECTED}")
        if kind in wanted:
            axes = [wanted[kind]]
        if not axes:
            continue
        if len(axes) == 2 or (len(axes) == 1 and kind not in wanted) or len({unit for _, unit, _ in axes}) > 1:
            raise FormatError(f"--columns: {kind} needs x, y and z in one unit; {EXPECTED}")
        found = tuple(array_of(name) for name, _, _ in axes)
        if any(not (array.is_triad if kind in wanted else array.is_column) for array in found):
            raise FormatError(
                f"{path}: --columns: {found[0].name} has the shape {found[0].shape}, {kind} needs {'(N, 3)' if kind in wanted else '(N,)'}"
            )
        parts[kind], units[kind] = found, axes[0][1]
        signs[kind] = tuple(sign for _, _, sign in axes) if len(axes) == 3 else (axes[0][2],) * 3
    if not parts:
        raise FormatError(f"--columns: neither a gyroscope nor an accelerometer; {EXPECTED}")
    if "temp" in wanted:
        parts["temp"], units["temp"], signs["temp"] = (array_of(wanted["temp"][0]),), wanted["temp"][1], (wanted["temp"][2],)
    t, t_unit = None, ""
    if "t" in wanted:
        t, t_unit = array_of(wanted["t"][0]), wanted["t"][1]
        if t.dtype.kind != "M" and t_unit not in TIME:
            raise FormatError(f"--columns: t needs a unit, such as t_s={t.name}; {EXPECTED}")
    lengths = {array.rows for array in (*([t] if t else []), *(array for part in parts.values() for array in part))}
    if len(lengths) > 1:
        raise FormatError(f"{path}: the arrays of --columns have {' and '.join(map(str, sorted(lengths)))} rows; expected one length")
    return Plan("columns", parts, units, signs, t, t_unit)


# Reading.


def _stream(path: Path, plan: Plan, values: Callable[[str], np.ndarray], rate_hz: float | None, remarks: Sequence[str]) -> Stream:
    notes = [*remarks, *plan.notes]
    read: dict[str, Part] = {}
    for kind, arrays in plan.parts.items():
        names, made = tuple(array.name for array in arrays), np.empty(plan.rows if kind == "temp" else (plan.rows, 3))
        if len(arrays) == 3 or kind == "temp":
            for place, array in enumerate(arrays):
                made.reshape(plan.rows, -1)[:, place] = _column(path, array, values(array.name))
        else:
            names, whole = tuple(f"{names[0]}[{axis}]" for axis in range(3)), np.asarray(values(names[0]))
            if whole.shape != arrays[0].shape:
                raise FormatError(
                    f"{path}: {arrays[0].name} has the shape {whole.shape}, and its head states {arrays[0].shape}; copy it again"
                )
            if whole.shape[1] != 3:
                whole = whole.T
                notes.append(f"{arrays[0].name} has a row for each axis")
            made[:] = whole
            del whole
        made *= np.array(plan.signs[kind][: 1 if kind == "temp" else 3], float)
        read[kind] = Part(made, plan.units.get(kind, ""), names)
    t_ns = None if plan.t is None else _nanoseconds(path, plan.t, np.asarray(values(plan.t.name)).ravel(), plan.t_unit)
    stamps = "" if plan.t is None else plan.t.name
    return Stream(plan.name, t_ns, read, rate_hz, notes=tuple(notes), columns=plan.columns, stamps=stamps)


def _column(path: Path, array: Array, values: np.ndarray) -> np.ndarray:
    """(N,) as they are."""
    flat = np.asarray(values).ravel()
    if len(flat) != array.rows:
        raise FormatError(f"{path}: {array.name} has {len(flat)} values, and its head states {array.rows}; copy it again")
    return flat


def _nanoseconds(path: Path, array: Array, values: np.ndarray, unit: str) -> np.ndarray:
    """(N,) int64; whole numbers stay exact."""
    if values.dtype.kind == "M":
        return values.astype("M8[ns]").astype(np.int64)
    per = TIME[unit]
    limit = 2**63 / per
    t_ns = np.empty(len(values), np.int64)
    for start in range(0, len(values), AT_ONCE):
        some, part = values[start : start + AT_ONCE], slice(start, start + AT_ONCE)
        if not (np.isfinite(some).all() and (abs(some.astype(float)) < limit).all()):
            raise FormatError(f"{path}: {array.name} holds stamps that are no time in {unit}; is its unit right?")
        if some.dtype.kind in "iu":
            t_ns[part] = some.astype(np.int64) * per
        else:
            whole = np.floor(some.astype(float))
            # Whole units and their fraction by themselves: seconds of an epoch keep what the file has of them.
            t_ns[part] = whole.astype(np.int64) * per + np.rint((some.astype(float) - whole) * per).astype(np.int64)
    return t_ns


def is_rate(name: str) -> bool:
    """Whether what is called so is a rate in Hz."""
    return name.rpartition("/")[2].rpartition(".")[2].lower() in RATES


def rate_of(named: Mapping[str, object]) -> float | None:
    """A rate in Hz among scalars and attributes of a file; None where there is none, or it is none."""
    for name, value in named.items():
        if is_rate(name):
            try:
                number = float(np.asarray(value).ravel()[0])
            except (ValueError, TypeError, IndexError):
                continue
            if np.isfinite(number) and 0 < number < NS_PER_S:
                return number
    return None
