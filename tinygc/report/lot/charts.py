"""Control charts as SVG: units by production order with their limits, and the moving average below."""

from __future__ import annotations

import numpy as np

from tinygc.lot.control import Chart as Control
from tinygc.lot.quantities import Seen
from tinygc.report.html.chart import Axis, Chart, linear_axis
from tinygc.report.html.markup import escape, figure, key
from tinygc.report.html.numbers import significant

#: single points up to so many; beyond, bands of the least and the largest
MOST_POINTS = 600
MOST_TITLES = 60
HEIGHT, LOW = 220, 130


def control_figure(chart: Control, seen: Seen, serials: list[str]) -> str:
    """Individuals and EWMA of one number; serials (U,) of units, in the order of production."""
    said = [f"{chart.limit:.1f} sigmas are the limit of a single point: one false alarm in a hundred lots, over all charts."]
    for rule in chart.broken:
        said.append(f"{escape(rule.capitalize())}: {chart.counts[rule]} times, by chance {significant(chart.chance[rule], 2)}.")
    keys = [key("after", "unit"), key("bad", "beyond its limit"), key("floor", "mean and limits", "dash"), key("physics", "EWMA", "line")]
    return figure(lambda width: _individuals(chart, seen, serials, width), "", keys) + figure(
        lambda width: _ewma(chart, seen, width), " ".join(said)
    )


def _axis(chart: Control) -> Axis:
    return Axis(float(chart.place[0]), float(max(chart.place[-1], chart.place[0] + 1)) + 1, "unit, in production order")


def _individuals(chart: Control, seen: Seen, serials: list[str], width: int) -> str:
    limit = chart.limit * chart.sigma
    # Wild points lie at the frame: they must not press all others into a line.
    usual = chart.y[np.abs(chart.score) <= chart.limit]
    high, low = chart.centre + np.median(limit), chart.centre - np.median(limit)
    y = linear_axis(np.concatenate([usual, [high, low]]), f"{seen.name}, {seen.unit}")
    drawn = Chart(width, HEIGHT, _axis(chart), y, f"{seen.name} by production order")
    place = chart.place + 1.0
    drawn.line(place, chart.centre + limit, "floor", "dash").line(place, chart.centre - limit, "floor", "dash")
    drawn.across(chart.centre, "floor")
    if len(chart.y) <= MOST_POINTS:
        drawn.dots(place, chart.y, "after", radius=2.2)
    else:
        drawn.line(place, chart.y, "after", "thin")
    shown = chart.alarms[np.argsort(-np.abs(chart.score[chart.alarms]))][:MOST_TITLES]
    names = [serials[int(chart.place[n])] or f"unit {int(chart.place[n]) + 1}" for n in shown]
    titles = [f"{name}: {chart.y[n]:.4g} {seen.unit}, {chart.score[n]:+.1f} sigmas" for name, n in zip(names, shown, strict=True)]
    return drawn.dots(place[shown], chart.y[shown], "bad", titles, ring=True, radius=5).svg()


def _ewma(chart: Control, seen: Seen, width: int) -> str:
    reach = max(chart.ewma_limit * 1.15, float(np.abs(chart.ewma).max()) * 1.05)
    drawn = Chart(width, LOW, _axis(chart), Axis(-reach, reach, "moving average, sigmas"), f"Moving average of {seen.name}")
    drawn.across(chart.ewma_limit, "floor").across(-chart.ewma_limit, "floor")
    return drawn.line(chart.place + 1.0, chart.ewma, "physics").svg()
