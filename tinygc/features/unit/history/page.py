"""The page of ``history``, and the section of a calibration report, where ``report --history`` names other fitted sessions of the unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tinygc.estimation.spread import ZERO
from tinygc.explanation.reported import ReportData
from tinygc.features.unit.history.curves import kinds_of, panel_of
from tinygc.features.unit.history.estimate import UnitHistory, history_of
from tinygc.features.unit.history.forecast import Outlook
from tinygc.features.unit.history.sessions import unit_sessions
from tinygc.features.unit.history.text import unit_facts
from tinygc.fitting.unit_state import fitted_state, state_of
from tinygc.reporting import facts
from tinygc.reporting.facts import Part
from tinygc.reporting.html.markup import Section

#: the section of the report that this one stands behind
BEHIND = "explanation"


def page(units: Sequence[UnitHistory], outlooks: Sequence[Sequence[Outlook]], remarks: Sequence[str]) -> str:
    """The page as one HTML document."""
    sections = [(f"unit-{k}", unit.name, unit_page(unit, own)) for k, (unit, own) in enumerate(zip(units, outlooks, strict=True))]
    sections += [("remarks", "Remarks", [*remarks])] if remarks else []
    title = units[0].name if len(units) == 1 else f"{len(units)} units"
    return facts.page("History", title, sections, "± is one standard deviation; intervals and limits have 95 %.")


def unit_page(history: UnitHistory, outlooks: Sequence[Outlook]) -> list[Part]:
    """What stands of one unit, with its charts."""
    return [*unit_facts(history, outlooks), *(panel_of(history, kind) for kind in kinds_of(history))]


def section(evidence: ReportData) -> Section | None:
    """Section on the unit's sessions, this one among them; None where the fit has no ``history``."""
    fit = evidence.fit
    if not fit.options.history or "least_squares" not in fit.methods:
        return None
    others = [fitted_state(folder) for folder in fit.options.history]
    history = history_of(unit_sessions([*others, state_of(fit, fit.session.config)]))
    # The fit states the bias of any other session, of the others alone: one document has one number.
    spread = fit.spread.at(ZERO)
    history = replace(history, any_session=None if spread.is_usual else spread)
    return Section("history", "History", facts.html(unit_page(history, ())))
