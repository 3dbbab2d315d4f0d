"""What the last explanation of a session asked to be recorded next."""

from __future__ import annotations

from pathlib import Path

from session.errors import FormatError
from tinygc.files import read_json


def asked(folder: Path) -> str | None:
    """``next`` of DIR/explain/explain.json; None where nothing was explained, or nothing asked."""
    try:
        words = read_json(folder / "explain" / "explain.json").get("next")
    except (FormatError, AttributeError):
        return None
    return words if isinstance(words, str) and words else None
