"""A session folder as one record: configuration, calibration logs, closure runs, dial readings (docs/formats.md)."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from session.common.errors import CalibrationError, DataError, FormatError
from session.common.texts import printable, shell_word
from session.common.units import DEG
from session.files.reading import require_file
from session.log.array_names import refuse_array
from session.log.arrays import samples_from_arrays, usual_ranges
from session.log.config import Accelerometer, Config, Protocol, Sensor, Site, read_config
from session.log.known_turns import NAME as KNOWN_TURNS
from session.log.known_turns import KnownTurn, read_known_turns
from session.log.logfile import Log, already_calibrated, read_log
from session.log.readings import mapped
from session.log.rows_of_text import rows_of
from session.log.samples import Samples, joined
from session.log.truth import Truth, read_truth, truth_path
from session.log.truth_reading import TruthAlignment, TruthReading

ATTITUDES = "attitudes.csv"
#: far beyond any recording, and small enough for a table with a row each
MOST_STILLS = 100_000


@dataclass(frozen=True, eq=False)
class Session:
    """What a folder holds.

    attitudes (stills, 3) rad, roll pitch yaw from the table's dials, or None; row = number of the still.  truths: of each log, where
    the reference is a truth file, else None.  turns: those whose angle is known beforehand.  alignment: how the truths are read, where
    that was found out (``session/alignment``).  rests: paths of its rest logs, which are long,
    and read by who wants them (``session/log/rests.py``).
    """

    folder: Path
    config: Config
    logs: tuple[Log, ...]
    closures: tuple[Log, ...]
    attitudes: np.ndarray | None = None
    truths: tuple[Truth, ...] | None = None
    turns: tuple[KnownTurn, ...] = ()
    alignment: TruthAlignment | None = None
    rests: tuple[Path, ...] = ()

    @classmethod
    def from_arrays(
        cls,
        t_s: ArrayLike,
        gyro_rps: ArrayLike,
        accel_mps2: ArrayLike,
        temp_c: ArrayLike | None = None,
        *,
        closures: Sequence[tuple[ArrayLike, ...]] = (),
        name: str = "arrays",
        model: str = "unknown",
        serial: str = "",
        gyro_fs_dps: float | None = None,
        accel_fs_g: float | None = None,
        accelerometer: Accelerometer | None = None,
        site: Site | None = None,
        protocol: Protocol | None = None,
    ) -> Session:
        """A session of one log that was never a file.

        t_s (N,) s, increasing; gyro_rps (N, 3) rad/s and accel_mps2 (N, 3) m/s^2 in body axes b (forward-right-down), as measured;
        temp_c (N,) degC.  closures: closure runs, each ``(t_s, gyro_rps, accel_mps2)`` or with ``temp_c`` as fourth, on the log's clock.
        Full scales that are not given are the smallest usual ones that hold the data.  accelerometer: its pre-calibration (none); site
        and protocol as in session.toml.  Raises DataError for what no file may hold either.
        """
        if Path(name).name != name or not name:
            raise DataError(f"name is {name!r}, expected one word, as of a folder")
        if protocol is not None and protocol.reference != "gravity":
            raise DataError(
                f'{name}: reference is "{protocol.reference}"; arrays have gravity alone, the others come from a session folder'
            )
        if not all(len(run) in (3, 4) for run in closures):
            raise DataError(f"{name}: each of closures is (t_s, gyro_rps, accel_mps2) or (t_s, gyro_rps, accel_mps2, temp_c)")
        logs = [_from_memory(f"{name}.log", t_s, gyro_rps, accel_mps2, temp_c)]
        runs = [_from_memory(f"{name}.closure{number}", *run) for number, run in enumerate(closures, start=1)]
        usual_gyro, usual_accel = usual_ranges(joined([log.samples for log in (*logs, *runs)]))
        for what, given in (("gyro_fs_dps", gyro_fs_dps), ("accel_fs_g", accel_fs_g)):
            if given is not None and not 0 < given < float("inf"):
                raise DataError(f"{name}: {what} is {given!r}, expected the full scale that the sensor was set to")
        sensor = Sensor(model, serial, 1 / logs[0].samples.period_s, gyro_fs_dps or usual_gyro, accel_fs_g or usual_accel)
        config = Config(sensor, accelerometer or Accelerometer(source="none"), site or Site(), protocol or Protocol())
        return cls(Path(name), config, tuple(logs), tuple(runs))

    def __repr__(self) -> str:
        seconds = sum(log.samples.duration_s for log in self.logs)
        runs = f", {len(self.closures)} closure run{'s' * (len(self.closures) != 1)}" if self.closures else ""
        return (
            f"<Session {self.name}: {len(self.logs)} log{'s' * (len(self.logs) != 1)}, {seconds:.0f} s{runs}; {self.config.sensor.model}>"
        )

    @property
    def name(self) -> str:
        """The folder's last name, as it may stand in a line (``session.common.texts.printable``)."""
        return printable(self.folder.resolve().name)

    def own_folder(self, name: str) -> Path:
        """Where results of that name go, unless another place is given.  CalibrationError where the session was never a folder."""
        if any(log.in_memory for log in self.logs):
            raise CalibrationError(f"{self.name}: made of arrays, it has no folder of its own; give one to save to")
        return self.folder / name

    def calibrated(self, log: Log) -> Samples:
        """A log's samples with the accelerometer's pre-calibration applied."""
        return log.samples.with_accel(mapped(log.samples.accel, self.config.accelerometer.correct))


def _from_memory(name: str, t_s: ArrayLike, gyro_rps: ArrayLike, accel_mps2: ArrayLike, temp_c: ArrayLike | None = None) -> Log:
    return Log(Path(name), samples_from_arrays(name, t_s, gyro_rps, accel_mps2, temp_c), raw=False, in_memory=True)


def log_paths(folder: Path, stem: str) -> list[Path]:
    """``stem*.csv`` and ``stem*.csv.gz`` in name order; FormatError where both forms of one log are there."""
    paths = sorted([*folder.glob(f"{stem}*.csv"), *folder.glob(f"{stem}*.csv.gz")], key=lambda path: path.name)
    bare = [path.name.removesuffix(".gz") for path in paths]
    for name in bare:
        if bare.count(name) > 1:
            raise FormatError(f"{folder}: holds {name} and {name}.gz; keep one, or the log would count twice")
    return paths


def read_session(folder: Path | str, progress: Callable[[str], None] = lambda what: None) -> Session:
    """Read a whole session folder.  Raises FormatError or DataError, naming file and line.  ``progress`` is told each file."""
    folder = Path(folder)
    if not folder.is_dir():
        hint = "that is a file; give the session folder" if folder.exists() else "not found"
        raise FormatError(f"{folder}: {hint}; a session folder holds session.toml and log*.csv")
    refuse_array(folder)
    config = read_config(folder / "session.toml")
    paths, closures = log_paths(folder, "log"), log_paths(folder, "closure")
    rests = log_paths(folder, "rest")
    if not paths and rests:
        raise FormatError(
            f"{folder}: no log but rest logs, in which nothing is turned; `calibrate.py fit {shell_word(folder)}` fits their temperature"
        )
    if not paths:
        raise FormatError(f"{folder}: no log; expected log*.csv or log*.csv.gz beside session.toml")

    for path in (*paths, *closures, *_beside(folder, config, paths)):
        require_file(path)
    session = read_logs(folder, config, paths, closures, rests, progress)
    attitudes = folder / ATTITUDES
    return replace(
        session,
        attitudes=_read_attitudes(attitudes) if config.protocol.reference == "table" or attitudes.exists() else None,
        truths=_read_truths(config, paths) if config.protocol.reference == "truth" else None,
        turns=_read_turns(folder / KNOWN_TURNS, config, [path.name for path in paths]),
    )


def read_logs(
    folder: Path,
    config: Config,
    paths: Sequence[Path],
    closures: Sequence[Path],
    rests: Sequence[Path],
    progress: Callable[[str], None] = lambda what: None,
) -> Session:
    """A session of these logs, closure runs and rest logs, without what may lie beside them.  Raises FormatError or DataError."""

    def read(path: Path) -> Log:
        progress(path.name)
        return read_log(path, config.sensor)

    logs, runs = tuple(map(read, paths)), tuple(map(read, closures))
    config, logs, runs = _calibrated_once(config, logs, runs)
    return Session(folder, config, logs, runs, rests=tuple(rests))


def _beside(folder: Path, config: Config, paths: list[Path]) -> list[Path]:
    """What is read after the logs, where it is there."""
    truths = list(map(truth_path, paths)) if config.protocol.reference == "truth" else []
    return [path for path in (folder / ATTITUDES, folder / KNOWN_TURNS, *truths) if path.exists()]


def _read_turns(path: Path, config: Config, logs: list[str]) -> tuple[KnownTurn, ...]:
    if not path.exists():
        return ()
    if config.protocol.reference != "gravity":
        raise FormatError(
            f'{path.name}: protocol.reference is "{config.protocol.reference}", which sees all three angles of every turn; '
            'remove the file, or use reference = "gravity"'
        )
    return read_known_turns(path, logs)


def _read_truths(config: Config, paths: list[Path]) -> tuple[Truth, ...]:
    reading = TruthReading.of(config.truth)
    return tuple(read_truth(truth_path(path), reading) for path in paths)


def _calibrated_once(config: Config, logs: tuple[Log, ...], closures: tuple[Log, ...]) -> tuple[Config, tuple[Log, ...], tuple[Log, ...]]:
    """Logs that ``apply`` wrote have calibrated specific force: [accelerometer] is not for them.  DataError where only some of them are."""
    done = ["accel" in (already_calibrated(log.comments) or ()) for log in (*logs, *closures)]
    if not any(done):
        return config, logs, closures
    if not all(done):
        one, other = ((*logs, *closures)[done.index(kind)].path for kind in (True, False))
        raise DataError(f"{one.name} has calibrated specific force, {other.name} has not: keep logs as measured, or calibrate all of them")
    note = "its specific force is calibrated already: [accelerometer] of session.toml is not for it"
    logs, closures = (tuple(replace(log, notes=(*log.notes, note)) for log in each) for each in (logs, closures))
    return replace(config, accelerometer=Accelerometer()), logs, closures


def _read_attitudes(path: Path) -> np.ndarray:
    """Dial readings ``still,roll_deg,pitch_deg,yaw_deg`` as (stills, 3) rad, NaN rows for stills that have none."""
    columns = ["still", "roll_deg", "pitch_deg", "yaw_deg"]
    if not os.path.lexists(path):
        raise FormatError(f'{path}: not found, but protocol.reference is "table"; add the dial readings, or use "gravity"')
    lines = rows_of(path)
    if [cell.strip() for cell in next(lines, (0, ""))[1].split(",")] != columns:
        raise FormatError(f"{path.name}: the header must be {','.join(columns)}")
    readings = {}
    for number, line in lines:
        try:
            row = next(csv.reader([line]))
            still, *angles = int(row[0]), *map(float, row[1:4])
        except (ValueError, IndexError, csv.Error):
            raise FormatError(f"{path.name} line {number}: {line[:60]!r}, expected still,roll_deg,pitch_deg,yaw_deg") from None
        if still > MOST_STILLS:
            raise FormatError(f"{path.name} line {number}: still {row[0][:20].strip()!r} is beyond {MOST_STILLS}; stills count from 0")
        if still < 0 or len(angles) != 3 or not all(map(math.isfinite, angles)) or still in readings:
            raise FormatError(f"{path.name} line {number}: still {still} is doubled, negative or has no finite angles")
        readings[still] = angles
    if not readings:
        raise FormatError(f"{path.name}: a header but no dial readings")
    table = np.full((max(readings) + 1, 3), np.nan)
    for still, angles in readings.items():
        table[still] = np.multiply(angles, DEG)
    return table
