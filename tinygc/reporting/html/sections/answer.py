"""The answer: closure before and after, against floor and limit; pass or fail, and the rule applied."""

from __future__ import annotations

from typing import Any

from session.base.numeric import rms_of
from session.base.texts import degrees
from session.base.units import DEG
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.reported import ReportData
from tinygc.reporting.drawing import Axis, Panel
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
        kind={"pass": "good", "no limit": "good", "fail": "bad"}.get(evidence.decision.answer, "raw"),
        **segments,
        run=run,
        closes=agrees(adopted.closure_p),
        near=adopted.times_floor <= NEAR_FLOOR,
        spread=spread,
        strip=_strip(segments, run, evidence.limit_deg),
    )
    return Section("answer", "Answer", html)


def _strip(segments: dict[str, float], run: dict[str, float] | None, limit: float | None) -> Panel:
    """Closure before and after in rad on one log scale, for segments and closure run, with floor and limit (degrees)."""
    rows = {"segments": segments, **({} if run is None else {"closure run": run})}
    names = Axis(lo=-0.6, hi=len(rows) - 0.4, ticks=[(float(n), name) for n, name in enumerate(rows)], down=True)
    about = [
        f"{name}: raw {degrees(row['raw'])}, calibrated {degrees(row['after'])}, noise alone {degrees(row['floor'])}"
        for name, row in rows.items()
    ]
    panel = Panel(Axis("closure (°)", log=True), names, about="; ".join(about), height=20 + 36 * len(rows))
    if limit:
        panel.upright(limit, "limit", name="limit")
    for n, (name, row) in enumerate(rows.items()):
        raw, after, floor = (row[key] / DEG for key in ("raw", "after", "floor"))
        panel.line([raw, after], n, "after", opacity=0.45)
        panel.points(raw, n, "before", radius=5, name="raw", labels=[f"{name}, raw: {degrees(row['raw'])}"])
        panel.points(after, n, "after", radius=6.5, name="calibrated", labels=[f"{name}, calibrated: {degrees(row['after'])}"])
        panel.line(floor, [n - 0.3, n + 0.3], "floor", name="noise floor", labels=[f"{name}, noise alone: {degrees(row['floor'])}"])
    return panel
