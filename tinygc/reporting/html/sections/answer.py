"""The answer: closure before and after, against floor and limit; pass or fail, and the rule applied."""

from __future__ import annotations

from typing import Any

from session.base.numeric import rms_of
from session.base.texts import degrees
from session.base.units import DEG
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.reported import ReportData
from tinygc.reporting.html.chart import drawing, log_axis
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.html.sections.accelerometer import misses_of, spread_text
from tinygc.verdict.acceptance import NEAR_FLOOR, agrees


def section(evidence: ReportData) -> Section:
    """Section with the result box at the top of the page."""
    from tinygc.closure.residual import closure_angles
    from tinygc.models.linear import bias_only

    adopted, fit = evidence.adopted, evidence.fit
    raw = fit.methods.get("raw")
    segments: dict[str, Any] = {
        "raw": tilt_rms(raw.angles if raw is not None else closure_angles(evidence.problem.batch, bias_only())),
        "after": tilt_rms(adopted.angles),
        "floor": adopted.floor_rms,
    }
    run = None
    if fit.runs:
        worst, after = max(enumerate(map(rms_of, adopted.run_errors)), key=lambda pair: pair[1])
        one = fit.runs[worst]
        run = {"raw": rms_of(one.errors(bias_only())), "after": after, "floor": rms_of(one.floor_rad), "seconds": one.duration_s}
    before, misses = misses_of(evidence)
    spread = None
    if evidence.problem.session.reference is None and misses.size:
        spread = {"before": before is not None and spread_text(before), "after": spread_text(misses), "stills": misses.size}
    html = render(
        "answer.html",
        e=evidence,
        kind={"pass": "good", "fail": "bad", "no limit": "floor"}.get(evidence.decision.answer, "raw"),
        **segments,
        run=run,
        closes=agrees(adopted.closure_p),
        near=adopted.times_floor <= NEAR_FLOOR,
        spread=spread,
        strip=lambda width: _strip(segments, run, evidence.limit_deg, width),
    )
    return Section("answer", "Answer", html)


def _strip(segments: dict[str, float], run: dict[str, float] | None, limit: float | None, width: int) -> str:
    """Chart closure before and after in rad on one log scale, for segments and closure run, with floor and limit (degrees)."""
    named = [("segments", segments), *([] if run is None else [("closure run", run)])]
    rows = [(name, each["raw"], each["after"], each["floor"]) for name, each in named]
    figures = [value / DEG for _, *values in rows for value in values]
    axis = log_axis([*figures, *([limit] if limit else [])], margin=1.5)
    left = 92 if width > 500 else 80
    inner, height = width - left - 22, 34 + 40 * len(rows) + 12
    at = lambda value: left + float(axis.place(value)) * inner  # noqa: E731
    parts = []
    for value, text in axis.marks(inner * 0.8):
        parts.append(f'<path class="grid" d="M{at(value):.1f} 8V{height - 26}"/>')
        parts.append(f'<text class="tick" x="{at(value):.1f}" y="{height - 8}" text-anchor="middle">{text}°</text>')
    if limit:
        parts.append(f'<path class="dash k-limit" d="M{at(limit):.1f} 8V{height - 26}"/>')
        parts.append(f'<text class="word k-limit" x="{at(limit) + 5:.1f}" y="18">limit</text>')
    for number, (name, before, after, floor) in enumerate(rows):
        y = 32 + 40 * number
        a, b, c = (at(value / DEG) for value in (before, after, floor))
        head = b + 7 if a > b else b - 7
        parts.append(f'<text class="strong" x="0" y="{y + 4}">{name}</text>')
        parts.append(f'<path class="line k-after" d="M{a:.1f} {y}H{head:.1f}" opacity=".45"/>')
        parts.append(
            f'<g class="dot k-before"><circle cx="{a:.1f}" cy="{y}" r="5"><title>{name}, raw: {degrees(before)}</title></circle></g>'
        )
        parts.append(
            f'<g class="dot k-after"><circle cx="{b:.1f}" cy="{y}" r="6.5"><title>{name}, calibrated: {degrees(after)}</title></circle></g>'
        )
        parts.append(
            f'<path class="line k-floor" d="M{c:.1f} {y - 11}V{y + 11}"><title>{name}, noise alone: {degrees(floor)}</title></path>'
        )
        if number == 0:
            parts.append(f'<text class="word k-before" x="{a:.1f}" y="{y - 12}" text-anchor="middle">raw</text>')
            parts.append(_beside(b, c, y))
    about = "; ".join(f"{name}: raw {degrees(b)}, calibrated {degrees(a)}, noise alone {degrees(f)}" for name, b, a, f in rows)
    return drawing(width, height, about, "".join(parts))


def _beside(calibrated: float, floor: float, y: float) -> str:
    """Place the names of two marks that may coincide, one on each side."""
    left, right = (("noise floor", floor, "floor"), ("calibrated", calibrated, "after"))
    if calibrated < floor:
        left, right = right, left
    parts = []
    for (text, x, kind), anchor, away in ((left, "end", 9), (right, "start", -9)):
        parts.append(
            f'<text class="word k-{kind}" x="{x - away if anchor == "end" else x + 11:.1f}" y="{y - 12}" '
            f'text-anchor="{anchor}">{text}</text>'
        )
    return "".join(parts)
