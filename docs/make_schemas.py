"""What follows from the records of our files: the tables of keys in the pages and the JSON Schemas.

``python docs/make_schemas.py`` writes the tables anew, each below its line ``<!-- keys of MODULE:RECORD -->`` (with
``in SECTION`` where they stand in one);
``python docs/make_schemas.py FOLDER`` writes a JSON Schema of each JSON into a folder, from the records and, as long as there are any, from
``docs/schema_tables``.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

from schema_tables.shapes import DEFINED, file_of, json_schema, schema_of  # noqa: E402

import tinygc  # noqa: E402, F401  # tells where the features are, which have keys as well
from session.base.records import REQUIRED, Entry, Record, record_of  # noqa: E402
from session.base.results import Array, Flag, Keys, ListOf, MapOf, Number, Shape  # noqa: E402

PAGES = (
    *("fit", "models", "explain", "lots", "simulation", "commands", "turns", "tables", "rates"),
    *("verify", "watch", "history", "budget"),
)
DIALECT = "https://json-schema.org/draft/2020-12/schema"

# Tables of keys.

HEAD = "| key | type, range | default | meaning |\n| --- | --- | --- | --- |\n"
MARK = re.compile(r"(<!-- keys of (\S+):(\w+)(?: in (\w+))? -->\n\n)(?:\|.*\n)*")


def pages() -> dict[Path, str]:
    """Each page that holds a table of keys -> its text with the tables as the records have them."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(DOCS.rglob("*.md"))}
    return {path: MARK.sub(lambda found: found[1] + _table(*found.groups()[1:]), text) for path, text in texts.items() if MARK.search(text)}


def _table(module: str, name: str, section: str | None) -> str:
    shape = record_of(getattr(importlib.import_module(module), name), null=False)
    return HEAD + "".join(_rows(shape, f"{section}." if section else ""))


def _rows(shape: Record, within: str) -> list[str]:
    said, rows = _sentences(shape.kind), []
    for entry in shape.entries:
        if isinstance(entry.shape, Record):
            rows += _rows(entry.shape, f"{within}{entry.name}.")
        elif within:  # what stands outside of a section has one of its own on the page
            rows.append(f"| `{within}{entry.name}` | {_range(entry.shape)} | {_default(entry)} | {said[entry.attribute]} |\n")
    return rows


def _sentences(kind: type) -> dict[str, str]:
    """Field -> what the comments ``#:`` above it say."""
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
    value = entry.absent
    if value is REQUIRED:
        return "required"
    if isinstance(value, np.ndarray):
        return "identity" if value.shape == (3, 3) and (value == np.eye(3)).all() else ", ".join(f"{each:g}" for each in value.ravel())
    if isinstance(value, str):
        return f'`"{value}"`'
    return "none" if value in (None, (), {}) else str(value)


# Schemas.


def schemas() -> dict[str, dict]:
    """File name -> each schema."""
    made = {}
    for name, kind in _records().items():
        made[file_of(name)] = {"$schema": DIALECT, "title": name} | json_schema(record_of(kind))
    for page in PAGES:
        for name, shape in importlib.import_module(f"schema_tables.{page}").TABLES.items():
            head = {"$schema": DIALECT, "title": name, "description": f"docs/formats/{page}.md"}
            known = {"type": "object", "properties": {"schema": {"const": name}}, "required": ["schema"]}
            whole = known | {"allOf": [schema_of(shape)]}
            made[file_of(name)] = head | whole | _definitions(whole)
    return made


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


def _definitions(schema: dict) -> dict[str, Any]:
    """``$defs`` of all names that a schema uses, and of those that these use."""
    used: dict[str, dict] = {}
    waiting = [schema]
    while waiting:
        for name in re.findall(r'"#/\$defs/(\w+)"', json.dumps(waiting.pop())):
            if name not in used:
                used[name] = schema_of(DEFINED[name])
                waiting.append(used[name])
    return {"$defs": dict(sorted(used.items()))} if used else {}


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
