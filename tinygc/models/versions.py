"""The versions that made a result."""

from __future__ import annotations

import platform
import subprocess
from importlib import metadata
from pathlib import Path

from session import VERSION

PACKAGES = ("numpy", "scipy")
ROOT = Path(__file__).resolve().parents[2]


def versions() -> dict[str, str]:
    """Return the versions of this project, its commit if it runs from a checkout, Python, and the numerical packages."""
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
    """Return the commit of the checkout that contains this file, marked if it has changed since; None without a checkout."""
    if not (ROOT / ".git").exists() or not (ROOT / "calibrate.py").exists():
        return None
    try:
        words = subprocess.run(
            ["git", "-C", str(ROOT), "describe", "--always", "--dirty=, changed since", "--abbrev=12", "--exclude=*"],
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return words.stdout.strip() or None
