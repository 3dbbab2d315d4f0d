"""The movement or condition that would tell what a recording cannot."""

from __future__ import annotations

from tinygc.explanation.twin.channels import bonferroni
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.where import BELONGS_P, worst_segments


def what_next(e: Explanation) -> str | None:
    """The movement or condition that would tell what this recording cannot; None where nothing is open."""
    for claim in e.claimed:
        if claim.equivalent:
            return f"to tell {claim.effect.id} from {', '.join(claim.equivalent)}: {claim.effect.splits}"
    if e.findings:
        return e.findings[0].effect.splits
    if e.verdict == "unexplained" and (suspicion := next((warning.do for warning in e.warnings if warning.do), None)):
        return suspicion
    if e.verdict == "unexplained":
        worst = worst_segments(e)
        where_to_look = f"; begin with the movement of segment {worst[0]}" if worst else ""
        return "repeat the session with one thing changed at a time (rate, temperature, attitude)" + where_to_look
    if e.verdict == "partly_explained" and bonferroni(e.left) < BELONGS_P:
        return "mend what is named, record again, and explain what is left"
    return None
