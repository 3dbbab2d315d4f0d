"""Result of ``explain``: why recording and simulation differ, with pictures."""

from __future__ import annotations

from session.base.texts import fixed
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.claims import LEFT
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
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.pictures.in_stills import in_time
from tinygc.reporting.pictures.in_turns import proof_panel
from tinygc.reporting.pictures.page import drawable, pair_of

#: functions with which the template describes a claim
WORDS = {each.__name__: each for each in (chance_words, equivalent_words, parameter_lines, rival_words)}


def section(evidence: ReportData) -> Section | None:
    """Section on the explanation; None if explain was not run."""
    from tinygc.noise.refit import candidates

    e = evidence.explanation
    if e is None:
        return None
    # The strongest cause whose picture the page can draw; one that draws its own may fail.
    told = next((claim for claim in drawable(e) if isinstance(claim.effect.pair, str)), None)
    panels = pair_of(e, told) if told is not None else (in_time(e),) if e.twin.stills else ()
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
        panels=panels,
        proof=proof_panel(e),
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
