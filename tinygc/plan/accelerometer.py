"""What a turn and the stills at its ends tell of an accelerometer that nobody has calibrated: nine numbers more, in the same linear terms.

The force is f = M (m - b), M upper triangular, in the order and by the derivatives of ``session.accelerometer.parameters``.  In every still
its length is gravity's: one row.  Its direction is the attitude at both ends of a turn: an error of f at the start turns the attitude that
is predicted for the end, one at the end turns the attitude that it is compared with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.accelerometer.parameters import PARAMETERS, UPPER, length_columns
from session.common.robust import sigma_of
from session.common.units import MG, G
from session.detect.stills import Noise, Still
from session.log.config import Accelerometer
from tinygc.problem.joint import tilt_columns

#: a tilt of 0.05 mrad, which is the target of the gyroscope's misalignments, too
TARGETS = np.array([50e-6] * 6 + [50e-6 * G] * 3)
#: what an accelerometer may be off by before any still was seen: 10 %, and 0.6 g (an MPU-9250 had 0.5 g)
PRIOR_SIGMA = np.array([0.1] * 6 + [0.6 * G] * 3)
#: m/s^2: what a MEMS accelerometer wanders by within minutes, until the stills themselves say how far they miss
WANDERS_MPS2 = 0.05 * MG
SPARE = 6  #: stills beyond nine that say it
UNCALIBRATED = Accelerometer(source="none")


@dataclass(frozen=True, eq=False)
class OwnAccelerometer:
    """accelerometer: as it is known so far (M upper triangular), or as it comes; sigma_mps2: of a still beyond white noise, each axis."""

    accelerometer: Accelerometer
    sigma_mps2: float

    @property
    def x(self) -> np.ndarray:
        """(9,) as ``session.accelerometer.parameters`` orders them."""
        return np.concatenate([self.accelerometer.matrix[UPPER], self.accelerometer.bias_mps2])

    def length_rows(self, force: np.ndarray) -> np.ndarray:
        """(S, 9) m/s^2 per unit: how each number changes the length of forces (S, 3), as they are by what is known."""
        return length_columns(self.x, self.accelerometer.measured(force))

    def tilt_rows(self, first: np.ndarray, last: np.ndarray, q_first: np.ndarray, q_last: np.ndarray) -> np.ndarray:
        """(S, 2, 9) rad per unit: how each number turns the end attitude that is predicted, beside the one that gravity shows.

        first, last (S, 3) m/s^2: the force at both ends by what is known; q_first, q_last (S, 4): the attitudes there, of which the second
        is the predicted one.
        """
        start, end = (tilt_columns(q, self.x, self.accelerometer.measured(force)) for q, force in ((q_first, first), (q_last, last)))
        return (start - end)[:, :2]


def as_known(accelerometer: Accelerometer | None, stills: tuple[Still, ...]) -> OwnAccelerometer:
    """From what the stills give so far (None: nothing), and how far they miss gravity's length under it."""
    if accelerometer is None or len(stills) < PARAMETERS + SPARE:
        return OwnAccelerometer(accelerometer or UNCALIBRATED, WANDERS_MPS2)
    length = np.linalg.norm(accelerometer.correct(np.array([still.accel_mean for still in stills])), axis=1)
    miss = float(sigma_of(length - np.median(length))) * np.sqrt(len(length) / (len(length) - PARAMETERS))
    return OwnAccelerometer(accelerometer, miss)


def length_information(own: OwnAccelerometer, stills: tuple[Still, ...], noise: Noise) -> np.ndarray:
    """(9, 9): what the lengths of gravity in the stills tell."""
    force = own.accelerometer.correct(np.array([still.accel_mean for still in stills]))
    white = float(np.mean(noise.velocity_random_walk**2)) / np.array([still.duration_s for still in stills])
    rows = own.length_rows(force) / np.sqrt(white + own.sigma_mps2**2)[:, None]
    return rows.T @ rows
