"""Apply a model to a log of any length in constant memory: rows are read, calibrated and written in pieces."""

from __future__ import annotations

import contextlib
import gzip
import itertools
import sys
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, BinaryIO

import numpy as np

from session.base.errors import CalibrationError, DataError, FormatError
from session.base.numeric import decimal_rows
from session.base.progress import Progress
from session.base.records import Count, table_of
from session.base.results import Text, whole
from session.base.texts import command_line, significant
from session.base.units import DEG
from session.bench.session_file import ASSUMED
from session.log.config import Accelerometer
from session.log.lines import PIECE_BYTES, STANDARD
from session.log.logfile import CALIBRATED, number_in, refuse_calibrated
from session.log.reader import Reader
from session.log.registers import DEFAULT, RegisterUnits
from session.log.stamps import pace_of
from session.log.standard import flags_of
from tinygc import models
from tinygc.deploy.calibration import Calibration, Stream, Surroundings, began_in_session, surroundings

#: decimals written, three orders below the noise of any MEMS sensor
DECIMALS = {"rps": 9, "dps": 7, "mps2": 6, "c": 4}
#: a data rate that differs from the model's by more than this share is reported
RATE_WITHIN = 0.05


@dataclass(frozen=True)
class Applied:
    """out: the file; rows: how many; kind of the model; delay_s: delay of the rates; notes: assumptions and data repairs; accelerometer:
    source of the calibration of the specific force (``model``, ``session`` or ``none``), None where the log has no accelerometer; model:
    name of its file."""

    schema = "tinygc-apply/1"
    written = ("out", "rows", "kind", "delay_s", "accelerometer", "notes")
    out: Path
    rows: Count
    kind: str
    delay_s: float
    accelerometer: Annotated[str | None, Text(("model", "session", "none"))]
    notes: tuple[str, ...]
    model: str

    @property
    def line(self) -> str:
        """What was written, in one line."""
        late = f", {1e3 * self.delay_s:.1f} ms late" if self.delay_s else ""
        return f"{self.out}: {self.rows} samples, calibrated ({self.kind}{late}, {self.model})"

    def to_json(self) -> dict:
        """``tinygc-apply/1`` (docs/formats.md)."""
        return table_of(self)


def model_of(path: Path) -> Path:
    """Return the model file that a path means: of a folder the one that its fit recommends.

    Raises CalibrationError where the folder has no fit, or where its fit recommends no model.
    """
    if not path.is_dir():
        return path
    from tinygc.fitting.fit_file import read_fit  # heavy, and a model file needs nothing of it

    fit = path / "fit"
    if not (fit / "fit.json").is_file():
        if len(only := list(fit.glob("model_*.json"))) == 1:
            return only[0]
        raise CalibrationError(f"{path}: a folder without a fit; run `{command_line('fit', path)}` first, or give a model file")
    use = read_fit(fit / "fit.json").get("use") or {}
    if (name := use.get("model")) is None:
        raise CalibrationError(f"{fit / 'fit.json'}: this fit recommends no model ({use.get('why', 'none is named')}); give a model file")
    name = Path(name).name
    if not (fit / name).is_file():
        raise CalibrationError(f"{fit / name}: not there, and the fit recommends it; run `{command_line('fit', path)}` again")
    return fit / name


def apply_model(
    model_path: Path,
    log: Path,
    out: Path,
    session: Path | None = None,
    unit: str = "rps",
    progress: Progress | None = None,
    table: dict | None = None,
) -> Applied:
    """Write ``log`` with calibrated rates, in ``unit`` (rps or dps), and calibrated specific force, as a log that TinyGC can read.

    table: what the model's file holds, of a model that is in memory, ``model_path`` being but its name.

    Full scales come from ``session``, from the session.toml next to the log, or from the model file, in this order.  ``calibration.py``
    chooses the calibration of the accelerometer.  ``out`` appears only when it is complete.  ``-`` is standard input or output.
    Raises FormatError, DataError, CalibrationError.
    """
    model, table = models.load_with_table(model_path) if table is None else (models.from_dict(table, str(model_path)), table)
    began_s = None if model.session_s is None else began_in_session(model, table, model_path, log)
    known = surroundings(table, model_path, log, session)
    source = LogSource(log, known)
    reader, pieces, rate_hz, notes = source.reader, source.pieces(), None, []
    if not source.model and any(unit.si is None for _, _, unit in reader.layout.kinds):
        notes.append(ASSUMED)
    if model.made_for_hz or Calibration(model, 1.0).uses_rate:
        first = next(pieces, None)
        if first is None:
            raise _no_samples(log)
        if not (np.diff(first.t_ns) > 0).any():
            raise DataError("the model needs the data rate, which the log's stamps do not give; import counts samples at a rate: --odr HZ")
        rate_hz = pace_of(first.t_ns).rate_hz
        pieces = itertools.chain([first], pieces)
        made_for = model.made_for_hz
        if made_for and abs(rate_hz / made_for - 1) > RATE_WITHIN:
            notes.append(f"the denoiser was made for {made_for:g} samples a second, the log has {rate_hz:.4g}: it smooths otherwise here")
    calibration = Calibration(model, rate_hz)
    channels = {"acc": ("the accelerometer", reader.layout.accel), "temp": ("the temperature", reader.layout.temp)}
    if missing := [named for what, (named, there) in channels.items() if what in calibration.needs and there is None]:
        needed_for = ", ".join(calibration.effects)
        raise DataError(f"{log.name} misses {' and '.join(missing)}, which the model needs ({needed_for}); import joins two files")
    if reader.layout.accel is not None:
        notes.append(f"specific force: {known.description}")
    if (spread := table.get("bias_sigma_rps")) is not None:
        notes.append(f"the bias of another session differs by up to {significant(np.sqrt(2) * max(spread) / DEG, 2)} dps (one sigma)")
    count = _write(out, log, source, pieces, calibration.stream(began_s), unit, progress)
    notes += reader.notes
    source_of_force = None if reader.layout.accel is None else known.source
    return Applied(out, count, models.to_dict(model)["kind"], model.delay_s, source_of_force, tuple(notes), model_path.name)


@dataclass(frozen=True, eq=False)
class Applicable:
    """Consecutive rows in SI: t_ns (N,) int64, gyro (N, 3) rad/s as measured, accel (N, 3) m/s^2 calibrated and temp (N,) degC, None where
    the log has none."""

    t_ns: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray | None
    temp: np.ndarray | None

    def rows(self, which: slice) -> Applicable:
        """Return a selection of the rows."""
        accel, temp = (None if part is None else part[which] for part in (self.accel, self.temp))
        return Applicable(self.t_ns[which], self.gyro[which], accel, temp)


class LogSource:
    """Pieces of a standard log in SI: time stamps, measured rate, calibrated force, temperature."""

    def __init__(self, log: Path, known: Surroundings, gyro_alone: bool = True):
        """The log's comments state its full scales and its sensor (``model``), or its session does; gyro_alone: whether it may have no
        accelerometer.

        Raises FormatError for a log that is calibrated already, and for registers whose full scale is not stated.
        """
        self.reader = Reader(log, gyro_alone)
        self.layout, comments, sensor = self.reader.layout, self.reader.comments, known.sensor
        refuse_calibrated(comments, log.name)
        self._accelerometer = known.accelerometer or Accelerometer(source="none")
        self.model = comments.get("sensor") or sensor.model
        gyro_fs_dps = number_in(comments, "gyro_fs_dps") or sensor.gyro_fs_dps
        accel_fs_g = number_in(comments, "accel_fs_g") or sensor.accel_fs_g
        for triad, full_scale, key in ((self.layout.gyro, gyro_fs_dps, "gyro_fs_dps"), (self.layout.accel, accel_fs_g, "accel_fs_g")):
            if triad is not None and triad.unit.si is None and full_scale is None:
                raise FormatError(f"{log.name} holds registers and does not state the full scale (# {key}=…); give --session DIR")
        own = sensor.own_units if self.model == sensor.model else {}
        self._units = RegisterUnits(self.model or DEFAULT, gyro_fs_dps, accel_fs_g, **own)
        self._gyro = self.layout.gyro_si(self._units)
        self._accel = 1.0 if self.layout.accel is None else self.layout.accel_si(self._units)

    def pieces(self, size: int = PIECE_BYTES) -> Iterator[Applicable]:
        """Yield the log's pieces of some ``size`` bytes in SI."""
        for piece in self.reader.pieces(size):
            assert piece.gyro is not None  # a standard log has rates and stamps
            assert piece.t_ns is not None
            temp = None if piece.temp is None else self.layout.temperature_c(piece.temp, self._units)
            force = None if piece.accel is None else self._accelerometer.correct(piece.accel * self._accel)
            yield Applicable(piece.t_ns, piece.gyro * self._gyro, force, temp)

    @property
    def calibrated(self) -> tuple[str, ...]:
        """Names of the calibrated quantities, for the log's comment."""
        return ("gyro",) if self.layout.accel is None or self._accelerometer.source == "none" else ("gyro", "accel")


def _no_samples(log: Path) -> FormatError:
    return FormatError(f"{log.name}: a header but no samples; was the recording stopped before it began?")


def _write(
    out: Path, log: Path, source: LogSource, pieces: Iterable[Applicable], stream: Stream, unit: str, progress: Progress | None
) -> int:
    """Write all rows and return their number.  The file gets its name only when it is complete."""
    if out.is_dir():
        raise FormatError(f"{out}: that is a folder; give -o a file")
    size, count = max(log.stat().st_size, 1) if log.is_file() else 1, 0
    try:
        with opened(out) as file:
            waiting: deque[Applicable] = deque()
            header = None
            for piece in pieces:
                if header is None:
                    header = ",".join(columns_of(unit, piece.accel is not None, piece.temp is not None, source.calibrated)) + "\n"
                    file.write(header.encode())
                waiting.append(piece)
                count += _drain(file, waiting, stream.push(piece.gyro, piece.accel, piece.temp), unit, count, len(source.calibrated))
                if progress is not None:
                    progress("applying", min(source.reader.position, size), size)
            if header is None:
                raise _no_samples(log)
            count += _drain(file, waiting, stream.flush(), unit, count, len(source.calibrated))
    except OSError as error:
        error.filename = error.filename or str(out)
        raise
    return count


@contextlib.contextmanager
def opened(out: Path) -> Iterator[BinaryIO | gzip.GzipFile]:
    """Open ``out`` for bytes, compressed if its name ends so, or standard output for ``-``."""
    if str(out) == STANDARD:
        with open(sys.stdout.fileno(), "wb", closefd=False) as file:  # not ``sys.stdout``, of which the command hears no broken pipe
            yield file
        return
    with whole(out) as plain:
        if out.name.endswith(".gz"):
            with gzip.open(plain, "wb", compresslevel=3) as file:
                yield file
        else:
            yield plain


def columns_of(unit: str, accel: bool, temp: bool, calibrated: tuple[str, ...]) -> list[str]:
    """Return the names of the columns.  The last ones hold 1 and name what is calibrated, which prevents a second calibration of the log; a
    comment would, too, but other programs take its line for a row."""
    names = ["t_ns", *(f"g{axis}_{unit}" for axis in "xyz"), *(f"a{axis}_mps2" for axis in "xyz" if accel), *(["temp_c"] if temp else [])]
    return names + flags_of({CALIBRATED: ",".join(calibrated)})


def taken(waiting: deque[Applicable], count: int) -> Iterator[Applicable]:
    """Yield the first ``count`` rows of what waits."""
    while count > 0:
        piece = waiting.popleft()
        if len(piece.gyro) > count:
            waiting.appendleft(piece.rows(slice(count, None)))
            piece = piece.rows(slice(count))
        count -= len(piece.gyro)
        yield piece


def _drain(file: BinaryIO | gzip.GzipFile, waiting: deque[Applicable], omega: np.ndarray, unit: str, before: int, flags: int) -> int:
    """Write the rows whose rates are known; the remaining rows of their pieces stay in the queue."""
    done = 0
    for piece in taken(waiting, len(omega)):
        take = len(piece.gyro)
        rate = omega[done : done + take] / (DEG if unit == "dps" else 1.0)
        columns, decimals = [piece.t_ns, *rate.T], [0, *[DECIMALS[unit]] * 3]
        if piece.accel is not None:
            columns, decimals = [*columns, *piece.accel.T], [*decimals, *[DECIMALS["mps2"]] * 3]
        if piece.temp is not None:
            columns, decimals = [*columns, piece.temp], [*decimals, DECIMALS["c"]]
        columns, decimals = [*columns, *[np.ones(take, np.int64)] * flags], [*decimals, *[0] * flags]
        try:
            file.write(decimal_rows(columns, decimals))
        except ValueError as error:
            raise CalibrationError(f"sample {before + done} and on: {error}; does the log suit the model?") from None
        done += take
    return done
