"""Detection limits of a user's own recording, by injection and blind test."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.io.errors import DataError
from tinygc.annexes.challenge.examination import SEALED, SESSIONS, Seal, asked_blind, explained, new_folder, opened, seal
from tinygc.annexes.challenge.other_effects import OUTSIDERS
from tinygc.annexes.challenge.recording import STRONG, HostRecording, InjectionTrial, draw_trials, inject, recording_of, write_spoilt
from tinygc.annexes.challenge.score import NAMELESS, score
from tinygc.effects import catalogue
from tinygc.explanation.decision import SAID
from tinygc.reporting.terminal import Group, Table, Text

# The size from which a recording reports each injected effect, compared with the detection limit of ``explain``.

#: a detection limit is confirmed within the step between two sizes that are tried
AGREES = 2.0
#: multiple of the detection limit from which on an effect should be found; a little less, for the rounding of sizes
EXPECTED = 1.999
#: the delay between the clocks is measured whether it is named or not: sigmas from which on it is the recording's, and within which a
#: copy's is the same
DELAY, DELAY_SIGMAS = "timing.gyro_accel_offset", 2.0
#: never wrong, since the Earth turns; where a latitude is given it is no candidate
EARTH = "earth.rotation"


@dataclass(frozen=True)
class Tried:
    """One size: whether the effect was found (named, or among the equivalents of a name; outside the catalogue: seen); reported ids, the
    wrong ones of them, and the untouched recording's own that are missing."""

    size: float
    found: bool
    named: tuple[str, ...]
    wrong: tuple[str, ...]
    lost: tuple[str, ...]


@dataclass(frozen=True)
class Power:
    """Detection of one effect: sizes that were tried, rising, in ``unit``; detection_limit, or None."""

    id: str
    unit: str
    detection_limit: float | None
    tried: tuple[Tried, ...]

    @property
    def detected_from(self) -> float | None:
        """The smallest size from which it was found at every size; None where the largest was not."""
        smallest = None
        for each in reversed(self.tried):
            if not each.found:
                break
            smallest = each.size
        return smallest

    @property
    def ratio(self) -> float | None:
        """Measured over predicted detection limit."""
        return None if self.detected_from is None or not self.detection_limit else self.detected_from / self.detection_limit

    @property
    def undetected_at(self) -> float | None:
        """The largest size at which it was not found; None where it was found at every size that was tried."""
        return max((each.size for each in self.tried if not each.found), default=None)

    @property
    def agrees(self) -> bool | None:
        """Whether the measured detection limit, which is between ``undetected_at`` and ``detected_from``, is within a factor of two of the
        predicted one; None where these two do not decide it, or none was predicted."""
        if not self.detection_limit:
            return None
        above, least, most = self.undetected_at or 0.0, self.detection_limit / AGREES, self.detection_limit * AGREES
        at_most = math.inf if self.detected_from is None else self.detected_from
        if at_most <= least or above >= most:
            return False
        return True if least <= above and at_most <= most else None


def reported_names(said: dict) -> set[str]:
    """Names of an explanation, with their equivalents."""
    return {name for claim in (*said["effects"], *said.get("findings", ())) for name in (claim["id"], *claim["equivalent"])}


def own_names(untouched: dict) -> set[str]:
    """Names reported for the untouched recording, and those that it weighs as high as a name."""
    return reported_names(untouched) | {one["id"] for one in untouched.get("considered", ()) if one["probability"] >= SAID}


def not_tried(untouched: dict) -> set[str]:
    """Effects of rates and forces that ``explain`` does not try here, such as another calibration of an accelerometer that is calibrated
    by the session's own stills."""
    return {name for name, effect in catalogue().items() if effect.kind in ("rate", "force")} - untouched["detection_limits"].keys()


def same_delay(untouched: dict, said: dict) -> bool:
    """Whether the untouched recording measures a delay between the clocks, named or not, and a copy measures the same one."""
    before, after = (answer.get("turn_gravity") for answer in (untouched, said))
    if not before or not after:
        return False
    limit_s = DELAY_SIGMAS * before["offset_std_s"]
    return abs(before["offset_s"]) > limit_s and abs(after["offset_s"] - before["offset_s"]) < limit_s


def powers(trials: list[InjectionTrial], said: dict[str, dict], untouched: dict) -> list[Power]:
    """Detection by effect.  Neither right nor wrong are names of the untouched recording, a delay that it measures, and the Earth."""
    own = own_names(untouched)
    groups: dict[tuple[str, str, float | None], list[Tried]] = {}
    for trial in sorted(trials, key=lambda trial: trial.size):
        groups.setdefault((trial.id, trial.unit, trial.detection_limit), []).append(_tried_sizes(trial, said[trial.name], own, untouched))
    ordered = sorted(groups.items(), key=lambda group: (group[0][0] in OUTSIDERS, group[0][1] == STRONG, group[0][0]))
    return [Power(name, unit, detection_limit, tuple(tried)) for (name, unit, detection_limit), tried in ordered]


def _tried_sizes(trial: InjectionTrial, said: dict, own: set[str], untouched: dict) -> Tried:
    result = score(trial.name, {"effects": {trial.id: {}}, "strength": trial.size}, said)
    own = own | {EARTH} | ({DELAY} if same_delay(untouched, said) else set())
    wrong = tuple(name for name in result.wrong if name not in own and not name.startswith(NAMELESS))
    found = bool(result.found)
    if trial.id in OUTSIDERS:
        nameless = {name for name in reported_names(said) if name.startswith(NAMELESS)}
        found = bool(nameless - own) or (untouched["verdict"] == "no_mismatch" and result.alarmed and said["verdict"] != "refused")
    lost = tuple(claim["id"] for claim in untouched["effects"] if claim["id"] not in reported_names(said))
    return Tried(trial.size, found, result.claimed, wrong, lost)


def agreement(found: list[Power]) -> dict:
    """Of the effects with a ``detection_limit``: how many were found at some size; for how many it holds within a factor of two, does not,
    and is undecided; the median ratio of those that were missed at some size, as for others it is an upper bound."""
    promised = [each for each in found if each.detection_limit is not None]
    answers = [each.agrees for each in promised]
    ratios = [each.ratio for each in promised if each.ratio is not None and each.undetected_at is not None]
    return {
        "predicted": len(promised),
        "detected": sum(each.detected_from is not None for each in promised),
        "agree": answers.count(True),
        "disagree": answers.count(False),
        "not_decided": answers.count(None),
        "median_ratio": float(np.median(ratios)) if ratios else None,
    }


# A recording tested from end to end: explain it, inject, seal, explain blind, open, count.

UNTOUCHED = "untouched"


@dataclass(frozen=True, eq=False)
class OwnExamination:
    """session: its name; sha256 of the truth as it was printed before; verdict, own names: of the untouched recording; powers: by
    effect."""

    session: str
    seed: int
    sha256: str
    verdict: str
    own: tuple[str, ...]
    powers: list[Power]


def examine_recording(
    session: Path,
    folder: Path,
    count: int | None,
    seed: int,
    *,
    announce: Callable[[str], None] = lambda text: None,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> OwnExamination:
    """Measure the detection limits of the recording in ``session``; ``folder`` must be empty or new; count: most trials, None for all.

    Raises what ``recording_of`` raises, and FormatError for the folder.
    """
    recording = recording_of(session)
    new_folder(folder)
    sessions = folder / SESSIONS
    progress("explaining it untouched", 0, 1)
    write_spoilt(recording.session, tuple(log.samples for log in recording.session.logs), sessions / UNTOUCHED)
    untouched = explained(sessions / UNTOUCHED)
    if untouched["verdict"] == "refused":
        raise DataError(f"{session}: explain refuses it: {untouched['why']}")
    detection_limits = {name: entry["size"] for name, entry in untouched["detection_limits"].items() if entry["size"]}
    own = own_names(untouched)
    trials = draw_trials(detection_limits, own | not_tried(untouched), recording.has_temperature, count, seed)
    trials, closed = _write(recording, trials, folder, progress)
    announce(f"truth sealed, SHA-256 {closed.sha256}")
    said = asked_blind([sessions / trial.name for trial in trials], explained, "explaining blind", progress)
    opened(folder, closed, {UNTOUCHED: untouched} | said)
    found = powers(trials, said, untouched)
    return OwnExamination(recording.session.name, seed, closed.sha256, untouched["verdict"], tuple(sorted(own)), found)


def _write(
    recording: HostRecording, trials: list[InjectionTrial], folder: Path, progress: Callable[[str, int, int], None]
) -> tuple[list[InjectionTrial], Seal]:
    """Write the session folders of the trials that this recording allows, and the sealed truth next to them."""
    written, truth = [], {}
    for done, trial in enumerate(trials):
        progress("concealing", done, len(trials))
        spoilt = inject(recording, trial)
        if not all(np.isfinite(log.gyro).all() for log in spoilt.logs):
            continue  # the effect needs an input that this recording lacks
        write_spoilt(recording.session, spoilt.logs, folder / SESSIONS / trial.name)
        truth[trial.name] = {
            "effects": {trial.id: spoilt.truth},
            "size": trial.size,
            "unit": trial.unit,
            "detection_limit": trial.detection_limit,
        }
        written.append(trial)
    return written, seal(truth, folder / SEALED)


def to_json(result: OwnExamination) -> dict:
    """``tinygc-power/2``."""
    return {
        "schema": "tinygc-power/2",
        "session": result.session,
        "seed": result.seed,
        "sha256": result.sha256,
        "verdict": result.verdict,
        "own": list(result.own),
        "effects": [
            {
                "id": each.id,
                "unit": each.unit,
                "detection_limit": each.detection_limit,
                "detected_from": each.detected_from,
                "ratio": each.ratio,
                "agrees": each.agrees,
                "tried": [vars(one) for one in each.tried],
            }
            for each in result.powers
        ],
        "agreement": agreement(result.powers),
    }


# The detection limits of a recording, as ``calibrate.py challenge --on`` prints them.

FOUND, NOT_FOUND = "✓", "–"


def power_tables(result: OwnExamination) -> Group:
    """A row for each effect, and a summary."""
    heads = ("concealed", "unit", "detection limit", "detected from", "ratio", "sizes that were tried", "wrong names")
    table = Table(*heads, title=f"from what size on {result.session} tells")
    for each in result.powers:
        sizes = "  ".join(f"{one.size:.2g} {FOUND if one.found else NOT_FOUND}" for one in each.tried)
        ratio = "" if each.ratio is None else _at_most(each) + f"{each.ratio:.2g}"
        wrong = ", ".join(sorted({name for one in each.tried for name in one.wrong}))
        table.add_row(each.id, each.unit, _number(each.detection_limit), _at_most(each) + _number(each.detected_from), ratio, sizes, wrong)
    return Group(table, Text(""), Text("\n".join(sentences(result))))


def sentences(result: OwnExamination) -> list[str]:
    """The summary as sentences."""
    found, t = result.powers, agreement(result.powers)
    tried = [one for each in found for one in each.tried]
    lines = [f"untouched: {result.verdict}" + (f"; its own, neither right nor wrong: {', '.join(result.own)}" if result.own else "")]
    lines.append(
        f"{len(tried)} concealed: {sum(one.found for one in tried)} found, {sum(bool(one.wrong) for one in tried)} with a wrong name"
    )
    if plain := [one for each in found for one in each.tried if each.detection_limit and one.size >= EXPECTED * each.detection_limit]:
        lines.append(f"of the {len(plain)} at twice their detection limit or more, {sum(one.found for one in plain)} found")
    if t["predicted"]:
        ratio = (
            "" if t["median_ratio"] is None else f"; detected from over detection limit, where no ≤ stands: median {t['median_ratio']:.2g}"
        )
        lines.append(
            f"of the {t['predicted']} effects with a detection limit it holds within a factor of 2 for {t['agree']}, "
            f"not for {t['disagree']}, and for {t['not_decided']} the sizes do not decide it; "
            f"{t['predicted'] - t['detected']} were not detected at the largest size{ratio}"
        )
    if lost := Counter(name for one in tried for name in one.lost):
        gone = ", ".join(f"{name} in {count}" for name, count in sorted(lost.items()))
        lines.append(f"its own that are gone beside what was concealed: {gone}")
    if blind := [each.id for each in found if not any(one.found for one in each.tried)]:
        lines.append(f"not detected at any size that was tried: {', '.join(blind)}")
    return lines


def _at_most(power: Power) -> str:
    """A sign before an upper bound, where no smaller size was tried."""
    return "≤ " if power.detected_from is not None and power.undetected_at is None else ""


def _number(value: float | None) -> str:
    return NOT_FOUND if value is None else f"{value:.2g}"
