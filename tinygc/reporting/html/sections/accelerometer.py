"""The accelerometer behind the references: nine parameters, each ± one sigma, and gravity's length before and after."""

from __future__ import annotations

import numpy as np

from session.base.texts import significant
from session.base.units import MG
from session.detect.accelerometer import attitudes_of, force_of
from tinygc.closure.joint import REFUTED_P
from tinygc.explanation.reported import ReportData
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.facts import errors_table
from tinygc.reporting.html.markup import Section, render

#: term -> its meaning in one line
MEANINGS = {
    "scale factor error": "the axis reads so much too far",
    "nonorthogonality": "90° less the angle between two input axes",
    "bias": "what it reads without any force",
}
#: mg; smaller residuals of gravity's length are drawn at the chart's lower edge
LEAST_MG = 1e-3


def section(evidence: ReportData) -> Section | None:
    """Section on the accelerometer; None with a further reference, where no reference depends on it."""
    if evidence.problem.session.reference is not None:
        return None
    found = evidence.fit.accelerometer
    before, after = misses_of(evidence)
    earlier = "as measured" if found.mode == "fit" else "as given"
    force = force_of([still for _, still in evidence.problem.references])
    html = render(
        "accelerometer.html",
        found=found,
        refuted_p=REFUTED_P,
        stills=f"{len(force)} in {attitudes_of(force)} attitudes",
        earlier=earlier,
        before=None if before is None else spread_text(before),
        after=spread_text(after) if after.size else None,
        rests_on=evidence.adopted.accelerometer.source,
        table=errors_table("", found.facts, meanings=MEANINGS),
        chart=_chart(before, earlier, after) if after.size else None,
    )
    return Section("accelerometer", "Accelerometer", html)


def _chart(before: np.ndarray | None, earlier: str, after: np.ndarray) -> Panel:
    about = "By how much each still's length misses gravity's"
    panel = Panel(Axis("still"), Axis("miss of gravity’s length (mg)", log=True), about=about)
    for name, misses in ((earlier, before), ("calibrated", after)):
        if misses is not None:
            labels = [f"still {n}: {miss / MG:+.3f} mg" for n, miss in enumerate(misses)]
            sizes, is_before = np.maximum(np.abs(misses) / MG, LEAST_MG), misses is before
            panel.points(np.arange(len(misses)), sizes, "before" if is_before else "after", ring=is_before, name=name, labels=labels)
    return panel


def spread_text(misses: np.ndarray) -> str:
    """Standard deviation of the residuals, as text in mg."""
    return f"{significant(float(np.std(misses)) / MG, 2)} mg"


def misses_of(evidence: ReportData) -> tuple[np.ndarray | None, np.ndarray]:
    """Residuals of gravity's length in the reference stills, m/s^2, before (None if there is no other calibration) and after."""
    found = evidence.fit.accelerometer
    if found.misses_mps2 is not None:
        return found.misses_mps2
    gravity = evidence.problem.session.config.site.expected_gravity_mps2
    return None, np.array([np.linalg.norm(still.accel_mean) - gravity for _, still in evidence.problem.references])
