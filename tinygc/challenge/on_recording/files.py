"""A recording with other readings, as a session folder: the same session.toml, the logs in the units that they had."""

from __future__ import annotations

import gzip
import shutil
from pathlib import Path

import numpy as np

from session.files.writing import naming, result_folder
from session.log.folder import Session
from session.log.samples import Samples
from session.sensor.registers import TEMP_AT_ZERO_C, TEMP_LSB_PER_C
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
            text = (f"# {comment}\n" if comment else "") + _text(samples, steps_of(session, number))
            data = text.encode("utf-8")
            (folder / log.path.name).write_bytes(gzip.compress(data, GZIP_LEVEL, mtime=0) if log.path.suffix == ".gz" else data)


def _text(samples: Samples, steps: Steps) -> str:
    names, formats, columns = ["t_ns"], ["%d"], [samples.t_ns]
    for letter, unit, values, step, raw in (
        ("g", "rps", samples.gyro, steps.gyro, steps.gyro_raw),
        ("a", "mps2", samples.accel, steps.accel, steps.accel_raw),
    ):
        names += [f"{letter}{axis}" + ("" if raw else f"_{unit}") for axis in "xyz"]
        formats += ["%d" if raw else "%.9g"] * 3
        columns += list(np.rint(values / step).astype(int).T if raw else values.T)
    if samples.temp_c is not None:
        raw = steps.gyro_raw and steps.accel_raw
        names.append("temp" if raw else "temp_c")
        formats.append("%d" if raw else "%.7g")
        columns.append(np.rint((samples.temp_c - TEMP_AT_ZERO_C) * TEMP_LSB_PER_C).astype(int) if raw else samples.temp_c)
    row = ",".join(formats) + "\n"
    return ",".join(names) + "\n" + "".join(row % values for values in zip(*(column.tolist() for column in columns), strict=True))
