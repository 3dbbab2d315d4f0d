"""What one session told of one unit: the numbers that a lot is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from tinygc.models import linear

#: of the accelerometer's numbers in a lot: M's upper triangle less the identity (1), then the bias (m/s^2), of f = M (m - b)
ACCELEROMETER_NAMES = (
    "accel_scale_x",
    "accel_nonorthogonality_xy",
    "accel_nonorthogonality_xz",
    "accel_scale_y",
    "accel_nonorthogonality_yz",
    "accel_scale_z",
    "accel_bias_x",
    "accel_bias_y",
    "accel_bias_z",
)
#: of the gyroscope's correction omega = E m + B (E of no unit, B in rad/s), then the accelerometer's
NAMES = (*linear.NAMES, *ACCELEROMETER_NAMES)


@dataclass(frozen=True)
class Weighed:
    """What a session says of one effect of the catalogue, named or not: estimate and one sigma of each of its parameters in SI, by name;
    chi_square: by how much the fit is better with it; named: whether explain has named it; probability that it is there, or None."""

    estimates: Mapping[str, float]
    sigmas: Mapping[str, float]
    chi_square: float
    named: bool
    probability: float | None = None


@dataclass(frozen=True, eq=False)
class UnitResult:
    """Of one session: key, the hash of its inputs, options and version; serial of the unit; session, its folder's name; recorded, its time
    as ISO 8601, or empty; order, its place in production (by time where that is known, else by name).

    values (21,) in the order of ``NAMES``, NaN where the session did not tell (the accelerometer was given, an axis was not turned);
    covariance (21, 21), NaN in those rows; closure_deg held out, and floor_deg; operator and station, where the notes name them;
    effects by id.
    """

    key: str
    serial: str
    session: str
    values: np.ndarray
    covariance: np.ndarray
    recorded: str = ""
    order: float = 0.0
    closure_deg: float | None = None
    floor_deg: float | None = None
    operator: str = ""
    station: str = ""
    effects: Mapping[str, Weighed] = field(default_factory=dict)

    @property
    def sigmas(self) -> np.ndarray:
        """(21,)."""
        return np.sqrt(np.diag(self.covariance))
