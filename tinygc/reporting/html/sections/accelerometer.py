"""The accelerometer behind the references: nine parameters with uncertainties, and gravity's length before and after."""

from __future__ import annotations

import numpy as np

from session.base.texts import significant
from session.base.units import MG
from session.detect.accelerometer import attitudes_of
from tinygc.closure.joint import REFUTED_P
from tinygc.estimation.accelerometer import UNITS
from tinygc.explanation.reported import ReportData
from tinygc.reporting.facts import errors_table
from tinygc.reporting.html.chart import Axis, Chart, log_axis
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
    force = np.array([still.accel_mean for still in evidence.problem.stills if still.problem is None]).reshape(-1, 3)
    numbers = [("Stills", f"{len(force)} in {attitudes_of(force)} attitudes"), ("Numbers", {"given": "given"}.get(found.mode, "estimated"))]
    if after.size:
        numbers += [] if before is None else [(f"Gravity’s spread, {earlier}", spread_text(before))]
        numbers.append(("Gravity’s spread, calibrated", spread_text(after)))
    nine = found.facts
    html = render(
        "accelerometer.html",
        found=found,
        refuted_p=REFUTED_P,
        numbers=numbers,
        rests_on=evidence.adopted.accelerometer.source,
        table=errors_table("", nine, meanings=MEANINGS),
        factors=[f"{q.factor:.2f}" for q in sorted(nine, key=lambda q: q.factor)],
        before=earlier,
        has_before=before is not None,
        chart=(lambda width: _chart(before, after, width)) if after.size else None,
    )
    return Section("accelerometer", "Accelerometer", html)


def _chart(before: np.ndarray | None, after: np.ndarray, width: int) -> str:
    sizes = [np.maximum(np.abs(each) / UNITS["mg"], LEAST_MG) for each in (before, after) if each is not None]
    y = log_axis(np.concatenate(sizes), "miss of gravity’s length, mg", margin=1.3)
    chart = Chart(width, 230, Axis(-0.5, len(after) - 0.5, "still"), y, "By how much each still's length misses gravity's")
    number = np.arange(len(after))
    for each, kind in ((before, "before"), (after, "after")):
        if each is not None:
            titles = [f"still {n}: {miss / MG:+.3f} mg" for n, miss in zip(number, each, strict=True)]
            chart.dots(number, np.maximum(np.abs(each) / MG, LEAST_MG), kind, titles, ring=kind == "before")
    return chart.svg()


def spread_text(misses: np.ndarray) -> str:
    """Standard deviation of the residuals, as text in mg."""
    return f"{significant(float(np.std(misses)) / MG, 2)} mg"


def misses_of(evidence: ReportData) -> tuple[np.ndarray | None, np.ndarray]:
    """Residuals of gravity's length in the reference stills, m/s^2, before (None if there is no other calibration) and after."""
    found = evidence.fit.accelerometer
    if found.misses_mps2 is not None:
        return found.misses_mps2
    gravity = evidence.problem.session.config.site.expected_gravity_mps2
    return None, np.array([np.linalg.norm(s.accel_mean) - gravity for s in evidence.problem.stills if s.problem is None])
