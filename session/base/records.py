"""Files of ours, each declared once: a frozen record whose annotated fields declare what its file holds.

A field's annotation gives its shape: a type alone (``float``, ``str``, ``tuple[Row, ...]``), or ``Annotated`` with bounds, choices, the
shape of an array, its key and its unit in the file.  From it follow the check with its complaint (``read_record``), the record itself, what
is written (``table_of``), and the page and the JSON Schema (``docs/make_schemas.py``, which takes a field's sentence from the comment
``#:`` above it).  A field without a default is a key that must be there.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from session.base.results import (
    Array,
    Flag,
    Keys,
    ListOf,
    MapOf,
    Maybe,
    Mismatch,
    Number,
    Shape,
    Text,
    read_required,
    require,
    write_text_whole,
)
from session.base.texts import escaped_json

Size = Annotated[float, Number(0)]  #: such as a sigma or a duration
Share = Annotated[float, Number(0, 1)]  #: such as a probability
Count = Annotated[int, Number(0, whole=True)]
Vector = Annotated[np.ndarray, Array((3,))]
Matrix = Annotated[np.ndarray, Array((3, 3))]


#: of a rotation's rows from length 1 and a right angle: written to four digits
ROTATION_WITHIN = 1e-3


def _rotation_fault(matrix: np.ndarray) -> str:
    """A rotation within 0.001."""
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > ROTATION_WITHIN or np.linalg.det(matrix) < 0:
        return "is no rotation: its rows must be of length 1, at right angles, right-handed"
    return ""


def _orthogonal(matrix: np.ndarray) -> np.ndarray:
    """Exactly."""
    left, _, right = np.linalg.svd(matrix)
    return left @ right


ROTATION = Array((3, 3), Number(-10, 10), _rotation_fault, _orthogonal)

#: of a key that must be there
REQUIRED = object()


@dataclass(frozen=True)
class Key:
    """How a field stands in its file.

    name: of its key, the field's own without one; si: SI per unit of what is written there; absent: what holds where the key is missing,
    in place of the field's default; if_known: a value of None, or an empty table, is not written; in_file: whether it has a key at all.
    """

    name: str = ""
    si: float = 1.0
    absent: Any = REQUIRED
    if_known: bool = False
    in_file: bool = True


DERIVED = Key(in_file=False)
T = TypeVar("T")


@dataclass(frozen=True)
class Entry:
    """What is read or written of a record's attribute.  absent: what holds where the key is missing, or ``REQUIRED``; is_read: whether it
    is a field, and no property, which is written alone."""

    attribute: str
    key: Key
    shape: Shape
    absent: Any
    is_read: bool

    @property
    def name(self) -> str:
        """Of its key."""
        return self.key.name or self.attribute


@dataclass(frozen=True)
class Record(Keys):
    """The shape of a record's table.  A class may state with ``fault(table)`` what is wrong with a table of sound keys."""

    kind: type = object
    entries: tuple[Entry, ...] = ()

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        super().check(value, where)
        if wrong := getattr(self.kind, "fault", lambda table: "")(value):
            raise Mismatch(f"{where}.{wrong}" if where else wrong)

    def made(self, value: Any) -> Any:
        """The record of a table that was checked."""
        values = {}
        for entry in self.entries:
            if entry.is_read and entry.name in value:
                found = entry.shape.made(value[entry.name])
                values[entry.attribute] = found if found is None or entry.key.si == 1 else found * entry.key.si
            elif entry.key.absent is not REQUIRED:
                values[entry.attribute] = entry.key.absent
        return self.kind(**values)


def _record_of(kind: Any, null: bool = True) -> Record:
    """The shape of a record's table; null: whether what is not known is null in its file, which TOML has no word for.

    A class variable ``schema`` is the key of that name, and its first; one ``written`` names the attributes that are keys, properties, too.
    """
    hints, own = get_type_hints(kind, include_extras=True), {each.name: each for each in fields(kind)}
    entries = tuple(entry for name in getattr(kind, "written", own) if (entry := _entry(kind, name, own, hints, null)).key.in_file)
    must: dict[str, Shape] = {"schema": Text((kind.schema,))} if hasattr(kind, "schema") else {}
    must |= {entry.name: entry.shape for entry in entries if entry.absent is REQUIRED and entry.is_read}
    return Record(must, {entry.name: entry.shape for entry in entries if entry.name not in must}, kind, entries)


record_of: Callable[..., Record] = cache(_record_of)


def _entry(kind: Any, name: str, own: Mapping[str, Field], hints: Mapping[str, Any], null: bool) -> Entry:
    absent = REQUIRED
    if name in own:
        hint, default, made = hints[name], own[name].default, own[name].default_factory
        absent = made() if made is not MISSING else REQUIRED if default is MISSING else default
    else:
        found = getattr(kind, name)
        hint = get_type_hints(found.fget if isinstance(found, property) else found.func, include_extras=True)["return"]
    marks = hint.__metadata__ if get_origin(hint) is Annotated else ()
    key = next((mark for mark in marks if isinstance(mark, Key)), Key())
    shape = shape_of(hint, null) if key.in_file else Shape()
    return Entry(name, key, shape, absent if key.absent is REQUIRED else key.absent, name in own)


def shape_of(hint: Any, null: bool = True) -> Shape:
    """The shape that an annotation declares."""
    kind, inner = get_origin(hint) or hint, get_args(hint)
    if kind is Annotated:
        base, marks = inner[0], inner[1:]
        shape = next((mark for mark in marks if isinstance(mark, Shape)), None)
        if shape is None:
            return shape_of(base, null)
        return Maybe(shape) if null and NoneType in get_args(base) else shape
    if kind in (Union, UnionType):
        (base,) = (each for each in inner if each is not NoneType)
        return Maybe(shape_of(base, null)) if null else shape_of(base, null)
    if kind is Literal:
        return Text(inner)
    if isinstance(kind, type) and issubclass(kind, tuple | list):
        return ListOf(shape_of(inner[0], null))
    if kind in (dict, Mapping) or getattr(kind, "__name__", "") == "Mapping":
        return MapOf(shape_of(inner[1], null))
    if is_dataclass(kind):
        return record_of(kind, null)
    return {float: Number(), int: Number(whole=True), str: Text(), bool: Flag(), Path: Text()}[kind]


def read_record(kind: type[T], path: Path, do: str = "fit again, or correct the file") -> T:
    """The record that a JSON file holds.  FormatError states, in one line, which key of which file is wrong, and what to do."""
    shape = record_of(kind)
    return shape.made(read_required(path, shape, do))


def record_from(kind: type[T], table: Any, where: str, do: str = "fit again, or correct the file") -> T:
    """The same of a parsed table; where: its file's name."""
    shape = record_of(kind)
    require(table, shape, where, do)
    return shape.made(table)


def table_of(record: Any) -> dict[str, Any]:
    """What is written of a record: a table for JSON, in the units of its file, with its schema first."""
    whole = record_of(type(record))
    table = {"schema": record.schema} if "schema" in whole.must else {}
    for entry in whole.entries:
        value = getattr(record, entry.attribute)
        if entry.key.if_known and (value is None or value == {}):
            continue
        if value is not None and entry.key.si != 1:
            value = value / entry.key.si
        shape = entry.shape.entry if isinstance(entry.shape, Maybe) else entry.shape
        # A shape of a structure of its own has how it is written.
        table[entry.name] = plain(value) if value is None else getattr(shape, "written", plain)(value)
    return table


def stated(record: Any, always: tuple[str, ...] = (), but: tuple[str, ...] = ()) -> dict[str, Any]:
    """What TOML holds of a record: the keys that are not as without them, and those that are always there; never what is not known."""
    table = {}
    for entry in record_of(type(record), null=False).entries:
        value = getattr(record, entry.attribute)
        if value is not None and entry.name not in but and (entry.name in always or np.any(value != entry.absent)):
            table[entry.name] = _stated(value if entry.key.si == 1 else value / entry.key.si)
    return {name: value for name, value in table.items() if value is not None}


def _stated(value: Any) -> Any:
    if is_dataclass(value):
        return stated(value)
    if isinstance(value, Mapping):
        return {key: _stated(inner) for key, inner in value.items()}
    return [_stated(inner) for inner in value] if isinstance(value, tuple | list) else plain(value)


def in_unit(si: float, **values: Any) -> dict[str, Any]:
    """Entries in a unit of this size, of numbers or arrays in SI; None of what is not known."""
    return {name: None if value is None else value / si for name, value in values.items()}


def plain(value: Any) -> Any:
    """A value as JSON has it: records as tables, arrays and tuples as lists, paths as text, null for a number that is not finite."""
    if is_dataclass(value) and not isinstance(value, type):
        return table_of(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist() if value.dtype.kind not in "fO" or np.isfinite(value).all() else plain(value.tolist())
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [plain(inner) for inner in value]
    return str(value) if isinstance(value, Path) else value


def write_whole(path: Path, table: Any) -> None:
    """JSON, whole or not at all: a full disk must not leave half a model."""
    write_text_whole(path, json_text(table) + "\n")


def json_text(table: Any, ascii_only: bool = False) -> str:
    """JSON, its texts as ``escaped_json`` has them; null for a number that is not finite, which JSON has no word for: what is not known is
    null (docs/formats.md)."""
    return escaped_json(json.dumps(plain(table), indent=1, ensure_ascii=False, allow_nan=False), ascii_only)


def json_line(table: Any) -> str:
    """The same in one line of ASCII, without its end."""
    return json.dumps(plain(table), allow_nan=False)
