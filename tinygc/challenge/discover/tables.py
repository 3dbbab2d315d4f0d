"""The tables of an examination of the search for laws: by strength, by law, and what was said where there is none."""

from __future__ import annotations

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from tinygc.challenge.cases import STRENGTHS
from tinygc.challenge.discover.score import FAR, WITH_LAW, WITHOUT_LAW, LawScore
from tinygc.challenge.examination import Examination

OTHERS = {"nothing": "nothing hidden", "catalogue": "an effect of the catalogue alone"}


def law_tables(result: Examination[LawScore]) -> Group:
    """What ``calibrate.py challenge --discover`` prints."""
    tables = [_by_strength(result.scores), _by_law(result.scores), _without(result.scores)]
    return Group(*[part for table in tables for part in (table, Text(""))], Text("\n".join(sentences(result.scores))))


def _by_strength(scores: list[LawScore]) -> Table:
    heads = (outcome.replace("_", " ") for outcome in WITH_LAW)
    table = Table("strength", "sessions", *heads, "correlation", "excess gone", "s", title="laws that stand in no catalogue, by strength")
    hidden = [each for each in scores if each.law is not None]
    for strength in (*STRENGTHS, None):
        group = hidden if strength is None else [each for each in hidden if each.strength == strength]
        if group:
            table.add_row("all" if strength is None else f"× {strength:g}", str(len(group)), *_counts(group), *_proofs(group))
    return table


def _by_law(scores: list[LawScore]) -> Table:
    heads = [f"× {strength:g}" for strength in STRENGTHS]
    table = Table("law", *heads, "correlation", "excess gone", "s", title="f found, = catalogue equal, a ambiguous, w wrong, m missed")
    laws = sorted({each.law for each in scores if each.law is not None})
    for law in laws:
        group = [each for each in scores if each.law == law]
        cells = [" ".join(_letter(each) for each in group if each.strength == strength) for strength in STRENGTHS]
        table.add_row(law.removeprefix("law."), *cells, *_proofs(group))
    return table


def _letter(score: LawScore) -> str:
    letter = "=" if score.outcome == "catalogue_equal" else score.outcome[0]
    return f"{letter}+" if score.kind == "beside" else letter


def _without(scores: list[LawScore]) -> Table:
    table = Table("hidden", "sessions", *WITHOUT_LAW, "s", title="where there is no law")
    for kind, title in OTHERS.items():
        group = [each for each in scores if each.kind == kind]
        if group:
            table.add_row(title, str(len(group)), *(str(_count(group, outcome)) for outcome in WITHOUT_LAW), _seconds(group))
    return table


def _counts(group: list[LawScore]) -> list[str]:
    return [str(_count(group, outcome)) for outcome in WITH_LAW]


def _count(group: list[LawScore], outcome: str) -> int:
    return sum(each.outcome == outcome for each in group)


def _proofs(group: list[LawScore]) -> tuple[str, str, str]:
    """Correlation, least and median, and share of the held-out excess that is gone, of those that are found; seconds, median."""
    found = [each for each in group if each.outcome == "found"]
    alike = [each.correlation for each in found if each.correlation is not None]
    gone = [100 * each.removed for each in found if each.removed is not None]
    return (
        f"{np.median(alike):.4f} (least {min(alike):.4f})" if alike else "–",
        f"{np.median(gone):.1f} % (least {min(gone):.1f})" if gone else "–",
        _seconds(group),
    )


def _seconds(group: list[LawScore]) -> str:
    seconds = [each.seconds for each in group if each.seconds is not None]
    return f"{np.median(seconds):.0f}" if seconds else "–"


def totals(scores: list[LawScore]) -> dict:
    """Counts and medians over all sessions, JSON-ready."""
    hidden = [each for each in scores if each.law is not None]
    found = [each for each in hidden if each.outcome == "found"]
    wrong = [each for each in hidden if each.outcome == "wrong"]
    gone = [each.removed for each in found if each.removed is not None]
    seconds = [each.seconds for each in scores if each.seconds is not None]
    return {
        "sessions": len(scores),
        "with_law": {outcome: _count(hidden, outcome) for outcome in WITH_LAW} | {"sessions": len(hidden)},
        "far": sum(each.correlation is None or each.correlation <= FAR for each in wrong),
        "misnamed": sum(each.misnamed for each in hidden),
        "ambiguous_with_equal": sum(each.outcome == "ambiguous" and each.listed_same for each in hidden),
        "strengths": [
            {"strength": strength, "sessions": len(group)} | {outcome: _count(group, outcome) for outcome in WITH_LAW}
            for strength in STRENGTHS
            if (group := [each for each in hidden if each.strength == strength])
        ],
        **{
            kind: {outcome: _count(group, outcome) for outcome in WITHOUT_LAW} | {"sessions": len(group)}
            for kind in OTHERS
            for group in [[each for each in scores if each.kind == kind]]
        },
        "removed_median": float(np.median(gone)) if gone else None,
        "removed_least": min(gone, default=None),
        "seconds_median": float(np.median(seconds)) if seconds else None,
        "seconds_most": max(seconds, default=None),
    }


def sentences(scores: list[LawScore]) -> list[str]:
    """The totals in words."""
    t = totals(scores)
    w = t["with_law"]
    lines = [
        f"{w['sessions']} sessions hide a law: {w['found']} found, {w['catalogue_equal']} given names of the catalogue that are "
        f"numerically equal, {w['ambiguous']} ambiguous ({t['ambiguous_with_equal']} with a law on the list that is numerically equal), "
        f"{w['wrong']} wrong ({t['far']} of them far: correlation at most {FAR:g}), {w['missed']} missed ({t['misnamed']} of them under "
        "other names)",
        *(
            f"{t[kind]['sessions']} hide {'nothing' if kind == 'nothing' else title}: {t[kind]['invented']} with an invented law, "
            f"{t[kind]['ambiguous']} ambiguous"
            for kind, title in OTHERS.items()
        ),
    ]
    if t["removed_median"] is not None:
        least, middle = 100 * t["removed_least"], 100 * t["removed_median"]
        lines.append(f"share of the held-out excess that a found law takes away: median {middle:.1f} %, least {least:.1f} %")
    if t["seconds_median"] is not None:
        lines.append(f"seconds for a session: median {t['seconds_median']:.0f}, most {t['seconds_most']:.0f}")
    return lines
