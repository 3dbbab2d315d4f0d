"""What a result was made from: the hash of every file of a session, and the versions that made it."""

from __future__ import annotations

import hashlib
import platform
import subprocess
from importlib import metadata
from pathlib import Path

import tinygc
from session.errors import FormatError
from session.folder import Session

PACKAGES = ("numpy", "scipy", "torch")
ROOT = Path(__file__).resolve().parent.parent


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


def versions() -> dict[str, str]:
    """This project, its commit where it runs from a checkout, Python, and the packages that compute."""
    found = {"TinyGC": tinygc.__version__}
    if commit := _commit():
        found["commit"] = commit
    found["Python"] = platform.python_version()
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def _commit() -> str | None:
    """Of the checkout that this file lies in, with a word if it has been changed since; None where there is none."""
    if not (ROOT / ".git").exists() or not (ROOT / "calibrate.py").exists():
        return None
    try:
        said = subprocess.run(
            ["git", "-C", str(ROOT), "describe", "--always", "--dirty=, changed since", "--abbrev=12", "--exclude=*"],
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return said.stdout.strip() or None
