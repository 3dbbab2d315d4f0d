"""One log of a session: a standard log (FORMATS), read by the one reader (``session/dialects``), in SI."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from session.common.errors import DataError, FormatError
from session.dialects.layout import Layout
from session.dialects.reader import Reader
from session.dialects.stamps import fresh
from session.log.config import Sensor
from session.log.readings import Growing, Packer, Readings, times
from session.log.samples import Samples
from session.sensor.registers import RegisterUnits


def _temperature(packer: Packer, layout: Layout, units: RegisterUnits) -> np.ndarray | None:
    """(N,) degC; None where there is none, or nobody knows what its register means."""
    if layout.temp is None or layout.temperature_c(np.zeros(1), units) is None:
        return None
    return cast(np.ndarray, Readings(*packer.packed(), (partial(_in_degrees, layout, units),)))


def _in_degrees(layout: Layout, units: RegisterUnits, values: np.ndarray) -> np.ndarray:
    found = layout.temperature_c(values, units)
    assert found is not None  # or there are no temperatures
    return found


@dataclass(frozen=True, eq=False)
class Bridge:
    """Readings that were put in from their neighbours (``session/detect/bridges.py``): what was there, ``gap`` or ``clipped``; row of the
    first, how many; at_s of the log; sigma_rad (3,): by how much the rotation over them may be off, body axes."""

    what: str
    row: int
    count: int
    at_s: float
    sigma_rad: np.ndarray


@dataclass(frozen=True, eq=False)
class Log:
    """One file's samples, and what else it said.

    samples with the specific force as measured; comments: ``key=value`` pairs of its # lines; notes: what was mended
    or left out while reading; raw: whether it held registers; in_memory: arrays that were never a file, path being but a name; bridges:
    readings of the samples that were put in.
    """

    path: Path
    samples: Samples
    comments: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    raw: bool = True
    in_memory: bool = False
    bridges: tuple[Bridge, ...] = ()

    @property
    def put_in(self) -> np.ndarray:
        """(N,) bool: which samples are no readings, but were put in."""
        mask = np.zeros(len(self.samples), dtype=bool)
        for bridge in self.bridges:
            mask[bridge.row : bridge.row + bridge.count] = True
        return mask

    def __repr__(self) -> str:
        return f"<Log {self.path.name}: {len(self.samples)} samples, {self.samples.duration_s:.1f} s>"


#: key of a comment that says what of a log ``apply`` has calibrated
CALIBRATED = "calibrated"


def already_calibrated(comments: dict[str, str]) -> frozenset[str] | None:
    """``gyro``, ``accel`` or both, as the comments of a log say that ``apply`` wrote; None of a log as it was measured."""
    return frozenset(comments[CALIBRATED].split(",")) if CALIBRATED in comments else None


def read_log(path: Path, sensor: Sensor) -> Log:
    """Read one log file.

    Raises FormatError (what cannot be read: line and column are named) or DataError (a single sample).
    A last line that was cut off is left out and noted.  A log of another program is refused: ``replay`` makes it one of ours.
    """
    reader = Reader(path, None)
    layout, units, stamps, packers = reader.layout, sensor.register_units, Growing(), (Packer(), Packer(), Packer())
    for rows in reader.pieces(as_written=True):
        assert rows.t_ns is not None  # a standard log without stamps was refused
        stamps.add(rows.t_ns)
        for packer, values in zip(packers, (rows.gyro, rows.accel, rows.temp), strict=True):
            if values is not None:
                packer.add(values)
    if not len(written := stamps.rows()):
        raise FormatError(f"{path.name}: a header but no samples; was the recording stopped before it began?")
    t_ns = reader.unrolled(written)
    del written
    try:
        factors = layout.gyro_si(units), layout.accel_si(units)
    except FormatError as error:
        raise FormatError(f"{path.name} holds registers: {error}") from None
    gyro, accel = (cast(np.ndarray, Readings(*p.packed(), (times(si),))) for p, si in zip(packers, factors, strict=False))
    samples = Samples(t_ns, gyro, accel, _temperature(packers[2], layout, units))
    notes = list(reader.notes)
    if layout.temp is not None and samples.temp_c is None:
        notes.append(f"temp: what the temperature register of {sensor.model} means is not known: left out")
    if reader.wraps:
        notes.append(f"the 32-bit time counter wrapped {reader.wraps}x: unrolled")
    if not (kept := fresh(samples.t_ns)).all():
        notes.append(f"{np.count_nonzero(~kept)} rows repeat the stamp before them: left out")
        samples = samples.pick(kept)
    if len(samples) < 2:
        raise DataError(f"{path.name}: a single sample; expected a recording of some seconds")
    raw = any(triad is not None and triad.unit.si is None for triad in (layout.gyro, layout.accel))
    return Log(path=path, samples=samples, comments=reader.comments, notes=tuple(notes), raw=raw)
