"""From what size on a recording names each effect that was concealed in it, beside the size that ``explain`` promised."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.challenge.on_recording.trials import STRONG, Trial
from tinygc.challenge.outsiders import OUTSIDERS
from tinygc.challenge.score import NAMELESS, score

#: a promise is kept within the step between two sizes that are tried
AGREES = 2.0


@dataclass(frozen=True)
class Tried:
    """One size: whether the effect was found (named, or among the equivalents of a name; what has no name: seen); ids that were named,
    those of them that are wrong, and the untouched recording's own that are gone."""

    size: float
    found: bool
    named: tuple[str, ...]
    wrong: tuple[str, ...]
    lost: tuple[str, ...] = ()


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
    """Of the effects with a ``seen_from``: how many were told at some size, how many within a factor of two of it, the median ratio."""
    promised = [each for each in found if each.seen_from is not None]
    ratios = [each.ratio for each in promised if each.ratio is not None]
    return {
        "promised": len(promised),
        "told": len(ratios),
        "within_factor_2": sum(1 / AGREES <= ratio <= AGREES * (1 + 1e-9) for ratio in ratios),
        "median_ratio": float(np.median(ratios)) if ratios else None,
    }
