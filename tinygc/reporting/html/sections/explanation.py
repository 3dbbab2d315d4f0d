"""Result of ``explain``: why recording and simulation differ, with pictures."""

from __future__ import annotations

from tinygc.explanation.reported import ReportData
from tinygc.explanation.result import what_next
from tinygc.reporting.explanation_text import explanation_facts, next_line
from tinygc.reporting.facts import html
from tinygc.reporting.html.markup import Section
from tinygc.reporting.pictures.in_stills import in_time
from tinygc.reporting.pictures.in_turns import proof_panel
from tinygc.reporting.pictures.page import drawable, pair_of
from tinygc.reporting.terminal import Text

#: repairs that are looked for in every recording of gravity
IN_REGISTERS = "clipping, false readings, lost samples, stills that move"


def section(evidence: ReportData) -> Section | None:
    """Section on the explanation; None if explain was not run."""
    from tinygc.noise.refit import candidates

    e = evidence.explanation
    if e is None:
        return None
    drawn = next(iter(drawable(e)), None)  # the strongest cause
    panels = [*(pair_of(e, drawn) if drawn is not None else (in_time(e),) if e.twin.stills else ())]
    panels += [*(() if e.shown is None else e.shown.panels), *([proof_panel(e)] if e.proof.changed else [])]
    tried = sorted({effect.id for effect in candidates(e.twin)} - {claim.effect.id for claim in e.claimed})
    words = f"tried, and not found: {', '.join(tried)}" + ("" if not e.gravity else f"; looked for in the readings as well: {IN_REGISTERS}")
    return Section(
        "explain",
        "Why recording and simulation differ",
        html([*explanation_facts(e, panels), next_line(e, what_next(e)), Text(words, "dim")]),
    )
