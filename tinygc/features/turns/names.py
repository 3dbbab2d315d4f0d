"""Whether a folder is of a gyroscope alone, whose turns are known: by the reference in its session.toml."""

from __future__ import annotations

from pathlib import Path

from session.base.errors import FormatError
from session.base.toml import read_toml

#: ``protocol.reference`` of a gyroscope alone
TURNS = "turns"


def is_gyroscope_alone(folder: Path) -> bool:
    """Whether that is the reference of a folder; what cannot be read is none."""
    try:
        protocol = read_toml(folder / "session.toml").get("protocol") if (folder / "session.toml").exists() else None
    except (FormatError, OSError):  # who reads the folder says it
        return False
    return isinstance(protocol, dict) and protocol.get("reference") == TURNS
