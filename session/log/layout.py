"""The layout of a log: which column is what, in which unit, and what one number of it is in SI."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from session.base.units import NS_PER_S, Unit

if TYPE_CHECKING:
    import numpy as np

    from session.log.registers import RegisterUnits


@dataclass(frozen=True)
class Triad:
    """columns of x, y, z by position, after signs and order of the axes; unit."""

    columns: tuple[int, int, int]
    signs: tuple[int, int, int]
    unit: Unit


def three(values: Iterable[int]) -> tuple[int, int, int]:
    """One value each for x, y, z; ValueError for another number of them."""
    x, y, z = values
    return x, y, z


@dataclass(frozen=True)
class Layout:
    """Of a standard log (docs/formats.md): commas, no quotes, whole numbers for registers and for stamps in ns or us.

    first: number of lines before the rows; time: its column, or None where rows are only counted; time_ns per unit of it; gyro, accel: what
    is there; temp: column; names of all columns; header_line as it stands in the file; remark: what was chosen without being stated;
    delimiter (None: white space).
    """

    first: int
    time: int | None
    time_ns: float
    gyro: Triad | None
    accel: Triad | None
    temp: int | None
    temp_unit: Unit | None
    names: tuple[str, ...]
    header_line: str = ""
    remark: str = ""
    delimiter: str | None = ","

    @property
    def numbers(self) -> tuple[int, ...]:
        """Columns of numbers, apart from the time: each once, the gyroscope's first."""
        triads = (triad.columns for triad in (self.gyro, self.accel) if triad is not None)
        return tuple(dict.fromkeys(column for columns in triads for column in columns)) + (() if self.temp is None else (self.temp,))

    @property
    def used(self) -> tuple[int, ...]:
        """Columns that are read, time first."""
        return (*(() if self.time is None else (self.time,)), *self.numbers)

    @property
    def kinds(self) -> list[tuple[str, tuple[int, ...], Unit]]:
        """Each quantity that is there: ``gyro``, ``accel`` or ``temp``, its columns, its unit."""
        triads = (("gyro", self.gyro), ("accel", self.accel))
        found: list[tuple[str, tuple[int, ...], Unit]] = [(kind, triad.columns, triad.unit) for kind, triad in triads if triad is not None]
        return found + ([] if self.temp is None or self.temp_unit is None else [("temp", (self.temp,), self.temp_unit)])

    @property
    def time_column(self) -> int:
        """``time`` of a log that has stamps."""
        assert self.time is not None  # the log has stamps
        return self.time

    def is_register(self, column: int) -> bool:
        """Whether a column holds a sensor's registers."""
        return any(column in columns and unit.si is None for _, columns, unit in self.kinds)

    def is_whole(self, column: int) -> bool:
        """Whether a column may hold nothing but whole numbers."""
        return self.time_ns < NS_PER_S if column == self.time else self.is_register(column)

    def name(self, column: int) -> str:
        """A column's name, as a message has it."""
        return self.names[column] if column < len(self.names) else f"column {column + 1}"

    def gyro_si(self, units: RegisterUnits) -> float:
        """rad/s per written unit; units: of registers.  FormatError where it holds registers whose meaning is not known."""
        assert self.gyro is not None  # the caller has checked that it is there
        return units.gyro_rps if self.gyro.unit.si is None else self.gyro.unit.si

    def accel_si(self, units: RegisterUnits) -> float:
        """m/s^2 per written unit; FormatError as for the gyroscope."""
        assert self.accel is not None
        return units.accel_mps2 if self.accel.unit.si is None else self.accel.unit.si

    def temperature_c(self, values: np.ndarray, units: RegisterUnits) -> np.ndarray | None:
        """degC (N,) of temperatures as written; None of registers whose meaning is not known."""
        assert self.temp_unit is not None
        return units.temperature_c(values) if self.temp_unit.si is None else values * self.temp_unit.si
