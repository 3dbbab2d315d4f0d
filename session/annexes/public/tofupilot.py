"""The IMU of TofuPilot's thermal calibration example: 70 minutes at rest, 52 to -18, 74 and 36 degC, at two samples a second.

``imu_raw_data.csv`` is text with tabs: microseconds, rates in rad/s, specific force in m/s^2, a status, degC.
"""

from __future__ import annotations

from pathlib import Path

from session.annexes.public.writing import found, text_of, write_rest_folder
from session.io.errors import FormatError

COLUMNS = ("timestamp", *(f"imu.gyro.{axis}" for axis in "xyz"), *(f"imu.acc.{axis}" for axis in "xyz"), "imu.status", "imu.temperature")
HEADER = "t_us,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2,temp_c"
TOML = """schema = "tinygc-session/1"

# TofuPilot's IMU thermal calibration example (MIT licence): an IMU at rest while its temperature goes down, up and down.
# The example names neither the sensor nor its full scales: these hold its readings.
[sensor]
model = "TofuPilot example"
serial = "imu_raw_data"
odr_hz = 2.0
gyro_fs_dps = 500
accel_fs_g = 4
"""


def write(source: Path, out: Path, given: bool = True) -> list[Path]:
    """``out/tofupilot``, a folder with one rest log.  FormatError for files that are not the authors', and where nothing is turned:
    not given, an accelerometer from stills in one attitude."""
    if not given:
        raise FormatError("tofupilot: the sensor lay in one attitude, which calibrates no accelerometer; leave --accelerometer out")
    (path,) = found(source, "imu_raw_data.csv", "templates/imu_thermal_calibration/data")
    lines = [line.split("\t") for line in text_of(path).splitlines() if line.strip()]
    if not lines or tuple(cell.strip() for cell in lines[0]) != COLUMNS:
        raise FormatError(f"{path}: its header is not {' '.join(COLUMNS)}; download it again")
    rows = []
    for number, cells in enumerate(lines[1:], start=2):
        try:
            stamp, *values = int(cells[0]), *map(float, cells[1:])
        except (ValueError, IndexError):
            values = []
        if len(values) != len(COLUMNS) - 1 or not all(abs(value) < 1e6 for value in values):
            raise FormatError(f"{path} line {number}: expected {len(COLUMNS)} numbers; download it again")
        rows.append(f"{stamp},{','.join(cells[1:7])},{cells[8].strip()}")
    return [write_rest_folder(out / "tofupilot", TOML, HEADER, rows)]
