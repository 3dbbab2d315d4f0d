"""Events in the samples: clipping, impacts, and knocks in a rest log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, log, pi, sqrt

import numpy as np

from session.base.numeric import runs_of
from session.base.units import DEG, G
from session.log.config import Sensor
from session.log.rests import RestLog
from session.log.samples import Samples, pieces
from session.log.sensors import REGISTER_MAX, REGISTER_SPAN

# Readings that stand at a limit: the register's end, or a level that the sensor does not leave.

FALSE_ALARM = 1e-4  #: chance that an extreme of pure noise is taken for a plateau
LEAST_RUN = 4
#: share by which a register's end and the full scale that is written for it differ: 32767 / 16.4 LSB/dps is 1998 dps for 2000
FULL_SCALE_ROUNDING = 2e-3
#: share by which the ends of both signs differ, 32767 and 32768, and a little more
SIGNS_APART = 1e-4


def register_reach(full_scale: float, table: Mapping[float, float] | None) -> float:
    """The largest reading that the 16-bit register can hold, in the unit of the full scale; table: full scale -> thousandths per LSB.

    A register may go further than the full scale: 32767 x 17.5 mdps = 573 dps at +-500 dps, and sensors do read on up there.
    A full scale that is not the sensor's own has no register here: then it is the limit itself.
    """
    if table is None:
        return full_scale * REGISTER_MAX / REGISTER_SPAN
    return REGISTER_MAX * table[full_scale] * 1e-3 if full_scale in table else full_scale


def gyro_reach_dps(sensor: Sensor) -> float:
    """The largest rate that the gyroscope's register holds, dps; infinite where the sensor is not known: a plateau shows its limit."""
    if sensor.gyro_mdps_per_lsb is not None:
        return REGISTER_MAX * sensor.gyro_mdps_per_lsb * 1e-3
    return np.inf if sensor.profile is None else register_reach(sensor.gyro_fs_dps, sensor.profile.gyro)


def accel_reach_g(sensor: Sensor) -> float:
    """The largest force that the accelerometer's register holds, g; infinite where the sensor is not known."""
    if sensor.accel_mg_per_lsb is not None:
        return REGISTER_MAX * sensor.accel_mg_per_lsb * 1e-3
    return np.inf if sensor.profile is None else register_reach(sensor.accel_fs_g, sensor.profile.accel)


def register_end_dps(sensor: Sensor, gyro: np.ndarray) -> float:
    """From which rate on, dps, a reading stands at the register's end, by the sensor and its rates (N, 3) rad/s.

    Of a sensor that is not known the register ends near its full scale, where the log's greatest reading is there; else the end is unknown.
    """
    end = gyro_reach_dps(sensor)
    if np.isfinite(end):
        return end * (1 - SIGNS_APART)
    peak = float(np.abs(gyro).max(initial=0.0)) / DEG
    return np.inf if abs(peak / sensor.gyro_fs_dps - 1) > FULL_SCALE_ROUNDING else peak * (1 - SIGNS_APART)


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
    so a run of n by chance^(n-1).  With three steps of noise that requires 5 equal readings, with less noise for more.
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


# Impacts: the table hits a stop, or the sensor is set down hard.  A movement that takes a few milliseconds falls between two readings.
#
# The length of the specific force does not depend on how the sensor lies, and no hand changes it by ``JUMP_G`` between two readings: what
# does, is shorter than they are apart.  What the gyroscope missed of it no reading shows; only the closure of such turns does.

#: g, from one reading to the next; hand turns without a stop reach 0.8 at 62.5 to 100 Hz (docs/real-recordings.md)
JUMP_G = 1.0
#: s: jumps that are nearer are one impact, and its ringing
APART_S = 0.2


@dataclass(frozen=True)
class Impact:
    """row of its greatest jump, which is between this reading and the next; at_s of the log; jump_g: that jump."""

    row: int
    at_s: float
    jump_g: float


def find_impacts(samples: Samples) -> list[Impact]:
    """All of a log, in order."""
    parts = [np.abs(np.diff(np.linalg.norm(part, axis=1))) / G for _, part in pieces(samples.accel, overlap=1)]
    jump = np.concatenate(parts)
    rows = np.flatnonzero(jump >= JUMP_G)
    if not len(rows):
        return []
    near = np.zeros(len(jump), dtype=bool)
    near[rows] = True
    reach = max(1, round(APART_S / samples.period_s))
    for first, last in pairwise(rows):
        if last - first <= reach:
            near[first : last + 1] = True
    greatest = [int(start + np.argmax(jump[start:stop])) for start, stop in zip(*runs_of(near), strict=True)]
    return [Impact(row, samples.at_s(row), float(jump[row])) for row in greatest]


# Blocks of a rest log with knocks or footsteps: their scatter is beyond what the others have.
#
# The scatter may follow temperature, so a block is held against its neighbours in time; how far the logarithm of a variance strays without
# a knock is taken from the log itself.

#: percentiles by which quiet blocks are known: a quarter of all is taken to be quiet, and how these scatter is their sigma
LOWEST, QUIET = 5, 25
#: blocks around one whose quarter is its yardstick: a knock is shorter, a change of temperature slower
AROUND = 121
#: knocks that are found in a whole log where there is none, on average
FALSE = 0.01


def knocked(log: RestLog) -> np.ndarray:
    """(B,) bool: blocks to leave out, and one on either side of each."""
    from scipy.ndimage import percentile_filter  # only where a rest log is read
    from scipy.special import ndtri

    found = np.zeros(len(log), dtype=bool)
    sigmas = -ndtri(FALSE / max(6 * len(log), 1))
    quiet_sigmas, lowest_sigmas = ndtri(QUIET / 100), ndtri(LOWEST / 100)
    for values in (*log.gyro_sd.T, *log.accel_sd.T):
        # A sensor whose register stands still has no scatter: half the smallest that there is stands for none.
        least = values[values > 0].min(initial=np.inf)
        if not np.isfinite(least):
            continue
        level = np.log(np.maximum(values, least / 2))
        off = level - percentile_filter(level, QUIET, size=min(AROUND, len(level)), mode="nearest")
        # By the quieter blocks: they are still even where half of a log is not.
        low, quiet = np.percentile(off, [LOWEST, QUIET])
        sigma = max((quiet - low) / (quiet_sigmas - lowest_sigmas), 1e-9)
        found |= off - quiet + quiet_sigmas * sigma > sigmas * sigma
    wide = found.copy()
    wide[1:] |= found[:-1]  # it rings on
    wide[:-1] |= found[1:]
    return wide
