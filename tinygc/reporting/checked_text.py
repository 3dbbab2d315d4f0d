"""The check of a recording's effects on other recordings, as text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.base.texts import measured, printable
from tinygc.explanation.checked import OUTCOMES, Checked, CheckedEffect, numbers_of, outcome_of
from tinygc.inference.decide import KINDS
from tinygc.reporting.facts import Part, Table
from tinygc.reporting.terminal import Text, one_line

#: why a recording does not test an effect, or its outcome
REASONS = {
    "of one recording": "a course of time, a motion, or readings of this recording, which no other repeats",
    "of one unit": "the sensor's own, and the other recording is of another unit",
    "no numbers": "found without numbers that would predict another recording",
    "no power": "no recording here can show it at that size",
}
#: odds beyond which only their order is of interest
MOST_ODDS = 1e6


def checked_page(checked: Sequence[Checked]) -> list[Part]:
    """Return a line for each effect over all recordings, and the table of each effect in each recording."""
    failed = [one_line(f"Not checked on {each.session.name}: {printable(each.error)}", "yellow") for each in checked if each.error]
    checked = [each for each in checked if not each.error]
    if not checked:
        return [*failed]
    effects = len(checked[0].effects)
    if not effects:
        return [*failed, Text("Checked on other recordings: nothing is named here that could be checked.")]
    parts: list[Part] = [*failed, Text("Checked on other recordings, with the numbers of this one:", "bold")]
    for number in range(effects):
        there = [each.effects[number] for each in checked]
        parts.append(_line(there, checked))
    found = [(each.session.name, found) for each in checked for found in each.effects]
    header = ("recording", "effect", "", "of its size there", "odds", "closure there: without → with")
    styles = {at: KINDS[each.outcome].style for at, (_, each) in enumerate(found)}
    return [*parts, Table("", header, [(name, each.named.effect.id, *_cells(each)) for name, each in found], left=range(6), styles=styles)]


def _line(there: list[CheckedEffect], checked: Sequence[Checked]) -> Text:
    outcome = outcome_of(there)
    counted = [each.outcome for each in there]
    if outcome in REASONS:
        return one_line(f"  {there[0].named.effect.id}: {outcome}: {REASONS[outcome]}")
    counts = [f"{each} in {counted.count(each)}" for each in OUTCOMES if each in counted]
    words = f"{there[0].named.effect.id}: {', '.join(counts)} of {len(counted)} recordings"
    differing = [each.session.name for each, found in zip(checked, there, strict=True) if found.other_size]
    if outcome == "confirmed" and differing:
        words += f"; its size differs in {', '.join(map(printable, differing))}"
    if any(each.same_unit is None for each in checked):
        words += "; whether they are of one unit is not stated"
    return one_line(f"  {words}", KINDS[outcome].style)


def _cells(found: CheckedEffect) -> tuple[str, str, str, str]:
    size = measured(*found.size) if np.isfinite(found.size).all() else "–"
    if found.other_size:
        size += f" (another size, p = {found.same_p:.1g})"
    if found.outcome in ("of one recording", "of one unit", "no numbers"):
        return found.outcome, _numbers(found), "–", "–"
    if found.there is None:
        return found.outcome, "–", "–", "–"
    closure = "–" if found.closure_rad is None else " → ".join(f"{value:.4f}°" for value in np.degrees(found.closure_rad))
    return found.outcome, size, odds_words(found.odds), closure


def _numbers(found: CheckedEffect) -> str:
    """Return the effect's largest number here, and the same one there, where the other recording names the effect itself."""
    if found.there is None or not found.named.covariance.size:
        return "–"
    both = [numbers_of(named) for named in (found.named, found.there)]
    name = next(iter(both[0][1]))
    at = int(np.argmax(np.abs(np.ravel(both[0][0][name]))))
    here, there = (measured(float(np.ravel(values[name])[at]), float(np.ravel(std[name])[at])) for values, std in both)
    return f"{name}: here {here}, there {there}"


def odds_words(log_odds_twice: float) -> str:
    """Return odds such as ``35 : 1`` or ``1 : 200``, of 2 ln of them."""
    odds = float(np.exp(min(abs(log_odds_twice) / 2, 50.0)))
    shown = f"> {MOST_ODDS:.0e}".replace("e+0", "e") if odds > MOST_ODDS else f"{odds:.2g}" if odds < 100 else f"{odds:.0f}"
    return f"{shown} : 1" if log_odds_twice >= 0 else f"1 : {shown}"
