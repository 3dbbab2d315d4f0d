"""What lies at rest in the inputs of ``noise``: rest logs, other logs of sessions, and standard logs by themselves.

All inputs are one unit's.  A rest log is read piece by piece, in constant memory; a session's log is read whole.  A log that moves gives
the rests between its movements, each for itself, since nothing is known of the bias from one attitude to the next.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import DataError, FormatError
from session.base.files import open_file, require_file
from session.base.names import has_recorded_name, log_paths, refuse_special
from session.base.numeric import median_length
from session.base.progress import Progress, no_report
from session.base.rotation import angle_between
from session.base.texts import command_line, printable
from session.base.units import DEG
from session.detect.check_stills import check_rest
from session.detect.stills import find_stills, references
from session.log.config import REFERENCES, Config, Sensor, read_config
from session.log.folder import Session, refuse_same
from session.log.logfile import number_in, read_log
from session.log.reader import Reader
from session.log.registers import profile_of
from session.log.rests import RestLog, read_rest, rest_from_samples
from session.log.samples import TOGETHER, Samples, joined
from session.log.sensors import CLOCK_WITHIN
from session.log.stamps import FASTEST_HZ, SLOWEST_HZ, evenly, pace_of
from tinygc.features.noise.summary import RestSums

#: one log as arrays: t_s (N,) s, gyro (N, 3) rad/s, accel (N, 3) m/s^2
Arrays = tuple[Any, Any, Any]
Input = Path | Session | Arrays

UNKNOWN = "unknown"
#: dps: twice the largest zero-rate level of a known sensor; what reads more throughout is turned
TURNING_DPS = 60.0
#: degrees of gravity's direction within one log: more than an accelerometer's zero can do by temperature (100 mg)
TURNED_DEG = 6.0
#: a movement scatters so many times as much as the quieter blocks, where a second of noise alone scatters twice as much at most
RESTLESS = 5.0
#: share of a log that may be moved before it is no rest with knocks
MOVED_SHARE = 0.2
#: s, a rest between two movements that shows noise beyond white
SHORTEST_S = 1.0
#: how a file begins whose first column is called tau
FIRST_OF_CURVE = re.compile(rb"\W*(\xcf\x84|(taus?|averaging[ _]?times?)(_?s)?\W)", re.IGNORECASE)
FIRST_BYTES = 100


@dataclass(eq=False)
class Rests:
    """What is at rest in all inputs.

    sums: of each rest log and of each still; logs: names of the files; sensor: its model; serial; remarks: what was repaired, assumed or
    left out, one sentence each.
    """

    sums: list[RestSums]
    logs: list[str]
    remarks: list[str]
    sensor: str = ""
    serial: str = ""
    rate_hz: float = 0.0

    def require_same(self, name: str, sensor: str, serial: str, rate_hz: float) -> None:
        """Raise DataError for a log of another unit or data rate than those before; what neither states is not compared."""
        sensor = "" if sensor == UNKNOWN else sensor
        for what, mine, first in (("sensor", sensor, self.sensor), ("serial number", serial, self.serial)):
            same = mine == first or (what == "sensor" and (known := profile_of(mine)) is not None and known is profile_of(first))
            if mine and first and not same:
                before = f"of {self.logs[0]} it is" if self.logs else "it is given as"
                raise DataError(f"{name}: the {what} is {mine}, and {before} {first}; give the logs of one unit")
        if self.rate_hz and abs(rate_hz / self.rate_hz - 1) > CLOCK_WITHIN.value:
            raise DataError(
                f"{name}: it has {rate_hz:.4g} Hz, and {self.logs[0]} has {self.rate_hz:.4g} Hz; give logs of one data rate, since "
                "the sensor's filter follows it"
            )
        self.sensor, self.serial, self.rate_hz = self.sensor or sensor, self.serial or serial, self.rate_hz or rate_hz


def read_inputs(inputs: Sequence[Input], sensor: str = "", serial: str = "", progress: Progress = no_report) -> Rests:
    """Read all inputs of one unit; sensor, serial: of which it is given to be.

    Raises FormatError and DataError, in one line, for what cannot be read, for logs of two units or data rates, for a recording that is
    given twice, and where nothing is at rest.
    """
    rests = Rests([], [], [], sensor, serial)
    parts = list(_parts(inputs))
    refuse_same([path for _, path, _ in parts if path is not None])
    names = [name for name, _, _ in parts]
    for number, (name, file, read) in enumerate(parts):
        progress(f"reading {name}", number, len(parts))
        read(rests)
        folder = f"{printable(file.resolve().parent.name)}/" if file is not None and names.count(name) > 1 else ""
        rests.logs.append(f"{folder}{name}")
    if not rests.sums:
        raise DataError(f"{', '.join(rests.logs)}: nothing lies still in it; expected a rest of minutes ({'; '.join(rests.remarks[:3])})")
    return rests


#: one log: its name in messages, its file where it has one of its own, and what reads it into the rests
_Part = tuple[str, Path | None, Callable[[Rests], None]]


def _parts(inputs: Sequence[Input]) -> Iterator[_Part]:
    if not inputs:
        raise DataError("no log is given; give at least one log, session folder or tuple of arrays")
    for each in inputs:
        if isinstance(each, Session):
            sensor = each.config.sensor
            yield from ((path.name, path, partial(_stream, path, sensor)) for path in each.rests)
            yield from ((log.path.name, None, partial(_add, log.samples, log.path.name, sensor)) for log in each.logs)
        elif not isinstance(each, Path):
            session = Session.from_arrays(*each)
            yield ("arrays", None, partial(_add, session.logs[0].samples, "arrays", session.config.sensor))
        elif each.is_dir():
            yield from _of_folder(each)
        elif (config := _session_of(each)) is not None:
            yield _of_session(each, config)
        else:
            yield (each.name, each, partial(_read_bare, each))


def _session_of(path: Path) -> Config | None:
    """The settings of a log that lies in a session folder under a log's name; None of any other file."""
    settings = path.parent / "session.toml"
    named = path.name.endswith((".csv", ".csv.gz")) and has_recorded_name(path)
    return read_config(settings) if named and settings.is_file() else None


# Folders: a session, or logs side by side.


def _of_folder(folder: Path) -> Iterator[_Part]:
    """The logs of a folder.  FormatError where it holds none."""
    refuse_special(folder)
    if (folder / "session.toml").exists():
        config = read_config(folder / "session.toml")
        paths = [*log_paths(folder, "rest"), *log_paths(folder, "log")]
        if not paths:
            raise FormatError(f"{folder}: neither a rest log nor a log; expected rest*.csv or log*.csv next to session.toml")
        yield from (_of_session(path, config) for path in paths)
        return
    paths = sorted(path for path in folder.iterdir() if path.is_file() and path.name.lower().endswith((".csv", ".csv.gz")))
    if not paths:
        raise FormatError(f"{folder}: cannot be read (it holds no log); expected a session, or the logs of one unit")
    yield from ((path.name, path, partial(_read_bare, path)) for path in paths)


def _of_session(path: Path, config: Config) -> _Part:
    """A log in a session folder: a rest log is read piece by piece, of any other that moves the stills."""
    require_file(path)
    sensor = config.sensor
    if path.name.lower().startswith("rest"):
        return (path.name, path, partial(_stream, path, sensor))
    return (path.name, path, partial(_read_session_log, path, sensor, config.protocol.reference not in REFERENCES))


# One log: piece by piece where it is text with stamps, else whole.


def _read_session_log(path: Path, sensor: Sensor, gyro_alone: bool, rests: Rests) -> None:
    _add(read_log(path, sensor, gyro_alone).samples, path.name, sensor, rests)


def _read_bare(path: Path, rests: Rests) -> None:
    """Add a standard log outside of a session; its comments state what is known of its sensor."""
    with open_file(path) as file:
        begins = file.read(FIRST_BYTES)
    if FIRST_OF_CURVE.match(begins):
        # An Allan curve is no log, and its columns would be missed in vain
        do = command_line("noise", "--curve", path)
        raise FormatError(f"{path}: its first column is an averaging time, as of an Allan curve, and no log; run `{do}`")
    reader = Reader(path, gyro_alone=True)
    comments = reader.comments
    ranges = [number_in(comments, key) for key in ("gyro_fs_dps", "accel_fs_g")]
    for triad, full_scale in zip((reader.layout.gyro, reader.layout.accel), ranges, strict=True):
        if triad is not None and triad.unit.si is None and full_scale is None:
            do = f"run `{command_line('import', path)}`, and give its folder"
            raise FormatError(f"{path.name} holds registers and no full scale (# gyro_fs_dps=… accel_fs_g=…); {do}")
    first = next(reader.pieces(), None)
    if first is None or first.t_ns is None:
        raise FormatError(f"{path.name}: a header but no samples; was the recording stopped before it began?")
    rate_hz = number_in(comments, "odr_hz") or pace_of(first.t_ns).rate_hz
    sensor = Sensor(comments.get("sensor", UNKNOWN), printable(comments.get("serial", "")), rate_hz, ranges[0] or 0.0, ranges[1] or 0.0)
    # Stamps that are coarser than the samples, or come in bursts, are counted along all of them
    if first.accel is not None and np.diff(first.t_ns).any() and evenly(first.t_ns, 1.0, path.name)[1] is None:
        _stream(path, sensor, rests, bare=True)
        return
    log = read_log(path, sensor, gyro_alone=True)
    rests.remarks += [f"{path.name}: {note}" for note in log.notes]
    _add(log.samples, path.name, sensor, rests)


def _rate_of(samples: Samples, name: str) -> float:
    """Hz, by the stamps.  FormatError where no sensor has such a rate."""
    rate_hz = 1 / samples.period_s
    if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise FormatError(f"{name}: its stamps give {rate_hz:.4g} Hz, which no sensor has; is their unit right?")
    return rate_hz


def _stream(path: Path, sensor: Sensor, rests: Rests, bare: bool = False) -> None:
    """Add a rest log, read once piece by piece; of one outside of a session that moves, its stills."""
    sums: list[RestSums] = []
    waiting: list[Samples] = []

    def add(samples: Samples) -> None:
        if not sums:  # a first piece of one sample shows no rate
            waiting.append(samples)
            samples = joined(waiting)
            if len(samples) < 2:
                return
            rate_hz = _rate_of(samples, path.name)
            rests.require_same(path.name, sensor.model, sensor.serial, rate_hz)
            sums.append(RestSums(rate_hz))
        sums[0].add(samples)

    log = read_rest(path, sensor, add)
    rests.remarks += [f"{path.name}: {note}" for note in log.notes if "temp" not in note]
    _refuse_units(log)
    if (moves := _movement(log)) is None:
        rests.sums += sums
        return
    if not bare:
        raise DataError(f"{path.name}: {moves}; a rest log lies still throughout; cut it there, or name it log*.csv")
    _add_stills(read_log(path, sensor).samples, path.name, rests, moves)


def _add(samples: Samples, name: str, sensor: Sensor, rests: Rests) -> None:
    """Add a log that is in memory: all of it where it lies still throughout, else its stills."""
    log = rest_from_samples(samples, name)
    if len(log) < 2:
        raise DataError(f"{name}: {len(samples)} samples in {samples.duration_s:.3g} s; expected a rest of minutes")
    _refuse_units(log)
    rests.require_same(name, sensor.model, sensor.serial, _rate_of(samples, name))
    if (moves := _movement(log)) is None:
        rests.sums.append(_sums_of(samples, rests.rate_hz))
    elif np.isnan(samples.accel[0]).any():
        raise DataError(f"{name}: no accelerometer, and gravity shows no still, and {moves}; give its log at rest")
    else:
        _add_stills(samples, name, rests, moves)


def _add_stills(samples: Samples, name: str, rests: Rests, moves: str) -> None:
    """Add the stills of a log that moves, each for itself."""
    found = references(find_stills(samples)[0])
    stills = [still for still in found if still.duration_s >= SHORTEST_S and np.linalg.norm(still.gyro_mean) <= TURNING_DPS * DEG]
    seconds = sum(still.duration_s for still in stills)
    taken = f"{len(stills)} stills, {seconds:.0f} s in all, are taken, each for itself" if stills else "it never lies still: left out"
    rests.remarks.append(f"{name}: {moves}; {taken}")
    rests.sums += [_sums_of(samples.between(still.start, still.stop), rests.rate_hz) for still in stills]


def _sums_of(samples: Samples, rate_hz: float) -> RestSums:
    sums = RestSums(rate_hz)
    for start in range(0, len(samples), TOGETHER):
        sums.add(samples.between(start, min(start + TOGETHER, len(samples))))
    return sums


# Does it lie still?


def _refuse_units(log: RestLog) -> None:
    """DataError where an accelerometer at rest does not show gravity: its unit is another.  NaN of a gyroscope alone is not tested."""
    if np.isnan(log.accel).all():
        return
    for finding in check_rest(log):
        if finding.level == "error" and finding.what == "gravity":
            raise DataError(finding.line)


def _movement(log: RestLog) -> str | None:
    """Why a log is no rest: it is turned, or is restless most of the time.  None where it lies still, knocks apart."""
    rate_dps = median_length(log.gyro) / DEG
    if rate_dps > TURNING_DPS:
        return f"it turns at {rate_dps:.0f} dps"
    if not np.isnan(log.accel).all():
        ways = log.accel / np.linalg.norm(log.accel, axis=1)[:, None]
        usual = np.median(ways, axis=0)
        angles = angle_between(ways, usual) / DEG
        # A knock moves single blocks, another attitude many.
        turned_deg = float(np.percentile(angles, 95))
        if turned_deg > TURNED_DEG:
            return f"it was turned by {turned_deg:.0f}° within the log"
    scatter = np.linalg.norm(log.gyro_sd, axis=1)
    if not (there := scatter[scatter > 0]).size:
        return None
    share = float(np.mean(scatter > RESTLESS * np.percentile(there, 25)))
    return f"it is moved for {100 * share:.0f} % of the time" if share > MOVED_SHARE else None
