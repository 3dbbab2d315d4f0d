"""A lot's report: one record from the results of sessions, its files (``tinygc-lot/3``, docs/formats.md), and what people see of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.special import stdtr

from session.base.errors import CalibrationError
from session.base.files import result_folder
from session.base.records import DERIVED, Count, Share, Size, read_record, table_of, write_whole
from session.base.results import Maybe, Number, write_text_whole
from session.base.texts import listed, printable, probability, significant
from tinygc.features.fleet.fleet_summary import IN_ORDER, results_of
from tinygc.features.fleet.fleet_table import EACH, FleetTable
from tinygc.features.fleet.lot import (
    NAMES,
    OWN,
    SENSOR_ERRORS,
    Lot,
    Outlier,
    UnitResult,
    error_sigmas,
    estimate,
    jacobian,
    key_of,
    lot_sessions,
    outliers,
    sensor_errors,
)
from tinygc.library.records import Shown
from tinygc.noise.figures import FILE, NoiseFigures, read_figures
from tinygc.noise.measured import SHOWN, rms_of_axes
from tinygc.reporting.facts import Chapter, Part, Table, page, screen
from tinygc.reporting.terminal import Group, Text, one_line

# Report of a lot: one function from the results of sessions to a record for tables, pages and files.

PER_UNITS = 1000


MaySize = Annotated[float, Maybe(Number(0))]


@dataclass(frozen=True)
class LotQuantity:
    """One number of the lot in its unit.

    units that show it; mean and its sigma; spread between units; repeatability, one sigma from session to session beyond what a session
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
class LotReport(Lot, Shown):
    """Result of ``tinygc.lot``: the lot as a prior, which is what ``fit --lot`` reads, with its report: its drift; sentences; the numbers
    that any unit shows, in displayed units; units that do not belong, the least probable first; noise: at rest of the units whose figures
    are known."""

    drift_p_value: Share
    drifts: bool
    notes: tuple[str, ...]
    quantities: tuple[LotQuantity, ...]
    outliers_found: Count
    outliers: tuple[Outlier, ...]
    noise: Annotated[Sequence[NoiseFigures], DERIVED] = ()

    def __repr__(self) -> str:
        return f"<LotReport of {self.units} units: {len(self.outliers)} outliers>"

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        return screen(lot_facts(self, everything=False))

    def to_json(self) -> dict:
        """``tinygc-lot/3`` (docs/formats.md)."""
        return table_of(self)

    def save(self, path: Path | str) -> Path:
        """Write the lot's file, for ``tinygc.fit(…, lot=path)``; returns the path."""
        write_whole(Path(path), self)
        return Path(path)

    def html(self) -> str:
        """The page as one HTML document."""
        chapters = [lot_chapter(self), *noise_chapters(self.noise)]
        return page("Lot statistics", f"{self.sensor or 'sensors'}: {self.units} units", chapters, "Statistics of a lot's calibrations.")

    def save_page(self, path: Path | str) -> Path:
        """Write a page; returns the path."""
        path = Path(path)
        with result_folder(path.parent):
            write_text_whole(path, self.html())
        return path


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
        notes.append("no unit has two sessions: repeatability is not known, and is part of the spread")
    if found.excluded.any():
        notes.append(f"the numbers are without the {int(found.excluded.sum())} of {sessions.units} units that do not belong")
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


# A fleet's table as a lot: sessions of sensors of one model.

MOST_NAMED = 5
#: fewest serial numbers for lot statistics on the page
FEWEST_UNITS = 8


def lot_of_table(table: FleetTable, model: str | None = None) -> LotReport:
    """Compute the lot of an open table.

    Raises CalibrationError where its sensors are of several models and none is named, and where fewer than two units were fitted.
    """
    fitted = f"FROM {EACH} WHERE held_out_deg IS NOT NULL"
    models = [name or "" for (name,) in table.rows(f"SELECT DISTINCT model {fitted} ORDER BY 1")]
    named = listed([printable(name or "(no name)") for name in models], MOST_NAMED)
    if model is not None and model not in models:
        raise CalibrationError(f"{table.path}: no fitted session of a {printable(model)}; there are {named or 'none at all'}")
    if model is None and len(models) > 1:
        raise CalibrationError(f"{table.path}: sensors of {len(models)} models ({named}), and a lot is of one; name it with --model")
    results = results_of(table)
    if model is not None and len(models) > 1:
        keys = {key for (key,) in table.rows(f"SELECT key {fitted} AND ifnull(model, '') = ?", (model,))}
        results = (each for each in results if each.key in keys)
    return lot_of(results, model or (models[0] if models else ""))


def lot_if_any(table: FleetTable) -> LotReport | None:
    """Compute the lot of an open table if its fitted sensors are of one model and enough for a page; else return None."""
    models, units = table.rows(
        f"SELECT count(DISTINCT ifnull(model, '')), count(DISTINCT serial) FROM {EACH} WHERE held_out_deg IS NOT NULL"
    )[0]
    return lot_of_table(table) if models == 1 and units >= FEWEST_UNITS else None


# What people see of it.

#: units that are listed one by one, the least probable first
MOST_SHOWN = 10
#: p-value below which a drift is marked
MARKED_P = 0.01
#: fewest units for a drift per 1000
FEWEST_DRIFT = 30


def lot_facts(report: LotReport, everything: bool = True) -> list[Part]:
    """The answer, numbers, units that do not belong, notes; everything: with the accelerometer's numbers."""
    shown = [each for each in report.quantities if everything or each.name.startswith("gyro")]
    rows = [
        [
            f"{each.name}, {each.unit}",
            (each.mean, each.mean_sigma),
            significant(each.spread, 2),
            significant(each.repeatability, 2),
            (each.drift_per_1000 if report.units >= FEWEST_DRIFT else None, each.drift_sigma),
        ]
        for each in shown
    ]
    styles = {k: "bold red" for k, each in enumerate(shown) if report.drifts and each.drift_p_value < MARKED_P}
    title = "Spread between units, and repeats of a unit's sessions (one sigma)"
    parts: list[Part] = [headline(report)]
    parts += [one_line(f"{each.description} ({probability(each.p_value)})", "bold red") for each in report.outliers[:MOST_SHOWN]]
    if report.outliers_found > MOST_SHOWN:
        parts.append(f"and {report.outliers_found - MOST_SHOWN} more, in the lot's file")
    parts.append(Table(title, ("", "mean ± sigma", "spread", "repeats", "drift per 1000"), rows, styles=styles, minor=(4,)))
    return parts + [one_line(f"Note: {note}.", "yellow") for note in report.notes]


def headline(report: LotReport) -> Text:
    """Whether all units belong, and whether they drift."""
    count = report.outliers_found
    which = f"{count} unit{'s do' if count != 1 else ' does'} not belong" if count else "All belong"
    drift = f"{'drift found' if report.drifts else 'no drift'} ({probability(report.drift_p_value)})"
    of = f" of {report.sensor}" if report.sensor else ""
    text = f"{which}, {drift}: {report.units} units{of}, {report.sessions} sessions."
    return one_line(text, "bold yellow" if count or report.drifts else "bold")


def lot_chapter(report: LotReport) -> Chapter:
    """What a page has of a lot."""
    return "lot", "The lot", lot_facts(report)


# Noise at rest of a fleet's units, where ``fit/noise.json`` lies in their session folders: medians, and the spread between units.
#
# The figures are read from the folders when a page is made: they are of units, and no result of a session.

TERMS = ("N", "B", "K")
#: units below which a spread means nothing
FEWEST = 3


def unit_noises(opened: FleetTable) -> list[NoiseFigures]:
    """Return the last figures of each unit of an open table; what cannot be read is passed over."""
    found: dict[str, NoiseFigures] = {}
    for serial, folder in opened.each(f"SELECT ifnull(serial, ''), folder FROM {EACH} {IN_ORDER}"):
        path = Path(folder) / "fit" / FILE
        if not path.is_file():
            continue
        try:
            found[serial or folder] = read_figures(path)
        except CalibrationError:  # fit of that session reports it
            continue
    return list(found.values())


def spread_between(values: np.ndarray, relative: np.ndarray) -> float:
    """Relative spread of a size between units, from values (U,) and their relative sigmas (U,), without the measurement's share.

    The variance of ln of the values is that between units, and the mean square of their own sigmas.
    """
    return float(np.sqrt(max(np.var(np.log(values), ddof=1) - np.mean(relative**2), 0.0)))


def noise_chapters(units: Sequence[NoiseFigures]) -> list[Chapter]:
    """Return the chapter of a page; none where no unit has figures."""
    rows = []
    for name in TERMS:
        known = [value for unit in units if (value := rms_of_axes(unit.gyro, name)) is not None]
        values, relative = np.array(known).reshape(-1, 2).T
        unit, si = SHOWN["gyro"][name]
        middle = float(np.median(values)) / si if known else None
        spread = f"{significant(100 * spread_between(values, relative), 2)} %" if len(known) >= FEWEST else None
        rows.append((f"{name}, {unit}", len(known), middle, spread))
    words = "Gyroscopes at rest, rms of the axes that show a term. The spread is without the measurement's share"
    table = Table(words, ("", "units", "median", "spread between units"), rows)
    return [("rest-noise", "Noise at rest", [table])] if units else []
