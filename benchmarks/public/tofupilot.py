"""The IMU of TofuPilot's thermal calibration example: 70 minutes at rest, 52 to -18, 74 and 36 degC, at two samples a second.

``imu_raw_data.csv`` is text with tabs: microseconds, rates in rad/s, specific force in m/s^2, a status, degC.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from .writing import REST, found, rows_of_numbers, write_folder

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


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/tofupilot``, a folder with one rest log: nothing is turned, so ``given`` means nothing."""
    (path,) = found(source, "imu_raw_data.csv", "templates/imu_thermal_calibration/data")
    lines = (",".join([*row[:7], row[8]]) for row in rows_of_numbers(path, COLUMNS, "\t", skip=1))
    yield write_folder(out / "tofupilot", TOML, {REST: (HEADER, lines)})
