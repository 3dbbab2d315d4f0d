"""Detect clipping below the register's range, and stills that creep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from session.base import rotation
from session.base.numeric import runs_of, sigma_of_steps
from session.base.units import DEG
from session.detect.events import FALSE_ALARM, run_bar
from session.detect.stills import CREEP_SIGMAS
from session.log.samples import Samples, pieces
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch, closure_angles
from tinygc.explanation.faulty_readings import register_step
from tinygc.noise.twin import Twin

# Rates that stay at a level below the register's range: the sensor clips early.

#: a plateau ends in corners: as far beyond its ends as it is long, a smooth peak has fallen by 9 times the band it stays within (2 steps)
CORNER_CHI2 = 3 * 9 * 2
#: share of full scale below which no ceiling is searched for: 25 dps of 500, slower than a turn
LEAST_CEILING = 0.05


class ReachedCeiling(NamedTuple):
    """A level that a rate does not exceed, rad/s, and the mask (N,) of the samples at it."""

    level: float
    mask: np.ndarray


def find_reached_ceiling(samples: Samples, full_scale_rps: float) -> ReachedCeiling | None:
    """Find a rate below the register's range that an axis reaches repeatedly and never exceeds."""
    found = []
    steps = [register_step(samples.gyro[:, axis]) for axis in range(3)]
    for axis, step in enumerate(steps):
        readings = samples.gyro[:, axis]
        for sign in (1, -1):
            values = sign * readings
            top = values.max()
            if top > LEAST_CEILING * full_scale_rps:
                at = values >= top - step
                bar = run_bar(float(sigma_of_steps(readings)), 2 * step)
                # Start and stop of the longest run.
                starts, stops = runs_of(at)
                longest = int(np.argmax(stops - starts))
                start, stop = int(starts[longest]), int(stops[longest])
                if stop - start >= bar:
                    found.append((top, at, has_corners(values, start, stop, top, CORNER_CHI2 * step)))
    if not any(corners for _, _, corners in found):
        return None
    level = float(np.median([top for top, _, _ in found]))
    # A clip of a sample or two loses as much of its turn: on any axis that reaches the level, and does not exceed it.
    size, slack = np.abs(samples.gyro), 1.5 * np.array(steps)
    short = ((size >= level - slack) & (size.max(axis=0) <= level + slack)).any(axis=1)
    return ReachedCeiling(level, np.any([short, *(at for _, at, _ in found)], axis=0))


def has_corners(values: np.ndarray, start: int, stop: int, top: float, least: float) -> bool:
    """Whether values (N,) fall by more than ``least`` from a plateau start:stop on both sides, as far beyond its ends as it is long."""
    beyond = values[[max(start - (stop - start), 0), min(stop + (stop - start), len(values)) - 1]]
    return bool(top - beyond.max() > least)


# A rate clipped before the registers: noise, misalignment and a filter act on its plateaus, so that no register value repeats.
#
# A hand's strokes have round peaks of different heights; clipped ones are flat, end in corners, and have one height, which no stroke
# exceeds.  A motor makes such strokes, too: only the closure of the segments can decide (``find_clipping``).

#: a plateau stays within this share of its level (the linear errors that act after clipping: a data sheet's 1 % and a little), or this many
#: times the noise (exceeded once in 10^9)
FLAT, NOISES = 0.012, 6.0
#: as far beyond its ends as it is long, a round peak has fallen by 9 times the band it stays within; a clipped stroke by more than this
CORNER = 18.0
#: strokes of one height, within this share (twice those linear errors), and the shortest plateau (not critical: benchmarks/thresholds.py)
FEWEST, SAME, SHORTEST_S = 3, 0.02, 0.05
#: least clipped rate, which is a turn: share of full scale, 25 dps of 500
LEAST = 0.05
#: shares: of a plateau's readings that are flat; of the plateaus that have one height (not critical: benchmarks/thresholds.py)
WHOLE, ALIKE = 0.9, 0.6


def _find_plateaus(samples: Samples, full_scale_rps: float) -> ReachedCeiling | None:
    """The level of rates that were clipped before misalignment, filter and noise; the same for all axes."""
    levels, masks, peak = [], [], 0.0
    for axis in range(3):
        readings = samples.gyro[:, axis]
        noise, peak = float(sigma_of_steps(readings)), max(peak, readings.max(), -readings.min())
        for sign in (1.0, -1.0):
            found = _plateaus_of(sign * readings, noise, LEAST * full_scale_rps, SHORTEST_S / samples.period_s)
            levels += [level for level, _, _ in found]
            masks += [(level, start, stop) for level, start, stop in found]
    if len(levels) < FEWEST:
        return None
    level = float(np.median(levels))
    alike = [(start, stop) for each, start, stop in masks if abs(each - level) < SAME * level]
    passed = peak > (1 + 2 * SAME) * level
    if len(alike) < max(FEWEST, ALIKE * len(levels)) or passed:
        return None
    mask = np.zeros(len(samples), dtype=bool)
    for start, stop in alike:
        mask[start:stop] = True
    for start, part in pieces(samples.gyro):
        mask[start : start + len(part)] |= (np.abs(part) > (1 - SAME) * level).any(axis=1)
    return ReachedCeiling(level, mask)


def _plateaus_of(values: np.ndarray, noise: float, least: float, shortest: float) -> list[tuple[float, int, int]]:
    """(level, start, stop) of the flat top of each stroke that has one."""
    found = []
    high = values > max(least, 0.5 * values.max())
    for begin, end in zip(*(edges.tolist() for edges in runs_of(high)), strict=True):
        stroke = values[begin:end]
        top = float(np.quantile(stroke, 0.9, method="lower"))  # one of its readings
        within = max(FLAT * top, NOISES * noise)
        flat = np.flatnonzero(np.abs(stroke - top) <= within)
        start, stop = begin + int(flat[0]), begin + int(flat[-1]) + 1
        length = stop - start
        if length < shortest or len(flat) < WHOLE * length:
            continue
        if has_corners(values, start, stop, top, CORNER * within):
            found.append((top, start, stop))
    return found


# Turns in which a rate reached a level are left out if they close worse than the others: the clipped part is lost.

#: least number of unclipped segments for a linear model: twice as many angles as it has parameters
FEWEST_WHOLE = 12
#: share to which a level in the registers is known: three steps of 17.5 mdps at the lowest ceiling, 25 dps
LEVEL_KNOWN = 0.002
#: closure of the segments at a level, over that of the others, above which they were clipped. Plateaus: a tenth of a degree of a turn is
#: enough (not critical: benchmarks/thresholds.py); a level in the registers has no other cause, so twice is enough
PLATEAU_EXCESS, CEILING_EXCESS = 10.0, 2.0


@dataclass(frozen=True, eq=False)
class Clipping:
    """level and known_to, rad/s; numbers of the segments that reach it; chance: bound of the probability that noise alone makes such a
    level; excess: ratio of these segments' closure to the others'; confirmed: whether the excess confirms the clipping."""

    level: float
    known_to: float
    numbers: list[int]
    chance: float
    excess: float
    confirmed: bool


def find_clipping(problem: Problem) -> Clipping | None:
    """Find clipping in the registers, or plateaus clipped before noise was added; None if no level is reached."""
    full_scale = problem.session.config.sensor.gyro_fs_dps * DEG
    ceilings: list[ReachedCeiling | None] = [find_reached_ceiling(log.samples, full_scale) for log in problem.logs]
    known_to, chance, bar = LEVEL_KNOWN, 6 * len(ceilings) * FALSE_ALARM, CEILING_EXCESS
    if not any(ceilings):
        known_to, bar = SAME, PLATEAU_EXCESS  # the linear errors act after clipping
        misfit = np.sum((closure_angles(problem.batch, problem.first) / problem.floor.sigma) ** 2)
        chance = float(chdtrc(int(problem.batch.known.sum()), misfit))
        ceilings = [_find_plateaus(log.samples, full_scale) for log in problem.logs]
    levels = [ceiling.level for ceiling in ceilings if ceiling is not None]
    if not levels:
        return None
    numbers = [s.number for s in problem.segments if (c := ceilings[s.log]) is not None and c.mask[s.start : s.stop].any()]
    if not numbers:
        return None
    excess = excess_of(problem, numbers)
    level = float(np.median(levels))
    return Clipping(
        level, known_to * level, numbers, min(chance, 1.0), excess, excess > bar or (np.isnan(excess) and bar == CEILING_EXCESS)
    )


def excess_of(problem: Problem, numbers: list[int]) -> float:
    """Ratio of these segments' closure to that of the others, by the linear model of the others (or of all, if those are few)."""
    hit = np.isin([segment.number for segment in problem.used], numbers)
    if not hit.any():
        return np.nan  # none of them is used
    own = ~hit if (~hit).sum() >= FEWEST_WHOLE else np.ones_like(hit)
    excess = closure_over_floor(problem, own) / np.sqrt(problem.batch.angles)
    return float(np.median(excess[hit]) / (1 if own.all() else max(1.0, np.median(excess[~hit]))))


def closure_over_floor(problem: Problem, kept: np.ndarray, trial: Batch | None = None) -> np.ndarray:
    """(S,) closure of each segment over its floor, by the fit of the kept segments; trial: in place of the problem's batch."""
    batch, sigma = problem.batch if trial is None else trial, problem.floor.sigma
    model = fit_least_squares(batch.pick(kept), sigma[kept], problem.first, still_rates=problem.still_rates).model
    return np.linalg.norm(closure_angles(batch, model) / sigma.reshape(len(batch), -1), axis=1)


# Stills that move: gravity moves in them, or they turn about the vertical, which only the gyro observes.

#: a still that turns about the vertical shows only in the gyro: outlier threshold of its rate against stills that agree (not critical:
#: benchmarks/thresholds.py)
OUTLIER_SIGMAS = 10.0
#: ratio of vertical to horizontal rate: the axis lies within 18 degrees of the vertical
VERTICAL = 3.0


def chance_of_creep(problem: Problem) -> float:
    """Bound of the probability that noise alone makes one of the stills seem to creep."""
    return min(1.0, len(problem.stills) * float(chdtrc(3, CREEP_SIGMAS**2)))


def about_the_vertical(problem: Problem) -> list[int]:
    """Numbers of the stills whose rate is an outlier, along gravity."""
    twin = Twin(problem)
    rate = twin.residuals(twin.start()).still
    rate = rate - np.median(rate, axis=0)
    size = np.linalg.norm(rate, axis=1)
    in_table = np.einsum("qij,qj->qi", rotation.matrix(twin.q_tb), rate)
    vertical = np.abs(in_table[:, 2]) > VERTICAL * np.linalg.norm(in_table[:, :2], axis=1)
    outlier = size >= OUTLIER_SIGMAS * max(float(np.median(size)) / 1.54, 1e-12)
    reference = [i for i, still in enumerate(problem.stills) if still.problem is None]
    return [number for number, far, along in zip(reference, outlier, vertical, strict=True) if far and along]
