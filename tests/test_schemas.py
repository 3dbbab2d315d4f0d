"""docs/make_schemas.py: a JSON Schema of every JSON that the tool writes, with the keys of its page, and strict.

What the commands write is held against the schemas wherever it is held against the pages: ``strangers`` of ``formats_page.py`` does both.
"""

import json

import pytest
from conftest import ROOT
from feature import feature
from formats_page import PAGE, SCHEMA, keys_on_page, maker, strangers, validators
from jsonschema import Draft202012Validator

#: what is no JSON
OTHERS = {f"tinygc-{name}/1" for name in ("session", "frame", "defaults", "limits", "table", "make", "requirements")}
FORMATS = sorted(set(SCHEMA.findall(PAGE)) - OTHERS)


def test_each_schema_is_one():
    for validator in validators().values():
        validator.check_schema(validator.schema)


def test_every_json_format_has_a_schema():
    assert set(FORMATS) - set(validators()) == set(), "no code has these sections of docs/formats/*.md"
    assert set(validators()) <= set(FORMATS)


@pytest.mark.parametrize(
    ("text", "sound", "wrong"),
    [
        ("text", ["a"], [None, 1]),
        ("size/null", [0, 1.5, None], [-1]),
        ("2[share/null]", [[0, None]], [[0], [0, 2], None]),
        ("n×3[number]", [[], [[1, 2, 3]]], [[[1, 2]]]),
        ('"x, y"/"x or y"/1', ["x, y", "x or y", 1], ["x", 2]),
        ('list["x"/"y"]/null', [[], ["y"], None], [["z"]]),
        ("numbers", [1, [[[1]]]], [[[[[1]]]], ["1"]]),
        ("parameter", [None, [1, None], "readings"], ["else"]),
    ],
)
def test_a_type_of_the_pages(text, sound, wrong):
    typed = Draft202012Validator(maker()._type(text))
    assert all(typed.is_valid(value) for value in sound)
    assert not any(typed.is_valid(value) for value in wrong)


def test_the_types_of_a_row_are_those_of_its_keys_in_order():
    rows = [
        '- `{a,b}.{c,d}`, `e` (text, count; "x; y")',
        "- `f[].<id>`, `g`, `g.h`, `i`, `j` (size; table/null; flag?; text unless `g`; text with `k`): (so)",
        "- `l.{m,n,o}` (share×2, flag): so",
    ]
    keys = dict(each for row in rows for each in maker()._typed_keys(row))
    typed = Draft202012Validator(maker()._table_of(keys))
    table = {"a": {"c": "", "d": 1}, "b": {"c": "", "d": 1}, "e": "x; y", "f": [{"any": 1}], "g": {}, "l": {"m": 0, "n": 1, "o": True}}
    for sound in ({}, {"g": None}, {"k": 1, "j": ""}, {"g": {"h": True}}, {"unknown": 1}):
        assert typed.is_valid(table | sound)
    for wrong in (
        {"a": {"c": ""}},
        {"e": "x"},
        {"f": [{"any": -1}]},
        {"g": {"h": None}},
        {"k": 1},
        {"b": None},
        {"l": {"m": 0, "n": True, "o": 1}},
    ):
        assert not typed.is_valid(table | wrong)
    assert not typed.is_valid({key: value for key, value in table.items() if key != "g"})


def paths(part, path=()):
    """Of every value that is no table, lists left out, ``<>`` for any key."""
    inner = [each for each in part.get("anyOf", ()) if each != {"type": "null"}]
    for each in [*inner, *([part["items"]] if "items" in part else [])]:
        yield from paths(each, path)
    for key, value in part.get("properties", {}).items():
        yield from paths(value, (*path, key))
    if "additionalProperties" in part:
        yield from paths(part["additionalProperties"], (*path, "<>"))
    if not inner and not {"items", "properties", "additionalProperties"} & set(part):
        yield path


def test_every_record_has_the_keys_of_its_page():
    """A page may name a table as a whole, and say which other page has its keys; a schema may leave a table open."""
    for name in maker()._records():
        page = {tuple("<>" if word.startswith("<") else word.removesuffix("[]") for word in path) for path in keys_on_page(name)}
        schema = set(paths(validators()[name].schema))
        assert {path for path in schema if not any(_of_one(path, known) for known in page)} == set(), name
        if name != "tinygc-noise/1" or feature("tinygc.features.noise"):  # without it the core reads some of the keys
            assert {known for known in page if not any(_of_one(path, known) for path in schema)} == set(), name


def _of_one(path, known):
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
