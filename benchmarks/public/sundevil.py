"""The 9-axis board of a student's rocket (Sun Devil Rocketry), turned by hand as imu_tk's authors advise: a long and a short recording.

A line of ``Rev2_IMU_Data/IMU_Rev2_Data_Long.txt`` is the time in s, specific force in m/s^2, rates in dps, four cells of the magnetometer,
pressure in kPa and temperature in degC; the authors' file of information says so.  They stay as the authors wrote them, although the rates
turn out to be half of the truth: docs/real-recordings.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from .writing import LOG, found, rows_of_numbers, write_folder

COLUMNS = ("time", "IMUX", "IMUY", "IMUZ", "GYROX", "GYROY", "GYROZ", "MAG1", "MAG2", "MAG3", "MAG4", "pressure", "temperature")
HEADER = "t_s,gx_dps,gy_dps,gz_dps,ax_mps2,ay_mps2,az_mps2,temp_c"
#: full scales by the steps of the numbers: 250 dps / 32767 and 16 g / 32768.  The temperature is the barometer's, on the same board
TOML = """schema = "tinygc-session/1"

# Sun Devil Rocketry's board, revision 2, as its authors converted its registers; full scales follow from the steps of the numbers.
[sensor]
model = "unknown"
serial = "Sun Devil Rocketry rev 2"
odr_hz = 20.0
gyro_fs_dps = 250
accel_fs_g = 16

[protocol]
still_s = 1.0
segment_s = 5.0
reference = "gravity"
"""


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/long`` and ``out/short``, one after the other."""
    for path in found(source, "IMU_Rev2_Data_*.txt", "Rev2_IMU_Data"):
        lines = (",".join([row[0], *row[4:7], *row[1:4], row[12]]) for row in rows_of_numbers(path, COLUMNS))
        yield write_folder(out / path.stem.removeprefix("IMU_Rev2_Data_").lower(), TOML, {LOG: (HEADER, lines)}, given)
