"""A lot's report: one record from the results of sessions, and its files (``tinygc-lot/3``, docs/formats.md)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtr

from session import VERSION
from session.base.errors import FormatError
from session.base.results import Keys, ListOf, Maybe, Number, Text, read_json, require, require_schema, shown, write_whole
from tinygc.features.fleet.estimate import LotEstimate, estimate
from tinygc.features.fleet.lot import (
    NAMES,
    OWN,
    SENSOR_ERRORS,
    Lot,
    SensorError,
    UnitResult,
    error_sigmas,
    jacobian,
    lot_sessions,
    sensor_errors,
)
from tinygc.features.fleet.outliers import Outlier, outliers

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
    estimate: LotEstimate
    notes: tuple[str, ...] = ()


def lot_of(results: Iterable[UnitResult], sensor: str = "") -> LotReport:
    """Report on the sessions of a lot, in any order.  Raises CalibrationError where fewer than two units determine any number."""
    sessions = lot_sessions(results)
    found = estimate(sessions)
    lot = Lot(sensor, sessions.units, sessions.sessions, found.next_mean, found.next_sigma, found.spread, found.repeatability)
    J, per = jacobian(found.mean), PER_UNITS / max(sessions.units - 1, 1)
    sigmas = (found.mean_sigma, found.spread, found.repeatability, found.drift_sigma * per)
    of_mean, spread, again, of_drift = (error_sigmas(each, J) for each in sigmas)
    drift = np.where(np.isfinite(of_drift), J @ np.nan_to_num(found.drift), np.nan) * per
    p = 2 * stdtr(found.freedom[OWN], -np.abs(drift) / of_drift)
    units = np.logical_or.reduceat(sessions.known[:, OWN], sessions.first).sum(axis=0)
    columns = zip(
        units.tolist(), *map(np.ndarray.tolist, (sensor_errors(found.mean), of_mean, spread, again, drift, of_drift, p)), strict=True
    )
    notes = []
    if not (sessions.count > 1).any():
        notes.append("no unit has two sessions: repeatability is unknown, and is part of the spread between units")
    if found.excluded.any():
        notes.append(f"the numbers are those without the {int(found.excluded.sum())} of {sessions.units} units that do not belong")
    if sessions.units <= 2:
        notes.append("two units have no drift")
    quantities = tuple(LotQuantity(error, *row) for error, row in zip(SENSOR_ERRORS, columns, strict=True))
    return LotReport(lot, quantities, tuple(outliers(sessions, found)), found, tuple(notes))


# A lot as a file: JSON of format ``tinygc-lot/3`` (docs/formats.md), null for unknown values.

SCHEMA = "tinygc-lot/3"
#: 21 numbers each, in the order of ``NAMES``
VECTORS = ("mean", "mean_sigma", "spread", "repeatability")
_AGAIN = "make the lot again, or correct the file"
_COUNT = Number(low=1, whole=True)
_SIGMAS = ListOf(Maybe(Number(low=0)))
LOT = Keys(
    must={
        "sensor": Text(),
        "units": _COUNT,
        "sessions": _COUNT,
        "names": ListOf(Text()),
        "mean": ListOf(Maybe(Number())),
        "mean_sigma": _SIGMAS,
        "spread": _SIGMAS,
        "repeatability": _SIGMAS,
    },
)


def _lot_table(lot: Lot, **more: Any) -> dict:
    """Return a JSON-ready table; ``more`` is added unchanged, and readers of a lot do not need it."""
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "sensor": lot.sensor,
        "units": lot.units,
        "sessions": lot.sessions,
        "names": list(NAMES),
        **{key: getattr(lot, key).tolist() for key in VECTORS},
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
    for key in VECTORS:
        if len(table[key]) != len(NAMES):
            raise FormatError(f"{where}: {key} has {len(table[key])} entries, expected {len(NAMES)}, one for each name; {_AGAIN}")
    vectors = (np.array(table[key], dtype=float) for key in VECTORS)
    return Lot(table["sensor"], table["units"], table["sessions"], *vectors)


# A lot's report as JSON: the file that ``fit --lot`` reads, with the report's other figures (docs/formats.md).

#: most outliers in a file; their total number is also given
MOST_OUTLIERS = 1000


def to_json(report: LotReport) -> dict:
    """Return ``tinygc-lot/3``."""
    drift = report.estimate
    return _lot_table(
        report.lot,
        drift_p_value=drift.drift_p,
        drifts=drift.drifts,
        notes=list(report.notes),
        quantities=[
            {"key": each.error.key, "unit": each.error.unit, **{name: value for name, value in vars(each).items() if name != "error"}}
            for each in report.quantities
            if each.units
        ],
        outliers_found=len(report.outliers),
        outliers=[_outlier(each) for each in report.outliers[:MOST_OUTLIERS]],
    )


def save(report: LotReport, path: Path | str) -> None:
    """Write the report atomically.  Raises StorageError for a full disk."""
    write_whole(Path(path), to_json(report))


def _outlier(each: Outlier) -> dict:
    named = {"description" if name == "says" else name: value for name, value in vars(each).items()}
    return {**named, "reasons": [vars(reason) for reason in each.reasons]}
