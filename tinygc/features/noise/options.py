"""Options of noise at rest other than its logs.  Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import Record, option
from tinygc.cli.options import LONGEST_S

CURVE = "an Allan curve that is there already"


@dataclass(frozen=True)
class NoiseOptions(Record):
    """Of the sensor, and of a curve."""

    sensor: str = option("", "what the sensor is, such as MPU-9250", read=str)
    serial: str = option("", "which one it is", metavar="TEXT", read=str)
    curve: Path | None = option(None, "columns of tau in s and deviations: 1 or 3 of each sensor", group=CURVE)
    curve_units: str | None = option(None, "of its deviations, where its header has none: m/s2,deg/s", metavar="LIST", group=CURVE)
    duration_s: float | None = option(
        None, "how long the recording was that it is from", unit="s", least=0, most=LONGEST_S, flags=("--duration",), group=CURVE
    )
    odr_hz: float | None = option(None, "its data rate", unit="Hz", least=0.1, most=50_000, flags=("--odr",), group=CURVE)
