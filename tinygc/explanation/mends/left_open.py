"""Turns with an event that do not close as most others do: the physics by which events are judged is not taken from them.

Least trimmed squares (Rousseeuw 1984): the fit of those segments that close best, found by concentration (Rousseeuw and Van Driessen
1999): fit, keep those that close best by this fit, and so on.
"""

from __future__ import annotations

import numpy as np

from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import closure_angles
from tinygc.explanation.mends.clipping import FEWEST_WHOLE
from tinygc.problem.problem import Problem

#: times the typical size of a closure; noise alone, by a fit to the few that suit it best, is beyond 3.5 in one turn of fifty and not
#: beyond this (tests/test_left_open.py)
OPEN = 5.0
#: share of the segments that is kept at first, and of a normal law's closures the typical size among these over that of all
KEPT, SIZE_OF_KEPT = 0.6, 0.71
#: of concentration, which settles in a few
ROUNDS = 12


def left_open(problem: Problem, touched: np.ndarray) -> np.ndarray:
    """(S,) bool of the touched (S,) segments that close far worse than most."""
    count = min(max(round(KEPT * len(touched)), FEWEST_WHOLE), len(touched))
    starts = [np.arange(len(touched)), np.flatnonzero(~touched)]
    sizes = [_concentrated(problem, start, count) for start in starts if len(start) >= count or start is starts[0]]
    size = min(sizes, key=lambda each: np.sum(np.sort(each)[:count] ** 2))
    found = touched & (size > OPEN * np.median(np.sort(size)[:count]) / SIZE_OF_KEPT)
    size = _closure(problem, np.flatnonzero(~found))  # so few as were kept are easily fitted too well
    return found & (size > OPEN * np.median(size[~found]))


def _concentrated(problem: Problem, kept: np.ndarray, count: int) -> np.ndarray:
    """(S,) ``_closure`` by the fit of the ``count`` that close best, found from those that are kept first."""
    size = np.zeros(len(problem.batch))
    for _ in range(ROUNDS):
        size = _closure(problem, kept)
        best = np.sort(np.argsort(size)[:count])
        if np.array_equal(best, kept):
            break
        kept = best
    return size


def _closure(problem: Problem, kept: np.ndarray) -> np.ndarray:
    """(S,) of each segment over its floor, by the fit of those that are kept."""
    batch, sigma = problem.batch, problem.floor.sigma
    model = fit_least_squares(batch.pick(kept), sigma[kept], problem.first, still_rates=problem.still_rates).model
    return np.linalg.norm(closure_angles(batch, model) / sigma.reshape(len(batch), -1), axis=1)
