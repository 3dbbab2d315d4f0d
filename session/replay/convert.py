"""Make a session folder of any program's logs: what was taken for what, and what remains open."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np

from session.base.errors import CalibrationError, FormatError
from session.base.files import MOST_TOML, copy_new, created, folder_whole, read_bytes, read_text, require_empty, write_new
from session.base.names import log_paths
from session.base.numeric import formatted_rows
from session.base.questions import QuestionsError
from session.base.records import Count, Key
from session.base.texts import command_line, comment
from session.base.toml import edited
from session.base.units import EARTH_RATE_RPS, MDPS, NS, TIME, endings
from session.detect.findings import Finding
from session.detect.first_look import check_folder
from session.detect.segments import session_segments
from session.detect.stills import SessionStills
from session.log.config import Accelerometer, Config, Protocol, Sensor, Site, read_config
from session.log.folder import Session, read_session
from session.log.logfile import CALIBRATED, read_log
from session.log.registers import profile_of
from session.log.stamps import FASTEST_HZ, SLOWEST_HZ, fresh, pace_of
from session.log.standard import flags_of
from session.log.written import toml_text
from session.replay.answers import (
    ASSUMED_RANGE,
    sensor_of,
    with_comments,
    with_full_scales,
    with_sensor,
)
from session.replay.clock import GIVEN
from session.replay.dialects import OWN
from session.replay.guesses import Guess, answered, contradicted
from session.replay.interpretation import interpretation, read_as
from session.replay.join import Joined, join
from session.replay.options import AXES, Answers
from session.replay.recognise import UnknownColumnsError
from session.replay.sources import Source, sources_of

# From what is on the card to a session folder: ``session.toml`` and a log that has lost nothing.

#: what a stamp in us leaves behind
US_NS = 1000
#: key of session.toml
EVEN_SIGMA = "even_sigma_ppm"


#: words of notes whose content stands in ``took`` as well
TAKEN = (ASSUMED_RANGE, "is taken for", "are taken for", "read as a table")


@dataclass(frozen=True)
class Imported:
    """Result of ``tinygc.import_log``: a session folder, and what was taken for what.

    folder and log that were written; dialects read; samples; notes on what was repaired, assumed or left out; findings of the first
    look; next: what to run; took: program, columns, units and full scales, clock and rate, a line each; read_as: the units in one line;
    turns, stills: how many it has, None where that is not known; rate_hz.
    """

    schema = "tinygc-replay/2"
    written = ("folder", "log_name", "dialects", "samples", "took", "notes", "findings", "next")
    folder: Path
    log: Path
    dialects: tuple[str, ...]
    samples: Count
    notes: tuple[str, ...]
    findings: tuple[Finding, ...]
    next: tuple[str, ...]
    took: tuple[str, ...] = ()
    read_as: str = ""
    turns: int | None = None
    stills: int | None = None
    rate_hz: float | None = None

    @property
    def headline(self) -> str:
        """Such as ``data/mine: 40 turns, 41 stills, 208 Hz.``."""
        counts = ((self.turns, "turn"), (self.stills, "still"))
        found = [f"{count} {what}{'s' * (count != 1)}" for count, what in counts if count is not None] or [f"{self.samples} samples"]
        return f"{self.folder}: {', '.join((*found, *([f'{self.rate_hz:.4g} Hz'] if self.rate_hz else [])))}."

    @property
    def repairs(self) -> list[str]:
        """The notes whose content is in no line of ``took``: on what was repaired or left out."""
        return [note for note in self.notes if not any(word in note for word in TAKEN)]

    @property
    def log_name(self) -> Annotated[str, Key("log")]:
        """Of its file."""
        return self.log.name

    @cached_property
    def session(self) -> Session:
        """The session, read from its folder."""
        return read_session(self.folder)


def convert(
    paths: Sequence[Path], out: Path, answers: Answers, add: str | None = None, serial: str = "", columns: Sequence[str] = ()
) -> Imported:
    """Make a session folder of one log, or of the two files that hold one.

    ``add`` ("log" or "closure") puts it into a session that is there; columns: a list for each file.  Nothing is left behind where it
    fails.  Raises FormatError and DataError; QuestionsError names every option for what the files do not state.
    """
    if add and not (out / "session.toml").exists():
        raise FormatError(f"{out}: no session to add to; leave --add out to make one")
    if not add:
        require_empty(out, "exists; give --out a new folder, or add to the session there with --add log or --add closure")
    try:
        return _converted(paths, out, answers, add, serial, columns)
    except (QuestionsError, UnknownColumnsError) as cause:
        guess = answered(paths, answers, columns, cause)
    except _Contradicted as found:
        guess = found.guess
    return _converted(paths, out, answers, add, serial, columns, guess)


class _Contradicted(Exception):  # no error: the log is read again
    """Physics contradicts what the log states of its units."""

    def __init__(self, guess: Guess):
        self.guess = guess


def _converted(
    paths: Sequence[Path],
    out: Path,
    answers: Answers,
    add: str | None,
    serial: str,
    columns: Sequence[str],
    guess: Guess | None = None,
) -> Imported:
    """guess: what physics decides of the log's units.  Raises ``_Contradicted`` where there is none, and physics contradicts the log's."""
    known = Guess() if guess is None else guess
    answers = known.answers(answers)
    with sources_of(paths, answers, columns) as sources:
        for source in sources if known.by else ():
            source.layout = known.layout(source.layout)
            in_unit = f"in {answers.time_unit} "
            source.notes = [note.replace(f"{in_unit}{GIVEN}", f"{in_unit}{known.by.get('time', GIVEN)}") for note in source.notes]
        answers = with_comments(answers, sources)
        if add:
            answers = _as_in(read_config(out / "session.toml").sensor, answers)
        answers, assumed = with_sensor(sources, answers)
        joined = join(sources, answers.odr_hz, answers.even)
        if guess is None and not add and (found := contradicted(joined, answers)) is not None:
            raise _Contradicted(found)
        answers, ranges = with_full_scales(sources, joined, answers)
        assumed = (*assumed, *ranges)
        with folder_whole(out) as work:
            samples = len(joined.t_ns)
            log, notes, t_ns = _write_log(sources, joined, work / "log0001.csv", answers)
            none = np.zeros(0)
            joined = replace(joined, t_ns=none, gyro=none, accel=none, temp=None)  # what reads the log again takes as much
            notes = [*notes, *assumed]
            rate_hz, duration_s = float(f"{pace_of(t_ns).rate_hz:.4g}"), float(t_ns[-1] - t_ns[0]) * NS
            del t_ns
            _require_a_sensors_rate(sources[0], rate_hz)
            took, stated = interpretation(sources, joined, answers, assumed, rate_hz, duration_s), read_as(joined, answers, rate_hz)
            if add:
                taken = {path.name.split(".")[0] for path in log_paths(out, add)}
                stem = next(f"{add}{number:04d}" for number in range(1, 10_000) if f"{add}{number:04d}" not in taken)
                name = stem + log.name.removeprefix("log0001")
                log.rename(work / name)
                before = _with_even_sigma(out / "session.toml", joined.even_sigma_ppm)
                write_new(work / "session.toml", before + f"\n# {name}: from {_source(sources)}\n".encode())
            else:
                name = log.name
                serial = serial or sources[0].comments.get("serial", "")
                even = None if joined.even_sigma_ppm is None else float(f"{joined.even_sigma_ppm:.2g}")
                sensor = replace(sensor_of(answers), serial=serial, odr_hz=answers.odr_hz or rate_hz, even_sigma_ppm=even)
                _write_toml(work / "session.toml", sources, sensor, assumed, out)
        dialects = tuple(dict.fromkeys(source.layout.dialect for source in sources))
    findings, turns, stills = first_look_at(out)
    return Imported(
        out, out / name, dialects, samples, tuple(notes), findings, next_steps(out, findings), took, stated, turns, stills, rate_hz
    )


def first_look_at(folder: Path) -> tuple[tuple[Finding, ...], int | None, int | None]:
    """The findings in a new folder, and how many turns and stills it has, where nothing is an error."""
    counts: list[int] = []

    def count(session: Session, found: SessionStills) -> list[Finding]:
        parts = session_segments(session, found)
        counts.extend((sum(segment.accepted for part in parts for segment in part.segments), sum(len(part.stills) for part in parts)))
        return []

    with np.errstate(all="ignore"):  # what is absurd in a log becomes a finding, not a warning of numpy's
        findings = tuple(check_folder(folder, count))
    return findings, *(counts or (None, None))


def _as_in(sensor: Sensor, answers: Answers) -> Answers:
    for key, option in (("gyro_fs_dps", "--gyro-fs"), ("accel_fs_g", "--accel-fs")):
        if getattr(answers, key) not in (None, getattr(sensor, key)):
            raise FormatError(
                f"{option} is {getattr(answers, key):g}, but the session has {getattr(sensor, key):g}; a session has one sensor and range"
            )
    if answers.sensor and profile_of(answers.sensor) is not profile_of(sensor.model):
        raise FormatError(f"--sensor is {answers.sensor}, but the session's is {sensor.model}; a session has one sensor")
    return replace(answers, gyro_fs_dps=sensor.gyro_fs_dps, accel_fs_g=sensor.accel_fs_g, sensor=sensor.model)


def _require_a_sensors_rate(source: Source, rate_hz: float) -> None:
    """FormatError where stamps show a rate that no sensor has: their unit is another."""
    if SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        return
    unit = next((word for word, ns in TIME.items() if ns == source.layout.time_ns), "that unit")
    raise FormatError(
        f"{source.path.name}: read as {unit}, its stamps show {rate_hz:g} Hz, and no sensor has less than {SLOWEST_HZ:g} or more than "
        f"{FASTEST_HZ:g}; is that the unit of its time column? --time-unit s, ms, us or ns"
    )


def _write_log(sources: list[Source], joined: Joined, path: Path, answers: Answers) -> tuple[Path, list[str], np.ndarray]:
    """Our own logs byte for byte, others as numbers in the units of docs/formats.md; the file, notes, and stamps (N,) ns as they are read
    again."""
    notes = list(joined.notes)
    if len(sources) == 1 and not notes and sources[0].path.is_file() and _is_ours(sources[0], answers):
        copy = path.with_name("log0001.csv.gz" if sources[0].path.suffix.lower() == ".gz" else "log0001.csv")
        copy_new(sources[0].path, copy)
        with contextlib.suppress(CalibrationError):  # what stands before its header, perhaps
            read = read_log(copy, sensor_of(answers))
            return copy, list(read.notes), read.samples.t_ns
        copy.unlink()
    frames = {layout.frame for layout in (joined.gyro_layout, joined.accel_layout) if layout.frame}
    notes += [f"axes as logged: {frame}; level need not be z down, gravity shows what is up" for frame in sorted(frames)]
    header, columns, formats = _columns(joined)
    facts = {CALIBRATED: next((source.comments[CALIBRATED] for source in sources if CALIBRATED in source.comments), "")}
    flags = flags_of(facts | ({"stamps": "counted"} if joined.counted else {}))
    columns += [np.ones(len(joined.t_ns), dtype=np.int8)] * len(flags)
    with created(path) as file:
        file.write(f"{','.join([*header, *flags])}\n".encode())
        file.writelines(formatted_rows(columns, formats + ["%d"] * len(flags)))
    as_they_are = len(joined.t_ns) > 1 and fresh(joined.t_ns).all()
    return path, notes, joined.t_ns if as_they_are else read_log(path, sensor_of(answers)).samples.t_ns


def _is_ours(source: Source, answers: Answers) -> bool:
    units = (answers.time_unit, answers.gyro_unit, answers.accel_unit)
    if answers.rows or answers.where:
        return False
    return source.layout.dialect == OWN and answers.gyro_axes == answers.accel_axes == AXES and units == (None, None, None)


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
        if (values % 1).any():
            options = "--gyro-unit dps, mdps or rad/s, --accel-unit g, mg or m/s2"
            raise FormatError(f"registers are whole numbers, but the log has fractions; give its unit: {options}")
        return "", values, "%d"
    for suffix, ours in units.items():
        if ours == si:
            return suffix, values, "%r"
    suffix, ours = next(iter(units.items()))
    return suffix, values * (si / ours), "%.15g"


def _with_even_sigma(path: Path, sigma_ppm: float | None) -> bytes:
    """A session.toml whose logs' rates have this relative sigma, or a larger one of the logs before."""
    if sigma_ppm is None or sigma_ppm <= (read_config(path).sensor.even_sigma_ppm or 0.0):
        return read_bytes(path, MOST_TOML)
    text = read_text(path, MOST_TOML).replace("\r\n", "\n").replace("\r", "\n")
    return edited(text, lambda document: document["sensor"].update({EVEN_SIGMA: float(f"{sigma_ppm:.2g}")})).encode()


def _write_toml(path: Path, sources: Sequence[Source], sensor: Sensor, assumed: Sequence[str], out: Path) -> None:
    """FormatError, in the name of ``out``, for what this tool would not read again: a log's own comments may hold anything."""
    text = toml_text(Config(sensor, Accelerometer(source="none"), Site(), Protocol()))
    remarks = [f"from {_source(sources)}", *(comment(each).replace("=", "_") for each in assumed if ASSUMED_RANGE in each)]
    write_new(path, "".join(f"# {remark}\n" for remark in remarks) + text)
    try:
        read_config(path)
    except FormatError as error:
        raise FormatError(f"{out / path.name} is not written: {str(error).removeprefix(f'{path}: ')}; give the right one") from None


def _source(sources: Sequence[Source]) -> str:
    """For a comment.  A reader of logs takes ``name=value`` in a comment for what the log states of itself: a file's name must not."""
    return comment(", ".join(f"{source.path.name} ({source.layout.dialect})" for source in sources)).replace("=", "_")


def next_steps(out: Path, findings: tuple[Finding, ...]) -> tuple[str, ...]:
    """What to run, and what may be given with it."""
    if any(finding.level == "error" for finding in findings):
        return (command_line("check", out),)
    if read_config(out / "session.toml").site.latitude_deg is not None:
        return (command_line("fit", out),)
    return command_line("fit", out), f"optional: --latitude DEG, which removes the Earth's rotation ({EARTH_RATE_RPS / MDPS:.0f} mdps)"
