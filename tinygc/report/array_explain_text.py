"""An array's explanation as a person reads it in the terminal."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from session.common.console import one_line
from session.common.units import DEG
from tinygc.array.explain import ArrayExplanation
from tinygc.array.fit_json import begins_s
from tinygc.report.array_text import event_lines

VERDICTS = {
    "no_mismatch": "no mismatch: every unit turns as its calibration says",
    "common": "what turns miss by is common to all units: none of the sensors",
    "own": "what turns miss by is the units' own",
    "common_and_own": "part of what turns miss by is common to all units, part is some units' own",
}
#: moments that are told one by one
MOST_MOMENTS = 12


def array_verdict_line(found: ArrayExplanation) -> Text:
    """The array, and what it is."""
    return one_line(f"{found.fit.array.name}: {VERDICTS[found.verdict]}", "bold")


def array_explain_page(found: ArrayExplanation) -> Group:
    """Verdict, the common part, whose each effect is, what the others say of each moment, each unit's own verdict."""
    fit = found.fit
    parts: list[RenderableType] = [array_verdict_line(found), one_line(f"Common: {fit.split.words}.")]
    parts += [one_line(f"{trait.words}.") for trait in found.traits]
    begins = begins_s(fit)
    parts += [one_line(f"{moment.at_s - begins:.2f} s: {moment.words}.", "yellow") for moment in found.moments[:MOST_MOMENTS]]
    if len(found.moments) > MOST_MOMENTS:
        parts.append(one_line(f"… and {len(found.moments) - MOST_MOMENTS} moments more, in array.json."))
    parts += [one_line(f"{line}.", "yellow") for line in event_lines(fit)]
    table = Table(title="Each unit by itself", title_justify="left", box=None, padding=(0, 1))
    for column in ("unit", "own excess, deg", "verdict alone", "named"):
        table.add_column(column, justify="left" if column in ("verdict alone", "named") else "right", overflow="fold")
    for unit in fit.units:
        explanation = found.explanations.get(unit.number)
        named = ", ".join(claim.effect.id for claim in explanation.claimed) if explanation else found.not_explained[unit.number]
        own, sigma = (part / DEG for part in unit.own_rad)
        table.add_row(str(unit.number), f"{own:.4f} ± {sigma:.4f}", explanation.verdict if explanation else "not explained", named or "–")
    parts += ["", table]
    parts += [one_line(f"Left out: unit {unit.number}: {unit.why}", "bold red") for unit in fit.left_out]
    return Group(*parts)
