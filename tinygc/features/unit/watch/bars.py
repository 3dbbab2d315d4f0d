"""The bars of the sequential tests, from the mean run length to a requested false alarm.

A one-sided CUSUM of independent z ~ N(0, 1) for a shift of the mean by ``shift``:

    W <- max(0, W + shift z - shift^2 / 2),   alarm at W >= bar                                          (Page 1954)

is, in units of z, S <- max(0, S + z - k) with k = shift / 2, alarm at S >= h = bar / shift.  Its mean run length L(s) from S = s obeys

    L(s) = 1 + L(0) Phi(k - s) + integral_0^h L(t) phi(t + k - s) dt

which is solved at the nodes of a Gauss-Legendre quadrature, the continuous limit of the Markov chain of Brook & Evans (1972).
Siegmund's closed form (1985, 2.56) is its check, in the tests.

Several tests alarm together as soon as one does.  Each gets an equal share of the rate: of m tests each has m times the run length, so
that n rests give a false alarm with a probability of at most n over the run length, however the tests depend on each other.  No bar is
above the logarithm of its run length, since that is at least exp(bar) (Lorden 1971).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

#: run lengths beyond this one grow with exp(bar), its limit (Lorden 1971); 64-bit equations lose them from 1e11 on
MOST = 1e9
#: nodes of the quadrature: some two in a unit of z for the longest bars
NODES = 160


def run_length(shift: float, bar: float) -> float:
    """Mean number of z until a false alarm of one one-sided test."""
    k, h = shift / 2, bar / shift
    node, weight = np.polynomial.legendre.leggauss(NODES)
    s, w = h * (node + 1) / 2, h * weight / 2

    def row(at: np.ndarray) -> np.ndarray:
        kernel = np.exp(-((s[None] + k - at[:, None]) ** 2) / 2) / np.sqrt(2 * np.pi) * w
        return np.column_stack([ndtr(k - at), kernel])

    at = np.concatenate([[0.0], s])
    return float(np.linalg.solve(np.eye(len(at)) - row(at), np.ones(len(at)))[0])


def squares_run_length(ratio: float, freedom: int, bar: float) -> float:
    """Mean run length of a CUSUM that looks for a chi-square of ``freedom`` degrees of freedom whose sigma is ``ratio`` times as large.

    Its increments are log likelihood ratios, x (1 - ratio^-2) / 2 - freedom log(ratio), x the chi-square.
    """
    from scipy.stats import chi2  # heavy

    slope, offset = (1 - ratio**-2) / 2, freedom * np.log(ratio)
    count = 400
    edges = np.linspace(0, bar, count + 1)
    middle = (edges[:-1] + edges[1:]) / 2
    # Brook & Evans: the chain is at 0, or in one of the cells.
    at = np.concatenate([[0.0], middle])
    below = chi2.cdf((edges[None] - at[:, None] + offset) / slope, freedom)
    moves = np.column_stack([below[:, 0], np.diff(below, axis=1)])
    return float(np.linalg.solve(np.eye(len(at)) - moves, np.ones(len(at)))[0])


@cache
def bar_of(run_length: Callable[..., float], length: float, *of: float) -> float:
    """The bar of one one-sided test, whose mean run length, a function of these numbers and the bar, is ``length``."""
    if length > MOST:
        return bar_of(run_length, MOST, *of) + float(np.log(length / MOST))
    return float(brentq(lambda bar: np.log(run_length(*of, bar) / length), 1e-3, np.log(length), xtol=1e-6))
