"""What follows from the records of our files: the tables of keys in the pages and the JSON Schemas.

``python docs/make_schemas.py`` writes the lists, each below its line ``<!-- keys of MODULE:RECORD -->`` (with
``in SECTION`` where they stand in one);
``python docs/make_schemas.py FOLDER`` writes a JSON Schema of each JSON into a folder, from the records and, of what is written only, from
the tables of the pages, which give each key's type (docs/formats.md, types).
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import re
import sys
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))

import tinygc  # noqa: E402, F401  # finds the features, which have keys as well
from session.base.records import REQUIRED, Entry, Record, record_of  # noqa: E402
from session.base.results import LARGEST, Array, Flag, Keys, ListOf, MapOf, Maybe, Number, Shape, Text  # noqa: E402

DIALECT = "https://json-schema.org/draft/2020-12/schema"

# Lists of keys.

MARK = re.compile(r"(<!-- keys of (\S+):(\w+)(?: in (\w+))? -->\n\n)(?:[-|] ?.*\n)*")


def pages() -> dict[Path, str]:
    """Each page that holds a list of keys -> its text with the lists as the records have them."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(DOCS.rglob("*.md"))}
    return {path: MARK.sub(lambda found: found[1] + _table(*found.groups()[1:]), text) for path, text in texts.items() if MARK.search(text)}


def _table(module: str, name: str, section: str | None) -> str:
    shape = record_of(getattr(importlib.import_module(module), name), null=False)
    return "".join(_rows(shape, f"{section}." if section else ""))


def _rows(shape: Record, within: str) -> list[str]:
    meanings, rows, above = _sentences(shape.kind), [], ""
    for entry in shape.entries:
        if isinstance(entry.shape, Record):
            rows += _rows(entry.shape, f"{within}{entry.name}.")
        elif within:  # what stands outside of a section has one of its own on the page
            kind = _range(entry.shape)
            shown = "likewise" if kind == above and " " in kind else kind
            rows.append(f"- `{within}{entry.name}` ({shown}{_default(entry)}): {meanings[entry.attribute]}\n")
            above = kind
    return rows


def _sentences(kind: type) -> dict[str, str]:
    """Field -> the comments ``#:`` above it."""
    found = re.finditer(r"((?:    #: .*\n)+)    (\w+):", inspect.getsource(kind))
    return {each[2]: " ".join(line.strip().removeprefix("#: ") for line in each[1].splitlines()) for each in found}


def _range(shape: Shape) -> str:
    if isinstance(shape, Number):
        low, high = (f"{value:.9f}".rstrip("0").rstrip(".").replace("-", "−") for value in (shape.low, shape.high))
        return f"above {low}, to {high}" if shape.above else f"{low} to {high}"
    if isinstance(shape, Array):
        sound = "" if shape.sound is None else ", " + (shape.sound.__doc__ or "").rstrip(".").lower()
        return f"{'×'.join(map(str, shape.shape))} numbers, each {_range(shape.entry)}{sound}"
    if isinstance(shape, Flag):
        return "`true`, `false`"
    if getattr(shape, "one_of", ()):
        return ", ".join(f'`"{word}"`' for word in shape.one_of)
    return {ListOf: "list of tables", MapOf: "table", Keys: "table"}.get(type(shape), shape.expected)


def _default(entry: Entry) -> str:
    """Nothing where a key that is missing stands for nothing."""
    value = entry.absent
    if value is REQUIRED:
        return ", required"
    if isinstance(value, np.ndarray):
        identity = value.shape == (3, 3) and (value == np.eye(3)).all()
        return f", default {'identity' if identity else ' '.join(f'{each:g}' for each in value.ravel())}"
    return "" if value in (None, (), {}, "") else f', default `"{value}"`' if isinstance(value, str) else f", default {value}"


# Schemas.


def _deep(entry: dict, most: int = 3) -> dict:
    return {"anyOf": [entry, {"type": "array", "items": _deep(entry, most - 1)}]} if most else entry


#: words of the pages (docs/formats.md, types) -> JSON Schema
TYPES: dict[str, dict] = {
    "text": {"type": "string"},
    "flag": {"type": "boolean"},
    "number": {"type": "number"},
    "size": {"type": "number", "minimum": 0},
    "share": {"type": "number", "minimum": 0, "maximum": 1},
    "whole": {"type": "integer"},
    "count": {"type": "integer", "minimum": 0},
    "hash": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
    "null": {"type": "null"},
    "table": {"type": "object"},
    "numbers": _deep({"type": "number"}),
    # the word is that of an axis skew
    "parameter": {"anyOf": [_deep({"type": ["number", "null"]}), {"const": "readings"}]},
    "any": {},
}


def schemas() -> dict[str, dict]:
    """File name -> each schema."""
    made = {name: json_schema(record_of(kind)) for name, kind in _records().items()}
    made |= {name: _table_of(keys | {("schema",): f'"{name}"'}) for name, keys in typed_keys().items()}
    return {file_of(name): {"$schema": DIALECT, "title": name} | schema for name, schema in made.items()}


def typed_keys() -> dict[str, dict[tuple[str, ...], str]]:
    """Format -> the type of each key that a page gives, those of other formats' tables included."""
    found = [each for page in sorted(DOCS.rglob("*.md")) for each in TYPED.findall(page.read_text(encoding="utf-8"))]
    keys = {name: dict(each for row in rows.splitlines() for each in _typed_keys(row)) for name, rows in found}
    for own in keys.values():
        for path, text in list(own.items()):
            if of := OF_ANOTHER.fullmatch(text):
                del own[path]
                own |= _within(keys[of[1]], of[2].split("."), path, of[3] or "")
    return keys


def _within(keys: dict[tuple[str, ...], str], root: list[str], path: tuple[str, ...], mark: str) -> dict[tuple[str, ...], str]:
    """The keys at and below ``root``, at ``path`` instead; mark: of the root, in the place of its own."""
    count = len(root)
    inner = {key: text for key, text in keys.items() if [part.removesuffix("[]") for part in key[:count]] == root}
    listed = any(key[count - 1].endswith("[]") for key in inner)
    moved = {(*path[:-1], path[-1] + "[]" * listed, *key[count:]): text for key, text in inner.items() if len(key) > count}
    return {path: MARKED.fullmatch(inner.get(tuple(root), "list" if listed else "table"))[1] + mark} | moved  # type: ignore[index]


def file_of(name: str) -> str:
    """``tinygc-fit-2.schema.json`` of ``tinygc-fit/2``."""
    return f"{name.replace('/', '-')}.schema.json"


#: a section whose list gives types, in brackets behind the keys: the format's name, and the rows
TYPED = re.compile(r"^## `(tinygc-\S+)`\n(?:(?!#|- ).*\n)*((?:- `[^(\n]*` \(.*\n)+)", re.M)
ROW = re.compile(r"- (`[^(]*`) \((.*?)\)(?:: .*)?")
#: what parts types, but not within quotes
UNQUOTED = r'(?=(?:[^"]*"[^"]*")*[^"]*$)'
SHAPED = re.compile(r"(list|[\dn×]+)\[(.*)\]")
#: the same as a key of another format: its name, the key, and a mark
OF_ANOTHER = re.compile(r"(tinygc-[\w-]+/\d+)#([\w.]+)(\?| (?:with|unless) `\w+`)?")
MARKED = re.compile(r"(.*?)(?:(\?)| (with|unless) `(\w+)`)?")


def expanded(path: str) -> list[str]:
    """``a.{b,c}`` as ``a.b``, ``a.c``."""
    pieces = re.split(r"\{([^{}]*)\}", path)
    return ["".join(choice) for choice in product(*(piece.split(",") if i % 2 else [piece] for i, piece in enumerate(pieces)))]


def _typed_keys(row: str) -> list[tuple[tuple[str, ...], str]]:
    """(path, type) of each key of a row."""
    key, text = ROW.fullmatch(row).groups()
    words, found = [expanded(word) for word in re.findall(r"`([^`]+)`", key)], []
    groups = re.split("; " + UNQUOTED, text)
    for paths, group in zip(words, groups * len(words) if len(groups) == 1 else groups, strict=True):
        types = [each for text in re.split(", " + UNQUOTED, group) for each in _repeated(text)]
        found += zip((tuple(path.split(".")) for path in paths), types * (len(paths) // len(types)), strict=True)
    return found


def _repeated(text: str) -> list[str]:
    """``size×3`` as three types."""
    each, star, count = text.rpartition("×")
    return [each] * int(count) if star and count.isdigit() else [text]


def _table_of(keys: dict[tuple[str, ...], str]) -> dict[str, Any]:
    """JSON Schema of a table by the types of its keys and of those within; one of ``<any name>`` is every further key."""
    table: dict[str, Any] = {"type": "object", "properties": {}, "required": []}
    only: dict[str, dict[str, list[str]]] = {"with": {}, "unless": {}}
    for name in dict.fromkeys(path[0].removesuffix("[]") for path in keys):
        within = {path[1:]: text for path, text in keys.items() if len(path) > 1 and path[0].removesuffix("[]") == name}
        text, absent, mark, other = MARKED.fullmatch(keys.get((name,), "table")).groups()
        schema = _table_of(within) if within else _type(text)
        if any(path[0] == f"{name}[]" for path in keys):
            schema = {"type": "array", "items": schema}
        if within and text.endswith("/null"):
            schema = {"anyOf": [schema, TYPES["null"]]}
        if name.startswith("<"):
            table["additionalProperties"] = schema
            continue
        table["properties"][name] = schema
        if mark:
            only[mark].setdefault(other, []).append(name)
        elif not absent:
            table["required"].append(name)
    either = [{"anyOf": [{"required": [word]}, {"required": names}]} for word, names in only["unless"].items()]
    return table | {"dependentRequired": only["with"]} | ({"allOf": either} if either else {})


def _type(text: str) -> dict[str, Any]:
    either = re.split(" or " + UNQUOTED, text)
    if len(either) > 1 or (text.endswith("]/null") and (either := [text.removesuffix("/null"), "null"])):
        return {"anyOf": [_type(each) for each in either]}
    if listed := SHAPED.fullmatch(text):
        schema = _type(listed[2])
        for count in reversed(listed[1].split("×")):
            schema = {"type": "array", "items": schema} | ({"minItems": int(count), "maxItems": int(count)} if count.isdigit() else {})
        return schema
    if text.startswith("tinygc-"):
        return {"$ref": file_of(text)}
    words = re.split("/" + UNQUOTED, text)
    if words[0] in TYPES:
        return TYPES[text] if len(words) == 1 else {"anyOf": [TYPES[word] for word in words]}
    return {"enum": [json.loads(word) for word in words]}


def json_schema(shape: Shape) -> dict[str, Any]:
    """A shape in JSON Schema 2020-12; further keys are allowed."""
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


def _records() -> dict[str, type]:
    """Format -> the record of its JSON: of those that stand on one another the last, which is what is written."""
    found: dict[str, type] = {}
    for path in sorted(path for package in ("session", "tinygc") for path in (DOCS.parent / package).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "base.records import" in text and not re.search(r"\b(read_toml|toml_of)\(", text):
            module = importlib.import_module(".".join(path.relative_to(DOCS.parent).with_suffix("").parts))
            own = [kind for kind in vars(module).values() if isinstance(kind, type) and kind.__module__ == module.__name__]
            for kind in own:
                if isinstance(name := getattr(kind, "schema", None), str) and issubclass(kind, found.get(name, object)):
                    found[name] = kind
    return found


def main() -> None:
    """Write the tables, or the schemas into the folder that is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, help="of the schemas; without it the tables of the pages are written")
    folder: Path | None = parser.parse_args().folder
    if folder is None:
        for path, text in pages().items():
            path.write_text(text, encoding="utf-8")
        return
    folder.mkdir(exist_ok=True)
    for name, schema in schemas().items():
        (folder / name).write_text(json.dumps(schema, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
