"""A lot's report: one record from the results of sessions, and its files (``tinygc-lot/2``, docs/formats.md)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtr

from session import VERSION
from session.io.errors import FormatError
from session.io.results import Keys, ListOf, Maybe, Number, Text, read_json, require, require_schema, shown, write_whole
from tinygc.annexes.lots.hierarchy import Hierarchy, hierarchy
from tinygc.annexes.lots.lot import (
    NAMES,
    OWN,
    SENSOR_ERRORS,
    Lot,
    LotSessions,
    SensorError,
    UnitResult,
    error_covariance,
    jacobian,
    lot_sessions,
    sensor_errors,
)
from tinygc.annexes.lots.outliers import Outlier, outliers

# Report of a lot: one function from the results of sessions to a record for tables, pages and files.

PER_UNITS = 1000


@dataclass(frozen=True)
class LotQuantity:
    """One number of the lot in its unit.

    units that tell it; mean and its sigma; spread between units; repeatability, one sigma from session to session beyond what a session
    states; drift per 1000 units, its sigma, and the p-value that there is none.  NaN where unknown.
    """

    error: SensorError
    units: int
    mean: float
    mean_sigma: float
    spread: float
    repeatability: float
    drift_per_1000: float
    drift_sigma: float
    drift_p_value: float


@dataclass(frozen=True, eq=False)
class LotReport:
    """The lot as a prior, with its report: its numbers in displayed units; outliers; the estimate that they are of; notes, sentences."""

    lot: Lot
    quantities: tuple[LotQuantity, ...]
    outliers: tuple[Outlier, ...]
    hierarchy: Hierarchy
    notes: tuple[str, ...] = ()


def lot_of(results: Iterable[UnitResult], sensor: str = "") -> LotReport:
    """Report on the sessions of a lot, in any order.  Raises CalibrationError where fewer than two units determine any number."""
    sessions = lot_sessions(results)
    found = hierarchy(sessions)
    lot = Lot(
        sensor, sessions.units, sessions.sessions, found.next_mean, found.next_covariance, found.spread, found.tails, found.repeatability
    )
    return LotReport(lot, _quantities(sessions, found), tuple(outliers(sessions, found)), found, _notes(sessions, found))


def _quantities(lot: LotSessions, found: Hierarchy) -> tuple[LotQuantity, ...]:
    J, known = jacobian(found.mean), lot.known[OWN]
    mean = np.where(known, sensor_errors(np.where(np.isfinite(found.mean), found.mean, lot.centre)), np.nan)

    def sigma(covariance: np.ndarray) -> np.ndarray:
        return np.sqrt(np.diag(error_covariance(covariance, J)))

    of_mean, spread, again, of_drift = map(sigma, (found.mean_covariance, found.spread, found.repeatability, found.drift_covariance))
    per = PER_UNITS / max(lot.units - 1, 1)
    drift = np.where(known, J @ np.nan_to_num(found.drift), np.nan) * per
    p = 2 * stdtr(max(lot.units - 2, 1), -np.abs(drift / per) / of_drift)
    of_drift, drift, p = (each if lot.units > 2 else np.full(len(p), np.nan) for each in (of_drift * per, drift, p))
    units = np.logical_or.reduceat(lot.told[:, OWN], lot.first).sum(axis=0)
    columns = zip(units.tolist(), *(each.tolist() for each in (mean, of_mean, spread, again, drift, of_drift, p)), strict=True)
    return tuple(LotQuantity(error, *row) for error, row in zip(SENSOR_ERRORS, columns, strict=True))


def _notes(lot: LotSessions, found: Hierarchy) -> tuple[str, ...]:
    told = []
    if not found.settled:
        told.append("the lot's variances had not converged when the passes over it ended; they are those of the last pass")
    if not (lot.count > 1).any():
        told.append("no unit has two sessions: repeatability is unknown, and is part of the spread between units")
    if lot.units < 3 * int(lot.known.sum()):
        told.append(
            f"{lot.units} units are few for {int(lot.known.sum())} numbers: correlations are shrunk towards zero, tails are not estimated"
        )
    if (off := int(np.sum(found.belongs <= 0.5))) > 0:
        told.append(f"{off} of {lot.units} units probably do not belong to the lot; its numbers are those of the others")
    if lot.units <= 2:
        told.append("two units have no drift")
    return tuple(told)


# A lot as a file: JSON of format ``tinygc-lot/2`` (docs/formats.md), null for unknown values.

SCHEMA = "tinygc-lot/2"
_AGAIN = "make the lot again, or correct the file"
#: tolerance of a correlation beyond 1, or an eigenvalue below 0, in shares of the largest: the rounding of JSON
_ROUNDING = 1e-9
_COUNT = Number(low=1, whole=True)
_VECTOR = ListOf(Maybe(Number()))
_MATRIX = ListOf(_VECTOR)
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
        **more,
    }


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
    )
    for key, matrix in (("mean_covariance", lot.mean_covariance), ("spread", lot.spread), ("repeatability", lot.repeatability)):
        for i in np.flatnonzero(np.isnan(mean) & np.isfinite(np.diag(matrix))):
            raise FormatError(f"{where}: {key} tells of {NAMES[i]}, whose mean is null; expected null there, too; {_AGAIN}")
    return lot


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

#: most outliers in a file; their total number is also given
MOST_OUTLIERS = 1000


def to_json(report: LotReport) -> dict:
    """Return ``tinygc-lot/2``."""
    drift = report.hierarchy
    return lot_table(
        report.lot,
        drift_p_value=drift.drift_p,
        drifts=drift.drifts,
        off_share=drift.off,
        settled=drift.settled,
        notes=list(report.notes),
        quantities=[_quantity(each) for each in report.quantities if each.units],
        outliers_found=len(report.outliers),
        outliers=[_outlier(each) for each in report.outliers[:MOST_OUTLIERS]],
    )


def save(report: LotReport, path: Path | str) -> None:
    """Write the report atomically.  Raises StorageError for a full disk."""
    write_whole(Path(path), to_json(report))


def _quantity(each: LotQuantity) -> dict:
    return {"key": each.error.key, "unit": each.error.unit, **{name: value for name, value in vars(each).items() if name != "error"}}


def _outlier(each: Outlier) -> dict:
    named = {"description" if name == "says" else name: value for name, value in vars(each).items()}
    return {**named, "reasons": [vars(reason) for reason in each.reasons]}
