"""The curve of an effect's own law: what it adds at a constant movement, along the variable that it follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.common.units import DEG
from tinygc.effects import Effect, Movement
from tinygc.explanation.twin.variable import Variable


def at_constant(
    effect: Effect, theta: np.ndarray, like: Movement, variable: Variable, axis: int, at: np.ndarray, *, per_rate: bool = False
) -> np.ndarray:
    """(K,) rad/s that the effect adds to one axis at each value (K,) of the variable, in people's units; a share of the rate on request.

    like: a log whose session, sampling period and full scale count.  An effect that is asked for a share where the rate is no
    variable has it at one tenth of full scale.
    """
    count = len(at)
    vector = np.zeros((count, 3))
    rate = np.zeros((count, 3))
    if per_rate and variable.variable != "rate":
        rate[:, axis] = like.fs_rps / 10
    one = like.with_rate(rate)
    one = replace(
        one,
        t_s=np.full(count, like.t_s.mean()),
        force_g=vector,
        temp_c=np.full(count, np.nanmean(like.temp_c) if np.isfinite(like.temp_c).any() else np.nan),
        vibration_g2=np.zeros(count),
    )
    if variable.variable == "rate":
        rate[:, axis] = at * DEG
    elif variable.variable == "temperature":
        one = replace(one, temp_c=at)
    elif variable.variable == "time":
        one = replace(one, t_s=at)
    elif variable.variable == "vibration":
        one = replace(one, vibration_g2=at)
    elif variable.variable == "attitude":
        vector[:, axis if variable.axis is None else variable.axis] = -at
    added = effect.distort(one, np.asarray(theta, dtype=float)) - one.rate
    if not per_rate:
        return added[:, axis]
    return np.divide(added[:, axis], one.rate[:, axis], out=np.full(count, np.nan), where=one.rate[:, axis] != 0)
