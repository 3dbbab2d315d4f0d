"""Pass or fail, and by which rule.

With a limit: the held-out closure of the segments and the error of each closure run, of the calibration that is reported, must not be
above it.  Without one: both must be what noise allows (p at least 0.01).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.units import DEG
from tinygc.html_report.adopted import Adopted, agrees
from tinygc.html_report.numbers import degrees, probability, significant, tilt_rms
from tinygc.uncertainty import MISMATCH_P


@dataclass(frozen=True)
class Decision:
    """passed; rule, one sentence; reasons, a sentence for each figure that it rests on (true where it is met)."""

    passed: bool
    rule: str
    reasons: list[tuple[bool, str]]


def decide(adopted: Adopted, files: list[str], limit_deg: float | None) -> Decision:
    """Judge the calibration; files names the closure runs."""
    if limit_deg is not None:
        reasons = [_against("segments, held out, rms of tilt", tilt_rms(adopted.angles), limit_deg)]
        reasons += [_against(f"{file}, RMSE", rmse(error), limit_deg) for file, error in zip(files, adopted.run_errors, strict=True)]
        rule = f"Limit {significant(limit_deg, 3)}° asked for: held-out closure of the segments and RMSE of each closure run at most that."
    else:
        reasons = [_by_chance("closure of the segments", adopted.closure_p)]
        reasons += [_by_chance(file, p) for file, p in zip(files, adopted.run_p, strict=True)]
        rule = f"No limit given: what is left must be what noise allows, p at least {MISMATCH_P:g}."
    return Decision(all(met for met, _ in reasons), rule, reasons)


def rmse(error: np.ndarray) -> float:
    """rad: over roll, pitch, yaw."""
    return float(np.sqrt(np.mean(error**2)))


def _against(what: str, figure_rad: float, limit_deg: float) -> tuple[bool, str]:
    met = bool(figure_rad / DEG <= limit_deg)
    return met, f"{what}: {degrees(figure_rad)}, {'within' if met else 'above'} {significant(limit_deg, 3)}°"


def _by_chance(what: str, p: float) -> tuple[bool, str]:
    return agrees(p), f"{what}: {probability(p)}, " + ("noise explains it" if agrees(p) else "more than noise allows")
