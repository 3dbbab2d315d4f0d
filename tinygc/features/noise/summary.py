"""What a rest shows of the noise, in constant memory: second moments of block means at each scale.

A block is a power of two of samples, about half a second.  Within it the readings are averaged level by level; at each level a window of
M neighbouring means gives M - 1 contrasts, its discrete cosines without the mean, and only the sums of their products are kept.  A
window's contrasts do not contain its mean, so that the next level has what this one leaves.  Above a block its means are kept
themselves, one in half a second: ``scales`` builds the coarser levels of them when the whole rest is known.

The sums are kept by chunks of neighbouring blocks, so that a knock or a noisy spell can be left out afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from session.base.errors import DataError
from session.base.units import NS
from session.log.samples import Samples
from session.log.thermometer import NO_GRID, Grid, grid_with

#: s: no more of a block; a still of a session holds one or two
SUMS_S = 0.5
#: samples of a block, at least; means of a window, at most
LEAST_BLOCK, MOST_WINDOW = 16, 16
#: periods without a reading that end a run; fewer missing rows shift the noise by no more than their own time
GAP_PERIODS = 4.5
#: stamps are multiples of one period to this share of it, nearly all of them, in pieces of so many steps or more
EVEN, MOSTLY, FEWEST_STEPS = 0.2, 0.98, 64
#: of sums in memory at once: 30 MB; beyond, neighbours are joined
MOST_CHUNKS = 1024
#: samples of a section whose spectrum is looked at for lines; sections, at most
SECTION, MOST_SECTIONS = 2048, 64
#: blocks: six weeks
MOST_BLOCKS = 8_000_000
#: gyroscope x y z, accelerometer x y z
CHANNELS = 6


@cache
def contrasts(count: int) -> np.ndarray:
    """Return orthonormal contrasts (M, M - 1) of M means: the discrete cosines (DCT-II) but the constant."""
    at = (np.arange(count)[:, None] + 0.5) * np.arange(1, count)[None]
    return np.asarray(np.cos(np.pi * at / count) * np.sqrt(2 / count))


def ratios_of(samples: int) -> tuple[int, ...]:
    """Return the windows of the levels that lead from a sample to a power of two of them, about equal, none above ``MOST_WINDOW``."""
    octaves = int(samples).bit_length() - 1
    levels = -(-octaves // (MOST_WINDOW.bit_length() - 1))
    return tuple(2 ** (octaves // levels + (k < octaves % levels)) for k in range(levels))


@dataclass(frozen=True, eq=False)
class Blocks:
    """Means of blocks in the order of time, B blocks of ``size`` samples, less the first reading.

    number (B,): which block of the rest's time; run (B,): which run without a gap; chunk (B,): which chunk of sums holds it; mean (B, 6)
    rad/s, m/s^2; temp_c (B,) degC, NaN without; peak (B, 6): farthest reading from the mean; stuck (B,): readings that repeat all six;
    grid of the thermometer's readings.
    """

    size: int
    number: np.ndarray
    run: np.ndarray
    chunk: np.ndarray
    mean: np.ndarray
    temp_c: np.ndarray
    peak: np.ndarray
    stuck: np.ndarray
    grid: Grid = NO_GRID

    def __len__(self) -> int:
        return len(self.number)


class RestSums:
    """Statistics of one rest log or of one still, piece by piece in the order of time.

    rate_hz: data rate, measured or nominal; rests of one estimate have the same.
    """

    def __init__(self, rate_hz: float):
        if not 0 < rate_hz < 1e6:
            raise DataError(f"the data rate is {rate_hz:g} Hz, expected above 0 and below 1e6")
        self.rate_hz = float(rate_hz)
        self.size = max(LEAST_BLOCK, 2 ** int(np.floor(np.log2(rate_hz * SUMS_S)))) if rate_hz * SUMS_S >= 1 else LEAST_BLOCK
        self.ratios = ratios_of(self.size)
        self.samples, self._grid = 0, NO_GRID
        self._each = 1  # blocks of a chunk
        self._sums: list[list[np.ndarray]] = [[] for _ in self.ratios]  # by level: (6, chunks, M - 1, M - 1)
        self._counts: list[np.ndarray] = []  # (chunks, levels) windows
        self._chunks = 0
        self._blocks: list[tuple[np.ndarray, ...]] = []
        self._many = 0
        self._about: np.ndarray | None = None
        self._waiting = np.empty((CHANNELS + 1, 0))
        self._last_ns: int | None = None
        self._run, self._next = 0, 0
        self._sections: list[np.ndarray] = []  # (SECTION, 6), every ``_stride``-th
        self._seen, self._stride = 0, 1
        self._in_runs_ns, self._steps = 0, 0
        self._pieces: list[tuple[float, int]] = []  # readings that are missing and that are there

    @property
    def period_s(self) -> float:
        """Time between two readings, s: the usual one where readings are missing between even stamps, else the mean."""
        mean_s = self._in_runs_ns * NS / self._steps if self._steps else 1 / self.rate_hz
        return mean_s / (1 + self.lost)

    @property
    def lost(self) -> float:
        """Readings that are missing within runs, as a share of those that are there; 0 where stamps are too uneven."""
        there = sum(count for _, count in self._pieces)
        return sum(lost for lost, _ in self._pieces) / there if there else 0.0

    @property
    def duration_s(self) -> float:
        """Time within runs, s."""
        return self._in_runs_ns * NS

    def add(self, samples: Samples) -> None:
        """Add the next samples (stamps, gyro rad/s, accel m/s^2, temp degC or None).

        Raises DataError for what is not finite or too long.
        """
        if not len(samples):
            return
        t_ns = np.asarray(samples.t_ns)
        self._grid = grid_with(self._grid, samples.temp_c)
        temp = np.full(len(samples), np.nan) if samples.temp_c is None else samples.temp_c
        values = np.column_stack([samples.gyro, samples.accel, temp]).T
        if not np.isfinite(values[:3]).all() or np.isinf(values).any():
            raise DataError("readings that are no numbers; import the log first, which finds them")
        if self._about is None:
            self._about = values[:CHANNELS, 0].copy()
        values[:CHANNELS] -= self._about[:, None]
        is_first = self.samples == 0
        self.samples += len(samples)
        before = t_ns[0] if self._last_ns is None else self._last_ns
        steps = np.diff(t_ns, prepend=before)
        self._last_ns = int(t_ns[-1])
        is_gap = steps > GAP_PERIODS / self.rate_hz / NS
        self._in_runs_ns += int(steps[~is_gap].sum())
        self._count_lost(steps[~is_gap][is_first:])
        self._steps += int(np.count_nonzero(~is_gap)) - is_first
        edges = [0, *(k for k in np.flatnonzero(is_gap).tolist() if k), len(t_ns)]
        for start, stop in pairwise(edges):
            if is_gap[start]:
                # Count what waits at the levels that it fills; the next block belongs to another run
                left, self._waiting = self._waiting, np.empty((CHANNELS + 1, 0))
                self._run += 1
                if left.shape[1] >= self.ratios[0]:
                    self._levels(left[:CHANNELS], 1)
                self._next += round(steps[start] * NS * self.rate_hz / self.size)
            self._add_run(values[:, start:stop])

    def _count_lost(self, steps: np.ndarray) -> None:
        """Count the readings that are missing between stamps, where these are multiples of one period."""
        if len(steps) < FEWEST_STEPS:
            return
        period = float(np.median(steps))
        times = steps / period if period > 0 else np.zeros(len(steps))
        even = np.abs(times - np.round(times)) < EVEN
        lost = float(np.sum(np.maximum(np.round(times) - 1, 0))) if np.mean(even & (times > 0.5)) > MOSTLY else 0.0
        self._pieces.append((lost, len(steps)))

    def _add_run(self, values: np.ndarray) -> None:
        values = np.concatenate([self._waiting, values], axis=1) if self._waiting.shape[1] else values
        count = values.shape[1] // self.size
        self._waiting = values[:, count * self.size :].copy()
        whole = np.ascontiguousarray(values[:, : count * self.size])
        for start in range(0, whole.shape[1] - SECTION + 1, SECTION):
            if self._seen % self._stride == 0:
                self._sections.append(whole[:CHANNELS, start : start + SECTION].T.astype(np.float32))
            self._seen += 1
            if len(self._sections) > MOST_SECTIONS:
                self._sections, self._stride = self._sections[::2], 2 * self._stride
        begin = 0
        while begin < count:  # the length of a chunk may grow on the way
            stop = min(begin + self._each * MOST_CHUNKS // 4, count)
            self._add_blocks(whole[:, begin * self.size : stop * self.size], stop - begin)
            begin = stop

    @property
    def sections(self) -> np.ndarray:
        """Sections (K, SECTION, 6) without gaps, spread over the rest."""
        return np.stack(self._sections) if self._sections else np.empty((0, SECTION, CHANNELS), np.float32)

    def _add_blocks(self, values: np.ndarray, count: int) -> None:
        self._many += count
        if self._many > MOST_BLOCKS:
            raise DataError(f"more than {MOST_BLOCKS} blocks of {self.size / self.rate_hz:g} s; are the stamps in the unit of the header?")
        each, channels = values.reshape(CHANNELS + 1, count, self.size), slice(0, CHANNELS)
        mean = each.mean(axis=2)
        peak = np.maximum(each[channels].max(axis=2) - mean[channels], mean[channels] - each[channels].min(axis=2))
        same = np.zeros((count, self.size), dtype=bool)
        same[:, 1:] = (each[:CHANNELS, :, 1:] == each[:CHANNELS, :, :-1]).all(axis=0)
        chunk = self._chunks + np.arange(count) // self._each
        whole = count // self._each
        if whole:
            self._levels(values[channels, : whole * self._each * self.size], whole)
        if whole * self._each < count:
            self._levels(values[channels, whole * self._each * self.size :], 1)
        number = self._next + np.arange(count)
        self._next += count
        run = np.full(count, self._run)
        self._blocks.append((number, run, chunk, mean[channels].T, mean[CHANNELS], peak.T.astype(np.float32), same.sum(axis=1)))
        while self._chunks > MOST_CHUNKS:
            self._join()

    def _levels(self, values: np.ndarray, chunks: int) -> None:
        """Add chunks of equal length, values (6, n): their sums at each level."""
        counts = np.zeros((chunks, len(self.ratios)))
        for level, ratio in enumerate(self.ratios):
            windows = values.shape[1] // ratio // chunks
            values = values[:, : windows * chunks * ratio].reshape(CHANNELS, chunks, windows, ratio)
            z = values @ contrasts(ratio)
            self._sums[level].append(np.swapaxes(z, 2, 3) @ z)
            counts[:, level] = windows
            values = values.mean(axis=3).reshape(CHANNELS, chunks * windows)
        self._counts.append(counts)
        self._chunks += chunks

    def _join(self) -> None:
        """Join neighbouring chunks, two and two."""
        starts = np.arange(0, self._chunks, 2)
        self._sums = [[np.add.reduceat(np.concatenate(level, axis=1), starts, axis=1)] for level in self._sums]
        self._counts = [np.add.reduceat(np.concatenate(self._counts), starts, axis=0)]
        self._blocks = [(*block[:2], block[2] // 2, *block[3:]) for block in self._blocks]
        self._chunks, self._each = len(starts), 2 * self._each

    def ended(self) -> tuple[Blocks, list[np.ndarray], np.ndarray]:
        """Return the blocks; by level the sums (6, chunks, M - 1, M - 1); and the windows (chunks, levels) that they are of.

        What waits for the rest of its block counts at the levels that it fills; more samples may still be added.
        """
        left = self._waiting[:CHANNELS]
        sums = [[*level] for level in self._sums]
        counts = [*self._counts]
        if left.shape[1] >= self.ratios[0]:
            partial = RestSums(self.rate_hz)
            partial._levels(left, 1)
            sums = [[*own, *more] for own, more in zip(sums, partial._sums, strict=True)]
            counts += partial._counts
        wide = [ratio - 1 for ratio in self.ratios]
        summed = [np.concatenate([np.zeros((CHANNELS, 0, w, w)), *level], axis=1) for level, w in zip(sums, wide, strict=True)]
        columns = [np.concatenate(column) for column in zip(*self._blocks, strict=True)] if self._blocks else []
        number, run, chunk, mean, temp, peak, stuck = columns or (np.zeros(0, int),) * 3 + (np.zeros((0, 6)), np.zeros(0)) + (
            np.zeros((0, 6)),
            np.zeros(0, int),
        )
        blocks = Blocks(self.size, number, run, chunk, mean, temp, peak, stuck, self._grid)
        return blocks, summed, np.concatenate([np.zeros((0, len(self.ratios))), *counts])
