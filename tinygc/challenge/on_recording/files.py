"""A recording with other readings, as a session folder: the same session.toml, the logs in the units that they had."""

from __future__ import annotations

import gzip
import shutil
from pathlib import Path

import numpy as np

from session.files.writing import naming, result_folder
from session.log.folder import Session
from session.log.samples import Samples
from session.sensor.registers import RegisterUnits
from tinygc.challenge.on_recording.recording import Steps, steps_of

GZIP_LEVEL = 1


def write_spoilt(session: Session, logs: tuple[Samples, ...], folder: Path) -> None:
    """The session with other samples in its logs; closure runs, which ``explain`` does not read, and results stay behind."""
    with result_folder(folder), naming(folder):
        for name in ("session.toml", "attitudes.csv", "turns.csv"):
            if (session.folder / name).exists():
                shutil.copyfile(session.folder / name, folder / name)
        for number, (log, samples) in enumerate(zip(session.logs, logs, strict=True)):
            comment = " ".join(f"{key}={value}" for key, value in log.comments.items())
            text = (f"# {comment}\n" if comment else "") + _text(samples, steps_of(session, number), _thermometer(session))
            data = text.encode("utf-8")
            (folder / log.path.name).write_bytes(gzip.compress(data, GZIP_LEVEL, mtime=0) if log.path.suffix == ".gz" else data)


def _thermometer(session: Session) -> RegisterUnits | None:
    """Of logs of registers; None where there are none, or their temperature's meaning is not known."""
    if not all(log.raw for log in session.logs):
        return None
    units = session.config.sensor.register_units
    return units if units.thermometer is not None else None


def _text(samples: Samples, steps: Steps, units: RegisterUnits | None) -> str:
    names, formats, columns = ["t_ns"], ["%d"], [samples.t_ns]
    for letter, unit, values, step, raw in (
        ("g", "rps", samples.gyro, steps.gyro, steps.gyro_raw),
        ("a", "mps2", samples.accel, steps.accel, steps.accel_raw),
    ):
        names += [f"{letter}{axis}" + ("" if raw else f"_{unit}") for axis in "xyz"]
        formats += ["%d" if raw else "%.9g"] * 3
        columns += list(np.rint(values / step).astype(int).T if raw else values.T)
    if samples.temp_c is not None:
        raw = steps.gyro_raw and steps.accel_raw and units is not None
        names.append("temp" if raw else "temp_c")
        formats.append("%d" if raw else "%.7g")
        registers = None if units is None else units.temperature_lsb(samples.temp_c, len(samples))
        columns.append(np.rint(registers).astype(int) if raw and registers is not None else samples.temp_c)
    row = ",".join(formats) + "\n"
    return ",".join(names) + "\n" + "".join(row % values for values in zip(*(column.tolist() for column in columns), strict=True))
