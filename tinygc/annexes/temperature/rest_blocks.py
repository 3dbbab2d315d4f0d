"""Rest logs in blocks: sweeps of the temperature, and knots few enough for a full covariance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter

from session.io.rests import RestLog
from tinygc.annexes.temperature.model import element_temperature
from tinygc.closure.floor import wander_covariance

# Rising and falling half cycles of the temperature, the units of cross-validation.

#: of the whole range: a smaller reversal of the temperature ends no sweep
TURN_SHARE = 0.25
#: degC: a log whose temperature varies by less has no sweep
LEAST_C = 2.0
#: blocks of the running median
SMOOTH = 9


@dataclass(frozen=True)
class Sweep:
    """Blocks start <= i < stop of one log; direction +1 (up) or -1 (down)."""

    log: int
    start: int
    stop: int
    direction: int


def sweeps_of(temp_c: np.ndarray, log: int = 0) -> list[Sweep]:
    """Return the half cycles of one log's temperatures (B,) degC, in the order of time; none where they hardly vary."""
    if len(temp_c) < 2 or not np.isfinite(temp_c).all():
        return []
    smooth = median_filter(temp_c, size=min(SMOOTH, len(temp_c)), mode="nearest")
    extent = float(np.ptp(smooth))
    if extent < LEAST_C:
        return []
    turns = _turning_points(smooth, TURN_SHARE * extent)
    edges = [0, *turns[1:-1], len(temp_c)]
    directions = np.sign(np.diff(smooth[turns])).astype(int)
    return [Sweep(log, start, stop, int(d)) for start, stop, d in zip(edges[:-1], edges[1:], directions, strict=True)]


def _turning_points(values: np.ndarray, least: float) -> list[int]:
    """Return the indices of the first extreme, of each reversal by at least ``least``, and of the last."""
    low = high = direction = 0
    points: list[int] = []
    for i, value in enumerate(values.tolist()):
        high = i if direction >= 0 and value > values[high] else high
        low = i if direction <= 0 and value < values[low] else low
        if direction <= 0 and value - values[low] >= least:
            points.append(low)
            direction, high = 1, i
        elif direction >= 0 and values[high] - value >= least:
            points.append(high)
            direction, low = -1, i
    points.append(high if direction > 0 else low)
    return points if len(points) > 1 else [0, len(values) - 1]


# Blocks of a rest log merged into knots, few enough for a full covariance of their noise.
#
# A polynomial of temperature is averaged over the blocks of a knot, not evaluated at the knot's mean temperature, so a knot may be wide.

#: over all logs: from 80 to 320 the sigmas grow by a fifth, and the time by fifteen (benchmarks/temperature.py knots)
MOST_KNOTS = 160
#: lags whose powers are cached, since six axes use the same grid
MOST_KEPT = 100


@dataclass(frozen=True, eq=False)
class Knots:
    """K knots from the B kept blocks of several rest logs.

    logs: kept blocks; of (K,): log of each knot; starts (K,): its first block, counted through all logs; t_s, span_s (K,) s: middle in its
    log, and averaging time; sweep (K,): number of its sweep, or 0 where there are none; direction (K,): of the temperature, +1, -1 or 0;
    temp_c (K,): mean reading; reference_c and half_c: temperatures are normalised as x = (T - reference) / half.
    """

    logs: tuple[RestLog, ...]
    of: np.ndarray
    starts: np.ndarray
    t_s: np.ndarray
    span_s: np.ndarray
    sweep: np.ndarray
    direction: np.ndarray
    temp_c: np.ndarray
    reference_c: float
    half_c: float
    _powers: dict[float, np.ndarray] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.of)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """(K, …) means over the blocks of each knot, of values (B, …)."""
        counts = np.diff(np.append(self.starts, len(values)))
        return np.add.reduceat(values, self.starts, axis=0) / counts.reshape(-1, *[1] * (values.ndim - 1))

    def element_c(self, tau_s: float) -> np.ndarray:
        """(B,) degC of the element at each block, for a lag."""
        return np.concatenate([_lagged(log, tau_s) for log in self.logs])

    def powers(self, tau_s: float, order: int) -> np.ndarray:
        """(K, order): means over each knot of x, x^2, …, where x is the element's normalised temperature."""
        kept = self._powers.get(tau_s)
        if kept is None or kept.shape[1] < order:
            x = (self.element_c(tau_s) - self.reference_c) / self.half_c
            kept = np.column_stack([self.mean(power) for power in _powers_of(x, order)]) if order else np.zeros((len(self), 0))
            if len(self._powers) < MOST_KEPT:
                self._powers[tau_s] = kept
        return kept[:, :order]

    def offsets(self) -> np.ndarray:
        """(K, L): 1 where a knot belongs to a log."""
        return (self.of[:, None] == np.arange(len(self.logs))).astype(float)

    def covariances(self) -> list[np.ndarray]:
        """(K, K) each, of noise of unit size: white of density 1 (a mean over h s has the variance 1/h), flicker of bias instability 1,
        a random walk of 1 per root of a second.  Logs are independent."""
        same = self.of[:, None] == self.of[None]
        flicker = np.where(same, wander_covariance(self.t_s, self.span_s, instability_rps=1.0), 0.0)
        walk = np.where(same, np.minimum(self.t_s[:, None], self.t_s[None]), 0.0)
        return [np.diag(1 / self.span_s), flicker, walk]


def _powers_of(x: np.ndarray, order: int) -> Iterator[np.ndarray]:
    """x, x^2 and so on."""
    power = np.ones_like(x)
    for _ in range(order):
        power = power * x
        yield power


def _lagged(log: RestLog, tau_s: float) -> np.ndarray:
    """Element temperature of one log's kept blocks; missing blocks are interpolated linearly."""
    if tau_s == 0:
        return log.temp_c
    every = np.arange(log.number[0], log.number[-1] + 1)
    return element_temperature(np.interp(every, log.number, log.temp_c), tau_s, log.block_s)[log.number - log.number[0]]


def make_knots(logs: list[RestLog], sweeps: list[Sweep]) -> Knots:
    """Merge the kept blocks of each log by their sweeps (``sweeps_of``); a log without sweeps counts as one."""
    has_temperature = all(log.has_temperature for log in logs)
    temp = np.concatenate([log.temp_c for log in logs]) if has_temperature else np.zeros(sum(map(len, logs)))
    total = sum(map(len, logs))
    rows: list[tuple] = []
    before = number = 0
    for index, log in enumerate(logs):
        own = [sweep for sweep in sweeps if sweep.log == index] or [Sweep(index, 0, len(log), 0)]
        for sweep in own:
            count = max(round(MOST_KNOTS * (sweep.stop - sweep.start) / total), 1)
            edges = np.unique(np.linspace(sweep.start, sweep.stop, min(count, sweep.stop - sweep.start) + 1).astype(int))
            for start, stop in pairwise(edges.tolist()):
                middle_s = float(log.t_s[start:stop].mean())
                mean_c = float(temp[before + start : before + stop].mean())
                rows.append((index, before + start, middle_s, (stop - start) * log.block_s, number, sweep.direction, mean_c))
            number += 1
        before += len(log)
    of, starts, t_s, span_s, sweep_number, direction, temp_c = (np.array(column) for column in zip(*rows, strict=True))
    low, high = float(temp.min()), float(temp.max())
    reference_c = float(np.round((low + high) / 2)) if has_temperature else 25.0
    half_c = max((high - low) / 2, 1.0)
    return Knots(tuple(logs), of, starts, t_s, span_s, sweep_number, direction, temp_c, reference_c, half_c)
