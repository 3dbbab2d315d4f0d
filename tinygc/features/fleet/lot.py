"""A lot: the numbers of its units, its sessions as arrays, and mean, drift, spread and repeatability without measurement noise
(docs/features/fleet/lots.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Annotated, Any, ClassVar

import numpy as np
from scipy.special import stdtr

from session import VERSION
from session.base.errors import CalibrationError
from session.base.numeric import MEDIAN_SIGMAS, derivative
from session.base.records import Key, Share
from session.base.results import Column, Maybe, Number, shown
from session.base.texts import significant
from session.base.units import MDPS
from session.detect.accelerometer import NAMES as TRIAD
from tinygc.estimation.accelerometer import ROWS, triad_errors
from tinygc.estimation.accelerometer import UNITS as SIZES
from tinygc.inference.solve import inverse
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


# The estimate, each number by itself.  That of unit u is
#
#     y_u = mean + drift (place_u - 1/2) + b_u + e_u     b_u ~ N(0, spread^2)     e_u ~ N(0, noise_u)
#
# place goes from 0 to 1 through production.  noise_u is what the unit's sessions state, each with the repeatability.  The spread has the
# largest restricted likelihood; mean and drift are weighted least squares.  Units that stand out are left out.

#: family-wise p-value, over all units and numbers, of a unit that stands out: one false one in a hundred lots
FAMILY_P = 0.01
#: p-value of a drift of any number (over all of them) below which it is included in the mean of the next unit
DRIFT_P = 0.01
#: degrees of freedom, for each value, of a scatter from the median
MEDIAN_FREEDOM = 0.37
#: most rounds of leaving out units, and most steps of a spread with the share of a step that ends them
ROUNDS, STEPS, SETTLED = 10, 100, 1e-9


@dataclass(frozen=True, eq=False)
class LotEstimate:
    """Estimates of a lot, SI, in the order of ``NAMES``, NaN where unknown.

    mean (21,) at the middle of production and its sigma; drift (21,) from the first unit to the last and its sigma; freedom (21,) of both;
    drift_p, that none of them drifts; next_mean (21,) of the next unit and its sigma, with the drift if it is significant (drifts); spread
    (21,) and repeatability (21,), one sigma; off (U, 21), of each unit from the mean at its place, and off_sigma; p_values (U, 21), over
    all units and numbers, of one so far off.
    """

    mean: np.ndarray
    mean_sigma: np.ndarray
    drift: np.ndarray
    drift_sigma: np.ndarray
    freedom: np.ndarray
    drift_p: float
    drifts: bool
    next_mean: np.ndarray
    next_sigma: np.ndarray
    spread: np.ndarray
    repeatability: np.ndarray
    off: np.ndarray
    off_sigma: np.ndarray
    p_values: np.ndarray

    @property
    def excluded(self) -> np.ndarray:
        """Return (U,): the units that stand out."""
        return self.p_values.min(axis=1) < FAMILY_P


def estimate(lot: LotSessions) -> LotEstimate:
    """Estimate the lot's numbers without the units that stand out, at first those that are far from the medians."""
    y, noise = joined(lot, np.zeros(COUNT))
    off = y - _median(y)
    spread = _median(np.abs(off)) / MEDIAN_SIGMAS
    far = off / np.sqrt(np.maximum(noise, spread**2))
    excluded = family(far, MEDIAN_FREEDOM * (np.isfinite(y).sum(axis=0) - 1)).min(axis=1) < FAMILY_P
    for _ in range(ROUNDS):
        found = without(lot, excluded)
        if (found.excluded == excluded).all():
            break
        excluded = found.excluded
    return found


def _median(y: np.ndarray) -> np.ndarray:
    """Return (21,) of (U, 21), NaN of an unknown number."""
    return np.array([np.median(each[np.isfinite(each)]) if np.isfinite(each).any() else np.nan for each in y.T])


def joined(lot: LotSessions, repeatability: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (U, 21), the mean of each unit's sessions by their variances and the repeatability's (21,), and its variance."""
    weight = np.where(lot.known, 1 / (lot.variances + repeatability), 0.0)
    total = np.add.reduceat(weight, lot.first)
    total[total == 0] = np.nan
    return np.add.reduceat(weight * np.where(lot.known, lot.values, 0.0), lot.first) / total, 1 / total


def family(far: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """Return (U, 21) two-sided p-values of Student's t, times the number of units and of the numbers that a unit shows; 1 if unknown."""
    tests = len(far) * np.isfinite(far).sum(axis=1, keepdims=True)
    return np.minimum(1.0, np.nan_to_num(2 * tests * stdtr(np.maximum(freedom, 1e-3), -np.abs(far)), nan=1.0))


def repeated(lot: LotSessions, belongs: np.ndarray) -> np.ndarray:
    """Return the repeatability's variances (21,): mean square of sessions about their unit's mean, less the stated one; NaN where no unit
    has two."""
    count = np.add.reduceat(lot.known.astype(int), lot.first)
    mean = np.add.reduceat(np.where(lot.known, lot.values, 0.0), lot.first) / np.maximum(count, 1)
    share = np.where(lot.known & (count > 1)[lot.unit] & belongs[lot.unit, None], 1.0, 0.0)
    square = np.where(lot.known, (lot.values - mean[lot.unit]) ** 2 - (1 - 1 / np.maximum(count, 1)[lot.unit]) * lot.variances, 0.0)
    freedom = np.where(belongs[:, None], np.maximum(count - 1, 0), 0).sum(axis=0)
    return np.where(freedom > 0, np.maximum((share * square).sum(axis=0), 0.0) / np.maximum(freedom, 1), np.nan)


def straight_line(y: np.ndarray, x: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean and drift (21, 2) of values (U, 21) at x (U, 21) with weights w, their covariance (21, 2, 2), residuals (U, 21).

    Where x is zero there is no drift: 0, as all that is not determined.
    """
    covariance = np.nan_to_num(inverse(moments(w, x)), posinf=0.0)
    beta = (covariance @ np.stack([(w * y).sum(axis=0), (w * x * y).sum(axis=0)], axis=-1)[..., None])[..., 0]
    return beta, covariance, y - beta[:, 0] - x * beta[:, 1]


def moments(w: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return (21, 2, 2), sums of w, w x and w x^2 over the units."""
    mixed = (w * x).sum(axis=0)
    return np.moveaxis(np.array([[w.sum(axis=0), mixed], [mixed, (w * x * x).sum(axis=0)]]), -1, 0)


def spread_of(y: np.ndarray, x: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Return the spread's variances (21,) of the largest restricted likelihood, by Fisher's scoring; noise (U, 21), infinite if unknown."""
    known = np.isfinite(noise)
    scale = variance = (np.where(known, straight_line(y, x, 1.0 * known)[2], 0.0) ** 2).sum(axis=0)
    for _ in range(STEPS):
        w = 1 / (noise + variance)
        _, covariance, residual = straight_line(y, x, w)
        hat = covariance @ moments(w**2, x)
        trace = w.sum(axis=0) - np.einsum("nii->n", hat)
        information = (w**2).sum(axis=0) - np.einsum("nij,nji->n", covariance, 2 * moments(w**3, x)) + np.einsum("nij,nji->n", hat, hat)
        step = (((w * residual) ** 2).sum(axis=0) - trace) / np.where(information > 0, information, np.inf)
        before, variance = variance, np.maximum(variance + step, 0.0)
        if (np.abs(variance - before) <= SETTLED * scale).all():
            break
    return variance


def without(lot: LotSessions, excluded: np.ndarray) -> LotEstimate:
    """Estimate the lot's numbers without these units (U,)."""
    again = repeated(lot, ~excluded)
    y, noise = joined(lot, np.nan_to_num(again))
    counted = np.isfinite(y) & ~excluded[:, None]
    units = counted.sum(axis=0)
    known, several = np.where(units >= 2, 1.0, np.nan), np.where(units > 2, 1.0, np.nan)  # two units have no drift
    along, end = (np.nan_to_num(several * each) for each in (lot.place[:, None] - 0.5, 0.5 + 1 / max(lot.units - 1, 1)))
    weighed, filled = np.where(counted, noise, np.inf), np.nan_to_num(y)
    variance = spread_of(filled, along, weighed)
    w = 1 / (weighed + variance)
    beta, covariance, _ = straight_line(filled, along, w)
    freedom = np.maximum(units - np.where(units > 2, 2, 1), 1)
    mean, drift = beta.T
    (mean_variance, mixed), (_, drift_variance) = np.moveaxis(covariance, 0, -1)
    drift_sigma = several * np.sqrt(drift_variance)
    p = 2 * np.sum(units >= 2) * stdtr(freedom, -np.abs(drift) / drift_sigma)
    drift_p = float(np.min(p, initial=1.0, where=np.isfinite(p)))
    if drift_p < DRIFT_P:
        next_mean, next_variance = mean + end * drift, mean_variance + 2 * end * mixed + end**2 * drift_variance
    else:
        next_variance = 1 / (known * w.sum(axis=0))
        next_mean = next_variance * (w * filled).sum(axis=0)
    off = known * (y - mean - along * drift)
    off_sigma = np.sqrt(noise + variance + mean_variance + 2 * along * mixed + along**2 * drift_variance)
    return LotEstimate(
        known * mean,
        known * np.sqrt(mean_variance),
        several * drift,
        drift_sigma,
        freedom,
        drift_p,
        drift_p < DRIFT_P,
        known * next_mean,
        known * np.sqrt(next_variance),
        known * np.sqrt(variance),
        known * np.sqrt(again),
        off,
        off_sigma,
        family(off / off_sigma, freedom),
    )


# Units that do not belong to a lot, with reasons: outlying numbers in sigmas of the lot.

MOST_REASONS = 5


@dataclass(frozen=True)
class Reason:
    """Reason for an outlier: what, a number's key; value, of the number less the lot's mean in its unit; sigmas of the lot."""

    what: str
    value: float
    sigmas: float


@dataclass(frozen=True)
class Outlier:
    """A unit that does not belong: serial; session, of a unit with one session alone, else empty; p_value over the whole lot; reasons, the
    largest first; description: the unit with its numbers."""

    serial: str
    session: str
    p_value: Share
    reasons: tuple[Reason, ...]
    description: str


def outliers(lot: LotSessions, found: LotEstimate) -> list[Outlier]:
    """Return the outliers, the least probable first."""
    made, J, p_values = [], jacobian(found.mean), found.p_values[:, OWN]
    values, sigmas = np.nan_to_num(found.off) @ J.T, error_sigmas(found.off_sigma, J)
    for u in np.flatnonzero(found.excluded):
        order = [n for n in np.argsort(-np.abs(found.off / found.off_sigma)[u, OWN]) if p_values[u, n] < FAMILY_P]
        reasons, words = [], []
        session = lot.names[lot.first[u]] if lot.count[u] == 1 else ""
        serial = lot.serials[u]
        for n in order[:MOST_REASONS]:
            (name, unit, _), value, off = SENSOR_ERRORS[n], float(values[u, n]), float(values[u, n] / sigmas[u, n])
            reasons.append(Reason(key_of(name, unit), value, off))
            words.append(f"{name} {'+' if value > 0 else ''}{significant(value)} {unit} ({off:+.1f} sigmas)")
        single = f" (one session, {session})" if session else ""
        description = f"unit {serial or '(no serial)'}{single}: {', '.join(words)}"
        made.append(Outlier(serial, session, float(p_values[u].min()), tuple(reasons), description))
    return sorted(made, key=lambda each: each.p_value)
