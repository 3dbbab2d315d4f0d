"""Rests of a log that are no reference, each with its reason: an operator who sees where the table was not left alone can do better.

A rest is what is quiet, at the rate that the stills have.  A pause of less than ``LEAST_S`` is part of a turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import DEG
from session.detect.blocks import Blocks, block_moments
from session.detect.stills import MIN_STILL_FRACTION, TURNING_RPS, Still, quiet_runs, usual_rate
from session.log.samples import Samples

LEAST_S = 0.25  #: a hand that changes its direction rests for less
KNOCK_S = 1.0  #: rests of one attitude that are parted by less were one, and something knocked at it
SAME_ATTITUDE_RAD = 0.5 * DEG  #: a table that somebody knocks at comes back to within this; a turn goes farther


@dataclass(frozen=True)
class UnusedRest:
    """start_s of the log; duration_s; cause, ``creeps``, ``turns``, ``knocked`` or ``too short``; why it is no reference, in words."""

    start_s: float
    duration_s: float
    cause: str
    why: str

    def __str__(self) -> str:
        return f"at {self.start_s:.1f} s ({self.duration_s:.1f} s): {self.why}"


def unused_rests(samples: Samples, stills: list[Still], still_s: float) -> list[UnusedRest]:
    """All of a log that ``find_stills`` did not take for a reference, in order; stills are what it found."""
    found = [UnusedRest(still.start_s, still.duration_s, "creeps", still.problem) for still in stills if still.problem]
    blocks = block_moments(samples)
    if len(blocks) < 3:
        return found
    runs, _ = quiet_runs(blocks)
    runs = [run for run in runs if (run[1] - run[0]) * blocks.duration_s >= LEAST_S]
    rates = np.array([blocks.gyro_mean[start:stop].mean(axis=0) for start, stop in runs]).reshape(-1, 3)
    lengths = np.array([stop - start for start, stop in runs], dtype=float)
    usual = np.median([still.gyro_mean for still in stills], axis=0) if stills else usual_rate(rates, lengths) if runs else np.zeros(3)
    taken = np.array([(still.start // blocks.size, -(-still.stop // blocks.size)) for still in stills], dtype=int).reshape(-1, 2)
    shortest_s = MIN_STILL_FRACTION * still_s
    for number, (run, rate) in enumerate(zip(runs, rates, strict=True)):
        if np.any((run[0] < taken[:, 1]) & (run[1] > taken[:, 0])):
            continue
        duration_s, off = (run[1] - run[0]) * blocks.duration_s, np.abs(rate - usual).max()
        cause, why = "too short", f"too short, expected {shortest_s:.2g} s"
        if off > TURNING_RPS:
            if duration_s < shortest_s:
                continue  # the middle of a slow turn
            cause, why = "turns", f"turns at a steady {off / DEG:.1f} dps"
        elif (knock_s := _knock_s(number, runs, blocks)) is not None:
            cause, why = "knocked", f"{why}: {knock_s:.1f} s of movement part it from a rest in the same attitude"
        found.append(UnusedRest(float(samples.t_s[run[0] * blocks.size]), duration_s, cause, why))
    return sorted(found, key=lambda rest: rest.start_s)


def _knock_s(number: int, runs: list[tuple[int, int]], blocks: Blocks) -> float | None:
    """s of movement between a run and a neighbour in the same attitude; None where there is no such neighbour."""
    for other in (number - 1, number + 1):
        if not 0 <= other < len(runs):
            continue
        (first, last) = sorted((runs[number], runs[other]))
        apart_s = (last[0] - first[1]) * blocks.duration_s
        down = [blocks.accel_mean[start:stop].mean(axis=0) for start, stop in (first, last)]
        angle = np.arctan2(np.linalg.norm(np.cross(*down)), down[0] @ down[1])
        if apart_s <= KNOCK_S and angle < SAME_ATTITUDE_RAD:
            return apart_s
    return None
