"""Session folders of a gyroscope alone: ``reference = "turns"``, logs that need no accelerometer, and ``turns.csv``.

Other programs' recordings become such a folder through ``write_turn_session``.
"""

from __future__ import annotations

import gzip
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import DataError, FormatError
from session.base.files import folder_whole, require_empty, require_file, write_new
from session.base.names import log_paths
from session.base.progress import no_report
from session.base.texts import printable
from session.base.toml import Note, section_text, setting, toml_line
from session.base.units import DEG, NS_PER_S
from session.log.arrays import USUAL_DPS
from session.log.config import SCHEMA, read_config
from session.log.folder import Session, read_logs
from session.log.logfile import COLUMNS, LOG, NAME, KnownTurn, read_known_turns
from tinygc.features.turns import TURNS

HEADER = "t_ns,gx_rps,gy_rps,gz_rps"


def read_turn_session(folder: Path | str) -> Session:
    """Read a folder whose reference is turns of known angle; the specific force of its samples is NaN.

    Closure runs, rest logs and dial readings next to the logs are not read.  Raises FormatError or DataError, which name file and line.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FormatError(f"{folder}: {'that is a file' if folder.exists() else 'not found'}; expected session.toml, log*.csv and {NAME}")
    config = read_config(folder / "session.toml")
    if config.protocol.reference != TURNS:
        raise FormatError(f'{folder}: protocol.reference is "{config.protocol.reference}", expected "{TURNS}" of a gyroscope alone')
    if not (paths := log_paths(folder, "log")):
        raise FormatError(f"{folder}: no log; expected log*.csv or log*.csv.gz next to session.toml")
    if not (folder / NAME).exists():
        raise FormatError(f"{folder / NAME}: not found; a gyroscope alone is calibrated by the angles that it states: {','.join(COLUMNS)}")
    for path in (*paths, folder / NAME):
        require_file(path)
    turns = read_known_turns(folder / NAME, [path.name for path in paths])
    for turn in turns:
        sensor_axis(turn)
    return replace(read_logs(folder, config, paths, (), (), no_report, gyro_alone=True), turns=turns)


def sensor_axis(turn: KnownTurn) -> tuple[int, int]:
    """The sensor's axis that a stated turn is about, 0, 1 or 2, and its sense, 1 or -1, by the right-hand rule.

    Raises FormatError for an oblique axis: its turn shows no axis' own scale.
    """
    axis = int(np.argmax(np.abs(turn.axis)))
    if abs(turn.axis[axis]) < np.cos(10 * DEG):
        raise FormatError(f"{NAME}: {turn.name} is about {turn.words}; of a gyroscope alone a turn is about x, y or z, within 10 deg")
    return axis, int(np.sign(turn.axis[axis] * turn.angle_rad))


@dataclass(frozen=True, eq=False)
class GyroLog:
    """A log to be written: its name, without an ending; t_ns (N,) int64, increasing; gyro_rps (N, 3) rad/s, body axes, as measured."""

    name: str
    t_ns: np.ndarray
    gyro_rps: np.ndarray


def write_turn_session(
    out: Path,
    logs: Sequence[GyroLog],
    turns: Sequence[KnownTurn],
    *,
    model: str = "unknown",
    serial: str = "",
    gyro_fs_dps: float | None = None,
    notes: Mapping[str, Note] | None = None,
) -> Path:
    """Write a session folder of a gyroscope alone into a folder that is new or empty, and return it.

    gyro_fs_dps: the smallest usual full scale that holds all rates where it is not given; notes: for ``[notes]``.  ``turns`` name their
    logs as they are named here.  Raises FormatError or DataError, as reading it again would, and leaves nothing behind then.
    """
    require_empty(out, "is there, and is no empty folder; choose another one")
    _refuse(logs)
    names = [f"{log.name}.csv.gz" for log in logs]
    sensor = {"model": model, "serial": serial, "odr_hz": float(f"{_rate_hz(logs):.4g}")}
    sensor["gyro_fs_dps"] = setting(gyro_fs_dps or _full_scale(logs))
    sections: dict[str, Mapping[str, Any]] = {"sensor": sensor, "protocol": {"reference": TURNS}, "notes": notes or {}}
    toml = toml_line("schema", SCHEMA) + "".join(section_text(name, table) for name, table in sections.items())
    files = {"session.toml": toml.encode()}
    for name, log in zip(names, logs, strict=True):
        files[name] = gzip.compress("\n".join([HEADER, *_rows(log), ""]).encode(), compresslevel=6, mtime=0)
    rows = [f"{t.turn},{t.words},{t.angle_rad / DEG:.10g},{t.sigma_rad / DEG:.10g},{t.log or ''}" for t in turns]
    files[NAME] = "\n".join([",".join((*COLUMNS, LOG)), *rows, ""]).encode()
    with folder_whole(out) as work:
        for name, data in files.items():
            write_new(work / name, data)
        read_turn_session(work)
    return out


def _refuse(logs: Sequence[GyroLog]) -> None:
    for log in logs:
        if not log.name.startswith("log") or printable(log.name) != log.name or Path(log.name).name != log.name:
            raise DataError(f"log {log.name!r}: expected a name that begins with log, as log0001")
        if len(log.t_ns) < 2 or log.gyro_rps.shape != (len(log.t_ns), 3):
            raise DataError(f"{log.name}: {len(log.t_ns)} stamps and rates {log.gyro_rps.shape}, expected (N,) and (N, 3), N above 1")
        if (back := np.diff(log.t_ns) < 0).any():
            raise DataError(f"{log.name}: the stamp of row {int(np.argmax(back)) + 1}, counted from 0, goes backward; split the log there")
    if not logs or len({log.name for log in logs}) != len(logs):
        raise DataError("no log, or two of one name; expected logs with names of their own")


def _rate_hz(logs: Sequence[GyroLog]) -> float:
    return float(np.median([NS_PER_S * (len(log.t_ns) - 1) / max(int(log.t_ns[-1] - log.t_ns[0]), 1) for log in logs]))


def _full_scale(logs: Sequence[GyroLog]) -> float:
    largest = max(float(np.abs(log.gyro_rps).max()) for log in logs) / DEG
    return next((float(fs) for fs in USUAL_DPS if fs > largest), float(np.ceil(largest)) + 1)


def _rows(log: GyroLog) -> Iterator[str]:
    for t, row in zip(log.t_ns.tolist(), log.gyro_rps.tolist(), strict=True):
        yield f"{t},{','.join(map(repr, row))}"
