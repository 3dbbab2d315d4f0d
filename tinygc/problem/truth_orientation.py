"""Absolute orientation error (AOE) of a run: the attitude carried by the gyro alone, from the first true one, against the truth.

AOE = sqrt(mean |log(R_true^T R_carried)|^2) over all moments of the truth (Brossard et al. 2020, and the paper's Table 1): one number, in
which yaw counts as much as tilt, and an error early in the run as much as one at its end.
"""

from __future__ import annotations

import numpy as np

from session.detect.truth_segments import moments_inside
from session.log.samples import Samples
from session.log.truth import Truth
from tinygc.attitude import rotation
from tinygc.attitude.integrate import steps
from tinygc.closure.residual import RateMap


def orientation_error(samples: Samples, truth: Truth, model: RateMap, integrator: str = "exact") -> tuple[np.ndarray, np.ndarray]:
    """t_s (K,) since the first moment, and rotation vectors (K, 3) rad in the body's axes, of the truth's moments within the log.

    ``model`` maps measured rates (N, 3) to calibrated ones.  Raises DataError where the truth's times are not the log's.
    """
    rows, q_true = moments_inside(samples, truth)
    part = samples.between(int(rows[0]), int(rows[-1]) + 1)
    # The whole log goes through the model: one with a memory has its past then.
    rate = np.asarray(model(samples.gyro))[rows[0] : rows[-1] + 1]
    running = rotation.accumulate(steps(rate, part.dt_s, integrator))
    q = np.concatenate([q_true[:1], rotation.multiply(q_true[0], running)])[rows - rows[0]]
    return part.t_s[rows - rows[0]], rotation.log(rotation.multiply(rotation.conjugate(q_true), q))


def absolute_orientation_error(samples: Samples, truth: Truth, model: RateMap, integrator: str = "exact") -> float:
    """AOE in rad."""
    _, error = orientation_error(samples, truth, model, integrator)
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
