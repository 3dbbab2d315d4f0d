"""The table's own errors in ``explain``: what of a mismatch is the machine's, what the sensor's, and what is not to be told apart.

An engine of its own beside the core's.  The core compares closures with gravity in each still, so its reference is the accelerometer; here
the reference is the machine's word, which errs in every still and within every turn, and its errors are columns of other rows
(``rows.py``).
All of them are small, so everything is linear about a fit of sensor and mounting (``selection.py``); the sensor's effects are the core's
catalogue, by their own columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from session.base.errors import DataError
from session.base.texts import measured
from session.base.units import DEG, DEG_PER_HOUR
from tinygc.closure.problem import Problem
from tinygc.explanation.claims import p_words
from tinygc.features.tables import rows as of
from tinygc.features.tables.machines.angles import NAME as ANGLES
from tinygc.features.tables.machines.angles import read_angles
from tinygc.features.tables.machines.description import NAME as TABLE
from tinygc.features.tables.machines.description import Description, read_description
from tinygc.features.tables.observed import observe
from tinygc.features.tables.rows_noise import AT_REST, IN_TURN, REPEATABILITY, WANDER
from tinygc.features.tables.selection import Named, Selected, select
from tinygc.inference.choose import LEVEL
from tinygc.reporting.terminal import Group, Text, one_line

#: verdicts -> what they say
VERDICTS = {
    "clean": "no error of table or sensor is seen",
    "table": "the table errs",
    "sensor": "the sensor errs, and not the table",
    "both": "table and sensor err",
    "ambiguous": "sensor or table: these attitudes do not tell",
    "suspected": "a mismatch is suspected; noise alone shows as much in a share p of clean sessions",
    "unexplained": "they disagree, and no known error is shown to account for it",
    "undecided": "not decided",
}
#: what each error says to a person
SAYS = {
    of.INDEX: "the angle is read wrong once and twice a turn, as an encoder off its centre does",
    of.WOBBLE: "the axis wobbles as it turns",
    of.RIPPLE: "the angle runs ahead and behind many times a turn, as a motor's steps or a worm do",
    of.SKEW: "the angle between two axes is another than declared",
    of.TILT: "the base is not level as the description has it",
    of.BACKLASH: "the stage lags behind its motor by a play, on the side from which it comes",
    of.LOST: "the motor has lost steps: all later angles are off by them",
    of.LATENCY: "the machine says its angles late",
    of.DROPPED: "the gyroscope alone misses a part of a turn: samples were lost in it",
}
#: movements that tell an error from what reads the same
SPLITS = {
    of.INDEX: "rest every 30 degrees over a whole turn of that axis",
    of.WOBBLE: "rest every 45 degrees over a whole turn of that axis, once more with the sensor mounted a quarter turn further",
    of.RIPPLE: "turn that axis slowly and fast over the same angles",
    of.SKEW: "rest at many angles of the outer axis with the inner one at right angles",
    of.TILT: "turn the sensor upside down and rest at four headings",
    of.BACKLASH: "come to the same angles from both sides, slowly and fast",
    of.LOST: "put the axis level, where gravity sees its angle, and go back to an earlier angle",
    of.LATENCY: "no movement tells a late word from a late sensor: compare with another sensor, or with the machine's own trigger",
    of.DROPPED: "put the axis level, where gravity sees its angle, and look at the samples' counter",
}
#: single turns with a loss, beyond which another error is as likely as so many losses
MOST_LOSSES = 2
#: p-value above which a mismatch without a name is suspected, and not claimed: chance shows as much in one session of a thousand
CLAIMED_P = 1e-3
OTHERWISE = "repeat the turns both ways, slowly and fast, about each axis of the sensor"


@dataclass(frozen=True, eq=False)
class TableExplanation:
    """What ``explain`` says of a table: its description and what was selected; why nothing could be, else empty."""

    table: Description
    selected: Selected | None
    why_not: str = ""

    @property
    def verdict(self) -> str:
        """A key of ``VERDICTS``."""
        if self.selected is None:
            return "undecided"
        named = self.selected.named
        if self.doubts or (not named and self.selected.first_p <= CLAIMED_P):
            return "unexplained"
        if not named:
            return "suspected" if self.selected.first_p <= LEVEL else "clean"
        sure = [each for each in named if not _crosses(each)]
        if not sure or any(each.candidate.id != of.LATENCY for each in named if each not in sure):
            return "ambiguous"
        whose = {each.candidate.whose for each in sure}
        return "both" if len(whose) > 1 else whose.pop()

    @property
    def doubts(self) -> list[str]:
        """Why what is named cannot be all: sizes of the noise beyond what is declared, and losses in too many turns."""
        selected = self.selected
        if selected is None:
            return []
        sizes, found = selected.noise.sizes, []
        for name, ratio in selected.excess.items():
            words = {
                REPEATABILITY: f"the table repeats {sizes[REPEATABILITY]:.2g} times worse than its axes declare",
                AT_REST: f"the accelerometer scatters by {1e3 * sizes[AT_REST]:.2g} mg from rest to rest",
                IN_TURN: f"turns scatter by {sizes[IN_TURN] / DEG:.2g} deg",
            }
            found.append(
                f"{words[name]}, {ratio:.1f} times what is taken to be noise: an error too large for this method, or unknown to it"
            )
        losses = [each for each in selected.named if each.candidate.id in (of.LOST, of.DROPPED)]
        if len(losses) > MOST_LOSSES:
            found.append(
                f"{len(losses)} turns have a loss of their own: either losses are frequent, or another error is unknown to this method"
            )
        return found

    def to_json(self) -> dict[str, Any]:
        """``table`` of ``tinygc-explain/2``."""
        found: dict[str, Any] = {"name": self.table.name, "verdict": self.verdict, "why_not": self.why_not or None}
        selected = self.selected
        if selected is None:
            return found
        sizes = selected.noise.sizes
        return found | {
            "rests": len(selected.observed.said),
            "turns": len(selected.observed.first),
            "p_value": selected.first_p,
            "left_p_value": selected.smallest_p,
            "latency_ms": 1e3 * selected.latency_s,
            "latency_std_ms": 1e3 * selected.latency_sigma_s,
            "noise": {
                "repeatability_of_declared": sizes[REPEATABILITY],
                "bias_wander_dph": sizes[WANDER] / DEG_PER_HOUR,
                "accelerometer_mg": 1e3 * sizes[AT_REST],
                "gyroscope_turn_deg": sizes[IN_TURN] / DEG,
                "word_jitter_ms": 1e3 * float(selected.noise.word[0]),
                "word_resolution_deg": float(selected.noise.word[1]) / DEG,
                "word_wander_ms": 1e3 * float(selected.noise.word[3]),
                "word_wander_s": float(selected.noise.word[4]),
            },
            "effects": [self._effect(each) for each in selected.named],
            "undecided": [
                {"id": id, "where": where, "detection_limit": limit, "unit": unit} for id, where, limit, unit in limits_of(selected)
            ],
            "doubts": self.doubts,
            "suspected": list(selected.suspected),
            "inseparable": [
                {"id": id, "where": where, "hidden_in": list(hidden), "movement": SPLITS.get(id, OTHERWISE)}
                for id, where, hidden in inseparable_of(selected)
            ],
        }

    def _effect(self, named: Named) -> dict[str, Any]:
        candidate = named.candidate
        return {
            "id": candidate.id,
            "whose": candidate.whose,
            "where": candidate.where,
            "shape": candidate.shape,
            "parameters": candidate.values(named.theta),
            "std": candidate.values(named.sigma),
            "p_value": named.p_value,
            "log_evidence": named.log_evidence,
            "equivalent": list(named.equivalent),
            "description": SAYS.get(candidate.id, "an effect of the sensor (docs/formats/effects.md)"),
            "movement": SPLITS.get(candidate.id, OTHERWISE) if named.equivalent else None,
        }

    def page(self) -> Group:
        """The section of the terminal's page."""
        line = Text.assemble(("table ", ""), (self.table.name, "bold"), ": ", VERDICTS[self.verdict])
        selected = self.selected
        if selected is None:
            return Group(Text(""), line.append(f": {self.why_not}"))
        line.append(f"   (p {p_words(selected.first_p)}; {len(selected.observed.said)} rests, {len(selected.observed.first)} turns)")
        parts: list[Any] = [Text(""), line]
        for each in selected.named:
            parts += self._lines(each)
        parts += [one_line(f"  {each}") for each in self.doubts]
        if not selected.named and selected.suspected:
            parts.append(one_line(f"  suspected, and not shown: {', '.join(selected.suspected)}"))
        seen = [f"{id.removeprefix('table.')} {where} {limit:.2g} {unit}" for id, where, limit, unit in limits_of(selected)]
        if seen:
            parts.append(one_line(f"  not seen, and would be from: {'; '.join(seen)}"))
        late = measured(1e3 * selected.latency_s, 1e3 * selected.latency_sigma_s)
        parts.append(Text(f"  the machine's word is {late} ms late against the sensor, its filter and stamps included"))
        sizes = selected.noise.sizes
        jitter_ms, wander_ms = (1e3 * float(selected.noise.word[number]) for number in (0, 3))
        stamps = f"stamps of the word scatter by {jitter_ms:.2g} ms and wander by {wander_ms:.2g} ms"
        parts.append(Text(f"  repeatability {sizes[REPEATABILITY]:.2g} of what the axes declare; {stamps}"))
        for id, where, hidden in inseparable_of(selected):
            split = SPLITS.get(id, OTHERWISE)
            parts.append(one_line(f"  inseparable here: a part of {id} ({where}) from {', '.join(hidden)}; {split}"))
        return Group(*parts)

    def _lines(self, named: Named) -> list[Any]:
        candidate = named.candidate
        values, sigmas = candidate.values(named.theta), candidate.values(named.sigma)
        shape = ", ".join(f"{key} {value}" for key, value in candidate.shape.items() if key not in ("axis", "turn"))
        head = f"   {candidate.where}{', ' if shape and candidate.where else ''}{shape}   p {p_words(named.p_value)}"
        lines: list[Any] = [Text.assemble((f"  {candidate.id}", "bold cyan"), head)]
        lines.append(one_line(f"    {SAYS.get(candidate.id, 'an effect of the sensor')}"))
        for name, value in values.items():
            lines.append(Text(f"    {name}: {_with_sigmas(value, sigmas[name])}"))
        if named.equivalent:
            lines.append(Text(f"    could as well be: {', '.join(named.equivalent)}", "yellow"))
            lines.append(one_line(f"    to tell: {SPLITS.get(candidate.id, OTHERWISE)}"))
        return lines


def _crosses(named: Named) -> bool:
    """Whether table and sensor both could have it."""
    other = of.SENSOR if named.candidate.whose == of.TABLE else of.TABLE
    return any((of.TABLE if id.startswith("table.") else of.SENSOR) == other for id in named.equivalent)


def _with_sigmas(value: float | Sequence[float], sigma: float | Sequence[float]) -> str:
    if isinstance(value, float) and isinstance(sigma, float):
        return measured(value, sigma)
    assert isinstance(value, Sequence) and isinstance(sigma, Sequence)  # noqa: PT018
    return "   ".join(measured(v, s) for v, s in zip(value, sigma, strict=True))


def limits_of(selected: Selected) -> list[tuple[str, str, float, str]]:
    """Of each error of a table that is not named: id, where, the size that would have been seen with 90 % probability, unit of its size.

    Of many forms of one error, the one that is seen the least.
    """
    found: dict[tuple[str, str], tuple[float, str]] = {}
    named = {(each.candidate.id, each.candidate.where) for each in selected.named}
    for candidate, limit in selected.limits:
        key = (candidate.id, "any turn" if candidate.id == of.LOST else candidate.where)
        if candidate.whose != of.TABLE or (candidate.id, candidate.where) in named or not limit > 0:
            continue
        name, si, _ = candidate.parts[0]
        if key not in found or limit / si > found[key][0]:
            found[key] = (limit / si, name.rsplit("_", 1)[1])
    return [(id, where, limit, unit) for (id, where), (limit, unit) in found.items()]


def inseparable_of(selected: Selected) -> list[tuple[str, str, tuple[str, ...]]]:
    """Errors of a table of which a part is hidden in what is always free: id, where, and the parts of the calibration that take it up."""
    found: dict[tuple[str, str], tuple[str, ...]] = {}
    for candidate, parts in selected.unseen:
        if candidate.whose == of.TABLE and parts and candidate.id != of.RIPPLE:
            where = "any turn" if candidate.id == of.LOST else candidate.where
            before = found.get((candidate.id, where), ())
            found[candidate.id, where] = tuple(dict.fromkeys([*before, *parts]))
    return [(id, where, hidden) for (id, where), hidden in found.items()]


def explain_table(problem: Problem, seed: int = 0) -> TableExplanation:
    """The errors of the table that turned a session, by its table.toml and table.csv.  FormatError for what is wrong with either file."""
    folder = problem.session.folder
    table = read_description(folder / TABLE)
    angles = read_angles(folder / ANGLES, table)
    try:
        return TableExplanation(table, select(observe(problem, table, angles), seed))
    except DataError as error:
        return TableExplanation(table, None, str(error))
    except np.linalg.LinAlgError:
        why = f"{ANGLES} and the sensor are too far apart for any small error; are axes, senses and mounting of {TABLE} right?"
        return TableExplanation(table, None, why)
