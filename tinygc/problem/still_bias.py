"""Each turn's bias from the stills that adjoin it, instead of from the ends of all turns.

A still turns with the Earth, so what it measures beyond that is the bias: b = m - E^-1 R_bt w_earth, in measured units.  Between the
middles of the still before a turn and the one after it the bias is taken to run straight.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.common.errors import FitError
from tinygc.problem.problem import Problem


def rest_biases(problem: Problem) -> np.ndarray:
    """(Q, 3) rad/s, measured: the bias that each reference still shows.

    E is that of the first linear fit; its error of a percent is one of the Earth's rate, not of the bias.
    """
    rates = problem.still_rates
    return rates.rate - np.linalg.solve(problem.first.E, rates.earth.T).T


def bias_shares(problem: Problem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers (S,) of the reference stills before and after each used segment, and the share (S, T) of the latter in each sample's bias."""
    rates = problem.still_rates
    assert rates.middle_s is not None
    stills = [still for log in problem.logs for still in log.stills if still.problem is None]
    number = {id(still): q for q, still in enumerate(stills)}
    first = np.array([number[id(segment.first)] for segment in problem.used])
    last = np.array([number[id(segment.last)] for segment in problem.used])
    began = problem.began_s
    start = np.array([began[segment.log] + segment.start_s for segment in problem.used])
    at_s = start[:, None] + np.concatenate([np.zeros((len(first), 1)), np.cumsum(problem.batch.dt, axis=1)], axis=1)
    before, after = rates.middle_s[first][:, None], rates.middle_s[last][:, None]
    return first, last, np.clip((at_s - before) / (after - before), 0.0, 1.0)


def with_still_bias(problem: Problem) -> Problem:
    """The problem with every turn at the session's mean bias, which its ``rest_rps`` then has: only E is left to be found.

    What a turn's bias is apart from the mean is taken off as the Earth's rate is: for any model, without touching what it is given.
    Raises FitError where the turns do not lie between stills (a truth file).
    """
    if problem.session.truths is not None or not len(problem.still_rates.rate):
        raise FitError("the turns of this session do not lie between stills, so these show no bias of theirs; fit without --bias stills")
    bias = rest_biases(problem)
    mean = bias.mean(axis=0)
    first, last, share = bias_shares(problem)
    apart = bias[first][:, None] * (1 - share[..., None]) + bias[last][:, None] * share[..., None] - mean
    batch = replace(problem.batch, earth=problem.batch.earth + apart @ problem.first.E.T)
    return replace(problem, batch=batch, rest_rps=mean)
