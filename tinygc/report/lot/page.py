"""The page of ``calibrate.py lot``."""

from __future__ import annotations

from pathlib import Path

from session.common.version import VERSION
from session.files.results import write_text_whole
from session.files.writing import result_folder
from tinygc.lot.report import LotReport
from tinygc.report.html.markup import escape
from tinygc.report.html.page import document
from tinygc.report.lot.sections import lot_sections


def page(report: LotReport) -> str:
    """The page as one HTML document."""
    name = escape(report.lot.sensor or "sensors")
    head = f'<header><p class="kicker">Lot statistics</p><h1>{name}: {report.lot.units} units</h1></header>'
    foot = f"<footer>Statistics of a lot's calibrations. TinyGC {escape(VERSION)}.</footer>"
    return document(f"Lot: {report.lot.units} units", head, lot_sections(report), foot)


def save(report: LotReport, path: Path) -> Path:
    """Write the page, whole or not at all; returns its path."""
    with result_folder(path.parent):
        write_text_whole(path, page(report))
    return path
