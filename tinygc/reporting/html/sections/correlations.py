"""Correlations between parameters, and the strongest of them in words."""

from __future__ import annotations

import numpy as np

from session.base.numeric import sigmas_in
from session.base.texts import fixed
from tinygc.explanation.reported import ReportData
from tinygc.models.linear import PARAMETERS, field_jacobian
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.html.markup import Section, render

#: the independent ones of the field's 18 quantities: scale factors, misalignments, biases
INDEPENDENT = (0, 1, 2, 3, 4, 5, 6, 7, 8, 15, 16, 17)
NAMES = ("scale x", "scale y", "scale z", "x to y", "x to z", "y to x", "y to z", "z to x", "z to y", "bias x", "bias y", "bias z")
STRONG = 0.5


def section(evidence: ReportData) -> Section:
    """Section of the correlation matrix and its description."""
    adopted = evidence.adopted
    slope = field_jacobian(adopted.vector[:PARAMETERS])[list(INDEPENDENT)]
    covariance = slope @ adopted.covariance[:PARAMETERS, :PARAMETERS] @ slope.T
    sigma = sigmas_in(covariance)
    correlation = covariance / np.outer(sigma, sigma)
    pairs = sorted(((abs(correlation[i, j]), i, j) for i in range(PARAMETERS) for j in range(i)), reverse=True)
    strong = [f"{NAMES[j]} and {NAMES[i]} {fixed(correlation[i, j], 2)}" for size, i, j in pairs if size > STRONG][:6]
    html = render(
        "correlations.html",
        matrix=_matrix(correlation),
        strong=strong,
        limit=f"{STRONG:g}",
    )
    return Section("correlations", "Correlations", html)


def _matrix(correlation: np.ndarray) -> Panel:
    names = Axis(lo=-0.6, hi=PARAMETERS - 0.4, ticks=[(float(n), name) for n, name in enumerate(NAMES)], down=True)
    across = Axis(lo=-0.6, hi=PARAMETERS - 0.4, ticks=[])
    panel = Panel(across, names, about="Correlations of the twelve parameters", height=300, widest=400)
    for i in range(PARAMETERS):
        for j in range(i + 1):
            value, half = float(correlation[i, j]), 0.47
            kind, name = ("quiet", "") if i == j else ("z", "positive") if value > 0 else ("x", "negative")
            opacity, says = 0.35 if i == j else min(1.0, 0.04 + abs(value)), [f"{NAMES[j]} and {NAMES[i]}: {fixed(value, 2)}"]
            panel.area([j - half, j + half], i - half, i + half, kind, "solid", opacity=opacity, name=name, says=says)
    return panel
