"""An explanation as text: the answer, the first screen of the command, and all facts, which ``--verbose`` and the report have.

The first screen fits 80 columns and 24 lines.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from session.base.numeric import rms_of
from session.base.texts import command_line, given_effects, listed, measured, printable, probability, significant
from session.base.units import DEG
from session.detect.first_look import CHANGED
from tinygc.effects import catalogue
from tinygc.effects.effect import Derived
from tinygc.explanation.claims import LEFT, Claim
from tinygc.explanation.decision import tilt_rms
from tinygc.explanation.engine import Explanation
from tinygc.explanation.result import (
    HEADING,
    chance_words,
    equivalent_words,
    families_of,
    is_refitted,
    needs_latitude,
    noise_rows,
    rejected_words,
    residual_table,
    rival_words,
    where,
)
from tinygc.explanation.search import lines_end_hz
from tinygc.inference.decide import KINDS
from tinygc.noise.twin import Variable
from tinygc.reporting.facts import Part, Table
from tinygc.reporting.terminal import Text, one_line

MOST_SEGMENTS = 6  #: number of segments listed, worst first
#: rms, in sigmas, from which slope or scatter of the rate within the stills is more than noise
BEYOND_NOISE = 2.0
#: rows of the smallest errors, those that matter most to an attitude first
MOST_LIMITS = 8
FIRST_LIMITS = (
    *("gyro.thermal_scale", "gyro.scale_asymmetry", "gyro.scale_nonlinearity", "gyro.g_sensitivity", "gyro.thermal_bias"),
    *("gyro.bias_step", "timing.axis_skew", "reference.accelerometer"),
)
#: unit -> a smaller one, and how many there are in it
SMALLER = {"dps": ("mdps", 1e3), "mg": ("µg", 1e3), "fraction": ("%", 1e2), "%": ("ppm", 1e4), "s": ("ms", 1e3), "ms": ("µs", 1e3)}
SMALLER |= {"fraction of full scale": ("% of full scale", 1e2)}


def explanation_screen(e: Explanation) -> list[Part]:
    """Facts of an explanation for its first screen, without what to do next."""
    parts = list[Part]()
    if len(named := [*e.claimed, *e.findings]) > 1:
        parts += [one_line(f"{number}. {_statement(claim)}.") for number, claim in enumerate(named, 1)]
    rows = [row for claim in e.claimed for row in _rows(claim)]
    parts += [one_line(" ".join(row)) for row in rows if len(row) == 3]
    of_axes = [(f"{label}, {unit}", *values) for label, unit, *values in rows if len(values) > 1]
    parts += [Table("", ("", "x", "y", "z"), of_axes)] if of_axes else []
    parts += limits(e) if e.verdict == "no_mismatch" else []
    parts += [] if e.shown is None else e.shown.brief
    return [*_answer(e), *([""] if parts else []), *parts]


def _answer(e: Explanation) -> list[Part]:
    return [*headline(e), _closure(e), *_looks(e)]


def headline(e: Explanation) -> list[Text]:
    """The answer in one line, and what it leaves open."""
    style, named = KINDS[e.verdict].style, [*e.claimed, *e.findings]
    scatter = max((rms_of(sigmas) for sigmas in e.within.values()), default=0.0)
    left = f"within the stills the rate scatters {scatter:.0f} sigma beyond its noise" if scatter > BEYOND_NOISE else ""
    found = "" if not named else _statement(named[0]) if len(named) == 1 else f"{len(named)} effects explain the mismatch"
    if e.verdict == "no_mismatch":
        first = f"OK, but {left}." if left else f"OK: nothing beyond the model shows ({probability(e.p_value)})."
        return [Text(first, style)]
    if e.verdict == "unexplained":
        lines = [one_line(f"NOT EXPLAINED: {found or e.words[0]}.", style)]
        return lines + ([Text(f"Not explained either: {left}.", style)] if left else [])
    alike = [claim for claim in e.claimed if claim.equivalent]
    fit = ", undecided" if alike else ""
    lines = [one_line(f"FOUND{', not all' if left or e.verdict == 'partly_explained' else fit}: {found}.", style)]
    lines += [Text("Something without a name is left.", style)] if e.verdict == "partly_explained" else []
    lines += [Text(f"Not explained: {left}.", style)] if left else []
    for claim in alike:
        instead = f" in place of {plain_name(claim.effect.id)}" if len(named) > 1 else ""
        lines.append(one_line(f"Fit as well{instead}: {', '.join(map(plain_name, claim.equivalent))}.", "yellow"))
    return lines


def plain_name(id: str) -> str:
    """``gyro scale with temperature`` of ``gyro.thermal_scale``."""
    kind, _, name = id.partition(".")
    words = name.replace("_", " ").replace("g sens", "g-sens").replace("g2", "g²")
    if words.startswith("thermal "):
        words = f"{words.removeprefix('thermal ')} with temperature"
    return words if kind in ("timing", "data", "unknown") else f"{kind} {words}"


def _statement(claim: Claim) -> str:
    """What the effect does, without what to do about it."""
    return printable(claim.description.partition(": ")[0])


def _closure(e: Explanation) -> Text:
    """Held-out closure without and with what is named, and what noise leaves."""
    before, after, named = (f"{tilt_rms(angles) / DEG:.4f}°" for angles in (e.proof.before, e.proof.after, e.proof.named))
    floor = f"noise alone leaves {e.proof.floor_rms / DEG:.4f}°."
    if e.proof.worse:
        return Text(f"Held-out closure {before}, with this {named}: the model stays without; {floor}")
    return Text(f"Held-out closure {before}{f' -> {after}' if after != before else ''}; {floor}")


def _looks(e: Explanation) -> Iterator[Text]:
    """What families leave open, gravity in the turns, the registers, and what the first look warned of, a line each."""
    for claim in e.claimed:
        if claim.against_stated is not None:
            yield Text(f"{claim.against_stated.words.partition(': ')[0].capitalize()}.")
    for family in families_of(e):
        yield Text(f"{family.words.capitalize()}.", "yellow")
    if e.gravity is not None:
        late, sigma = 1e3 * e.gravity.offset_s, 1e3 * e.gravity.whole_sigma_s
        apart = f"in step ({measured(late, sigma)} ms)" if abs(late) < 2 * sigma else f"{measured(abs(late), sigma)} ms apart"
        lever = ", ".join(f"{1e3 * x:.0f}" for x in e.gravity.lever_m)
        yield Text(f"Lever arm {lever} mm.{'' if e.gravity.is_offset else f' Gyro and accelerometer {apart}.'}")
        if not e.repaired.found:
            yield Text("No clipping, no lost samples.")
    if warned := [each.what for each in e.warnings if each.level == "warning" and each.what != CHANGED]:
        what = listed(list(dict.fromkeys(warned)), 3)
        yield one_line(f"The first look warns of {what}: see `check`.", "yellow")


def _rows(claim: Claim) -> Iterator[list[str]]:
    """Label, value and unit of each number of a claim, in units of its size; label, unit and three values of a vector, or of a row of a
    matrix."""
    effect = claim.effect
    for name, value in claim.parameters.items():
        if effect.occurs is not None and name == effect.occurs.key and isinstance(value, list):
            yield [plain_name(effect.id), f"at {len(value)}", "moment" if len(value) == 1 else "moments"]
            continue
        if isinstance(value, str) or not np.size(value):
            continue
        label, unit = plain_name(effect.id), name.rpartition("_")[2]
        if name == effect.parameter.name:
            unit = effect.parameter.unit
        elif isinstance(effect.derived, Derived):
            unit = effect.derived.unit
        elif effect.scan is not None:
            label, unit = f"{label}: {effect.scan.name.removesuffix(f'_{effect.scan.unit}')}".replace("_", " "), effect.scan.unit
        values = np.asarray(value, dtype=float)
        factor, unit = in_unit(float(np.abs(values).max()), unit)
        sigmas = np.full_like(values, np.nan) if claim.std.get(name) is None else np.asarray(claim.std[name], dtype=float)
        numbers = np.frompyfunc(measured, 2, 1)(values * factor, sigmas * factor)
        if values.size == 1:
            yield [label, str(numbers), unit]
        elif values.ndim == 1:
            yield [label, unit, *numbers, ""][:5]
        else:
            for axis, row in zip("xyz", numbers, strict=False):
                yield [f"{label} of {axis}", unit, *row, ""][:5]


def in_unit(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which a size is at least one."""
    factor, (first, per, last) = 1.0, unit.replace("1/", "fraction/", 1).partition("/")
    while 0 < size * factor < 1 and first in SMALLER:
        first, times = SMALLER[first]
        factor *= times
    return factor, first + per + last


def limits(e: Explanation, most: int = MOST_LIMITS) -> list[Part]:
    """The smallest errors that would have shown, and what cannot show."""
    known = sorted(e.detection_limits, key=lambda name: (FIRST_LIMITS.index(name) if name in FIRST_LIMITS else MOST_LIMITS, name))
    seen, parts = [name for name in known if isfinite(e.detection_limits[name])], list[Part]()
    rows = [(plain_name(name), *_limit(name, e.detection_limits[name])) for name in seen[:most]]
    more = len(seen) - len(rows)
    title = f"Smallest errors that would have shown{f' ({more} more: --verbose)' if more else ''}"
    parts += [title, Table("", ("", "", ""), rows, left=(0, 2))] if rows else []
    blind = [plain_name(name) for name in known if name not in seen]
    return [*parts, *([one_line(f"This recording cannot show: {', '.join(blind)}.")] if blind else [])]


def _limit(name: str, size: float) -> tuple[str, str]:
    factor, unit = in_unit(size, catalogue()[name].parameter.unit)
    return significant(size * factor, 2), unit


def next_line(e: Explanation, following: str | None) -> str:
    """What to do next: what would decide what is open, else what to do about the effect; empty where there is nothing."""
    dos = [claim.description.partition(": ")[2] for claim in e.claimed if claim.against_stated is None]
    do = following or "; ".join(dict.fromkeys(filter(None, dos)))
    return f"next: {do}" if do else ""


def next_commands(e: Explanation, effects: Sequence[Path] = ()) -> list[str]:
    """The command that goes on from here, if there is one; effects: folders of effects, which it needs, too."""
    if needs_latitude(e) and not e.session.in_memory:
        return [command_line("fit", e.session.folder, "--latitude", "DEG", *given_effects(effects))]
    named = e.verdict in ("explained", "partly_explained") and any(claim.effect.kind == "rate" for claim in e.proof.fit.state.claims)
    words = ("report", e.session.folder) if e.verdict == "no_mismatch" else ("fit", e.session.folder, "--physics", "auto") if named else ()
    return [command_line(*words, *given_effects(effects))] if words and not e.session.in_memory else []


# All facts: what the screen begins with, then each effect with its evidence, residuals, what was rejected, the noise.


def explanation_facts(e: Explanation, panels: Sequence[Part] = ()) -> list[Part]:
    """Facts of an explanation, without what to do next; panels: for a page."""
    parts: list[Part] = [*_answer(e), *([] if e.decision is None else [one_line(f"fit: {e.decision.headline}", "dim")]), ""]
    # Warnings of the first look come before findings without a name: they are the likelier cause.
    for warning in e.warnings:
        parts += [Text(f"First look: {warning.line}", "yellow" if warning.level == "warning" else ""), ""]
    among = " among the catalogue's effects" if e.verdict in LEFT else ""
    for claim, style in (*((claim, "bold cyan") for claim in e.claimed), *((claim, "bold magenta") for claim in e.findings)):
        named = style == "bold cyan"
        of = " of it, or of what fits as well," if claim.equivalent else ""
        chance = f"   probability{of} {chance_words(claim.probability)}{among * named}, {probability(claim.p_value, claim.p_is_bound)}"
        share = "" if named else f"; it carries {100 * (claim.share or 0):.0f} % of the misfit"
        parts += [Text.assemble((f"{claim.effect.id}  ", style), claim.effect.equation, chance), f"  {claim.description}{share}"]
        parts += [f"  {line}" for line in parameter_lines(claim.parameters, claim.std) if named]
        if claim.equivalent:
            parts.append(Text(f"  fit as well: {', '.join(equivalent_words(claim))}", "yellow"))
        parts += [*([f"  alternatives: {', '.join(rivals)}"] if (rivals := rival_words(claim)) else []), ""]
    columns = ("before", "after") if is_refitted(e) else ("rms",)
    rows = [(channel, values, *(f"{rms:.2f}" for rms in shown)) for channel, values, shown in residual_table(e)]
    parts += [Text(HEADING, "italic"), Table("", ("channel", "values", *columns), rows), *panels]
    parts += [*([] if e.shown is None else [Table("", ("", ""), e.shown.rows, left=(0, 1))]), ""]
    if rejected := rejected_words(e):
        parts.append(f"considered, and rejected: {', '.join(rejected)}")
    if e.verdict == "unexplained" and (highest := lines_end_hz(e.twin)) is not None:
        parts.append(f"not searched: lines of the rate above {significant(highest, 2)} Hz, too many in so long a session")
    if components := noise_rows(e):
        parts.append(Table("estimated non-white noise", ("component", "± one sigma", "what it is"), components, left=range(3)))
    if not e.problem.instability.source.startswith("typical"):
        role = "by the stills alone" if e.problem.instability.of_unit else "the prior of `noise.bias_wander`"
        parts.append(f"bias instability, {role}: {e.problem.instability.words}")
    parts += [e.problem.at_rest.words] if e.problem.at_rest is not None and e.problem.at_rest.words else []
    parts += [place] if (place := _where(e)) else []
    return parts + (limits(e, len(e.detection_limits)) if e.verdict == "no_mismatch" else [])


def parameter_lines(parameters: Mapping[str, Any], stds: Mapping[str, Any]) -> list[str]:
    """Parameters and their standard deviations as ``name: value ± std``, a matrix by rows."""
    lines = []
    for name, value in parameters.items():
        std = stds.get(name)
        rows = value if isinstance(value, list) and value and isinstance(value[0], list) else [value]
        spreads = std if isinstance(std, list) and std and isinstance(std[0], list) else [std]
        for i, row in enumerate(rows):
            spread = spreads[i] if i < len(spreads) else None
            lines.append(f"{name if i == 0 else ' ' * len(name)}: {_numbers(row, spread)}")
    return lines


def _numbers(value: Any, std: Any) -> str:
    if not isinstance(value, list):
        return str(value) if isinstance(value, int | str) else measured(value, std)  # a text describes the numbers
    if not isinstance(std, list) or len(std) != len(value):
        shown = ", ".join(f"{v:.10g}" for v in value[:16])
        return shown + (f", … ({len(value)})" if len(value) > 16 else "")
    return "   ".join(measured(v, s) for v, s in zip(value, std, strict=True))


def _where(e: Explanation) -> str:
    """Phases, axes, range and times of the mismatch, and the worst segments."""
    place = where(e)
    if not place["phases"]:
        return ""
    words, at = [f"where: {', '.join(place['phases'])}"], place["conditions"]
    words += [f"axes {', '.join(place['axes'])}"] if place["axes"] else []
    if at is not None and at["variable"] != "time":
        variable = Variable(at["variable"], "xyz".index(at["axis"]) if "axis" in at else None).words
        words.append(f"{variable} {significant(at['from'])} to {significant(at['to'])} {at['units']}")
    words += [] if place["seconds"] is None else [f"from {place['seconds'][0]:.1f} to {place['seconds'][1]:.1f} s"]
    worst = zip(place["segments"][:MOST_SEGMENTS], place["segment_seconds"], strict=False)
    listing = ", ".join(f"{number} ({start:.0f}–{stop:.0f} s)" for number, (start, stop) in worst)
    return "; ".join([*words, *([f"worst segments {listing}"] if listing else [])])
