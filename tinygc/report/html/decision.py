"""Pass or fail, and by which rule.

With a limit: the held-out closure of the segments and the error of each closure run, of the calibration that is reported, must not be
above it.  Without one: both must be what noise allows (p at least 0.01), and held-out closure must be near enough to its floor, of
enough segments, for that to mean anything: few segments leave little that a fit could not follow.  Nor is it decided where the
accelerometer's own numbers are not observed: what is wrong with all references alike is wrong with E, and closes all the same.  Either
way, a calibration that closes held-out segments worse than the raw rates do fails.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.accelerometer.parameters import PARAMETERS
from session.checks.stills import ENOUGH_SEGMENTS
from session.common.units import DEG
from tinygc.closure.uncertainty import MISMATCH_P
from tinygc.fitting.accelerometer import AccelerometerFit
from tinygc.fitting.against_raw import AgainstRaw
from tinygc.problem.joint import REFUTED_P
from tinygc.report.html.adopted import Adopted, agrees
from tinygc.report.html.numbers import degrees, probability, significant, tilt_rms

#: held-out closure this many times its floor is not noise, whatever the fitted residuals say
NEAR_FLOOR = 2.0


@dataclass(frozen=True)
class Decision:
    """passed; rule, one sentence; reasons, a sentence for each figure that it rests on (true where it is met); doubts, a sentence for
    each reason why what is met tells little; by_limit: whether a limit was given."""

    passed: bool
    rule: str
    reasons: list[tuple[bool, str]]
    doubts: list[str]
    by_limit: bool

    @property
    def answer(self) -> str:
        """pass, doubtful pass, not decided, fail.  A limit decides by itself: what speaks against it is said beside it."""
        if not self.passed:
            return "fail"
        return "pass" if not self.doubts else "doubtful pass" if self.by_limit else "not decided"

    @property
    def word(self) -> str:
        """The answer as a person reads it."""
        return {"pass": "Pass", "doubtful pass": "Pass, with doubts", "not decided": "Not decided", "fail": "Fail"}[self.answer]


def decide(
    adopted: Adopted,
    files: list[str],
    limit_deg: float | None,
    raw: AgainstRaw | None = None,
    accelerometer: AccelerometerFit | None = None,
) -> Decision:
    """Judge the calibration; files names the closure runs; raw: what the rates leave as they were measured; accelerometer that the
    references rest on."""
    if limit_deg is not None:
        reasons = [_against("segments, held out, rms of tilt", tilt_rms(adopted.angles), limit_deg)]
        reasons += [_against(f"{file}, RMSE", rmse(error), limit_deg) for file, error in zip(files, adopted.run_errors, strict=True)]
        rule = f"Limit {significant(limit_deg, 3)}° asked for: held-out closure of the segments and RMSE of each closure run at most that."
    else:
        degrees_of = "" if adopted.closure_freedom is None else f", {adopted.closure_freedom} degrees of freedom"
        reasons = [_by_chance(f"closure of the fitted segments{degrees_of}", adopted.closure_p)]
        reasons += [_by_chance(file, p) for file, p in zip(files, adopted.run_p, strict=True)]
        rule = (
            f"No limit given: what is left must be what noise allows, p at least {MISMATCH_P:g}; and to be decided, held-out closure "
            f"at most {NEAR_FLOOR:g} times the floor, of at least {ENOUGH_SEGMENTS} segments."
        )
    reasons = [(met, f"{text}; {said}" if said else text) for (met, text), said in zip(reasons, ["", *adopted.run_losses], strict=True)]
    if raw is not None and raw.condemns(tilt_rms(adopted.angles) / DEG):
        words = f"segments, held out, rms of tilt: {degrees(tilt_rms(adopted.angles))}, worse than the"
        reasons.append((False, f"{words} {significant(raw.tilt_rms_deg, 2)}° of the raw rates"))
        rule += " Worse than the raw rates is a fail in any case."
    doubts = _doubts(adopted) + _accelerometer_doubts(accelerometer)
    return Decision(all(met for met, _ in reasons), rule, reasons, doubts, limit_deg is not None)


def _doubts(adopted: Adopted) -> list[str]:
    doubts = []
    if len(adopted.numbers) < ENOUGH_SEGMENTS:
        doubts.append(f"{adopted.in_numbers}, expected {ENOUGH_SEGMENTS} segments or more: record more turns")
    if adopted.times_floor > NEAR_FLOOR:
        doubts.append(f"held-out closure is {significant(adopted.times_floor)} times what noise alone leaves ({adopted.in_numbers})")
    return doubts


def _accelerometer_doubts(accelerometer: AccelerometerFit | None) -> list[str]:
    """What the closure cannot show: references that all err alike turn the calibration with them."""
    if accelerometer is None:
        return []
    doubts = []
    if accelerometer.unobserved:
        none = len(accelerometer.unobserved) == PARAMETERS
        left = f"not observed: {'all of its numbers' if none else ', '.join(accelerometer.unobserved)}"
        doubts.append(f"accelerometer: {left}; what it errs there is in E, and closure does not show it: rest it on more sides")
    if accelerometer.mode == "prior" and accelerometer.p_value is not None and accelerometer.p_value < REFUTED_P:
        doubts.append(
            f"accelerometer: the given calibration was kept as a prior, and no longer holds ({probability(accelerometer.p_value)})"
        )
    return doubts


def rmse(error: np.ndarray) -> float:
    """rad: over roll, pitch, yaw."""
    return float(np.sqrt(np.mean(error**2)))


def _against(what: str, figure_rad: float, limit_deg: float) -> tuple[bool, str]:
    met = bool(figure_rad / DEG <= limit_deg)
    return met, f"{what}: {degrees(figure_rad)}, {'within' if met else 'above'} {significant(limit_deg, 3)}°"


def _by_chance(what: str, p: float) -> tuple[bool, str]:
    return agrees(p), f"{what}: {probability(p)}, " + ("noise explains it" if agrees(p) else "more than noise allows")
