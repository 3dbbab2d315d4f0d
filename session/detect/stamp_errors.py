"""Errors of the stamps: how they scatter about an even clock, and how much of that the readings went along with.

A stamp that is off by e misplaces e times the change of the rate around it, whether it was rounded or came late.  A clock that truly ticks
unevenly does no harm: the readings are then those of the uneven moments, and show it wherever the rate changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from session.base.numeric import running_sum
from session.base.units import NS
from session.detect.bridging import short_gaps
from session.log.samples import Samples, once, pieces
from session.log.stamps import GAP_PERIODS, LOST, lasting_gaps

#: findings on stamps that are wrong: a likelier cause of whatever is left than any effect
JITTER, RATE_CHANGES = STAMPS = "jitter", "rate changes"
#: rows that are looked at together
TOGETHER = 1 << 18
#: numbers of which a transform is quick
ROUND = 1 << 12
#: and which of them are, times a power of two
QUICK = (1, 3, 5, 9, 15)
#: rows on either side that a reading's slope is taken over
SLOPE = 4
#: what is left of a reading by its neighbours: a movement up to the third power of time leaves nothing
BEND = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6
#: rows whose sums are taken for independent
BLOCK = 16
#: sigma of the share up to which it is known: one more uncertain is of stamps that move the rate by less than a third of its noise
RESOLVED = 1 / 3


@dataclass(frozen=True, eq=False)
class StampErrors:
    """Of one log: period_s; grid_s, the step of its stamps; covariance (L,) s^2 of their scatter about a line through some seconds, at a
    lag of so many samples; followed, sigma: share of that scatter that the readings went along with, 1 where samples were taken when their
    stamps state, 0 where they were taken evenly."""

    period_s: float
    grid_s: float
    covariance: np.ndarray
    followed: float
    sigma: float

    @property
    def scatter_s(self) -> float:
        """Rms scatter about a line through some seconds."""
        return float(np.sqrt(self.covariance[0]))

    @property
    def resolved(self) -> bool:
        """Whether the readings show if the stamps are wrong."""
        return self.sigma < RESOLVED

    @cached_property
    def share(self) -> float:
        """Share of the scatter's variance that is in error: what the readings did not follow, and never less than what the grid makes."""
        rounded = min(1.0, self.grid_s**2 / 12 / max(self.covariance[0], np.finfo(float).tiny))
        return max(rounded, min(max(1 - self.followed, 0.0), 1.0)) if self.resolved else rounded

    def density(self, count: int) -> np.ndarray:
        """(F,) by which squares at the frequencies of ``count`` numbers, and as many zeros or more, are summed as over lags."""
        size = 2 * max(count, len(self.covariance))
        lags = np.zeros(size)
        lags[: len(self.covariance)] = self.covariance
        lags[size - len(self.covariance) + 1 :] = self.covariance[:0:-1]
        found = np.maximum(np.fft.rfft(lags).real, 0.0)
        quick = min(odd << max(1, (-(-size // odd) - 1).bit_length()) for odd in QUICK)  # an even one
        if quick > size:  # the same lags among more zeros
            lags = np.fft.irfft(found, size)
            lags[size // 2] = 0.0  # no two of the numbers are so far apart
            found = np.fft.rfft(np.insert(lags, size // 2, np.zeros(quick - size))).real
        # A sum over lags, as one over frequencies: those between the first and the last count twice.
        found[1:-1] *= 2
        return found / quick

    def variance(self, moved: np.ndarray) -> np.ndarray:
        """(S, 3, 3) rad^2 of sums whose stamps' errors move them by ``moved`` (S, T, 3) rad/s: what one second late at each sample does."""
        density = self.density(moved.shape[1])
        found = np.fft.rfft(moved, 2 * (len(density) - 1), axis=1)
        return self.share * np.einsum("sfi,f,sfj->sij", found, density, found.conj(), optimize=True).real


def moved_by_stamps(steps: np.ndarray) -> np.ndarray:
    """(..., T, 3) rad/s: the sum of steps (..., T-1, 3) rad/s times their durations, by one second that each of T stamps is late."""
    none = np.zeros_like(steps[..., :1, :])
    return np.concatenate([none, steps], axis=-2) - np.concatenate([steps, none], axis=-2)


@once
def stamp_errors(samples: Samples, over_s: float) -> StampErrors:
    """Estimated from a log's own stamps and readings; over_s: what a line goes through on either side, the length of a segment."""
    pace = samples.pace
    half = max(2 * SLOPE, round(over_s / pace.period_s))
    sums, rows, blocks = np.zeros(half + 1), 0, []
    for piece, count in _even_pieces(samples, [(piece.start, piece.stop) for piece in rate_pieces(samples)]):
        off = _about_lines(samples.t_ns[piece], count, half)
        lags = np.fft.irfft(np.abs(np.fft.rfft(off, ROUND * -(-(len(off) + half) // ROUND))) ** 2)[: min(len(off), half + 1)]
        sums[: len(lags)] += lags
        rows += len(off)
        ramp, power, product = np.arange(SLOPE, -SLOPE - 1, -1.0), np.zeros(1), np.zeros(1)
        for axis in range(3):
            rate = np.asarray(samples.gyro[piece, axis], dtype=float)
            slope = np.convolve(rate, ramp / (ramp @ ramp), "same") / pace.period_s
            went, read = np.convolve(slope * off, BEND, "valid"), np.convolve(rate, BEND, "valid")
            power, product = power + _blocks(went * went), product + _blocks(went * read)
        blocks.append([power, product])
    if not rows:
        return StampErrors(pace.period_s, 0.0, np.zeros(1), 0.0, np.inf)
    power, product = np.concatenate(blocks, axis=1)
    grid = int(np.gcd.reduce([np.gcd.reduce(np.diff(part)) for _, part in pieces(samples.t_ns, overlap=1)]))
    whole = float(power.sum())
    followed = float(product.sum()) / whole if whole > 0 else 0.0
    sigma = float(np.sqrt(np.sum((product - followed * power) ** 2))) / whole if whole > 0 else np.inf
    return StampErrors(pace.period_s, grid * NS, sums / rows, followed, sigma)


def _even_pieces(samples: Samples, rates: Sequence[tuple[int, int]]) -> Iterator[tuple[slice, np.ndarray]]:
    """The rows between gaps and within rates (first and last row, behind it), no more than ``TOGETHER`` at a time, and their numbers (N,),
    by which samples lost singly are counted."""
    pace = samples.pace
    if pace.coarse:
        gaps = lasting_gaps(samples.t_ns, pace.period_s, LOST)[0]
    else:
        long_ns = GAP_PERIODS * pace.period_s / NS
        gaps = np.concatenate([row + np.flatnonzero(np.diff(part) > long_ns) for row, part in pieces(samples.t_ns, overlap=1)])
    lost = np.zeros(len(samples), dtype=np.int8)
    if not pace.coarse:
        rows, counts = short_gaps(samples)
        lost[rows + 1] = counts
    edges = np.array([0, *(gaps + 1).tolist(), len(samples)])
    # No line goes through a change of the rate.
    margin = round(LAG_S / pace.period_s)
    parts = [(start + margin * (start > 0), stop - margin * (stop < len(samples))) for start, stop in rates]
    for first, last in ((max(a, start), min(b, stop)) for a, b in pairwise(edges.tolist()) for start, stop in parts):
        for start in range(first, last, TOGETHER):
            piece = slice(start, min(start + TOGETHER, last))
            if piece.stop - start >= BLOCK + len(BEND) - 1:
                yield piece, np.arange(piece.stop - start) + np.cumsum(lost[piece], dtype=int)


def _about_lines(t_ns: np.ndarray, count: np.ndarray, half: int) -> np.ndarray:
    """(N,) s by which stamps (N,) ns of samples with these numbers (N,) are off a line through ``half`` of them on either side, fewer near
    the ends: a rate that wanders slowly leaves nothing."""
    t_s = (t_ns - t_ns[0]) * NS
    t_s = t_s - t_s[-1] / (count[-1] - count[0]) * (count - count[0])
    running = running_sum(t_s)
    row = np.arange(len(t_s))
    reach = np.minimum(half, np.minimum(row, row[::-1]))
    return t_s - (running[row + reach + 1] - running[row - reach]) / (2 * reach + 1)


def _blocks(values: np.ndarray) -> np.ndarray:
    """Sums of (N,) over ``BLOCK`` rows."""
    count = len(values) // BLOCK
    return values[: count * BLOCK].reshape(count, -1).sum(axis=1)


def angle_rms(log: Samples, errors: StampErrors, segment_s: float) -> float:
    """rad that the whole scatter of the stamps makes of a segment on its worst axis, rms over the log, were all of it in error."""
    whole = replace(errors, followed=0.0, sigma=0.0)
    square, densities = np.zeros(3), dict[int, np.ndarray]()
    for _, gyro in pieces(log.gyro, overlap=1):
        moved = moved_by_stamps((gyro[1:] + gyro[:-1]) / 2)[1:-1]
        if len(moved) not in densities:
            densities[len(moved)] = whole.density(len(moved))
        density = densities[len(moved)]
        for axis in range(3):
            found = np.fft.rfft(moved[:, axis], 2 * (len(density) - 1))
            square[axis] += whole.share * (density @ (found.real**2 + found.imag**2))
    return float(np.sqrt(square.max() / (len(log) * errors.period_s) * segment_s))


# A rate that changes within a log: a clock that was set or slewed, or a sensor that really changed its pace.
#
# Each sample's stamp against that a second later implies the rate there; medians of some seconds of them pass over gaps, late stamps and
# jumps of a coarse clock.  A rate that wanders changes little from one stretch to the next, one that was changed does so at once.

#: s between the two stamps of a rate; between the moments that are looked at; of a stretch before and behind a change, and at least
LAG_S, MOMENT_S, STRETCH_S, SHORTEST_S = 1.0, 0.5, 10.0, 3.0
#: times what the rate usually changes by from one stretch to the next; sigmas of the difference of two lines through the stamps
CHANGES, LINES_APART = 8.0, 5.0


@dataclass(frozen=True)
class RatePiece:
    """Rows from start to stop, not included, of one rate, hz with its sigma: that of a line through stamps that scatter together."""

    start: int
    stop: int
    hz: float
    sigma_hz: float


@once
def rate_pieces(samples: Samples) -> list[RatePiece]:
    """A log in pieces, each of one rate by its stamps: one piece where the rate stays."""
    period_s = samples.period_s
    lag, size = max(1, round(LAG_S / period_s)), max(1, round(MOMENT_S / period_s))
    most, least, apart = round(STRETCH_S / MOMENT_S), round(SHORTEST_S / MOMENT_S), -(-lag // size)
    count = max(0, len(samples) - lag) // size
    change = np.zeros(count)
    if count > 2 * least + apart + most:
        parts = []
        for first, last in pairwise([*range(0, count, max(1, TOGETHER // size)), count]):
            rows = slice(first * size, last * size)
            steps = samples.t_ns[rows.start + lag : rows.stop + lag] - samples.t_ns[rows]
            parts.append(np.median(steps.reshape(-1, size), axis=1) * (NS / lag / period_s))
        behind, ahead = _medians(off := np.concatenate(parts), most), _medians(off[::-1], most)[::-1]
        change[least + apart : count - least] = ahead[least + apart : count - least] - behind[least - 1 : count - least - apart - 1]
    bar = CHANGES * float(np.median(np.abs(change))) + np.finfo(np.float32).eps if count else 0.0
    edges: list[int] = []
    while count and np.abs(change).max() > bar:
        at = int(np.argmax(np.abs(change)))
        like = np.abs(change) > abs(change[at]) / 2
        start = at - int(np.argmin(like[at::-1])) + 1 if not like[: at + 1].all() else 0
        stop = at + int(np.argmin(like[at:])) if not like[at:].all() else count
        edges.append((start + stop - apart) // 2 * size)
        change[max(start - most // 2, 0) : stop + most // 2] = 0.0
    ends = [0, *sorted(edges), len(samples)]
    pieces = [_line(samples, start, stop) for start, stop in pairwise(ends) if stop > start]
    joined = pieces[:1]
    for piece in pieces[1:]:
        before = joined[-1]
        if abs(piece.hz - before.hz) > LINES_APART * np.hypot(piece.sigma_hz, before.sigma_hz):
            joined.append(piece)
        else:
            joined[-1] = _line(samples, before.start, piece.stop)
    return joined


def _medians(values: np.ndarray, most: int) -> np.ndarray:
    """(N,) of each of values (N,) and those before it, ``most`` in all, fewer near the beginning; N is ``most`` at least."""
    windows, every = sliding_window_view(values, most), TOGETHER // most
    whole = [np.median(windows[start : start + every], axis=1) for start in range(0, len(windows), every)]
    return np.concatenate([[np.median(values[:stop]) for stop in range(1, most)], *whole])


def _line(samples: Samples, start: int, stop: int) -> RatePiece:
    """The rate of the lines through the stamps between gaps, all of one slope."""
    found = []
    for piece, number in _even_pieces(samples, [(start, stop)]):
        t_s = (samples.t_ns[piece] - samples.t_ns[piece.start]) * NS
        count, t_s = number - number.mean(), t_s - t_s.mean()
        square = float(count @ count)
        own_s = float(count @ t_s) / square
        t_s -= own_s * count
        found.append((square, own_s, float(t_s @ t_s)))
    if not found:
        return RatePiece(start, stop, 1 / samples.period_s, np.inf)
    squares, each, left = np.array(found).T
    each_s = float(squares @ each / squares.sum())
    # About the common slope, what is left of each by its own, and what the two differ by.
    sigma_s = float(np.sqrt((left.sum() + squares @ (each - each_s) ** 2) / squares.sum()))
    return RatePiece(start, stop, 1 / each_s, sigma_s / each_s**2)
