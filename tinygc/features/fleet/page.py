"""The page of ``fleet --lot``: numbers, and units that do not belong."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from session import VERSION
from session.base.files import result_folder
from session.base.results import write_text_whole
from session.base.texts import fixed, probability
from tinygc.features.fleet.report import LotReport
from tinygc.features.fleet.text import CAPTION, COLUMNS, rows_of
from tinygc.reporting.html.markup import Section, escape, paragraph, table
from tinygc.reporting.html.page import document

MOST_OUTLIERS = 50


def lot_sections(report: LotReport) -> list[Section]:
    """Return the sections of a page."""
    rows = rows_of(report, fixed)
    drift = probability(report.estimate.drift_p)
    said = f"The lot {'drifts' if report.estimate.drifts else 'does not drift beyond chance'} ({drift}, all numbers together)."
    marked = [number for number, (_, drifts) in enumerate(rows) if drifts]
    html = paragraph(f"{report.lot.units} units, {report.lot.sessions} sessions. {said}")
    html += table(COLUMNS, [row for row, _ in rows], CAPTION, marked=marked)
    html += "".join(paragraph(f"{escape(note[:1].upper() + note[1:])}.", "soft") for note in report.notes)
    return [Section("lot", "The lot", html), Section("lot-outliers", "What does not belong", _outliers(report))]


def _outliers(report: LotReport) -> str:
    if not report.outliers:
        return paragraph("No unit is farther off than chance explains.")
    rows = [
        f'<div class="found">{paragraph(f"{escape(each.says)}. By chance, in such a lot: {probability(each.p_value)}.")}</div>'
        for each in report.outliers[:MOST_OUTLIERS]
    ]
    more = len(report.outliers) - len(rows)
    return "".join(rows) + (paragraph(f"And {more} more, in the lot's file.", "soft") if more > 0 else "")


# The page of ``fleet --lot``.


def page(report: LotReport, more: Sequence[Section] = ()) -> str:
    """Return the page as one HTML document; more: sections at its end."""
    name = escape(report.lot.sensor or "sensors")
    head = f'<header><p class="kicker">Lot statistics</p><h1>{name}: {report.lot.units} units</h1></header>'
    foot = f"<footer>Statistics of a lot's calibrations. TinyGC {escape(VERSION)}.</footer>"
    return document(f"Lot: {report.lot.units} units", head, [*lot_sections(report), *more], foot)


def save(report: LotReport, path: Path, more: Sequence[Section] = ()) -> Path:
    """Write the page atomically; return its path."""
    with result_folder(path.parent):
        write_text_whole(path, page(report, more))
    return path
