"""Where alarms and wrong names come from: by data rate, by the gyro's bias instability, and by what session.toml told of it."""

from __future__ import annotations

from itertools import pairwise

from tinygc.challenge.cases import MOST_INSTABILITY_DPH
from tinygc.challenge.score import Score

#: deg/h: below a typical gyro's, about it, beyond
INSTABILITIES = (0.0, 2.0, 5.0, MOST_INSTABILITY_DPH)


def splits(scores: list[Score]) -> list[dict]:
    """Of each group that has sessions: ``by``, ``group``, and counts of sessions, wrongly named ones, nulls and their false alarms."""
    groups: dict[tuple[str, float | str, str], list[Score]] = {}
    for each in scores:
        for key in _groups_of(each):
            groups.setdefault(key, []).append(each)
    ordered = sorted(groups, key=lambda key: (key[0], str(type(key[1])), key[1]))
    return [{"by": by, "group": name, **_counts(groups[by, place, name])} for by, place, name in ordered]


def _groups_of(each: Score) -> list[tuple[str, float | str, str]]:
    """By what, where in order, and name of each group that a session belongs to."""
    found: list[tuple[str, float | str, str]] = []
    if each.odr_hz is not None:
        found.append(("data rate", each.odr_hz, f"{each.odr_hz:g} Hz"))
    if each.instability_dph is not None:
        for low, high in pairwise(INSTABILITIES):
            if low <= each.instability_dph < high or each.instability_dph == high == MOST_INSTABILITY_DPH:
                found.append(("bias instability", low, f"{low:g} to {high:g} deg/h"))
    if each.told is not None:
        found.append(("told of the bias instability", each.told, each.told))
    return found


def _counts(here: list[Score]) -> dict[str, int]:
    nulls = [each for each in here if each.kind == "nothing"]
    return {
        "sessions": len(here),
        "wrongly_named": sum(bool(each.wrong) for each in here),
        "nulls": len(nulls),
        "false_alarms": sum(each.alarmed for each in nulls),
    }
