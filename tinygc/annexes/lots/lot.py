"""A lot: the numbers of its units, in SI and in displayed units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from session.io.units import DEG, G
from tinygc.models import linear
from tinygc.models.linear import BIAS, MATRIX

# A lot: prior knowledge of the next unit of a kind.


@dataclass(frozen=True, eq=False)
class PooledEffect:
    """An effect over a lot.

    share of the units that have it; mean and spread (one sigma between units that have it) of each of its parameters, SI, by name; p_value:
    that no unit has it, corrected for the whole catalogue; units: how many have an estimate; equivalent: other effects that could be the
    cause.
    """

    share: float
    mean: Mapping[str, float]
    spread: Mapping[str, float]
    p_value: float
    units: int
    equivalent: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Lot:
    """The numbers ``tinygc.annexes.lots.lot.NAMES`` over units of one kind.

    mean (21,) of the next unit, drift included; mean_covariance (21, 21) of that mean; spread (21, 21), the covariance between units,
    without measurement noise; tails: degrees of freedom of the units' distribution (Student's t, infinity where it is normal);
    repeatability (21, 21), the covariance of one unit from session to session beyond the stated one; units and sessions: how many it was
    made of; sensor: their model.  Numbers unknown to all sessions are NaN, in rows and columns, too.
    """

    sensor: str
    units: int
    sessions: int
    mean: np.ndarray
    mean_covariance: np.ndarray
    spread: np.ndarray
    tails: float
    repeatability: np.ndarray
    effects: Mapping[str, PooledEffect] = field(default_factory=dict)


# One session's results for one unit: the numbers a lot is made of.

#: names of the accelerometer's numbers in a lot: M's upper triangle less the identity (1), then the bias (m/s^2), of f = M (m - b)
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
#: names of the gyroscope's correction omega = E m + B (E of no unit, B in rad/s), then the accelerometer's
NAMES = (*linear.NAMES, *ACCELEROMETER_NAMES)


@dataclass(frozen=True)
class Weighed:
    """A session's estimate of one effect of the catalogue, reported or not: values and one sigma of its parameters in SI, by name.

    chi_square: improvement of the fit with it; named: whether explain reported it; probability that it is present, or None.
    """

    estimates: Mapping[str, float]
    sigmas: Mapping[str, float]
    chi_square: float
    named: bool
    probability: float | None = None


@dataclass(frozen=True, eq=False)
class UnitResult:
    """Result of one session.

    key, the hash of its inputs, options and version; serial of the unit; session, its folder's name; recorded, its time as ISO 8601, or
    empty; order, its place in production (by time where that is known, else by name).

    values (21,) in the order of ``NAMES``, NaN where unknown (the accelerometer was given, an axis was not turned); covariance (21, 21),
    NaN in those rows; closure_deg held out, and floor_deg; operator and station, where the notes name them; effects by id.
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
        """Return (21,) sigmas."""
        return np.sqrt(np.diag(self.covariance))


# The 21 numbers of a lot as sensor errors, rather than as the correction that removes them.
#
#     gyroscope      scale factor error (ppm), misalignment i to j (mrad), bias (mdps): of m = M omega + b with M = E^-1, b = -E^-1 B
#     accelerometer  scale factor error (ppm), nonorthogonality (mrad), bias (mg): of m = M^-1 f + b
#
# The terms are those of ``tinygc/models/linear.py``.

#: positions of the accelerometer's numbers in a lot's vector: M's upper triangle less the identity, then the bias
TRIAD, FORCE_BIAS = slice(12, 18), slice(18, 21)
_UPPER = np.triu_indices(3)
_STEP = 1e-6


@dataclass(frozen=True)
class SensorError:
    """One error of a sensor: sensor, word, component, unit, and that unit in SI."""

    sensor: str
    word: str
    component: str
    unit: str
    si: float

    @property
    def name(self) -> str:
        """Return a name such as ``gyro scale factor error x``."""
        return f"{self.sensor} {self.word} {self.component}"

    @property
    def key(self) -> str:
        """Return the key used in files, such as ``gyro_scale_factor_error_x_ppm``."""
        return f"{self.name} {self.unit}".replace(" ", "_")


_LEANS = [(i, j) for i in range(3) for j in range(3) if i != j]
SENSOR_ERRORS = (
    *(SensorError("gyro", "scale factor error", axis, "ppm", 1e-6) for axis in "xyz"),
    *(SensorError("gyro", "misalignment", f"{'xyz'[i]} to {'xyz'[j]}", "mrad", 1e-3) for i, j in _LEANS),
    *(SensorError("gyro", "bias", axis, "mdps", 1e-3 * DEG) for axis in "xyz"),
    *(SensorError("accel", "scale factor error", axis, "ppm", 1e-6) for axis in "xyz"),
    *(SensorError("accel", "nonorthogonality", pair, "mrad", 1e-3) for pair in ("xy", "xz", "yz")),
    *(SensorError("accel", "bias", axis, "mg", 1e-3 * G) for axis in "xyz"),
)
#: their units in SI (21,)
UNITS = np.array([each.si for each in SENSOR_ERRORS])
#: index in a lot's vector of each error, to first order
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
#: values of a sensor without an error
NO_ERROR = np.isin(NAMES, ("E_xx", "E_yy", "E_zz")).astype(float)


def sensor_errors(values: np.ndarray) -> np.ndarray:
    """Return (…, 21) sensor errors in their units, of (…, 21) SI in the order of ``NAMES``; NaN where their own number is unknown.

    The other numbers enter by second order only, and are taken as no error where unknown.
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
    """Return (21, 21), the derivative of ``sensor_errors`` at values (21,), by central differences; unknown numbers are taken as no
    error."""
    at = np.where(np.isfinite(values), values, NO_ERROR)
    steps = np.eye(len(NAMES)) * _STEP
    return (sensor_errors(at + steps) - sensor_errors(at - steps)).T / (2 * _STEP)


def error_covariance(covariance: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Return (…, 21, 21) in displayed units from SI; NaN where unknown."""
    unknown = ~np.isfinite(np.einsum("...ii->...i", covariance))
    found = J @ np.where(unknown[..., :, None] | unknown[..., None, :], 0.0, covariance) @ J.T
    lost = unknown[..., OWN]
    return np.where(lost[..., :, None] | lost[..., None, :], np.nan, found)
