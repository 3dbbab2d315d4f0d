"""The sensor's axes, and the parameters beside those of E and B in the field's terms, each ± one sigma, or marked as not observed."""

from __future__ import annotations

import numpy as np

from session.base.rotation import unit_vectors
from session.base.units import DEG_PER_HOUR
from tinygc.explanation.reported import ReportData
from tinygc.reporting.drawing import Panel
from tinygc.reporting.facts import errors_table
from tinygc.reporting.fit_text import TERMS
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.html.sections.recording import temperature_words

#: term -> its meaning in one line
MEANINGS = {
    "scale factor error": "the axis reads so much too far",
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
    ordered = sorted((q for q in evidence.quantities if q.word not in TERMS), key=lambda q: [*MEANINGS].index(q.word))
    html = render(
        "parameters.html",
        e=evidence,
        temperature=temperature_words(evidence.problem),
        triad=_triad(M),
        enlarged=_enlargement(M),
        hidden=[q.name for q in evidence.quantities if not q.observed and q.word != "bias instability"],
        table=errors_table("", ordered, meanings=MEANINGS),
        per_hour=DEG_PER_HOUR,
    )
    return Section("parameters", "Parameters", html)


# The sensor's axes and the reference axes, with errors enlarged until they are visible.

#: the largest error is drawn at about this angle
SHOWN_RAD = 0.22
#: drawing directions across and up for a viewer to the right, in front and above; body axes are forward-right-down, so z points down
_ACROSS, _UP = np.array([-0.62, 0.78, 0.0]), np.array([-0.36, -0.30, -0.88])


def _enlargement(M: np.ndarray) -> float:
    """Round factor by which errors are enlarged."""
    u = unit_vectors(M)
    largest = max(float(np.abs(u - np.eye(3)).max()), float(np.abs(np.linalg.norm(M, axis=1) - 1).max()), 1e-6)
    wanted = SHOWN_RAD / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1, 2, 5) if step * power <= wanted * (1 + 1e-9)))


def _triad(M: np.ndarray) -> Panel:
    """The response rows of M (3, 3) as arrows, and the reference axes behind them."""
    factor = _enlargement(M)
    about = f"Input axes and scale factors of the sensor, errors enlarged {factor:g} times"
    panel = Panel(about=about, height=230, widest=320, is_equal=True, is_framed=False)
    for axis, row, reference in zip("xyz", np.eye(3) + factor * (M - np.eye(3)), np.eye(3), strict=True):
        tip, base = (np.array([v @ _ACROSS, v @ _UP]) for v in (row, reference))
        along = tip / np.linalg.norm(tip)
        aside, back = np.array([-along[1], along[0]]), tip - 0.06 * along
        panel.line([0, base[0]], [0, base[1]], "quiet", "dash", name="reference")
        panel.line([0, back[0]], [0, back[1]], axis, name=f"{axis}, sensor")
        head = np.stack([back - 0.03 * aside, tip, back + 0.03 * aside])
        panel.area(head[:, 0], head[:, 1], head[:, 1], axis, "solid")
        x, y = tip + 0.1 * along
        panel.words(float(x), float(y), axis, axis, anchor="middle")
    return panel
