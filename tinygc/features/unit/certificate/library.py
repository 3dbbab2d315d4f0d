"""A certificate of a report's data: HTML for paper, PDF, and the Digital Calibration Certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import CalibrationError, FormatError
from session.base.files import open_file, result_folder
from session.base.results import write_text_whole
from session.base.texts import fixed, significant
from session.log.config import read_config
from session.log.requirements import ATTITUDE
from tinygc.explanation.reported import ReportData
from tinygc.features.unit.certificate.content import Content, content_of
from tinygc.features.unit.certificate.dcc_file import dcc_text, require_fields
from tinygc.inference.decide import Conformity, Fact, share_words
from tinygc.library.arguments import public
from tinygc.library.reports import Report
from tinygc.models.files import load_with_table
from tinygc.models.linear import LinearModel
from tinygc.reporting.facts import Table, errors_table
from tinygc.reporting.html.markup import render
from tinygc.reporting.html.paper import print_pdf, require_browser

#: bytes of a file that say whether it is a certificate
ENOUGH = 4096


@dataclass(frozen=True, eq=False, repr=False)
class Certificate:
    """Result of ``tinygc.certificate``: ``html``, ``dcc``, ``draft``, ``missing``, ``save(path)``, ``to_json()``."""

    content: Content

    def __repr__(self) -> str:
        return f"<Certificate {self.content.number}{': a draft' if self.content.draft else ''}>"

    @property
    def draft(self) -> tuple[str, ...]:
        """Why it is a draft; empty of one that may be signed."""
        return self.content.draft

    @property
    def missing(self) -> tuple[str, ...]:
        """Keys of session.toml that a certificate requires and that are not there."""
        return self.content.missing

    @property
    def line(self) -> str:
        """What is missing, in one line; empty where nothing is."""
        return f"certificate: a draft; {'; '.join(self.draft)}" if self.draft else ""

    @cached_property
    def html(self) -> str:
        """The certificate as one HTML document that needs nothing else."""
        return page(self.content)

    @cached_property
    def dcc(self) -> str:
        """The certificate as Digital Calibration Certificate, XML.  Raises CalibrationError for a draft."""
        return dcc_text(self.content)

    def save(self, path: Path | str, *, pdf: bool = False) -> list[Path]:
        """Write the HTML file, and the same as PDF beside it, which needs Chromium; returns the paths."""
        path = Path(path)
        if pdf:
            require_browser()
        with result_folder(path.parent):
            write_text_whole(path, self.html)
        return [path, *([print_pdf(path, path.with_suffix(".pdf"))] if pdf else [])]

    def save_dcc(self, path: Path | str) -> Path:
        """Write the Digital Calibration Certificate; returns its path.  Raises CalibrationError for a draft."""
        path, text = Path(path), self.dcc
        with result_folder(path.parent):
            write_text_whole(path, text)
        return path

    def to_json(self) -> dict:
        """``certificate`` of ``tinygc-report/1``."""
        return {"number": self.content.given.number or None, "draft": list(self.draft), "missing": list(self.missing)}


def check_before(folder: Path, form: Path | None, dcc: Path | None) -> None:
    """Refuse, before a fit, what its certificate would fail at.

    Raises CalibrationError where a certificate that is no draft lies at one of the two paths, or session.toml lacks what a Digital
    Calibration Certificate needs, and FormatError for a damaged session.toml.
    """
    for path, mark in ((form, f"<title>{TITLE} "), (dcc, "digitalCalibrationCertificate")):
        if path is None or not path.is_file():
            continue
        with open_file(path) as stream:
            begins = stream.read(ENOUGH)
        if mark.encode() in begins:
            raise CalibrationError(f"{path}: holds a certificate, which may be issued; move it to its place, or give another file")
    if dcc is not None and (toml := folder / "session.toml").is_file():
        require_fields(read_config(toml))


@public()
def certificate(report: Any, as_found: Path | str | None = None) -> Certificate:
    """Make the form that a laboratory signs, of a report.

    Parameters
    ----------
    report : Report
        The report whose numbers it states.
    as_found : str or Path, optional
        Model file of the calibration in use until now, whose errors are then stated.

    Returns
    -------
    Certificate
        ``html``, ``dcc``, ``draft``, ``missing``, ``save(path, pdf=False)``, ``save_dcc(path)``.

    Raises
    ------
    CalibrationError
        For a file that is no linear model.

    Examples
    --------
    >>> import tinygc
    >>> tinygc.certificate(tinygc.report("data/session1")).save("certificate.html")  # doctest: +SKIP

    """
    if not isinstance(report, Report):
        raise CalibrationError(f"report is of type {type(report).__name__}, expected a report: tinygc.report(session)")
    return certificate_of(report.data, as_found)


def certificate_of(data: ReportData, as_found: Path | str | None = None) -> Certificate:
    """The certificate of a report's data; as_found: model file of the calibration in use until now.

    Raises FormatError for a file that is no linear model.
    """
    previous = None
    if as_found is not None:
        model, _ = load_with_table(as_found)
        if not isinstance(model, LinearModel):
            raise FormatError(f"{as_found}: a model of kind {model.kind}, expected a linear one; give model_least_squares.json")
        previous = (Path(as_found).name, model)
    return Certificate(content_of(data, previous))


# The HTML document for paper: A4, the number and page x of y on every sheet; nothing is fetched, nothing runs.

TITLE, DRAFT = "Calibration certificate", "Draft of a calibration certificate"


def page(content: Content) -> str:
    """The certificate as HTML."""
    title = DRAFT if content.draft else TITLE
    number = f"{'draft, ' if content.draft else ''}certificate number {content.number}"
    model = zip("xyz", content.model.E, content.model.B, strict=True)
    rows = [[axis, *(fixed(each, 6) for each in row), fixed(bias, 7)] for axis, row, bias in model]
    closure = [[_first(each.name), each.stated, _factor(each), significant(floor, 2)] for each, floor in content.closure]
    return render(
        "certificate.html",
        "tinygc.features.unit.certificate",
        c=content,
        title=title,
        running={"bottom-left": number},
        results=errors_table("", content.results, meanings={}),
        found=errors_table("", content.as_found, meanings={}),
        model=Table("", ("ω = E m + B", "E, of m x", "E, of m y", "E, of m z", "B, rad/s"), rows),
        closure=Table("", ("Closure with it, degrees", "Value ± U", "k", "Noise alone"), closure),
        statements=[(reference, rule, _conformities(each)) for reference, rule, each in content.statements],
    ).lstrip()


def _first(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}"


def _factor(each: Fact) -> str:
    return fixed(each.factor, 2) if each.observed and each.expanded > 0 else ""


def _conformities(conformities: Sequence[Conformity]) -> Table:
    rows = []
    for each in conformities:
        m = each.measured
        risk = "not known"
        if m.key == ATTITUDE:
            risk = "none: an uncertainty"
        elif each.risk is not None:
            risk = share_words(each.risk)
        elif m.observed and np.isfinite(m.u):
            risk = f"PASS {share_words(1 - each.probability)}, FAIL {share_words(each.probability)}"
        rows.append([f"{_first(m.name)}, {m.unit}", each.limit_words, m.stated, _factor(m), each.answer.upper(), risk])
    return Table("", ("Requirement", "Limits", "Value ± U", "k", "Answer", "Risk that it is wrong"), rows)
