"""An explanation as facts for terminal and page, whatever its reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from session.base.texts import measured, probability
from session.base.units import DEG, MG
from tinygc.effects.effect import IN_STILLS
from tinygc.explanation.claims import LEFT
from tinygc.explanation.decision import tilt_rms
from tinygc.explanation.engine import Explanation
from tinygc.explanation.result import (
    HEADING,
    chance_words,
    considered_lines,
    equivalent_words,
    families_of,
    is_refitted,
    noise_rows,
    residual_table,
    rival_words,
    what_next,
    where,
)
from tinygc.explanation.search import lines_end_hz
from tinygc.noise.turn_gravity import TurnGravity
from tinygc.noise.twin import Variable
from tinygc.reporting.explanation_screen import headline, limits
from tinygc.reporting.facts import Part, Table
from tinygc.reporting.terminal import Text, one_line

MOST_SEGMENTS = 6  #: number of segments listed, worst first


def explanation_facts(e: Explanation, panels: Sequence[Part] = (), with_next: bool = True) -> list[Part]:
    """Facts of an explanation: verdict, effects with their parameters, residuals, evidence and, if ``with_next``, what to do next; panels:
    for a page."""
    parts: list[Part] = [*headline(e), *([] if e.decision is None else [one_line(f"fit: {e.decision.headline}", "dim")]), ""]
    among = " among the catalogue's effects" if e.verdict in LEFT else ""
    # Warnings of the first look come before findings without a name: they are the likelier cause.
    for warning in e.warnings:
        parts += [Text(f"First look: {warning.where}: {warning.what}: {warning.says}; {warning.do}", "yellow"), ""]
    for family in families_of(e):
        parts += [family.words, ""]
    for claim, style in (*((claim, "bold cyan") for claim in e.claimed), *((claim, "bold magenta") for claim in e.findings)):
        named = style == "bold cyan"
        chance = f"   probability {chance_words(claim.probability)}{among * named}, {probability(claim.p_value, claim.p_is_bound)}"
        share = "" if named else f"; it carries {100 * (claim.share or 0):.0f} % of the misfit"
        parts += [Text.assemble((f"{claim.effect.id}  ", style), claim.effect.equation, chance), f"  {claim.description}{share}"]
        parts += [f"  {line}" for line in parameter_lines(claim.parameters, claim.std) if named]
        if claim.equivalent:
            parts.append(Text(f"  fit as well: {', '.join(equivalent_words(claim))}", "yellow"))
        parts += [*([f"  alternatives: {', '.join(rivals)}"] if (rivals := rival_words(claim)) else []), ""]
    parts += [Text(HEADING, "italic"), channels_table(e), *panels]
    parts += [] if e.gravity is None else [_gravity(e.gravity), _stamps(e)]
    parts += [*([] if e.shown is None else [Table("", ("", ""), e.shown.rows, left=(0, 1))]), ""]
    # Candidates that were detected or weighed, and rejected.
    lines = considered_lines(e)
    parts += ["considered, and rejected:", *(f"  {line}" for line in lines)] if lines else []
    if e.verdict == "unexplained" and (highest := lines_end_hz(e.twin)) is not None:
        parts.append(f"not searched: lines of the rate above {highest:.2g} Hz, too many in so long a session")
    if rows := noise_rows(e):
        parts.append(Table("estimated non-white noise", ("component", "± one sigma", "what it is"), rows, left=range(3)))
    if not e.problem.instability.source.startswith("typical"):
        parts.append(f"bias instability, the prior of `noise.bias_wander`: {e.problem.instability.words}")
    parts += [e.problem.at_rest.words] if e.problem.at_rest is not None and e.problem.at_rest.words else []
    parts += [*(["; ".join(place)] if (place := where_words(e)) else []), _proof(e)]
    parts += limits(e, len(e.detection_limits)) if e.verdict == "no_mismatch" else []
    return parts + ([Text.assemble(("next: ", "bold"), following)] if with_next and (following := what_next(e)) else [])


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


def channels_table(e: Explanation) -> Table:
    """Table of channels: root mean square of recording less prediction, in sigmas of the channel's noise."""
    rows = [(channel, values, *(f"{rms:.2f}" for rms in shown)) for channel, values, shown in residual_table(e)]
    return Table("", ("channel", "values", *(("before", "after") if is_refitted(e) else ("rms",))), rows)


def _stamps(e: Explanation) -> Text:
    """Compare registers and stamps with the prediction, which has no false reading and one sample per period."""
    longest = max(float(log.samples.dt_s.max() / log.samples.period_s) for log in e.problem.logs)
    repaired = [claim.effect for claim in e.claimed if claim.effect.id in e.repaired.found]
    found = [effect.id for effect in repaired if effect.occurs is None or effect.occurs.counts != IN_STILLS]
    registers = ", ".join(found) or "no clipping, no false readings, no lost samples"
    return Text(f"registers: {registers}; stamps: longest interval {longest:.2f} periods")


def _gravity(gravity: TurnGravity) -> Text:
    lever = ", ".join(f"{1e3 * x:.0f}" for x in gravity.lever_m)
    return Text(
        f"gravity during the turns: off by {gravity.before_mps2 / MG:.1f} mg rms; {gravity.after_mps2 / MG:.1f} mg with a lever arm of "
        f"{lever} mm and the gyro {1e3 * abs(gravity.offset_s):.2f} ms {'late' if gravity.offset_s > 0 else 'early'}"
        + ("" if gravity.is_offset else f" ± {1e3 * gravity.whole_sigma_s:.2f}, reported from {1e3 * gravity.bar_s:.1f} on")
    )


def where_words(e: Explanation) -> list[str]:
    """Where the mismatch lives: phases, axes, range, times, and the worst segments; empty where it is unknown."""
    place = where(e)
    if not place["phases"]:
        return []
    words = [f"where: {', '.join(place['phases'])}"]
    if place["axes"]:
        words.append(f"axes {', '.join(place['axes'])}")
    words += [text for text in (variable_words(place["conditions"]), seconds_words(place["seconds"])) if text]
    if place["segments"]:
        worst = zip(place["segments"][:MOST_SEGMENTS], place["segment_seconds"], strict=False)
        words.append("worst segments " + ", ".join(f"{number} ({start:.0f}–{stop:.0f} s)" for number, (start, stop) in worst))
    return words


def variable_words(regime: dict | None) -> str:
    """Range of the variable, such as ``gravity along x −0.98 to 1 g``; empty without a range, or if the variable is time."""
    if regime is None or regime["variable"] == "time":
        return ""
    words = Variable(regime["variable"], "xyz".index(regime["axis"]) if "axis" in regime else None).words
    return f"{words} {regime['from']:.3g} to {regime['to']:.3g} {regime['units']}".replace("-", "−")


def seconds_words(seconds: list[float] | None) -> str:
    """Time range, such as ``from 3.2 to 154.7 s``, or an empty text."""
    return "" if seconds is None else f"from {seconds[0]:.1f} to {seconds[1]:.1f} s"


def _proof(e: Explanation) -> Text:
    before, after, floor = (x / DEG for x in (tilt_rms(e.proof.before), tilt_rms(e.proof.after), e.proof.floor_rms))
    if not e.proof.changed:
        return Text(f"held-out closure: {before:.4f}°, floor {floor:.4f}°")
    removed = "" if e.proof.removed is None else f"; {100 * e.proof.removed:.1f} % of the excess is gone"
    if e.proof.removed is not None and e.proof.removed <= 0:
        removed = "; closure is no better with what is named"
    if e.proof.worse:
        removed = f"; closure is worse with what is named, {tilt_rms(e.proof.named) / DEG:.4f}°: the model stays without it"
    return Text(f"held-out closure: {before:.4f}° before, {after:.4f}° after, floor {floor:.4f}°{removed}")
