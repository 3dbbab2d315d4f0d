"""Align a truth file with its log: clock, frame and mounting from gravity and the gyroscope's rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product as combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from session.base import rotation
from session.base.numeric import nearest_row, running_sum, sigmas_in
from session.base.units import DEG, NS, NS_PER_S
from session.log.folder import Session
from session.log.samples import Samples
from tinygc.features.truth.reading import (
    ASSUMED,
    FOUND,
    FRAMES,
    GIVEN,
    ORDERS,
    SENSES,
    Truth,
    TruthAlignment,
    TruthGiven,
    TruthReading,
    changed,
    down_of,
    given_in,
)
from tinygc.inference.solve import Solution, solve

# Short spans between moments of truth, and what the gyro makes of them at any offset of the truth's clock.

#: as short as the truth allows: there the rates are greatest against the truth's own errors
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
        """(K, 4): attitude at any times, from the nearest sample by the rate that is straight to its neighbour, or holds next to a gap."""
        row, late = self.nearest(t_s)
        return rotation.multiply(self.q[row], rotation.exp((self.rate[row] + self._slope(row, late) * late[:, None] / 2) * late[:, None]))

    def rate_at(self, t_s: np.ndarray) -> np.ndarray:
        """(K, 3) rad/s, likewise."""
        row, late = self.nearest(t_s)
        return self.rate[row] + self._slope(row, late) * late[:, None]

    def nearest(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(K,) rows, and s by which each time is later than its own."""
        row = nearest_row(self.t_s, t_s)
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
        (first, early), (last, late) = self.nearest(begin_s), self.nearest(end_s)
        return (np.maximum(np.abs(early), np.abs(late)) < self._period_s) & (self.gaps[first] == self.gaps[last]) & (last > first)


def carried(samples: Samples, rate: np.ndarray) -> Carried:
    """A log's attitude by rates (N, 3) rad/s: exact for a mean rate between samples, with the coning of a straight one."""
    dt = samples.dt_s
    steps = (rate[1:] + rate[:-1]) / 2 * dt[:, None] + np.cross(rate[:-1], rate[1:]) * (dt**2 / 12)[:, None]
    q = rotation.accumulate(np.concatenate([[[1.0, 0, 0, 0]], rotation.exp(steps)]))
    gaps = running_sum(dt > GAP_PERIODS * samples.period_s)
    return Carried(samples.t_s, rate, q, gaps)


@dataclass(frozen=True, eq=False)
class Spans:
    """K spans of one log: begin_s, end_s (K,) on the log's clock as the truth has it; first, last (K,) moments."""

    begin_s: np.ndarray
    end_s: np.ndarray
    first: np.ndarray
    last: np.ndarray

    def __len__(self) -> int:
        return len(self.first)

    def pick(self, rows: Any) -> Spans:
        """Some of them."""
        return Spans(self.begin_s[rows], self.end_s[rows], self.first[rows], self.last[rows])

    def turned(self, q: np.ndarray) -> np.ndarray:
        """(K, 4): what attitudes (moments, 4) turn by from begin to end, in the axes at the beginning."""
        return rotation.multiply(rotation.conjugate(q[self.first]), q[self.last])


def _spans_of(samples: Samples, truth: Truth, most: int = MOST_SPANS) -> Spans:
    """Spans of ``SPAN_S`` from every moment, or of every so many; none across windows."""
    t_s = (truth.t_ns - samples.t_ns[0]) * NS
    last = np.searchsorted(truth.t_ns, truth.t_ns + round(SPAN_S * NS_PER_S * 0.999))
    first = np.flatnonzero(last < len(truth))
    last = last[first]
    kept = (t_s[last] - t_s[first] < LONGEST_S) & truth.sound[first] & truth.sound[last]
    if truth.window is not None:
        kept &= truth.window[first] == truth.window[last]
    first, last = first[kept], last[kept]
    every = -(-len(first) // most) or 1
    return Spans(t_s[first[::every]], t_s[last[::every]], first[::every], last[::every])


def all_spans(session: Session) -> list[Spans]:
    """Of each log with its truth, and of each an equal share of ``MOST_SPANS`` at most, rounded up."""
    truths: Sequence[Truth] = session.reference.truths
    return [_spans_of(log.samples, truth, -(-MOST_SPANS // len(truths))) for log, truth in zip(session.logs, truths, strict=True)]


# Which way a truth file's quaternions turn, whose axes they are of, and which way is up in its world.
#
# The gyro's rates show the sense of turning and the mounting: short spans' rotation vectors, seen in the body at the span's beginning, are
# the gyro's, turned by a constant rotation.  Those of an inverse attitude are the world's, which no constant rotation brings to the body.
# Cells in another order are an inverse with two constant turns, so the rates alone do not separate the two: the least mounting does.

#: the contract's own way is taken unless another leaves less than this share of what it leaves of rates and of gravity
MUCH_LESS = 0.5
#: two ways that differ by less, of all that turns, are one: cells in another order against an inverse
SAME = 0.02
#: cosine of the angle from the nearest axis: an up that is farther off belongs to no known world
UPRIGHT = 0.9
#: of the mean specific force over its mean length: a body that a gyro can follow does not fly freely
STEADY = 0.7


@dataclass(frozen=True, eq=False)
class _Way:
    """One way to read the file: misfit, the share of the truth's squared rotation that the gyro leaves; up (3,), the mean specific force
    in the file's world over its mean length, or None where the log has none; ``reading``'s mounting is the one that fits."""

    reading: TruthReading
    misfit: float
    up: np.ndarray | None

    @property
    def cost(self) -> float:
        """What rates and gravity leave together."""
        return self.misfit + (0.0 if self.up is None else max(1 - float(self.up @ self.up), 0.0))

    @property
    def mounted(self) -> float:
        """rad."""
        return float(np.linalg.norm(rotation.log(rotation.from_matrix(self.reading.mounting)[None])))


@dataclass(frozen=True, eq=False)
class AlignedLog:
    """One log: the gyro, spans of the truth at the truth's clock, the cells as they are written (moments, 4), specific force (N, 3)."""

    gyro: Carried
    spans: Spans
    written: np.ndarray
    force: np.ndarray


def ways(seen: Sequence[AlignedLog], given: TruthGiven, offset_s: float) -> list[_Way]:
    """Every way to read the files that is not ruled out by what is given, the contract's own first."""
    stated = TruthReading.of(given)
    senses = SENSES if given.sense is None else (given.sense,)
    orders = ORDERS if given.order is None else (given.order,)
    found = []
    for order, sense in combinations(orders, senses):
        reading = replace(stated, order=order, sense=sense, offset_s=offset_s)
        turns = [_turns(one, replace(reading, mounting=np.eye(3))) for one in seen]
        truth, gyro, duration = (np.concatenate(part) for part in zip(*turns, strict=True))
        mounting, misfit = _mounting(truth, gyro, duration, given.mounting)
        reading = replace(reading, mounting=mounting)
        # Sum of the force (3,) in the file's world: gravity is what is left of it.
        total, length = np.zeros(3), 0.0
        for one in seen:
            # in the file's own world
            q = rotation.multiply(rotation.conjugate(FRAMES[reading.frame]), reading.read(one.written[one.spans.first]))
            force = one.force[one.gyro.nearest(one.spans.begin_s + reading.offset_s)[0]]
            total += Rotation.from_quat(q, scalar_first=True).apply(force).sum(axis=0)  # a force that is not known is zero
            length += float(np.sum(np.linalg.norm(force, axis=1)))
        found.append(_Way(reading, misfit, total / length if length > 0 else None))
    return found


def _best_way(found: list[_Way]) -> _Way:
    """The contract's own, unless another is much better; of those that are as good, the one with the least mounting, then the earlier."""
    own, least = found[0], min(found, key=lambda way: way.cost)
    if least.cost > MUCH_LESS * own.cost:
        return own
    good = [way for way in found if way.cost < least.cost + SAME]
    # A defined world has up along its z axis.
    return min(good, key=lambda way: (round(way.mounted, 1), 0.0 if way.up is None else -abs(way.up[2])))


def _frame_of(way: _Way) -> str | None:
    """The world's frame by which way is up, or None where that is not known."""
    if way.up is None or np.linalg.norm(way.up) < STEADY:
        return None
    up = way.up / np.linalg.norm(way.up)
    name = min(FRAMES, key=lambda name: up @ down_of(name))
    return name if -(up @ down_of(name)) > UPRIGHT else None


def _turns(one: AlignedLog, reading: TruthReading) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation vectors (K, 3) rad of the truth and of the gyro, and durations (K,) s, of the spans that the log has whole."""
    begin, end = one.spans.begin_s + reading.offset_s, one.spans.end_s + reading.offset_s
    kept = one.gyro.whole(begin, end)
    truth = rotation.log(one.spans.turned(reading.read(one.written)))
    gyro = rotation.log(rotation.multiply(rotation.conjugate(one.gyro.at(begin)), one.gyro.at(end)))
    # Near half a turn the shorter way is not the one that was gone.
    kept &= (np.linalg.norm(truth, axis=1) < np.pi / 2) & (np.linalg.norm(gyro, axis=1) < np.pi / 2)
    return truth[kept], gyro[kept], (end - begin)[kept]


def _mounting(truth: np.ndarray, gyro: np.ndarray, duration: np.ndarray, given: np.ndarray | None) -> tuple[np.ndarray, float]:
    """The rotation (3, 3) from the gyro's vectors (K, 3) to the truth's, a constant bias taken off, and the share of squares left."""
    bias = np.zeros(3)
    for _ in range(5):
        matrix = rotation.nearest_rotation(truth.T @ (gyro + bias * duration[:, None])) if given is None else given
        bias = np.median((truth @ matrix - gyro) / duration[:, None], axis=0)
    apart = truth - (gyro + bias * duration[:, None]) @ matrix.T
    size = np.sum(truth**2, axis=1)
    rough = np.sum(apart**2, axis=1) > 9 * np.median(np.sum(apart**2, axis=1)) + size  # wrong moments of truth
    return matrix, float(np.sum(apart[~rough] ** 2) / max(np.sum(size[~rough]), 1e-30))


# Where the truth's clock stands, roughly: where its speed of turning goes along best with the gyro's.
#
# The speed, |rate|, knows nothing of frames: it is the same in any axes, for the inverse attitude, and for a quaternion in another order.

#: a clock that differs by more from what is known of it is another clock: the correlation of two different movements would be trusted
REACH_S = 2.0
#: of the search; the speed of a hand or a vehicle hardly changes within
STEP_S = 0.01
#: a speed that goes along with another's has a coefficient near 1; unrelated movements of 100 spans have 0.1
ALIKE = 0.7
#: what is left of likeness may be by half more than at the best; a peak is the best of so many steps on either side
AS_GOOD, NEAR = 1.5, 5


def _rough_offset(gyro: Sequence[Carried], truth: Sequence[tuple[Spans, np.ndarray]], around_s: float = 0.0) -> float | None:
    """Seconds to add to the truth's stamps, or None where the speeds are not alike at any; truth: of each log, spans and the quaternions
    (K, 4) that they turn by; around_s: the middle of what is searched, an offset that is known beforehand."""
    steps = STEP_S * np.arange(-round(REACH_S / STEP_S), round(REACH_S / STEP_S) + 1)
    offsets = around_s + steps
    speeds = [np.linalg.norm(rotation.log(q), axis=1) / (s.end_s - s.begin_s) for s, q in truth]
    sums = [_summed(log) for log in gyro]
    likeness = np.array([_likeness(gyro, sums, truth, speeds, offset) for offset in offsets])
    # Movements that repeat are alike at many offsets: the nearest to the middle of those that are as good.
    likeness = np.nan_to_num(likeness, nan=-1.0)
    best = float(likeness.max())
    if best < ALIKE:
        return None
    good = np.flatnonzero(1 - likeness <= AS_GOOD * (1 - best))
    peaks = [i for i in good if likeness[i] >= likeness[max(i - NEAR, 0) : i + NEAR + 1].max()]
    return float(offsets[min(peaks, key=lambda i: abs(steps[i]))])


def _summed(log: Carried) -> np.ndarray:
    """(3, N) rad: the rate, summed in the body's own axes; each axis lies together, as it is read at hundreds of offsets."""
    steps = (log.rate[1:] + log.rate[:-1]) / 2 * np.diff(log.t_s)[:, None]
    return np.ascontiguousarray(running_sum(steps).T)


def _likeness(
    gyro: Sequence[Carried], sums: list[np.ndarray], truth: Sequence[tuple[Spans, np.ndarray]], speeds: list[np.ndarray], offset_s: float
) -> float:
    """Correlation coefficient of the speeds, over all spans that lie whole within their logs; nan for fewer than half of them."""
    ours, theirs = [], []
    for log, summed, (spans, _), speed in zip(gyro, sums, truth, speeds, strict=True):
        begin, end = spans.begin_s + offset_s, spans.end_s + offset_s
        kept = log.whole(begin, end)
        turned = [np.interp(end[kept], log.t_s, axis) - np.interp(begin[kept], log.t_s, axis) for axis in summed]
        ours.append(np.sqrt(sum(np.square(each) for each in turned)) / (end - begin)[kept])
        theirs.append(speed[kept])
    x, y = np.concatenate(ours), np.concatenate(theirs)
    if len(x) < sum(map(len, speeds)) / 2 or len(x) < 3 or not x.std() > 0 or not y.std() > 0:
        return float("nan")
    return float(np.corrcoef(x, y)[0, 1])


# Clock and mounting together with the gyro's own linear errors, by Gauss-Newton over all spans: each with its sigma.
#
# Of a span, seen in the truth's body at its beginning, the truth's turn and the gyro's differ by
#
#     e = M (R w_end - w_begin) s + M sum_k R_k (dE w_k + b) dt,      R_k from the body at k to the body at the beginning,
#
# s the truth's offset, M the mounting.  The antisymmetric part of dE is a turn of M, and goes there.

#: of independent spans: 60 angles for 13 unknowns
FEWEST = 20
STEPS = 4
#: a twentieth of the session, but no shorter than two spans and no longer than a vehicle's slow errors
BLOCKS, DRAWN_BLOCK_S = 20, (1.0, 10.0)
#: residual, in medians, at which a span's weight is a half; passes of the reweighted fit
HALF_WEIGHT, ROBUST_PASSES = 3.0, 8


class Refined(NamedTuple):
    """offset_s of the truth's clock and its sigma; mounting (3, 3) and its sigmas (3,) rad about the gyro's axes; sigmas are NaN where they
    are not known."""

    offset_s: float
    offset_sigma_s: float
    mounting: np.ndarray
    mounting_sigma: np.ndarray


def refined(seen: Sequence[AlignedLog], samples: Sequence[Samples], reading: TruthReading) -> Refined | None:
    """Estimate clock and mounting from where the ways have left them; None where there are too few spans, or they do not fix them."""
    E, b, mounting, offset_s = np.eye(3), np.zeros(3), reading.mounting, reading.offset_s
    gyro = [one.gyro for one in seen]
    for step in range(STEPS):
        if step:
            gyro = [carried(part, part.gyro @ E.T + b) for part in samples]
        now = replace(reading, mounting=mounting, offset_s=offset_s)
        rows = [span_rows(one, log, now) for one, log in zip(seen, gyro, strict=True)]
        error, columns = (np.concatenate(part) for part in list(zip(*rows, strict=True))[:2])
        block, length_s = _blocks(rows)
        if sum(_independent(part[2]) for part in rows) < FEWEST:
            return None
        solved = _solved(error, columns, block, length_s, float(np.median(np.concatenate([np.diff(part[2]) for part in rows]))))
        if solved is None:
            return None
        theta, covariance = solved
        offset_s -= float(theta[0])
        dE = -theta[1:10].reshape(3, 3)
        turn = np.array([dE[2, 1] - dE[1, 2], dE[0, 2] - dE[2, 0], dE[1, 0] - dE[0, 1]]) / 2
        mounting = mounting @ Rotation.from_rotvec(turn).as_matrix()
        E = (np.eye(3) + (dE + dE.T) / 2) @ E
        b = (np.eye(3) + (dE + dE.T) / 2) @ b - theta[10:]
    pick = np.zeros((3, 13))
    for axis, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        pick[axis, 1 + 3 * i + j], pick[axis, 1 + 3 * j + i] = 0.5, -0.5
    sigma = sigmas_in(pick @ covariance @ pick.T)
    return Refined(offset_s, float(np.sqrt(covariance[0, 0])), mounting, sigma)


def span_rows(one: AlignedLog, gyro: Carried, reading: TruthReading) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors (K, 3) rad about the gyro's axes at the beginning, their columns (K, 3, 13), and the spans' beginnings (K,) s."""
    spans: Spans = one.spans
    begin, end = spans.begin_s + reading.offset_s, spans.end_s + reading.offset_s
    kept = gyro.whole(begin, end)
    begin, end = begin[kept], end[kept]
    truth = spans.turned(reading.read(one.written))[kept]  # with the mounting: in the gyro's axes
    at_begin, at_end = gyro.at(begin), gyro.at(end)
    turned = rotation.multiply(rotation.conjugate(at_begin), at_end)
    error = rotation.log(rotation.multiply(turned, rotation.conjugate(truth)))
    matrix = Rotation.from_quat(gyro.q, scalar_first=True).as_matrix()
    weight = np.gradient(gyro.t_s)[:, None, None]
    # What a constant error of the matrix and of the bias turns by, up to each sample, in the axes that all is carried from.
    grown = np.concatenate([np.einsum("nij,nk->nijk", matrix, gyro.rate).reshape(-1, 3, 9), matrix], axis=2) * weight
    grown = np.concatenate([np.zeros((1, 3, 12)), np.cumsum((grown[1:] + grown[:-1]) / 2, axis=0)])
    back = Rotation.from_quat(at_begin, scalar_first=True).as_matrix().transpose(0, 2, 1)
    errors = np.einsum("kij,kjp->kip", back, grown[gyro.nearest(end)[0]] - grown[gyro.nearest(begin)[0]])
    spun = Rotation.from_quat(turned, scalar_first=True).apply(gyro.rate_at(end)) - gyro.rate_at(begin)
    return error, np.concatenate([spun[:, :, None], errors], axis=2), begin


def _independent(begin: np.ndarray) -> int:
    """Spans that do not overlap, of as many as there are."""
    count, free = 0, -np.inf
    for t in begin:
        if t >= free:
            count, free = count + 1, t + 0.49
    return count


def _blocks(rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> tuple[np.ndarray, float]:
    """(K,) number of each span's block, and the blocks' length, s."""
    total = sum(float(begin[-1] - begin[0]) for _, _, begin in rows if len(begin))
    length = float(np.clip(total / BLOCKS, *DRAWN_BLOCK_S))
    numbers: list[np.ndarray] = []
    first = 0
    for _, _, begin in rows:
        own = ((begin - begin[:1]) / length).astype(int)
        numbers.append(own + first)
        first += int(own[-1]) + 1 if len(own) else 0
    return np.concatenate(numbers), length


def _solved(
    error: np.ndarray, columns: np.ndarray, block: np.ndarray, length_s: float, every_s: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """theta (13,) that takes up most of the errors (K, 3), robustly, and its covariance (13, 13); None where they are not fixed.

    The covariance is that of leaving out each block (the jackknife, Bell & McCaffrey 2002), which holds where one block has most of the
    movement.  Errors go on from block to block: ``_within`` has what blocks of this length do not see of that.  every_s: from span to span.
    """
    found, weight = robust(error, columns)
    size = columns.shape[2]
    if found.rank < size:
        return None
    design, left = columns / found.size, error - columns @ found.shortest
    count = int(block.max()) + 1
    sums, normals = np.zeros((count, size)), np.zeros((count, size, size))
    np.add.at(sums, block, np.einsum("kip,ki,k->kp", design, left, weight**2))
    np.add.at(normals, block, np.einsum("kip,kiq,k->kpq", design, design, weight**2))
    others = normals.sum(axis=0) - normals
    if (np.linalg.cond(others) > 1e12).any():
        return None
    moved = np.linalg.solve(others, sums[:, :, None])[:, :, 0]
    covariance = moved.T @ moved * ((count - 1) / count) / _within(left * weight[:, None], every_s / length_s)
    return found.shortest, covariance / np.outer(found.size, found.size)


def robust(values: np.ndarray, columns: np.ndarray) -> tuple[Solution, np.ndarray]:
    """Least squares of values (K, 3) by columns (K, 3, P), and roots of the weights (K,), which fall as the square of a residual that is
    large (Cauchy's)."""
    weight = np.ones(len(values))
    for _ in range(ROBUST_PASSES):
        found = solve((columns * weight[:, None, None]).reshape(-1, columns.shape[2]), (values * weight[:, None]).ravel())
        length = np.linalg.norm(values - columns @ found.shortest, axis=1)
        weight = 1 / np.sqrt(1 + (length / max(HALF_WEIGHT * float(np.median(length)), 1e-15)) ** 2)
    return found, weight


def _within(left: np.ndarray, step: float) -> float:
    """Share of the variance of a mean that blocks show, of errors (K, 3) that are correlated like an autoregression of first order; step:
    from one to the next, in lengths of a block.

    With the correlation time T in lengths of a block it is 1 - T (1 - exp(-1 / T)): what neighbouring blocks have in common is not in it.
    T is half the sum of the autocorrelation over all lags, up to its first zero.
    """
    power, total = float(np.sum(left**2)), 0.0
    for lag in range(1, len(left)):
        correlation = float(np.sum(left[lag:] * left[:-lag])) / power if power else 0.0
        if correlation <= 0:
            break
        total += correlation
    T = step * (0.5 + total)
    return float(1 + T * np.expm1(-1 / T))


# How a truth file was read, as the results' JSON has it (docs/formats.md).


def alignment_table(alignment: TruthAlignment) -> dict:
    """What ``plain`` makes a JSON of; null there for what the recording does not show."""
    reading = alignment.reading
    return {
        "offset_s": alignment.offset_s,
        "offset_std_s": alignment.offset_sigma_s,
        "offset_used_s": reading.offset_s,
        "gyro_to_truth_deg": alignment.turned / DEG,
        "gyro_to_truth_std_deg": alignment.turned_sigma / DEG,
        "mounting": reading.mounting,
        "frame": reading.frame,
        "sense": reading.sense,
        "order": reading.order,
        "up": alignment.up,
        "source": {name.removesuffix("_s"): source for name, source in alignment.source.items()},
    }


# A session's truth files, read as session.toml states, or else as the recording shows.

#: an offset is taken off where it is as sure as this: of ten EuRoC sequences, whose clocks their authors have aligned, one shows 5.0 and
#: the others 3.0 at most, errors of truth and gyro that go along with the movement (benchmarks/truth_alignment.py)
OFFSET_SIGMAS = 6.0
#: a rotation that is larger is no gyro's misalignment: 2 % of cross-axis sensitivity, the most that data sheets of MEMS sensors allow,
#: about each of three axes; what is less stays in the gyro's matrix
MOUNTING_RAD, MOUNTING_SIGMAS = 2.0 * DEG, 5.0
#: of the truth's rotations, or they are not this gyro's
EXPLAINED = 0.5
FEWEST_SPANS = 10
#: for the search of the clock: what it costs grows with them, and its peak is as wide as a turn
ROUGH_SPANS = 600


def align(session: Session) -> Session:
    """The session with its truths reread where nothing was given and the recording shows another convention; ``alignment`` states it.

    Sessions that were aligned before are returned as they are; so is a truth that does not go with the gyro at all.
    """
    if session.reference.alignment is not None:
        return session
    given = given_in(session.config)
    stated = TruthReading.of(given)
    alignment = _alignment(session, given, stated)
    truths = tuple(truth.reread(stated, alignment.reading) for truth in session.reference.truths)
    return changed(session, truths=truths, alignment=alignment)


def _alignment(session: Session, given: TruthGiven, stated: TruthReading) -> TruthAlignment:
    source = {name: ASSUMED if value is None else GIVEN for name, value in vars(given).items()}
    if any(len(log.samples) < 3 for log in session.logs):
        return _unknown(stated, source)
    seen = _seen(session, stated)
    if sum(len(one.spans) for one in seen) < FEWEST_SPANS:
        return _unknown(stated, source)
    turns = [(one.spans, one.spans.turned(stated.read(one.written))) for one in seen]
    rough = _rough_offset([one.gyro for one in seen], [_fewer(*pair) for pair in turns], stated.offset_s)
    if rough is None:
        return _unknown(stated, source)
    # What is given is finer than the search, unless the recording contradicts it.
    start = stated.offset_s if abs(rough - stated.offset_s) < 1.5 * STEP_S and given.offset_s is not None else rough
    way = _best_way(ways(seen, given, start))
    if 1 - way.misfit < EXPLAINED:
        return _unknown(stated, source)
    found = refined(seen, [log.samples for log in session.logs], way.reading)
    if found is None:
        found = Refined(way.reading.offset_s, float("nan"), way.reading.mounting, np.full(3, np.nan))
    return _adopted(given, stated, source, way, found)


def _seen(session: Session, stated: TruthReading) -> list[AlignedLog]:
    """Spans at the truth's own stamps, and its cells as they are written."""
    found = []
    for log, truth, spans in zip(session.logs, session.reference.truths, all_spans(session), strict=True):
        own = replace(spans, begin_s=spans.begin_s - stated.offset_s, end_s=spans.end_s - stated.offset_s)
        force = session.config.accelerometer.correct(log.samples.accel)
        force = np.where(np.abs(log.samples.accel).sum(axis=1, keepdims=True) > 0, force, 0.0)
        found.append(AlignedLog(carried(log.samples, log.samples.gyro), own, stated.written(truth.q_nb), force))
    return found


def _fewer(spans: Spans, turned: np.ndarray) -> tuple[Spans, np.ndarray]:
    picked = slice(None, None, len(spans) // ROUGH_SPANS + 1)
    return spans.pick(picked), turned[picked]


def _unknown(stated: TruthReading, source: dict[str, str]) -> TruthAlignment:
    nothing = np.full(3, np.nan)
    return TruthAlignment(stated, source, float("nan"), float("nan"), nothing, nothing, None, float("nan"))


def _adopted(given: TruthGiven, stated: TruthReading, source: dict[str, str], way: _Way, found: Refined) -> TruthAlignment:
    """What is adopted of a convention and of the refined estimate; the rest stays as stated."""
    offset_s, offset_sigma_s, mounting, sigma = found
    source, reading = dict(source), replace(way.reading, mounting=stated.mounting, offset_s=stated.offset_s)
    for name in ("order", "sense"):
        if getattr(given, name) is None and getattr(reading, name) != getattr(stated, name):
            source[name] = FOUND
    frame = _frame_of(way)
    if given.frame is None and frame is not None:
        source["frame"] = FOUND
        reading = replace(reading, frame=frame)
    turned = Rotation.from_matrix(mounting).as_rotvec()
    if given.mounting is None and np.linalg.norm(turned) > MOUNTING_RAD and _sure(turned, sigma, MOUNTING_SIGMAS):
        source["mounting"] = FOUND
        reading = replace(reading, mounting=mounting)
    if given.offset_s is None and _sure(np.array([offset_s]), np.array([offset_sigma_s]), OFFSET_SIGMAS):
        source["offset_s"] = FOUND
        reading = replace(reading, offset_s=offset_s)
    return TruthAlignment(reading, source, offset_s, offset_sigma_s, turned, sigma, way.up, 1 - way.misfit)


def _sure(values: np.ndarray, sigma: np.ndarray, sigmas: float) -> bool:
    """Whether they differ from zero by so many sigmas; where no sigma is known, whether they do at all in what is known roughly."""
    return bool(np.linalg.norm(values / sigma) > sigmas) if np.isfinite(sigma).all() else bool(values.any())
