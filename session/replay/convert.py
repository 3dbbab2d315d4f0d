"""Make a session folder of another program's logs, or of a recording's raw bytes."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.bench.decoder import StreamDecoder
from session.bench.frames import cannot_be_told
from session.bench.logwriter import FOREIGN, LogWriter, said_not_logged
from session.bench.rawfile import said_cut
from session.bench.recorder import BLOCK, stream
from session.bench.session_file import ASSUMED, NAME, PATIENCE_S, UNKNOWN, SessionFile
from session.detect.findings import Finding
from session.detect.first_look import check_folder
from session.detect.segments import pace_of
from session.io.config import Sensor, read_config
from session.io.dialects import AXES, Answers, Layout
from session.io.errors import CalibrationError, DataError, FormatError, StorageError
from session.io.files import MB, MOST_TOML, naming, open_file, read_bytes
from session.io.logfile import CALIBRATED, read_log
from session.io.names import log_paths
from session.io.reader import Piece, Reader, counted, evenly, fresh
from session.io.recognise import OWN, flags_of
from session.io.registers import DEFAULT, nearest_name, profile_of, require_profile, require_registers
from session.io.texts import command_line, comment
from session.io.toml import line, setting
from session.io.units import NS_PER_S, TIME, endings

# The sensor of a log, and what to report where it is not stated or not known.


def with_sensor(readers: list[Reader], answers: Answers) -> tuple[Answers, list[str]]:
    """The answers with the sensor, and notes: registers must be some sensor's, numbers in physical units may be anyone's.

    FormatError: registers of a sensor that is not known, or of a foreign log that does not name it.
    """
    registers = any(unit.si is None for reader in readers for _, _, unit in reader.layout.kinds)
    if answers.sensor:
        if registers:
            require_profile(answers.sensor)
        if profile_of(answers.sensor) is not None:
            return answers, []
        near = nearest_name(answers.sensor)
        note = f"{answers.sensor} is no sensor that is known{f' (is {near} meant?)' if near else ''}"
        return answers, [f"{note}: it has no yardstick (`calibrate.py sensors` lists those that have one)"]
    if not registers:
        return answers, []
    if any(reader.layout.dialect != OWN for reader in readers):
        named = " and ".join(reader.path.name for reader in readers)
        raise FormatError(f"{named} holds registers and does not name the sensor; give --sensor NAME (`calibrate.py sensors` lists them)")
    return replace(answers, sensor=DEFAULT), [ASSUMED]


# One log from one file, or from one for the gyroscope and one for the accelerometer, joined on time.

#: beyond this many of its own periods a second file's neighbours are too far apart to read between them
WIDEST = 3.5
#: all of which are held at once: two days at 208 Hz
MOST_ROWS = 40_000_000
#: of notes on stamps that are none
COUNTED = "samples were counted at"


@dataclass(frozen=True, eq=False)
class Joined:
    """t_ns (N,); gyro, accel (N, 3) and temp (N,) as written, each with the layout of the file it is from (temp may be None); counted:
    whether there were no stamps, or none to go by, so that samples were counted at a rate that was given."""

    t_ns: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    temp: np.ndarray | None
    gyro_layout: Layout
    accel_layout: Layout
    temp_layout: Layout | None
    notes: tuple[str, ...]
    counted: bool = False


def join(readers: list[Reader], odr_hz: float | None) -> Joined:
    """Raises FormatError where the files do not hold one gyroscope and one accelerometer, DataError where their times do not meet."""
    notes: list[str] = []
    whole = [(reader, _whole(reader, odr_hz, notes)) for reader in readers]
    gyro_reader, gyro = _only(whole, "gyro", "gyroscope")
    accel_reader, accel = _only(whole, "accel", "accelerometer")
    gyro_ns, accel_ns, rate, force = gyro.t_ns, accel.t_ns, gyro.gyro, accel.accel
    assert gyro_ns is not None and accel_ns is not None  # noqa: PT018  # ``_whole`` gives stamps to what has none
    assert rate is not None and force is not None  # noqa: PT018  # ``_only`` has looked
    keep = np.ones(len(gyro_ns), dtype=bool)
    if accel_reader is not gyro_reader:
        force, keep = _at(gyro_ns, accel_ns, force)
        notes.append(_joined_note(gyro_ns, accel_ns, keep))
        if not keep.any():
            raise DataError(f"{gyro_reader.path.name} and {accel_reader.path.name} share no time; are they of one recording, on one clock?")
    temps = [(reader, piece) for reader, piece in whole if piece.temp is not None]
    # The gyro's own temperature before any other's.
    temp_reader, temp = next((entry for entry in temps if entry[0] is gyro_reader), temps[0] if temps else (None, None))
    values = None if temp is None else temp.temp
    if temp is not None and values is not None and temp.t_ns is not None and temp_reader is not gyro_reader:
        values = np.interp(gyro_ns, temp.t_ns, values)
    return Joined(
        gyro_ns[keep],
        rate[keep],
        force[keep],
        None if values is None else values[keep],
        gyro_reader.layout,
        accel_reader.layout,
        None if temp_reader is None else temp_reader.layout,
        tuple(notes),
        any(COUNTED in note for note in notes),
    )


def _whole(reader: Reader, odr_hz: float | None, notes: list[str]) -> Piece:
    pieces, rows = [], 0
    name = reader.path.name
    for piece in reader.pieces():
        pieces.append(piece)
        rows += len(next(part for part in (piece.gyro, piece.accel, piece.temp) if part is not None))
        if rows > MOST_ROWS:
            raise FormatError(f"{name}: more than {MOST_ROWS} rows; a log of a table has hours, cut out what belongs to it")
    notes += [f"{name}: {note}" for note in reader.notes]
    if reader.wraps:
        notes.append(f"{name}: the time counter came round {reader.wraps}x: unrolled")
    if not pieces:
        raise FormatError(f"{name}: a header but no samples; was the recording stopped before it began?")
    columns = [
        None if getattr(pieces[0], part) is None else np.concatenate([getattr(piece, part) for piece in pieces])
        for part in ("t_ns", "gyro", "accel", "temp")
    ]
    whole = Piece(*columns)
    if whole.t_ns is None:
        if odr_hz is None:  # of a file with neither sensor: ``recognise`` requires it of the others
            raise FormatError(f"{name}: it has no time stamps; give the true data rate, --odr HZ")
        rows = next(len(part) for part in (whole.gyro, whole.accel, whole.temp) if part is not None)
        notes.append(f"{name}: no stamps: {COUNTED} {odr_hz:g} Hz")
        return Piece(counted(rows, odr_hz), *columns[1:])
    stamps, note = evenly(whole.t_ns, odr_hz, name)
    if note:
        notes.append(f"{name}: {note}")
    return Piece(stamps, *columns[1:])


def _only(whole: list[tuple[Reader, Piece]], part: str, called: str) -> tuple[Reader, Piece]:
    there = [(reader, piece) for reader, piece in whole if getattr(piece, part) is not None]
    if len(there) == 1:
        return there[0]
    if there:
        raise FormatError(f"{' and '.join(reader.path.name for reader, _ in there)} both hold a {called}; give the files of one sensor")
    named = ", ".join(reader.path.name for reader, _ in whole)
    raise FormatError(f"{named}: no {called}; give its file as well (this log needs the gyroscope's and the accelerometer's)")


def _at(t_ns: np.ndarray, there_ns: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """values (M, 3) at the moments t_ns, straight between neighbours, and where that can be trusted."""
    later = fresh(there_ns)
    there_ns, values = there_ns[later], values[later]
    if len(there_ns) < 2:
        return np.zeros((len(t_ns), 3)), np.zeros(len(t_ns), dtype=bool)
    after = np.clip(np.searchsorted(there_ns, t_ns), 1, len(there_ns) - 1)
    gap = there_ns[after] - there_ns[after - 1]
    part = ((t_ns - there_ns[after - 1]) / gap)[:, None]
    # On the stamp itself the value must be the value, not nearly.
    between = np.where(
        part >= 1, values[after], np.where(part <= 0, values[after - 1], values[after - 1] * (1 - part) + values[after] * part)
    )
    inside = (t_ns >= there_ns[0]) & (t_ns <= there_ns[-1])
    near = (gap <= WIDEST * np.median(np.diff(there_ns))) | (part[:, 0] == 0) | (part[:, 0] == 1)
    return between, inside & near


def _joined_note(gyro_ns: np.ndarray, accel_ns: np.ndarray, keep: np.ndarray) -> str:
    rates = [NS_PER_S / np.median(np.diff(t)[np.diff(t) > 0]) if len(t) > 2 and np.diff(t).any() else np.nan for t in (gyro_ns, accel_ns)]
    text = f"joined on time: gyroscope at {rates[0]:.4g} Hz, accelerometer at {rates[1]:.4g} Hz"
    if not np.isin(gyro_ns[keep], accel_ns).all():
        text += ", read between its samples"
    lost = np.count_nonzero(~keep)
    return text + (f"; {lost} samples of the gyroscope without accelerometer samples are left out" if lost else "")


# From what is on the card to a session folder: ``session.toml`` and a log that has lost nothing.

#: what a stamp in us leaves behind
US_NS = 1000
#: the data rates of session.toml (docs/formats.md): any sensor's, with room
SLOWEST_HZ, FASTEST_HZ = 0.1, 50_000.0


@dataclass(frozen=True)
class Converted:
    """folder and log that were written; dialects read; samples; notes on what was repaired, assumed or left out; findings of the first
    look; next: what to run."""

    folder: Path
    log: Path
    dialects: tuple[str, ...]
    samples: int
    notes: tuple[str, ...]
    findings: tuple[Finding, ...]
    next: tuple[str, ...]


def convert(paths: list[Path], out: Path, answers: Answers, add: str | None = None, serial: str = "") -> Converted:
    """Make a session folder of one log, or of the two files that hold one.

    ``add`` ("log" or "closure") puts it into a session that is there.  Nothing is left behind where it fails.
    Raises FormatError and DataError; the message names the option for what the files do not state.
    """
    _check_out(out, add)
    readers = [Reader(path, answers) for path in paths]
    answers = _with_comments(answers, readers)
    if add:
        sensor = read_config(out / "session.toml").sensor
        answers = _as_in(sensor, answers)
    _require_full_scales(readers, answers)
    answers, assumed = with_sensor(readers, answers)
    missing = [path.parent for path in [out, *out.parents] if not path.parent.exists()]
    with naming(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    try:
        with naming(out):
            log, notes, samples = _write_log(readers, work / "log0001.csv", answers)
        notes = [*notes, *assumed]
        rate_hz = float(f"{pace_of(read_log(log, _sensor(answers)).samples.t_ns).rate_hz:.4g}")
        _require_a_sensors_rate(readers[0], rate_hz)
        if add:
            name = _next_name(out, add) + log.name.removeprefix("log0001")
            log.replace(out / name)
            with naming(out), (out / "session.toml").open("a", encoding="utf-8") as file:
                file.write(f"\n# {name}: from {_source(readers)}\n")
        else:
            odr_hz = answers.odr_hz or rate_hz
            with naming(out):
                _write_toml(work / "session.toml", _toml(readers, odr_hz, answers, serial), out)
            work.chmod(0o755)
            name = log.name
            if out.exists():
                out.rmdir()  # it is empty
            work.replace(out)
    finally:
        shutil.rmtree(work, ignore_errors=True)
        for path in missing:
            with contextlib.suppress(OSError):
                path.rmdir()
    dialects = tuple(dict.fromkeys(reader.layout.dialect for reader in readers))
    with np.errstate(all="ignore"):  # what is absurd in a log becomes a finding, not a warning of numpy's
        findings = tuple(check_folder(out))
    return Converted(out, out / name, dialects, samples, tuple(notes), findings, _next(out, findings))


def _check_out(out: Path, add: str | None) -> None:
    if add and not (out / "session.toml").exists():
        raise FormatError(f"{out}: no session to add to; leave --add out to make one")
    if not add and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FormatError(f"{out}: exists; give --out a new folder, or add to the session there with --add log or --add closure")


def _with_comments(answers: Answers, readers: list[Reader]) -> Answers:
    """What a log's own comments say (``# gyro_fs_dps=500 accel_fs_g=4``), unless the person says otherwise."""
    stated: dict[str, float] = {}
    for reader in readers:
        for key in ("gyro_fs_dps", "accel_fs_g", "odr_hz"):
            with contextlib.suppress(KeyError, ValueError):
                stated[key] = float(reader.comments[key])
    return replace(
        answers,
        gyro_fs_dps=stated.get("gyro_fs_dps") if answers.gyro_fs_dps is None else answers.gyro_fs_dps,
        accel_fs_g=stated.get("accel_fs_g") if answers.accel_fs_g is None else answers.accel_fs_g,
        odr_hz=stated.get("odr_hz") if answers.odr_hz is None else answers.odr_hz,
        sensor=answers.sensor or next((reader.comments["sensor"] for reader in readers if "sensor" in reader.comments), None),
    )


def _as_in(sensor: Sensor, answers: Answers) -> Answers:
    for key, option in (("gyro_fs_dps", "--gyro-fs"), ("accel_fs_g", "--accel-fs")):
        if getattr(answers, key) not in (None, getattr(sensor, key)):
            raise FormatError(
                f"{option} is {getattr(answers, key):g}, but the session has {getattr(sensor, key):g}; a session has one sensor and range"
            )
    if answers.sensor and profile_of(answers.sensor) is not profile_of(sensor.model):
        raise FormatError(f"--sensor is {answers.sensor}, but the session's is {sensor.model}; a session has one sensor")
    return replace(answers, gyro_fs_dps=sensor.gyro_fs_dps, accel_fs_g=sensor.accel_fs_g, sensor=sensor.model)


def _require_full_scales(readers: list[Reader], answers: Answers) -> None:
    options = [option for option, value in (("--gyro-fs DPS", answers.gyro_fs_dps), ("--accel-fs G", answers.accel_fs_g)) if value is None]
    if options:
        names = " and ".join(dict.fromkeys(reader.layout.dialect for reader in readers))
        what = "full scale" if len(options) == 1 else "full scales"
        raise FormatError(f"{readers[0].path.name} ({names}) does not say the {what} that the sensor was set to; give {' '.join(options)}")


def _require_a_sensors_rate(reader: Reader, rate_hz: float) -> None:
    """FormatError where stamps say a rate that no sensor has: their unit is another."""
    if SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        return
    unit = next((word for word, ns in TIME.items() if ns == reader.layout.time_ns), "that unit")
    raise FormatError(
        f"{reader.path.name}: read as {unit}, its stamps say {rate_hz:g} Hz, and no sensor has less than {SLOWEST_HZ:g} or more than "
        f"{FASTEST_HZ:g}; is that the unit of its time column? --time-unit s, ms, us or ns"
    )


def _write_log(readers: list[Reader], path: Path, answers: Answers) -> tuple[Path, list[str], int]:
    """Our own logs byte for byte, others as numbers in the units of docs/formats.md; the file, notes, and how many samples."""
    joined = join(readers, answers.odr_hz)
    notes = list(joined.notes)
    if len(readers) == 1 and not notes and readers[0].path.is_file() and _is_ours(readers[0], answers):
        copy = path.with_name("log0001.csv.gz" if readers[0].path.suffix.lower() == ".gz" else "log0001.csv")
        shutil.copyfile(readers[0].path, copy)
        with contextlib.suppress(CalibrationError):  # what stands before its header, perhaps
            return copy, list(read_log(copy, _sensor(answers)).notes), len(joined.t_ns)
        copy.unlink()
    frames = {layout.frame for layout in (joined.gyro_layout, joined.accel_layout) if layout.frame}
    notes += [f"axes as logged: {frame}; level need not be z down, gravity shows what is up" for frame in sorted(frames)]
    header, columns, formats = _columns(joined)
    said = {CALIBRATED: next((reader.comments[CALIBRATED] for reader in readers if CALIBRATED in reader.comments), "")}
    flags = flags_of(said | ({"stamps": "counted"} if joined.counted else {}))
    row = ",".join([*formats, *["1"] * len(flags)])
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"{','.join([*header, *flags])}\n")
        for start in range(0, len(joined.t_ns), 1 << 15):
            part = [column[start : start + (1 << 15)].tolist() for column in columns]
            file.write("\n".join(map(row.__mod__, zip(*part, strict=True))) + "\n")
    return path, notes, len(joined.t_ns)


def _is_ours(reader: Reader, answers: Answers) -> bool:
    units = (answers.time_unit, answers.gyro_unit, answers.accel_unit)
    if answers.rows or answers.where:
        return False
    return reader.layout.dialect == OWN and answers.gyro_axes == answers.accel_axes == AXES and units == (None, None, None)


def _sensor(answers: Answers) -> Sensor:
    assert answers.gyro_fs_dps is not None and answers.accel_fs_g is not None  # noqa: PT018  # ``_require_full_scales`` has checked
    return Sensor(answers.sensor or UNKNOWN, "", 1.0, answers.gyro_fs_dps, answers.accel_fs_g)


def _columns(joined: Joined) -> tuple[list[str], list[np.ndarray], list[str]]:
    """Names, values and how each is written: as it was, or to 15 digits, which no decimal of a log exceeds, after a change of unit."""
    in_us = not (joined.t_ns % US_NS).any()
    header, columns, formats = ["t_us" if in_us else "t_ns"], [joined.t_ns // US_NS if in_us else joined.t_ns], ["%d"]
    gyro, accel = joined.gyro_layout.gyro, joined.accel_layout.accel
    assert gyro is not None and accel is not None  # noqa: PT018  # ``join`` chose the files that have them
    for letter, values, unit, units in (("g", joined.gyro, gyro.unit, endings("gyro")), ("a", joined.accel, accel.unit, endings("accel"))):
        suffix, values, written = _in_our_unit(values, unit.si, {ending: each.si for ending, each in units.items() if each.si is not None})
        header += [f"{letter}{axis}{suffix}" for axis in "xyz"]
        columns += list(values.T)
        formats += [written] * 3
    if joined.temp is not None:
        assert joined.temp_layout is not None and joined.temp_layout.temp_unit is not None  # noqa: PT018  # of the file it is from
        raw = joined.temp_layout.temp_unit.si is None
        header.append("temp" if raw else "temp_c")
        columns.append(np.rint(joined.temp) if raw else joined.temp)
        formats.append("%d" if raw else "%r")
    return header, columns, formats


def _in_our_unit(values: np.ndarray, si: float | None, units: dict[str, float]) -> tuple[str, np.ndarray, str]:
    """The written numbers in the unit of ours that changes them least: not at all, or by a factor."""
    if si is None:
        require_registers(values)
        return "", values, "%d"
    for suffix, ours in units.items():
        if ours == si:
            return suffix, values, "%r"
    suffix, ours = next(iter(units.items()))
    return suffix, values * (si / ours), "%.15g"


def _next_name(folder: Path, stem: str) -> str:
    taken = {path.name.split(".")[0] for path in log_paths(folder, stem)}
    return next(f"{stem}{number:04d}" for number in range(1, 10_000) if f"{stem}{number:04d}" not in taken)


def _toml(readers: list[Reader], odr_hz: float, answers: Answers, serial: str) -> str:
    assert answers.gyro_fs_dps is not None and answers.accel_fs_g is not None  # noqa: PT018  # ``_require_full_scales`` has checked
    model, serial = answers.sensor or UNKNOWN, serial or readers[0].comments.get("serial", "")
    return f"""\
# from {_source(readers)}
schema = "tinygc-session/1"

[sensor]
{line("model", model)}{line("serial", serial)}{line("odr_hz", odr_hz)}\
{line("gyro_fs_dps", setting(answers.gyro_fs_dps))}{line("accel_fs_g", setting(answers.accel_fs_g))}\
# gyro_bias_instability_dph =  # deg/h, data sheet; without it, it is estimated from the recording
# gyro_noise_mdps_rthz =       # one-sided, data sheet; what `check` holds the noise against

# Fill in what is known: what is missing here is error in the calibration.
# [accelerometer]  # pre-calibration: a = matrix @ (measured_mps2 - bias_mps2)
# matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
# bias_mps2 = [0, 0, 0]
# [site]
# latitude_deg = 0.0
# gravity_mps2 = 9.80665
"""


def _write_toml(path: Path, text: str, out: Path) -> None:
    """FormatError, in the name of ``out``, for what this tool would not read again: a log's own comments may say anything."""
    path.write_text(text, encoding="utf-8")
    try:
        read_config(path)
    except FormatError as error:
        raise FormatError(f"{out / path.name} is not written: {str(error).removeprefix(f'{path}: ')}; give the right one") from None


def _source(readers: list[Reader]) -> str:
    """For a comment.  A reader of logs takes ``name=value`` in a comment for what the log says of itself: a file's name must not."""
    return comment(", ".join(f"{reader.path.name} ({reader.layout.dialect})" for reader in readers)).replace("=", "_")


def _next(out: Path, findings: tuple[Finding, ...]) -> tuple[str, ...]:
    look = command_line("check", out)
    if any(finding.level == "error" for finding in findings):
        return (look,)
    return look, f"fill in [accelerometer] and [site] in {out / 'session.toml'}", command_line("fit", out)


# A session folder from a raw file: the logs that a recording made, or would have made, from the same bytes.

SUFFIX = ".bin"
#: bytes without a sample: three hours of a port that listens at a wrong speed
MOST_SILENT = 128 * MB


def is_raw(path: Path) -> bool:
    """Whether a file is what a port gave, rather than a log: by its name."""
    return path.suffix.lower() == SUFFIX


def convert_raw(
    raw_path: Path,
    out: Path,
    odr_hz: float | None = None,
    gyro_fs_dps: float | None = None,
    accel_fs_g: float | None = None,
    sensor: str | None = None,
    header: str | None = None,
) -> Converted:
    """Make a session folder of a raw file; session.toml is the one in its folder, or is made from the board's data and the arguments.

    Nothing is left behind where it fails.  Raises FormatError and StorageError.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FormatError(f"{out}: exists; give --out a new folder")
    open_file(raw_path).close()  # before anything is made
    missing = [path for path in (out, *out.parents) if not path.exists()]
    decoder, logs = StreamDecoder(header), LogWriter(out)
    try:
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(f"{out}: {error.strerror or error}; give --out another folder") from None
        silent, samples = 0, 0
        for _ in stream(raw_path, decoder, logs):
            silent, samples = silent + 1 if decoder.samples == samples else 0, decoder.samples
            if silent * BLOCK > MOST_SILENT:
                raise FormatError(f"{raw_path}: no sample among {MOST_SILENT} bytes, behind {samples} samples; cut the file there")
        logs.write(decoder.finish())
        logs.close()
        own = [path for path in logs.paths if not path.name.startswith(FOREIGN)]
        if not own:
            raise FormatError(
                f"{raw_path}: no samples among {raw_path.stat().st_size} bytes ({decoder.garbage} are neither frame nor line); "
                "text in physical units that does not say its header needs --header t_us,gx_dps,…"
            )
        with naming(out):
            assumed = _configure(raw_path, out, decoder, logs, odr_hz, gyro_fs_dps, accel_fs_g, sensor)
    except (CalibrationError, OSError):
        for path in [*logs.paths, out / NAME]:
            path.unlink(missing_ok=True)
        for path in missing:
            with contextlib.suppress(OSError):
                path.rmdir()
        raise
    notes = [f"{path.name} written" for path in logs.paths[1:]]
    counts = {
        "samples lost": decoder.lost,
        "frames with a bad CRC": decoder.crc_errors,
        "bytes of garbage": decoder.garbage,
        "samples left out as implausible": decoder.implausible,
        "resets": decoder.resets,
    }
    notes += [f"{count} {what}" for what, count in counts.items() if count]
    if decoder.crc_errors:
        notes.append(f"of {decoder.crc_errors} damaged frames {cannot_be_told(decoder.crc_errors)}")
    if logs.not_logged:
        notes.append(said_not_logged(logs.not_logged, logs.not_logged_starts))
    notes += [words] if (words := said_cut(raw_path)) else []
    notes += [ASSUMED] * assumed
    next_steps = (command_line("check", out), command_line("fit", out))
    return Converted(out, own[0], ("a port's raw bytes",), decoder.samples, tuple(notes), tuple(check_folder(out)), next_steps)


def _configure(
    raw_path: Path,
    out: Path,
    decoder: StreamDecoder,
    logs: LogWriter,
    odr_hz: float | None,
    gyro_fs_dps: float | None,
    accel_fs_g: float | None,
    sensor: str | None,
) -> bool:
    """Write session.toml; whether its sensor is only assumed."""
    beside = raw_path.with_name(NAME)
    if beside.exists():
        (out / NAME).write_bytes(read_bytes(beside, MOST_TOML))
        return False
    rate_hz = odr_hz or (None if decoder.info else decoder.measured_odr_hz)
    file = SessionFile(out, None, rate_hz, gyro_fs_dps, accel_fs_g, sensor)
    if file.configure(decoder.info, PATIENCE_S, bool(logs.physical), logs.board) is None:
        raise FormatError(
            f"{raw_path}: the board does not say its ranges, and no {NAME} lies in its folder; give --gyro-fs DPS --accel-fs G"
        )
    return file.assumed
