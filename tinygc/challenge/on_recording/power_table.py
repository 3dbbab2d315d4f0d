"""What a recording can tell, as ``calibrate.py challenge --on`` prints it."""

from __future__ import annotations

from collections import Counter

from rich.console import Group
from rich.table import Table
from rich.text import Text

from tinygc.challenge.on_recording.examine import OwnExamination
from tinygc.challenge.on_recording.power import Power, agreement

FOUND, NOT_FOUND = "✓", "–"


def power_tables(result: OwnExamination) -> Group:
    """A row for each effect, and what it comes to."""
    heads = ("concealed", "unit", "seen from", "told from", "ratio", "sizes that were tried", "wrong names")
    table = Table(*heads, title=f"from what size on {result.session} tells")
    for each in result.powers:
        sizes = "  ".join(f"{one.size:.2g} {FOUND if one.found else NOT_FOUND}" for one in each.tried)
        ratio = "" if each.ratio is None else _at_most(each) + f"{each.ratio:.2g}"
        wrong = ", ".join(sorted({name for one in each.tried for name in one.wrong}))
        table.add_row(each.id, each.unit, _number(each.seen_from), _told(each), ratio, sizes, wrong)
    return Group(table, Text(""), Text("\n".join(sentences(result))))


def sentences(result: OwnExamination) -> list[str]:
    """The whole in words."""
    found, t = result.powers, agreement(result.powers)
    tried = [one for each in found for one in each.tried]
    lines = [f"untouched: {result.verdict}" + (f"; its own, neither right nor wrong: {', '.join(result.own)}" if result.own else "")]
    lines.append(
        f"{len(tried)} concealed: {sum(one.found for one in tried)} found, {sum(bool(one.wrong) for one in tried)} with a wrong name"
    )
    if t["promised"]:
        ratio = "" if t["median_ratio"] is None else f"; told from over seen from, where no ≤ stands: median {t['median_ratio']:.2g}"
        lines.append(
            f"of the {t['promised']} effects with a seen_from it holds within a factor of 2 for {t['agree']}, not for {t['disagree']}, and "
            f"for {t['not_decided']} the sizes do not decide it; {t['promised'] - t['told']} were not told at the largest size{ratio}"
        )
    if lost := Counter(name for one in tried for name in one.lost):
        gone = ", ".join(f"{name} in {count}" for name, count in sorted(lost.items()))
        lines.append(f"its own that are gone beside what was concealed: {gone}")
    if blind := _blind(found):
        lines.append(f"not told at any size that was tried: {', '.join(blind)}")
    return lines


def _told(power: Power) -> str:
    return _at_most(power) + _number(power.told_from)


def _at_most(power: Power) -> str:
    """A sign before what is only known to be no more, because no smaller size was tried."""
    return "≤ " if power.told_from is not None and power.not_told_at is None else ""


def _blind(found: list[Power]) -> list[str]:
    return [each.id for each in found if not any(one.found for one in each.tried)]


def _number(value: float | None) -> str:
    return NOT_FOUND if value is None else f"{value:.2g}"
