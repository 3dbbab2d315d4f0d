"""Options of a budget: the use whose attitude error is asked for.  Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import Record, option

GROUP = "the use whose attitude error is asked for"
#: s: a use is at most a day
MOST_S = 86400


@dataclass(frozen=True)
class Use(Record):
    """How a calibration is used."""

    motion: Path | None = option(
        None,
        "rest, a session folder, or a log: the motion of the use (the session's own beginning)",
        metavar="rest|DIR|LOG",
        group=GROUP,
    )
    seconds: float = option(60.0, "how long", unit="s", above=0, most=MOST_S, group=GROUP)
    elapsed_s: float | None = option(
        None,
        "the use is so long after the session and the sensor was not switched off since; else it is another switch-on",
        unit="s",
        above=0,
        flags=("--elapsed",),
        group=GROUP,
    )
    warmer_k: float | None = option(
        None,
        "how much warmer the sensor is in use than in the session",
        unit="K",
        least=-200,
        most=200,
        flags=("--warmer",),
        group=GROUP,
    )
