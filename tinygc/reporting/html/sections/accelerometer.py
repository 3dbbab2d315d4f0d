"""The accelerometer that the references rest on: nine numbers, how well they are known, and gravity's length before and after."""

from __future__ import annotations

from math import nan

import numpy as np

from session.detect.accelerometer import attitudes_of
from session.io.units import MG
from tinygc.closure.joint import REFUTED_P
from tinygc.estimation.accelerometer import UNITS, AccelerometerFit
from tinygc.models.linear import COVERAGE_FACTOR, Quantity
from tinygc.reporting.html.chart import Axis, Chart, log_axis
from tinygc.reporting.html.evidence import Evidence
from tinygc.reporting.html.markup import Section, decimals_for, escape, facts, figure, fixed, key, paragraph, probability, table
from tinygc.reporting.html.measures import misses_of, spread_text

#: word -> what it means, in one line
MEANINGS = {
    "scale factor error": "the axis reads so much too far",
    "nonorthogonality": "90° less the angle between two input axes",
    "bias": "what it reads without any force",
}
#: mg: a length that misses by less lies on the chart's lower edge
LEAST_MG = 1e-3


def section(evidence: Evidence) -> Section | None:
    """None beside a truth file: nothing rests on it there."""
    if evidence.problem.session.truths is not None:
        return None
    found = evidence.fit.accelerometer
    html = paragraph(f"{_origin(found)} The attitude of every still comes from it, so its errors would become the gyroscope’s.")
    misses = misses_of(evidence)
    html += _facts(evidence, found, misses)
    if evidence.adopted.accelerometer.source != found.calibration.source:
        html += paragraph("The calibration with physics, which this report states, rests on what session.toml gives, as it is.")
    if found.unobserved:
        html += (
            '<div class="warning">'
            + paragraph(
                f"<strong>Not observed here:</strong> {escape(', '.join(found.unobserved))}. They stay as they were, and their errors are "
                "in the gyroscope’s misalignments, where closure does not show them. Rest the sensor on more sides, on edges and corners."
            )
            + "</div>"
        )
    if found.calibration.source != "none":
        html += _table(found)
    if misses[1].size:
        html += figure(
            lambda width: _chart(*misses, width),
            f"By how much each still’s length misses gravity’s, on a log scale{'' if misses[0] is None else ', before and after'}.",
            ([] if misses[0] is None else [key("before", _before(found), "ring")]) + [key("after", "calibrated")],
        )
    return Section("accelerometer", "Accelerometer", html)


def _origin(found: AccelerometerFit) -> str:
    if found.calibration.source == "none":
        return "Nobody has calibrated the accelerometer, and these stills do not suffice for it: it is taken as measured."
    if found.mode == "given":
        return "The accelerometer’s calibration was taken as session.toml gives it."
    if found.mode == "fit":
        return "The accelerometer’s nine numbers come from this session’s own stills and turns, estimated together with the gyroscope’s."
    if found.p_value is not None and found.p_value < REFUTED_P:
        return (
            f"The accelerometer’s calibration in session.toml <strong>no longer holds</strong> ({probability(found.p_value)}); it was "
            "kept as a prior all the same, as asked."
        )
    chance = "" if found.p_value is None else f" ({probability(found.p_value)})"
    return f"The accelerometer’s calibration in session.toml <strong>holds</strong>{chance}; this session’s stills and turns sharpen it."


def _facts(evidence: Evidence, found: AccelerometerFit, misses: tuple[np.ndarray | None, np.ndarray]) -> str:
    force = np.array([still.accel_mean for still in evidence.problem.stills if still.problem is None]).reshape(-1, 3)
    before, after = misses
    pairs = [("Stills", f"{len(force)} in {attitudes_of(force)} attitudes"), ("Numbers", {"given": "given"}.get(found.mode, "estimated"))]
    if after.size:
        pairs += [] if before is None else [(f"Gravity’s spread, {_before(found)}", spread_text(before))]
        pairs.append(("Gravity’s spread, calibrated", spread_text(after)))
    return facts((escape(name), escape(value)) for name, value in pairs)


def _before(found: AccelerometerFit) -> str:
    return "as measured" if found.mode == "fit" else "as given"


def quantities(found: AccelerometerFit) -> list[Quantity]:
    """The nine numbers in the field's words, each with its expanded uncertainty (NaN where it was taken as given)."""
    made = []
    for name, unit, values, sigmas, names in found.errors():
        spread = np.full(3, nan) if sigmas is None else COVERAGE_FACTOR * sigmas
        word = f"accelerometer {name}"
        for value, expanded, each in zip(values, spread, names, strict=True):
            made.append(Quantity(word, each.split()[-1], unit, float(value), float(expanded), each not in found.unobserved))
    return made


def _table(found: AccelerometerFit) -> str:
    rows = []
    numbers = quantities(found)
    for at, (word, meaning) in zip(range(0, 9, 3), MEANINGS.items(), strict=True):
        group = numbers[at : at + 3]
        unit = group[0].unit
        known = [q.expanded for q in group if q.observed and np.isfinite(q.expanded)]
        decimals = decimals_for(max(known)) if known else {"ppm": 0, "mrad": 3, "mg": 2}[unit]
        heading = f'{word}, <span class="unit">{unit}</span><br><small>{meaning}</small>'
        rows.append((heading, *(_cell(q, decimals) for q in group)))
    caption = "What the sensor does, in its own triad"
    caption += ", as given." if found.sigmas is None else "; each value ± its expanded uncertainty, <i>k</i> = 2 (about 95 %)."
    return table(("Parameter", "x", "y", "z"), rows, caption, kind="parameters")


def _cell(quantity: Quantity, decimals: int) -> str:
    of = f'<span class="of">{escape(quantity.component)}</span>' if len(quantity.component) > 1 else ""
    if not quantity.observed:
        return f'{of}<span class="absent">not observed</span>'
    spread = f" <small>± {fixed(quantity.expanded, decimals)}</small>" if np.isfinite(quantity.expanded) else ""
    return f"{of}{fixed(quantity.value, decimals)}{spread}"


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
