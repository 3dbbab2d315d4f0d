"""The linear calibration in the field's words: what the sensor does, instead of what undoes it.

The calibration is omega = E m + B.  The sensor is its inverse, m = M omega + b with M = E^-1 and b = -E^-1 B.  Row i of M is the
response of axis i: its length is the scale factor (1 by the data sheet), its direction u_i the input axis (IEEE 528, 1431).

    scale factor error      |M_i| - 1                                      the axis reads so much too far
    misalignment i to j     angle by which input axis i leans towards reference axis j: atan2(u_ij, u_ii)
    nonorthogonality ij     90 deg less the angle between input axes i and j: asin(u_i . u_j)
    triad rotation          rotation vector from the reference axes to the nearest right-angled triad of the input axes (polar)
    bias                    b, the output at no rate

The reference axes are those of the pre-calibrated accelerometer.  Six misalignments are three nonorthogonalities and one rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from session.common.units import DEG
from tinygc.models.linear import BIAS, MATRIX, NAMES, PARAMETERS

AXES = "xyz"
#: a quantity that moves by this much per unit of a parameter that nothing shows is not shown either
DEPENDS = 0.1
#: k of the expanded uncertainty
COVERAGE_FACTOR = 2.0


@dataclass(frozen=True)
class Quantity:
    """One number of a report: word, component (x, xy, …), unit; value and its expanded uncertainty (k = 2) in that unit.

    observed: whether the session shows it; at_most: an upper limit where it does not, or NaN; note: what a reader must know.
    """

    word: str
    component: str
    unit: str
    value: float
    expanded: float
    observed: bool = True
    at_most: float = float("nan")
    note: str = ""


#: word, components, unit, unit in SI
WORDS = (
    ("scale factor error", ("x", "y", "z"), "ppm", 1e-6),
    ("misalignment", ("x to y", "x to z", "y to x", "y to z", "z to x", "z to y"), "mrad", 1e-3),
    ("nonorthogonality", ("xy", "yz", "zx"), "mrad", 1e-3),
    ("triad rotation", ("x", "y", "z"), "mrad", 1e-3),
    ("bias", ("x", "y", "z"), "dps", DEG),
)


def scale_factor_errors(E: np.ndarray) -> np.ndarray:
    """(…, 3): by how much each axis reads too far, of calibrations E (…, 3, 3)."""
    return np.linalg.norm(np.linalg.inv(E), axis=-1) - 1


def field_vector(vector: np.ndarray) -> np.ndarray:
    """(18,) SI, in the order of ``WORDS``, from ``LinearModel.vector`` (12,).  Raises numpy's LinAlgError for a singular E."""
    E, B = vector[MATRIX].reshape(3, 3), vector[BIAS]
    M = np.linalg.inv(E)
    length = np.linalg.norm(M, axis=1)
    u = M / length[:, None]
    lean = [np.arctan2(u[i, j], u[i, i]) for i in range(3) for j in range(3) if i != j]
    skew = [np.arcsin(np.clip(u[i] @ u[j], -1, 1)) for i, j in ((0, 1), (1, 2), (2, 0))]
    left, _, right = np.linalg.svd(u)
    triad = left @ right  # rows: the right-angled triad nearest to the input axes
    turn = Rotation.from_matrix(triad.T).as_rotvec() if np.linalg.det(triad) > 0 else np.full(3, np.nan)
    return np.concatenate([length - 1, lean, skew, turn, -M @ B])


def field_jacobian(vector: np.ndarray) -> np.ndarray:
    """(18, 12) of ``field_vector``, by central differences."""
    steps = np.eye(PARAMETERS) * 1e-6
    return np.stack([(field_vector(vector + step) - field_vector(vector - step)) / 2e-6 for step in steps], axis=1)


def field_quantities(vector: np.ndarray, covariance: np.ndarray, unobserved: tuple[str, ...] = ()) -> list[Quantity]:
    """18 quantities of a linear model (12,) with its covariance (12, 12); unobserved: names of parameters that nothing shows."""
    values, jacobian = field_vector(vector), field_jacobian(vector)
    sigma = np.sqrt(np.diag(jacobian @ covariance @ jacobian.T))
    hidden = [i for i, name in enumerate(NAMES) if name in unobserved]
    quantities, at = [], 0
    for word, components, unit, si in WORDS:
        for component in components:
            shown = not (np.abs(jacobian[at, hidden]) > DEPENDS).any()
            value, expanded = values[at] / si, COVERAGE_FACTOR * sigma[at] / si
            quantities.append(Quantity(word, component, unit, float(value), float(expanded), bool(shown)))
            at += 1
    return quantities
