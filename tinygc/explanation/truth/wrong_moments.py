"""Single attitudes of a truth file that are wrong: the segment before misses by what the segment after makes good."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from tinygc.closure.least_squares import fit_least_squares
from tinygc.explanation.truth.evidence import error_angles, neighbours
from tinygc.problem.problem import Problem

#: both its segments miss by this many times what is usual (normal errors: less than 1e-7 a moment by ``chance_of``), in opposite
#: directions: misses of five times the noise point apart by 180 degrees less 16 or so, and 45 are allowed
JUMP = 5.0
OPPOSITE = -0.7


#: median length of a vector of three normal deviates; and how many squares a scale from a median of N such lengths is worth, over N
MEDIAN_LENGTH, FREEDOM_SHARE = float(stats.chi.median(3)), 1.58


def without_wrong_moments(problem: Problem) -> tuple[Problem, list[tuple[int, float]], float]:
    """The problem without the segments at both sides of a wrong moment of truth, log and s of each such moment, and an upper bound of the
    chance that noise alone makes one as large as the largest; 1 where there is none."""
    model = problem.first
    keep = np.ones(len(problem.batch), dtype=bool)
    for _ in range(3):
        model = fit_least_squares(problem.batch.pick(keep), problem.floor.sigma[keep], model).model
        angles = error_angles(problem.batch, model)
        usual = float(np.median(np.linalg.norm(angles, axis=1)))
        at = neighbours(problem)
        before, after = angles[at], angles[at + 1]
        size = np.minimum(np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1))
        cosine = np.sum(before * after, axis=1) / np.maximum(np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1), 1e-12)
        wrong = at[(size > JUMP * usual) & (cosine < OPPOSITE)]
        keep = np.ones(len(problem.batch), dtype=bool)
        keep[wrong] = keep[wrong + 1] = False
    if not len(wrong) or keep.sum() < len(keep) / 2:
        return problem, [], 1.0
    numbers = {segment.number for segment, ok in zip(problem.used, keep, strict=True) if not ok}
    segments = [replace(s, problem="one of its moments of truth is wrong") if s.number in numbers else s for s in problem.segments]
    jumps = [(problem.used[i].log, problem.used[i].start_s + problem.used[i].duration_s) for i in wrong]
    wider = None if problem.floor.wider is None else problem.floor.wider[keep]
    floor = replace(problem.floor, own=problem.floor.own[keep], wider=wider, shared=np.zeros((max(keep.sum() - 1, 0), 3, 3)))
    kept = replace(problem, segments=segments, batch=problem.batch.pick(keep), floor=floor)
    # What two neighbours share is kept where both are.
    both = np.flatnonzero(keep[:-1] & keep[1:])
    new = np.cumsum(keep) - 1
    floor.shared[new[both]] = problem.floor.shared[both]
    return kept, jumps, chance_of(float(size[np.isin(at, wrong)].max() / usual), len(at), len(angles))


def chance_of(times_usual: float, pairs: int, segments: int) -> float:
    """Upper bound of the chance that normal errors, of the scale that the median length of ``segments`` of them tells, miss on both sides
    of one of ``pairs`` moments by so many times that length: that one side of one does, over all moments (Bonferroni)."""
    ratio = (times_usual * MEDIAN_LENGTH) ** 2 / 3
    return float(min(1.0, pairs * stats.f.sf(ratio, 3, FREEDOM_SHARE * segments)))
