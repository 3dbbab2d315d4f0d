"""The check of a recording's effects on other recordings, as text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.base.texts import measured, printable
from tinygc.explanation.checked import OUTCOMES, UNTESTED, Checked, CheckedEffect, outcome_of
from tinygc.inference.decide import KINDS
from tinygc.reporting.explanation_text import plain_name
from tinygc.reporting.facts import Part, Table
from tinygc.reporting.terminal import Text, one_line

#: why a recording does not test an effect
REASONS = {
    "of one recording": "it belongs to this recording, and no other repeats it",
    "of one unit": "it is the sensor's own, and the other recording is of another unit",
    "no numbers": "it has no numbers that would predict another recording",
    "no power": "no other recording can show it at that size",
}


def checked_page(checked: Sequence[Checked]) -> list[Part]:
    """Return a line for each effect over all recordings, and the table of each effect in each recording."""
    parts: list[Part] = [
        one_line(f"Not checked on {each.session.name}: {printable(each.error)}", "yellow") for each in checked if each.error
    ]
    checked = [each for each in checked if not each.error]
    effects = list(zip(*(each.effects for each in checked), strict=True))
    if not effects:
        return [*parts, *([Text("Other recordings: there is no effect to check.")] if checked else [])]
    parts += [_line(there, checked) for there in effects]
    found = [(each.session.name, found) for each in checked for found in each.effects]
    rows = [(name, plain_name(each.named.effect.id), each.outcome, *_cells(each)) for name, each in found]
    styles = {at: KINDS[each.outcome].style for at, (_, each) in enumerate(found)}
    return [*parts, Table("", ("recording", "effect", "", "size, here 1", "closure"), rows, left=range(3), styles=styles, minor=(4,))]


def _line(there: Sequence[CheckedEffect], checked: Sequence[Checked]) -> Text:
    outcome, name = outcome_of(there), plain_name(there[0].named.effect.id)
    if outcome in REASONS:
        return one_line(f"Other recordings, {name}: {REASONS[outcome]}.")
    counted = [each.outcome for each in there]
    counts = ", ".join(f"{each} in {counted.count(each)}" for each in OUTCOMES if each in counted)
    differing = [each.session.name for each, found in zip(checked, there, strict=True) if outcome == "confirmed" and found.other_size]
    words = f"Other recordings, {name}: {counts} of {len(counted)}"
    words += f"; another size in {', '.join(map(printable, differing))}" if differing else ""
    return one_line(f"{words}{'; units not stated' if any(each.same_unit is None for each in checked) else ''}.", KINDS[outcome].style)


def _cells(found: CheckedEffect) -> tuple[str, str]:
    if found.outcome in UNTESTED or found.there is None:
        return "–", "–"
    size = measured(*found.size) if np.isfinite(found.size).all() else "–"
    return size, "–" if found.closure_rad is None else " -> ".join(f"{value:.4f}°" for value in np.degrees(found.closure_rad))
