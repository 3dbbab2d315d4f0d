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

from session.annexes.public.writing import placed, text_of
from session.annexes.turntable.folder import GyroLog, read_turn_session, turn_session_files
from session.io.errors import FormatError
from session.io.logfile import KnownTurn
from session.io.stamps import ERA_NS
from session.io.units import DEG, NS_PER_S

NAME = re.compile(r"(?P<phone>\w+?)_(?P<axis>[XYZ])[GM]_(?P<speed>[\d.]+)_(?P<angle>\d+)(?P<each>i?)_(?P<number>\d+)\.csv")
#: the authors do not say how well the table stops: half a step of a usual motor of 1.8 deg as the width of a rectangular distribution
STOP_SIGMA_DEG = 0.26
#: a turn of 1800i
EACH_DEG = 360
#: of the last samples that stand there once more
AGAIN_S = 1.1


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/IphoneSE3G`` and ``out/SamsungS10``, a session folder of a gyroscope alone for each telephone.

    FormatError for files that are not the authors', and not given: there is no accelerometer.
    """
    if not given:
        raise FormatError("phones: there is no accelerometer to be calibrated; leave --accelerometer out")
    files: dict[str, list[tuple[re.Match[str], Path]]] = {}
    for path in sorted(source.glob("*/Rotation/*/*/*.csv")):
        if (match := NAME.fullmatch(path.name)) is None:
            raise FormatError(f"{path}: expected a name as PHONE_XG_10_1800_1.csv; download it again")
        files.setdefault(match["phone"], []).append((match, path))
    if not files:
        raise FormatError(
            f"{source}: holds no PHONE/Rotation/SPEED/ANGLE/*.csv; download the authors' files first (docs/real-recordings.md)"
        )
    for phone, mine in files.items():
        logs, turns, again = [], [], 0
        for match, path in mine:
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
        contents = turn_session_files(logs, turns, serial=phone, notes=notes)

        def write_files(where: Path, contents: dict[str, bytes] = contents) -> None:
            for name, data in contents.items():
                (where / name).write_bytes(data)

        yield placed(out / phone, write_files, True, read_turn_session)


def read_rates(path: Path) -> tuple[np.ndarray, np.ndarray, int]:
    """Stamps (N,) ns, rates (N, 3) rad/s, and how many rows at the end stood there twice.  FormatError with the line that is at fault."""
    lines = text_of(path).splitlines()
    separator = ";" if lines and ";" in lines[0] else ","
    names = [name.split(" ")[0].strip() for name in lines[0].split(separator)] if lines else []
    if names[:1] != ["time"] or names[-3:] != ["wx", "wy", "wz"]:
        raise FormatError(f"{path}: its header is not time,wx,wy,wz; download it again")
    stamps, rows = [], []
    for number, text in enumerate(lines[1:], start=2):
        cells = [cell.replace(",", ".") if separator == ";" else cell for cell in text.split(separator)]
        try:
            stamps.append(_ns(cells[0]))
            rows.append([float(cell) for cell in cells[-3:]])
        except (ValueError, OverflowError):
            rows.append([])
        if len(cells) != len(names) or len(rows[-1]) != 3 or not np.isfinite(rows[-1]).all():
            raise FormatError(
                f"{path} line {number}: {text[:60]!r}, expected {len(names)} numbers: {separator.join(names)}; download it again"
            )
    if len(rows) < 2:
        raise FormatError(f"{path}: {len(rows)} rows of numbers, expected many; download it again")
    t_ns, gyro = np.array(stamps, dtype=np.int64), np.array(rows).reshape(-1, 3)
    whole = len(t_ns)
    back = np.flatnonzero(np.diff(t_ns) < 0)
    if len(back) == 1 and t_ns[back[0]] - t_ns[back[0] + 1] < AGAIN_S * NS_PER_S and t_ns[-1] - t_ns[back[0] + 1] < AGAIN_S * NS_PER_S:
        whole = int(back[0]) + 1
    elif len(back):
        raise FormatError(f"{path} line {back[0] + 3}: the time goes back, and not to repeat the last second; download it again")
    return t_ns[:whole], gyro[:whole], len(t_ns) - whole


def _ns(text: str) -> int:
    """Whole ns of seconds, or of a moment of a clock in UTC.  ValueError or OverflowError for anything else."""
    if "T" in text:
        return round(datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp() * 1000) * 1_000_000
    ns = round(float(text) * 1e6) * 1000
    if abs(ns) >= ERA_NS:
        raise ValueError("no time of this era")
    return ns
