"""Lists and tables in one cell of a fleet's table: JSON on one line, as the tool tells it to itself."""

from __future__ import annotations

import json
from typing import Any

from session.files.results import json_text


def cell_of(table: list | dict) -> str:
    """JSON as ``session.files.results`` writes it, on one line, its keys in order."""
    return json.dumps(json.loads(json_text(table)), separators=(",", ":"), ensure_ascii=False, sort_keys=True)


def told_by(cell: str) -> Any:
    """What it holds.  ValueError for what is no JSON: another program has written it."""
    try:
        return json.loads(cell)
    except RecursionError:
        raise ValueError("nested too deeply") from None
