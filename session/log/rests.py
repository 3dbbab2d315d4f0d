"""A rest log: the sensor lies still, for minutes or days, while its temperature changes.  Read once, in constant memory, into block means.

A rest log is no calibration log: nothing is turned, and its millions of samples need not be in memory.  Means over a second
keep everything that temperature can do; what a second hides is kept as the scatter within it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.base.errors import DataError, FormatError
from session.base.units import NS_PER_S
from session.log.config import Sensor
from session.log.reader import Reader
from session.log.samples import Samples
from session.log.stamps import fresh
from session.log.thermometer import NO_GRID, Grid, Sound, grid_with

#: a block is a second, or so many samples where a second holds fewer: the scatter within it must mean something
REST_BLOCK_S, BLOCK_SAMPLES = 1.0, 8
#: six weeks, at some 200 bytes each
MOST_BLOCKS = 4_000_000
#: called with each piece of samples as it is read
Watch = Callable[[Samples], None]


@dataclass(frozen=True, eq=False)
class RestLog:
    """Block means of one rest log, in the order of time, B blocks; blocks that hold less than half their samples are left out.

    number (B,) int: which block since the first, so that a gap shows; block_s; t_s (B,) s, middle of each, since the first sample;
    temp_c (B,) degC, NaN where the log has none; gyro (B, 3) rad/s and accel (B, 3) m/s^2, as measured; gyro_sd, accel_sd (B, 3): standard
    deviation of the samples within each block; count (B,); samples in all; period_s between two; notes of the reader; grid of the
    thermometer's readings.
    """

    path: Path
    number: np.ndarray
    block_s: float
    temp_c: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    gyro_sd: np.ndarray
    accel_sd: np.ndarray
    count: np.ndarray
    samples: int
    period_s: float
    notes: tuple[str, ...] = ()
    grid: Grid = NO_GRID

    def __len__(self) -> int:
        return len(self.number)

    def __repr__(self) -> str:
        return f"<RestLog {self.path.name}: {self.samples} samples, {self.duration_s:.0f} s>"

    @property
    def t_s(self) -> np.ndarray:
        """(B,) s, middle of each block."""
        return (self.number + 0.5) * self.block_s

    @property
    def duration_s(self) -> float:
        """From the first block to the last."""
        return float(self.number[-1] + 1) * self.block_s if len(self) else 0.0

    @property
    def has_temperature(self) -> bool:
        """Whether the log had such a column."""
        return bool(np.isfinite(self.temp_c).all())

    def pick(self, which: np.ndarray) -> RestLog:
        """The blocks of a mask or of indices (…)."""
        names = ("number", "temp_c", "gyro", "accel", "gyro_sd", "accel_sd", "count")
        return replace(self, **{name: getattr(self, name)[which] for name in names})


def read_rest(path: Path, sensor: Sensor, watch: Watch = lambda samples: None) -> RestLog:
    """Read one rest log; ``watch`` is called with each piece of samples (SI), so that nothing is read twice.

    Raises FormatError (what cannot be read: line and column are named) or DataError (too short to mean
    anything).
    """
    reader = Reader(path)
    blocks = BlockMeans(max(REST_BLOCK_S, BLOCK_SAMPLES / sensor.odr_hz))
    repeated, steps_s, has_temperature, sound = 0, [], False, Sound()
    for samples, left_out in _pieces(reader, sensor, sound):
        repeated += left_out
        has_temperature |= samples.temp_c is not None
        if len(samples) > 1:
            steps_s.append(samples.period_s)
        try:
            blocks.add(samples)
        except DataError as error:
            raise DataError(f"{path.name}: {error}") from None
        watch(samples)
    if blocks.samples == 0:
        raise FormatError(f"{path.name}: a header but no samples; was the recording stopped before it began?")
    notes = reader.notes_on(sound, sensor.model, has_temperature)
    if repeated:
        notes.append(f"{repeated} rows repeat the stamp before them: left out")
    log = blocks.log(path, float(np.median(steps_s)) if steps_s else np.nan, tuple(notes))
    if len(log) < 2:
        raise DataError(
            f"{path.name}: {blocks.samples} samples, less than two blocks of {blocks.block_s:g} s; "
            "expected a rest of minutes; is sensor.odr_hz right, and are the stamps in the unit of the header?"
        )
    return log


def _pieces(reader: Reader, sensor: Sensor, sound: Sound) -> Iterator[tuple[Samples, int]]:
    """Samples in SI, and how many rows of each piece repeated a stamp."""
    layout, last = reader.layout, None
    units = sensor.register_units
    gyro_si, accel_si = reader.factors(units)
    for rows in reader.pieces():
        t_ns = rows.t_ns
        assert t_ns is not None and rows.gyro is not None and rows.accel is not None  # noqa: PT018  # a standard log has them
        kept = fresh(t_ns) if last is None else np.diff(t_ns, prepend=last) > 0
        last = t_ns[-1]
        temp = None if rows.temp is None else sound(layout.temperature_c(rows.temp, units))
        samples = Samples(t_ns, rows.gyro * gyro_si, rows.accel * accel_si, temp)
        if left_out := int(np.count_nonzero(~kept)):
            samples = samples.pick(kept)
        if len(samples):
            yield samples, left_out


class BlockMeans:
    """Sums over blocks of ``block_s``, piece by piece; the block that a piece ends in waits for the next piece."""

    def __init__(self, block_s: float):
        self.block_s, self.samples, self._blocks, self._grid = block_s, 0, 0, NO_GRID
        self._first_ns: int | None = None
        self._rows: list[np.ndarray] = []
        self._open: np.ndarray | None = None
        self._about: np.ndarray | None = None  # sums of squares about the first sample: gravity is large, its scatter small

    def add(self, samples: Samples) -> None:
        """The next samples, in the order of time."""
        if self._first_ns is None:
            self._first_ns = int(samples.t_ns[0])
        self.samples += len(samples)
        number = (samples.t_ns - self._first_ns) // round(self.block_s * NS_PER_S)
        self._grid = grid_with(self._grid, samples.temp_c)
        temp = np.full(len(samples), np.nan) if samples.temp_c is None else samples.temp_c
        values = np.column_stack([samples.gyro, samples.accel])
        if self._about is None:
            self._about = values[0].copy()
        values -= self._about
        starts = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
        columns = np.column_stack([np.ones(len(samples)), temp, values, values**2])
        rows = np.column_stack([number[starts], np.add.reduceat(columns, starts, axis=0)])
        self._blocks += len(rows)
        if self._blocks > MOST_BLOCKS:
            raise DataError(f"more than {MOST_BLOCKS} blocks of {self.block_s:g} s; are the stamps in the unit of the header?")
        if self._open is not None:
            if self._open[0] == rows[0, 0]:
                rows[0, 1:] += self._open[1:]
            else:
                self._rows.append(self._open[None])
        self._rows.append(rows[:-1])
        self._open = rows[-1]

    def log(self, path: Path, period_s: float, notes: tuple[str, ...] = ()) -> RestLog:
        """What was added, as one record."""
        assert self._open is not None
        assert self._about is not None
        table = np.concatenate([*self._rows, self._open[None]])
        usual = np.median(table[:, 1])
        table = table[table[:, 1] >= max(usual / 2, 2)]
        count = table[:, 1]
        mean, square = table[:, 3:9] / count[:, None], table[:, 9:15] / count[:, None]
        sd = np.sqrt(np.maximum(square - mean**2, 0) * (count / (count - 1))[:, None]) if len(table) else mean
        mean = mean + self._about
        return RestLog(
            path,
            table[:, 0].astype(int),
            self.block_s,
            table[:, 2] / count,
            mean[:, :3],
            mean[:, 3:],
            sd[:, :3],
            sd[:, 3:],
            count.astype(int),
            self.samples,
            period_s,
            notes,
            self._grid,
        )


def rest_from_samples(samples: Samples, name: str = "rest.csv") -> RestLog:
    """A rest log that was never a file."""
    blocks = BlockMeans(max(REST_BLOCK_S, BLOCK_SAMPLES * samples.period_s))
    blocks.add(samples)
    return blocks.log(Path(name), samples.period_s)
