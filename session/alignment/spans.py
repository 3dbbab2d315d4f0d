"""Short spans between moments of truth, and what the gyro makes of them at any offset of the truth's clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from session.common.units import NS, NS_PER_S
from session.log.folder import Session
from session.log.samples import Samples
from session.log.truth import Truth
from session.log.truth_reading import inverse, product

#: as short as the truth allows: there the rates are greatest beside what the truth is wrong by
SPAN_S = 0.5
#: over more, what is left of a bias of some dps turns too far to be a correction
LONGEST_S = 10.0
#: spans that are looked at; they overlap where the truth has more moments, which averages its noise
MOST_SPANS = 6000
#: a step between samples that is longer than this many periods has no rate in it
GAP_PERIODS = 1.5


@dataclass(frozen=True, eq=False)
class Carried:
    """One log's attitude, carried by the gyro alone: t_s (N,) since its first sample, rate (N, 3), q (N, 4) from the identity, gaps (N,)
    counted up to each sample."""

    t_s: np.ndarray
    rate: np.ndarray
    q: np.ndarray
    gaps: np.ndarray

    def at(self, t_s: np.ndarray) -> np.ndarray:
        """(K, 4): attitude at any times, from the nearest sample by the rate that is straight to its neighbour, or holds beside a gap."""
        row, late = self._nearest(t_s)
        return product(self.q[row], turn((self.rate[row] + self._slope(row, late) * late[:, None] / 2) * late[:, None]))

    def rate_at(self, t_s: np.ndarray) -> np.ndarray:
        """(K, 3) rad/s, likewise."""
        row, late = self._nearest(t_s)
        return self.rate[row] + self._slope(row, late) * late[:, None]

    def _nearest(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(K,) rows, and s by which each time is later than its own."""
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        row = after - (t_s - self.t_s[after - 1] < self.t_s[after] - t_s)
        return row, t_s - self.t_s[row]

    def _slope(self, row: np.ndarray, late: np.ndarray) -> np.ndarray:
        other = np.clip(row + np.where(late < 0, -1, 1), 0, len(self.t_s) - 1)
        step = self.t_s[other] - self.t_s[row]
        known = (self.gaps[other] == self.gaps[row]) & (step != 0)
        return np.where(known[:, None], self.rate[other] - self.rate[row], 0.0) / np.where(known, step, 1.0)[:, None]

    @cached_property
    def _period_s(self) -> float:
        return float(np.median(np.diff(self.t_s)))

    def whole(self, begin_s: np.ndarray, end_s: np.ndarray) -> np.ndarray:
        """(K,) bool: whether the log has all samples from each begin to its end, within a period."""
        (first, early), (last, late) = self._nearest(begin_s), self._nearest(end_s)
        return (np.maximum(np.abs(early), np.abs(late)) < self._period_s) & (self.gaps[first] == self.gaps[last]) & (last > first)


def carried(samples: Samples, rate: np.ndarray) -> Carried:
    """A log's attitude by rates (N, 3) rad/s: exact for a mean rate between samples, with the coning of a straight one."""
    dt = samples.dt_s
    steps = (rate[1:] + rate[:-1]) / 2 * dt[:, None] + np.cross(rate[:-1], rate[1:]) * (dt**2 / 12)[:, None]
    q = np.concatenate([[[1.0, 0, 0, 0]], turn(steps)])
    reach = 1
    while reach < len(q):  # products of all that came before, doubling the reach
        q = np.concatenate([q[:reach], product(q[:-reach], q[reach:])])
        reach *= 2
    gaps = np.concatenate([[0], np.cumsum(dt > GAP_PERIODS * samples.period_s)])
    return Carried(samples.t_s, rate, q / np.linalg.norm(q, axis=1, keepdims=True), gaps)


def turn(vector: np.ndarray) -> np.ndarray:
    """(K, 4) of rotation vectors (K, 3) rad."""
    return Rotation.from_rotvec(vector).as_quat(scalar_first=True)


def vector(q: np.ndarray) -> np.ndarray:
    """Rotation vectors (K, 3) rad, the shorter way, of (K, 4)."""
    return Rotation.from_quat(q, scalar_first=True).as_rotvec()


@dataclass(frozen=True, eq=False)
class Spans:
    """K spans of one log: begin_s, end_s (K,) on the log's clock as the truth has it; first, last (K,) moments."""

    begin_s: np.ndarray
    end_s: np.ndarray
    first: np.ndarray
    last: np.ndarray

    def __len__(self) -> int:
        return len(self.first)

    def turned(self, q: np.ndarray) -> np.ndarray:
        """(K, 4): what attitudes (moments, 4) turn by from begin to end, in the axes at the beginning."""
        return product(inverse(q[self.first]), q[self.last])


def spans_of(samples: Samples, truth: Truth, most: int = MOST_SPANS) -> Spans:
    """Spans of ``SPAN_S`` from every moment, or of every so many; none across windows."""
    t_s = (truth.t_ns - samples.t_ns[0]) * NS
    last = np.searchsorted(truth.t_ns, truth.t_ns + round(SPAN_S * NS_PER_S * 0.999))
    last = np.maximum(last, np.arange(len(last)) + 1)
    first = np.flatnonzero(last < len(truth))
    last = last[first]
    if truth.window is not None:
        kept = truth.window[first] == truth.window[last]
        first, last = first[kept], last[kept]
    kept = t_s[last] - t_s[first] < LONGEST_S
    first, last = first[kept], last[kept]
    every = -(-len(first) // most) or 1
    return Spans(t_s[first[::every]], t_s[last[::every]], first[::every], last[::every])


def all_spans(session: Session) -> list[Spans]:
    """Of each log with its truth, no more together than ``MOST_SPANS``."""
    truths: Sequence[Truth] = session.truths or ()
    most = max(MOST_SPANS // max(len(truths), 1), 1)
    return [spans_of(log.samples, truth, most) for log, truth in zip(session.logs, truths, strict=True)]
