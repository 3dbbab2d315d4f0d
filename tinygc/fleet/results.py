"""Rows of a fleet's table as the records that a lot is made of, and as CSV."""

from __future__ import annotations

import contextlib
import csv
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np

from session.common.errors import FormatError
from tinygc.fleet.cells import told_by
from tinygc.fleet.row import COLUMNS, VALUES, unpacked
from tinygc.fleet.table import COUNTED, EACH, Table, read_table
from tinygc.lot.unit_result import UnitResult, Weighed

#: in the order of production: by time where that is known, then by name, in which s2 is before s10
IN_ORDER = f"ORDER BY ifnull(recorded, '') = '', recorded, {COUNTED}(folder), folder"
#: as bytes they are for programs, and weighed is as long as all the rest
NOT_IN_CSV = ("covariance", "weighed")


def unit_results(out: Path) -> Iterator[UnitResult]:
    """Of OUT's table, each session that was fitted, in the order of production, one after the other; a copy counts once.

    FormatError where there is no table.
    """
    with read_table(out) as table:
        yield from results_of(table)


def results_of(table: Table) -> Iterator[UnitResult]:
    """The same, of a table that is open."""
    names = ("key", "folder", "serial", "recorded", "held_out_deg", "floor_deg", "operator", "station", "effects", "weighed", "covariance")
    sql = f"SELECT {', '.join((*names, *VALUES))} FROM {EACH} WHERE held_out_deg IS NOT NULL {IN_ORDER}"
    for order, row in enumerate(table.each(sql)):
        told = dict(zip(names, row, strict=False))
        with read_as_written(table, told["folder"]):
            found = UnitResult(
                key=told["key"],
                serial=told["serial"] or "",
                session=Path(told["folder"]).name,
                values=np.array(row[len(names) :], dtype=float),
                covariance=unpacked(told["covariance"]),
                recorded=told["recorded"] or "",
                order=float(order),
                closure_deg=told["held_out_deg"],
                floor_deg=told["floor_deg"],
                operator=told["operator"] or "",
                station=told["station"] or "",
                effects=weighed_of(told["weighed"]),
            )
        yield found


@contextlib.contextmanager
def read_as_written(table: Table, folder: str) -> Iterator[None]:
    """FormatError for what another program has put into a row."""
    try:
        yield
    except (ValueError, TypeError, KeyError, AttributeError):
        raise FormatError(
            f"{table.path}: the row of {folder} holds what fleet does not write; delete it from the table results, and run fleet again"
        ) from None


def weighed_of(text: str | None) -> Mapping[str, Weighed]:
    """What ``compute`` kept of each effect, by id; NaN for what JSON has no number for: it was not told."""
    found = {}
    for name, each in told_by(text or "{}").items():
        for key in ("estimates", "sigmas"):
            each[key] = {component: np.nan if value is None else value for component, value in each[key].items()}
        found[name] = Weighed(**each)
    return found


def write_csv(table: Table, file: TextIO) -> int:
    """A header and a line for each folder, by name; returns how many.  Effects are their ids with spaces between; SI as in the table."""
    columns = [name for name in COLUMNS if name not in NOT_IN_CSV]
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["folder", "key", *columns])
    sql = (
        f"SELECT folders.folder, folders.key, {', '.join(columns)}, folders.error FROM folders LEFT JOIN results USING (key) ORDER BY 1"
    ).replace(" error,", " results.error,")
    status, error, effects, findings = (2 + columns.index(name) for name in ("status", "error", "effects", "findings"))
    count = 0
    for row in table.each(sql):
        cells = list(row[:-1])
        if row[1] is None:
            cells[status], cells[error] = "failed", row[-1]
        with read_as_written(table, row[0]):
            cells[effects] = " ".join(effect["id"] for effect in told_by(cells[effects] or "[]"))
            cells[findings] = "; ".join(f"{each['where']}: {each['what']}: {each['says']}" for each in told_by(cells[findings] or "[]"))
        writer.writerow(["" if cell is None else repr(cell) if isinstance(cell, float) else cell for cell in cells])
        count += 1
    return count
