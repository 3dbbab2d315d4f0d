"""Limits of variance components by the profile of the restricted likelihood."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tinygc.explanation.standing import ONE_SIDED
from tinygc.features.arrays.system import Solution

#: relative precision of a limit, and most steps of each part of its search
NEAR, MOST_STEPS = 0.03, 12


def rise(solution: Solution, held: dict[int, float]) -> float:
    """Return by how much -2 log likelihood rises where components have these values, all others estimated anew."""
    begin, keep = solution.t.copy(), np.zeros(len(solution.t), dtype=bool)
    for k, value in held.items():
        begin[k], keep[k] = value, True
    return solution.system.estimated(begin, keep).value - solution.value


def upper_component(solution: Solution, k: int, sigma: float, zero: Sequence[int] = ()) -> float:
    """Return the largest value of component k that is not excluded with 95 %, all others free; infinite where none is excluded.

    sigma: of the component, with which the search steps; zero: components held at zero meanwhile.  Where these alone are excluded, the
    value that is best without them.
    """
    nothing = dict.fromkeys(zero, 0.0)
    low = float(solution.t[k])
    if nothing:
        begin, keep = solution.t.copy(), np.zeros(len(solution.t), dtype=bool)
        begin[list(zero)], keep[list(zero)] = 0.0, True
        without = solution.system.estimated(begin, keep)
        low = float(without.t[k])
        if without.value - solution.value >= ONE_SIDED**2:
            return low
    step = sigma if np.isfinite(sigma) and sigma > 0 else max(low, 1e-3 * float(np.median(solution.system.base)))
    high = low + ONE_SIDED * step
    for _ in range(MOST_STEPS):
        if rise(solution, {k: high, **nothing}) >= ONE_SIDED**2:
            break
        low, high = high, high + 2 * (high - low)
    else:
        return np.inf
    for _ in range(MOST_STEPS):
        if high - low <= NEAR * high:
            break
        middle = (low + high) / 2
        low, high = (low, middle) if rise(solution, {k: middle, **nothing}) >= ONE_SIDED**2 else (middle, high)
    return high
