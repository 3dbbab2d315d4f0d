"""Options of a verification.  Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import Record, documented, option

SPREAD = "what may have changed without a fault"


@documented
@dataclass(frozen=True)
class VerifyOptions(Record):
    """What a person may set of a verification."""

    false_alarm: float = option(0.05, "probability of any false alarm, over all questions", above=0, most=0.999999, metavar="P")
    limit_deg: float = option(
        1.0, "that a minute of use may miss before a change matters", unit="deg", above=0, most=180, flags=("--limit",)
    )
    history: tuple[Path, ...] = option(
        (), "another fitted session of this unit; two or more show how it moves between sessions", repeated=True, group=SPREAD
    )
    lot: Path | None = option(None, "a production lot (lot.json) that shows it", group=SPREAD)
    switched_on: bool = option(
        True,
        "the sensor may have been switched off since the calibration",
        off="the sensor was not switched off since the calibration",
        flags=("--same-power-on",),
        group=SPREAD,
    )
    elapsed_s: float | None = option(
        None,
        "how long ago that was; a day where it is not given",
        unit="s",
        least=0,
        most=1e9,
        flags=("--elapsed",),
        group=SPREAD,
    )
    noise: Path | None = option(None, "noise figures of the unit (noise.json): its drift in that time", group=SPREAD)
    other_serial: bool = option(False, "go on with a recording of another serial number")
    earth: bool = option(True, "subtract the Earth's rotation from the rates", off="leave the Earth's rotation in the rates")
