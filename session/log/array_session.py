"""Several units that were fixed to one rigid body and recorded at the same time: each a session of its own, on its own clock."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.common.texts import printable
from session.log.folder import Session


@dataclass(frozen=True, eq=False)
class ArraySession:
    """units: of each unit what a session folder of its own would hold, stamps as its own clock gave them; numbers: theirs, increasing.

    The array's body frame is that of ``units[0]``, and so is its clock.
    """

    folder: Path
    numbers: tuple[int, ...]
    units: tuple[Session, ...]

    def __len__(self) -> int:
        return len(self.units)

    @property
    def name(self) -> str:
        """The folder's last name, as it may stand in a line."""
        return printable(self.folder.resolve().name)
