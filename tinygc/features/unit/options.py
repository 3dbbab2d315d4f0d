"""Options of the commands and functions on one unit: verify, watch, history, budget, certificate.  Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from session.base.options import Record, documented, file_written, option
from tinygc.cli.arguments import OWN_PLACE, duration
from tinygc.cli.options import Stream
from tinygc.estimation.options import Earth

# Whether a calibration holds: verify and watch.

SPREAD = "what may have changed without a fault"


@documented
@dataclass(frozen=True)
class VerifyOptions(Earth):
    """What a person may set of a verification."""

    false_alarm: float = option(0.05, "probability of any false alarm, over all questions", above=0, most=0.999999, metavar="P", rare=True)
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
        rare=True,
    )
    noise: Path | None = option(None, "noise figures of the unit (noise.json): its drift in that time", group=SPREAD)
    other_serial: bool = option(False, "go on with a recording of another serial number", rare=True)


@dataclass(frozen=True)
class WatchOptions(Record):
    """What a watch goes by."""

    false_alarm_every_s: float = option(
        30 * 86400.0,
        "mean time at rest to a false alarm, s, or as 30d, 12h, 90min",
        metavar="TIME",
        read=duration,
        above=0,
        flags=("--false-alarm-every",),
        rare=True,
    )
    noise: Path | None = option(None, "noise.json of this unit, or its folder (next to the model)", metavar="PATH")
    session: Path | None = option(None, "where session.toml is: place, full scales, accelerometer", metavar="DIR")


@dataclass(frozen=True)
class SourceOptions(Stream):
    """How a source is read."""

    follow: bool = option(False, "read a log on while it grows, until Ctrl-C")


# One unit over its sessions: history.


def _day(text: str) -> datetime:
    found = datetime.fromisoformat(text)
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found


_day.__name__ = "date"


@dataclass(frozen=True)
class HistoryOptions(Record):
    """Which units, limits and day a history is for."""

    serial: str = option("", "only this unit, where there are several", metavar="TEXT", read=str, rare=True)
    accuracy: str = option("", "until when the attitude error at rest stays within this: 1deg/60s", metavar="DEG/S", read=str)
    require: tuple[str, ...] = option(
        (),
        "until when these numbers stay within a limit of the last calibration: 'bias 50 mdps'; may be repeated",
        metavar="LIMIT",
        read=str,
        repeated=True,
    )
    today: Any = option(None, "the day to answer for (today)", metavar="DATE", read=_day, rare=True)


# What its numbers are worth: budget and certificate.

USE = "the use whose attitude error is stated"
#: s: a use is at most a day
MOST_S = 86400


@dataclass(frozen=True)
class BudgetOptions(Record):
    """How a calibration is used, and which budgets are printed."""

    motion: Path | None = option(
        None,
        "rest, a session folder, or a log: the motion of the use (the session's own beginning)",
        metavar="rest|DIR|LOG",
        group=USE,
    )
    seconds: float = option(60.0, "how long", unit="s", above=0, most=MOST_S, group=USE)
    elapsed_s: float | None = option(
        None,
        "use so long after the session, not switched off since",
        unit="s",
        above=0,
        flags=("--elapsed",),
        group=USE,
    )
    warmer_k: float | None = option(
        None,
        "how much warmer the sensor is in use than in the session",
        unit="K",
        least=-200,
        most=200,
        flags=("--warmer",),
        group=USE,
        rare=True,
    )
    of: tuple[str, ...] = option(
        (),
        "print all sources of a quantity: bias_x, E_xy, attitude_total; may be repeated",
        metavar="NAME",
        read=str,
        repeated=True,
    )


@dataclass(frozen=True)
class CertificateOptions(Record):
    """Options of ``report``."""

    certificate: Path | None = option(
        None,
        "write the certificate as well, the form that a laboratory signs (certificate.html in the session folder)",
        read=file_written,
        alone=OWN_PLACE,
    )
    dcc: Path | None = option(None, "write the certificate as a Digital Calibration Certificate, XML", read=file_written, rare=True)
    as_found: Path | None = option(None, "the model in use until now: the certificate states its errors as found", rare=True)
