"""The versions that made a result."""

from __future__ import annotations

import platform
import subprocess
from importlib import metadata
from pathlib import Path

from session.common.version import VERSION

PACKAGES = ("numpy", "scipy", "torch")
ROOT = Path(__file__).resolve().parents[2]


def versions() -> dict[str, str]:
    """Of this project, its commit where it runs from a checkout, Python, and the packages that compute."""
    found = {"TinyGC": VERSION}
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
