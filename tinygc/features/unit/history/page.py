"""The page of ``history``, and the section of a calibration report, where ``report --history`` names other fitted sessions of the unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta

import numpy as np

from tinygc.estimation.session_times import YEAR_S
from tinygc.estimation.spread import ZERO
from tinygc.explanation.reported import ReportData
from tinygc.features.unit.history.curves import Panel, panels_of
from tinygc.features.unit.history.estimate import UnitHistory, history_of
from tinygc.features.unit.history.forecast import Outlook
from tinygc.features.unit.history.sessions import unit_sessions
from tinygc.features.unit.history.text import unit_facts
from tinygc.fitting.unit_state import fitted_state, state_of
from tinygc.reporting import facts
from tinygc.reporting.facts import Part, Picture
from tinygc.reporting.html.chart import Axis, Chart, linear_axis
from tinygc.reporting.html.markup import Section

HEIGHT = 230
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
    said = unit_facts(history, outlooks)
    for panel in panels_of(history):
        keys = [(curve.axis, curve.label) for curve in panel.curves] + [("floor", "shock", "dash")] * bool(panel.shocks)
        course = "the course with its 68 %, dashed where neither drift nor step is significant"
        caption = f"{panel.title}: difference from each one’s mean, and {course}."
        said.append(Picture(lambda width, panel=panel: _chart(history, panel, width), caption, keys))  # type: ignore[misc]
    return said


def _chart(history: UnitHistory, panel: Panel, width: int) -> str:
    everything = np.concatenate(
        [np.concatenate([curve.values - curve.sigmas, curve.values + curve.sigmas, curve.low, curve.high]) for curve in panel.curves]
    )
    up = linear_axis(everything, f"difference, {panel.unit}")
    # Axis of years since the first session, its ticks at sessions: dates, or names where there are none
    lo, hi = float(history.at[0]), float(history.at[-1])
    room = 0.04 * (hi - lo) or 0.5
    first = history.sessions[0].moment
    if history.dated and first is not None:
        whole = np.linspace(lo, hi, max(2, width // 170))
        ticks = [(float(at), (first.when + timedelta(seconds=float(at) * YEAR_S)).date().isoformat()) for at in whole]
    else:
        ticks = [(float(at), session.name[:16]) for at, session in zip(history.at, history.sessions, strict=True)]
    chart = Chart(width, HEIGHT, Axis(lo - room, hi + room, "", ticks=ticks), up, f"{panel.title} over the sessions")
    span = float(history.at[-1] - history.at[0]) or 1.0
    for k, curve in enumerate(panel.curves):
        if len(curve.grid):
            chart.area(curve.grid, curve.low, curve.high, curve.axis).line(
                curve.grid, curve.course, curve.axis, "thin" if curve.shows else "dash"
            )
        at = curve.at + (k - 1) * 0.006 * span
        for where, value, sigma in zip(at, curve.values, curve.sigmas, strict=True):
            chart.line([where, where], [value - sigma, value + sigma], curve.axis)
        names = [history.sessions[place].name for place in curve.sessions]
        component = panel.components[k]
        titles = [
            f"{name}: {component} {value:+.3g} ± {sigma:.2g} {panel.unit}"
            for name, value, sigma in zip(names, curve.values, curve.sigmas, strict=True)
        ]
        chart.dots(at, curve.values, curve.axis, titles)
    for at_years, words in panel.shocks:
        chart.upright(at_years, "floor")
        (px,), _ = chart.at([at_years], [0.0])
        chart.text(float(px) + 4, chart.top + chart.inner_height - 6, words, "start", "floor")
    return chart.svg()


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
