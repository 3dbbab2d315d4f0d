"""What the last explanation of a session asked to be recorded next."""

from __future__ import annotations

from pathlib import Path

from session.common.errors import FormatError, printable
from session.files.results import read_json
from session.log.hashes import sha256_of


def requested_by_explain(folder: Path) -> str | None:
    """``next`` of DIR/explain/explain.json; None where nothing was explained, nothing asked, or the logs are not those any more."""
    try:
        explained = read_json(folder / "explain" / "explain.json")
        words, logs = explained.get("next"), explained.get("logs", {}).items()
    except (FormatError, AttributeError):
        return None
    if not isinstance(words, str) or not words:
        return None
    # Logs that were recorded since do not answer it before they are explained, too.
    return printable(words) if all(_sha256(folder, str(name)) == sha256 for name, sha256 in logs) else None


def _sha256(folder: Path, name: str) -> str | None:
    """Of a file of this folder; None where there is none, or where the name leads elsewhere."""
    try:
        return sha256_of(folder / name) if Path(name).name == name else None
    except (FormatError, ValueError):  # a name that no file can have
        return None
