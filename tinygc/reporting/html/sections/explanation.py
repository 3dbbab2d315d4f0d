"""What ``explain`` found: why recording and simulation differ, with its pictures."""

from __future__ import annotations

import numpy as np

from session.io.units import DEG
from tinygc.effects.effect import ENERGY_LAW, LAG_LAW, SCALE_LAW, TURNS
from tinygc.explanation.claims import VERDICTS, Claim
from tinygc.explanation.engine import Explanation
from tinygc.explanation.result import (
    HEADING,
    chance_words,
    considered_lines,
    equivalent_words,
    is_refitted,
    noise_rows,
    residual_table,
    rival_words,
    what_next,
    where,
)
from tinygc.reporting.explanation_text import parameter_lines, seconds_words, variable_words
from tinygc.reporting.html.chart import Axis, Chart, linear_axis, log_axis
from tinygc.reporting.html.evidence import Evidence
from tinygc.reporting.html.markup import (
    Section,
    code,
    degrees,
    escape,
    figure,
    fixed,
    key,
    paragraph,
    probability,
    significant,
    table,
    tilt_rms,
)
from tinygc.reporting.pictures.values import (
    AxisLaws,
    added_in_stills,
    axis_laws,
    per_parameter,
    rates_per_still,
    recorded_in_stills,
    strongest,
    told,
    variable_for,
)

#: pictures of what turns show
OF_TURNS = (TURNS, SCALE_LAW, LAG_LAW, ENERGY_LAW)
AXIS_KEYS = [key(axis, axis) for axis in "xyz"]


def section(evidence: Evidence) -> Section | None:
    """None where explain was not asked."""
    e = evidence.explanation
    if e is None:
        return None
    words, _ = VERDICTS[e.verdict]
    html = paragraph(f"<strong>{escape(words[:1].upper() + words[1:])}</strong> ({probability(e.p_value)}).")
    for claim in e.claimed:
        html += _claim(claim)
    for claim in e.findings:
        html += _claim(claim, "A finding without a name in the catalogue. ")
    html += _place(e)
    html += _channels(e)
    html += _pictures(e)
    html += _considered(e)
    html += _noise(e)
    html += _tested(e)
    if following := what_next(e):
        html += paragraph(f"<strong>Next:</strong> {escape(following)}.")
    return Section("explain", "Why recording and simulation differ", html)


def _claim(claim: Claim, before: str = "") -> str:
    says = escape(claim.says[:1].upper() + claim.says[1:])
    html = f'<div class="found"><h3>{escape(claim.effect.id)}</h3>{paragraph(f"{before}{says}.")}'
    chance = escape(f"probability {chance_words(claim.probability)}")
    html += paragraph(f"<code>{escape(claim.effect.equation)}</code>, {chance}, {probability(claim.p_value)}", "soft")
    if claim.parameters:
        html += code("\n".join(parameter_lines(claim)))
    if claim.equivalent:
        names = ", ".join(equivalent_words(claim))
        html += paragraph(f"This recording cannot tell it from {escape(names)}: {escape(claim.effect.splits)}.")
    if rivals := rival_words(claim):
        html += paragraph(f"Weighed in its place, with their probabilities: {escape(', '.join(rivals))}.")
    return html + "</div>"


def _place(e: Explanation) -> str:
    place = where(e)
    if not place["phases"]:
        return paragraph(
            "The simulation replays this recording’s own movement through the linear model, the Earth and the noise, and nothing "
            "is left to explain."
        )
    words = [f"It lives in: {', '.join(place['phases'])}"]
    if place["axes"]:
        words.append(f"on {', '.join(place['axes'])}")
    words += [text for text in (variable_words(place["regime"]), seconds_words(place["seconds"])) if text]
    if place["segments"]:
        words.append(f"worst in segments {', '.join(map(str, place['segments'][:6]))}")
    return paragraph(escape("; ".join(words)) + ".")


def _channels(e: Explanation) -> str:
    """The same numbers as on the page of ``explain``."""
    refitted = is_refitted(e)
    header = ("channel", "values", *(("linear model", "with what is named") if refitted else ("rms",)))
    rows = []
    for row in residual_table(e):
        shown = [fixed(row.before, 2)] + ([] if row.after is None else [fixed(row.after, 2)])
        rows.append((escape(row.channel), str(row.values), *shown, *[""] * (len(header) - 2 - len(shown))))
    return paragraph(f"{escape(HEADING)}:") + table(header, rows)


def _pictures(e: Explanation) -> str:
    claim = told(e)
    html = ""
    turning = claim is not None and claim.effect.pair in OF_TURNS
    if claim is not None and turning:
        laws = axis_laws(e, claim)
        says = f"what {escape(claim.effect.id)} makes it miss" if laws is None else f"its {laws.follows}"
        asked = "what each turn misses, parameter by parameter, against" if laws is None else f"the {laws.words} of each turn against"
        html += figure(
            lambda width: _law(e, claim, laws, width),
            f"Where it lives: {asked} {says}, all else of the fit taken off. The line is the law.",
            AXIS_KEYS if laws is not None or claim.effect.parameter.size == 3 else [],
        )
    else:
        html += figure(
            lambda width: _stills_along(e, claim, width),
            "Where it lives: the mean rate in each still, less what the model predicts. Filled: linear model. Ring: with what is named."
            if is_refitted(e)
            else "The mean rate in each still, less what the model predicts.",
            AXIS_KEYS,
        )
    if claim is not None and not turning and "still" in claim.effect.seen_in:
        html += figure(
            lambda width: _said_against_recorded(e, claim, width),
            f"Recorded in each still against what {escape(claim.effect.id)} says.",
            AXIS_KEYS,
        )
    if e.proof.changed:
        before, after = (degrees(tilt_rms(x)) for x in (e.proof.before, e.proof.after))
        gone = f" {100 * e.proof.removed:.1f} % of the excess over the floor is gone." if e.proof.removed is not None else ""
        html += figure(
            lambda width: _proof(e, width),
            f"Proof: closure of segments that the fit never saw, {before} before, {after} after, floor {degrees(e.proof.floor_rms)}.{gone}",
            _before_after_keys(True),
        )
    return html


def _before_after_keys(named: bool) -> list[str]:
    after = [key("after", "with what is named")] if named else []
    return [key("before", "linear model"), *after, key("floor", "noise floor", "dash")]


def _stills_along(e: Explanation, claim: Claim | None, width: int) -> str:
    variable = variable_for(e, claim)
    x = variable.of_stills(e.twin)
    before, after = rates_per_still(e)
    before, after = 1e3 * before, 1e3 * after
    chart = Chart(
        width,
        270,
        linear_axis(x, f"{variable.words}, {variable.units}"),
        linear_axis(np.concatenate([before, after]), "mdps", zero=True),
        f"Rate in each still along {variable.words}",
    )
    chart.across(0, "floor", style="axis")
    for i, axis in enumerate("xyz"):
        chart.dots(x, before[:, i], axis)
        if is_refitted(e):
            chart.dots(x, after[:, i], axis, ring=True)
    return chart.svg()


def _law(e: Explanation, claim: Claim, laws: AxisLaws | None, width: int) -> str:
    """Each turn's share and the curve; or what each turn misses, on a line of slope one where the effect is the cause."""
    if laws is None:
        own = claim.effect.parameter.size == 3
        parts = [("xyz"[entry if own else number], per_parameter(e, claim, entry)) for number, entry in enumerate(strongest(e, claim))]
        span = linear_axis(np.concatenate([of.law for _, of in parts] + [of.before for _, of in parts]) / DEG)
        x, y = (Axis(span.lo, span.hi, label) for label in (f"{claim.effect.id} says, degrees", "missed in the turn, degrees"))
        chart = Chart(width, 300, x, y, f"What each turn misses against what {claim.effect.id} says")
        chart.line([span.lo, span.hi], [span.lo, span.hi], "floor", "dash")
        for colour, of in parts:
            chart.dots(of.law / DEG, of.before / DEG, colour)
        return chart.svg()
    x, y = linear_axis(laws.reached, laws.x_label), linear_axis(laws.asked, f"{laws.words}, {laws.unit}", zero=True)
    chart = Chart(width, 270, x, y, f"The {laws.words} of each turn along its {laws.follows}")
    chart.across(0, "floor", style="axis")
    for axis, of, (at, values) in zip("xyz", laws.turns, laws.curves, strict=True):
        chart.line(at, values, axis)
        chart.bars(of.x, of.before - of.sigma, of.before + of.sigma, axis)
        chart.dots(of.x, of.before, axis)
    return chart.svg()


def _said_against_recorded(e: Explanation, claim: Claim, width: int) -> str:
    said, recorded = added_in_stills(e, claim) * 1e3, recorded_in_stills(e, claim) * 1e3
    span = linear_axis(np.concatenate([said, recorded]))
    x, y = (Axis(span.lo, span.hi, label) for label in (f"{claim.effect.id} says, mdps", "recorded, mdps"))
    chart = Chart(width, 300, x, y, "Recorded against explained")
    chart.line([span.lo, span.hi], [span.lo, span.hi], "floor", "dash")
    for i, axis in enumerate("xyz"):
        chart.dots(said[:, i], recorded[:, i], axis)
    return chart.svg()


def _proof(e: Explanation, width: int) -> str:
    before, after = (np.linalg.norm(angles[:, :2], axis=1) / DEG for angles in (e.proof.before, e.proof.after))
    floor = e.proof.floor_rms / DEG
    last = max([*e.proof.before_numbers, *e.proof.after_numbers])
    chart = Chart(
        width,
        260,
        Axis(-0.8, last + 0.8, "segment"),
        log_axis([*before, *after, floor], "closure, degrees"),
        "Closure of each segment before and after naming",
    )
    chart.across(floor, "floor")
    chart.dots(
        e.proof.before_numbers,
        before,
        "before",
        [f"segment {n}: {significant(v)}°" for n, v in zip(e.proof.before_numbers, before, strict=True)],
    )
    chart.dots(
        e.proof.after_numbers,
        after,
        "after",
        [f"segment {n}: {significant(v)}°" for n, v in zip(e.proof.after_numbers, after, strict=True)],
    )
    return chart.svg()


def _considered(e: Explanation) -> str:
    """What fired, or was weighed, and is not borne out, as the page of ``explain`` has it."""
    lines = "".join(f"<li>{escape(line)}</li>" for line in considered_lines(e))
    return paragraph("Considered, and not borne out:") + f"<ul>{lines}</ul>" if lines else ""


def _noise(e: Explanation) -> str:
    """Components of the noise, each with its size ± one standard deviation."""
    rows = [(escape(name), escape(size), escape(says)) for name, size, says in noise_rows(e)]
    caption = "Noise beyond white, which everything here is judged against: estimated from this recording, ± one standard deviation."
    return table(("component", "size", "what it is"), rows, caption) if rows else ""


def _tested(e: Explanation) -> str:
    """Which effects were tried and not found: a name that is missing here was not looked for."""
    from tinygc.explanation.evidence import candidates

    tried = sorted({effect.id for effect in candidates(e.twin)} - {claim.effect.id for claim in e.claimed})
    return paragraph(
        f"Tried, and not found: {escape(', '.join(tried))}. Looked for in the registers as well: clipping, false readings, lost "
        "samples, stills that move.",
        "soft",
    )
