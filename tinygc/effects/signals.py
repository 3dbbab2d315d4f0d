"""Signals of past motion and attitude for laws with a memory, for use in an effect file.

Each function takes the fields of a ``Movement`` and returns arrays of its N samples.  All are causal.  They are integrals and lags over
time, not sums over samples, so they do not depend on the data rate, or on thinning the rests to a row a second.
How far a function reads back is a ``Reach`` here: ``lag_reach(tau_s)``, ``SLOPE`` and, for integrals since the log began, ``WHOLE``.
An effect of the last kind also declares ``inputs=("time",)``: it holds for its own session, whose logs are known from their beginning.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from session.base import rotation
from session.base.numeric import running_sum
from session.base.units import DEG
from tinygc.effects.movement import Movement, Reach

#: rad/s: a hand turns faster; a sensor at rest, with a bias of a few dps, reads less
TURNING_RPS = 10 * DEG
#: rad/s: below the first, over all axes, a calibrated rate is noise; above the second it is movement.  A hand passes both within some
#: samples.  The weight rises continuously between them: a law with a jump could only be inverted to within the jump.
MOVING_RPS, FULLY_MOVING_RPS = 1 * DEG, 3 * DEG
#: s: length of each of the two means whose difference gives the temperature rate; a package takes tens of seconds, and a register's
#: noise of 0.01 degC at 100 Hz leaves 2e-4 degC/s
SLOPE_S = 5.0
SLOPE = Reach(before_samples=1, before_s=2 * SLOPE_S)
#: time constants after which a lag has decayed to 2e-12, which is not measurable in a hand's rate
FORGOTTEN = 27.0
#: s: longer than any log
WHOLE = Reach(before_samples=1, before_s=30 * 86400.0)
#: s to either side over which the rate's derivative is computed, or a sample if that is longer: at 104 Hz between the neighbours.
#: A hand's motion at 5 Hz loses 1 %; over a sample at 833 Hz, correcting a law of 1 ms would add as much noise as there is.
DERIVATIVE_S = 0.008
DERIVATIVE = Reach.around(samples=1, seconds=DERIVATIVE_S)
#: s: averaging time of gravity when a log begins; a protocol's stills are a second
LEVEL_S = 0.5
#: share of a sampling period: rows whose spacing differs by less (jitter of the stamps) are filtered as equally spaced; a thinned rest
#: and a gap differ by more
EQUAL = 0.5


def moving_rate(movement: Movement) -> np.ndarray:
    """Return the rate (N, 3) rad/s, set to zero where the norm is below 1 dps, and unchanged from 3 dps on.

    At rest a reading is noise, and so is its sign or any other nonlinear function of it.  The means of both over a rest are correlated, so
    a law of such a function would fit the noise of every rest.
    """
    square = np.sum(movement.rate**2, axis=1, keepdims=True)
    share = (square - MOVING_RPS**2) / (FULLY_MOVING_RPS**2 - MOVING_RPS**2)
    return np.clip(share, 0.0, 1.0) * movement.rate


def angular_acceleration(movement: Movement) -> np.ndarray:
    """Return the derivative (N, 3) rad/s^2 of the rate over ``DERIVATIVE_S`` to either side, the same at any data rate."""
    if movement.dt_s >= DERIVATIVE_S:
        return movement.acceleration
    return derivative(movement.rate, movement)


def angular_jerk(movement: Movement) -> np.ndarray:
    """Return the derivative (N, 3) rad/s^3 of ``angular_acceleration``, over the same time."""
    return derivative(angular_acceleration(movement), movement)


def derivative(values: np.ndarray, movement: Movement, over_s: float = DERIVATIVE_S) -> np.ndarray:
    """Return the derivative (N, …) per s of values (N, …) that are linear between samples, over so many s to either side."""
    t_s, flat = movement.t_s, values.reshape(len(values), -1)
    if movement.dt_s >= over_s:
        return np.gradient(values, t_s, axis=0)
    ahead, behind = np.minimum(t_s + over_s, t_s[-1]), np.maximum(t_s - over_s, t_s[0])
    found = [(np.interp(ahead, t_s, column) - np.interp(behind, t_s, column)) / (ahead - behind) for column in flat.T]
    return np.stack(found, axis=-1).reshape(values.shape)


def lag_reach(tau_s: float) -> Reach:
    """Return how far a lag reads back."""
    return Reach(before_samples=1, before_s=FORGOTTEN * tau_s)


def lagged(values: np.ndarray, tau_s: float, t_s: np.ndarray) -> np.ndarray:
    """Filter values (N, …), linear between the samples at ``t_s`` (N,), by a first-order lag of ``tau_s`` that begins in the steady state
    of the first value.  Where a value is NaN the lag holds, and the result is NaN."""
    known = np.isfinite(values).reshape(len(values), -1).all(axis=1)
    if not known.all():
        found = np.full(np.shape(values), np.nan)
        if known.any():
            found[known] = lagged(values[known], tau_s, t_s[known])
        return found
    values, found = np.asarray(values, dtype=float), np.empty(np.shape(values))
    found[:1] = values[:1]
    for start, stop in _equal_runs(t_s):
        found[start + 1 : stop + 1] = _lagged_evenly(
            values[start : stop + 1], found[start], tau_s, float(t_s[stop] - t_s[start]) / (stop - start)
        )
    return found


def _equal_runs(t_s: np.ndarray) -> list[tuple[int, int]]:
    """Return ranges (first, last) of equally spaced rows; the last row of each is the first of the next."""
    if len(t_s) < 2:
        return []
    steps = np.diff(t_s)
    changes = np.flatnonzero(np.abs(np.diff(steps)) > EQUAL * np.minimum(steps[1:], steps[:-1])) + 1
    edges = [0, *changes.tolist(), len(steps)]
    return list(pairwise(edges))


def _lagged_evenly(values: np.ndarray, state: np.ndarray, tau_s: float, dt_s: float) -> np.ndarray:
    """Filter rows 1 … of (M, …) from the state at row 0: exact for an input that is linear between samples (a first-order hold)."""
    from scipy.signal import lfilter  # imported late, since most fits do not need it

    keep = float(np.exp(-dt_s / tau_s))
    late = (1 - keep) * tau_s / dt_s
    now, before = 1 - late, late - keep
    return lfilter([now, before], [1, -keep], values[1:], axis=0, zi=(before * values[:1] + keep * state[None]))[0]


def temperature_rate(movement: Movement) -> np.ndarray:
    """Return the temperature rate (N,) degC/s from the means over the last five seconds and the five before; NaN where the temperature is.

    Before the log the first temperature is assumed, so the rate is too small in the first ten seconds of a warm-up.
    """
    t_s, known = movement.t_s, np.isfinite(movement.temp_c)
    found = np.full(len(t_s), np.nan)
    if not known.any():
        return found
    t_s, above = t_s[known], movement.temp_c[known] - movement.temp_c[known][0]
    integral = running_sum(np.diff(t_s) * (above[1:] + above[:-1]) / 2)
    now, then, before = (np.interp(t_s - back, t_s, integral) for back in (0.0, SLOPE_S, 2 * SLOPE_S))
    found[known] = ((now - then) - (then - before)) / SLOPE_S**2
    return found


def seconds_at_rest(movement: Movement) -> np.ndarray:
    """Return the time (N,) s since the sensor last turned faster than 10 dps, or since the log began; 0 while it turns."""
    turning = np.linalg.norm(movement.rate, axis=1) > TURNING_RPS
    t_s = movement.t_s
    last = np.where(turning, t_s, max(t_s[0], 0.0))  # a simulation begins before the first sample
    return np.maximum(t_s - np.maximum.accumulate(last), 0.0)


def last_sense(movement: Movement) -> np.ndarray:
    """Return the sense (N, 3) +1 or -1 in which each axis last turned faster than 10 dps; 0 before it has."""
    return latched(movement.rate, TURNING_RPS)


def latched(values: np.ndarray, threshold: float) -> np.ndarray:
    """Return the sign (N, …) +1 or -1 that each column of the values (N, …) had when it was last beyond ±threshold; 0 before that."""
    beyond = np.abs(values) > threshold
    number = np.arange(len(values)).reshape(-1, *[1] * (np.ndim(values) - 1))
    rows = np.maximum.accumulate(np.where(beyond, number, 0), axis=0)
    return np.take_along_axis(np.where(beyond, np.sign(values), 0.0), rows, axis=0)


def play(values: np.ndarray, width: float) -> np.ndarray:
    """Follow the values (N, …) with the backlash of a gear: the output stands until they differ by ±width, and then is drawn along.

    It begins as near to zero as the values allow.  Each row clips the state to an interval.  Clips in sequence are a clip,
    so rows are combined in runs, and then the runs in order.
    """
    count, shape = len(values), np.shape(values)[1:]
    length = max(int(np.sqrt(count)), 1)
    runs = -(-count // length)
    padded = np.concatenate([values, np.broadcast_to(values[-1:], (runs * length - count, *shape))]).reshape(runs, length, *shape)
    low, high = padded - width, padded + width
    for row in range(1, length):  # the combined clip of a run's rows so far
        own_low, own_high = low[:, row].copy(), high[:, row].copy()
        low[:, row] = np.clip(low[:, row - 1], own_low, own_high)
        high[:, row] = np.clip(high[:, row - 1], own_low, own_high)
    found, state = np.empty_like(low), np.zeros(shape)
    for run in range(runs):
        found[run] = np.clip(state, low[run], high[run])
        state = found[run, -1]
    return found.reshape(-1, *shape)[:count]


def angle_turned(movement: Movement) -> np.ndarray:
    """Return the integral (N, 3) rad of each axis' rate since the log began."""
    rate, dt_s = movement.rate, np.diff(movement.t_s)[:, None]
    turned = running_sum(dt_s * (rate[1:] + rate[:-1]) / 2)
    return turned - turned[_first(movement)]


def level_directions(movement: Movement) -> np.ndarray:
    """Return the two level directions (N, 3, 2) of ``world_directions``, in body axes."""
    return world_directions(movement)[:, :, :2]


def world_directions(movement: Movement) -> np.ndarray:
    """Return three orthogonal directions (N, 3, 3), in body axes, that are fixed in the world: two level ones, and upright.

    The first is the level part of the sensor's x axis when the log began; it is arbitrary if the x axis stood upright then.
    The first attitude is taken from gravity over half a second, in which the sensor should be still.
    From there the rate is integrated: heading and tilt drift as the rate's integral does, and with the Earth, 15 degrees an hour.
    """
    begin, t_s, rate = _first(movement), movement.t_s, movement.rate
    gravity = movement.force_g[begin:][t_s[begin:] < t_s[begin] + LEVEL_S].mean(axis=0)
    steps = rotation.exp(np.diff(t_s)[:, None] * (rate[1:] + rate[:-1]) / 2)
    turned = rotation.accumulate(np.concatenate([[[1.0, 0, 0, 0]], steps]))
    since = rotation.multiply(rotation.conjugate(turned[begin]), turned)
    attitude = rotation.multiply(rotation.from_gravity(gravity), since)
    return np.swapaxes(rotation.matrix(attitude), 1, 2)


def _first(movement: Movement) -> int:
    """Return the row at which the session begins, or the log, if later: a simulation begins before its first sample."""
    return int(np.argmax(movement.t_s >= 0)) if movement.t_s[0] < 0 else 0
