"""A fit's bias: from the ends of the turns, or from the stills around each; as asked, or what closes held-out segments better."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.errors import CalibrationError
from session.common.units import DEG
from tinygc.closure.probability import signed_ranks_above
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.methods.run import run_method
from tinygc.models.linear import BIAS, NAMES
from tinygc.problem.build import FEWEST_SEGMENTS
from tinygc.problem.problem import Problem
from tinygc.problem.still_bias import with_still_bias

#: one-sided, of the held-out errors in pairs: the stills must be better by more than chance
BETTER_P = 0.05


@dataclass(frozen=True, eq=False)
class BiasChoice:
    """asked: the option; used: ``ends`` or ``stills``; held_out: of both, least squares' error angles (S, d) rad on segments that it never
    saw, where both were tried; p_value: of so much less by the stills by chance; unseen: whether the ends do not show the bias; of_lot:
    whether a lot's prior is there."""

    asked: str
    used: str
    held_out: dict[str, np.ndarray]
    p_value: float | None = None
    unseen: bool = False
    of_lot: bool = False

    def to_json(self) -> dict:
        """``bias_from`` of ``tinygc-fit/1``."""
        rms = {name: float(_rms(angles)) / DEG for name, angles in self.held_out.items()}
        return {
            "asked": self.asked,
            "used": self.used,
            "ends_holdout_tilt_rms_deg": rms.get("ends"),
            "stills_holdout_tilt_rms_deg": rms.get("stills"),
            "p_value": self.p_value,
        }

    @property
    def words(self) -> str:
        """One sentence."""
        where = {"ends": "from the ends of the turns", "stills": "of each turn from the stills around it"}[self.used]
        if not self.held_out:
            return f"Bias {where}."
        ends, stills = (_rms(self.held_out[name]) / DEG for name in ("ends", "stills"))
        better = "better by more than chance" if self.used == "stills" else "not better by more than chance"
        why = "as asked" if self.asked != "auto" else f"the stills are {better}: p = {self.p_value:.2g}"
        if self.unseen and self.asked == "auto":
            return f"Bias {where}: the ends of so few turns do not show it."
        if self.of_lot and self.asked == "auto" and self.used == "stills":
            return f"Bias {where}: beside a lot's prior the turns are few, and their ends are not better by more than chance."
        return f"Bias {where} ({why}); held out with the ends {ends:.4f}°, with the stills {stills:.4f}°."


def choose(problem: Problem, options: FitOptions) -> tuple[BiasChoice, Problem, MethodFit]:
    """The choice, the problem with it, and its least squares.

    Raises CalibrationError where the stills are asked for and cannot be used, and FitError.
    """
    asked = options.bias
    why = _why_not(problem, options)
    if asked == "stills" and why:
        raise CalibrationError(f"--bias stills: {why}")
    if why:
        return BiasChoice(asked, "ends", {}), problem, run_method("least_squares", problem, options)
    level = with_still_bias(problem)
    ends = run_method("least_squares", problem, options)
    fits = {"ends": ends, "stills": run_method("least_squares", level, options, before={"least_squares": ends})}
    held = {name: fit.held_out for name, fit in fits.items()}
    p_value = less_by_chance(held["ends"], held["stills"])
    unseen = problem.batch.turns is not None and any(name in NAMES[BIAS] for name in fits["ends"].notes["unobserved"])
    unseen = unseen or (problem.batch.turns is None and len(problem.batch) < FEWEST_SEGMENTS)
    of_lot = problem.prior is not None
    # Beside a lot's prior the turns are few: what their ends leave of the bias is many times what the stills do.
    stills = unseen or p_value < BETTER_P or (of_lot and less_by_chance(held["stills"], held["ends"]) >= BETTER_P)
    used = asked if asked != "auto" else ("stills" if stills else "ends")
    return BiasChoice(asked, used, held, p_value, unseen, of_lot), level if used == "stills" else problem, fits[used]


def less_by_chance(usual: np.ndarray, other: np.ndarray) -> float:
    """Probability that tilt errors (S, d) of the other are so often and so much less, segment by segment, if neither is better.

    Wilcoxon's signed ranks: a few turns that hardly close have a long tail, in which a mean of squares drowns.  1 where the root mean
    square is not less as well.
    """
    less = np.linalg.norm(usual[:, :2], axis=1) - np.linalg.norm(other[:, :2], axis=1)
    if _rms(other) >= _rms(usual) or not less.any():
        return 1.0
    return signed_ranks_above(less)


def _why_not(problem: Problem, options: FitOptions) -> str:
    if problem.session.truths is not None or not len(problem.still_rates.rate):
        return "the turns of this session do not lie between stills; leave it out"
    if options.still_rates:
        return "the stills are data already with --still-rates; leave one of them out"
    if options.bias_per_log:
        return "with --bias-per-log each log has a bias of its own from its ends; leave one of them out"
    return ""


def _rms(angles: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(angles[:, :2] ** 2, axis=1))))
