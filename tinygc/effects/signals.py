"""What the past and the attitude leave behind: signals that laws with a memory follow, as an effect file may compute them.

Each function takes what a ``Movement`` holds and gives arrays of its N samples.  All look back alone, so that they hold in live use.
"""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from tinygc.attitude import rotation
from tinygc.effects.movement import Movement

#: rad/s: a hand that turns is faster, a table at rest, with a bias of a few dps, is slower
TURNING_RPS = 10 * DEG
#: s: over which the rate of temperature is taken; a package takes tens of seconds, a register's noise is faster
TEMPERATURE_RATE_S = 10.0


def lagged(values: np.ndarray, tau_s: float, dt_s: float) -> np.ndarray:
    """(N, …) through a first-order lag of ``tau_s``, from rest at the first sample."""
    from scipy.signal import lfilter  # a fit that needs none of this need not wait for it

    keep = float(np.exp(-dt_s / tau_s))
    return lfilter([1 - keep], [1, -keep], values, axis=0, zi=keep * values[:1])[0]


def temperature_rate(movement: Movement) -> np.ndarray:
    """(N,) degC/s, as a lag of ten seconds sees it."""
    return (movement.temp_c - lagged(movement.temp_c, TEMPERATURE_RATE_S, movement.dt_s)) / TEMPERATURE_RATE_S


def seconds_at_rest(movement: Movement) -> np.ndarray:
    """(N,) s since the sensor last turned; 0 while it turns, and since the log began where it has not turned yet."""
    turning = np.linalg.norm(movement.rate, axis=1) > TURNING_RPS
    last = np.maximum.accumulate(np.where(turning, np.arange(len(turning)), 0))
    return movement.t_s - movement.t_s[last]


def last_sense(movement: Movement) -> np.ndarray:
    """(N, 3) +1 or -1, the sense in which each axis turned last; 0 before it has."""
    sense = np.where(np.abs(movement.rate) > TURNING_RPS, np.sign(movement.rate), 0.0)
    rows = np.maximum.accumulate(np.where(sense != 0, np.arange(len(sense))[:, None], 0), axis=0)
    return np.take_along_axis(sense, rows, axis=0)


def angle_turned(movement: Movement) -> np.ndarray:
    """(N, 3) rad, the rate of each axis summed since the log began."""
    return np.cumsum(movement.rate, axis=0) * movement.dt_s


def level_directions(movement: Movement) -> np.ndarray:
    """(N, 3, 2) in body axes: two level directions, at right angles, that are fixed in the world.

    The first is where the sensor's x axis (or y, where x stands upright) pointed when the log began.  Heading is carried by the rate alone,
    so it drifts as the rate does; the tilt is the rate's, too, from gravity's at the beginning.
    """
    first = rotation.from_gravity(movement.force_g[:1])[0]
    steps = rotation.exp(movement.rate * movement.dt_s)
    attitude = rotation.multiply(first, rotation.accumulate(steps))
    return np.swapaxes(rotation.matrix(attitude)[:, :2], 1, 2)
