"""What the last explanation of a session asked to be recorded next."""

from __future__ import annotations

from pathlib import Path

from session.common.errors import FormatError, printable
from session.files.shapes import Keys, MapOf, Maybe, Text, read_required
from session.log.hashes import sha256_of

SHAPE = Keys({"schema": Text(("tinygc-explain/1",))}, {"next": Maybe(Text()), "logs": MapOf(Text())})


def requested_by_explain(folder: Path) -> str | None:
    """``next`` of DIR/explain/explain.json; None where nothing was explained, nothing asked, or the logs are not those any more.

    FormatError for an explanation that cannot be read.
    """
    path = folder / "explain" / "explain.json"
    if not path.exists():
        return None
    explained = read_required(path, SHAPE, "explain again, or remove it")
    # Logs that were recorded since do not answer it before they are explained, too.
    same = all(_sha256(folder, name) == sha256 for name, sha256 in explained.get("logs", {}).items())
    return printable(explained.get("next") or "") or None if same else None


def _sha256(folder: Path, name: str) -> str | None:
    """Of a file of this folder; None where there is none, or where the name leads elsewhere."""
    try:
        return sha256_of(folder / name) if Path(name).name == name else None
    except (FormatError, ValueError):  # a name that no file can have
        return None
