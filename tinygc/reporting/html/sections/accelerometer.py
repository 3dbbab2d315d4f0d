"""The accelerometer behind the references: nine parameters with uncertainties, and gravity's length before and after."""

from __future__ import annotations

from math import nan

import numpy as np

from session.base.texts import significant
from session.base.units import MG
from session.detect.accelerometer import NAMES, attitudes_of
from tinygc.closure.joint import REFUTED_P
from tinygc.estimation.accelerometer import UNITS, AccelerometerFit
from tinygc.explanation.reported import ReportData, with_freedom
from tinygc.models.linear import COVERAGE_FACTOR, Quantity
from tinygc.reporting.html.chart import Axis, Chart, log_axis
from tinygc.reporting.html.markup import Section, decimals_for, render

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
    groups, nine = [], quantities(found)
    for at, (word, meaning) in zip(range(0, 9, 3), MEANINGS.items(), strict=True):
        group = nine[at : at + 3]
        known = [q.expanded for q in group if q.observed and np.isfinite(q.expanded)]
        decimals = decimals_for(max(known)) if known else {"ppm": 0, "mrad": 3, "mg": 2}[group[0].unit]
        groups.append((word, meaning, group, decimals))
    html = render(
        "accelerometer.html",
        found=found,
        refuted_p=REFUTED_P,
        numbers=numbers,
        rests_on=evidence.adopted.accelerometer.source,
        groups=groups,
        factors=[f"{q.factor:.2f}" for q in sorted(nine, key=lambda q: q.factor)],
        before=earlier,
        has_before=before is not None,
        chart=(lambda width: _chart(before, after, width)) if after.size else None,
    )
    return Section("accelerometer", "Accelerometer", html)


def quantities(found: AccelerometerFit) -> list[Quantity]:
    """The nine parameters in the field's terms, each with its expanded uncertainty (NaN if taken as given)."""
    made, freedoms = [], dict(zip(NAMES, found.freedoms, strict=True))
    for name, unit, values, sigmas, names in found.errors():
        spread = np.full(3, nan) if sigmas is None else COVERAGE_FACTOR * sigmas
        word = f"accelerometer {name}"
        for value, expanded, each in zip(values, spread, names, strict=True):
            quantity = Quantity(word, each.split()[-1], unit, float(value), float(expanded), each not in found.unobserved)
            made.append(with_freedom(quantity, freedoms[each]))
    return made


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
