"""Rests and turns of a log by its gyroscope alone.

A block of readings is quiet where its scatter is that of this recording's quietest blocks, or far below the rate of its turns: a table's
motor also hums at rest.  A turn at constant rate is quiet as well: the rests are the quiet stretches at the rate that the log begins and
ends with, each as long as the block means stay.  A movement between two rests that turned by less than a quarter of the smallest stated
angle was a knock, and parts no rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from session.base.numeric import runs_of, sigma_of, sigma_of_steps
from session.detect.rounding import lsb_of, rounding_of_mean
from session.detect.stills import MEAN_SIGMAS, QUIET_VARIANCE_RATIO, TURNING_RPS, block_size, noise_variance
from tinygc.features.turns.clock import SampleTimes

#: of the rate of turns, the 90th percentile of the blocks' rms: less scatter is quiet, up to TURNING_RPS
HUM, TURNING_BLOCKS = 0.1, 90
#: blocks of a rest at least
FEWEST_BLOCKS = 2
#: of the smallest stated angle: what turned by less is a knock
KNOCK = 0.25


@dataclass(frozen=True, eq=False)
class Rest:
    """spans: rows ``start <= i < stop``, more than one where a knock parts them; count of samples; middle_s of the log; mean (3,) rad/s and
    variance (3,) of single readings; rounding (3,): variance of what rounding leaves in the mean; blocks (B, 3) rad/s, means over block_s
    each."""

    spans: tuple[tuple[int, int], ...]
    count: int
    middle_s: float
    mean: np.ndarray
    variance: np.ndarray
    rounding: np.ndarray
    blocks: np.ndarray
    block_s: float

    @property
    def start(self) -> int:
        """Its first row."""
        return self.spans[0][0]

    @property
    def stop(self) -> int:
        """The row behind its last."""
        return self.spans[-1][1]


@dataclass(frozen=True, eq=False)
class Movement:
    """A turn from row start to row stop, both within rests; before, after: the rest on either side, None where the log has none there."""

    start: int
    stop: int
    before: Rest | None
    after: Rest | None


def find_turns(times: SampleTimes, gyro: np.ndarray, least_rad: float) -> tuple[list[Rest], list[Movement]]:
    """Rests, in order, and the turns between, before and behind them, of readings (N, 3) rad/s.

    least_rad: the smallest angle that was turned about any axis.
    """
    size = block_size(times.period_s)
    lsb = lsb_of(gyro)
    spans = _still_spans(gyro, size, lsb)
    rests: list[Rest] = []
    for span in spans:
        rest = _rest(times, gyro, (span,), size, lsb)
        if rests and _turned(times, gyro, rests[-1], rest) < KNOCK * least_rad:
            rests[-1] = _rest(times, gyro, (*rests[-1].spans, span), size, lsb)
        else:
            rests.append(rest)
    if not rests:
        return [], []
    turns = [Movement(a.stop - 1, b.start, a, b) for a, b in pairwise(rests)]
    first, last, end = rests[0], rests[-1], len(gyro) - 1
    if _angle(times, gyro, 0, first.start, first.mean) >= KNOCK * least_rad:
        turns.insert(0, Movement(0, first.start, None, first))
    if _angle(times, gyro, last.stop - 1, end, last.mean) >= KNOCK * least_rad:
        turns.append(Movement(last.stop - 1, end, last, None))
    return rests, turns


def _still_spans(gyro: np.ndarray, size: int, lsb: float) -> list[tuple[int, int]]:
    """Rows of each quiet stretch at the rate of the rests."""
    blocks = gyro[: len(gyro) // size * size].reshape(-1, size, 3)
    if len(blocks) < FEWEST_BLOCKS:
        return []
    mean, variance = blocks.mean(axis=1), blocks.var(axis=1, ddof=1)
    noise = np.maximum(noise_variance(variance), max(lsb**2 / 12, np.finfo(float).tiny))
    with np.errstate(over="ignore"):  # readings without noise
        quiet = ((variance / noise).mean(axis=1) < QUIET_VARIANCE_RATIO) & (variance < 2 * QUIET_VARIANCE_RATIO * noise).all(axis=1)
    turning = np.percentile(np.linalg.norm(np.sqrt(mean**2 + variance), axis=1), TURNING_BLOCKS)
    quiet |= variance.sum(axis=1) < min(HUM * turning, TURNING_RPS) ** 2
    if not quiet.any():
        return []
    both = quiet[1:] & quiet[:-1]
    spread = np.maximum(sigma_of(np.diff(mean, axis=0)[both]) / np.sqrt(2) if both.any() else 0.0, np.sqrt(noise / size))
    low = quiet & (np.abs(mean - _rate_at_rest(mean, quiet)).max(axis=1) < TURNING_RPS)
    found = []
    for start, stop in zip(*runs_of(low), strict=True):
        own = sigma_of_steps(mean[start:stop]) if stop - start > FEWEST_BLOCKS else spread  # a rest may hum, and another not
        steady = (np.abs(mean[start:stop] - np.median(mean[start:stop], axis=0)) < MEAN_SIGMAS * np.maximum(own, spread)).all(axis=1)
        found += [(start + a, start + b) for a, b in zip(*runs_of(steady), strict=True) if b - a >= FEWEST_BLOCKS]
    return [(int(a) * size, int(b) * size) for a, b in found]


def _rate_at_rest(mean: np.ndarray, quiet: np.ndarray) -> np.ndarray:
    """(3,) rad/s that the rests read, of block means (B, 3) of which some are quiet (B,) bool: a turn at constant rate is quiet as well.

    A log should begin and end at rest.  Where its first and last quiet stretch do not read alike, most stretches decide: rests are alike,
    turns go both ways and about several axes.  A zero may be larger than the rate of a slow turn.
    """
    runs = [run for run in zip(*runs_of(quiet), strict=True) if run[1] - run[0] >= FEWEST_BLOCKS] or list(zip(*runs_of(quiet), strict=True))
    rates = np.array([np.median(mean[start:stop], axis=0) for start, stop in runs])
    alike = (np.abs(rates[:, None] - rates).max(axis=2) < TURNING_RPS).sum(axis=1)
    lowest = int(np.argmin(np.linalg.norm(rates, axis=1)))
    first, last = rates[0], rates[-1]
    if len(rates) > 1 and np.abs(first - last).max() < TURNING_RPS:
        return np.asarray(first if runs[0][1] - runs[0][0] >= runs[-1][1] - runs[-1][0] else last)  # a hand may have been at the other
    return np.asarray(max((rates[lowest], first, last), key=lambda rate: int(alike[np.argmin(np.abs(rates - rate).max(axis=1))])))


def _rest(times: SampleTimes, gyro: np.ndarray, spans: tuple[tuple[int, int], ...], size: int, lsb: float) -> Rest:
    rows = np.concatenate([np.arange(*span) for span in spans])
    values = gyro[rows]
    blocks = values.reshape(-1, size, 3).mean(axis=1)
    return Rest(
        spans,
        len(rows),
        float(times.t_s[rows].mean()),
        values.mean(axis=0),
        values.var(axis=0, ddof=1),
        rounding_of_mean(values, lsb),
        blocks,
        size * times.period_s,
    )


def _turned(times: SampleTimes, gyro: np.ndarray, before: Rest, after: Rest) -> float:
    """rad between two rests, less their mean rate."""
    return _angle(times, gyro, before.stop - 1, after.start, (before.mean + after.mean) / 2)


def _angle(times: SampleTimes, gyro: np.ndarray, start: int, stop: int, bias: np.ndarray) -> float:
    return float(np.linalg.norm(np.trapezoid(gyro[start : stop + 1] - bias, times.t_s[start : stop + 1], axis=0)))
