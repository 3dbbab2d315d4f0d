"""One log of a session, and the small tables of its folder: dial readings, known turns."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from session.base.errors import DataError, FormatError
from session.base.units import DEG
from session.log.config import Sensor
from session.log.layout import Layout
from session.log.lines import Lines
from session.log.reader import Reader
from session.log.registers import RegisterUnits
from session.log.samples import Growing, Packer, Samples, times
from session.log.stamps import COARSE, TWICE, evenly, fresh, placed_between, written_once
from session.log.thermometer import Sound

# One log of a session: a standard log (FORMATS), read by the one reader (``session/dialects``), in SI.


def _temperature(packer: Packer, layout: Layout, units: RegisterUnits) -> np.ndarray | None:
    """(N,) degC; None where there is none, or its register's scale is unknown."""
    if layout.temp is None or layout.temperature_c(np.zeros(1), units) is None:
        return None
    return packer.readings(partial(_in_degrees, layout, units))


def _in_degrees(layout: Layout, units: RegisterUnits, values: np.ndarray) -> np.ndarray:
    found = layout.temperature_c(values, units)
    assert found is not None  # or there are no temperatures
    return found


@dataclass(frozen=True, eq=False)
class Bridge:
    """Readings that interpolation put in (``session/detect/bridging.py``).

    what was there, ``gap`` or ``clipped``; row of the first, how many; at_s of the log; sigma_rad (3,): by how much the rotation over
    them may be off, body axes.
    """

    what: str
    row: int
    count: int
    at_s: float
    sigma_rad: np.ndarray


@dataclass(frozen=True, eq=False)
class Log:
    """One file's samples, comments and the reader's notes.

    samples with the specific force as measured; comments: ``key=value`` pairs of its # lines; notes: what the reader repaired
    or left out; raw: whether it held registers; in_memory: arrays that were never a file, path being but a name; bridges:
    readings of the samples that were put in.
    """

    path: Path
    samples: Samples
    comments: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    raw: bool = True
    in_memory: bool = False
    bridges: tuple[Bridge, ...] = ()

    def number(self, key: str) -> float | None:
        """The number that a comment ``key=value`` states; None where it states none."""
        return number_in(self.comments, key)

    @property
    def counted(self) -> bool:
        """Whether it had no stamps, and its samples were counted at a nominal rate."""
        return self.comments.get("stamps") == "counted"

    @property
    def put_in(self) -> np.ndarray:
        """(N,) bool: which samples are no readings, but were put in."""
        mask = np.zeros(len(self.samples), dtype=bool)
        for bridge in self.bridges:
            mask[bridge.row : bridge.row + bridge.count] = True
        return mask

    def __repr__(self) -> str:
        return f"<Log {self.path.name}: {len(self.samples)} samples, {self.samples.duration_s:.1f} s>"


#: key of a comment that states what of a log ``apply`` has calibrated
CALIBRATED = "calibrated"


def number_in(comments: Mapping[str, str], key: str) -> float | None:
    """The number that a comment ``key=value`` states; None where it states none."""
    try:
        return float(comments[key])
    except (KeyError, ValueError):
        return None


def already_calibrated(comments: dict[str, str]) -> frozenset[str] | None:
    """``gyro``, ``accel`` or both, from the comments that ``apply`` wrote in a log; None of a log as it was measured."""
    return frozenset(comments[CALIBRATED].split(",")) if CALIBRATED in comments else None


def refuse_calibrated(comments: dict[str, str], name: str) -> None:
    """Raise FormatError for a log that ``apply`` wrote."""
    if (done := already_calibrated(comments)) is not None:
        raise FormatError(f"{name} is calibrated already ({', '.join(sorted(done))}): give the log that it was made of")


def read_log(path: Path, sensor: Sensor, gyro_alone: bool = False) -> Log:
    """Read one log file; gyro_alone: its accelerometer, which it may lack, is not read, and the specific force is NaN.

    Raises FormatError (what cannot be read: line and column are named) or DataError (a single sample).
    A last line that was cut off is left out and noted.  A log of another program is refused: ``import`` makes it one of ours.
    """
    reader = Reader(path, gyro_alone)
    layout, units, stamps, packers = reader.layout, sensor.register_units, Growing(), (Packer(), Packer(), Packer())
    sound = Sound()
    for rows in reader.pieces(as_written=True):
        assert rows.t_ns is not None  # a standard log without stamps was refused
        stamps.add(rows.t_ns)
        temp = None if rows.temp is None else sound(layout.temperature_c(rows.temp, units), rows.temp)
        for packer, values in zip(packers, (rows.gyro, None if gyro_alone else rows.accel, temp), strict=True):
            if values is not None:
                packer.add(values)
    if not len(written := stamps.rows()):
        raise FormatError(f"{path.name}: a header but no samples; was the recording stopped before it began?")
    t_ns = reader.unrolled(written)
    del written
    factors = reader.factors(units, gyro_alone)
    if gyro_alone:
        packers[1].add(np.full((len(t_ns), 3), np.nan))
    gyro, accel = (packer.readings(times(si)) for packer, si in zip(packers, factors, strict=False))
    samples = Samples(t_ns, gyro, accel, _temperature(packers[2], layout, units))
    notes = reader.notes_on(sound, sensor.model, samples.temp_c is not None)
    if not fresh(samples.t_ns).all():
        samples, more = _with_stamps_of_their_own(samples, path.name)
        notes += more
    if len(samples) < 2:
        raise DataError(f"{path.name}: a single sample; expected a recording of some seconds")
    raw = any(triad is not None and triad.unit.si is None for triad in (layout.gyro, layout.accel))
    return Log(path=path, samples=samples, comments=reader.comments, notes=tuple(notes), raw=raw)


def _with_stamps_of_their_own(samples: Samples, name: str) -> tuple[Samples, list[str]]:
    """The samples without rows that repeat the one before them, and with times for those that share its stamp alone; and notes.

    Where many share a stamp, all are counted along the stamps, as ``import`` does; else they are placed between their neighbours, where
    there is time for them.  Raises DataError where many would be left out.
    """
    once = written_once(samples.t_ns, [samples.gyro, samples.accel])
    shared, twice, notes = np.count_nonzero(np.diff(samples.t_ns) == 0), np.count_nonzero(~once), list[str]()
    refused = None
    if shared > COARSE * len(samples) and twice < TWICE * shared:
        try:
            t_ns, note, _ = evenly(samples.t_ns, None, name)
            if note and fresh(t_ns).all():
                return replace(samples, t_ns=t_ns), [note]
        except DataError as error:
            refused = DataError(str(error).replace("give --odr HZ", "count the samples: import --odr HZ"))
    samples = samples if once.all() else samples.pick(once)
    placed = placed_between(samples.t_ns)
    if moved := np.count_nonzero(placed != samples.t_ns):
        notes.append(f"{moved} rows have the stamp of another row and readings of their own: placed between their neighbours")
        samples = replace(samples, t_ns=placed)
    kept = fresh(samples.t_ns)
    if twice:
        notes.append(f"{twice} rows repeat the row before them: left out")
    if out := np.count_nonzero(~kept):
        if refused is not None and out > COARSE * len(kept):
            raise refused
        notes.append(f"{out} rows have the stamp of another row, and no time before the next: left out")
    return samples.pick(kept), notes


# The rows of a session folder's small tables: dial readings, known turns.  Read a line at a time, however long they are.


def rows_of(path: Path) -> Iterator[tuple[int, str]]:
    """The number of each line that is neither blank nor a comment, and the line, plain or gzipped, whatever its line ends.

    FormatError for what cannot be read: no file, no UTF-8, packed and broken off, or beyond any table (``session/log/lines.py``).
    """
    before = 0
    with Lines(path, strict=True) as file:
        while lines := file.take():
            for number, line in enumerate(lines, start=before + 1):
                if line.strip() and not line.startswith("#"):
                    yield number, line
            before += len(lines)


# ``turns.csv``: turns whose angle is known beforehand, from a stop or the table's index (docs/formats.md).
#
# The file counts turns as ``check`` and ``fit`` count segments: from 0, over all logs in name order; with the column ``log``, from 0 in the
# log of that name.

NAME = "turns.csv"
COLUMNS = ("turn", "axis", "angle_deg", "sigma_deg")
#: any order, and ``log`` as well where turns are counted within each log
LOG = "log"
#: a stop that repeats worse than this adds nothing to a gyroscope's own reading
MOST_SIGMA_DEG = 10.0
#: full circles in one turn; beyond that the angle is in another unit
MOST_ANGLE_DEG = 36_000.0
#: five times the longest session that a table has made
MOST_TURNS = 10_000


@dataclass(frozen=True, eq=False)
class KnownTurn:
    """One row.

    turn: its number, over all logs, or in the log of that name; axis (3,) unit, body axes, nominal: what the sensor was turned about;
    words: the axis as it was written; angle_rad about it by the right-hand rule, whole circles included; sigma_rad: the
    stop's repeatability.
    """

    turn: int
    log: str | None
    axis: np.ndarray
    words: str
    angle_rad: float
    sigma_rad: float

    @property
    def name(self) -> str:
        """``turn 3``, or ``turn 0 of log0002.csv``."""
        return f"turn {self.turn}" + (f" of {self.log}" if self.log else "")

    @property
    def description(self) -> str:
        """``360 ± 0.05 deg about x``."""
        return f"{self.angle_rad / DEG:g} ± {self.sigma_rad / DEG:g} deg about {self.words}"


def read_known_turns(path: Path, logs: list[str]) -> tuple[KnownTurn, ...]:
    """The rows of ``turns.csv``; logs: names of the session's logs.  FormatError names the line and what is wrong."""
    lines = rows_of(path)
    header = [cell.strip() for cell in next(lines, (0, ""))[1].split(",")]
    if sorted(set(header) - {LOG}) != sorted(COLUMNS) or len(set(header)) != len(header):
        raise FormatError(f"{NAME}: the header must be {','.join(COLUMNS)}, with the column {LOG} where turns are counted in each log")
    turns: dict[tuple[int, str | None], KnownTurn] = {}
    for number, line in lines:
        where = f"{NAME} line {number}"
        try:
            cells = [cell.strip() for cell in next(csv.reader([line], strict=True))]
        except csv.Error:
            cells = []
        if len(cells) != len(header):
            raise FormatError(f"{where}: {line[:60]!r}, expected {len(header)} cells: {','.join(header)}")
        turn = known_turn(where, dict(zip(header, cells, strict=True)), logs)
        if (turn.turn, turn.log) in turns:
            raise FormatError(f"{NAME} line {number}: {turn.name} is given twice; keep one")
        turns[turn.turn, turn.log] = turn
        if len(turns) > MOST_TURNS:
            raise FormatError(f"{NAME} line {number}: more than {MOST_TURNS} turns; is it the right file?")
    if not turns:
        raise FormatError(f"{NAME}: a header but no turns; remove the file, or give a row for each turn of known angle")
    return tuple(turns.values())


def known_turn(where: str, cell: Mapping[str, str], logs: list[str]) -> KnownTurn:
    """A turn of its four cells as text, and of ``log``; logs: names of the session's logs.  FormatError states what is wrong, and where."""
    words = ";".join(part.strip() for part in cell["axis"].split(";"))  # a number may stand between invisible characters
    turn = _number(where, "turn", cell["turn"], "a whole number, the first turn is 0")
    if turn != int(turn) or not 0 <= turn < MOST_TURNS:
        raise FormatError(f"{where}: turn is {cell['turn']!r}, expected a whole number, the first turn is 0")
    angle = _number(where, "angle_deg", cell["angle_deg"], "degrees, as 360 or -90")
    if not 0 < abs(angle) <= MOST_ANGLE_DEG:
        raise FormatError(f"{where}: angle_deg is {cell['angle_deg']!r}, expected degrees, not 0 and within {MOST_ANGLE_DEG:g}")
    sigma = _number(where, "sigma_deg", cell["sigma_deg"], "degrees, one sigma of the stop, as 0.05")
    if not 0 < sigma <= MOST_SIGMA_DEG:
        raise FormatError(
            f"{where}: sigma_deg is {cell['sigma_deg']!r}, expected one sigma of the stop, above 0 and up to {MOST_SIGMA_DEG:g}"
        )
    return KnownTurn(int(turn), _log(where, cell.get(LOG), logs), _axis(where, words), words, angle * DEG, sigma * DEG)


def _number(where: str, name: str, text: str, expected: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{where}: {name} is {text[:30]!r}, expected {expected}")
    return value


def _axis(where: str, text: str) -> np.ndarray:
    """``x``, ``+y``, ``-z``, or three numbers with semicolons between; (3,) unit."""
    sign, letter = (-1.0 if text.startswith("-") else 1.0), text.lstrip("+-").lower()
    if letter in ("x", "y", "z") and len(text) <= 2:
        return sign * np.eye(3)["xyz".index(letter)]
    try:
        axis = np.array([float(part) for part in text.split(";")])
    except ValueError:
        axis = np.zeros(0)
    if axis.shape != (3,) or not np.isfinite(axis).all() or not axis.any():
        raise FormatError(f"{where}: axis is {text[:30]!r}, expected x, y or z with a sign if need be, or three numbers as 0;0.7;0.7")
    axis = axis / np.abs(axis).max()  # the squares of what is very large or small are no numbers
    return axis / np.linalg.norm(axis)


def _log(where: str, text: str | None, logs: list[str]) -> str | None:
    """The log's own name; an empty cell counts over all logs."""
    if not text:
        return None
    for name in logs:
        if text in (name, name.removesuffix(".gz"), name.removesuffix(".gz").removesuffix(".csv")):
            return name
    raise FormatError(f"{where}: log is {text[:40]!r}, expected one of {', '.join(logs[:6])}{', …' if len(logs) > 6 else ''}")
