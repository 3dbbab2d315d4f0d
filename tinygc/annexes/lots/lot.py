"""A lot: the numbers of its units, in SI and as people see them, and its sessions as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from session.io.errors import CalibrationError
from session.io.numeric import sigma_of
from session.io.units import DEG, G
from tinygc.models import linear
from tinygc.models.linear import BIAS, MATRIX

# A lot: prior knowledge of the next unit of a kind.


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


@dataclass(frozen=True, eq=False)
class UnitResult:
    """Result of one session.

    key, the hash of its inputs, options and version; serial of the unit; session, its folder's name; values (21,) in the order of
    ``NAMES``, NaN where unknown (the accelerometer was given, an axis was not turned); covariance (21, 21), NaN in those rows; order, its
    place in production (by time where that is known, else by name).
    """

    key: str
    serial: str
    session: str
    values: np.ndarray
    covariance: np.ndarray
    order: float = 0.0


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


# Sessions of a lot as compact arrays, in the order of production, sized for a hundred thousand.

COUNT = len(NAMES)
TRIANGLE = np.triu_indices(COUNT)
#: variance of an unknown number, in squares of the parameter's scale: it has no weight, and matrices stay invertible
UNTOLD = 1e8
#: units processed at once: some 20 MB
CHUNK = 1024


@dataclass(frozen=True, eq=False)
class UnitChunk:
    """Units and their sessions.

    y (S, 21) and noise (S, 21, 21) in scales about the centre; first (U,) of each unit among the sessions; count (U,); place (U,), of 0 to
    1 through production; told (U,): number of values known from its sessions.
    """

    y: np.ndarray
    noise: np.ndarray
    first: np.ndarray
    count: np.ndarray
    place: np.ndarray
    told: np.ndarray


@dataclass(frozen=True, eq=False)
class LotSessions:
    """Sessions of a lot: values (S, 21), SI, NaN where unknown; covariances (S, 231), their upper triangles, in units of scale (21,).

    told (S, 21): known values.  Sessions of a unit are adjacent: first (U,), count (U,); serials (U,); place (U,): production index of the
    unit; centre (21,) and scale (21,): median and robust sigma over all sessions, SI; known (21,): numbers known of at least two units;
    twice (21,): numbers with two sessions of at least one unit; names (S,).
    """

    values: np.ndarray
    covariances: np.ndarray
    told: np.ndarray
    first: np.ndarray
    count: np.ndarray
    serials: list[str]
    place: np.ndarray
    centre: np.ndarray
    scale: np.ndarray
    known: np.ndarray
    twice: np.ndarray
    names: list[str]

    @property
    def units(self) -> int:
        """Return the number of units."""
        return len(self.first)

    @property
    def sessions(self) -> int:
        """Return the number of sessions."""
        return len(self.values)

    @property
    def unit(self) -> np.ndarray:
        """Return (S,): the unit of each session."""
        return np.repeat(np.arange(self.units), self.count)

    def sigmas(self) -> np.ndarray:
        """Return the stated sigmas (S, 21), SI; NaN where unknown."""
        diagonal = np.flatnonzero(TRIANGLE[0] == TRIANGLE[1])
        return np.where(self.told, np.sqrt(self.covariances[:, diagonal]) * self.scale, np.nan)

    def covariance(self, sessions: np.ndarray | slice) -> np.ndarray:
        """Return the stated covariances (…, 21, 21), in scales; ``UNTOLD`` where unknown."""
        packed = self.covariances[sessions]
        full = np.empty((len(packed), COUNT, COUNT))
        full[:, TRIANGLE[0], TRIANGLE[1]] = packed
        full[:, TRIANGLE[1], TRIANGLE[0]] = packed
        return full

    def chunks(self, units: np.ndarray | None = None, at_once: int = CHUNK) -> Iterator[tuple[np.ndarray, UnitChunk]]:
        """Yield the numbers of units and their data, chunk by chunk; all units, or the given ones."""
        numbers = np.arange(self.units) if units is None else units
        last = max(self.units - 1, 1)
        for begin in range(0, len(numbers), at_once):
            part = numbers[begin : begin + at_once]
            count = self.count[part]
            first = np.concatenate([[0], np.cumsum(count)[:-1]])
            rows = np.repeat(self.first[part] - first, count) + np.arange(count.sum())
            y = np.where(self.told[rows], (self.values[rows] - self.centre) / self.scale, 0.0)
            told = np.logical_or.reduceat(self.told[rows], first).sum(axis=1)
            yield part, UnitChunk(y, self.covariance(rows), first, count, self.place[part] / last, told)


def lot_sessions(results: Iterable[UnitResult]) -> LotSessions:
    """Collect sessions in any order; those with one key count once, and a session without a serial number is a unit of its own.

    Raises CalibrationError where fewer than two units have any value.
    """
    rows, sensor_errors = [], set()
    values, packed = [], bytearray()  # grows in place, and becomes the array without a copy
    for each in results:
        variance = np.diag(each.covariance)
        if each.key in sensor_errors or not (np.isfinite(each.values) & (variance > 0)).any():
            continue
        sensor_errors.add(each.key)
        values.append(np.array(each.values, dtype=float))
        packed += np.asarray(each.covariance, dtype=float)[TRIANGLE].tobytes()
        rows.append((each.serial or f"\0{each.key}", each.order, each.session))
    serials = np.array([row[0] for row in rows], dtype=object)
    names, of_unit = np.unique(serials.astype(str), return_inverse=True) if rows else (np.array([]), np.array([], dtype=int))
    if len(names) < 2:
        raise CalibrationError(f"a lot needs fitted sessions of two units or more, got {len(names)}; give more, or name their serials")
    order = np.array([row[1] for row in rows], dtype=float)
    made = np.full(len(names), np.inf)
    np.minimum.at(made, of_unit, order)
    place = np.empty(len(names))
    place[np.lexsort((names, made))] = np.arange(len(names))
    sort = np.lexsort((order, place[of_unit]))
    count = np.bincount(place[of_unit].astype(int))
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    rows = [rows[i] for i in sort]
    all_values = np.array(values)[sort]
    covariances = np.frombuffer(packed).reshape(len(rows), -1)
    if (sort != np.arange(len(rows))).any():
        covariances = covariances[sort]
    shown = [names[i] for i in np.argsort(place)]
    serial = ["" if str(name).startswith("\0") else str(name) for name in shown]
    told, centre, scale = _scaled(all_values, covariances)
    units_telling = np.logical_or.reduceat(told, first).sum(axis=0)
    return LotSessions(
        np.where(told, all_values, np.nan),
        covariances,
        told,
        first,
        count,
        serial,
        np.arange(len(names), dtype=float),
        centre,
        scale,
        units_telling >= 2,
        np.any(np.add.reduceat(told.astype(int), first) >= 2, axis=0),
        [row[2] for row in rows],
    )


def _scaled(values: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return told, centre and scale; covariances are scaled in place, with ``UNTOLD`` for unknown values."""
    i, j = TRIANGLE
    diagonal = np.flatnonzero(i == j)
    variance = covariances[:, diagonal]
    told = np.isfinite(values) & np.isfinite(variance) & (variance > 0)
    centre, scale = np.zeros(COUNT), np.ones(COUNT)
    for n in range(COUNT):
        if told[:, n].any():
            mine = values[told[:, n], n]
            centre[n] = np.median(mine)
            noise = np.sqrt(np.median(variance[told[:, n], n]))
            scale[n] = max(float(sigma_of(mine - centre[n])), noise)
    for k in range(len(i)):
        both = told[:, i[k]] & told[:, j[k]]
        covariances[:, k] = np.where(both, covariances[:, k] / (scale[i[k]] * scale[j[k]]), UNTOLD if i[k] == j[k] else 0.0)
    return told, centre, scale
