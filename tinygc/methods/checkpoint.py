"""Where a training leaves what it can go on from: the record alone, which the options hold; what is in the file, ``minimise`` knows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

NAME = "checkpoint_{}.json"


@dataclass(frozen=True)
class Checkpoint:
    """path of the file; resume: whether to go on from it where it is there."""

    path: Path
    resume: bool = False
