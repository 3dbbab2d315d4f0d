"""The history of the unit in a calibration report, where ``report --history`` names other fitted sessions of it."""

from __future__ import annotations

from dataclasses import replace

from tinygc.explanation.reported import ReportData
from tinygc.features.unit.calibrated import calibrated_of, read_calibrated
from tinygc.features.unit.history.estimate import history_of
from tinygc.features.unit.history.page import unit_html
from tinygc.features.unit.history.sessions import unit_sessions
from tinygc.reporting.html.markup import Section

#: the section of the report that this one stands behind
BEHIND = "explanation"


def section(evidence: ReportData) -> Section | None:
    """Section on the unit's sessions, this one among them; None where the fit has no ``history``."""
    fit = evidence.fit
    if not fit.options.history or "least_squares" not in fit.methods:
        return None
    others = [read_calibrated(folder) for folder in fit.options.history]
    history = history_of(unit_sessions([*others, calibrated_of(fit, fit.session.config)]))
    # The fit states the bias of any other session, of the others alone: one document has one number.
    return Section("history", "History", unit_html(replace(history, any_session=fit.repeatability), ()))
