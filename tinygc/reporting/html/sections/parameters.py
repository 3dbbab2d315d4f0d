"""The parameters in the field's terms, each with its expanded uncertainty (95 %), or marked as not observed."""

from __future__ import annotations

import numpy as np

from session.base.units import DEG_PER_HOUR
from tinygc.explanation.reported import ReportData
from tinygc.reporting.facts import errors_table
from tinygc.reporting.html.chart import enlargement, triad
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.html.sections.recording import temperature_words

#: term -> its meaning in one line
MEANINGS = {
    "scale factor error": "the axis reads so much too far, against the data sheet’s sensitivity",
    "scale factor asymmetry": "scale factor for positive less that for negative rates, over their mean",
    "misalignment": "input axis leans towards a reference axis",
    "nonorthogonality": "90° less the angle between two input axes",
    "triad rotation": "the whole triad against the reference axes, a rotation vector",
    "bias": "what it reads at no rate",
    "g-sensitivity": "what specific force adds to the rate",
    "angle random walk": "white noise of the rate, integrated; Allan deviation at 0.2 s",
    "bias instability": "floor of the overlapping Allan deviation / 0.664",
}


def section(evidence: ReportData) -> Section:
    """Section of picture and tables."""
    M = np.linalg.inv(evidence.adopted.linear.E)
    shown = [q for q in evidence.quantities if q.observed]
    ordered = sorted(evidence.quantities, key=lambda q: [*MEANINGS].index(q.word))
    html = render(
        "parameters.html",
        e=evidence,
        temperature=temperature_words(evidence.problem),
        triad=lambda width: triad(M, min(width, 320)),
        enlarged=enlargement(M),
        factors=[f"{q.factor:.2f}" for q in sorted(shown, key=lambda q: q.factor)],
        hidden=[q.name for q in evidence.quantities if not q.observed and q.word != "bias instability"],
        table=errors_table("", ordered, meanings=MEANINGS),
        per_hour=DEG_PER_HOUR,
    )
    return Section("parameters", "Parameters", html)
