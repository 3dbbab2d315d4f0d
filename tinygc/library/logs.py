"""``tinygc.import_log`` and ``tinygc.read_log``: any program's log as a session folder, or as arrays."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from session.base import features
from session.base.errors import CalibrationError, FormatError
from session.base.options import records
from session.base.questions import QuestionsError
from session.log.folder import Session, read_session
from session.replay.convert import Imported as Imported
from session.replay.importing import import_log as import_files
from session.replay.options import Answers, Into, Place
from tinygc.library.arguments import public
from tinygc.library.tables import is_table, write_table

Paths = str | PathLike[str] | Sequence[str | PathLike[str]]


@dataclass(frozen=True, eq=False)
class LogArrays:
    """Result of ``tinygc.read_log``: readings of a gyroscope and an accelerometer, as plain arrays in SI."""

    #: (N,) s, from the first sample on
    t_s: np.ndarray
    #: (N, 3) rad/s
    gyro_rps: np.ndarray
    #: (N, 3) m/s^2
    accel_mps2: np.ndarray
    #: (N,) °C, or None
    temp_c: np.ndarray | None
    #: as stated, or assumed: then a note states it
    gyro_fs_dps: float
    #: as stated, or assumed
    accel_fs_g: float
    #: program, columns, units and full scales, clock and rate, in three lines
    took: tuple[str, ...]
    #: what was repaired, assumed or left out
    notes: tuple[str, ...]
    #: the sensor's model, ``"unknown"`` where neither the log nor the caller states it
    sensor: str
    #: the sensor's serial number, as far as the log states it
    serial: str
    #: Hz, the data rate as stated, or by the stamps
    odr_hz: float
    #: whether there were no stamps, so that ``t_s`` counts samples at ``odr_hz``
    counted: bool
    #: whether the log held registers
    raw: bool
    #: what the log states of itself (``key=value``), as ``Log.comments`` has it
    comments: dict[str, str]

    def __repr__(self) -> str:
        return f"<LogArrays {len(self.t_s)} samples, {self.t_s[-1]:.1f} s>"

    def session(self, **more: Any) -> Session:
        """The session that ``import_log`` makes, of these arrays; more: further arguments of ``Session.from_arrays``."""
        values: dict[str, Any] = {
            "gyro_fs_dps": self.gyro_fs_dps,
            "accel_fs_g": self.accel_fs_g,
            "model": self.sensor,
            "serial": self.serial,
        } | more
        made = public()(Session.from_arrays)(self.t_s, self.gyro_rps, self.accel_mps2, self.temp_c, **values)
        sensor = replace(made.config.sensor, odr_hz=self.odr_hz)
        logs = tuple(replace(log, comments=dict(self.comments), raw=self.raw) for log in made.logs)
        return replace(made, config=replace(made.config, sensor=sensor), logs=logs)


@contextmanager
def _files(data: Any) -> Iterator[list[Path]]:
    """The paths of logs; of a table in memory that of its text."""
    if not is_table(data):
        yield _paths(data)
        return
    with TemporaryDirectory(prefix="table-") as folder:
        path = Path(folder) / "data"
        write_table(data, path)
        yield [path]


def _paths(paths: Paths) -> list[Path]:
    given = [paths] if isinstance(paths, str | PathLike) else list(paths) if isinstance(paths, Sequence) else []
    if not given or not all(isinstance(path, str | PathLike) for path in given):
        raise CalibrationError(f"paths is {paths!r:.80}, expected the path of a log, or of the gyroscope's and the accelerometer's")
    return [Path(fspath(path)) for path in given]


#: options of the command whose keywords are called otherwise
KEYWORDS = {"--gyro-fs": "gyro_fs_dps", "--accel-fs": "accel_fs_g", "--odr": "odr_hz"}


@contextmanager
def asking_for_keywords() -> Iterator[None]:
    """Let questions name keywords instead of the command's options."""
    try:
        yield
    except QuestionsError as requested:
        words = [question.option.split(" ") for question in requested.questions]
        named = [KEYWORDS.get(word[0], word[0].removeprefix("--").replace("-", "_")) + "=" + "".join(word[1:2]) for word in words]
        questions = [replace(question, option=name) for question, name in zip(requested.questions, named, strict=True)]
        raise QuestionsError(requested.file, requested.dialect, questions) from None


def columns_of(columns: Sequence[str] | None) -> tuple[str, ...]:
    """Return what a list of columns, one for each file, states; none where it is left out."""
    return () if columns is None else (columns,) if isinstance(columns, str) else tuple(columns)


#: what features add to it
FURTHER = tuple(features.each("options of import"))


@public(Answers, Into, Place, *FURTHER)
def import_log(
    paths: Paths,
    out: Path | str | None = None,
    *,
    columns: Sequence[str] | None = None,
    header: str | None = None,
    most_memory: int | None = None,
    **answers: Any,
) -> Imported:
    """Make a session folder of any program's log, as the command ``import`` does.

    Parameters
    ----------
    paths : str, Path or sequence of them
        The log; or the gyroscope's and the accelerometer's; or a folder or an archive that holds them.
    out : str or Path, optional
        The session folder to make; named as the log by default.
    columns : str or sequence of str, optional
        Which column is what, ``"t_us=time,gx_dps=wx,…"``; of several files, one for each.
    header : str, optional
        Header line of a port's bytes in text.
    most_memory : int, optional
        Bytes that reading may take; 1 GB, or 20 times what the files take on the disk.

    Returns
    -------
    Imported
        ``folder``, ``session``, ``took``, ``notes``, ``findings``.

    Raises
    ------
    CalibrationError
        For what cannot be read, with the line; for all that the log does not state, with each option.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> log = tinygc.simulate(segments=3, closure_s=0.0, odr_hz=104.0, seed=1).save(folder / "a") / "log0001.csv.gz"
    >>> made = tinygc.import_log(log, folder / "b", gyro_fs_dps=500, accel_fs_g=4)
    >>> made.session.config.sensor.gyro_fs_dps
    500.0

    """
    with asking_for_keywords():
        return import_files(
            _paths(paths),
            None if out is None else Path(out),
            *records(answers, Answers),
            **(vars(*records(answers, Into)) | vars(*records(answers, Place))),
            columns=columns_of(columns),
            header=header,
            further=records(answers, *FURTHER),
            most_memory=most_memory,
        )


@public(Answers)
def read_log(paths: Any, *, columns: Sequence[str] | None = None, **answers: Any) -> LogArrays:
    """Read any program's log as arrays in SI, without a folder.

    Parameters
    ----------
    paths : str, Path or sequence of them, or a table
        The log; or the gyroscope's and the accelerometer's; or a folder or an archive that holds them; or a DataFrame, a dict of arrays,
        an array with named columns, or one whose columns physics shows.
    columns : str or sequence of str, optional
        Which column is what, ``"t_us=time,gx_dps=wx,…"``; of several files, one for each.

    Returns
    -------
    LogArrays
        ``t_s`` (N,) s, ``gyro_rps`` (N, 3) rad/s, ``accel_mps2`` (N, 3) m/s², ``temp_c`` (N,) °C or None; ``session()``.

    Raises
    ------
    CalibrationError
        As ``import_log``.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> folder = tinygc.simulate(segments=3, closure_s=0.0, odr_hz=104.0, seed=1).save(tempfile.mkdtemp())
    >>> log = tinygc.read_log(folder / "log0001.csv.gz", gyro_fs_dps=500, accel_fs_g=4)
    >>> log.gyro_rps.shape == (len(log.t_s), 3)
    True

    """
    with asking_for_keywords(), _files(paths) as files, TemporaryDirectory(prefix="read-log-") as folder:
        try:
            made = import_files(files, Path(folder) / "log", Answers(**answers), columns=columns_of(columns))
            session = read_session(made.folder)
        except CalibrationError as error:
            if folder not in str(error):
                raise
            raise FormatError(str(error).replace(f"{folder}{os.sep}", "")) from None  # a folder that was not given
    if len(session.logs) != 1:
        raise CalibrationError(f"read_log: it makes {len(session.logs)} logs, and arrays are of one; use tinygc.import_log")
    (log,), sensor = session.logs, session.config.sensor
    samples = log.samples
    return LogArrays(
        (samples.t_ns - samples.t_ns[0]) * 1e-9,
        samples.gyro[:],
        samples.accel[:],
        None if samples.temp_c is None else samples.temp_c[:],
        sensor.gyro_fs_dps,
        sensor.accel_fs_g,
        made.took,
        made.notes,
        sensor.model,
        sensor.serial,
        sensor.odr_hz,
        log.counted,
        log.raw,
        log.comments,
    )
