"""Terminal output of a lot and of a fleet's table."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.base.texts import NONE, fixed, printable
from tinygc.features.fleet.report import LotReport
from tinygc.reporting.html.markup import decimals_for
from tinygc.reporting.terminal import Group, Table, Text, one_line, plain_table

if TYPE_CHECKING:
    from tinygc.features.fleet.fleet_run import FleetRun
    from tinygc.features.fleet.fleet_summary import Summary


# A lot: numbers, units that do not belong, notes.

MOST_OUTLIERS = 10
#: p-value below which a drift is marked
MARKED_P = 0.01
#: fewest units for a drift per 1000
FEWEST_DRIFT = 30
COLUMNS = ("", "mean ± sigma", "spread", "repeats within", "drift per 1000")
CAPTION = (
    "spread: one sigma between units, measurement noise taken out; repeats within: one sigma from session to session beyond what is stated"
)


def lot_page(report: LotReport) -> Group:
    """Headline, table, outliers, notes."""
    table = plain_table("Sensor errors", *COLUMNS, right=True)
    table.caption, table.caption_justify = CAPTION, "left"
    for row, drifts in rows_of(report):
        table.add_row(*row[:-1], Text(row[-1], "bold red" if drifts else ""))
    lines = [one_line(f"{each.says} (p = {each.p_value:.1g})", "bold red") for each in report.outliers[:MOST_OUTLIERS]]
    if report.outliers_found > MOST_OUTLIERS:
        lines.append(Text(f"and {report.outliers_found - MOST_OUTLIERS} more"))
    return Group(headline(report), table, *lines, *(one_line(f"Note: {note}.", "yellow") for note in report.notes))


def headline(report: LotReport) -> Text:
    """Number of units, drift, outliers."""
    drift = f"{'it drifts' if report.drifts else 'no drift is seen'} (p = {report.drift_p_value:.2g})"
    count = report.outliers_found
    which = f"{count} unit{'s do' if count != 1 else ' does'} not belong" if count else "all belong"
    name = f"{report.sensor}: " if report.sensor else ""
    said = f"{name}{report.units} units, {report.sessions} sessions; {drift}; {which}."
    return one_line(said, "bold yellow" if count or report.drifts else "bold")


def rows_of(report: LotReport) -> list[tuple[list[str], bool]]:
    """Return the cells of each number that any unit tells, by ``COLUMNS``, and whether it drifts."""
    rows = []
    for each in report.quantities:
        digits = decimals_for(each.mean_sigma)
        drift = NONE
        if report.units >= FEWEST_DRIFT and np.isfinite(each.drift_per_1000):
            drift = " ± ".join(fixed(value, decimals_for(each.drift_sigma)) for value in (each.drift_per_1000, each.drift_sigma))
        row = [
            f"{each.name}, {each.unit}",
            f"{fixed(each.mean, digits)} ± {fixed(each.mean_sigma, digits)}",
            fixed(each.spread, digits),
            fixed(each.repeatability, max(digits, decimals_for(each.repeatability))),  # often far below the spread between units
            drift,
        ]
        rows.append((row, report.drifts and each.drift_p_value < MARKED_P))
    return rows


# A fleet's table in a few lines.

MOST_SHOWN = 8  #: rows of each list; the page has more


def fleet_page(summary: Summary, tally: FleetRun | None) -> Group:
    """Return the summary, for rich."""
    lines = [] if tally is None else [f"this run: {tally.done} done, {tally.failed} failed, {tally.reused} known before"]
    lines.append(
        f"the table: {summary.folders} folders, {summary.sessions} different sessions of {summary.units} serial numbers; "
        f"{summary.done} done, {summary.all_failed} failed"
    )
    if summary.fitted:
        undecided = f", {summary.undecided} not decided" if summary.undecided else ""
        lines.append(f"of {summary.fitted} that were fitted, {summary.passed} pass{undecided}, {summary.missed} fail: {summary.rule}")
    for what, counts in (("first look", summary.first_look), ("explain", summary.verdicts), ("named", summary.effects)):
        if counts:
            shown = ", ".join(f"{name} {count}" for name, count in list(counts.items())[:MOST_SHOWN])
            lines.append(f"{what}: {shown}" + (" …" if len(counts) > MOST_SHOWN else ""))
    parts: list[Text | Table] = [Text(printable(line)) for line in lines]
    if summary.reasons:
        table = plain_table("Failures by reason", "sessions", "in", "because")
        table.columns[0].justify = "right"
        for step, reason, count in summary.reasons[:MOST_SHOWN]:
            table.add_row(str(count), step, printable(reason))
        parts.append(table)
    return Group(*parts)
