"""The floor: how large closure residuals must be from noise alone.

Gyro white noise over the segment (angle random walk), and the accelerometer's noise over the stills at both ends.  Two neighbours
share a still, so their accelerometer parts are correlated, with opposite signs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.detect.stills import Noise, Still
from tinygc.attitude import rotation
from tinygc.closure.residual import Batch, directions

#: rad^2 of an angle that is not known: its residual and its columns are 0, so any number will do that is larger than what is measured
UNKNOWN_RAD2 = 1.0


@dataclass(frozen=True, eq=False)
class Floor:
    """Covariance of the error angles, rad^2: own (S, d, d) of each segment; shared (S-1, d, d) of each with the next.

    tilt_excess: factor on the tilt's sigma that a recording asks for beyond its floor.  It changes weights, no covariance: turns of known
    angle, which know their own sigma, would else be outweighed by ends that only seem to be better.
    """

    own: np.ndarray
    shared: np.ndarray
    tilt_excess: float = 1.0

    @property
    def sigma(self) -> np.ndarray:
        """(S, d) rad: the weight of each angle is 1 / sigma^2; one for both of tilt, whose axes are only the table's."""
        tilt = self.tilt_excess**2 * np.repeat((self.own[:, 0, 0] + self.own[:, 1, 1])[:, None] / 2, 2, axis=1)
        return np.sqrt(np.concatenate([tilt, np.diagonal(self.own, axis1=1, axis2=2)[:, 2:]], axis=1))

    @property
    def tilt_rms(self) -> float:
        """rad: expected root mean square of the tilt error over the segments."""
        return float(np.sqrt(np.mean(self.own[:, 0, 0] + self.own[:, 1, 1])))

    def dense(self) -> np.ndarray:
        """(S d, S d)."""
        count, d = self.own.shape[:2]
        full = np.zeros((count, d, count, d))
        index = np.arange(count)
        full[index, :, index, :] = self.own
        full[index[:-1], :, index[1:], :] = self.shared
        full[index[1:], :, index[:-1], :] = self.shared.transpose(0, 2, 1)
        return full.reshape(count * d, count * d)

    def times(self, columns: np.ndarray) -> np.ndarray:
        """Covariance times columns (S, d, P), without the dense matrix."""
        product = self.own @ columns
        product[:-1] += self.shared @ columns[1:]
        product[1:] += self.shared.transpose(0, 2, 1) @ columns[:-1]
        return product


def still_tilt_variance(still: Still, noise: Noise) -> float:
    """rad^2 per horizontal angle of a still's gravity direction."""
    return float(np.mean(noise.velocity_random_walk**2)) / still.duration_s / still.gravity_mps2**2


def closure_floor(
    batch: Batch, attitudes: np.ndarray, ends: list[tuple[Still, Still]], noises: list[Noise], dial_sigma_rad: float = 0.0
) -> Floor:
    """Floor of S segments with attitudes (S, T, 4), the stills at their ends, and the noise of the log each is from.

    Tilt is gravity's, with white noise (which holds the register's rounding, too); yaw, where it is known, a dial's; the angle of a known
    turn, the stop's.  What the accelerometer's pre-calibration leaves is not in it: nobody has stated it.
    """
    axes = directions(batch, attitudes[:, -1])
    own = (axes @ gyro_variance(batch, attitudes, noises) @ axes.transpose(0, 2, 1))[:, : batch.angles, : batch.angles]
    shared = np.zeros((max(len(batch) - 1, 0), batch.angles, batch.angles))
    dial = [dial_sigma_rad**2] if batch.yaw_known else [0.0] * (batch.angles - 2)
    if batch.turns is not None:
        own[:, 2, 2] += np.where(batch.turns.known, np.nan_to_num(batch.turns.sigma_rad) ** 2, UNKNOWN_RAD2)
    for i, ((first, last), noise) in enumerate(zip(ends, noises, strict=True)):
        begin, end = (np.diag([still_tilt_variance(still, noise)] * 2 + dial) for still in (first, last))
        own[i] += begin + end
        if i + 1 < len(ends) and ends[i + 1][0] is last:
            shared[i] = -end
    return Floor(own, shared)


def gyro_variance(batch: Batch, attitudes: np.ndarray, noises: list[Noise]) -> np.ndarray:
    """(S, 3, 3) rad^2: the integrated white noise of the gyro, each axis with its own angle random walk."""
    weights = np.concatenate([batch.dt, np.zeros((len(batch), 1))], axis=1)
    turn = rotation.matrix(attitudes)
    walk = np.array([noise.angle_random_walk for noise in noises]) ** 2
    return np.einsum("st,stij,sj,stkj->sik", weights, turn, walk, turn, optimize=True)
