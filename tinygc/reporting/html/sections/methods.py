"""Comparison of methods: residual closure on fitted and on held-out segments."""

from __future__ import annotations

from collections.abc import Sequence

from session.base.numeric import rms_of
from session.base.texts import degrees
from session.base.units import DEG
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.reported import ReportData
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.fit_text import TITLES, Closed, closed_methods, closure_table
from tinygc.reporting.html.markup import Section, render


def section(evidence: ReportData) -> Section:
    """Section of table and picture."""
    rows = closed_methods(evidence.fit, evidence.adopted)
    html = render(
        "methods.html",
        e=evidence,
        titles=TITLES,
        folds=min(evidence.fit.options.folds, len(evidence.problem.used)),
        picture=_picture(evidence, rows),
        table=closure_table(evidence.fit, evidence.adopted),
    )
    return Section("methods", "Methods side by side", html)


def _picture(evidence: ReportData, rows: Sequence[Closed]) -> Panel:
    names = Axis(lo=-0.6, hi=len(rows) - 0.4, ticks=[(float(n), row.title) for n, row in enumerate(rows)], down=True)
    panel = Panel(Axis("closure (°)", log=True), names, about="Closure by method", height=34 * len(rows) + 16)
    panel.upright(evidence.problem.floor.tilt_rms / DEG, name="noise floor")
    for n, (name, title, _, fitted, held_out, errors, _) in enumerate(rows):
        kind = name if name in TITLES else "ink"
        dots = [("closure run, RMSE", rms_of(error), "physics", False, 3.0) for error in errors]
        dots += [] if fitted is None else [("fitted", tilt_rms(fitted), kind, True, 5.5)]
        for which, size, colour, ring, radius in (*dots, ("held out", tilt_rms(held_out), kind, False, 5.0)):
            panel.points(size / DEG, n, colour, ring, radius, labels=[f"{title}, {which}: {degrees(size)}"])
    keys = [("held out", "after", False), ("fitted", "after", True)]
    for name, colour, ring in (*keys, *([("closure run, RMSE", "physics", False)] if evidence.fit.runs else [])):
        panel.points([], [], colour, ring, name=name)
    return panel
