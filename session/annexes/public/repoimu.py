"""RepoIMU's wand (Szczęsna et al., ICCVG 2016): an IMU on a T-shaped stick, moved by hand, whose attitude Vicon cameras have followed.

``TStick/TStick_Test06_Trial1.csv`` has semicolons and two header lines.  A row is the time in s, the cameras' quaternion, scalar first,
then specific force in m/s^2, rates in rad/s and the magnetic field.  The cameras' world is the frame of the stick's markers at the first
row, with z up within 3 deg.  A quaternion of zeros stands where the cameras saw nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from session.annexes.public.writing import found, rows_of_numbers, text_of, write_folder
from session.io.errors import FormatError
from session.io.logfile import of_length_1

HEAD = ("Time (s);Vicon Orientation;;;;IMU Acceleration;;;IMU Gyroscope;;;IMU Magnetometer;;;", ";W;X;Y;Z;X;Y;Z;X;Y;Z;X;Y;Z;")
COLUMNS = ("t", "qw", "qx", "qy", "qz", *(f"{what}{axis}" for what in "agm" for axis in "xyz"))
HEADER, TRUTH_HEADER = "t_s,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2", "t_s,qw,qx,qy,qz"
#: the repository names neither the sensor nor its full scales: these hold its readings.  The sigma is an assumption about the cameras
TOML = """schema = "tinygc-session/1"

# RepoIMU, {name}.  The repository states neither the sensor nor its full scales.
[sensor]
model = "unknown"
serial = "RepoIMU T-stick"
odr_hz = 100.0
gyro_fs_dps = 2000
accel_fs_g = 16

[protocol]
segment_s = 5.0
reference = "truth"
truth_sigma_deg = 0.1
"""


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/Test06_Trial1`` and so on, a session folder with a truth file for each trial with motion, one after the other.

    not given: with an accelerometer from the trial's own stills.  FormatError for files that are not the authors'; not given: what
    ``placed`` raises.
    """
    for path in found(source, "TStick_Test*_Trial*.csv", "TStick"):
        if tuple(line.strip() for line in text_of(path).splitlines()[:2]) != HEAD:
            raise FormatError(f"{path}: its two header lines are not RepoIMU's; download it again")
        rows = rows_of_numbers(path, COLUMNS, ";", skip=2)
        q_wxyz = np.array([row[1:5] for row in rows], dtype=float)
        seen = np.any(q_wxyz != 0, axis=1)
        if not of_length_1(q_wxyz[seen]).all():
            raise FormatError(f"{path}: holds quaternions that are not of length 1; download it again")
        log = (",".join([row[0], *row[8:11], *row[5:8]]) for row in rows)
        truth = (",".join(row[:5]) for row, is_seen in zip(rows, seen, strict=True) if is_seen)
        name = path.stem.removeprefix("TStick_")
        yield write_folder(out / name, TOML.format(name=path.stem), HEADER, log, given, (TRUTH_HEADER, truth))
