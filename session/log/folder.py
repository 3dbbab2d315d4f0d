"""A session folder as one record: configuration, logs, closure runs, tables; its hashes, and what may be added to it."""

from __future__ import annotations

import csv
import hashlib
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from session.base import features
from session.base.errors import CalibrationError, DataError, FormatError, StorageError
from session.base.files import (
    MB,
    MOST_TOML,
    copy_new,
    created,
    folder_whole,
    open_file,
    read_text,
    replaced,
    require_empty,
    require_file,
    unreadable,
    write_new,
)
from session.base.names import CLOCKS, log_paths, refuse_special
from session.base.progress import Reporter, no_report
from session.base.texts import printable, significant, unicode_text
from session.base.toml import Note, add_lines, edited, parse_toml, toml_line, value_text
from session.base.units import DEG
from session.log.config import (
    Accelerometer,
    ByHand,
    Config,
    LeftOut,
    NominalRate,
    Protocol,
    Sensor,
    Site,
    StillByHand,
    config_of,
    read_config,
    reference_of,
)
from session.log.logfile import NAME as KNOWN_TURNS
from session.log.logfile import KnownTurn, Log, already_calibrated, read_known_turns, read_log, rows_of
from session.log.registers import UNKNOWN
from session.log.samples import Samples, joined, mapped

# A session folder as one record: configuration, calibration logs, closure runs, dial readings (docs/formats.md).

ATTITUDES = "attitudes.csv"
#: beyond any full scale, dps or g
FAR = 1e9
#: far beyond any recording, and small enough for a table with a row each
MOST_STILLS = 100_000


@dataclass(frozen=True, eq=False)
class Session:
    """What a folder holds.

    attitudes (stills, 3) rad, roll pitch yaw from the table's dials, or None; row = number of the still.  reference: what a feature
    serves in place of gravity and dials (``REFERENCE`` of ``session/base/features.py``), None without one.  turns: those whose angle is
    known beforehand.  rests: paths of its rest logs, which are long, and read by who wants them (``session/log/rests.py``).
    attitude_lines: the line in its file of each row of attitudes, None where the still has none.
    """

    folder: Path
    config: Config
    logs: tuple[Log, ...]
    closures: tuple[Log, ...]
    attitudes: np.ndarray | None = None
    reference: Any = None
    turns: tuple[KnownTurn, ...] = ()
    rests: tuple[Path, ...] = ()
    attitude_lines: tuple[int | None, ...] = ()

    @classmethod
    def from_arrays(
        cls,
        t_s: ArrayLike | None = None,
        gyro_rps: ArrayLike | None = None,
        accel_mps2: ArrayLike | None = None,
        temp_c: ArrayLike | None = None,
        *,
        logs: Sequence[tuple[ArrayLike, ...]] = (),
        closures: Sequence[tuple[ArrayLike, ...]] = (),
        turns: Sequence[tuple[Any, ...]] = (),
        rate_unit: str = "rad/s",
        force_unit: str = "m/s^2",
        name: str = "arrays",
        model: str = "unknown",
        serial: str = "",
        gyro_fs_dps: float | None = None,
        accel_fs_g: float | None = None,
        accelerometer: Accelerometer | None = None,
        site: Site | None = None,
        protocol: Protocol | None = None,
        **further: Sequence[tuple[ArrayLike, ...]],
    ) -> Session:
        """A session that was never a file.

        Parameters
        ----------
        t_s, gyro_rps, accel_mps2, temp_c : array_like
            One log: (N,) s, increasing; (N, 3) rad/s and (N, 3) m/s^2 in body axes b (forward-right-down), as measured; (N,) degC, which
            may be left out.
        logs : sequence of tuple
            Several logs in their place, each ``(t_s, gyro_rps, accel_mps2)`` or with ``temp_c`` as fourth.
        closures : sequence of tuple
            Closure runs, each likewise, on the clock of the logs.
        turns : sequence of tuple
            Turns of known angle, each ``(number, axis, angle_deg, sigma_deg)``, with the number of a log as fifth where the turn counts
            within that log; axis: ``"x"``, ``"-y"``, or three numbers in body axes.
        rate_unit, force_unit : str
            Units of all rates and forces that are given, as ``"dps"`` and ``"g"``; inside, all is SI.
        name, model, serial : str
            Of the session, one word; of the sensor.
        gyro_fs_dps, accel_fs_g : float
            Full scales; those not given are the smallest usual ones that hold the data.
        accelerometer, site, protocol : Accelerometer, Site, Protocol
            Its pre-calibration (none), and sections of session.toml.
        further : sequence of tuple
            Arrays of a further reference, one entry for each log, under its word of ``protocol.reference``.

        Returns
        -------
        Session
            For ``check``, ``fit``, ``explain`` and the others; ``save`` writes it as a folder.

        Raises
        ------
        DataError
            For what no file may hold either, and for rates that no such gyroscope reads, which are in degrees.

        Examples
        --------
        >>> import numpy as np
        >>> t_s = np.arange(1000) / 100
        >>> session = Session.from_arrays(t_s, np.zeros((1000, 3)), np.tile([0, 0, -1.0], (1000, 1)), force_unit="g")
        >>> session.logs[0].samples.accel[0, 2]
        np.float64(-9.80665)

        """
        from session.log.arrays import logs_of_arrays, require_kind, si_of, turns_of_arrays, usual_ranges

        for what, text in (("name", name), ("model", model), ("serial", serial)):
            require_kind(what, text, str, "text")
        if Path(name).name != name or not name or "\0" in name:
            raise DataError(f"name is {name!r}, expected one word, as of a folder")
        for word in further:
            if reference_of(word) is None:
                raise TypeError(f"Session.from_arrays() got an unexpected keyword argument {word!r}")
        given_rows = {"logs": logs, "closures": closures, "turns": turns, **further}
        for what, rows in given_rows.items():
            require_kind(what, rows, (list, tuple, NoneType), "a list of tuples")
        logs, closures, turns = logs or (), closures or (), turns or ()
        further = {word: rows for word, rows in further.items() if rows}
        for what, record, kind in (("accelerometer", accelerometer, Accelerometer), ("site", site, Site), ("protocol", protocol, Protocol)):
            require_kind(what, record, (kind, NoneType), f"a tinygc.{kind.__name__}")
        protocol = protocol or Protocol(reference=next(iter(further), "gravity"))
        kind = reference_of(protocol.reference)
        wanted = [] if kind is None or not kind.accelerometer else [kind.word]
        if list(further) != wanted or (protocol.reference != "gravity" and not wanted):
            words = [each.word for each in features.each("reference") if each.accelerometer]
            others = "".join(f', or "{word}" with {word}=' for word in words)
            raise DataError(f'protocol.reference is "{protocol.reference}"; arrays have "gravity"{others}')
        for what, given in (("gyro_fs_dps", gyro_fs_dps), ("accel_fs_g", accel_fs_g)):
            require_kind(what, given, (int, float, np.number, NoneType), "the full scale that the sensor was set to")
            if given is not None and not 0 < given < FAR:
                raise DataError(f"{what} is {given!r:.60}, expected the full scale that the sensor was set to")
        one = [array for array in (t_s, gyro_rps, accel_mps2, temp_c) if array is not None]
        if bool(one) == (len(logs) > 0) or (one and (t_s is None or gyro_rps is None or accel_mps2 is None)):
            raise DataError("give one log as t_s, gyro_rps and accel_mps2, or several as logs=")
        si = si_of("rate_unit", "gyro", rate_unit), si_of("force_unit", "accel", force_unit)
        if one:
            made = logs_of_arrays("", [f"{name}.log"], [(t_s, gyro_rps, accel_mps2, temp_c)], gyro_fs_dps, si)
        else:
            made = logs_of_arrays("logs", _numbered(f"{name}.log", logs), logs, gyro_fs_dps, si)
        runs = logs_of_arrays("closures", _numbered(f"{name}.closure", closures), closures, gyro_fs_dps, si)
        if further and len(turns):
            seen = f"{kind.word}= sees all three angles of every turn"
            raise DataError(f"turns= are of known angle against gravity, and {seen}; leave turns out")
        usual_gyro, usual_accel = usual_ranges(joined([log.samples for log in (*made, *runs)]))
        sensor = Sensor(model, serial, 1 / made[0].samples.period_s, gyro_fs_dps or usual_gyro, accel_fs_g or usual_accel)
        config = Config(sensor, accelerometer or Accelerometer(source="none"), site or Site(), protocol)
        return cls(
            folder=Path(name),
            config=config,
            logs=made,
            closures=runs,
            reference=kind.of_arrays(name, further[kind.word], len(made), config) if further else None,
            turns=turns_of_arrays(turns, made),
        )

    def save(self, folder: Path | str) -> Path:
        """Write a session folder that ``read_session`` reads to the same numbers, and return it.

        Rates are in rad/s, specific force in m/s^2 and stamps in ns, with all digits; registers become such numbers.  Logs and closure
        runs are numbered from 1.  Raises FormatError where the folder holds something, and for a setting that no session.toml may hold.
        """
        from session.log.arrays import require_kind
        from session.log.written import attitudes_text, log_lines, toml_text, turns_text

        require_kind("folder", folder, (str, os.PathLike), "the path of a new folder")
        if "\0" in str(folder) or not str(folder).strip():
            raise DataError(f"folder is {folder!r:.60}, expected the path of a new folder")
        folder = Path(folder)
        require_empty(folder, "holds something already; give a new or an empty folder")
        names = {log.path.name: f"log{number:04d}.csv" for number, log in enumerate(self.logs, start=1)}
        plain = {old.removesuffix(".gz"): new for old, new in names.items()}
        own = self.config.accelerometer
        if own.source in ("stills", "prior"):  # estimated from these very stills
            own = replace(own, own_stills=True)
        named = self.config.with_names(lambda name: plain.get(name.removesuffix(".gz"), name))
        config = replace(named, accelerometer=own)
        text = toml_text(config, but=())
        config_of(Path(self.name), parse_toml(text, self.name))  # nothing is written that no reader takes
        with folder_whole(folder) as work:
            write_new(work / "session.toml", text)
            for log, name in zip(self.logs, names.values(), strict=True):
                _write_lines(work / name, log_lines(log))
            for number, run in enumerate(self.closures, start=1):
                _write_lines(work / f"closure{number:04d}.csv", log_lines(run))
            if self.reference is not None:
                self.reference.save(work, config)
            if self.turns:
                turns = tuple(replace(turn, log=turn.log and names[turn.log]) for turn in self.turns)
                _write_lines(work / KNOWN_TURNS, [turns_text(turns)])
            if self.attitudes is not None:
                _write_lines(work / ATTITUDES, [attitudes_text(self.attitudes)])
            for rest in self.rests:
                copy_new(rest, work / rest.name)
        return folder

    def __repr__(self) -> str:
        seconds = sum(log.samples.duration_s for log in self.logs)
        runs = f", {len(self.closures)} closure run{'s' * (len(self.closures) != 1)}" if self.closures else ""
        return (
            f"<Session {self.name}: {len(self.logs)} log{'s' * (len(self.logs) != 1)}, {seconds:.0f} s{runs}; {self.config.sensor.model}>"
        )

    @property
    def name(self) -> str:
        """The folder's last name, as it may stand in a line (``session.base.texts.printable``)."""
        return printable(self.folder.resolve().name)

    @property
    def nominal_rate(self) -> NominalRate | None:
        """The data rate that stands for a clock in any of the logs; None where all stamps are measured."""
        return next((rate for log in self.logs if (rate := self.rate_of(log)) is not None), None)

    @property
    def clock(self) -> NominalRate | None:
        """What the logs' times are worth: that rate, else the clock that stamps them, where session.toml states how good it is."""
        sensor = self.config.sensor
        if self.nominal_rate is not None or not sensor.clock_sigma:
            return self.nominal_rate
        return NominalRate(sensor.odr_hz, sensor.clock_sigma, "sensor.clock_sigma_ppm")

    @property
    def clock_known(self) -> bool:
        """Whether anything states how far the logs' clock may be off."""
        sensor = self.config.sensor
        stated = (sensor.odr_sigma, sensor.clock_sigma_ppm, sensor.clock_ratio)
        return self.nominal_rate is not None or any(each is not None for each in stated)

    def on_clock(self, clock: str) -> Session:
        """The session by this clock, one of ``CLOCKS``: ``arrivals`` divides all times by ``sensor.clock_ratio``, once.

        Raises FormatError where no ratio was measured, and where a further reference goes by the same stamps.
        """
        if clock == CLOCKS[0]:
            return self
        ratio, sigma_ppm = self.config.sensor.clock_ratio, self.config.sensor.clock_sigma_ppm
        if ratio is None:
            raise FormatError(f"{self.folder}: sensor.clock_ratio is not given; `record` measures it; leave --clock {clock} out")
        if self.reference is not None:
            raise FormatError(f"{self.folder}: the {self.reference.title}s go by the logs' own stamps; leave --clock {clock} out")
        note = f"stamps divided by {ratio:.9g}" + ("" if sigma_ppm is None else f" ± {significant(sigma_ppm)} ppm") + f" (--clock {clock})"

        def timed(log: Log) -> Log:
            t_ns = np.rint(log.samples.t_ns / np.longdouble(ratio)).astype(np.int64)
            stated_hz = log.number("odr_hz")  # by the same clock
            comments = log.comments if stated_hz is None else log.comments | {"odr_hz": f"{stated_hz * ratio:.9g}"}
            return replace(log, samples=replace(log.samples, t_ns=t_ns), comments=comments, notes=(*log.notes, note))

        config = self.config.on_time(lambda at_s: at_s / ratio)
        return replace(self.with_logs(timed), config=replace(config, sensor=replace(config.sensor, clock_ratio=None)))

    def examined(self) -> tuple[Session, list[Any]]:
        """The session with its further reference as the recording shows it, and findings on it; without one it stays as it is."""
        return (self, []) if self.reference is None else self.reference.examined(self)

    def rate_of(self, log: Log) -> NominalRate | None:
        """The same of one log or closure run."""
        sensor = self.config.sensor
        return sensor.nominal_rate if log.counted or sensor.odr_sigma is not None else None

    @property
    def temperature_c(self) -> float | None:
        """Mean temperature over its logs, °C; None where no log has one."""
        means = [float(np.mean(log.samples.temp_c[:])) for log in self.logs if log.samples.temp_c is not None]
        return float(np.mean(means)) if means else None

    @property
    def in_memory(self) -> bool:
        """Whether it is made of arrays and was never a folder."""
        return any(log.in_memory for log in self.logs)

    def with_logs(self, change: Callable[[Log], Log]) -> Session:
        """The session with each log and closure run changed."""
        return replace(self, logs=tuple(map(change, self.logs)), closures=tuple(map(change, self.closures)))

    def own_folder(self, name: str) -> Path:
        """Where results of that name go, unless another place is given.  CalibrationError where the session was never a folder."""
        if self.in_memory:
            raise CalibrationError(f"{self.name}: made of arrays, it has no folder of its own; give one to save to")
        return self.folder / name

    def calibrated(self, log: Log) -> Samples:
        """A log's samples with the accelerometer's pre-calibration applied."""
        return log.samples.with_accel(mapped(log.samples.accel, self.config.accelerometer.correct))


def _numbered(stem: str, given: Sequence[Any]) -> list[str]:
    return [f"{stem}{number}" for number in range(1, len(given) + 1)]


def _write_lines(path: Path, lines: Iterable[str]) -> None:
    with created(path) as file:
        file.writelines(text.encode() for text in lines)


def read_session(folder: Path | str, progress: Reporter = no_report) -> Session:
    """Read a whole session folder.  FormatError or DataError names file and line.  ``progress`` is called with each file's name."""
    folder = Path(folder)
    if not folder.is_dir():
        raise FormatError(f"{folder}: {'a file; give the session folder' if folder.exists() else 'no such folder'}")
    refuse_special(folder)
    config = read_config(folder / "session.toml")
    paths, closures = log_paths(folder, "log"), log_paths(folder, "closure")
    rests = log_paths(folder, "rest")
    if not paths and rests:
        raise FormatError(f"{folder}: rest logs alone, in which nothing is turned; give a session with turns")
    if not paths:
        raise FormatError(f"{folder}: no log; expected log*.csv or log*.csv.gz next to session.toml")

    kind = reference_of(config.protocol.reference)
    further = [] if kind is None else kind.paths(paths)
    tables = [path for path in (folder / ATTITUDES, folder / KNOWN_TURNS) if path.exists()]
    for path in (*paths, *closures, *tables, *further):
        require_file(path)
    session = read_logs(folder, config, paths, closures, rests, progress)
    attitudes = folder / ATTITUDES
    dials = _read_attitudes(attitudes) if config.protocol.reference == "table" or attitudes.exists() else (None, ())
    return replace(
        session,
        attitudes=dials[0],
        attitude_lines=dials[1],
        reference=None if kind is None else kind.read(further, config),
        turns=_read_turns(folder / KNOWN_TURNS, config, [path.name for path in paths]),
    )


def read_logs(
    folder: Path,
    config: Config,
    paths: Sequence[Path],
    closures: Sequence[Path],
    rests: Sequence[Path],
    progress: Reporter = no_report,
    gyro_alone: bool = False,
) -> Session:
    """A session of these logs, closure runs and rest logs, without the tables of its folder; gyro_alone: as in ``read_log``.

    Raises FormatError or DataError.
    """

    def read(path: Path) -> Log:
        progress(path.name)
        return read_log(path, config.sensor, gyro_alone)

    logs, runs = tuple(map(read, paths)), tuple(map(read, closures))
    config, logs, runs = _calibrated_once(config, logs, runs)
    return Session(folder, config, logs, runs, rests=tuple(rests))


def _read_turns(path: Path, config: Config, logs: list[str]) -> tuple[KnownTurn, ...]:
    if not path.exists():
        return ()
    if config.protocol.reference != "gravity":
        raise FormatError(
            f'{path.name}: protocol.reference is "{config.protocol.reference}", which sees all three angles of every turn; '
            'remove the file, or use reference = "gravity"'
        )
    return read_known_turns(path, logs)


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


def _read_attitudes(path: Path) -> tuple[np.ndarray, tuple[int | None, ...]]:
    """Dial readings ``still,roll_deg,pitch_deg,yaw_deg`` as (stills, 3) rad, NaN rows for stills that have none; and each row's line."""
    columns = ["still", "roll_deg", "pitch_deg", "yaw_deg"]
    if not os.path.lexists(path):
        raise FormatError(f'{path}: not found, but protocol.reference is "table"; add the dial readings, or use "gravity"')
    lines = rows_of(path)
    if [cell.strip() for cell in next(lines, (0, ""))[1].split(",")] != columns:
        raise FormatError(f"{path.name}: the header must be {','.join(columns)}")
    readings, at = {}, {}
    for number, text in lines:
        try:
            row = next(csv.reader([text]))
            still, *angles = int(row[0]), *map(float, row[1:4])
        except (ValueError, IndexError, csv.Error):
            raise FormatError(f"{path.name} line {number}: {text[:60]!r}, expected still,roll_deg,pitch_deg,yaw_deg") from None
        if still > MOST_STILLS:
            raise FormatError(f"{path.name} line {number}: still {row[0][:20].strip()!r} is beyond {MOST_STILLS}; stills count from 0")
        if still < 0 or len(angles) != 3 or not all(map(math.isfinite, angles)) or still in readings:
            raise FormatError(f"{path.name} line {number}: still {still} is doubled, negative or has no finite angles")
        readings[still], at[still] = angles, number
    if not readings:
        raise FormatError(f"{path.name}: a header but no dial readings")
    table = np.full((max(readings) + 1, 3), np.nan)
    for still, angles in readings.items():
        table[still] = np.multiply(angles, DEG)
    return table, tuple(at.get(still) for still in range(len(table)))


# What a result was made from: the hash of every file of a session.


def input_files(session: Session) -> list[Path]:
    """Every file of a session that a result depends on: session.toml, logs, closure runs, and tables next to them."""
    dials = [session.folder / "attitudes.csv"] if session.attitudes is not None else []
    dials += [session.folder / KNOWN_TURNS] if session.turns and not session.in_memory else []
    further = [] if session.in_memory or session.reference is None else [path for path, _ in session.reference.arrays]
    config = [] if session.in_memory else [session.folder / "session.toml"]
    return [*config, *(log.path for log in (*session.logs, *session.closures)), *dials, *further]


def input_hashes(session: Session) -> dict[str, str]:
    """SHA-256 of each of ``input_files``, by name, or of arrays that were never a file; FormatError where one cannot be read any more."""
    logs = {log.path: log for log in (*session.logs, *session.closures)}
    hashes = {file_key(path): hash_of_log(logs[path]) if path in logs else sha256_of(path) for path in input_files(session)}
    if session.turns and KNOWN_TURNS not in hashes:
        rows = [(turn.turn, turn.log, turn.axis.tolist(), turn.angle_rad, turn.sigma_rad) for turn in session.turns]
        hashes[KNOWN_TURNS] = hashlib.sha256(repr(rows).encode()).hexdigest()
    for path, arrays in () if session.reference is None else session.reference.arrays:
        hashes.setdefault(file_key(path), _hash_of_arrays(arrays))
    return hashes


def file_key(path: Path) -> str:
    """The file's name as JSON can hold it, and gives it back."""
    return unicode_text(path.name)


def hash_of_log(log: Log) -> str:
    """Of its file; of arrays that were never a file, of their bytes, little-endian, one array after the other."""
    if not log.in_memory:
        return sha256_of(log.path)
    samples = log.samples
    return _hash_of_arrays(((samples.t_ns, "<i8"), (samples.gyro, "<f8"), (samples.accel, "<f8"), (samples.temp_c, "<f8")))


def _hash_of_arrays(arrays: Iterable[tuple[np.ndarray | None, str]]) -> str:
    """SHA-256 of arrays that are there, each with its type, in hexadecimal."""
    digest = hashlib.sha256()
    for array, kind in arrays:
        if array is not None:
            digest.update(np.ascontiguousarray(array, dtype=kind).tobytes())
    return digest.hexdigest()


def sha256_of(path: Path) -> str:
    """Of a file's bytes as they lie on the disk (packed logs packed), in hexadecimal."""
    try:
        with open_file(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise unreadable(path, error) from None


#: bytes up to which two logs of one size are compared
MOST_COMPARED = 20_000 * MB


def refuse_same(paths: Sequence[Path]) -> None:
    """DataError where two logs are the same recording, which would count twice, and narrow every sigma."""
    seen: dict[str, int] = {}
    sizes = [path.stat().st_size if path.is_file() else -1 for path in paths]
    for number, (path, size) in enumerate(zip(paths, sizes, strict=True)):
        compared = sizes.count(size) > 1 and 0 <= size <= MOST_COMPARED
        first = seen.setdefault(sha256_of(path) if compared else os.path.realpath(path), number)
        if first != number:
            raise DataError(f"{paths[first]} and {path} are the same recording, which would count twice; leave one of them out")


# What is added to a ``session.toml`` that is there: notes, and turns that do not count.  The rest stays as it is, and the file is replaced
# whole or not at all.


def add_notes(path: Path, notes: Mapping[str, Note]) -> str:
    """Add to ``[notes]``, and give the file's text, which its folder may not outlive.  What is there already in the same words is left;
    FormatError where it states something else."""
    from session.log.written import notes_text

    text, table = _read(path)
    notes = {unicode_text(name): unicode_text(value) if isinstance(value, str) else value for name, value in notes.items()}
    there = table.get("notes", {})
    for name, value in notes.items():
        if name in there and there[name] != value:
            raise FormatError(f"{path}: notes.{name} is {value_text(there[name])} already; correct it there, or give another name")
    if not (fresh := {name: value for name, value in notes.items() if name not in there}):
        return text
    return _replace(path, _with_lines(text, "notes", notes_text(fresh)), table | {"notes": there | fresh})


def set_sensor(path: Path, values: Mapping[str, float]) -> str:
    """Give keys of ``[sensor]`` these values, and give the file's text."""
    text, table = _read(path)
    lines = "".join(toml_line(name, value) for name, value in values.items())
    return _replace(path, _with_lines(text, "sensor", lines), table | {"sensor": {**table["sensor"], **values}})


def fill_in(path: Path, section: str, name: str, value: str | float) -> str:
    """Give a section a value that it does not state yet, and give the file's text.  FormatError where it states another."""
    from session.log.written import NO_SITE

    text, table = _read(path)
    stated = table.get(section, {})
    if (there := stated.get(name)) == value:
        return text
    if there not in (None, UNKNOWN):
        raise FormatError(f"{path}: {section}.{name} is {there}, not {value}; correct it there, or leave the option out")
    line = toml_line(name, value)
    filled = text.replace(NO_SITE, line) if section == "site" and NO_SITE in text and not stated else _with_lines(text, section, line)
    return _replace(path, filled, table | {section: {**stated, name: value}})


def add_board(path: Path, board: Mapping[str, str | float], remarks: Mapping[str, str]) -> str:
    """Add ``[board]``, where there is none yet, and give the file's text.  remarks: comments, each before the key that it is of."""
    text, table = _read(path)
    if "board" in table:
        return text
    lines = "".join((f"# {remarks[name]}\n" if name in remarks else "") + toml_line(name, value) for name, value in board.items())
    return _replace(path, _ended(text) + f"\n[board]\n{lines}", table | {"board": dict(board)})


def add_by_hand(path: Path, row: ByHand) -> str:
    """Add what a person changed of a turn or a still, and give the file's text."""
    from session.log.written import by_hand_text

    text, table = _read(path)
    key = KEYS[type(row)]
    wanted = table | {key: [*table.get(key, []), _stated(row)]}
    added = text + by_hand_text(row)  # which begins with a new line: a last line without one is left so when the row goes
    try:
        right = _parsed(added, "") == wanted
    except FormatError:
        right = False
    if not right and key in table:  # as an array within a line
        added = edited(text, lambda document: document[key].append(_stated(row)))
    return _replace(path, added, wanted)


def remove_by_hand(path: Path, row: ByHand) -> str:
    """Take such a change back, and give the file's text: what it was before, where nothing else has changed.  FormatError without it."""
    from session.log.written import by_hand_text

    text, table = _read(path)
    key, mine = KEYS[type(row)], _stated(row)
    rows = table.get(key, [])
    if mine not in rows:
        raise FormatError(f"{path}: [[{key}]] of {row.log} at {row.at_s:g} s is not there any more")
    at = rows.index(mine)
    left = [other for number, other in enumerate(rows) if number != at]
    wanted = {name: value for name, value in table.items() if name != key} | ({key: left} if left else {})
    as_added = text.replace(by_hand_text(row), "", 1)
    if _parsed(as_added, str(path)) == wanted:
        return _replace(path, as_added, wanted)
    return _replace(path, edited(text, lambda document: document[key].pop(at) if left else document.pop(key)), wanted)


KEYS = {LeftOut: "exclude", StillByHand: "still"}


def _stated(row: ByHand) -> dict[str, Any]:
    return {name: unicode_text(value) if isinstance(value, str) else value for name, value in vars(row).items() if value is not None}


def _with_lines(text: str, section: str, lines: str) -> str:
    """The text with the keys of these lines in a section, which is made where there is none."""
    if (there := _parsed(text, "").get(section)) is None:
        return _ended(text) + f"\n[{section}]\n{lines}"
    return edited(text, lambda document: add_lines(document[section], lines)) if isinstance(there, dict) else text


def _ended(text: str) -> str:
    return text if not text or text.endswith("\n") else text + "\n"


def _read(path: Path) -> tuple[str, dict]:
    text = read_text(path, MOST_TOML, mark=True)  # line ends, and a byte order mark, stay what they are
    return text, _parsed(text, str(path))


def _parsed(text: str, where: str) -> dict:
    return parse_toml(text.removeprefix("\ufeff").replace("\r\n", "\n"), where)


def _replace(path: Path, text: str, wanted: dict) -> str:
    """A text that states what is wanted becomes the file, in one step: no reader sees half of it."""
    try:
        right = _parsed(text, str(path)) == wanted
    except FormatError:
        right = False
    if not right:
        raise FormatError(f"{path}: its form leaves no place to add to; write it there yourself")
    try:
        with replaced(path) as file:
            file.write(text.encode())
    except OSError as error:
        raise StorageError(f"{path}: {error.strerror or error}; what was to be added is not in it") from None
    return text
