"""A calibration is worth something only where it closes turns that it never saw better than the raw rates do.

Raw is whichever is the better of the two that fit nothing: the rates as they were measured, or less what the first still reads.  Below
``ENOUGH_SEGMENTS`` it is not decided: folds of a few turns leave a fit too little to be judged by, and it is said, but no fail.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isinf

from session.checks.stills import ENOUGH_SEGMENTS
from tinygc.fitting.figures import closure_figures
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.methods.registry import METHODS
from tinygc.methods.run import run_method
from tinygc.problem.problem import Problem

#: methods that fit nothing: shown as the sensor measured
RAW = ("raw", "raw_bias_removed")


@dataclass(frozen=True)
class AgainstRaw:
    """method: the better of the raw ones; tilt_rms_deg that it leaves; held_out: method -> the same of each that was fitted, on segments
    that it never saw; segments: how many there are."""

    method: str
    tilt_rms_deg: float
    held_out: Mapping[str, float]
    segments: int = ENOUGH_SEGMENTS

    @property
    def worse(self) -> tuple[str, ...]:
        """Methods that leave more than raw does: not to be used."""
        return tuple(name for name, tilt in self.held_out.items() if self.is_worse(tilt))

    @property
    def failed(self) -> bool:
        """Whether nothing that was fitted is better than raw, by turns enough to say so."""
        return bool(self.held_out) and len(self.worse) == len(self.held_out) and self.segments >= ENOUGH_SEGMENTS

    def is_worse(self, tilt_rms_deg: float) -> bool:
        """Whether a held-out tilt is worse than raw, or no number at all."""
        return not tilt_rms_deg <= self.tilt_rms_deg

    def condemns(self, tilt_rms_deg: float) -> bool:
        """Whether a held-out tilt is worse than raw, by turns enough to say so."""
        return self.is_worse(tilt_rms_deg) and self.segments >= ENOUGH_SEGMENTS

    @property
    def words(self) -> str:
        """One sentence on those that are worse; empty without one."""
        if not self.worse:
            return ""
        listed = ", ".join(f"{METHODS[name].title} {self.held_out[name]:.4f}°" for name in self.worse)
        few = f"by {self.segments} turns this is not decided" if self.segments < ENOUGH_SEGMENTS else "do not apply these"
        whom = "nothing that was fitted is worth applying" if self.failed else few
        return (
            f"Held out worse than raw ({METHODS[self.method].title}, {self.tilt_rms_deg:.4f}°): {listed}: {whom}. "
            "Record more turns, to more attitudes, and look at the first look's warnings."
        )

    def to_json(self) -> dict:
        """``against_raw`` of ``tinygc-fit/1``."""
        return {"method": self.method, "tilt_rms_deg": self.tilt_rms_deg, "worse": list(self.worse), "passed": not self.failed}


def against_raw(problem: Problem, options: FitOptions, fits: Mapping[str, MethodFit]) -> AgainstRaw:
    """Of the methods by name; problem: with the rates as they were measured, for the raw ones that are not among them."""
    raw = {name: _tilt(fits[name] if name in fits else run_method(name, problem, options)) for name in RAW}
    best = min(raw, key=raw.__getitem__)
    held_out = {name: _tilt(fit) for name, fit in fits.items() if name not in RAW}
    return AgainstRaw(best, raw[best], held_out, len(problem.used))


def worse_in_table(fit: Mapping, method: str) -> tuple[float, float] | None:
    """Held-out tilt of a method and raw's, degrees, inf where there is no number, of a ``fit.json`` (``fit_file.JUDGED``) where the first
    is worse, or no number, by turns enough; None where it is not, or where the file says nothing of that method."""
    if method not in fit.get("methods", {}) or "against_raw" not in fit or fit["segments"]["used"] < ENOUGH_SEGMENTS:
        return None
    tilts = (fit["methods"][method]["holdout"]["tilt_rms_deg"], fit["against_raw"]["tilt_rms_deg"])
    mine, raw = (inf if tilt is None else float(tilt) for tilt in tilts)
    return (mine, raw) if mine > raw or isinf(mine) else None


def _tilt(fit: MethodFit) -> float:
    return closure_figures(fit.held_out)["tilt_rms_deg"]
