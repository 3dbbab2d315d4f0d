"""What the columns of a text stream are: a sensor's registers, or numbers in physical units, as its header says (docs/formats.md)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from session.common.plausible import BEYOND
from session.common.units import DEG, G

COLUMNS = ("t_us", "gx", "gy", "gz", "ax", "ay", "az", "temp")
HEADER = ",".join(COLUMNS)
#: us per unit of a time column
TIME_US = {"t_us": 1.0, "t_s": 1e6, "t_ns": 1e-3}
#: of a step that is doubted beside damage (``steps``), one sample period long: 0.8 % of ±2000 dps, 1.6 % of ±16 g, degC
BARS = {"dps": 16.0, "rps": 16.0 * DEG, "g": 0.25, "mps2": 0.25 * G, "c": 0.25}
#: SI per unit
SI = {"dps": DEG, "rps": 1.0, "g": G, "mps2": 1.0, "c": 1.0}
#: the same of registers, LSB: gyro 0.8 % of full scale, accelerometer 1.6 %, temperature 0.25 degC of an ASM330LHH
REGISTER_BARS = np.array([256, 256, 256, 512, 512, 512, 64], np.int64)


@dataclass(frozen=True)
class Form:
    """names of the log's columns as the header has them: time, rates, forces, and the temperature where there is one."""

    names: tuple[str, ...] = COLUMNS

    @property
    def physical(self) -> bool:
        """Whether the numbers are in physical units, and not registers."""
        return self.names != COLUMNS

    @property
    def units(self) -> tuple[str, str]:
        """Of rates and forces, as the names end: ``dps`` or ``rps``, ``g`` or ``mps2``; empty of registers."""
        return self.names[1].partition("_")[2], self.names[4].partition("_")[2]

    @property
    def has_temperature(self) -> bool:
        """Whether the last column is one."""
        return len(self.names) == len(COLUMNS)

    @property
    def time_us(self) -> float:
        """us per unit of the time column."""
        return TIME_US[self.names[0]]

    @property
    def log_header(self) -> str:
        """Of the log that is made of it, whose time is in us."""
        return ",".join(("t_us", *self.names[1:]))

    @property
    def bars(self) -> np.ndarray:
        """(6 or 7,) of each column's steps."""
        if not self.physical:
            return REGISTER_BARS
        gyro, accel = self.units
        return np.array([BARS[gyro]] * 3 + [BARS[accel]] * 3 + [BARS["c"]] * self.has_temperature)

    @cached_property
    def limits(self) -> tuple[float, ...]:
        """Of each column but the time, in physical units: what no sensor measures is beyond it, and what holds it is no line."""
        gyro, accel = self.units
        kinds = [("gyro", gyro)] * 3 + [("accel", accel)] * 3 + [("temp", "c")] * self.has_temperature
        return tuple(BEYOND[kind] / SI[unit] for kind, unit in kinds)


REGISTERS = Form()


def parse_header(line: bytes) -> tuple[int, tuple[int, ...], Form] | None:
    """A header line: how many columns it announces, where the log's are, and what they are; None where it is none."""
    names = [name.strip() for name in line.decode("latin-1").split(",")]
    form = REGISTERS if set(COLUMNS) <= set(names) else _physical(names)
    return None if form is None else (len(names), tuple(map(names.index, form.names)), form)


def _physical(names: list[str]) -> Form | None:
    times = [name for name in names if name in TIME_US]
    gyro = _triad(names, "g", ("dps", "rps"))
    accel = _triad(names, "a", ("g", "mps2"))
    if len(times) != 1 or gyro is None or accel is None:
        return None
    return Form((times[0], *gyro, *accel, *(["temp_c"] if "temp_c" in names else [])))


def _triad(names: list[str], letter: str, units: tuple[str, ...]) -> tuple[str, ...] | None:
    found = [triad for unit in units if set(triad := tuple(f"{letter}{axis}_{unit}" for axis in "xyz")) <= set(names)]
    return found[0] if len(found) == 1 else None
