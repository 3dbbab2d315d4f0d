"""docs/make_schemas.py: a JSON Schema of every JSON that the tool writes, with the keys of its page, and strict.

What the commands write is held against the schemas wherever it is held against the pages: ``strangers`` of ``formats_page.py`` does both.
"""

import json
from collections.abc import Iterator

import pytest
from conftest import ROOT
from formats_page import PAGE, SCHEMA, keys_on_page, strangers, validators

#: what is no JSON
OTHERS = {f"tinygc-{name}/1" for name in ("session", "frame", "defaults", "limits", "table", "make", "requirements")}
FORMATS = sorted(set(SCHEMA.findall(PAGE)) - OTHERS)


def test_each_schema_is_one():
    for validator in validators().values():
        validator.check_schema(validator.schema)


def test_every_json_format_has_a_schema():
    assert set(validators()) == set(FORMATS)


def paths(schema: dict, part: dict, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Of every value that is no table, lists left out, ``<>`` for any key: own definitions are followed, other formats are not."""
    while part.get("$ref", "").startswith("#/$defs/"):
        part = schema["$defs"][part["$ref"].removeprefix("#/$defs/")]
    inner = [each for each in (*part.get("anyOf", ()), *part.get("allOf", ())) if each != {"type": "null"}]
    for each in [*inner, *(part[key] for key in ("then", "else", "items") if key in part)]:
        yield from paths(schema, each, path)
    for key, value in part.get("properties", {}).items():
        yield from paths(schema, value, (*path, key))
    if "additionalProperties" in part:
        yield from paths(schema, part["additionalProperties"], (*path, "<>"))
    if not inner and not {"then", "else", "items", "properties", "additionalProperties"} & set(part):
        yield path


@pytest.mark.parametrize("name", FORMATS)
def test_a_schema_has_the_keys_of_its_page(name):
    """A page may name a table as a whole, and say which other page has its keys; a schema may leave a table open."""
    page = {tuple("<>" if word.startswith("<") else word.removesuffix("[]") for word in path) for path in keys_on_page(name)}
    schema = set(paths(validators()[name].schema, validators()[name].schema))
    assert {path for path in schema if not any(_of_one(path, known) for known in page)} == set()
    assert {known for known in page if not any(_of_one(path, known) for path in schema)} == set()


def _of_one(path: tuple[str, ...], known: tuple[str, ...]) -> bool:
    return all(one == other for one, other in zip(path, known, strict=False))


def test_a_missing_key_and_a_wrong_type_are_refused():
    """Of the truth of the checkout, which is older than two of the options: a key that is added keeps the number."""
    text = (ROOT / "data" / "session1" / "truth.json").read_text(encoding="utf-8")
    assert strangers(json.loads(text)) == []
    for key in set(json.loads(text)) - {"schema"}:
        assert strangers(json.loads(text) | {key: {"wrong": ["wrong"]}}), key
    table = json.loads(text)
    table["E"][1][1] = "1"
    assert any(complaint.startswith("$") for complaint in strangers(table))
    assert strangers({"schema": "tinygc-plan/2"}) == ["$: 'requested' is a required property"]
