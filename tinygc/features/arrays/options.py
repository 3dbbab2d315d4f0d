"""Options of a simulated array, in addition to those of each unit's session."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite

from session.base.errors import CalibrationError
from tinygc.features.arrays.model import MOST_UNITS
from tinygc.simulation.options import choice

#: limits beyond any board, reader and hand motion
LARGEST = {
    "mounting_deg": 30.0,
    "position_mm": 1000.0,
    "clock_offset_ms": 10_000.0,
    "clock_rate": 0.05,
    "jerk_deg": 10.0,
    "knock_deg": 10.0,
    "false_reading_dps": 2000.0,
    "reference_error_mg": 100.0,
}


@dataclass(frozen=True)
class ArrayOptions:
    """Several units on one body.  Extrinsics and clocks are drawn with the sizes given here (1 sigma), from the session's seed."""

    units: int = choice(1, "on one rigid body, each with errors, place, clock and noise of its own; 2 or more make an array")
    mounting_deg: float = choice(2.0, "deg about each axis, from the first unit's axes to another's")
    position_mm: float = choice(20.0, "mm along each axis, from the first unit to another")
    clock_offset_ms: float = choice(20.0, "ms, another unit's clock against the first one's")
    clock_rate: float = choice(0.002, "fraction, another unit's clock against the first one's")
    synchronous: bool = choice(False, "one reader takes all units at one moment, by one clock")
    jerk_deg: float = choice(0.0, "deg, jerks quicker than half the data rate, three a turn, felt by all; 0: none")
    knock_deg: float = choice(0.0, "deg, of one knock in the middle turn, felt by all; 0: none")
    false_reading_dps: float = choice(0.0, "dps, of three readings in a row of the last unit in the second turn; 0: none")
    reference_error_mg: float = choice(0.0, "mg, a level acceleration in each still, felt by all; 0: none")

    def __post_init__(self) -> None:
        for option in fields(self):
            value, most = getattr(self, option.name), LARGEST.get(option.name)
            if most is not None and not (isfinite(value) and 0 <= value <= most):
                raise CalibrationError(f"--{option.name.replace('_', '-')} is {value!r}, expected 0 to {most:g}")
        if not 1 <= self.units <= MOST_UNITS:
            raise CalibrationError(f"--units is {self.units}, expected 1 to {MOST_UNITS}")
