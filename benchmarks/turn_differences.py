"""Difference of each unit's rotation over a turn, from still to still, from the mean of all units.

No gravity is needed, so turns about the vertical count as any other.  Errors common to all units cancel: motion beyond the data rate, the
reference, the table.  Each unit's own errors show: latency of its readings, its response to a knock, its noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from session.annexes.arrays.recording import ArraySession
from session.detect.stills import SessionStills
from session.io.units import NS
from tinygc.annexes.arrays.clocks import ClockFit, Rates, session_rates
from tinygc.annexes.arrays.latency import SampleAges, SharedMotion
from tinygc.attitude.rotation import compose, conjugate, log, mapped, multiply, steps

#: s; length of the stills on both sides that is integrated with a turn
BESIDE_S = 0.25
#: s of stills for the zero rate next to a turn, at most
ZERO_S = 20.0
#: s; a longer one is no turn from still to still
LONGEST_S = 10.0


@dataclass(frozen=True, eq=False)
class TurnDifferences:
    """Differences of T turns and U units.

    log (T,); start_s and stop_s (T,) s array clock; rotation (U, T, 3) rad, each unit's minus the mean, as a vector in the first unit's
    gyroscope axes at the turn's begin; white (U, T) rad rms of its length, from each unit's noise.
    """

    log: np.ndarray
    start_s: np.ndarray
    stop_s: np.ndarray
    rotation: np.ndarray
    white: np.ndarray

    @property
    def rms_rad(self) -> np.ndarray:
        """Return (U,) root mean square of the length over all turns."""
        return np.asarray(np.sqrt(np.square(self.rotation).sum(axis=2).mean(axis=1)))


def turn_differences(
    array: ArraySession,
    fits: Sequence[ClockFit],
    ages: Sequence[SampleAges] | None = None,
    *,
    beside_s: float = BESIDE_S,
    one_zero: bool = False,
) -> TurnDifferences:
    """Compare all units' rotations; ages, if given, are subtracted from the stamps; the linear maps onto the mean use all readings.

    beside_s: s of the stills on both sides that are integrated with the turn; one_zero: one zero rate for the whole recording, as in a fit,
    instead of that of the stills next to each turn.
    """
    rates = [session_rates(unit) for unit in array.units]
    motion = SharedMotion(rates, fits)
    if ages is not None:
        motion.correct([[each.age_s(one.t_s) for one in mine] for each, mine in zip(ages, rates, strict=True)])
    motion.differences()
    motion.differences()
    turns = _turns(array, rates)
    zeros = [[_zeros(motion.moved[unit][turn[0]], turn) for turn in turns] for unit in range(len(array))]
    kept = [k for k in range(len(turns)) if all(unit[k] is not None for unit in zeros)]
    if one_zero and kept:
        means = [np.mean([zero for zero in unit if zero is not None], axis=(0, 1)) for unit in zeros]
        zeros = [[np.tile(mean, (2, 1)) for _ in turns] for mean in means]
    rotation, white = np.zeros((len(array), len(kept), 3)), np.zeros((len(array), len(kept)))
    for place, k in enumerate(kept):
        number = turns[k][0]
        ends = []
        for unit in range(len(array)):
            mine, zero = motion.moved[unit][number], zeros[unit][k]
            assert zero is not None
            q, white[unit, place] = _turned(mine, motion.maps[unit], zero, turns[k][1:], beside_s)
            ends.append(q)
        mean = Rotation.from_quat(np.array(ends)[:, [1, 2, 3, 0]]).mean().as_quat()[[3, 0, 1, 2]]
        rotation[:, place] = log(multiply(np.array(ends), conjugate(mean)[None]))
    share = 1 - 1 / len(array)
    # the mean includes every unit's noise
    both = np.sqrt(np.square(white) * share**2 + (np.square(white).sum(axis=0) - np.square(white)) / len(array) ** 2)
    picked = [turns[k] for k in kept]
    log_number, start_s, stop_s = (np.array([turn[i] for turn in picked]) for i in (0, 2, 3))
    return TurnDifferences(log_number, start_s, stop_s, rotation, both)


def _turns(array: ArraySession, rates: Sequence[Sequence[Rates]]) -> list[tuple[int, float, float, float, float]]:
    """Return each turn's log, and s of the array's clock: begin of the still before, of the turn, of the still after, and its end.

    Saturated turns are left out.
    """
    first, found = SessionStills(array.units[0]), []
    for number, each in enumerate(array.units[0].logs):
        stills = [still for still in first.of(each).stills if still.problem is None]
        t_s = each.samples.t_ns * NS
        for one, other in pairwise(stills):
            if other.start < one.stop or t_s[other.start] - t_s[one.stop - 1] > LONGEST_S:
                continue
            found.append((number, t_s[one.start], t_s[one.stop - 1], t_s[other.start], t_s[other.stop - 1]))
    return found


def _zeros(rates: Rates, turn: tuple[int, float, float, float, float]) -> np.ndarray | None:
    """Return (2, 3) rad/s: zero rates of a unit in the stills before and after; None where the turn clips, or a still lacks readings."""
    _, before, begin, end, after = turn
    inside = (rates.t_s > begin - BESIDE_S) & (rates.t_s < end + BESIDE_S)
    sides = [
        (rates.t_s >= max(before, begin - ZERO_S)) & (rates.t_s <= begin),
        (rates.t_s >= end) & (rates.t_s <= min(after, end + ZERO_S)),
    ]
    if not inside.any() or not rates.good[inside].all() or any(np.count_nonzero(side) < 3 for side in sides):
        return None
    return np.array([rates.rate[side].mean(axis=0) for side in sides])


def _turned(
    rates: Rates, to_first: np.ndarray, zero: np.ndarray, turn: tuple[float, float, float, float], beside_s: float
) -> tuple[np.ndarray, float]:
    """Return the quaternion of a turn's rotation, and its error from white noise, rad rms.

    turn: begins of the still before, of the turn, of the still after, and its end.
    """
    before, after = turn[0], turn[3]
    begin, end = max(before, turn[1] - beside_s), min(after, turn[2] + beside_s)
    rows = np.flatnonzero((rates.t_s > begin) & (rates.t_s < end))
    t_s = rates.t_s[rows]
    bias = zero[0] + (zero[1] - zero[0]) * ((t_s - begin) / (end - begin))[:, None]
    q = compose(steps(mapped(to_first, rates.rate[rows] - bias), np.diff(t_s)))
    scatter = float(np.sqrt(np.square(_scatter(rates, before, turn[1])).sum()))
    return np.asarray(q), scatter * np.sqrt(rates.period_s * (end - begin))


def _scatter(rates: Rates, before: float, begin: float) -> np.ndarray:
    """Return (3,) rad/s scatter of single readings in the still before."""
    rows = np.flatnonzero((rates.t_s >= max(before, begin - ZERO_S)) & (rates.t_s <= begin))
    return np.asarray(np.std(np.diff(rates.rate[rows], axis=0), axis=0) / np.sqrt(2.0)) if len(rows) > 2 else np.zeros(3)
