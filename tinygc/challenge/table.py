"""The examination's tables: by effect and strength, and in all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from tinygc.challenge.cases import STRENGTHS
from tinygc.challenge.examination import Examination
from tinygc.challenge.reliability import CLAIMS_FROM, calibration_error, reliability
from tinygc.challenge.score import KINDS, Score
from tinygc.challenge.splits import splits

TITLES = {"nothing": "nothing hidden", "beside": "beside an outsider", **{kind: f"{kind} at once" for kind in ("two", "three", "four")}}
#: effects of the catalogue, and nothing else
HIDDEN = ("one", "two", "three", "four")
LAST = list(TITLES.values())


def challenge_tables(result: Examination[Score]) -> Group:
    """What ``calibrate.py challenge`` prints."""
    tables = [part for table in _tables(result.scores) for part in (table, Text(""))]
    return Group(*tables, Text("\n".join(sentences(result.scores))))


def markdown(result: Examination[Score]) -> str:
    """The same, for a README."""
    return "\n\n".join([*map(_markdown, _tables(result.scores)), "\n".join(f"- {line}" for line in sentences(result.scores))]) + "\n"


def _tables(scores: list[Score]) -> list[Table]:
    stated = any(each.statements for each in scores)
    return [_by_effect(scores), _by_strength(scores), *([_by_probability(scores)] if stated else []), _by_session(scores)]


def _markdown(table: Table) -> str:
    columns = [list(column.cells) for column in table.columns]
    lines: list[Sequence[object]] = [[column.header for column in table.columns], ["---"] * len(columns), *zip(*columns, strict=True)]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def _by_effect(scores: list[Score]) -> Table:
    strengths = [f"× {strength:g}" for strength in STRENGTHS]
    table = Table(
        "hidden", *strengths, "wrong names", "error, median σ", "within 3 σ", "excess gone", title="named (exactly or among equivalents) of"
    )
    groups: dict[str, list[Score]] = {}
    for each in scores:
        groups.setdefault(TITLES.get(each.kind) or each.truth[0], []).append(each)
    for name in sorted(groups, key=lambda name: (name in LAST, name.startswith("outside"), LAST.index(name) if name in LAST else 0, name)):
        group = groups[name]
        cells = [_named_of([each for each in group if each.strength == strength]) for strength in STRENGTHS]
        if group[0].kind == "nothing":
            cells = [f"{sum(each.alarmed for each in group)} alarms of {len(group)}", "", "", ""]
        table.add_row(name, *cells, str(sum(len(each.wrong) for each in group)), *_parameters(group))
    return table


def _named_of(group: list[Score]) -> str:
    """``named/of``; of outsiders, which have no name to be given: ``seen/of seen``."""
    if not group:
        return ""
    if group[0].kind == "outside":
        return f"{sum(each.alarmed for each in group)}/{len(group)} seen"
    return f"{sum(each.covered for each in group)}/{len(group)}"


def _by_strength(scores: list[Score]) -> Table:
    heads = ("strength", "sessions", "named exactly", "or with equivalents", "wrongly named", "missed", "error, median σ", "within 3 σ")
    table = Table(*heads, "excess gone", title="sessions that hide effects of the catalogue, by the weakest of them")
    hidden = [each for each in scores if each.kind in HIDDEN]
    for strength in (*STRENGTHS, None):
        group = hidden if strength is None else [each for each in hidden if each.strength == strength]
        if group:
            counts = (
                len(group),
                sum(each.exact for each in group),
                sum(each.covered for each in group),
                sum(bool(each.wrong) for each in group),
                sum(bool(each.missed) for each in group),
            )
            table.add_row("all" if strength is None else f"× {strength:g}", *map(str, counts), *_parameters(group))
    return table


def _by_probability(scores: list[Score]) -> Table:
    table = Table("stated probability", "names", "share right", "mean stated", title="is a stated probability what it says?")
    for each in reliability(one for score in scores for one in score.statements):
        if each.low >= CLAIMS_FROM and each.share_right is not None and each.mean_stated is not None:
            right, stated = f"{100 * each.share_right:.1f} %", f"{100 * each.mean_stated:.1f} %"
            table.add_row(f"{each.low:g} to {each.high:g}", str(each.number), right, stated)
    return table


def _by_session(scores: list[Score]) -> Table:
    table = Table("by", "", "sessions", "wrongly named", "nothing hidden", "false alarms", title="where alarms and wrong names come from")
    for row in splits(scores):
        table.add_row(*map(str, row.values()))
    return table


def _parameters(group: Sequence[Score]) -> tuple[str, str, str]:
    sigmas = [x for each in group for x in each.sigmas]
    removed = [each.removed for each in group if each.removed is not None]
    return (
        f"{np.median(sigmas):.2f}" if sigmas else "–",
        f"{100 * np.mean(np.array(sigmas) < 3):.0f} %" if sigmas else "–",
        f"{100 * np.median(removed):.1f} %" if removed else "–",
    )


def totals(scores: list[Score]) -> dict:
    """Counts and medians over all sessions, JSON-ready."""
    kinds = {kind: [each for each in scores if each.kind == kind] for kind in KINDS}
    hidden = [each for kind in HIDDEN for each in kinds[kind]]
    sigmas = [x for each in hidden for x in each.sigmas]
    right = [x for each in hidden for x in each.right]
    removed = [each.removed for each in hidden if each.removed is not None and each.found]
    stated = [one for each in scores for one in each.statements]
    return {
        "sessions": len(scores),
        "refused": sum(each.verdict == "refused" for each in scores),
        "nulls": len(kinds["nothing"]),
        "false_alarms": sum(each.alarmed for each in kinds["nothing"]),
        "hidden": len(hidden),
        "named_exactly": sum(each.exact for each in hidden),
        "named_with_equivalents": sum(each.covered for each in hidden),
        "wrongly_named": sum(bool(each.wrong) for each in hidden),
        "missed": sum(bool(each.missed) for each in hidden),
        "outsiders": len(kinds["outside"]),
        "outsiders_seen": sum(each.alarmed for each in kinds["outside"]),
        "outsiders_wrongly_named": sum(bool(each.wrong) for each in kinds["outside"]),
        "outsiders_undecided": sum(bool(each.claimed) and not each.wrong for each in kinds["outside"]),
        "kinds": [
            {
                "kind": kind,
                "sessions": len(group),
                "named_exactly": sum(each.exact for each in group),
                "named_with_equivalents": sum(each.covered for each in group),
                "wrongly_named": sum(bool(each.wrong) for each in group),
                "missed": sum(bool(each.missed) for each in group),
            }
            for kind, group in kinds.items()
            if group
        ],
        "splits": splits(scores),
        "reliability": [vars(each) for each in reliability(stated)],
        "ece": calibration_error(stated),
        "ece_claimed": calibration_error(one for one in stated if one.claimed),
        "error_median_sigmas": float(np.median(sigmas)) if sigmas else None,
        "share_within_3_sigmas": float(np.mean(np.array(sigmas) < 3)) if sigmas else None,
        "share_within_3_sigmas_or_tenth": float(np.mean(right)) if right else None,
        "excess_removed_median": float(np.median(removed)) if removed else None,
    }


def sentences(scores: list[Score]) -> list[str]:
    """The totals in words."""
    t = totals(scores)
    lines = [
        f"{t['hidden']} sessions hide one to four effects: {t['named_exactly']} named exactly, {t['named_with_equivalents']} exactly or "
        f"with equivalents that contain the truth, {t['wrongly_named']} with a wrong name, {t['missed']} with something missed",
        *_by_kind(t["kinds"]),
        f"{t['nulls']} hide nothing: {t['false_alarms']} false alarms",
        f"{t['outsiders']} hide what no catalogue has: {t['outsiders_seen']} seen, {t['outsiders_wrongly_named']} wrongly given a name, "
        f"{t['outsiders_undecided']} said to be ambiguous between a name and a shape without one",
    ]
    if t["error_median_sigmas"] is not None:
        lines.append(
            f"parameters: median error {t['error_median_sigmas']:.2f} sigmas, {100 * t['share_within_3_sigmas']:.1f} % within 3 sigmas, "
            f"{100 * t['share_within_3_sigmas_or_tenth']:.1f} % within 3 sigmas or a tenth"
        )
    if t["excess_removed_median"] is not None:
        lines.append(f"share of the held-out misfit removed: median {100 * t['excess_removed_median']:.1f} %")
    if t["ece"] is not None:
        claimed = "" if t["ece_claimed"] is None else f" ({100 * t['ece_claimed']:.1f} % over the names that are claimed)"
        lines.append(f"stated probabilities: expected calibration error {100 * t['ece']:.1f} %{claimed}")
    if t["refused"]:
        lines.append(f"{t['refused']} were refused by the first look")
    return lines


def _by_kind(kinds: list[dict]) -> list[str]:
    """A line for each kind of several at once."""
    return [
        f"{each['sessions']} hide {'one or two effects ' if each['kind'] == 'beside' else ''}{TITLES[each['kind']]}: "
        f"{each['named_with_equivalents']} right, {each['wrongly_named']} with a wrong name, {each['missed']} with something missed"
        for each in kinds
        if each["kind"] in ("two", "three", "four", "beside")
    ]
