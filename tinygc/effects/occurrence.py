"""When it happened: of an effect that is found in the registers or in the stills, which of its JSON parameters tells the moments."""

from __future__ import annotations

from dataclasses import dataclass

#: rows of all logs together, seconds of the session, numbers of stills, or the readings that stand at a level
ROWS, SECONDS, STILLS, LEVEL = "rows", "seconds", "stills", "level"


@dataclass(frozen=True)
class Occurrence:
    """key of the parameter, and what it counts."""

    key: str
    counts: str
