"""The bias of a fit: from the ends of the turns or from the stills, and one for each log over several days."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.base.errors import CalibrationError
from session.base.numeric import rms_length
from session.base.texts import probability
from session.base.units import DEG
from session.detect.check_stills import ENOUGH_SEGMENTS
from session.detect.segments import FEWEST_SEGMENTS
from tinygc.closure import residual
from tinygc.closure.build import with_still_bias
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch, RateMap
from tinygc.estimation.held_out import run_method
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.inference.prove import signed_ranks_above
from tinygc.inference.solve import solve
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
    why = _why_not(problem, options)
    if requested == "stills" and why:
        raise CalibrationError(f"--bias stills: {why}")
    if why:
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


def _why_not(problem: Problem, options: FitOptions) -> str:
    if problem.session.reference is not None or not len(problem.still_rates.rate):
        return "the turns of this session do not lie between stills; leave it out"
    if options.bias_per_log:
        return "with bias_per_log each log has a bias of its own from its ends; leave one of them out"
    return ""


def tilt_rms(angles: np.ndarray) -> float:
    """Root mean square tilt of error angles (S, 2 or 3), rad."""
    return rms_length(angles[:, :2])


# A calibration over several days: one E for all, a bias for each log, and the spread of the biases.
#
# E is stable, the bias is not.  A single bias for logs of several days distorts E (on the EuRoC windows by 0.4 %).  Here each log has a
# bias of its own, E is common, and the stored bias is the logs' median: an outlying day affects neither.  Weights by
# distance make a squared loss a sum of distances (Weiszfeld 1937), in which outlying segments, or days, have less weight.

#: iterations of the weights by distance, each with Gauss-Newton steps of three nearly linear parameters
PASSES = 25
STEPS = 3
#: below this share of the median distance a segment's weight grows no further
LEAST = 0.05


@dataclass(frozen=True, eq=False)
class Levelled:
    """Segments with the bias of each log shifted to the median: batch, its sigma (S, d) rad with the distances' weights; offsets (L, 3)
    rad/s of each log's bias from the median, NaN where a log has too few segments; sigma_rps (3,) their spread."""

    batch: Batch
    sigma: np.ndarray
    offsets: np.ndarray
    sigma_rps: np.ndarray


def level_days(problem: Problem) -> Levelled:
    """Estimate each log's bias together with the linear model, and subtract its difference from the median from its segments."""
    owner = np.array([segment.log for segment in problem.used])
    batch, sigma, model = problem.batch, problem.floor.sigma, problem.first
    offsets = np.zeros((len(problem.logs), 3))
    for _ in range(PASSES):
        offsets = _bias_by_log(problem, model, sigma)
        offsets = offsets - np.nanmedian(offsets, axis=0)
        # A log's bias difference is subtracted like the Earth's rate: this works for any model, and leaves its input unchanged.
        each = np.nan_to_num(offsets)[owner]
        batch = replace(problem.batch, earth=problem.batch.earth - each[:, None])
        model = fit_least_squares(batch, sigma, model).model
        # Factors (S,) on the segments' sigmas that make a squared loss a sum of distances at the model.
        distance = np.linalg.norm(residual.segment_residuals(batch, model(batch.rate)), axis=1)
        typical = max(float(np.median(distance)), 1e-12)
        sigma = problem.floor.sigma * np.sqrt(np.maximum(distance / typical, LEAST))[:, None]
    known = offsets[np.isfinite(offsets).all(axis=1)]
    return Levelled(batch, sigma, offsets, np.sqrt(np.sum(known**2, axis=0) / max(len(known) - 1, 1)))


def with_level_bias(problem: Problem) -> tuple[Problem, np.ndarray]:
    """Return the problem with each log's bias shifted to the median, for any method, and the biases' spread (3,) rad/s."""
    days = level_days(problem)
    floor = problem.floor.scaled((days.sigma / problem.floor.sigma)[:, 0])
    return replace(problem, batch=days.batch, floor=floor), days.sigma_rps


def _bias_by_log(problem: Problem, model: RateMap, sigma: np.ndarray | None = None) -> np.ndarray:
    """Estimate (L, 3) rad/s to add to a model's calibrated rate for the best closure of each log, NaN where not determined."""
    sigma = problem.floor.sigma if sigma is None else sigma
    changes = np.full((len(problem.logs), 3), np.nan)
    owner = np.array([segment.log for segment in problem.used])
    for log in range(len(changes)):
        batch = problem.batch.pick(owner == log)
        if len(batch) < 2:
            continue
        weight, rate = 1 / sigma[owner == log][..., None], np.asarray(model(batch.rate))
        columns = residual.sensitivity(batch, rate)[:, :, : batch.angles].sum(axis=1)
        changes[log] = 0
        for _ in range(STEPS):
            angles = 2 * residual.segment_residuals(batch, rate + changes[log])[..., None]
            changes[log] -= solve((columns * weight).reshape(-1, 3), (angles * weight).ravel()).value
    return changes
