"""Writing results."""

from __future__ import annotations

import json
from pathlib import Path


def write_whole(path: Path, table: dict) -> None:
    """JSON, whole or not at all: a full disk must not leave half a model."""
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(table, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    partial.replace(path)
