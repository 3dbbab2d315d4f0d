"""Correlations between parameters, and the strongest of them in words."""

from __future__ import annotations

import numpy as np

from session.base.texts import fixed
from tinygc.explanation.reported import ReportData
from tinygc.models.linear import PARAMETERS
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.fit_text import ERRORS, STRONG, correlations
from tinygc.reporting.html.markup import Section, render


def section(evidence: ReportData) -> Section:
    """Section of the correlation matrix and its description."""
    correlation, strong = correlations(evidence.adopted.vector[:PARAMETERS], evidence.adopted.covariance[:PARAMETERS, :PARAMETERS])
    html = render(
        "correlations.html",
        matrix=_matrix(correlation),
        strong=strong,
        limit=f"{STRONG:g}",
    )
    return Section("correlations", "Correlations", html)


def _matrix(correlation: np.ndarray) -> Panel:
    names = Axis(lo=-0.6, hi=PARAMETERS - 0.4, ticks=[(float(n), name) for n, name in enumerate(ERRORS)], down=True)
    across = Axis(lo=-0.6, hi=PARAMETERS - 0.4, ticks=[])
    panel = Panel(across, names, about="Correlations of the twelve parameters", height=300, widest=400)
    for i in range(PARAMETERS):
        for j in range(i + 1):
            value, half = float(correlation[i, j]), 0.47
            kind, name = ("quiet", "") if i == j else ("z", "positive") if value > 0 else ("x", "negative")
            opacity, labels = 0.35 if i == j else min(1.0, 0.04 + abs(value)), [f"{ERRORS[j]} and {ERRORS[i]}: {fixed(value, 2)}"]
            panel.area([j - half, j + half], i - half, i + half, kind, "solid", opacity=opacity, name=name, labels=labels)
    return panel
