"""The table's own errors in ``explain``: what of a mismatch is the machine's, what the sensor's, and what cannot be separated.

In addition to the twin of ``explain``, whose reference is the accelerometer: here the reference is the machine's word, which has errors in
every still and within every turn, and they are columns of other rows (``rows.py``).  The sensor's effects are those of the catalogue, by
their own columns; all compete in one search (``selection.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from session.base.errors import DataError
from session.base.texts import measured, probability, significant
from session.base.units import DEG, DEG_PER_HOUR
from tinygc.closure.problem import Problem
from tinygc.features.tables import rows as of
from tinygc.features.tables.machines.angles import NAME as ANGLES
from tinygc.features.tables.machines.angles import read_angles
from tinygc.features.tables.machines.description import NAME as TABLE
from tinygc.features.tables.machines.description import Description, read_description
from tinygc.features.tables.observed import observe
from tinygc.features.tables.rows_noise import AT_REST, IN_TURN, REPEATABILITY, RESOLUTION, WANDER
from tinygc.features.tables.selection import Named, Selected, select
from tinygc.inference.choose import LEVEL
from tinygc.inference.decide import KINDS
from tinygc.reporting.drawing import Panel
from tinygc.reporting.explanation_text import parameter_lines

#: what each error means to a person, and the movement that separates it from what reads the same
MEANINGS = {
    of.INDEX: (
        "the angle is read wrong once and twice a turn, as an encoder off its centre does",
        "rest every 30 degrees over a whole turn of that axis",
    ),
    of.WOBBLE: (
        "the axis wobbles as it turns",
        "rest every 45 degrees over a whole turn of that axis, once more with the sensor mounted a quarter turn further",
    ),
    of.RIPPLE: (
        "the angle runs ahead and behind many times a turn, as a motor's steps or a worm do",
        "turn that axis slowly and fast over the same angles",
    ),
    of.SKEW: (
        "the angle between two axes is another than declared",
        "rest at many angles of the outer axis with the inner one at right angles",
    ),
    of.TILT: ("the base is not level as the description has it", "turn the sensor upside down and rest at four headings"),
    of.BACKLASH: (
        "the stage lags behind its motor by a play, on the side from which it comes",
        "come to the same angles from both sides, slowly and fast",
    ),
    of.LOST: (
        "the motor has lost steps: all later angles are off by them",
        "put the axis level, where gravity sees its angle, and go back to an earlier angle",
    ),
    of.LATENCY: (
        "the machine reports its angles late",
        "no movement separates a late word from a late sensor: compare with another sensor, or with the machine's own trigger",
    ),
    of.DROPPED: (
        "the gyroscope alone misses a part of a turn: samples were lost in it",
        "put the axis level, where gravity sees its angle, and look at the samples' counter",
    ),
}
#: the same of an effect of the catalogue
OTHERWISE = (
    "an effect of the sensor (docs/formats/effects.md)",
    "repeat the turns both ways, slowly and fast, about each axis of the sensor",
)
#: single turns with a loss, beyond which another error is as likely as so many losses
MOST_LOSSES = 2
#: p-value above which a mismatch without a name is suspected, and not claimed: chance shows as much in one session of a thousand
CLAIMED_P = 1e-3


@dataclass(frozen=True, eq=False)
class TableShown:
    """What a table adds to ``explain``: its description and what was selected; why nothing could be, else empty."""

    panels: ClassVar[tuple[Panel, ...]] = ()
    table: Description
    selected: Selected | None
    why_not: str = ""

    @property
    def verdict(self) -> str:
        """Of ``KINDS``."""
        if self.selected is None:
            return "undecided"
        named = self.selected.named
        if self.doubts or (not named and self.selected.first_p <= CLAIMED_P):
            return "partly_explained" if named else "unexplained"
        if not named:
            return "suspected" if self.selected.first_p <= LEVEL else "clean"
        # Table and sensor both could have it.
        either = [each for each in named if len({of.whose(id) for id in (each.candidate.id, *each.equivalent)}) > 1]
        if len(either) == len(named) or any(each.candidate.id != of.LATENCY for each in either):
            return "ambiguous"
        whose = {of.whose(each.candidate.id) for each in named if each not in either}
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
                REPEATABILITY: f"the table repeats {significant(sizes[REPEATABILITY], 2)} times worse than its axes declare",
                AT_REST: f"the accelerometer scatters by {significant(1e3 * sizes[AT_REST], 2)} mg from rest to rest",
                IN_TURN: f"turns scatter by {significant(sizes[IN_TURN] / DEG, 2)} deg",
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
        return {"table": self._to_json()}

    def _to_json(self) -> dict[str, Any]:
        found: dict[str, Any] = {"name": self.table.name, "verdict": self.verdict, "why_not": self.why_not or None}
        selected = self.selected
        if selected is None:
            return found
        sizes, (jitter_s, wander_s, time_s) = selected.noise.sizes, selected.noise.stamps
        return found | {
            "rests": len(selected.observed.reported),
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
                "word_jitter_ms": 1e3 * jitter_s,
                "word_resolution_deg": sizes[RESOLUTION] / DEG,
                "word_wander_ms": 1e3 * wander_s,
                "word_wander_s": time_s,
            },
            "effects": [self._effect(each) for each in selected.named],
            "undecided": [
                {"id": id, "where": where, "detection_limit": limit, "unit": unit}
                for (id, where), (limit, unit) in selected.limits.items()
                if of.whose(id) == of.TABLE
            ],
            "doubts": self.doubts,
            "suspected": list(selected.suspected),
            "inseparable": [
                {"id": id, "where": where, "hidden_in": list(hidden), "movement": MEANINGS.get(id, OTHERWISE)[1]}
                for (id, where), hidden in selected.hidden.items()
                if of.whose(id) == of.TABLE and hidden and id != of.RIPPLE
            ],
        }

    def _effect(self, named: Named) -> dict[str, Any]:
        candidate = named.candidate
        meaning, movement = MEANINGS.get(candidate.id, OTHERWISE)
        return {
            "id": candidate.id,
            "whose": of.whose(candidate.id),
            "where": candidate.where,
            "shape": candidate.shape,
            "parameters": candidate.values(named.theta),
            "std": candidate.values(named.sigma),
            "p_value": named.p_value,
            "log_evidence": named.log_evidence,
            "equivalent": list(named.equivalent),
            "description": meaning,
            "movement": movement if named.equivalent else None,
        }

    @property
    def brief(self) -> list[str]:
        """Its line of the first screen."""
        return [self.rows[0][1]]

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Subject of each line of the page (empty: the same as above), and its statement: what the JSON has."""
        shown, verdict = self._to_json(), f"{self.table.name}: {KINDS[self.verdict].word}"
        if self.selected is None:
            return [("table", f"{verdict}: {self.why_not}")]
        rows = [("table", f"{verdict} ({probability(shown['p_value'])}; {shown['rests']} rests, {shown['turns']} turns)")]
        for each in shown["effects"]:
            shape = (f"{key} {value}" for key, value in each["shape"].items() if key not in ("axis", "turn"))
            rows.append(
                (each["id"], ", ".join(filter(None, (each["where"], *shape, f"{probability(each['p_value'])}: {each['description']}"))))
            )
            rows += [("", words) for words in parameter_lines(each["parameters"], each["std"])]
            if each["equivalent"]:
                rows.append(("", f"could as well be {', '.join(each['equivalent'])}; to separate them: {each['movement']}"))
        rows += [("", words) for words in shown["doubts"]]
        if not shown["effects"] and shown["suspected"]:
            rows.append(("", f"suspected, and not shown: {', '.join(shown['suspected'])}"))
        seen = [
            f"{each['id'].removeprefix('table.')} {each['where']} {significant(each['detection_limit'], 2)} {each['unit']}"
            for each in shown["undecided"]
        ]
        limits = [f"not seen, and would be from: {'; '.join(seen)}"] if seen else []
        limits += [
            f"inseparable here: a part of {each['id']} ({each['where']}) from {', '.join(each['hidden_in'])}; {each['movement']}"
            for each in shown["inseparable"]
        ]
        rows += zip(["limits", *[""] * len(limits)], limits, strict=False)
        late, noise = measured(shown["latency_ms"], shown["latency_std_ms"]), shown["noise"]
        rows.append(("word", f"{late} ms late against the sensor, its filter and stamps included"))
        jitter, wander = (significant(noise[f"word_{name}_ms"], 2) for name in ("jitter", "wander"))
        rows.append(("", f"its stamps scatter by {jitter} ms and wander by {wander} ms"))
        return [*rows, ("", f"repeatability {significant(noise['repeatability_of_declared'], 2)} of what the axes declare")]


def explain_table(problem: Problem, seed: int = 0) -> TableShown:
    """The errors of the table that turned a session, by its table.toml and table.csv.  FormatError for what is wrong with either file."""
    folder = problem.session.folder
    table = read_description(folder / TABLE)
    angles = read_angles(folder / ANGLES, table)
    try:
        return TableShown(table, select(observe(problem, table, angles), seed))
    except DataError as error:
        return TableShown(table, None, str(error))
    except np.linalg.LinAlgError:
        why = f"{ANGLES} and the sensor are too far apart for any small error; are axes, senses and mounting of {TABLE} right?"
        return TableShown(table, None, why)
