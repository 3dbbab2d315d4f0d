"""The page of ``rates``: for each sensor the law, the residuals, and the terms of IEEE 1431 as rows; sine sweeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session import VERSION
from session.base.texts import significant
from tinygc.features.tables.rates.choice import Choice
from tinygc.features.tables.rates.sweep import Sweep
from tinygc.features.tables.rates.terms import terms
from tinygc.features.tables.rates.text import cells, curve_words, headline, held_out_rows, lines
from tinygc.reporting.html.chart import Axis, Chart, linear_axis
from tinygc.reporting.html.markup import Section, escape, figure, key, paragraph, table
from tinygc.reporting.html.page import document
from tinygc.reporting.pictures.canvas import plain

#: rates at which a law is drawn
DRAWN = 401
HEIGHT, LOW = 260, 180


def page(choices: Sequence[Choice], sweeps: Sequence[Sweep], remarks: Sequence[str], name: str) -> str:
    """The page as one HTML document; name: of what was measured."""
    sections = [_sensor(choice, n) for n, choice in enumerate(choices)]
    sections += [_sweep(sweep, n) for n, sweep in enumerate(sweeps)]
    if remarks:
        sections.append(Section("remarks", "Remarks", "".join(paragraph(escape(remark)) for remark in remarks)))
    head = f'<header><p class="kicker">Rate table</p><h1>{escape(name)}</h1></header>'
    foot = f"<footer>Terms of IEEE 1431, 12.9 to 12.11 and 12.15. ± is one standard deviation. TinyGC {escape(VERSION)}.</footer>"
    return document(f"Rate table: {name}", head, sections, foot)


def _sensor(choice: Choice, number: int) -> Section:
    said = "".join(paragraph(escape(line)) for line in (headline(choice), *lines(choice)))
    rows = []
    for row in terms(choice):
        value, sigma = cells(row)
        rows.append([escape(text) for text in (row.name, value, sigma, row.unit, row.condition)])
    keys = [key("after", "measured"), key("physics", "chosen law", "line"), key("floor", "straight line", "dash")]
    html = said + table(("", "value", "±", "unit", "condition"), rows, "“Less than” is an upper limit (95 %) of a term that does not show.")
    html += figure(lambda width: _output(choice, width), "", keys)
    html += figure(lambda width: _residuals(choice, width), "What the chosen law leaves.")
    if choice.held_out:
        curves = choice.points.curves
        rows = [[escape(law), *found] for law, found in held_out_rows(choice)]
        words = (
            f"Rms, {escape(choice.points.unit)}, on a curve that was not fitted; its offset alone is free. "
            "In brackets: with the rates that lie beyond those that were fitted."
        )
        html += table(("", *(escape(curve_words(curve)) for curve in curves)), rows, words)
    return Section(f"sensor-{number}", choice.points.sensor, html)


def _rates(choice: Choice) -> Axis:
    return linear_axis(choice.points.rate_dps, "rate, °/s")


def _output(choice: Choice, width: int) -> str:
    points = choice.points
    grid = np.linspace(points.rate_dps.min(), points.rate_dps.max(), DRAWN)
    law, line = choice.fit.at(grid), choice.line.at(grid)
    chart = Chart(width, HEIGHT, _rates(choice), linear_axis([*points.output, *law], f"output, {points.unit}"), "Output over rate")
    chart.line(grid, line, "floor", "dash").line(grid, law, "physics")
    return chart.dots(points.rate_dps, points.output, "after", _titles(choice), radius=3).svg()


def _residuals(choice: Choice, width: int) -> str:
    left, points = choice.fit.residuals, choice.points
    chart = Chart(width, LOW, _rates(choice), linear_axis([*left, 0.0], f"left, {points.unit}"), "What the law leaves over rate")
    return chart.across(0.0, "floor").dots(points.rate_dps, left, "after", _titles(choice), radius=3).svg()


def _titles(choice: Choice) -> list[str]:
    points = choice.points
    names = [curve_words(points.curves[n]) for n in points.curve]
    return [
        f"{name} {significant(rate)} °/s: {value:.6g} {points.unit}, {left:+.2g} from the law".strip()
        for name, rate, value, left in zip(names, points.rate_dps, points.output, choice.fit.residuals, strict=True)
    ]


def _sweep(sweep: Sweep, number: int) -> Section:
    rows = [[significant(f), plain(gain, gs), plain(phase, ps)] for f, gain, gs, phase, ps in sweep.rows_deg]
    said = "".join(paragraph(escape(line)) for line in (sweep.headline, *sweep.lines))
    return Section(f"sweep-{number}", f"Sweep {sweep.response.name}", said + table(("frequency, Hz", "gain", "phase, °"), rows))
