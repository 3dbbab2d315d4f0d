"""The zero is pulled along by the turn that has just been: needs what came before a sample."""

import numpy as np
from scipy.signal import lfilter

from tinygc.effects import Effect, Movement, NoC, Parameter, Reach, axis_of, diagonal, largest

from ._exponential import decay

SECONDS = 0.7


def _follows(rate: np.ndarray, movement: Movement) -> np.ndarray:
    """(N, 3) the rate's mean over the past, as if it had always been what it is at first."""
    left = decay(movement.dt_s, SECONDS)
    return rate[0] + lfilter([1 - left], [1, -left], rate - rate[0], axis=0)


def _correct(measured: np.ndarray, movement: Movement, theta: np.ndarray) -> np.ndarray:
    """m = r + k mean(r), solved sample by sample."""
    left, back = decay(movement.dt_s, SECONDS), np.empty_like(measured)
    for axis, k in enumerate(theta):
        beyond = measured[:, axis] - measured[0, axis]
        back[:, axis] = measured[0, axis] / (1 + k) + lfilter([1, -left], [1 + k * (1 - left), -left], beyond)
    return back


EFFECT = Effect(
    id="gyro.rate_memory",
    equation="ω_i += k_i mean of ω_i over the past, forgotten within 0.7 s",
    parameter=Parameter("share", (3,), "fraction", plausible=0.02),
    observable_in=("still", "turn"),
    columns=lambda movement: diagonal(_follows(movement.rate, movement)),
    exact_correct=_correct,
    describe=lambda theta: f"{100 * abs(largest(theta)):.2f} % of the turn that has just been stays in the zero of {axis_of(theta)}",
    discriminating_motion="turn, stop at once, and look at the first second after it",
    reach=Reach(before_s=30 * SECONDS),
    conditions=("rate", "dps"),
    device=NoC("it forgets in seconds, and C is not told the data rate"),
)
