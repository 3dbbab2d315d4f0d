"""Result of ``explain``: why recording and simulation differ, with pictures."""

from __future__ import annotations

from functools import partial

import numpy as np

from session.base.texts import fixed, significant
from session.base.units import DEG
from tinygc.effects.effect import ENERGY_LAW, LAG_LAW, SCALE_LAW, TURNS
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.claims import LEFT, Claim
from tinygc.explanation.engine import Explanation
from tinygc.explanation.reported import ReportData
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
)
from tinygc.reporting.explanation_text import parameter_lines, where_words
from tinygc.reporting.html.chart import Axis, Chart, linear_axis, log_axis
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.pictures.values import (
    AxisLaws,
    added_in_stills,
    axis_laws,
    per_parameter,
    rates_per_still,
    recorded_in_stills,
    strongest,
    strongest_rate_effect,
    variable_for,
)

#: pictures that show the turns
OF_TURNS = (TURNS, SCALE_LAW, LAG_LAW, ENERGY_LAW)
#: functions with which the template describes a claim
WORDS = {each.__name__: each for each in (chance_words, equivalent_words, parameter_lines, rival_words)}


def section(evidence: ReportData) -> Section | None:
    """Section on the explanation; None if explain was not run."""
    from tinygc.noise.refit import candidates

    if evidence.by_reference is not None:
        found: Section = evidence.problem.session.reference.report_section(evidence.by_reference)
        return found
    e = evidence.explanation
    if e is None:
        return None
    claim = strongest_rate_effect(e)
    turning = claim is not None and claim.effect.pair in OF_TURNS
    in_stills = claim is not None and not turning and "still" in claim.effect.observable_in
    laws = axis_laws(e, claim) if claim is not None and turning else None
    header, residuals = residual_rows(e)
    html = render(
        "explanation.html",
        e=e,
        verdict=e.words[0],
        words=WORDS,
        among=" among the catalogue's effects" if e.verdict in LEFT else "",
        place=where_words(e),
        heading=HEADING,
        header=header,
        residuals=residuals,
        refitted=is_refitted(e),
        told=claim,
        laws=laws,
        law=partial(_law, e, claim, laws) if claim is not None and turning else None,
        stills=lambda width: _stills_along(e, claim, width),
        recorded=partial(_said_against_recorded, e, claim) if claim is not None and in_stills else None,
        proof=lambda width: _proof(e, width),
        tilt_rms=tilt_rms,
        considered=considered_lines(e),
        noise=noise_rows(e),
        tried=sorted({effect.id for effect in candidates(e.twin)} - {claim.effect.id for claim in e.claimed}),
        next=what_next(e),
    )
    return Section("explain", "Why recording and simulation differ", html)


def residual_rows(e: Explanation) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the table of residuals, with the same numbers as the page of ``explain``."""
    header = ["channel", "values", *(("linear model", "with what is named") if is_refitted(e) else ("rms",))]
    rows = []
    for channel, values, shown in residual_table(e):
        cells = [channel, str(values), *(fixed(rms, 2) for rms in shown)]
        rows.append(cells + [""] * (len(header) - len(cells)))
    return header, rows


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
    """Chart each turn's share and the curve, or the residual of each turn, on a line of slope one if the effect is the cause."""
    if laws is None:
        own = claim.effect.parameter.size == 3
        parts = [("xyz"[entry if own else number], per_parameter(e, claim, entry)) for number, entry in enumerate(strongest(e, claim))]
        labels = (f"{claim.effect.id} says, degrees", "missed in the turn, degrees")
        about = f"What each turn misses against what {claim.effect.id} says"
        return _on_slope_one([(colour, of.law / DEG, of.before / DEG) for colour, of in parts], labels, about, width)
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
    points = list(zip("xyz", said.T, recorded.T, strict=True))
    return _on_slope_one(points, (f"{claim.effect.id} says, mdps", "recorded, mdps"), "Recorded against explained", width)


def _on_slope_one(points: list[tuple[str, np.ndarray, np.ndarray]], labels: tuple[str, str], about: str, width: int) -> str:
    """Chart of series (colour, x, y) to one scale on both axes, with the line of slope one."""
    span = linear_axis(np.concatenate([values for _, *pair in points for values in pair]))
    x, y = (Axis(span.lo, span.hi, label) for label in labels)
    chart = Chart(width, 300, x, y, about).line([span.lo, span.hi], [span.lo, span.hi], "floor", "dash")
    for colour, predicted, recorded in points:
        chart.dots(predicted, recorded, colour)
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
    for kind, numbers, closure in (("before", e.proof.before_numbers, before), ("after", e.proof.after_numbers, after)):
        chart.dots(numbers, closure, kind, [f"segment {n}: {significant(v)}°" for n, v in zip(numbers, closure, strict=True)])
    return chart.svg()
