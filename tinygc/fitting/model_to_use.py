"""Which of a fit's models to use: the simplest that no other betters, on segments that neither has seen, by more than chance.

Better by more than chance is what ``bias_choice`` asks of the stills: Wilcoxon's signed ranks of the held-out tilts, segment by segment,
shared among as many models as are tried.  And by something: models that minimise the same residual differ by a last digit, always the
same way round, which is no chance and worth nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tinygc.fitting.against_raw import RAW, AgainstRaw
from tinygc.fitting.bias_choice import BETTER_P, less_by_chance
from tinygc.fitting.figures import closure_figures
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.registry import METHODS

#: two closures that differ by less are one (as two floors are, in the report)
SAME = 0.01


@dataclass(frozen=True)
class ModelToUse:
    """method: whose model to use, None: no one's; best: of those fitted, the one with the least held-out tilt, None without one; p_value:
    that it, or ``method`` in place of a simpler one, is better by chance, None where nothing was compared; why: a sentence."""

    method: str | None
    best: str | None
    p_value: float | None
    why: str

    def to_json(self) -> dict:
        """``use`` of ``tinygc-fit/1``."""
        return {"method": self.method, "best": self.best, "p_value": self.p_value, "why": self.why}


def model_to_use(fits: Mapping[str, MethodFit], raw: AgainstRaw, numbers: Mapping[str, list[int]]) -> ModelToUse:
    """Of the methods by name; numbers: of the segments that each one's angles belong to."""
    fitted = sorted((name for name in fits if name not in RAW), key=lambda name: (fits[name].parameters, list(METHODS).index(name)))
    tilts = {name: closure_figures(fits[name].held_out)["tilt_rms_deg"] for name in fitted}
    able = [name for name in fitted if not raw.is_worse(tilts[name])]
    if not able:
        why = "nothing that was fitted closes held-out turns better than the raw rates" if fitted else "nothing was fitted"
        why += f", which {raw.segments} turns do not decide" if fitted and not raw.failed else ""
        return ModelToUse(None, min(tilts, key=tilts.__getitem__, default=None), None, why)

    def chance(usual: str, other: str) -> float:
        if not tilts[other] < (1 - SAME) * tilts[usual]:
            return 1.0
        common = sorted(set(numbers[usual]) & set(numbers[other]))
        pair = [fits[name].held_out[[numbers[name].index(number) for number in common]] for name in (usual, other)]
        return less_by_chance(*pair) if common else 1.0

    used, p_value, others = able[0], None, able[1:]
    for name in others:
        p = chance(used, name)
        if p < BETTER_P / len(others):
            used, p_value = name, p
    best = min(able, key=tilts.__getitem__)
    if p_value is None and (near := chance(used, best)) < 1:
        p_value = near
    return ModelToUse(used, best, p_value, _why(used, p_value, able, tilts))


def _why(used: str, p_value: float | None, able: list[str], tilts: Mapping[str, float]) -> str:
    held, best = f"held out {tilts[used]:.4f}°", min(able, key=tilts.__getitem__)
    if len(tilts) == 1:
        return f"{held}, the only one fitted"
    if len(able) == 1:
        return f"{held}, the only one that is better than the raw rates"
    if used != able[0]:
        simpler = METHODS[able[0]].title
        return f"{held} instead of {tilts[able[0]]:.4f}° ({simpler}), better by more than chance (p = {p_value:.2g})"
    if p_value is None:
        return f"{held}, the simplest, and none is better by {100 * SAME:g} %"
    return f"{held}, the simplest; none is better by more than chance ({METHODS[best].title} {tilts[best]:.4f}°, p = {p_value:.2g})"
