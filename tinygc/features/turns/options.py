"""Options that a gyroscope alone adds to commands of the core."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import Record, option


@dataclass(frozen=True)
class ImportOptions(Record):
    """Options of ``import``."""

    turns: Path | None = option(None, "of a gyroscope alone: turns.csv, the known angles of its turns")
