"""A lot's report: one record from the results of sessions, and its files (``tinygc-lot/2``, docs/formats.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import gammaincinv, stdtr

from session import VERSION
from session.io.errors import FormatError
from session.io.results import Keys, ListOf, MapOf, Maybe, Number, Text, read_json, require, require_schema, shown, write_whole
from tinygc.annexes.lots.capability import Capability, ControlChart, capability, chart
from tinygc.annexes.lots.gauge import Gauge, gauge
from tinygc.annexes.lots.hierarchy import Hierarchy, hierarchy
from tinygc.annexes.lots.lot import (
    NAMES,
    OWN,
    SENSOR_ERRORS,
    Lot,
    LotSessions,
    PooledEffect,
    SensorError,
    SessionErrors,
    UnitResult,
    error_covariance,
    jacobian,
    lot_sessions,
    sensor_errors,
    session_errors,
    stated,
)
from tinygc.annexes.lots.outliers import Outlier, outliers

# Report of a lot: one function from the results of sessions to a record for tables, pages and files.

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


# A lot as a file, ``tinygc-lot/2`` (docs/formats.md), and its report as JSON.

# A lot as a file: JSON of format ``tinygc-lot/2`` (docs/formats.md), null for unknown values.

SCHEMA = "tinygc-lot/2"
_AGAIN = "make the lot again, or correct the file"
#: tolerance of a correlation beyond 1, or an eigenvalue below 0, in shares of the largest: the rounding of JSON
_ROUNDING = 1e-9
_COUNT = Number(low=1, whole=True)
_SHARE = Number(low=0, high=1)
_VECTOR = ListOf(Maybe(Number()))
_MATRIX = ListOf(_VECTOR)
_EFFECT = Keys(
    must={
        "share": _SHARE,
        "mean": MapOf(Maybe(Number())),
        "spread": MapOf(Maybe(Number(low=0))),
        "p_value": _SHARE,
        "units": Number(low=0, whole=True),
    },
    may={"equivalent": ListOf(Text())},
)
LOT = Keys(
    must={
        "sensor": Text(),
        "units": _COUNT,
        "sessions": _COUNT,
        "names": ListOf(Text()),
        "mean": _VECTOR,
        "mean_covariance": _MATRIX,
        "spread": _MATRIX,
        "tails": Maybe(Number(low=0, above=True)),
        "repeatability": _MATRIX,
    },
    may={"effects": MapOf(_EFFECT)},
)


def lot_table(lot: Lot, **more: Any) -> dict:
    """Return a JSON-ready table; ``more`` is added unchanged, and readers of a lot do not need it."""
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "sensor": lot.sensor,
        "units": lot.units,
        "sessions": lot.sessions,
        "names": list(NAMES),
        "mean": lot.mean.tolist(),
        "mean_covariance": lot.mean_covariance.tolist(),
        "spread": lot.spread.tolist(),
        "tails": lot.tails,
        "repeatability": lot.repeatability.tolist(),
        "effects": {name: vars(effect) for name, effect in lot.effects.items()},
        **more,
    }


def write_lot(path: Path | str, lot: Lot, **more: Any) -> None:
    """Write the lot's file atomically; non-finite values become null.  Raises StorageError for a full disk."""
    write_whole(Path(path), lot_table(lot, **more))


def read_lot(path: Path | str) -> Lot:
    """Read a lot from a file, in SI.  Raises FormatError for an invalid lot, in one line with the key and the expected value."""
    return lot_of_table(read_json(Path(path)), str(path))


def lot_of_table(table: Any, where: str) -> Lot:
    """Build the lot from parsed JSON; where: its file's name.  Raises FormatError as ``read_lot``."""
    require_schema(table, SCHEMA, where, _AGAIN)
    require(table, LOT, where, _AGAIN)
    if table["names"] != list(NAMES):
        raise FormatError(
            f"{where}: names are {shown(table['names'])}, expected the {len(NAMES)} of docs/formats.md in their order; {_AGAIN}"
        )
    if table["sessions"] < table["units"]:
        raise FormatError(f"{where}: sessions is {table['sessions']}, expected at least one for each unit of {table['units']}; {_AGAIN}")
    effects = {
        name: PooledEffect(e["share"], _known(e["mean"]), _known(e["spread"]), e["p_value"], e["units"], tuple(e.get("equivalent", ())))
        for name, e in table.get("effects", {}).items()
    }
    mean = _array(table, "mean", where, 1)
    lot = Lot(
        table["sensor"],
        table["units"],
        table["sessions"],
        mean,
        _covariance(table, "mean_covariance", where),
        _covariance(table, "spread", where),
        float("inf") if table["tails"] is None else float(table["tails"]),
        _covariance(table, "repeatability", where),
        effects,
    )
    for key, matrix in (("mean_covariance", lot.mean_covariance), ("spread", lot.spread), ("repeatability", lot.repeatability)):
        for i in np.flatnonzero(np.isnan(mean) & np.isfinite(np.diag(matrix))):
            raise FormatError(f"{where}: {key} tells of {NAMES[i]}, whose mean is null; expected null there, too; {_AGAIN}")
    return lot


def _known(values: dict[str, float | None]) -> dict[str, float]:
    return {name: float("nan") if value is None else float(value) for name, value in values.items()}


def _array(table: dict, key: str, where: str, dimensions: int) -> np.ndarray:
    """Return (21,) or (21, 21), NaN for null."""
    rows, size = table[key], len(NAMES)
    lengths = [len(rows)] + ([len(row) for row in rows] if dimensions == 2 else [])
    for at, length in enumerate(lengths):
        if length != size:
            place = key if at == 0 else f"{key}[{at - 1}]"
            raise FormatError(f"{where}: {place} has {length} entries, expected {size}, one for each name; {_AGAIN}")
    return np.array(rows, dtype=float)


def _covariance(table: dict, key: str, where: str) -> np.ndarray:
    """Return (21, 21), symmetric and without negative variances where known, NaN in whole rows and columns where not."""
    matrix = _array(table, key, where, 2)
    unknown = np.isnan(np.diag(matrix))
    for i, j in np.argwhere(np.isnan(matrix) != (unknown[:, None] | unknown)):
        raise FormatError(f"{where}: {key}[{i}][{j}] is {shown(table[key][i][j])}, expected null in whole rows and columns only; {_AGAIN}")
    told = matrix[np.ix_(~unknown, ~unknown)]
    scale = np.sqrt(np.abs(np.diag(told)))
    scaled = told / np.where(scale > 0, np.outer(scale, scale), 1.0) if told.size else told
    wrong = ""
    if (np.abs(scaled - scaled.T) > _ROUNDING).any():
        wrong = "is not symmetric"
    elif told.size and ((np.diag(told) < 0).any() or np.linalg.eigvalsh(scaled)[0] < -_ROUNDING * len(told)):
        wrong = "has a negative variance"
    elif (np.abs(told[scale == 0]) > 0).any():
        wrong = "has a covariance with a number of no variance"
    if wrong:
        raise FormatError(f"{where}: {key} {wrong}, expected a covariance; {_AGAIN}")
    matrix[np.ix_(~unknown, ~unknown)] = (told + told.T) / 2
    return matrix


# A lot's report as JSON: the file that ``fit --lot`` reads, with the report's other figures (docs/formats.md).

#: most alarms and outliers in a file; their total number is also given
MOST_ALARMS, MOST_OUTLIERS = 20, 1000


def to_json(report: LotReport) -> dict:
    """Return ``tinygc-lot/2``."""
    drift = report.hierarchy
    return lot_table(
        report.lot,
        appraisers=report.appraisers or None,
        drift_p_value=drift.drift_p,
        drifts=drift.drifts,
        off_share=drift.off,
        settled=drift.settled,
        notes=list(report.notes),
        quantities=[_quantity(each) for each in report.quantities if each.units],
        charts={key: _chart(each, report) for key, each in report.charts.items()},
        gauges={key: _gauge(each) for key, each in report.gauges.items()},
        capabilities={key: asdict(each) for key, each in report.capabilities.items()},
        outliers_found=len(report.outliers),
        outliers=[_outlier(each) for each in report.outliers[:MOST_OUTLIERS]],
    )


def save(report: LotReport, path: Path | str) -> None:
    """Write the report atomically.  Raises StorageError for a full disk."""
    write_whole(Path(path), to_json(report))


def _quantity(each: LotQuantity) -> dict:
    return {"key": each.error.key, "unit": each.error.unit, **{name: value for name, value in vars(each).items() if name != "error"}}


def _chart(each: ControlChart, report: LotReport) -> dict:
    return {
        "points": len(each.y),
        "centre": each.centre,
        "short_term": each.short_term,
        "limit_sigmas": each.limit,
        "ewma_limit_sigmas": each.ewma_limit,
        "moving_range_limit": each.range_limit,
        "beyond_limit": len(each.alarms),
        "alarms": _points_table(each.alarms, each),
        "ewma_beyond_limit": len(each.ewma_alarms),
        "ewma_alarms": _points_table(each.ewma_alarms, each),
        "rules": [
            {"rule": name, "found": each.counts[name], "by_chance": each.chance[name], "broken": name in each.broken}
            for name in each.counts
        ],
    }


def _points_table(alarms: np.ndarray, chart: ControlChart) -> list[dict[str, Any]]:
    return [{"place": int(chart.place[n]), "value": float(chart.y[n]), "sigmas": float(chart.score[n])} for n in alarms[:MOST_ALARMS]]


def _gauge(each: Gauge) -> dict:
    table = None
    if each.table is not None:
        kept = zip(("part", "appraiser", "interaction", "repeat"), each.table.freedom, each.table.squares, strict=True)
        table = {
            "pooled": each.table.pooled,
            "interaction_p_value": each.table.interaction_p,
            "rows": [{"source": name, "freedom": float(f), "sum_of_squares": float(s)} for name, f, s in kept],
        }
    names = ("ev", "av", "interaction", "grr", "pv", "tv", "percent_grr", "percent_tolerance", "method", "parts", "sessions", "verdict")
    return {
        **{name: getattr(each, name) for name in names},
        "ndc": each.ndc,
        "percent_grr_interval": list(each.percent_grr_interval),
        "ndc_interval": list(each.ndc_interval),
        "anova": table,
        "why_not": each.why or None,
    }


def _outlier(each: Outlier) -> dict:
    named = {"description" if name == "says" else name: value for name, value in vars(each).items()}
    return {**named, "reasons": [vars(reason) for reason in each.reasons]}
