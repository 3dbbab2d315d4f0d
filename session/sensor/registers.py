"""What the ASM330LHH's registers mean (ST, asm330lhh_reg.c: ``asm330lhh_from_fs500dps_to_mdps`` and its kin)."""

from __future__ import annotations

import numpy as np

from session.common.errors import FormatError
from session.common.units import MDPS, MG

#: full scale in dps -> mdps per LSB
GYRO_MDPS_PER_LSB = {125: 4.375, 250: 8.75, 500: 17.5, 1000: 35.0, 2000: 70.0, 4000: 140.0}
#: full scale in g -> mg per LSB
ACCEL_MG_PER_LSB = {2: 0.061, 4: 0.122, 8: 0.244, 16: 0.488}
TEMP_LSB_PER_C = 256.0
TEMP_AT_ZERO_C = 25.0
REGISTER_MAX = 32767


def gyro_rps_per_lsb(fs_dps: float) -> float:
    """Sensitivity of the gyroscope at a full scale given in dps, in rad/s per LSB; FormatError if there is no such range."""
    return _look_up(GYRO_MDPS_PER_LSB, fs_dps, "gyro_fs_dps") * MDPS


def accel_mps2_per_lsb(fs_g: float) -> float:
    """Sensitivity of the accelerometer at a full scale given in g, in m/s^2 per LSB; FormatError if there is none."""
    return _look_up(ACCEL_MG_PER_LSB, fs_g, "accel_fs_g") * MG


def temperature_c(lsb: np.ndarray) -> np.ndarray:
    """Temperature register (N,) in degC."""
    return TEMP_AT_ZERO_C + lsb / TEMP_LSB_PER_C


def _look_up(table: dict[int, float], full_scale: float, name: str) -> float:
    if full_scale not in table:
        ranges = ", ".join(map(str, table))
        raise FormatError(
            f"{name} = {full_scale:g} is no ASM330LHH full scale (it has {ranges}); "
            "correct session.toml, or log physical units (gx_dps, ax_g, …)"
        )
    return table[int(full_scale)]
