"""From what size on a recording names each effect that was concealed in it, beside the size that ``explain`` promised."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tinygc.challenge.on_recording.trials import STRONG, Trial
from tinygc.challenge.outsiders import OUTSIDERS
from tinygc.challenge.score import NAMELESS, score

#: a promise holds within the step between two sizes that are tried
AGREES = 2.0


@dataclass(frozen=True)
class Tried:
    """One size: whether the effect was found (named, or among the equivalents of a name; what has no name: seen); ids that were named,
    those of them that are wrong, and the untouched recording's own that are gone."""

    size: float
    found: bool
    named: tuple[str, ...]
    wrong: tuple[str, ...]
    lost: tuple[str, ...]


@dataclass(frozen=True)
class Power:
    """Of one effect: sizes that were tried, rising, in ``unit``; seen_from, or None."""

    id: str
    unit: str
    seen_from: float | None
    tried: tuple[Tried, ...]

    @property
    def told_from(self) -> float | None:
        """The smallest size from which on it was found at every size; None where the largest was not."""
        smallest = None
        for each in reversed(self.tried):
            if not each.found:
                break
            smallest = each.size
        return smallest

    @property
    def ratio(self) -> float | None:
        """Told from over seen from."""
        return None if self.told_from is None or not self.seen_from else self.told_from / self.seen_from

    @property
    def not_told_at(self) -> float | None:
        """The largest size at which it was not found; None where it was found at every size that was tried."""
        return max((each.size for each in self.tried if not each.found), default=None)

    @property
    def agrees(self) -> bool | None:
        """Whether the size from which on it is told, which lies between ``not_told_at`` and ``told_from``, is within a factor of two of
        seen from; None where these two do not decide it, or nothing was promised."""
        if not self.seen_from:
            return None
        above, least, most = self.not_told_at or 0.0, self.seen_from / AGREES, self.seen_from * AGREES
        at_most = math.inf if self.told_from is None else self.told_from
        if at_most <= least or above >= most:
            return False
        return True if least <= above and at_most <= most else None


def own_names(untouched: dict) -> set[str]:
    """Names that a recording gets without anything concealed, with their equivalents."""
    claims = [*untouched["effects"], *untouched.get("findings", ())]
    return {name for claim in claims for name in (claim["id"], *claim["equivalent"])}


def powers(trials: list[Trial], said: dict[str, dict], untouched: dict) -> list[Power]:
    """By effect.  What the untouched recording is said to have is neither right nor wrong."""
    own = own_names(untouched)
    groups: dict[tuple[str, str, float | None], list[Tried]] = {}
    for trial in sorted(trials, key=lambda trial: trial.size):
        groups.setdefault((trial.id, trial.unit, trial.seen_from), []).append(_tried(trial, said[trial.name], own, untouched))
    ordered = sorted(groups.items(), key=lambda group: (group[0][0] in OUTSIDERS, group[0][1] == STRONG, group[0][0]))
    return [Power(name, unit, seen_from, tuple(tried)) for (name, unit, seen_from), tried in ordered]


def _tried(trial: Trial, said: dict, own: set[str], untouched: dict) -> Tried:
    result = score(trial.name, {"effects": {trial.id: {}}, "strength": trial.size}, said)
    wrong = tuple(name for name in result.wrong if name not in own and not name.startswith(NAMELESS))
    found = bool(result.found)
    if trial.id in OUTSIDERS:
        nameless = {name for name in own_names(said) if name.startswith(NAMELESS)}
        found = bool(nameless - own) or (untouched["verdict"] == "no_mismatch" and result.alarmed and said["verdict"] != "refused")
    lost = tuple(claim["id"] for claim in untouched["effects"] if claim["id"] not in own_names(said))
    return Tried(trial.size, found, result.claimed, wrong, lost)


def agreement(found: list[Power]) -> dict:
    """Of the effects with a ``seen_from``: how many were told at some size; of how many it holds within a factor of two, of how many not,
    and of how many that is not decided; the median ratio of those that were not found at some size: of others it is an upper bound."""
    promised = [each for each in found if each.seen_from is not None]
    answers = [each.agrees for each in promised]
    ratios = [each.ratio for each in promised if each.ratio is not None and each.not_told_at is not None]
    return {
        "promised": len(promised),
        "told": sum(each.told_from is not None for each in promised),
        "agree": answers.count(True),
        "disagree": answers.count(False),
        "not_decided": answers.count(None),
        "median_ratio": float(np.median(ratios)) if ratios else None,
    }
