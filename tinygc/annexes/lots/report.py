"""Report of a lot: one function from the results of sessions to a record for tables, pages and files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.special import gammaincinv, stdtr

from tinygc.annexes.lots.capability import Capability, ControlChart, capability, chart
from tinygc.annexes.lots.gauge import Gauge, gauge
from tinygc.annexes.lots.hierarchy import Hierarchy, hierarchy
from tinygc.annexes.lots.lot import (
    OWN,
    SENSOR_ERRORS,
    Lot,
    PooledEffect,
    SensorError,
    UnitResult,
    error_covariance,
    jacobian,
    sensor_errors,
)
from tinygc.annexes.lots.outliers import Outlier, outliers
from tinygc.annexes.lots.sessions import LotSessions, SessionErrors, lot_sessions, session_errors, stated

#: fewest points for a control chart
FEWEST_POINTS = 8
CONFIDENCE = 0.95
PER_UNITS = 1000


@dataclass(frozen=True)
class LotQuantity:
    """One number of the lot in its unit.

    mean and its sigma; spread between units with its 95 % interval; noise, one sigma of a session as stated; repeatability, one sigma from
    session to session beyond that, with its interval; drift per 1000 units, its sigma, and the p-value that there is none; ratio of the
    differences between sessions of one unit to the stated sigmas, and its p-value.  NaN where unknown.
    """

    error: SensorError
    units: int
    mean: float
    mean_sigma: float
    spread: float
    spread_interval: tuple[float, float]
    noise: float
    repeatability: float
    repeatability_interval: tuple[float, float]
    drift_per_1000: float
    drift_sigma: float
    drift_p_value: float
    stated_ratio: float
    stated_p_value: float


@dataclass(frozen=True, eq=False)
class LotReport:
    """The lot as a prior, with its report.

    its numbers in displayed units; charts, gauges and capabilities by a number's key; outliers; the sessions and readings used; appraisers:
    ``operator`` or ``station``, or empty where fewer than two are named.
    """

    lot: Lot
    quantities: tuple[LotQuantity, ...]
    charts: Mapping[str, ControlChart]
    gauges: Mapping[str, Gauge]
    capabilities: Mapping[str, Capability]
    outliers: tuple[Outlier, ...]
    appraisers: str
    hierarchy: Hierarchy
    sessions: LotSessions
    session_errors: SessionErrors
    notes: tuple[str, ...] = field(default_factory=tuple)


def lot_of(
    results: Iterable[UnitResult],
    sensor: str = "",
    limits: Mapping[str, tuple[float, float]] | None = None,
    effects: Mapping[str, PooledEffect] | None = None,
    seed: int = 0,
) -> LotReport:
    """Report on the sessions of a lot, in any order.

    limits: lower and upper by a number's key (``capability.py``); seed: of intervals. Raises CalibrationError where fewer than two units
    determine any number.
    """
    sessions = lot_sessions(results)
    found = hierarchy(sessions)
    J = jacobian(found.mean)
    read = session_errors(sessions, J)
    quantities = _quantities(sessions, found, J, read)
    known = [n for n, each in enumerate(quantities) if each.units >= 2]
    charts = {}
    for n in known:
        points = _points(read, n)
        if len(points) >= FEWEST_POINTS:
            again = np.nan_to_num(quantities[n].repeatability)
            noise = np.hypot(read.sigmas[points, n], again)
            charts[SENSOR_ERRORS[n].key] = chart(read.values[points, n], noise, found.tails, len(known), read.unit[points])
    what, who = _appraisers(sessions)
    bounds = limits or {}
    gauges, capabilities = {}, {}
    belongs = found.belongs[read.unit] > 0.5
    for n in known:
        key, limit = SENSOR_ERRORS[n].key, bounds.get(SENSOR_ERRORS[n].key, (-np.inf, np.inf))
        width = limit[1] - limit[0]
        gauges[key] = gauge(
            np.where(belongs, read.values[:, n], np.nan), read.unit, who, width if np.isfinite(width) else float("nan"), what, seed
        )
        if key in bounds:
            each, first = quantities[n], read.values[_points(read, n), n]
            within = charts[key].short_term if key in charts else each.spread
            noise, freedom = float(np.hypot(each.noise, np.nan_to_num(each.repeatability))), float(found.spread_freedom[OWN[n]])
            capabilities[key] = capability(limit, each.mean, each.spread, noise, within, freedom, found.tails, first)
    lot = Lot(
        sensor,
        sessions.units,
        sessions.sessions,
        found.next_mean,
        found.next_covariance,
        found.spread,
        found.tails,
        found.repeatability,
        effects or {},
    )
    odd = tuple(outliers(sessions, found))
    return LotReport(lot, quantities, charts, gauges, capabilities, odd, what, found, sessions, read, _notes(sessions, found, what))


def _quantities(lot: LotSessions, found: Hierarchy, J: np.ndarray, read: SessionErrors) -> tuple[LotQuantity, ...]:
    known = lot.known[OWN]
    mean = np.where(known, sensor_errors(np.where(np.isfinite(found.mean), found.mean, lot.centre)), np.nan)

    def sigma(covariance: np.ndarray) -> np.ndarray:
        return np.sqrt(np.diag(error_covariance(covariance, J)))

    of_mean, spread, again, of_drift = map(sigma, (found.mean_covariance, found.spread, found.repeatability, found.drift_covariance))
    drift = J @ np.nan_to_num(found.drift)
    per = PER_UNITS / max(lot.units - 1, 1)
    p = 2 * stdtr(max(lot.units - 2, 1), -np.abs(drift) / of_drift)
    ratio, ratio_p = stated(read)
    units = np.logical_or.reduceat(np.isfinite(read.values), read.first).sum(axis=0)
    squares = np.where(np.isfinite(read.sigmas), read.sigmas**2, 0.0).sum(axis=0) / np.maximum(np.isfinite(read.sigmas).sum(axis=0), 1)
    return tuple(
        LotQuantity(
            SENSOR_ERRORS[n],
            int(units[n]),
            float(mean[n]),
            float(of_mean[n]),
            float(spread[n]),
            _interval(float(spread[n]), float(found.spread_freedom[OWN[n]])),
            float(np.sqrt(squares[n])) if units[n] else float("nan"),
            float(again[n]),
            _interval(float(again[n]), float(found.repeatability_freedom[OWN[n]])),
            float(drift[n] * per) if known[n] and lot.units > 2 else float("nan"),
            float(of_drift[n] * per) if lot.units > 2 else float("nan"),
            float(p[n]) if lot.units > 2 else float("nan"),
            float(ratio[n]),
            float(ratio_p[n]),
        )
        for n in range(len(SENSOR_ERRORS))
    )


def _interval(sigma: float, freedom: float) -> tuple[float, float]:
    """Return the 95 % interval of a standard deviation with these degrees of freedom of chi-square."""
    if not (np.isfinite(sigma) and np.isfinite(freedom)):
        return (float("nan"), float("nan"))
    if freedom < 1:  # not distinct from zero
        return (0.0, float("nan"))
    lo, hi = 2 * gammaincinv(freedom / 2, [(1 + CONFIDENCE) / 2, (1 - CONFIDENCE) / 2])
    return (float(sigma * np.sqrt(freedom / lo)), float(sigma * np.sqrt(freedom / hi)))


def _points(read: SessionErrors, n: int) -> np.ndarray:
    """Return the rows of each unit's first session with a value: the test at the end of production, in its order."""
    rows = np.flatnonzero(np.isfinite(read.values[:, n]))
    _, first = np.unique(read.unit[rows], return_index=True)
    return rows[first]


def _appraisers(lot: LotSessions) -> tuple[str, np.ndarray | None]:
    """Return the kind of appraiser, operators, or stations where only these differ, and their numbers, or None.

    At least two have to be named; sessions without a name form one more.
    """
    for what, names in (("operator", lot.operators), ("station", lot.stations)):
        kinds, numbers = np.unique(np.array(names, dtype=object).astype(str), return_inverse=True)
        if len(kinds[kinds != ""]) > 1:
            return what, numbers
    return "", None


def _notes(lot: LotSessions, found: Hierarchy, what: str) -> tuple[str, ...]:
    told = []
    if not found.settled:
        told.append("the lot's variances had not converged when the passes over it ended; they are those of the last pass")
    if not (lot.count > 1).any():
        told.append("no unit has two sessions: repeatability is unknown, and is part of the spread between units")
    elif not what:
        told.append("fewer than two operators or stations are named: reproducibility is unknown")
    if lot.units < 3 * int(lot.known.sum()):
        told.append(
            f"{lot.units} units are few for {int(lot.known.sum())} numbers: correlations are shrunk towards zero, tails are not estimated"
        )
    if (off := int(np.sum(found.belongs <= 0.5))) > 0:
        told.append(
            f"{off} of {lot.units} units probably do not belong to the lot; its numbers and its gauge study are those of the others"
        )
    if lot.units <= 2:
        told.append("two units have no drift")
    return tuple(told)
