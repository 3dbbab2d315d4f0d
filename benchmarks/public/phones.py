"""Two telephones on a stepper's table (ShallDa's gyroscope_calibration): one turn of known angle a file, and no accelerometer.

``Rotation/SPEED/ANGLE/PHONE_AXISG_SPEED_ANGLE_N.csv`` holds the time in s and the rates in rad/s, both as the telephone's app wrote them,
to two decimals.  The S10's files have semicolons, decimal commas, and stamps in bursts.  ANGLE is in degrees; ``1800i`` are five turns of
360 deg with rests between them.  All turns are positive by the right-hand rule.  ``Statique`` is at rest.

Most files of the iPhone end twice: behind the last row stand once more the samples of the last second, with stamps that begin again one
second earlier.  They are left out.  Who integrates over that step takes off a second of turning where the table still turned then: 360 deg
become 300.

The three ``ZM`` files hold specific forces near zero, since the app had taken gravity off: no session with an accelerometer can be made of
them.  Their rates and their stamps, of a clock, are used.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.units import DEG, NS_PER_S
from session.log.logfile import KnownTurn
from tinygc.features.turns.folder import GyroLog, write_turn_session

from .writing import AGAIN, found, text_of

NAME = re.compile(r"(?P<phone>\w+?)_(?P<axis>[XYZ])[GM]_(?P<speed>[\d.]+)_(?P<angle>\d+)(?P<each>i?)_(?P<number>\d+)\.csv")
#: the authors do not say how well the table stops: half a step of a usual motor of 1.8 deg as the width of a rectangular distribution
STOP_SIGMA_DEG = 0.26
#: a turn of 1800i
EACH_DEG = 360
#: of the last samples that stand there once more
AGAIN_S = 1.1


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/IphoneSE3G`` and ``out/SamsungS10``, a session folder of a gyroscope alone for each telephone; ``given`` means nothing."""
    phones: dict[str, list[tuple[re.Match[str], Path]]] = {}
    for path in found(source, "*/Rotation/*/*/*.csv"):
        if match := NAME.fullmatch(path.name):
            phones.setdefault(match["phone"], []).append((match, path))
    for phone, files in phones.items():
        logs, turns, again = [], [], 0
        for match, path in files:
            t_ns, gyro, repeated = read_rates(path)
            again += repeated
            name = "log_" + path.stem.removeprefix(f"{phone}_").replace(".", "p")
            logs.append(GyroLog(name, t_ns, gyro))
            angle_deg = int(match["angle"])
            count, angle_deg = (angle_deg // EACH_DEG, EACH_DEG) if match["each"] else (1, angle_deg)
            axis = match["axis"].lower()
            unit = np.eye(3)["xyz".index(axis)]
            turns += [KnownTurn(i, f"{name}.csv.gz", unit, axis, angle_deg * DEG, STOP_SIGMA_DEG * DEG) for i in range(count)]
        notes = {
            "source": "ShallDa/gyroscope_calibration, BSD 3-Clause",
            "repeated_rows": f"{again} rows of ends that stand twice left out",
        }
        yield write_turn_session(out / phone, logs, turns, serial=phone, notes=notes)


def read_rates(path: Path) -> tuple[np.ndarray, np.ndarray, int]:
    """Stamps (N,) ns, rates (N, 3) rad/s, and how many rows at the end stood there twice.  FormatError with the line that is at fault."""
    head, *lines = text_of(path).splitlines()
    semicolons = ";" in head
    stamps, rates = [], []
    for number, text in enumerate(lines, start=2):
        cells = text.replace(",", ".").split(";") if semicolons else text.split(",")
        try:
            stamps.append(_ns(cells[0]))
            rates.append([float(cell) for cell in cells[-3:]])
        except ValueError:
            raise FormatError(f"{path} line {number}: {text[:60]!r}, expected the columns {head}; {AGAIN}") from None
    t_ns, gyro = np.array(stamps, dtype=np.int64), np.array(rates)
    back = np.flatnonzero(np.diff(t_ns) < 0)
    if not len(back):
        return t_ns, gyro, 0
    whole = int(back[0]) + 1
    if len(back) > 1 or max(t_ns[whole - 1], t_ns[-1]) - t_ns[whole] >= AGAIN_S * NS_PER_S:
        raise FormatError(f"{path} line {whole + 2}: the time goes back, and not to repeat the last second; {AGAIN}")
    return t_ns[:whole], gyro[:whole], len(t_ns) - whole


def _ns(text: str) -> int:
    """Whole ns of seconds, or of a moment of a clock in UTC.  ValueError for anything else."""
    if "T" in text:
        return round(datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp() * 1000) * 1_000_000
    return round(float(text) * 1e6) * 1000
