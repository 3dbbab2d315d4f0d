"""Closure of every segment, before and after, against the floor; and the same errors in a target plot."""

from __future__ import annotations

import numpy as np

from session.base.numeric import rms_of
from session.base.texts import degrees, significant
from session.base.units import DEG
from tinygc.closure.residual import closure_angles
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.reported import ReportData
from tinygc.models.linear import bias_only
from tinygc.reporting.html.chart import Axis, Chart, drawing, log_axis
from tinygc.reporting.html.markup import Section, render
from tinygc.verdict.acceptance import NEAR_FLOOR, agrees

#: share of errors in two directions that lie within one, two, three sigmas
RINGS = ((1, "39 %"), (2, "86 %"), (3, "99 %"))


def section(evidence: ReportData) -> Section:
    """Section of both pictures."""
    adopted, problem = evidence.adopted, evidence.problem
    raw = closure_angles(problem.batch, bias_only())
    sigma = np.sqrt(np.trace(problem.floor.own[:, :2, :2], axis1=1, axis2=2) / 2)
    numbers = [segment.number for segment in problem.used]
    by_number = dict(zip(numbers, sigma, strict=True))
    own = np.array([by_number.get(number, sigma.mean()) for number in adopted.numbers])
    ratio = np.linalg.norm(adopted.angles[:, :2], axis=1) / own
    worst = int(np.argmax(ratio))
    html = render(
        "closure.html",
        e=evidence,
        raw=tilt_rms(raw),
        after=tilt_rms(adopted.angles),
        by_segment=lambda width: _by_segment(evidence, raw, numbers, width),
        keys=[
            ("before", "raw"),
            ("after", f"calibrated ({adopted.title}), held out"),
            ("floor", "noise floor", "dash"),
            *([("limit", "limit", "dash")] if evidence.limit_deg else []),
        ],
        target=lambda width: _target(evidence, own, width),
        inside=[(np.mean(ratio <= k), expected) for k, expected in RINGS],
        worst=adopted.numbers[worst],
        furthest=ratio[worst],
        closes=agrees(adopted.closure_p),
        near=adopted.times_floor <= NEAR_FLOOR,
    )
    return Section("closure", "Closure per segment", html)


def _by_segment(evidence: ReportData, raw: np.ndarray, numbers: list[int], width: int) -> str:
    adopted, floor = evidence.adopted, evidence.adopted.floor_rms / DEG
    before, after = (np.linalg.norm(angles[:, :2], axis=1) / DEG for angles in (raw, adopted.angles))
    y = log_axis(
        [*before, *after, floor, *([evidence.limit_deg] if evidence.limit_deg else [])],
        "tilt at the end of the segment, degrees",
        margin=1.3,
    )
    last = max([*numbers, *adopted.numbers])
    chart = Chart(width, 280, Axis(-0.8, last + 0.8, "segment"), y, "Closure of each segment before and after calibration")
    chart.across(floor, "floor")
    if evidence.limit_deg:
        chart.across(evidence.limit_deg, "limit", "limit")
    radius = 3.4 if len(numbers) < 150 else 1.8
    chart.dots(
        numbers,
        before,
        "before",
        [f"segment {n}, raw: {significant(v)}°" for n, v in zip(numbers, before, strict=True)],
        radius=radius - 0.4,
    )
    words = [f"segment {n}, calibrated: {significant(v)}°" for n, v in zip(adopted.numbers, after, strict=True)]
    return chart.dots(adopted.numbers, after, "after", words, radius=radius).svg()


def _target(evidence: ReportData, sigma: np.ndarray, width: int) -> str:
    adopted = evidence.adopted
    side = min(width, 340)
    one = rms_of(sigma)
    reach = max(3.4 * one, 1.08 * float(np.abs(adopted.angles[:, :2]).max()))
    centre, scale = side / 2, (side / 2 - 16) / reach
    parts = [f'<path class="grid" d="M12 {centre}H{side - 12}M{centre} 12V{side - 12}"/>']
    for k, _ in RINGS:
        if k * one < reach:
            parts.append(f'<circle class="dash k-floor" cx="{centre}" cy="{centre}" r="{k * one * scale:.1f}"/>')
            if k * one * scale > 22:
                parts.append(f'<text x="{centre + 4}" y="{centre - k * one * scale - 4:.1f}">{k}σ</text>')
    dots = []
    for number, (x, y) in zip(adopted.numbers, adopted.angles[:, :2], strict=True):
        title = f"segment {number}: {significant(np.hypot(x, y) / DEG)}°"
        dots.append(f'<circle cx="{centre + x * scale:.1f}" cy="{centre - y * scale:.1f}" r="3.6"><title>{title}</title></circle>')
    parts.append(f'<g class="dot k-after">{"".join(dots)}</g>')
    parts.append(
        f'<text x="{side - 4}" y="{centre - 6}" text-anchor="end">about x</text><text x="{centre + 6}" y="{side - 4}">about y</text>'
    )
    parts.append(f'<text x="4" y="{side - 4}">1σ = {degrees(one)}</text>')
    return drawing(side, side, "Error of tilt of each segment about the two horizontal axes, with rings of noise", "".join(parts))
