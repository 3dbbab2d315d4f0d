"""The answer: closure before and after, against floor and limit; passed or not, and by which rule."""

from __future__ import annotations

import numpy as np

from session.io.units import DEG
from tinygc.reporting.html.chart import drawing, log_axis
from tinygc.reporting.html.evidence import NEAR_FLOOR, Evidence, agrees, rmse
from tinygc.reporting.html.markup import Section, degrees, escape, figure, probability, significant, tilt_rms
from tinygc.reporting.html.measures import card

TICK = (
    '<svg viewBox="0 0 16 16" aria-hidden="true"><path d="M2.5 8.5l3.6 3.6L13.5 4" fill="none" stroke="currentColor" '
    'stroke-width="2.4"/></svg>'
)
CROSS = (
    '<svg viewBox="0 0 16 16" aria-hidden="true"><path d="M3.5 3.5l9 9m0-9l-9 9" fill="none" stroke="currentColor" '
    'stroke-width="2.4"/></svg>'
)
QUERY = (
    '<svg viewBox="0 0 16 16" aria-hidden="true"><path d="M4.8 5.6a3.2 3.2 0 1 1 4.6 2.8c-1 .5-1.4 1-1.4 2.1m0 2v1.6" fill="none" '
    'stroke="currentColor" stroke-width="2"/></svg>'
)


def section(evidence: Evidence) -> Section:
    """The box at the top."""
    decision = evidence.decision
    kind, sign = {"pass": ("good", TICK), "fail": ("bad", CROSS)}.get(decision.answer, ("raw", QUERY))
    reasons = "".join(
        f'<li><b class="k-{"good" if met else "bad"}" style="color:var(--c)" '
        f'aria-label="{"met" if met else "not met"}">{"✓" if met else "✗"}</b>'
        f"<span>{escape(text)}</span></li>"
        for met, text in decision.reasons
    ) + "".join(
        f'<li><b class="k-raw" style="color:var(--c)" aria-label="in doubt">?</b><span>{escape(text)}</span></li>'
        for text in decision.doubts
    )
    heads = _heads(evidence)
    html = (
        f'<div class="answer" id="answer"><div class="verdict"><span class="stamp k-{kind}" style="color:var(--c)">'
        f"{sign}{decision.word}</span>"
        f'<p>{escape(decision.rule)}</p></div><dl class="heads{" four" * (len(heads) == 4)}">{"".join(heads)}</dl>'
        f"{figure(lambda width: _strip(evidence, width))}"
        f'<ul class="reasons">{reasons}</ul></div>'
    )
    return Section("answer", "Answer", html)


def _heads(evidence: Evidence) -> list[str]:
    """The figures that count, each with one line of what it is."""
    before, after, floor = _segments(evidence)
    heads = [
        _head(
            "Closure of a segment",
            f"<small>{degrees(before)} →</small> {degrees(after)}",
            f"rms of tilt, segments the fit had not seen; noise alone leaves {degrees(floor)}",
        )
    ]
    if run := _worst_run(evidence):
        number, raw, error, run_floor = run
        one = evidence.fit.runs[number]
        which = f"the worst of {len(evidence.fit.runs)} runs" if len(evidence.fit.runs) > 1 else f"a run of {one.duration_s:.0f} s"
        heads.append(
            _head(
                "Attitude after a closure run",
                f"<small>{degrees(raw)} →</small> {degrees(error)}",
                f"RMSE of roll, pitch, yaw, {which}, never fitted; noise alone {degrees(run_floor)}",
            )
        )
    heads.append(_head("Above the noise floor", f"{significant(after / floor, 3)} <small>×</small>", _why(evidence)))
    if (spread := card(evidence)) is not None:
        heads.append(_head(*spread))
    return heads


def _head(name: str, figure_html: str, words: str) -> str:
    return f"<div><dt>{name}</dt><dd>{figure_html}</dd><dd>{words}</dd></div>"


def _why(evidence: Evidence) -> str:
    adopted = evidence.adopted
    with_physics = f"with {', '.join(escape(claim.effect.id) for claim in adopted.claims)} in the model; " if adopted.claims else ""
    if agrees(adopted.closure_p):
        freedom = "" if adopted.closure_freedom is None else f" with {adopted.closure_freedom} degrees of freedom"
        fitted = f"noise explains what the fitted segments leave ({probability(adopted.closure_p)}{freedom})"
        if adopted.times_floor <= NEAR_FLOOR:
            return f"{with_physics}{fitted}; held out, with {adopted.in_numbers}, they cost a little more"
        return f"{with_physics}{fitted}, but not this: {adopted.in_numbers} do not tell what the next one will leave"
    if evidence.verdict is None:
        return f"{with_physics}something is missing from the model; explain has not been asked"
    return f"{with_physics}something is left that the model does not have"


def _segments(evidence: Evidence) -> tuple[float, float, float]:
    """rad: raw, adopted held out, floor."""
    return _raw_tilt(evidence), tilt_rms(evidence.adopted.angles), evidence.adopted.floor_rms


def _raw_tilt(evidence: Evidence) -> float:
    from tinygc.closure.residual import closure_angles
    from tinygc.models.linear import bias_only

    raw = evidence.fit.methods.get("raw")
    return tilt_rms(raw.angles if raw is not None else closure_angles(evidence.problem.batch, bias_only()))


def _worst_run(evidence: Evidence) -> tuple[int, float, float, float] | None:
    """Number, and RMSE in rad raw, adopted, of noise alone, of the closure run that the calibration does worst."""
    from tinygc.models.linear import bias_only

    if not evidence.fit.runs:
        return None
    errors = [rmse(error) for error in evidence.adopted.run_errors]
    worst = int(np.argmax(errors))
    run = evidence.fit.runs[worst]
    return worst, rmse(run.errors(bias_only())), errors[worst], rmse(run.floor_rad)


def _strip(evidence: Evidence, width: int) -> str:
    """Before and after on one log scale, for segments and for the closure run, with floor and limit."""
    rows = [("segments", *_segments(evidence))]
    if run := _worst_run(evidence):
        rows.append(("closure run", *run[1:]))
    figures = [value / DEG for _, *values in rows for value in values]
    limit = evidence.limit_deg
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
    """Names of the two marks that may lie on each other: one to each side."""
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
