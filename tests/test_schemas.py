"""docs/formats/schemas: a JSON Schema of every JSON that the tool writes, from declared tables, as strict as these, and true of its files.

What the commands write is held against the schemas wherever it is held against the pages: ``strangers`` of ``formats_page.py`` does both.
"""

import importlib.util
from collections.abc import Iterator
from typing import Any

import pytest
from conftest import ROOT, broad
from formats_page import PAGE, SCHEMA, keys_on_page, validators
from jsonschema import Draft202012Validator

from tinygc.models.files import ANNEX_KINDS, KINDS

#: what is no JSON
OTHERS = {f"tinygc-{name}/1" for name in ("session", "frame", "defaults", "limits", "table", "make", "requirements")}
FORMATS = sorted(set(SCHEMA.findall(PAGE)) - OTHERS)
LONG = ("tinygc-explain/2", "tinygc-fit/2", "tinygc-lot/3", "tinygc-model/1")
each_format = pytest.mark.parametrize("name", FORMATS)


def test_the_schemas_are_what_the_tables_give():
    spec = importlib.util.spec_from_file_location("make_schemas", ROOT / "docs" / "make_schemas.py")
    maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(maker)
    there = {path.name: path.read_text(encoding="utf-8") for path in maker.FOLDER.glob("*")}
    assert there == maker.schemas(), "python docs/make_schemas.py"


def test_every_json_format_has_a_schema():
    assert set(validators()) == set(FORMATS)
    for validator in validators().values():
        Draft202012Validator.check_schema(validator.schema)


# A schema as data


class Walk:
    """Through a schema: its own definitions are followed, other formats are not."""

    def __init__(self, name: str):
        self.schema = validators()[name].schema

    def followed(self, part: dict) -> dict:
        while part.get("$ref", "").startswith("#/$defs/"):
            part = self.schema["$defs"][part["$ref"].removeprefix("#/$defs/")]
        return part

    def paths(self, part: dict, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
        """Of every value that is no table, lists left out; ``<>`` for any key."""
        part = self.followed(part)
        inner = [each for each in (*part.get("anyOf", ()), *part.get("allOf", ())) if each != {"type": "null"}]
        inner += [part[key] for key in ("then", "else", "items") if key in part]
        for each in inner:
            yield from self.paths(each, path)
        for key, value in part.get("properties", {}).items():
            yield from self.paths(value, (*path, key))
        if "additionalProperties" in part:
            yield from self.paths(part["additionalProperties"], (*path, "<>"))
        if not inner and not {"properties", "additionalProperties"} & set(part):
            yield path

    def requires(self, part: dict, path: tuple) -> bool:
        """Whether any form of the format requires the key at the end of a path."""
        part = self.followed(part)
        inner = [*part.get("anyOf", ()), *part.get("allOf", ()), *(part[key] for key in ("then", "else") if key in part)]
        if any(self.requires(each, path) for each in inner):
            return True
        first, *rest = path
        if not rest:
            return first in part.get("required", ())
        below = part.get("items") if isinstance(first, int) else part.get("properties", {}).get(first, part.get("additionalProperties"))
        return below is not None and self.requires(below, tuple(rest))

    def example(self, part: dict, kind: str | None = None, branch: int = 0) -> Any:
        """What a schema allows, with all that may be there; branch: 1 for the second form of a format that has two;
        kind: of a model."""
        part = self.followed(part)
        if "$ref" in part:
            name = part["$ref"].removesuffix(".schema.json")
            return Walk("/".join(name.rsplit("-", 1))).whole()
        if "const" in part or "enum" in part:
            return part["const"] if "const" in part else part["enum"][0]
        if "anyOf" in part:
            return self.example(part["anyOf"][0])
        if "pattern" in part:
            return "0" * 64
        if part.get("type") in SIMPLE:
            return SIMPLE[part["type"]]
        if part.get("type") == "array":
            return [self.example(part["items"]) for _ in range(part.get("minItems", 1))]
        table = {key: self.example(value) for key, value in part.get("properties", {}).items()}
        if "additionalProperties" in part:
            table["x"] = self.example(part["additionalProperties"])
        for each in part.get("allOf", ()):
            if "else" in each:
                table |= self.example(each[("then", "else")[branch]])
            elif "if" not in each:
                table |= self.example(each, kind)
            elif each["if"]["properties"]["kind"]["const"] == kind:
                table |= self.example(each["then"])
        return table | ({"kind": kind} if kind and "kind" in table else {})

    def whole(self, kind: str | None = None, branch: int = 0) -> dict:
        return self.example(self.schema, "linear" if self.schema["title"] == "tinygc-model/1" and kind is None else kind, branch)


SIMPLE = {"string": "text", "number": 0.5, "integer": 1, "boolean": True, "null": None}


def alternatives(name: str) -> list[dict]:
    """An example of each form of a format."""
    walk = Walk(name)
    if name == "tinygc-model/1":
        (kinds,) = (each["properties"]["kind"]["enum"] for each in walk.schema["allOf"][0]["allOf"] if "if" not in each)
        return [walk.whole(kind) for kind in kinds]
    return [walk.whole(branch=branch) for branch in range(2 if "else" in walk.schema["allOf"][0] else 1)]


def places(value: Any, path: tuple = ()) -> Iterator[tuple]:
    """Paths of everything within a table, but not within whole tables of other formats."""
    if path:
        yield path
    if isinstance(value, dict) and not (path and "schema" in value):
        for key, inner in value.items():
            yield from places(inner, (*path, key))
    elif isinstance(value, list) and value:
        yield from places(value[0], (*path, 0))


def at(table: Any, path: tuple) -> Any:
    for key in path:
        table = table[key]
    return table


def test_a_schema_of_models_has_the_kinds_of_the_code():
    kinds = {*KINDS, *ANNEX_KINDS}
    assert {model["kind"] for model in alternatives("tinygc-model/1")} == kinds
    assert {
        kind for kind in kinds if not validators()["tinygc-apply/1"].is_valid(alternatives("tinygc-apply/1")[1] | {"kind": kind})
    } == set()


@each_format
def test_a_schema_has_the_keys_of_its_page(name):
    """A page may name a table as a whole, and say which other page has its keys."""
    page = {tuple("<>" if word.startswith("<") else word.removesuffix("[]") for word in path) for path in keys_on_page(name)}
    schema = set(Walk(name).paths(Walk(name).schema))
    assert {path for path in schema if not any(path[: len(known)] == known for known in page)} == set()
    assert {known for known in page if not any(path[: len(known)] == known for path in schema)} == set()


@pytest.mark.parametrize("name", [broad(name) if name in LONG else name for name in FORMATS])
def test_a_missing_key_and_a_wrong_type_are_refused(name):
    """In an example of each form of the format, made from its schema with all that may be there."""
    validator, walk = validators()[name], Walk(name)
    for example in alternatives(name):
        assert [error.message for error in validator.iter_errors(example)] == []
        for path in list(places(example)):
            here, key = at(example, path[:-1]), path[-1]
            right = here[key]
            here[key] = "wrong" if isinstance(right, dict | list) else {"wrong": ["wrong"]}
            assert not validator.is_valid(example), f"{path} of another type"
            if isinstance(key, str):
                del here[key]
                assert validator.is_valid(example) != walk.requires(walk.schema, path), f"{path} is missing"
            here[key] = right


# Files and commands
