"""imucal's example of Ferraris's protocol: a sensor on its six sides, then turned about each axis by a full circle, by hand on a table.

``example_data/example_ferraris_session.csv`` has the header ``n_samples,gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z`` in dps and m/s^2.  There is
no time; the example's own text says 102.4 Hz.  Each circle is -360 deg (imucal's convention: clockwise), in four strokes without a rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from .writing import LOG, found, rows_of_numbers, write_folder

FILE = "example_ferraris_session.csv"
COLUMNS = ("n_samples", "gyr_x", "gyr_y", "gyr_z", "acc_x", "acc_y", "acc_z")
RATE_HZ = 102.4
HEADER = "t_s,gx_dps,gy_dps,gz_dps,ax_mps2,ay_mps2,az_mps2"
#: turns as ``check`` counts them, and a hand's repeatability against the edge of a table, an assumption
CIRCLES = ("turn,axis,angle_deg,sigma_deg", ["7,x,-360,0.5", "9,y,-360,0.5", "11,z,-360,0.5"])
TOML = """schema = "tinygc-session/1"

[sensor]
model = "unknown"
serial = "imucal-example"
odr_hz = 102.4
gyro_fs_dps = 2000
accel_fs_g = 16

[protocol]
still_s = 1.0
segment_s = 8.0
reference = "gravity"
"""


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/imucal`` with ``turns.csv``."""
    (path,) = found(source, FILE, "example_data")
    rows = rows_of_numbers(path, COLUMNS, ",", skip=1)
    lines = (f"{number / RATE_HZ:.7f},{','.join(row[1:])}" for number, row in enumerate(rows))
    yield write_folder(out / "imucal", TOML, {LOG: (HEADER, lines), "turns.csv": CIRCLES}, given)
