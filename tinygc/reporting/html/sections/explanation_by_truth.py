"""What ``explain`` found where the reference is a truth file: of the sensor, of the truth, of their clocks and frames."""

from __future__ import annotations

import numpy as np

from session.io.units import DEG
from tinygc.explanation.truth_evidence import TruthClaim, TruthExplanation
from tinygc.reporting.html.chart import Chart, log_axis
from tinygc.reporting.html.evidence import Evidence
from tinygc.reporting.html.markup import Section, code, escape, figure, key, paragraph, probability, table
from tinygc.reporting.truth_text import CANNOT, evidence_rows, refusals, values_of


def section(evidence: Evidence) -> Section | None:
    """None without a truth file, or where explain was not asked."""
    e = evidence.against_truth
    if e is None:
        return None
    html = paragraph(f"<strong>{escape(e.verdict.replace('_', ' ').capitalize())}</strong> ({probability(e.p_value)}).")
    html += "".join(map(_claim, e.claimed))
    html += "".join(paragraph(f"{escape(sentence[:1].upper() + sentence[1:])}.") for sentence in refusals(e))
    html += table(("Of", "it says"), [(escape(of), escape(says)) for of, says in evidence_rows(e)], kind="words")
    if len(e.lengths_s) > 1:
        html += figure(
            lambda width: _growth(e, width),
            "Closure against the length of a segment: the truth's own noise is the same for each length, the gyro's grows as the root of "
            "it, a bias as the length.",
            [key(axis, axis) for axis in "xyz"] + ([key("floor", "the gyro's own noise", "dash")] if len(e.problem.stills) else []),
        )
    return Section("explain", "Why recording and truth differ", html + paragraph(escape(CANNOT[:1].upper() + CANNOT[1:]) + ".", "soft"))


def _claim(claim: TruthClaim) -> str:
    return (
        f'<div class="found"><h3>{escape(claim.effect.id)}</h3>{paragraph(f"{escape(claim.says[:1].upper() + claim.says[1:])}.")}'
        + paragraph(f"<code>{escape(claim.effect.equation)}</code>, {probability(claim.p_value)}", "soft")
        + code(f"{claim.effect.parameter.name}: {', '.join(values_of(claim))}")
        + "</div>"
    )


def _growth(e: TruthExplanation, width: int) -> str:
    closure = e.closure_rad / DEG
    # What a gyro that is never still shows of its own noise has the vibration in it.
    own = e.gyro_rad / DEG * np.sqrt(e.lengths_s) if len(e.problem.stills) else np.zeros(0)
    x, y = log_axis(e.lengths_s, "length of a segment, s"), log_axis(np.r_[closure.ravel(), own], "closure, degrees")
    chart = Chart(width, 250, x, y, "Closure against the length of a segment")
    if len(own):
        chart.line(e.lengths_s, own, "floor", "dash")
    for i, axis in enumerate("xyz"):
        chart.dots(e.lengths_s, closure[:, i], axis)
    return chart.svg()
