"""The first screen of an explanation: the answer, the closure, each effect with its size, what would have shown, what to do next.

It fits 80 columns and 24 lines; ``explain --verbose`` and the report have the rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

import numpy as np

from session.base.numeric import rms_of
from session.base.texts import command_line, listed, measured, printable, probability, significant
from session.base.units import DEG
from tinygc.effects import catalogue
from tinygc.effects.effect import Derived
from tinygc.explanation.claims import Claim
from tinygc.explanation.decision import tilt_rms
from tinygc.explanation.engine import Explanation
from tinygc.explanation.families import SLOW_ZERO
from tinygc.explanation.result import families_of
from tinygc.inference.decide import KINDS
from tinygc.reporting.facts import Part, Table
from tinygc.reporting.terminal import Text, one_line

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
    parts: list[Part] = [*headline(e), _closure(e), *_looks(e), ""]
    if len(named := [*e.claimed, *e.findings]) > 1:
        parts += [one_line(f"{number}. {_statement(claim)}.") for number, claim in enumerate(named, 1)]
    rows = [row for claim in e.claimed for row in _rows(claim)]
    parts += [one_line(" ".join(row)) for row in rows if len(row) == 3]
    of_axes = [(f"{label}, {unit}", *values) for label, unit, *values in rows if len(values) > 1]
    parts += [Table("", ("", "x", "y", "z"), of_axes)] if of_axes else []
    parts += limits(e) if e.verdict == "no_mismatch" else []
    return parts + ([] if e.shown is None else e.shown.brief)


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
        words = found or (e.words[0])
        return [one_line(f"NOT EXPLAINED: {words}.", style), *([Text(f"Not explained either: {left}.", style)] if left else [])]
    alike = [claim for claim in e.claimed if claim.equivalent]
    fit = f", one of {len(alike[0].equivalent) + 1} that fit" if alike and len(named) == 1 else ""
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
    for family in families_of(e):
        shares = [f"{SLOW_ZERO[name]} ({share:.2f})" for name, share in family.shares.items() if share >= 0.05]
        yield Text(f"It may be {' or '.join(shares)}{'' if family.thermometer else '; temperature was not recorded'}.", "yellow")
    if e.gravity is not None:
        step = f" Gyro and accelerometer in step ({measured(1e3 * e.gravity.offset_s, 1e3 * e.gravity.whole_sigma_s)} ms)."
        lever = ", ".join(f"{1e3 * x:.0f}" for x in e.gravity.lever_m)
        yield Text(f"Lever arm {lever} mm.{'' if e.gravity.is_offset else step}")
        if not e.repaired.found:
            yield Text("No clipping, no lost samples.")
    if e.warnings:
        what = listed(list(dict.fromkeys(warning.what for warning in e.warnings)), 3)
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
    """What to do next: what would decide what is open, else what to do about the effect."""
    do = following or "; ".join(dict.fromkeys(claim.description.partition(": ")[2] for claim in e.claimed if ": " in claim.description))
    return f"next: {do}" if do else "next:"


def next_commands(e: Explanation) -> list[str]:
    """The command that goes on from here, if there is one."""
    if e.session.in_memory:
        return []
    if e.verdict == "no_mismatch":
        return [command_line("report", e.session.folder)]
    named = e.verdict in ("explained", "partly_explained") and any(claim.effect.kind == "rate" for claim in e.proof.fit.state.claims)
    return [command_line("fit", e.session.folder, "--physics", "auto")] if named else []
