"""Probabilities of a few statistics.  ``scipy.stats`` has them as well, and takes longer to import than a fit takes.

tests/test_probability.py holds them against it.
"""

from __future__ import annotations

import math

import numpy as np

#: differences up to which every assignment of signs is counted
EXACT_UP_TO = 50


def chi_square_above(value: float, freedom: int) -> float:
    """Probability that chi-square of so many degrees of freedom, 1 or more, exceeds a value.

    For whole degrees the incomplete gamma function is a finite sum, of positive terms (Abramowitz & Stegun 1964, 26.4.4 and 26.4.5).
    """
    half = value / 2
    if half <= 0:
        return 1.0
    odd = freedom % 2
    powers = np.arange(freedom // 2) + odd / 2
    logs = powers * math.log(half) - half - np.array([math.lgamma(power + 1) for power in powers])
    return min(1.0, odd * math.erfc(math.sqrt(half)) + float(np.sum(np.exp(logs))))


def normal_above(value: float) -> float:
    """Probability that a normal number exceeds so many sigmas."""
    return math.erfc(value / math.sqrt(2)) / 2


def signed_ranks_above(differences: np.ndarray) -> float:
    """Wilcoxon's signed ranks: probability of a sum of the positive ones' ranks as large by chance, differences (n,) being symmetric.

    Zeros are left out, ties share their mean rank.  Exact up to ``EXACT_UP_TO``, normal with the variance that ties leave above.
    """
    left = differences[differences != 0]
    if not len(left):
        return 1.0
    _, place, counts = np.unique(np.abs(left), return_inverse=True, return_counts=True)
    twice = (2 * np.cumsum(counts) - counts + 1)[place]  # ranks, doubled: a tie's may be halves
    positive = int(np.sum(twice[left > 0]))
    if len(left) <= EXACT_UP_TO:
        ways = np.zeros(int(np.sum(twice)) + 1)
        ways[0] = 1.0
        for rank in twice:
            ways[rank:] += ways[:-rank].copy()
        return float(np.sum(ways[positive:]) / np.sum(ways))
    sigma = math.sqrt(float(np.sum(twice.astype(float) ** 2)))
    return normal_above((2 * positive - float(np.sum(twice))) / sigma)
