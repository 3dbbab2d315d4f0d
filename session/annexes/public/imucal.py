"""imucal's example of Ferraris's protocol: a sensor on its six sides, then turned about each axis by a full circle, by hand on a table.

``example_data/example_ferraris_session.csv`` has the header ``n_samples,gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z`` in dps and m/s^2.  There is
no time; the example's own text says 102.4 Hz.  Each circle is -360 deg (imucal's convention: clockwise), in four strokes without a rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from session.annexes.public.writing import found, refuse_to_replace, rows_of_numbers, text_of, write_folder
from session.io.errors import FormatError
from session.io.logfile import COLUMNS as TURN_COLUMNS
from session.io.logfile import NAME as KNOWN_TURNS

FILE = "example_ferraris_session.csv"
COLUMNS = ("n_samples", "gyr_x", "gyr_y", "gyr_z", "acc_x", "acc_y", "acc_z")
RATE_HZ = 102.4
HEADER = "t_s,gx_dps,gy_dps,gz_dps,ax_mps2,ay_mps2,az_mps2"
#: turns as ``check`` counts them, and a hand's repeatability against the edge of a table, an assumption
CIRCLES = "".join(f"{turn},{axis},-360,0.5\n" for turn, axis in ((7, "x"), (9, "y"), (11, "z")))
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
    """``out/imucal`` with ``turns.csv``.  The authors give no calibration; given: as in ``mikov``.  FormatError for another file."""
    (path,) = found(source, FILE, "example_data")
    head = text_of(path).partition("\n")[0]
    if tuple(cell.strip() for cell in head.split(",")) != COLUMNS:
        raise FormatError(f"{path} line 1: {head[:60]!r}, expected {','.join(COLUMNS)}; download it again")
    rows = rows_of_numbers(path, COLUMNS, ",", skip=1)
    lines = (f"{number / RATE_HZ:.7f},{','.join(row[1:])}" for number, row in enumerate(rows))
    turns = ",".join(TURN_COLUMNS) + "\n" + CIRCLES
    refuse_to_replace(out / "imucal" / KNOWN_TURNS, turns.encode())
    folder = write_folder(out / "imucal", TOML, HEADER, lines, given)
    (folder / KNOWN_TURNS).write_text(turns, encoding="utf-8")
    yield folder
