"""What a result was made from: the hash of every file of a session."""

from __future__ import annotations

import hashlib
from pathlib import Path

from session.common.errors import FormatError
from session.log.folder import Session


def input_files(session: Session) -> list[Path]:
    """Every file of a session that a result depends on: session.toml, logs, closure runs, dial readings, truth."""
    dials = [session.folder / "attitudes.csv"] if session.attitudes is not None else []
    truths = [truth.path for truth in session.truths or ()]
    return [session.folder / "session.toml", *(log.path for log in (*session.logs, *session.closures)), *dials, *truths]


def input_hashes(session: Session) -> dict[str, str]:
    """SHA-256 of each of ``input_files``, by name; FormatError where one cannot be read any more."""
    return {path.name: sha256_of(path) for path in input_files(session)}


def sha256_of(path: Path) -> str:
    """Of a file's bytes as they lie on the disk (packed logs packed), in hexadecimal."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror or error})") from None
