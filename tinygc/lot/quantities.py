"""The 21 numbers of a lot as people see them: what the sensors err by, not what undoes it.

    gyroscope      scale factor error (ppm), misalignment i to j (mrad), bias (mdps): of m = M omega + b with M = E^-1, b = -E^-1 B
    accelerometer  scale factor error (ppm), nonorthogonality (mrad), bias (mg): of m = M^-1 f + b

The words are those of ``tinygc/models/field_parameters.py``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import DEG, G
from tinygc.lot.unit_result import NAMES
from tinygc.models.linear import BIAS, MATRIX

#: where the accelerometer's numbers stand in a lot's vector: M's upper triangle less the identity, then the bias
TRIAD, FORCE_BIAS = slice(12, 18), slice(18, 21)
_UPPER = np.triu_indices(3)
_STEP = 1e-6


@dataclass(frozen=True)
class Seen:
    """One number as people see it: sensor, word, component, unit, and that unit in SI."""

    sensor: str
    word: str
    component: str
    unit: str
    si: float

    @property
    def name(self) -> str:
        """``gyro scale factor error x``."""
        return f"{self.sensor} {self.word} {self.component}"

    @property
    def key(self) -> str:
        """As files name it: ``gyro_scale_factor_error_x_ppm``."""
        return f"{self.name} {self.unit}".replace(" ", "_")


_LEANS = [(i, j) for i in range(3) for j in range(3) if i != j]
SEEN = (
    *(Seen("gyro", "scale factor error", axis, "ppm", 1e-6) for axis in "xyz"),
    *(Seen("gyro", "misalignment", f"{'xyz'[i]} to {'xyz'[j]}", "mrad", 1e-3) for i, j in _LEANS),
    *(Seen("gyro", "bias", axis, "mdps", 1e-3 * DEG) for axis in "xyz"),
    *(Seen("accel", "scale factor error", axis, "ppm", 1e-6) for axis in "xyz"),
    *(Seen("accel", "nonorthogonality", pair, "mrad", 1e-3) for pair in ("xy", "xz", "yz")),
    *(Seen("accel", "bias", axis, "mg", 1e-3 * G) for axis in "xyz"),
)
#: their units in SI (21,)
UNITS = np.array([each.si for each in SEEN])
#: which number of a lot's vector each of them is, to first order
OWN = np.array(
    [
        *(NAMES.index(f"E_{axis}{axis}") for axis in "xyz"),
        *(NAMES.index(f"E_{'xyz'[i]}{'xyz'[j]}") for i, j in _LEANS),
        *(NAMES.index(f"B_{axis}") for axis in "xyz"),
        *(NAMES.index(f"accel_scale_{axis}") for axis in "xyz"),
        *(NAMES.index(f"accel_nonorthogonality_{pair}") for pair in ("xy", "xz", "yz")),
        *(NAMES.index(f"accel_bias_{axis}") for axis in "xyz"),
    ]
)
#: of a sensor without an error
NO_ERROR = np.isin(NAMES, ("E_xx", "E_yy", "E_zz")).astype(float)


def seen(values: np.ndarray) -> np.ndarray:
    """(…, 21) as people see them, in their units, of (…, 21) SI in the order of ``NAMES``; NaN where their own number is not told.

    The others, which bend it by second order only, count as no error where they are not told.
    """
    values = np.asarray(values, dtype=float)
    shape, filled = values.shape[:-1], np.where(np.isfinite(values), values, NO_ERROR)
    M = np.linalg.inv(filled[..., MATRIX].reshape(*shape, 3, 3))
    length = np.linalg.norm(M, axis=-1)
    u = M / length[..., None]
    leans = np.stack([np.arctan2(u[..., i, j], u[..., i, i]) for i, j in _LEANS], axis=-1)
    bias = -np.einsum("...ij,...j->...i", M, filled[..., BIAS])
    T = np.zeros((*shape, 3, 3))
    T[..., _UPPER[0], _UPPER[1]] = filled[..., TRIAD]
    R = np.linalg.inv(T + np.eye(3))
    size = np.linalg.norm(R, axis=-1)
    r = R / size[..., None]
    skew = np.stack([np.arcsin(np.clip(np.sum(r[..., i, :] * r[..., j, :], axis=-1), -1, 1)) for i, j in ((0, 1), (0, 2), (1, 2))], axis=-1)
    found = np.concatenate([length - 1, leans, bias, size - 1, skew, filled[..., FORCE_BIAS]], axis=-1) / UNITS
    return np.where(np.isfinite(values[..., OWN]), found, np.nan)


def jacobian(values: np.ndarray) -> np.ndarray:
    """(21, 21): of ``seen`` at values (21,), by central differences; what is not told counts as no error."""
    at = np.where(np.isfinite(values), values, NO_ERROR)
    steps = np.eye(len(NAMES)) * _STEP
    return (seen(at + steps) - seen(at - steps)).T / (2 * _STEP)


def seen_covariance(covariance: np.ndarray, J: np.ndarray) -> np.ndarray:
    """(…, 21, 21) in people's units, of one in SI; NaN for what is not told."""
    unknown = ~np.isfinite(np.einsum("...ii->...i", covariance))
    found = J @ np.where(unknown[..., :, None] | unknown[..., None, :], 0.0, covariance) @ J.T
    lost = unknown[..., OWN]
    return np.where(lost[..., :, None] | lost[..., None, :], np.nan, found)
