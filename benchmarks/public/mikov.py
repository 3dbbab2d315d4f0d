"""Five MPU-9150 on one body, turned by hand (Mikov, Panyov, Kosyanchuk, Prikhodko, ICINS 2020): ``imu0.log`` to ``imu4.log``.

A line is ``ax ay az gx gy gz`` in m/s^2 and rad/s.  There is no time; the authors say 100 Hz, so ``t_s`` is the line's number over 100.
Full scales follow from the steps of the numbers.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

from .writing import LOG, found, rows_of_numbers, write_folder

COLUMNS = ("ax", "ay", "az", "gx", "gy", "gz")
RATE_HZ = 100
HEADER = "t_s,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2"
TOML = """schema = "tinygc-session/1"

[sensor]
model = "MPU-9150"
serial = "mikov-{number}"
odr_hz = 100.0
gyro_fs_dps = 2000
accel_fs_g = 16

[protocol]
still_s = 1.0
segment_s = 5.0
reference = "gravity"
"""


ARRAY = """schema = "tinygc-session/1"

[array]
folders = [{names}]
"""


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/imu0`` and so on, as many as there are logs, one after the other."""
    for path in found(source, "imu[0-9].log", "data"):
        rows = rows_of_numbers(path, COLUMNS)
        lines = (f"{number / RATE_HZ:.2f},{','.join(row[3:] + row[:3])}" for number, row in enumerate(rows))
        yield write_folder(out / path.stem, TOML.format(number=path.stem.removeprefix("imu")), {LOG: (HEADER, lines)}, given)


def write_array(source: Path, out: Path) -> Iterator[Path]:
    """``out/mikov``, an array of the units whose logs, or session folders made of them before, lie in the source."""
    folder = out / "mikov"
    if sessions := sorted(path.parent for path in source.glob("imu[0-9]/session.toml")):
        units = [Path(shutil.copytree(session, folder / session.name)) for session in sessions]
    else:
        units = [*write(source, folder)]
    names = ", ".join(f'"{unit.name}"' for unit in units)
    (folder / "session.toml").write_text(ARRAY.format(names=names), encoding="utf-8")
    yield folder
