"""Closure figures, whether a calibration is better than raw rates, and which of the models to use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isinf
from typing import TypedDict

import numpy as np

from session.base.numeric import rms_of
from session.base.records import Share, Size
from session.base.texts import probability
from session.base.units import DEG
from session.detect.check_stills import ENOUGH_SEGMENTS
from tinygc.closure.problem import Problem
from tinygc.estimation.bias import BETTER_P, SAME, less_by_chance
from tinygc.estimation.held_out import run_method
from tinygc.estimation.options import METHODS, FitOptions, MethodFit

# Figures of closure errors, in degrees.


class ClosureFigures(TypedDict):
    """Root mean squares over segments, degrees; yaw_rms_deg: None where yaw is not known.  Where some turns have a known angle, it is
    taken over these turns, about each one's own axis."""

    tilt_rms_deg: float
    roll_rms_deg: float
    pitch_rms_deg: float
    yaw_rms_deg: float | None


def closure_figures(angles: np.ndarray) -> ClosureFigures:
    """Return the four figures of error angles (S, 2 or 3) rad, in degrees."""
    rms = np.sqrt(np.mean(angles**2, axis=0)) / DEG
    third = angles[:, 2:][angles[:, 2:] != 0]  # 0, exactly, where a segment's angle is not known
    return {
        "tilt_rms_deg": float(np.hypot(rms[0], rms[1])),
        "roll_rms_deg": float(rms[0]),
        "pitch_rms_deg": float(rms[1]),
        "yaw_rms_deg": rms_of(third) / DEG if len(third) else None,
    }


def run_figures(errors: np.ndarray) -> dict[str, float]:
    """Return the figures of one closure run, from roll, pitch, yaw errors (3,) rad."""
    roll, pitch, yaw = (float(error) / DEG for error in errors)
    return {"roll_deg": roll, "pitch_deg": pitch, "yaw_deg": yaw, "rmse_deg": rms_of(errors) / DEG}


# A calibration is useful only if its closure error on held-out turns is smaller than that of the raw rates.
#
# Raw is the better of the two methods that fit nothing: the measured rates, or these less the first still's mean.  Below
# ``ENOUGH_SEGMENTS`` there is no verdict: folds of a few turns are too small for one, so the result is a warning, not a failure.

#: methods that fit nothing
RAW = ("raw", "raw_bias_removed")


@dataclass(frozen=True)
class AgainstRaw:
    """The comparison with raw rates: method: the better of the raw ones; its tilt_rms_deg; held_out: method -> the held-out tilt of each
    fitted method; segments: their number."""

    written = ("method", "tilt_rms_deg", "worse", "passed")
    method: str
    tilt_rms_deg: Size
    held_out: Mapping[str, float]
    segments: int = ENOUGH_SEGMENTS

    @property
    def worse(self) -> tuple[str, ...]:
        """Methods that are worse than raw and should not be used."""
        return tuple(name for name, tilt in self.held_out.items() if self.is_worse(tilt))

    @property
    def failed(self) -> bool:
        """Whether no fitted method is better than raw, with enough turns for a verdict."""
        return bool(self.held_out) and len(self.worse) == len(self.held_out) and self.segments >= ENOUGH_SEGMENTS

    def is_worse(self, tilt_rms_deg: float) -> bool:
        """Whether a held-out tilt is worse than raw, or not a number."""
        return not tilt_rms_deg <= self.tilt_rms_deg

    def condemns(self, tilt_rms_deg: float) -> bool:
        """Whether a held-out tilt is worse than raw, with enough turns for a verdict."""
        return self.is_worse(tilt_rms_deg) and self.segments >= ENOUGH_SEGMENTS

    @property
    def words(self) -> str:
        """Describe the worse methods in one sentence, empty without one."""
        if not self.worse:
            return ""
        listed = ", ".join(f"{METHODS[name].title} {self.held_out[name]:.4f}°" for name in self.worse)
        few = f"by {self.segments} turns this is not decided" if self.segments < ENOUGH_SEGMENTS else "do not apply these"
        whom = "nothing that was fitted is worth applying" if self.failed else few
        return (
            f"Held out worse than raw ({METHODS[self.method].title}, {self.tilt_rms_deg:.4f}°): {listed}: {whom}. "
            "Record more turns, to more attitudes, and look at the first look's warnings."
        )

    @property
    def passed(self) -> bool:
        """Whether a fitted method is better than raw, or that is not known."""
        return not self.failed


def against_raw(problem: Problem, options: FitOptions, fits: Mapping[str, MethodFit]) -> AgainstRaw:
    """Compare the methods by name with raw; problem: with the measured rates, for raw methods that are not among them."""
    raw = {name: _tilt(fits[name] if name in fits else run_method(name, problem, options)) for name in RAW}
    best = min(raw, key=raw.__getitem__)
    held_out = {name: _tilt(fit) for name, fit in fits.items() if name not in RAW}
    return AgainstRaw(best, raw[best], held_out, len(problem.used))


def worse_in_table(fit: Mapping, method: str) -> tuple[float, float] | None:
    """Return the held-out tilts of a method and of raw, degrees, inf where there is no number, from a ``fit.json`` (``results.EVALUATED``),
    if the first is worse, or no number, with enough turns; None otherwise, or where the file has no such method."""
    if method not in fit.get("methods", {}) or "against_raw" not in fit or fit["segments"]["used"] < ENOUGH_SEGMENTS:
        return None
    tilts = (fit["methods"][method]["holdout"]["tilt_rms_deg"], fit["against_raw"]["tilt_rms_deg"])
    mine, raw = (inf if tilt is None else float(tilt) for tilt in tilts)
    return (mine, raw) if mine > raw or isinf(mine) else None


def _tilt(fit: MethodFit) -> float:
    return closure_figures(fit.held_out)["tilt_rms_deg"]


# The model to use: the simplest that no other one significantly improves on, on held-out segments.
#
# Significance is tested as for the bias from the stills: Wilcoxon's signed ranks of the held-out tilts, segment by segment, with the level
# divided by the number of models tried.  The difference must also have a size: models that minimise the same residual differ in the last
# digit, always in the same direction, which is significant but useless.


@dataclass(frozen=True)
class ModelToUse:
    """The model to use: its method, None for none; best: the fitted method with the least held-out tilt, None without one; p_value: of
    it, or of ``method`` against a simpler one, being better by chance, None where nothing was compared; why: a sentence."""

    method: str | None
    best: str | None
    p_value: Share | None
    why: str


def model_to_use(fits: Mapping[str, MethodFit], raw: AgainstRaw, numbers: Mapping[str, list[int]]) -> ModelToUse:
    """Select among the methods by name; numbers: the segments that each one's angles belong to."""
    fitted = sorted((name for name in fits if name not in RAW), key=lambda name: (fits[name].parameters, list(METHODS).index(name)))
    tilts = {name: closure_figures(fits[name].held_out)["tilt_rms_deg"] for name in fitted}
    able = [name for name in fitted if not raw.is_worse(tilts[name])]
    if not able:
        why = "nothing that was fitted closes held-out turns better than the raw rates" if fitted else "nothing was fitted"
        why += f", which {raw.segments} turns do not decide" if fitted and not raw.failed else ""
        return ModelToUse(None, min(tilts, key=tilts.__getitem__, default=None), None, why)

    def chance(usual: str, other: str) -> float:
        # A denoiser smooths and delays as well, so it must close better by more than these turns know a root mean square to.
        least = SAME if other != "tinygc_denoised" else max(SAME, float(1 / np.sqrt(2 * fits[other].held_out[:, :2].size)))
        if not tilts[other] < (1 - least) * tilts[usual]:
            return 1.0
        common = sorted(set(numbers[usual]) & set(numbers[other]))
        pair = [fits[name].held_out[[numbers[name].index(number) for number in common]] for name in (usual, other)]
        return less_by_chance(*pair) if common else 1.0

    # Where closure does not observe a part of an effect, held-out closure does not prove the whole.
    proved = [able[0], *(name for name in able[1:] if not any(claim.effect.partly_observed for claim in fits[name].model.undone))]
    used, p_value, others = able[0], None, proved[1:]
    for name in others:
        p = chance(used, name)
        if p < BETTER_P / len(others):
            used, p_value = name, p
    best = min(able, key=tilts.__getitem__)
    if p_value is None and (near := chance(used, min(proved, key=tilts.__getitem__))) < 1:
        p_value = near
    if len(proved) == len(able):
        return ModelToUse(used, best, p_value, _why(used, p_value, able, tilts))
    unproved = ", ".join(METHODS[name].title for name in able if name not in proved)
    why = f"held out {tilts[used]:.4f}°; not recommended, as closure does not observe a part of a law that it has: {unproved}"
    return ModelToUse(used, best, p_value, why)


def _why(used: str, p_value: float | None, able: list[str], tilts: Mapping[str, float]) -> str:
    held, best = f"held out {tilts[used]:.4f}°", min(able, key=tilts.__getitem__)
    if len(tilts) == 1:
        return f"{held}, the only one fitted"
    if len(able) == 1:
        return f"{held}, the only one that is better than the raw rates"
    if used != able[0]:
        simpler = METHODS[able[0]].title
        return f"{held} instead of {tilts[able[0]]:.4f}° ({simpler}), significantly better ({probability(p_value)})"
    if p_value is None:
        return f"{held}, the simplest model within {100 * SAME:g} % of the best"
    return f"{held}, the simplest model; none is significantly better ({METHODS[best].title} {tilts[best]:.4f}°, {probability(p_value)})"
