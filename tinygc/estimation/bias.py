"""The bias of a fit: from the ends of the turns or from the stills, and one for each log over several days."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.base.errors import CalibrationError
from session.base.numeric import rms_length
from session.base.texts import probability
from session.base.units import DEG
from session.detect.check_stills import ENOUGH_SEGMENTS
from session.detect.segments import FEWEST_SEGMENTS
from tinygc.closure.build import with_still_bias
from tinygc.closure.problem import Problem
from tinygc.estimation.held_out import run_method
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.inference.prove import signed_ranks_above
from tinygc.models.linear import BIAS, NAMES

# The bias from the ends of the turns, or from the stills around each: as requested, or by the smaller held-out closure error.

#: significance level of the one-sided test on paired held-out errors: a model with more parameters, or a prior against the stills,
#: must be better than by chance
BETTER_P = 0.05
#: relative difference below which two closures are equal (as are two floors in the report)
SAME = 0.01


@dataclass(frozen=True, eq=False)
class BiasChoice:
    """The source of the bias.

    requested: option; used: ``ends`` or ``stills``; held_out: held-out error angles (S, d) rad of least squares with both, where both were
    tried; p_value: of the improvement by the stills; unseen: whether the bias is not observable at the ends; of_prior: whether a prior
    is used.
    """

    requested: str
    used: str
    held_out: dict[str, np.ndarray]
    p_value: float | None = None
    unseen: bool = False
    of_prior: bool = False

    def to_json(self) -> dict:
        """Return ``bias_from`` of ``tinygc-fit/2``."""
        rms = {name: float(tilt_rms(angles)) / DEG for name, angles in self.held_out.items()}
        return {
            "requested": self.requested,
            "used": self.used,
            "ends_holdout_tilt_rms_deg": rms.get("ends"),
            "stills_holdout_tilt_rms_deg": rms.get("stills"),
            "p_value": self.p_value,
        }

    @property
    def words(self) -> str:
        """Describe the choice in one sentence."""
        where = {"ends": "from the ends of the turns", "stills": "of each turn from the stills around it"}[self.used]
        if not self.held_out:
            return f"Bias {where}."
        ends, stills = (tilt_rms(self.held_out[name]) / DEG for name in ("ends", "stills"))
        why = "as requested" if self.requested != "auto" else self._why
        if self.unseen and self.requested == "auto":
            return f"Bias {where}: the ends of so few turns do not show it."
        if self.of_prior and self.requested == "auto" and self.used == "stills":
            return f"Bias {where}: with a prior and few turns, using their ends is not significantly better."
        return f"Bias {where} ({why}); held out with the ends {ends:.4f}°, with the stills {stills:.4f}°."

    @property
    def _why(self) -> str:
        ends, stills = (tilt_rms(self.held_out[name]) for name in ("ends", "stills"))
        if self.used == "stills" or ends < (1 - SAME) * stills:
            return "which closes held-out turns better"
        if stills < (1 - SAME) * ends:
            return f"so few turns do not show that the stills are better, {probability(self.p_value)}"
        return f"both close held-out turns within {100 * SAME:g} %"


def choose(problem: Problem, options: FitOptions) -> tuple[BiasChoice, Problem, MethodFit]:
    """Choose the source of the bias; return it, the problem with it, and its least squares.

    Raises CalibrationError where the stills are requested and cannot be used, and FitError.
    """
    requested = options.bias
    if problem.session.reference is not None or not len(problem.still_rates.rate):
        if requested == "stills":
            raise CalibrationError("--bias stills: the turns of this session do not lie between stills; leave it out")
        return BiasChoice(requested, "ends", {}), problem, run_method("least_squares", problem, options)
    level = with_still_bias(problem)
    ends = run_method("least_squares", problem, options)
    fits = {"ends": ends, "stills": run_method("least_squares", level, options, before={"least_squares": ends})}
    held = {name: fit.held_out for name, fit in fits.items()}
    p_value = less_by_chance(held["ends"], held["stills"])
    unseen = problem.batch.turns is not None and any(name in NAMES[BIAS] for name in fits["ends"].notes["unobserved"])
    unseen = unseen or (problem.batch.turns is None and len(problem.batch) < FEWEST_SEGMENTS)
    of_prior = problem.prior is not None
    # With a prior the turns are few: the bias from their ends is many times less certain than from the stills.
    stills = (
        unseen or closes_better(held["ends"], held["stills"]) or (of_prior and less_by_chance(held["stills"], held["ends"]) >= BETTER_P)
    )
    used = requested if requested != "auto" else ("stills" if stills else "ends")
    return BiasChoice(requested, used, held, p_value, unseen, of_prior), level if used == "stills" else problem, fits[used]


def closes_better(usual: np.ndarray, other: np.ndarray) -> bool:
    """Whether the other's held-out tilt errors (S, d) are smaller in root mean square, by more than ``SAME``; of fewer than
    ``ENOUGH_SEGMENTS`` turns, whose root mean squares are largely chance, whether they are significantly smaller.

    A test at 5 % that favoured the ends took them in seven of 48 recordings of mimu, in all of which the stills were better, by 0.02 to
    0.32 degrees.
    """
    if len(usual) < ENOUGH_SEGMENTS:
        return less_by_chance(usual, other) < BETTER_P
    return bool(tilt_rms(other) < (1 - SAME) * tilt_rms(usual))


def less_by_chance(usual: np.ndarray, other: np.ndarray) -> float:
    """Return the p-value of the other's tilt errors (S, d) being smaller, segment by segment, if neither is better.

    Wilcoxon's signed-rank test is robust to a few turns with large closure errors.  The result is 1 where the root mean square is
    not smaller as well.
    """
    less = np.linalg.norm(usual[:, :2], axis=1) - np.linalg.norm(other[:, :2], axis=1)
    if tilt_rms(other) >= tilt_rms(usual) or not less.any():
        return 1.0
    return signed_ranks_above(less)


def tilt_rms(angles: np.ndarray) -> float:
    """Root mean square tilt of error angles (S, 2 or 3), rad."""
    return rms_length(angles[:, :2])
