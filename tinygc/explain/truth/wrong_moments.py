"""Single attitudes of a truth file that are wrong: the segment before misses by what the segment after makes good."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tinygc.closure.least_squares import fit_least_squares
from tinygc.explain.truth.evidence import error_angles, neighbours
from tinygc.problem.problem import Problem

#: both its segments miss by this many times what is usual, in opposite directions
JUMP = 5.0
OPPOSITE = -0.7


def without_wrong_moments(problem: Problem) -> tuple[Problem, list[tuple[int, float]]]:
    """The problem without the segments at both sides of a wrong moment of truth, and log and s of each such moment."""
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
        return problem, []
    numbers = {segment.number for segment, ok in zip(problem.used, keep, strict=True) if not ok}
    segments = [replace(s, problem="one of its moments of truth is wrong") if s.number in numbers else s for s in problem.segments]
    jumps = [(problem.used[i].log, problem.used[i].start_s + problem.used[i].duration_s) for i in wrong]
    floor = replace(problem.floor, own=problem.floor.own[keep], shared=np.zeros((max(keep.sum() - 1, 0), 3, 3)))
    kept = replace(problem, segments=segments, batch=problem.batch.pick(keep), floor=floor)
    # What two neighbours share is kept where both are.
    both = np.flatnonzero(keep[:-1] & keep[1:])
    new = np.cumsum(keep) - 1
    floor.shared[new[both]] = problem.floor.shared[both]
    return kept, jumps
