"""A lot as a file, ``tinygc-lot/1`` (docs/formats.md), and its report as JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from session import VERSION
from session.io.errors import FormatError
from session.io.results import Keys, ListOf, MapOf, Maybe, Number, Text, read_json, require, shown, write_whole
from tinygc.annexes.lots.capability import ControlChart
from tinygc.annexes.lots.gauge import Gauge
from tinygc.annexes.lots.lot import NAMES, Lot, PooledEffect
from tinygc.annexes.lots.outliers import Outlier
from tinygc.annexes.lots.report import LotQuantity, LotReport

# A lot as a file: JSON of format ``tinygc-lot/1`` (docs/formats.md), null for unknown values.

SCHEMA = "tinygc-lot/1"
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
    if not isinstance(table, dict) or table.get("schema") != SCHEMA:
        raise FormatError(f'{where}: no lot of this tool, expected "schema": "{SCHEMA}"; make it with calibrate.py lot or fleet')
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
    """Return ``tinygc-lot/1``."""
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
        "alarms": _points(each.alarms, each),
        "ewma_beyond_limit": len(each.ewma_alarms),
        "ewma_alarms": _points(each.ewma_alarms, each),
        "rules": [
            {"rule": name, "found": each.counts[name], "by_chance": each.chance[name], "broken": name in each.broken}
            for name in each.counts
        ],
    }


def _points(alarms: np.ndarray, chart: ControlChart) -> list[dict[str, Any]]:
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
    return {**vars(each), "reasons": [vars(reason) for reason in each.reasons]}
