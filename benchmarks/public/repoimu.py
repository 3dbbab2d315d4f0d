"""RepoIMU's wand (Szczęsna et al., ICCVG 2016): an IMU on a T-shaped stick, moved by hand, whose attitude Vicon cameras have followed.

``TStick/TStick_Test06_Trial1.csv`` has semicolons and two header lines.  A row is the time in s, the cameras' quaternion, scalar first,
then specific force in m/s^2, rates in rad/s and the magnetic field.  The cameras' world is the frame of the stick's markers at the first
row, with z up within 3 deg.  A quaternion of zeros stands where the cameras saw nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from .writing import LOG, TRUTH, found, rows_of_numbers, write_folder

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
    """``out/Test06_Trial1`` and so on, a session folder with a truth file for each trial with motion, one after the other."""
    for path in found(source, "TStick_Test*_Trial*.csv", "TStick"):
        rows = rows_of_numbers(path, COLUMNS, ";", skip=2)
        log = (",".join([row[0], *row[8:11], *row[5:8]]) for row in rows)
        truth = (",".join(row[:5]) for row in rows if any(map(float, row[1:5])))
        toml, files = TOML.format(name=path.stem), {LOG: (HEADER, log), TRUTH: (TRUTH_HEADER, truth)}
        yield write_folder(out / path.stem.removeprefix("TStick_"), toml, files, given)
