"""A lot's report: one record from the results of sessions, and its files (``tinygc-lot/3``, docs/formats.md)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.special import stdtr

from session.base.records import DERIVED, Count, Share, Size, read_record
from session.base.results import Maybe, Number
from tinygc.features.fleet.estimate import Outlier, estimate, outliers
from tinygc.features.fleet.lot import (
    NAMES,
    OWN,
    SENSOR_ERRORS,
    Lot,
    UnitResult,
    error_sigmas,
    jacobian,
    key_of,
    lot_sessions,
    sensor_errors,
)

# Report of a lot: one function from the results of sessions to a record for tables, pages and files.

PER_UNITS = 1000


MaySize = Annotated[float, Maybe(Number(0))]


@dataclass(frozen=True)
class LotQuantity:
    """One number of the lot in its unit.

    units that tell it; mean and its sigma; spread between units; repeatability, one sigma from session to session beyond what a session
    states; drift per 1000 units, its sigma, and the p-value that there is none.  NaN where unknown.
    """

    name: Annotated[str, DERIVED]
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


#: outliers in a report; their total number is also given
MOST_OUTLIERS = 1000


@dataclass(frozen=True, eq=False, kw_only=True)
class LotReport(Lot):
    """The lot as a prior, which is what ``fit --lot`` reads, with its report: its drift; sentences; the numbers that any unit tells, in
    displayed units; units that do not belong, the least probable first."""

    drift_p_value: Share
    drifts: bool
    notes: tuple[str, ...]
    quantities: tuple[LotQuantity, ...]
    outliers_found: Count
    outliers: tuple[Outlier, ...]


def lot_of(results: Iterable[UnitResult], sensor: str = "") -> LotReport:
    """Report on the sessions of a lot, in any order.  Raises CalibrationError where fewer than two units determine any number."""
    sessions = lot_sessions(results)
    found = estimate(sessions)
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
    odd = outliers(sessions, found)
    return LotReport(
        sensor=sensor,
        units=sessions.units,
        sessions=sessions.sessions,
        names=NAMES,
        mean=found.next_mean,
        mean_sigma=found.next_sigma,
        spread=found.spread,
        repeatability=found.repeatability,
        drift_p_value=found.drift_p,
        drifts=found.drifts,
        notes=tuple(notes),
        quantities=tuple(
            LotQuantity(name, key_of(name, unit), unit, *row) for (name, unit, _), row in zip(SENSOR_ERRORS, columns, strict=True) if row[0]
        ),
        outliers_found=len(odd),
        outliers=tuple(odd[:MOST_OUTLIERS]),
    )


def read_lot(path: Path | str) -> Lot:
    """Read a lot from a file (docs/formats.md), in SI.

    Raises FormatError for an invalid lot, in one line with the key and the expected value.
    """
    return read_record(Lot, Path(path), "make the lot again, or correct the file")
