"""A lot: the numbers of its units, in SI and as people see them, and its sessions as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Annotated, Any, ClassVar

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError
from session.base.records import Key
from session.base.results import Column, Maybe, Number, shown
from session.base.units import MDPS
from session.detect.accelerometer import NAMES as TRIAD
from tinygc.estimation.accelerometer import ROWS, derivative, triad_errors
from tinygc.estimation.accelerometer import UNITS as SIZES
from tinygc.models import linear
from tinygc.models.linear import WORDS, field_vector

# A lot: prior knowledge of the next unit of a kind.


Sigmas = Annotated[np.ndarray, Column(Maybe(Number(0)))]


@dataclass(frozen=True, eq=False, kw_only=True)
class Lot:
    """The numbers ``tinygc.features.fleet.lot.NAMES`` over units of one kind.

    mean (21,) of the next unit, drift included, and its sigma; spread (21,), one sigma between units, without measurement noise;
    repeatability (21,), one sigma of a unit from session to session beyond the stated one; units and sessions: how many it was made of;
    sensor: their model.  Unknown numbers are NaN.
    """

    schema: ClassVar[str] = "tinygc-lot/3"
    version: Annotated[str, Key(absent="")] = VERSION
    sensor: str
    units: Annotated[int, Number(1, whole=True)]
    sessions: Annotated[int, Number(1, whole=True)]
    names: tuple[str, ...]
    mean: Annotated[np.ndarray, Column(Maybe(Number()))]
    mean_sigma: Sigmas
    spread: Sigmas
    repeatability: Sigmas

    @staticmethod
    def fault(table: Mapping[str, Any]) -> str:
        """What is wrong with its names and how many numbers it has; empty where nothing is."""
        if table["names"] != list(NAMES):
            return f"names are {shown(table['names'])}, expected the {len(NAMES)} of docs/formats.md in their order"
        if table["sessions"] < table["units"]:
            return f"sessions is {table['sessions']}, expected at least one for each unit of {table['units']}"
        for key in ("mean", "mean_sigma", "spread", "repeatability"):
            if len(table[key]) != len(NAMES):
                return f"{key} has {len(table[key])} entries, expected {len(NAMES)}, one for each name"
        return ""


# One session's results for one unit: the numbers a lot is made of.

#: names of the accelerometer's numbers in a lot: M's upper triangle less the identity (1), then the bias (m/s^2), of f = M (m - b)
ACCELEROMETER_NAMES = tuple(f"accel_{name.replace(' ', '_')}" for name in TRIAD)
#: names of the gyroscope's correction omega = E m + B (E of no unit, B in rad/s), then the accelerometer's
NAMES = (*linear.NAMES, *ACCELEROMETER_NAMES)


@dataclass(frozen=True, eq=False)
class UnitResult:
    """Result of one session.

    key, the hash of its inputs, options and version; serial of the unit; folder; values (21,) in the order of
    ``NAMES``, NaN where unknown (the accelerometer was given, an axis was not turned); covariance (21, 21), NaN in those rows; order, its
    place in production (by time where that is known, else by name); model of its sensor; recorded, its date.
    """

    key: str
    serial: str
    folder: str
    values: np.ndarray
    covariance: np.ndarray
    order: float = 0.0
    model: str = ""
    recorded: str = ""

    @property
    def session(self) -> str:
        """Name of its folder."""
        return PurePath(self.folder).name


# The 21 numbers of a lot as sensor errors, rather than as the correction that removes them.
#
#     gyroscope      scale factor error (ppm), misalignment i to j (mrad), bias (mdps): of m = M omega + b with M = E^-1, b = -E^-1 B
#     accelerometer  scale factor error (ppm), nonorthogonality (mrad), bias (mg): of m = M^-1 f + b
#
# The terms are those of ``tinygc/models/linear.py``.

#: name, unit, and that unit in SI of each
SENSOR_ERRORS = [
    *((f"gyro {word} {component}", unit, si) for word, components, unit, si in WORDS[:2] for component in components),
    *((f"gyro bias {axis}", "mdps", MDPS) for axis in "xyz"),
    *((f"accel {word} {TRIAD[i].split()[-1]}", unit, SIZES[unit]) for _, word, unit, which in ROWS for i in which),
]
#: their units in SI (21,)
UNITS = np.array([si for _, _, si in SENSOR_ERRORS])
#: index in a lot's vector of each error, to first order
OWN = np.array([0, 4, 8, 1, 2, 3, 5, 6, 7, 9, 10, 11, *(linear.PARAMETERS + i for *_, which in ROWS for i in which)])
#: values of a sensor without an error
NO_ERROR = np.isin(NAMES, ("E_xx", "E_yy", "E_zz")).astype(float)


def key_of(name: str, unit: str) -> str:
    """Return the key used in files, such as ``gyro_scale_factor_error_x_ppm``."""
    return f"{name} {unit}".replace(" ", "_")


def sensor_errors(values: np.ndarray) -> np.ndarray:
    """Return (21,) sensor errors in their units, of (21,) SI in the order of ``NAMES``; NaN where their own number is unknown.

    The other numbers enter by second order only, and are taken as no error where unknown.
    """
    filled = np.where(np.isfinite(values), values, NO_ERROR)
    gyro, accel = field_vector(filled[: linear.PARAMETERS]), triad_errors(filled[linear.PARAMETERS :])
    found = np.concatenate([gyro[:9], gyro[-3:], *(accel[which] for *_, which in ROWS)]) / UNITS
    return np.where(np.isfinite(np.asarray(values, dtype=float)[OWN]), found, np.nan)


def jacobian(values: np.ndarray) -> np.ndarray:
    """Return (21, 21), the derivative of ``sensor_errors`` at values (21,), by central differences; unknown numbers are taken as no
    error."""
    return derivative(sensor_errors, np.where(np.isfinite(values), values, NO_ERROR))


def error_sigmas(sigmas: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Return (…, 21) in displayed units from SI; NaN where unknown."""
    return np.where(np.isfinite(sigmas[..., OWN]), np.sqrt(np.nan_to_num(sigmas) ** 2 @ (J**2).T), np.nan)


# Sessions of a lot as arrays, in the order of production.

COUNT = len(NAMES)


@dataclass(frozen=True, eq=False)
class LotSessions:
    """Sessions of a lot: values (S, 21) and their variances (S, 21), SI; known (S, 21): those that are known.

    Sessions of a unit are adjacent: first (U,), count (U,); serials (U,), in the order of production; names (S,).
    """

    values: np.ndarray
    variances: np.ndarray
    known: np.ndarray
    first: np.ndarray
    count: np.ndarray
    serials: list[str]
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

    @property
    def place(self) -> np.ndarray:
        """Return (U,): the place of each unit in production, of 0 to 1."""
        return np.linspace(0.0, 1.0, self.units)


def lot_sessions(results: Iterable[UnitResult]) -> LotSessions:
    """Collect sessions in any order; those with one key count once, and a session without a serial number is a unit of its own.

    Raises CalibrationError where fewer than two units have any value.
    """
    rows = {}
    for each in results:
        variance = np.diag(each.covariance)
        if each.key not in rows and (np.isfinite(each.values) & (variance > 0)).any():
            rows[each.key] = (each.serial or f"\0{each.key}", each.order, each.session, each.values, variance.copy())
    serials, order, sessions, values, variances = zip(*rows.values(), strict=True) if rows else ((),) * 5
    names, of_unit = np.unique(np.array(serials, dtype=str), return_inverse=True)
    if len(names) < 2:
        raise CalibrationError(f"a lot needs fitted sessions of two units or more, got {len(names)}; give more, or name their serials")
    made = np.full(len(names), np.inf)
    np.minimum.at(made, of_unit, order)
    by_place = np.lexsort((names, made))
    place = np.argsort(by_place)[of_unit]
    sort = np.lexsort((order, place))
    count = np.bincount(place)
    y, variance = np.array(values, dtype=float)[sort], np.array(variances, dtype=float)[sort]
    return LotSessions(
        y,
        variance,
        np.isfinite(y) & np.isfinite(variance) & (variance > 0),
        np.cumsum(count) - count,
        count,
        ["" if str(name).startswith("\0") else str(name) for name in names[by_place]],
        [sessions[i] for i in sort],
    )
