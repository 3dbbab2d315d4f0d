"""Terminal output of an array's fit and explanation."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from scipy.spatial.transform import Rotation

from session.bench.console import one_line
from session.io.texts import printable
from session.io.units import DEG, G
from tinygc.annexes.arrays.explanation import ArrayExplanation
from tinygc.annexes.arrays.fit import ArrayFit, UnitFit, begins_s
from tinygc.annexes.arrays.joint import COMMON_STILL, COMMON_TURN, OWN_TURN, ArrayEvent
from tinygc.annexes.arrays.model import ArrayModel
from tinygc.estimation.choice import run_figures

# Terminal output of an array's fit.


def array_page(fit: ArrayFit) -> Group:
    """Return the page: extrinsics, closure, common errors, events, and what was left out."""
    parts: list[RenderableType] = [_places(fit), "", _closure(fit), ""]
    parts.append(one_line(f"Common: {fit.split.words}."))
    parts += [one_line(_bias_words(fit)), one_line(_fused_words(fit.fused))]
    for unit in fit.units:
        runs = ", ".join(f"{run.file} {run_figures(error)['rmse_deg']:.4f}°" for run, error in unit.runs)
        parts += [one_line(f"Closure runs of unit {unit.number}, rms error at the return: {runs}.")] if runs else []
        parts += [one_line(f"Unit {unit.number}: not observed: {', '.join(unit.unobserved)}.", "yellow")] if unit.unobserved else []
    if fit.ages:
        ages = ", ".join(f"unit {each.number} ({each.beat_hz:.3g} Hz)" for each in fit.ages)
        parts.append(one_line(f"Readings wait for the reader, and their ages beat: {ages}; the stamps were corrected."))
    parts += [one_line(f"{line}.", "yellow") for line in event_lines(fit)]
    parts += [one_line(f"Left out: unit {unit.number}: {unit.why}", "bold red") for unit in fit.left_out]
    return Group(*parts)


def _places(fit: ArrayFit) -> Table:
    table = Table(title="Units against the first: clock, mounting, position", title_justify="left", box=None, padding=(0, 1))
    for column in ("unit", "serial", "clock, ms", "rate, ppm", "mounting about x, y, z, deg", "± deg", "position, mm", "± mm"):
        table.add_column(column, justify="left" if column == "serial" else "right", overflow="fold")
    for unit in fit.units:
        table.add_row(*_place(unit, unit is fit.units[0]))
    return table


def _place(unit: UnitFit, first: bool) -> list[str]:
    place, clock = unit.place, unit.place.clock
    name = [str(unit.number), printable(unit.session.config.sensor.serial)]
    if first:
        return [*name, "0", "0", "0, 0, 0", "–", "0, 0, 0", "–"]
    turn = Rotation.from_matrix(place.mounting).as_rotvec() / DEG
    sigma = float(np.sqrt(np.trace(place.mounting_covariance) / 3)) / DEG
    where, known = "not told by the motion", "–"
    if place.position_m is not None and place.position_covariance is not None:
        where = ", ".join(f"{x * 1e3:.1f}" for x in place.position_m)
        known = f"{float(np.sqrt(np.trace(place.position_covariance) / 3)) * 1e3:.1f}"
    return [
        *name,
        f"{clock.offset_s * 1e3:.3f} ± {clock.offset_sigma_s * 1e3:.3f}",
        f"{clock.rate * 1e6:.1f} ± {clock.rate_sigma * 1e6:.1f}",
        ", ".join(f"{x:.3f}" for x in turn),
        f"{sigma:.3f}",
        where,
        known,
    ]


def _closure(fit: ArrayFit) -> Table:
    title = "What turns miss by, degrees of tilt, rms a turn, and how much better the array knows each unit than it knows itself"
    table = Table(title=title, title_justify="left", box=None, padding=(0, 1))
    for column in ("unit", "closure alone", "white floor", "own excess", "unit minus mean", "scale, ppm: alone", "array"):
        table.add_column(column, justify="right", overflow="fold")
    for unit in fit.units:
        own, sigma = (part / DEG for part in unit.own_rad)
        diagonal = [0, 4, 8]
        alone, array = (float(np.sqrt(np.mean(s[diagonal] ** 2))) * 1e6 for s in (unit.sigma_alone, unit.sigma))
        table.add_row(
            str(unit.number),
            f"{unit.closure_rad / DEG:.4f}",
            f"{unit.floor_rad / DEG:.4f}",
            f"{own:.4f} ± {sigma:.4f}",
            f"{unit.minus_mean_rad / DEG:.4f}",
            f"± {alone:.0f}",
            f"± {array:.0f}",
        )
    split = fit.split
    table.add_row("all", "", "", f"common {split.common / DEG:.4f}", f"{split.minus_mean_rad / DEG:.4f}", "", "", style="bold")
    return table


def _bias_words(fit: ArrayFit) -> str:
    where = {"ends": "from the ends of the turns", "stills": "of each turn from the stills around it"}[fit.bias]
    why = "as asked" if fit.bias_p is None else f"the stills are better by chance with p = {fit.bias_p:.2g}"
    turns = sum(len(rows) for rows in fit.same.turns)
    return f"Biases {where} ({why}). {turns} turns of {len(fit.units)} units, {len(fit.same.spans)} of the body."


def _fused_words(model: ArrayModel) -> str:
    """Describe the fused noise with the units' own, and the gain of as many equal units."""
    own = [1e3 * float(np.sqrt(np.mean(np.diag(unit.in_array(unit.noise_density))))) / DEG for unit in model.units]
    fused, alone = 1e3 * float(np.sqrt(np.mean(model.noise_density**2))) / DEG, float(np.sqrt(np.mean(np.square(own))))
    count = len(model)
    return (
        f"All units as one gyroscope: {fused:.3g} mdps/rtHz of white noise, as far as they do not share it, where one has "
        f"{min(own):.3g} to {max(own):.3g}, rms {alone:.3g}: {alone / fused:.2f} times less than rms; {count} equal ones would have "
        f"{np.sqrt(count):.2f} times less."
    )


def event_words(event: ArrayEvent, fit: ArrayFit) -> str:
    """Describe an event, the units it belongs to, and its treatment."""
    at = fit.same.time_s[event.first, 1 if "turn" in event.what else 0] - begins_s(fit)
    if event.what == COMMON_TURN:
        return f"{at:.1f} s: all units miss this turn by {event.size / DEG:.2g}°: a knock or the motion, no unit's reading"
    if event.what == COMMON_STILL:
        return f"{at:.1f} s: all units feel {1e3 * event.size / G:.2g} mg in this still: the body was not at rest"
    assert event.unit is not None
    number = fit.units[event.unit].number
    if event.rival is not None:
        both = f"units {number} and {fit.units[event.rival].number}"
        size = f"{event.size / DEG:.2g}°" if event.what == OWN_TURN else f"{1e3 * event.size / G:.2g} mg"
        where = "turn" if event.what == OWN_TURN else "still"
        return f"{at:.1f} s: {both} differ by {size} in this {where}, and two do not tell which one errs; unit {number}'s does not count"
    spoilt = event.together(fit.joint.events)
    others = len(fit.units) - len(spoilt)
    if len(spoilt) > 1:
        return f"{at:.1f} s: {_several_words(spoilt, fit)}"
    whom = f"the other {others} do not" if others > 1 else "the other does not"
    if event.what == OWN_TURN:
        return f"{at:.1f} s: unit {number} misses this turn by {event.size / DEG:.2g}°, {whom}: its own readings; its turn does not count"
    return f"{at:.1f} s: unit {number} feels {1e3 * event.size / G:.2g} mg too much in this still, {whom}; its gravity there does not count"


def event_lines(fit: ArrayFit) -> list[str]:
    """Return a line for each event; one line for several units with events in one turn or still."""
    return list(dict.fromkeys(event_words(event, fit) for event in fit.joint.events))


def _several_words(events: tuple[ArrayEvent, ...], fit: ArrayFit) -> str:
    turn = events[0].what == OWN_TURN
    in_order = sorted(events, key=lambda event: fit.units[event.unit or 0].number)
    sizes = (f"{e.size / DEG:.2g}°" if turn else f"{1e3 * e.size / G:.2g} mg" for e in in_order)
    who = ", ".join(f"unit {fit.units[e.unit or 0].number} by {size}" for e, size in zip(in_order, sizes, strict=True))
    where, lost = ("turn", "their turns do not count") if turn else ("still", "their gravity there does not count")
    return (
        f"{len(events)} of {len(fit.units)} units stand out in this {where}, each in its own way ({who}): several at once are hardly "
        f"their own readings: a blow that each unit feels or samples otherwise is more probable; {lost}"
    )


# Terminal output of an array's explanation.

VERDICTS = {
    "no_mismatch": "no mismatch: every unit turns as its calibration says",
    "common": "what turns miss by is common to all units: none of the sensors",
    "own": "what turns miss by is the units' own",
    "common_and_own": "part of what turns miss by is common to all units, part is some units' own",
}
#: most events listed one by one
MOST_MOMENTS = 12


def array_verdict_line(found: ArrayExplanation) -> Text:
    """Return one line with the array's verdict."""
    return one_line(f"{found.fit.array.name}: {VERDICTS[found.verdict]}", "bold")


def array_explain_page(found: ArrayExplanation) -> Group:
    """Return the page: the verdict, the common part, the units of each effect, the events, and each unit's own verdict."""
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
