"""The words in which the tables are written, and what they are in JSON Schema 2020-12.

A table is a dict: key -> shape; ``"key?"`` may be missing; ``"<file>"`` stands for any further key.  ``[shape]`` is a list of any length.
Keys that a table does not name are allowed, as every reader ignores them (docs/formats.md, versions).
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

from session.base.records import Record, record_of
from session.base.results import LARGEST, Array, Flag, Keys, ListOf, MapOf, Maybe, Number, Text
from session.base.results import Shape as Declared

#: a declared shape: an ``Of``, a table, or a list of one shape
Shape = Any


@dataclass(frozen=True)
class Of:
    """A shape that is JSON Schema already."""

    schema: dict[str, Any]


def schema_of(shape: Shape) -> dict[str, Any]:
    """A declared shape in JSON Schema."""
    if isinstance(shape, Of):
        return shape.schema
    if isinstance(shape, list):
        (entry,) = shape
        return {"type": "array", "items": schema_of(entry)}
    named = {key: inner for key, inner in shape.items() if not key.startswith("<")}
    rest = [inner for key, inner in shape.items() if key.startswith("<")]
    table: dict[str, Any] = {"type": "object", "properties": {key.removesuffix("?"): schema_of(inner) for key, inner in named.items()}}
    table["required"] = [key for key in named if not key.endswith("?")]
    if rest:
        table["additionalProperties"] = schema_of(rest[0] if len(rest) == 1 else either(*rest))
    return {key: value for key, value in table.items() if value not in ({}, [])}


def json_schema(shape: Declared) -> dict[str, Any]:
    """A shape in JSON Schema 2020-12; what it does not know may stand beside."""
    if isinstance(shape, Number):
        bounds = {"exclusiveMinimum" if shape.above else "minimum": shape.low, "maximum": shape.high}
        return {"type": "integer" if shape.whole else "number"} | {key: value for key, value in bounds.items() if abs(value) < LARGEST}
    if isinstance(shape, Array):
        schema: dict[str, Any] = json_schema(shape.entry)
        for count in reversed(shape.shape):
            schema = {"type": "array", "items": schema} | ({} if count is None else {"minItems": count, "maxItems": count})
        return schema
    if isinstance(shape, Maybe):
        return {"anyOf": [json_schema(shape.entry), {"type": "null"}]}
    if isinstance(shape, Text):
        return {"enum": list(shape.one_of)} if shape.one_of else {"type": "string"}
    if isinstance(shape, ListOf):
        return {"type": "array", "items": json_schema(shape.entry)}
    if isinstance(shape, MapOf):
        return {"type": "object", "additionalProperties": json_schema(shape.entry)}
    if isinstance(shape, Keys) and shape.known:
        written = [entry.name for entry in shape.entries if not entry.key.if_known] if isinstance(shape, Record) else shape.must
        schema = {"type": "object", "properties": {key: json_schema(inner) for key, inner in shape.known.items()}}
        return schema | {"required": list(dict.fromkeys([*shape.must, *written]))}
    return {"type": "boolean"} if isinstance(shape, Flag) else {"type": "object"} if isinstance(shape, Keys) else {}


def of(place: str) -> Of:
    """The record ``MODULE:NAME``."""
    module, name = place.split(":")
    return Of(json_schema(record_of(getattr(importlib.import_module(module), name))))


TEXT, FLAG, NULL = (Of({"type": name}) for name in ("string", "boolean", "null"))
NUMBER = Of({"type": "number"})
SIZE = Of({"type": "number", "minimum": 0})  #: such as a sigma or a duration
SHARE = Of({"type": "number", "minimum": 0, "maximum": 1})  #: such as a probability
WHOLE = Of({"type": "integer"})
COUNT = Of({"type": "integer", "minimum": 0})
HASH = Of({"type": "string", "pattern": "^[0-9a-f]{64}$"})


def words(*known: str) -> Of:
    """One of some words."""
    return Of({"enum": list(known)})


def array(entry: Shape, *counts: int | None) -> Of:
    """Lists in lists: so many at each depth, None for any number."""
    if not counts:
        return entry
    first, *rest = counts
    bounds = {} if first is None else {"minItems": first, "maxItems": first}
    return Of({"type": "array", "items": schema_of(array(entry, *rest)), **bounds})


def maybe(shape: Shape) -> Of:
    """Or null: what is not known."""
    return either(shape, NULL)


def either(*shapes: Shape) -> Of:
    """One of several shapes."""
    return Of({"anyOf": [schema_of(shape) for shape in shapes]})


def depth(entry: Shape, most: int) -> Of:
    """A value, or lists of it, up to so deep: what an effect's parameter may be."""
    return either(*(array(entry, *[None] * count) for count in range(most + 1)))


#: one measured value against its limits (docs/formats/fit.md)
CONFORMITY = {
    "quantity": TEXT,
    "name": TEXT,
    "unit": TEXT,
    "rule": words("simple acceptance", "guard band"),
    "answer": words("pass", "fail", "not decided"),
    "value": maybe(NUMBER),
    "standard_uncertainty": maybe(SIZE),
    "degrees_of_freedom": maybe(SIZE),
    "coverage_factor": maybe(SIZE),
    "expanded_uncertainty": maybe(SIZE),
    "lower": maybe(NUMBER),
    "upper": maybe(NUMBER),
    "guard_band": maybe(SIZE),
    "test_uncertainty_ratio": maybe(SIZE),
    "conformity_probability": maybe(SHARE),
    "risk": maybe(SHARE),
}

#: shapes that many tables use -> their names under ``$defs``
DEFINED: dict[str, Shape] = {}


def named(name: str, shape: Shape) -> Of:
    """A shape that a schema holds once, under ``$defs``."""
    DEFINED[name] = shape
    return Of({"$ref": f"#/$defs/{name}"})


def file_of(format_name: str) -> str:
    """``tinygc-fit-2.schema.json`` of ``tinygc-fit/2``."""
    return f"{format_name.replace('/', '-')}.schema.json"


def other(*format_names: str) -> Of:
    """A whole table of another format within this one."""
    return (
        either(*(Of({"$ref": file_of(name)}) for name in format_names)) if len(format_names) > 1 else Of({"$ref": file_of(format_names[0])})
    )


def by_kind(key: str, tables: dict[str, dict]) -> Of:
    """What a table must hold beside its common keys, by the word that stands under ``key``."""
    cases = [
        {
            "if": {"properties": {key: {"const": word}}, "required": [key]},
            "then": {k: v for k, v in schema_of(table).items() if k != "type"},
        }
        for word, table in tables.items()
    ]
    return Of({"allOf": [{"properties": {key: {"enum": list(tables)}}}, *cases]})


def when(key: str, there: dict, otherwise: dict) -> Of:
    """Two forms of one format: with a key, and without it."""
    return Of({"if": {"required": [key]}, "then": schema_of(there), "else": schema_of(otherwise)})


def both(table: dict, cases: Of) -> Of:
    """A table and its cases."""
    return Of({**schema_of(table), **cases.schema})


VECTOR, MATRIX = named("vector", array(NUMBER, 3)), named("matrix", array(NUMBER, 3, 3))
INTERVAL = array(NUMBER, 2)
#: a parameter by its JSON name: one number, one for each axis, a matrix, or one of these for each moment; the word is that of an axis skew
PARAMETER = named("parameter", either(depth(maybe(NUMBER), 3), words("readings")))
PARAMETERS = {"<parameter>": PARAMETER}
