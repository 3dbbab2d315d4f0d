"""Events of one turn are judged together: of two that both are false, neither closes the turn alone."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np

#: events in one turn of which every choice is tried, sixty-four in all; of more, those are tried that a search goes through
EVERY_CHOICE = 6

#: which of a turn's events are mended
Choice = frozenset[int]


def choices(count: int, value: Callable[[Choice], tuple[float, float]]) -> dict[Choice, float]:
    """Log-likelihood of every choice among ``count`` events that is worth a thought.

    value(choice) -> its log-likelihood, and how far the turn misses.  A choice of which a part misses no more is none: what is allowed for
    across a gap makes nothing of what is missed less of a miss.
    """
    seen: dict[Choice, tuple[float, float]] = {}

    def known(choice: Choice) -> tuple[float, float]:
        if choice not in seen:
            seen[choice] = value(choice)
        return seen[choice]

    if count <= EVERY_CHOICE:
        tried = [frozenset(some) for size in range(count + 1) for some in combinations(range(count), size)]
    else:
        nothing: Choice = frozenset()
        tried = [*_climb(nothing, count, known), *_climb(frozenset(range(count)), count, known)]
    worth = [choice for choice in tried if all(known(choice)[1] < known(choice - {one})[1] for one in choice)]
    return {choice: known(choice)[0] for choice in worth}


def _climb(begin: Choice, count: int, known: Callable[[Choice], tuple[float, float]]) -> list[Choice]:
    """From one choice on by the best change of one event or two, as long as there is a better one; all that it goes through."""
    changes = [frozenset(some) for size in (1, 2) for some in combinations(range(count), size)]
    passed = [begin]
    while True:
        best = max((passed[-1] ^ change for change in changes), key=lambda choice: known(choice)[0])
        if known(best)[0] <= known(passed[-1])[0]:
            return passed
        passed.append(best)


def chance_of_each(count: int, likelihood: dict[Choice, float], share: float) -> np.ndarray:
    """(count,) posterior probability of each event, where such a share of all events is true beforehand."""
    weight = np.array([L + len(c) * np.log(share) + (count - len(c)) * np.log1p(-share) for c, L in likelihood.items()])
    weight = np.exp(weight - weight.max())
    held = np.array([[one in choice for one in range(count)] for choice in likelihood], dtype=float)
    return weight @ held / weight.sum()
