"""The table of docs/real-recordings.md, and the lines below it: from what ``real_recordings.py`` has of each recording."""

from __future__ import annotations

import math
from collections.abc import Callable

UNCALIBRATED = ("mikov", "mimu")
#: the recording that the effects were injected into has it by itself
OWN = "gyro.g_sensitivity"
#: faults of a log that are not expected in these sets: every frame of mimu has a right checksum and none is missing
NO_FAULTS = ("data.glitches", "timing.dropped_samples")
UNDERSAMPLED = "motion.undersampled"
NAMELESS, OUTSIDE = "unknown.", "outside."
#: of a set whose data rate is too low for a hand
SLOW_SET, SLOW_RATE = "mimu", "62.5 Hz"
#: within this factor the predicted undersampling is called right
RIGHT = 1.5
NOTHING = "–"
HEADER = ("recording", "verdict", "names", "shapes without a name", "held-out closure before → after, °", "floor, °")
PREFACE = (
    "Behind each name stands its probability, behind `motion.undersampled` also the closure error that it predicts. "
    "`mikov` and `mimu` have their accelerometers calibrated from their own stills."
)


def page(results: list[dict], truth: dict) -> str:
    """All that follows the mark ``<!-- table -->``; truth: of ``injected``, by the recording's name."""
    results = sorted(results, key=title)
    lines = (HEADER, ["---"] * len(HEADER), *map(row, results))
    table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return "\n\n".join([PREFACE, table, "\n".join(summary(results, truth))])


def title(result: dict) -> str:
    """``mimu/e1u0``; ``xsens`` for the only one of a set."""
    return result["set"] if result["name"] == result["set"] else f"{result['set']}/{result['name']}"


def row(result: dict) -> tuple[str, ...]:
    """Cells of one recording, or why it is refused."""
    if not result["explain"]:
        return (title(result), f"refused: {result['refused']}", *[NOTHING] * (len(HEADER) - 2))
    closure = closure_of(result)
    return (
        title(result),
        result["explain"]["verdict"],
        ", ".join(map(_claim, named(result).values())) or NOTHING,
        ", ".join(f"`{name}`" for name in shapes(result)) or NOTHING,
        f"{closure['before']:.3f} → {closure['after']:.3f}",
        f"{closure['floor']:.3f}",
    )


def _claim(effect: dict) -> str:
    """``name 0.97 or stand-in (0.40°)``."""
    predicted = f" ({effect['parameters']['predicted_deg']:.2f}°)" if effect["id"] == UNDERSAMPLED else ""
    either = "".join(f" or `{name}`" for name in effect["equivalent"])
    return f"`{effect['id']}` {_probability(effect['probability'])}{either}{predicted}"


def _probability(value: float) -> str:
    return "> 0.99" if value >= 0.995 else f"{value:.2f}"


def named(result: dict) -> dict[str, dict]:
    """Claimed effects by id; what is only called unknown is no name."""
    effects = result["explain"]["effects"] if result["explain"] else []
    return {effect["id"]: effect for effect in effects if not effect["id"].startswith(NAMELESS)}


def shapes(result: dict) -> list[str]:
    """What is claimed, or found beside the names, without a name."""
    told = [*result["explain"]["effects"], *result["explain"].get("findings", ())]
    return [each["id"] for each in told if each["id"].startswith(NAMELESS)]


def closure_of(result: dict) -> dict:
    """``before``, ``after`` and ``floor``, degrees, of held-out segments."""
    return result["explain"]["fit"]["holdout_closure_rms_deg"]


def said_wrongly(result: dict, truth: dict) -> list[str]:
    """Wrong names by the truth of what was injected; of uncalibrated sets, faults that are not expected; nothing where nobody knows."""
    found = named(result)
    if result["set"] in UNCALIBRATED:
        return [name for name in found if name in NO_FAULTS]
    if result["set"] != "injected" or result["name"] not in truth:
        return []
    true = {OWN, *truth[result["name"]]["effects"]}
    return [name for name, effect in found.items() if name not in true and not true & set(effect["equivalent"])]


def missed(result: dict, truth: dict) -> list[str]:
    """What was injected and has a name, and is neither claimed nor among what cannot be told from a claim."""
    if result["set"] != "injected":
        return []
    said = {name for effect in named(result).values() for name in (effect["id"], *effect["equivalent"])}
    return [name for name in truth.get(result["name"], {"effects": {}})["effects"] if name not in said and not name.startswith(OUTSIDE)]


def is_predicted(result: dict) -> bool | None:
    """Whether the undersampling that is claimed is within ``RIGHT`` of what held-out closure has beyond the floor; None without a claim."""
    claim = named(result).get(UNDERSAMPLED)
    if claim is None:
        return None
    closure = closure_of(result)
    excess = math.sqrt(max(closure["after"] ** 2 - closure["floor"] ** 2, 0.0))
    return excess / RIGHT <= claim["parameters"]["predicted_deg"] <= excess * RIGHT


def summary(results: list[dict], truth: dict) -> list[str]:
    """A line for each thing that can be counted."""
    whole = [result for result in results if result["explain"]]
    worse = sum(closure_of(result)["after"] > closure_of(result)["before"] for result in whole)
    lines = [f"- {len(results) - len(whole)} of {len(results)} recordings are refused."] if len(whole) < len(results) else []
    lines.append(f"- The held-out closure after is worse than before in {worse} of {len(whole)}.")
    return lines + _faults(whole, truth) + _undersampled(whole) + _injected(whole, truth)


def _faults(whole: list[dict], truth: dict) -> list[str]:
    of_sets = [result for result in whole if result["set"] in UNCALIBRATED]
    if not of_sets:
        return []
    count = sum(bool(said_wrongly(result, truth)) for result in of_sets)
    sets = " and ".join(f"`{name}`" for name in dict.fromkeys(result["set"] for result in of_sets))
    return [
        f"- False readings or lost samples are claimed in {count} of the {len(of_sets)} recordings of {sets}, where all units on one body "
        "felt the same. What detectors propose there is listed as considered."
    ]


def _undersampled(whole: list[dict]) -> list[str]:
    of_set = [result for result in whole if result["set"] == SLOW_SET]
    if not of_set:
        return []
    answers = [answer for answer in map(is_predicted, of_set) if answer is not None]
    return [
        f"- Undersampled motion is named in {len(answers)} of the {len(of_set)} of `{SLOW_SET}`, which have {SLOW_RATE}. "
        f"What it predicts is within a factor of {RIGHT:g} of the excess, √(after² − floor²), in {sum(answers)} of these {len(answers)}."
    ]


def _injected(whole: list[dict], truth: dict) -> list[str]:
    of_set = [result for result in whole if result["set"] == "injected" and result["name"] in truth]
    if not of_set:
        return []
    wrong, left = (_listed(of_set, truth, which) for which in (said_wrongly, missed))
    outside = [r["name"] for r in of_set if any(name.startswith(OUTSIDE) for name in truth[r["name"]]["effects"])]
    lines = [
        f"- Names of `injected` that were not put in, beside the recording's own `{OWN}`: {wrong or 'none'}. "
        f"Put in and not named: {left or 'none'}."
    ]
    return lines + [f"- What no catalogue has was put into {', '.join(outside)}."] * bool(outside)


def _listed(results: list[dict], truth: dict, which: Callable[[dict, dict], list[str]]) -> str:
    return ", ".join(f"`{name}` ({result['name']})" for result in results for name in which(result, truth))
