"""What the last explanation of a session asked to be recorded next."""

from __future__ import annotations

import json
from pathlib import Path


def asked(folder: Path) -> str | None:
    """``next`` of DIR/explain/explain.json; None where nothing was explained, or nothing asked."""
    try:
        words = json.loads((folder / "explain" / "explain.json").read_text(encoding="utf-8")).get("next")
    except (OSError, ValueError, AttributeError):
        return None
    return words if isinstance(words, str) and words else None
