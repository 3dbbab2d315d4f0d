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
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.pictures.in_turns import closure_panel
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
        by_segment=closure_panel(
            [
                ("raw", "before", False, numbers, raw),
                (f"calibrated ({adopted.title}), held out", "after", False, adopted.numbers, adopted.angles),
            ],
            adopted.floor_rms / DEG,
            limit_deg=evidence.limit_deg,
        ),
        target=_target(evidence, own),
        inside=[(np.mean(ratio <= k), expected) for k, expected in RINGS],
        worst=adopted.numbers[worst],
        furthest=ratio[worst],
        closes=agrees(adopted.closure_p),
        near=adopted.times_floor <= NEAR_FLOOR,
    )
    return Section("closure", "Closure per segment", html)


def _target(evidence: ReportData, sigma: np.ndarray) -> Panel:
    adopted, one = evidence.adopted, rms_of(sigma) / DEG
    about = "Error of tilt of each segment about the two horizontal axes, with rings of noise"
    panel = Panel(Axis("tilt about x (°)"), Axis("tilt about y (°)"), about=about, height=270, widest=340, is_equal=True)
    tilt, turn = adopted.angles[:, :2] / DEG, np.linspace(0, 2 * np.pi, 73)
    reach = max(3.4 * one, float(np.abs(tilt).max()))
    for k, _ in RINGS:
        if k * one < reach:
            panel.line(k * one * np.cos(turn), k * one * np.sin(turn), "floor", "dash", name=f"1σ = {degrees(one * DEG)}, 2σ, 3σ")
    labels = [f"segment {number}: {significant(np.hypot(*each))}°" for number, each in zip(adopted.numbers, tilt, strict=True)]
    return panel.points(tilt[:, 0], tilt[:, 1], "after", labels=labels)
