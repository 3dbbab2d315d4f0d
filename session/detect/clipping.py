"""Readings that stand at a limit: the register's end, or a level that the sensor does not leave."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, log, pi, sqrt

import numpy as np

from session.common.runs import runs_of
from session.log.config import Sensor
from session.sensor.profiles.profile import REGISTER_MAX, REGISTER_SPAN

FALSE_ALARM = 1e-4  #: chance that an extreme of pure noise is taken for a plateau
LEAST_RUN = 4


def register_reach(full_scale: float, table: Mapping[float, float] | None, per_lsb: float) -> float:
    """The largest reading that the 16-bit register can hold, in the unit of the full scale; table: full scale -> thousandths per LSB.

    A register may go further than the full scale: 32767 x 17.5 mdps = 573 dps at +-500 dps, and sensors do read on up there.
    A full scale that is not the sensor's own has no register here: then it is the limit itself.
    """
    if table is None:
        return full_scale * REGISTER_MAX / REGISTER_SPAN
    return REGISTER_MAX * table[full_scale] * per_lsb if full_scale in table else full_scale


def gyro_reach_dps(sensor: Sensor) -> float:
    """The largest rate that the gyroscope's register holds, dps; infinite where the sensor is not known: a plateau shows its limit."""
    if sensor.gyro_mdps_per_lsb is not None:
        return REGISTER_MAX * sensor.gyro_mdps_per_lsb * 1e-3
    return np.inf if sensor.profile is None else register_reach(sensor.gyro_fs_dps, sensor.profile.gyro, 1e-3)


def accel_reach_g(sensor: Sensor) -> float:
    """The largest force that the accelerometer's register holds, g; infinite where the sensor is not known."""
    if sensor.accel_mg_per_lsb is not None:
        return REGISTER_MAX * sensor.accel_mg_per_lsb * 1e-3
    return np.inf if sensor.profile is None else register_reach(sensor.accel_fs_g, sensor.profile.accel, 1e-3)


def clips(magnitude: np.ndarray, full_scale: float, reach: float) -> bool:
    """Whether readings (N,), magnitudes in the unit of the full scale, are at the register's end or stand at the full scale.

    Beyond the full scale alone is no clipping: the register goes on, and so does the sensor.
    """
    peak = magnitude.max()
    if peak >= reach * (1 - 1e-6):
        return True
    return bool(peak >= full_scale * (1 - 1e-3) and plateau(magnitude, peak, LEAST_RUN).any())


def run_bar(noise_std: float, step: float) -> int:
    """How many equal readings in a row noise does not make at a turn's peak, where the rate itself stands.

    Two neighbours with noise ``noise_std`` fall on the same register step with a chance of at most step / (2 sqrt(pi) noise_std),
    so a run of n by chance^(n-1).  With three steps of noise that asks for 5 equal readings, with less noise for more.
    """
    chance = step / (2 * sqrt(pi) * noise_std) if noise_std > 0 else 1.0
    if chance >= 0.9:
        return 200
    return max(LEAST_RUN, 1 + ceil(log(FALSE_ALARM) / log(chance))) if chance > 0 else LEAST_RUN


def plateau(values: np.ndarray, level: float, least_run: int) -> np.ndarray:
    """Mask (N,) of readings equal to ``level`` in runs of at least ``least_run``."""
    at = values == level
    mask = np.zeros(len(values), dtype=bool)
    for start, stop in zip(*runs_of(at), strict=True):
        mask[start:stop] = stop - start >= least_run
    return mask
