"""Turns in which a rate stood at a level are left out, if they close worse than the others: what was clipped is lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from session.common.units import DEG
from session.detect.clipping import FALSE_ALARM
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import closure_angles
from tinygc.explanation.mends import plateaus
from tinygc.explanation.mends.ceilings import ReachedCeiling, find_ceiling
from tinygc.problem.problem import Problem

#: segments without a loss from which a linear model can be had: twice as many angles as it has parameters
FEWEST_WHOLE = 12
#: share to which a level in the registers is known: three steps of 17.5 mdps at the least ceiling that is looked for, 25 dps
LEVEL_KNOWN = 0.002
#: segments with plateaus that miss by so many times what the others do were clipped: a tenth of a degree of a turn is enough
#: (not critical: benchmarks/thresholds.py); at a level of the registers, which no other cause makes, twice is enough
PLATEAU_EXCESS, CEILING_EXCESS = 10.0, 2.0


@dataclass(frozen=True, eq=False)
class Clipping:
    """level and known_to, rad/s; numbers of the segments that reach it; chance: bound of the chance that noise alone makes such a level;
    borne_out: whether these segments close worse than the others; excess: by how many times."""

    level: float
    known_to: float
    numbers: list[int]
    chance: float
    excess: float
    borne_out: bool


def find_clipping(problem: Problem) -> Clipping | None:
    """In the registers, or as plateaus that were clipped before noise came on top; None where no level is reached."""
    full_scale = problem.session.config.sensor.gyro_fs_dps * DEG
    ceilings: list[ReachedCeiling | None] = [find_ceiling(log.samples, full_scale) for log in problem.logs]
    known_to, chance, bar = LEVEL_KNOWN, 6 * len(ceilings) * FALSE_ALARM, CEILING_EXCESS
    if not any(ceilings):
        known_to, bar = plateaus.SAME, PLATEAU_EXCESS  # the linear errors came after
        misfit = np.sum((closure_angles(problem.batch, problem.first) / problem.floor.sigma) ** 2)
        chance = float(chi2.sf(misfit, int(problem.batch.known.sum())))
        ceilings = [plateaus.find_plateaus(log.samples, full_scale) for log in problem.logs]
    levels = [ceiling.level for ceiling in ceilings if ceiling is not None]
    if not levels:
        return None
    numbers = [s.number for s in problem.segments if (c := ceilings[s.log]) is not None and c.mask[s.start : s.stop].any()]
    if not numbers:
        return None
    excess = _excess(problem, numbers)
    level = float(np.median(levels))
    return Clipping(
        level, known_to * level, numbers, min(chance, 1.0), excess, excess > bar or (np.isnan(excess) and bar == CEILING_EXCESS)
    )


def _excess(problem: Problem, numbers: list[int]) -> float:
    """By how many times these segments close worse than the others, by the linear model of the others (or of all, where those are few)."""
    hit = np.isin([segment.number for segment in problem.used], numbers)
    if not hit.any():
        return np.nan  # nothing of them is used, and nothing can be said
    own = ~hit if (~hit).sum() >= FEWEST_WHOLE else np.ones_like(hit)
    sigma = problem.floor.sigma
    model = fit_least_squares(problem.batch.pick(own), sigma[own], problem.first).model
    excess = np.sqrt(np.mean((closure_angles(problem.batch, model) / sigma) ** 2, axis=1))
    return float(np.median(excess[hit]) / (1 if own.all() else max(1.0, np.median(excess[~hit]))))
