"""Correlations between parameters, and the strongest of them in words."""

from __future__ import annotations

import numpy as np

from session.base.numeric import sigmas_in
from session.base.texts import fixed
from tinygc.explanation.reported import ReportData
from tinygc.models.linear import PARAMETERS, field_jacobian
from tinygc.reporting.html.chart import drawing
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
        matrix=lambda width: _matrix(correlation, min(width, 400)),
        strong=strong,
        limit=f"{STRONG:g}",
    )
    return Section("correlations", "Correlations", html)


def _matrix(correlation: np.ndarray, side: int) -> str:
    left, top = 62.0, 8.0
    size = (side - left - 4) / PARAMETERS
    parts = []
    for i in range(PARAMETERS):
        y = top + i * size
        parts.append(f'<text x="{left - 8}" y="{y + size / 2 + 4:.1f}" text-anchor="end">{NAMES[i]}</text>')
        for j in range(i + 1):
            value = 1.0 if i == j else float(correlation[i, j])
            kind = "quiet" if i == j else "z" if value > 0 else "x"
            title = f"{NAMES[j]} and {NAMES[i]}: {fixed(value, 2)}"
            parts.append(
                f'<rect class="solid k-{kind}" opacity="{0.35 if i == j else min(1.0, 0.04 + abs(value)):.2f}" '
                f'x="{left + j * size:.1f}" y="{y:.1f}" '
                f'width="{size - 1.5:.1f}" height="{size - 1.5:.1f}"><title>{title}</title></rect>'
            )
    return drawing(side, top + PARAMETERS * size + 4, "Correlations of the twelve parameters", "".join(parts))
