"""A lot's report: one record from the results of sessions, and its files (``tinygc-lot/3``, docs/formats.md)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.special import stdtr

from session.base.records import DERIVED, Count, Share, Size, read_record, table_of, write_whole
from session.base.results import Maybe, Number
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


MaySize = Annotated[float, Maybe(Number(0))]


@dataclass(frozen=True)
class LotQuantity:
    """One number of the lot in its unit.

    units that tell it; mean and its sigma; spread between units; repeatability, one sigma from session to session beyond what a session
    states; drift per 1000 units, its sigma, and the p-value that there is none.  NaN where unknown.
    """

    error: Annotated[SensorError, DERIVED]
    key: str
    unit: str
    units: Count
    mean: float
    mean_sigma: Size
    spread: Size
    repeatability: MaySize
    drift_per_1000: Annotated[float, Maybe(Number())]
    drift_sigma: MaySize
    drift_p_value: Annotated[float, Maybe(Number(0, 1))]


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
    lot = Lot(
        sensor=sensor,
        units=sessions.units,
        sessions=sessions.sessions,
        names=NAMES,
        mean=found.next_mean,
        mean_sigma=found.next_sigma,
        spread=found.spread,
        repeatability=found.repeatability,
    )
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
    quantities = tuple(LotQuantity(error, error.key, error.unit, *row) for error, row in zip(SENSOR_ERRORS, columns, strict=True))
    return LotReport(lot, quantities, tuple(outliers(sessions, found)), found, tuple(notes))


# A lot as a file (docs/formats.md), null for unknown values.

#: most outliers in a file; their total number is also given
MOST_OUTLIERS = 1000


@dataclass(frozen=True, eq=False, kw_only=True)
class WrittenLot(Lot):
    """What ``fit --lot`` reads, with the report's other figures."""

    drift_p_value: Share | None
    drifts: bool
    notes: tuple[str, ...]
    quantities: tuple[LotQuantity, ...]
    outliers_found: Count
    outliers: tuple[Outlier, ...]


def read_lot(path: Path | str) -> Lot:
    """Read a lot from a file, in SI.  Raises FormatError for an invalid lot, in one line with the key and the expected value."""
    return read_record(Lot, Path(path), "make the lot again, or correct the file")


def to_json(report: LotReport) -> dict:
    """Return ``tinygc-lot/3``."""
    file = WrittenLot(
        **vars(report.lot),
        drift_p_value=report.estimate.drift_p,
        drifts=report.estimate.drifts,
        notes=report.notes,
        quantities=tuple(each for each in report.quantities if each.units),
        outliers_found=len(report.outliers),
        outliers=report.outliers[:MOST_OUTLIERS],
    )
    return table_of(file)


def save(report: LotReport, path: Path | str) -> None:
    """Write the report atomically.  Raises StorageError for a full disk."""
    write_whole(Path(path), to_json(report))
