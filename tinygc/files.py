"""Writing results."""

from __future__ import annotations

import json
from pathlib import Path


def write_whole(path: Path, table: dict) -> None:
    """JSON, whole or not at all: a full disk must not leave half a model."""
    write_text_whole(path, json.dumps(table, indent=1, ensure_ascii=False) + "\n")


def write_text_whole(path: Path, text: str) -> None:
    """Text, whole or not at all."""
    partial = path.with_suffix(".partial")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
