"""Result of ``explain`` with a truth file as reference: errors of the sensor, of the truth, of their clocks and frames."""

from __future__ import annotations

import numpy as np

from session.base.units import DEG
from tinygc.features.truth.evidence import TruthExplanation
from tinygc.features.truth.text import CANNOT, evidence_rows, refusals, values_of
from tinygc.reporting.html.chart import Chart, log_axis
from tinygc.reporting.html.markup import Section, render


def section(e: TruthExplanation) -> Section:
    """Section on the explanation."""
    html = render(
        "truth.html",
        "tinygc.features.truth",
        e=e,
        values_of=values_of,
        refusals=refusals(e),
        rows=evidence_rows(e),
        growth=lambda width: _growth(e, width),
        cannot=CANNOT,
    )
    return Section("explain", "Why recording and truth differ", html)


def _growth(e: TruthExplanation, width: int) -> str:
    closure = e.closure_rad / DEG
    # A gyro that is never still shows vibration in its apparent noise.
    own = e.gyro_rad / DEG * np.sqrt(e.lengths_s) if len(e.problem.stills) else np.zeros(0)
    x, y = log_axis(e.lengths_s, "length of a segment, s"), log_axis(np.r_[closure.ravel(), own], "closure, degrees")
    chart = Chart(width, 250, x, y, "Closure against the length of a segment")
    if len(own):
        chart.line(e.lengths_s, own, "floor", "dash")
    for i, axis in enumerate("xyz"):
        chart.dots(e.lengths_s, closure[:, i], axis)
    return chart.svg()
