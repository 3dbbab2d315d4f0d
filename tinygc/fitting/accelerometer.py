"""What a fit says of the accelerometer that its references rest on: nine numbers, how well they are known, where they are from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.accelerometer.lengths import LengthFit
from session.accelerometer.parameters import BIASES, NAMES, PARAMETERS, SCALES, SHEARS, UPPER
from session.common.units import MG
from session.log.config import Accelerometer
from tinygc.models import linear
from tinygc.problem.joint_fit import JointFit

#: of the accelerometer's nine numbers and the gyroscope's twelve, in the order of a joint covariance
JOINT_NAMES = (*(f"accelerometer {name}" for name in NAMES), *linear.NAMES)
#: each number's unit for a person, and its size in SI
UNITS = {"ppm": 1e-6, "mrad": 1e-3, "mg": MG}


@dataclass(frozen=True, eq=False)
class AccelerometerFit:
    """mode: ``given``, ``fit`` or ``prior``; calibration that is in force; covariance (9, 9) of the numbers, SI, None where it was taken as
    given; unobserved: names of numbers that stay as they were; p_value: of a given one, that it holds; spread_mps2: of gravity's length
    over the stills before and after."""

    mode: str
    calibration: Accelerometer
    covariance: np.ndarray | None = None
    unobserved: tuple[str, ...] = ()
    p_value: float | None = None
    spread_mps2: tuple[float, float] | None = None

    @property
    def values(self) -> np.ndarray:
        """(9,): scale correction - 1, nonorthogonality and bias (m/s^2) in the triad's own frame, in the order of ``NAMES``.

        A full matrix is a turn of the body frame and an upper triangle (QR); the triangle is the sensor's.
        """
        upper = np.linalg.qr(self.calibration.matrix)[1]
        upper = upper * np.sign(np.diag(upper))[:, None]
        return np.concatenate([(upper - np.eye(3))[UPPER], self.calibration.bias_mps2])

    @property
    def sigmas(self) -> np.ndarray | None:
        """(9,) of ``values``; a correction close to the identity is known as well as what it makes."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance))

    def rows(self) -> list[tuple[str, str, np.ndarray, np.ndarray | None, list[str]]]:
        """Key of the JSON, unit, values (3,), sigmas (3,), in that unit, and names, as a table shows them."""
        found = []
        for key, unit, which in (
            ("scale_correction_ppm", "ppm", SCALES),
            ("nonorthogonality_mrad", "mrad", SHEARS),
            ("bias_mg", "mg", BIASES),
        ):
            sigma = None if self.sigmas is None else self.sigmas[which] / UNITS[unit]
            found.append((key, unit, self.values[which] / UNITS[unit], sigma, [NAMES[i] for i in which]))
        return found

    def to_json(self) -> dict:
        """``accelerometer`` of ``tinygc-fit/1``."""
        rows = self.rows()
        before, after = (None, None) if self.spread_mps2 is None else (each / MG for each in self.spread_mps2)
        return {
            "mode": self.mode,
            "equation": "f = matrix (measured - bias)",
            "matrix": self.calibration.matrix.tolist(),
            "bias_mps2": self.calibration.bias_mps2.tolist(),
            **{key: values.tolist() for key, _, values, _, _ in rows},
            "sigma": {key: None if sigmas is None else sigmas.tolist() for key, _, _, sigmas, _ in rows},
            "unobserved": list(self.unobserved),
            "p_value": self.p_value,
            "gravity_spread_before_mg": before,
            "gravity_spread_mg": after,
        }


def accelerometer_fit(calibration: Accelerometer, joint: JointFit | None, covariance: np.ndarray | None) -> AccelerometerFit:
    """Of a fit; covariance (21, 21) of ``JOINT_NAMES``, where noise was estimated."""
    if joint is None:
        return AccelerometerFit("given", calibration)
    own = joint.covariance if covariance is None else covariance[:PARAMETERS, :PARAMETERS]
    spread = float(np.std(joint.before)), float(np.std(joint.after))
    return AccelerometerFit(joint.mode, calibration, own, joint.unobserved, joint.p_value, spread)


def of_lengths(found: LengthFit) -> AccelerometerFit:
    """Of the stills' lengths alone, as measured."""
    spread = float(np.std(found.before)), float(np.std(found.after))
    return AccelerometerFit("fit", found.accelerometer, found.covariance, found.unobserved, None, spread)
