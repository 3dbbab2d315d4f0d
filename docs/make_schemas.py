"""JSON Schema of every JSON that the tool writes, from ``docs/schema_tables``: ``python docs/make_schemas.py``."""

from __future__ import annotations

import importlib
import json
import re
import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS))

from schema_tables.shapes import DEFINED, file_of, schema_of  # noqa: E402

FOLDER = DOCS / "formats" / "schemas"
PAGES = (
    *("fit", "models", "explain", "lots", "simulation", "commands", "turns", "noise", "tables", "rates"),
    *("verify", "watch", "history", "budget"),
)
WIDTH = 120
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schemas() -> dict[str, str]:
    """File name -> text of each schema."""
    made = {}
    for page in PAGES:
        for name, shape in importlib.import_module(f"schema_tables.{page}").TABLES.items():
            head = {"$schema": DIALECT, "title": name, "description": f"docs/formats/{page}.md"}
            known = {"type": "object", "properties": {"schema": {"const": name}}, "required": ["schema"]}
            whole = known | {"allOf": [schema_of(shape)]}
            made[file_of(name)] = _text(head | whole | _definitions(whole)) + "\n"
    return made


def _definitions(schema: dict) -> dict:
    """``$defs`` of all names that a schema uses, and of those that these use."""
    used: dict[str, dict] = {}
    waiting = [schema]
    while waiting:
        for name in re.findall(r'"#/\$defs/(\w+)"', json.dumps(waiting.pop())):
            if name not in used:
                used[name] = schema_of(DEFINED[name])
                waiting.append(used[name])
    return {"$defs": dict(sorted(used.items()))} if used else {}


def _text(value: Any, before: int = 0) -> str:
    """JSON of which a line holds what fits on it."""
    line = json.dumps(value, ensure_ascii=False)
    if before + len(line) <= WIDTH or not isinstance(value, dict | list) or not value:
        return line
    pad = " " * (before + 1)
    if isinstance(value, dict):
        lines = [f"{pad}{json.dumps(key)}: {_text(inner, before + 1)}" for key, inner in value.items()]
        return "{\n" + ",\n".join(lines) + "\n" + pad[1:] + "}"
    return "[\n" + ",\n".join(pad + _text(inner, before + 1) for inner in value) + "\n" + pad[1:] + "]"


def main() -> None:
    """Write what is new, and remove what is gone."""
    FOLDER.mkdir(exist_ok=True)
    made = schemas()
    for path in FOLDER.glob("*.json"):
        if path.name not in made:
            path.unlink()
    for name, text in made.items():
        (FOLDER / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
