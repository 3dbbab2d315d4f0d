"""Result of ``explain``: why recording and simulation differ, with pictures."""

from __future__ import annotations

from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.claims import LEFT
from tinygc.explanation.reported import ReportData
from tinygc.explanation.result import (
    HEADING,
    chance_words,
    considered_lines,
    equivalent_words,
    noise_rows,
    rival_words,
    what_next,
)
from tinygc.reporting.explanation_text import channels_table, noise_table, parameter_lines, where_words
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
    html = render(
        "explanation.html",
        e=e,
        verdict=e.words[0],
        words=WORDS,
        among=" among the catalogue's effects" if e.verdict in LEFT else "",
        place=where_words(e),
        heading=HEADING,
        residuals=channels_table(e),
        panels=panels,
        proof=proof_panel(e),
        tilt_rms=tilt_rms,
        considered=considered_lines(e),
        noise=noise_rows(e) and noise_table(e),
        tried=sorted({effect.id for effect in candidates(e.twin)} - {claim.effect.id for claim in e.claimed}),
        next=what_next(e),
    )
    return Section("explain", "Why recording and simulation differ", html)
