"""Comparison of methods: residual closure on fitted and on held-out segments."""

from __future__ import annotations

from collections.abc import Sequence

from session.base.numeric import rms_of
from session.base.texts import degrees
from session.base.units import DEG
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.reported import ReportData
from tinygc.reporting.fit_text import TITLES, Closed, closed_methods, closure_table
from tinygc.reporting.html.chart import Axis, Chart, log_axis
from tinygc.reporting.html.markup import Section, render


def section(evidence: ReportData) -> Section:
    """Section of table and picture."""
    rows = closed_methods(evidence.fit, evidence.adopted)
    html = render(
        "methods.html",
        e=evidence,
        titles=TITLES,
        folds=min(evidence.fit.options.folds, len(evidence.problem.used)),
        picture=lambda width: _picture(evidence, rows, width),
        keys=[
            ("after", "held out"),
            ("after", "fitted", "ring"),
            *([("physics", "closure run, RMSE")] if evidence.fit.runs else []),
            ("floor", "noise floor", "dash"),
        ],
        table=closure_table(evidence.fit, evidence.adopted),
    )
    return Section("methods", "Methods side by side", html)


def _picture(evidence: ReportData, rows: Sequence[Closed], width: int) -> str:
    floor = evidence.problem.floor.tilt_rms / DEG
    values = [floor]
    for _, _, _, fitted, held_out, errors, _ in rows:
        values += [tilt_rms(held_out) / DEG, *(rms_of(error) / DEG for error in errors)]
        values += [] if fitted is None else [tilt_rms(fitted) / DEG]
    x, count = log_axis(values, "closure, degrees", margin=1.3), len(rows)
    narrow = width < 500
    y = Axis(-0.7, count - 0.3, ticks=[] if narrow else [(count - 1 - i, row.title) for i, row in enumerate(rows)])
    chart = Chart(
        width, (46 if narrow else 30) * count + 62, x, y, "Closure by method", left=18 if narrow else 190, right=20 if narrow else 14
    )
    chart.upright(floor, "floor")
    for i, (name, title, _, fitted, held_out, errors, _) in enumerate(rows):
        level = count - 1 - i - (0.18 if narrow else 0)
        kind = name if name in TITLES else "ink"
        if narrow:
            _, (b,) = chart.at([x.lo], [level + 0.5])
            chart.text(20, float(b) + 6, title)
        chart.across(level, "quiet", style="grid")
        for error in errors:
            chart.dots([rms_of(error) / DEG], [level], "physics", [f"{title}, closure run: {degrees(rms_of(error))}"], radius=3)
        if fitted is not None:
            chart.dots([tilt_rms(fitted) / DEG], [level], kind, [f"{title}, fitted: {degrees(tilt_rms(fitted))}"], ring=True, radius=5.5)
        chart.dots([tilt_rms(held_out) / DEG], [level], kind, [f"{title}, held out: {degrees(tilt_rms(held_out))}"], radius=5)
    return chart.svg()
