"""The test data of imu_tk (Tedaldi, Pretto, Menegatti, ICRA 2014): the raw counts of a hand-turned Xsens MTi.

``xsens_acc.mat`` and ``xsens_gyro.mat`` are text: seconds, then three counts around 32768.  imu_tk states no units for the counts; one
nominal scale for all axes stands for them here, and the accelerometer's scale within that is imu_tk's own result on these files.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.log.config import Accelerometer

from .writing import AGAIN, LOG, found, rows_of_numbers, write_folder

OFFSET = 32768  #: counts at zero, of imu_tk's example
ACCEL_PER_MPS2 = 414.0
GYRO_PER_RPS = 4774.0
#: what imu_tk's example finds in these files, for these scales
BY_IMU_TK = Accelerometer(
    np.array([[0.998892836, -0.003375521, -0.008892462], [0.0, 1.004828837, -0.021300745], [0.0, 0.0, 0.998435634]]),
    np.array([0.86034436, 1.22507110, -0.97484143]),
)
HEADER = "t_s,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2"
TOML = """schema = "tinygc-session/1"

# The test data of imu_tk (Tedaldi, Pretto, Menegatti, ICRA 2014; BSD licence): a hand-turned Xsens MTi's raw counts,
# put into units with one nominal scale and the offset 32768 on all axes.
[sensor]
model = "Xsens MTi (raw counts)"
serial = "imu_tk xsens"
odr_hz = 100.0
gyro_fs_dps = 393
accel_fs_g = 8

{accelerometer}[site]
gravity_mps2 = 9.81744

[protocol]
still_s = 1.0
segment_s = 5.0
reference = "gravity"
"""


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/xsens``; given: with imu_tk's own accelerometer."""
    (acc_path,) = found(source, "xsens_acc.mat", "bin/test_data")
    gyro_path = acc_path.with_name("xsens_gyro.mat")
    accel, gyro = (np.array(rows_of_numbers(path, ("seconds", "x", "y", "z")), dtype=float) for path in (acc_path, gyro_path))
    if accel.shape != gyro.shape or (accel[:, 0] != gyro[:, 0]).any():
        raise FormatError(f"{gyro_path}: its {len(gyro)} times are not the {len(accel)} of {acc_path.name}; {AGAIN}")
    rates, forces = (gyro[:, 1:] - OFFSET) / GYRO_PER_RPS, (accel[:, 1:] - OFFSET) / ACCEL_PER_MPS2
    lines = (
        f"{t:.6f},{','.join(f'{value:.7f}' for value in rate)},{','.join(f'{value:.6f}' for value in force)}"
        for t, rate, force in zip(accel[:, 0].tolist(), rates.tolist(), forces.tolist(), strict=True)
    )
    matrix, bias = np.round(BY_IMU_TK.matrix, 9).tolist(), np.round(BY_IMU_TK.bias_mps2, 8).tolist()
    known = f"# imu_tk's own result.\n[accelerometer]\nmatrix = {matrix}\nbias_mps2 = {bias}\n\n" if given else ""
    yield write_folder(out / "xsens", TOML.format(accelerometer=known), {LOG: (HEADER, lines)}, given)
