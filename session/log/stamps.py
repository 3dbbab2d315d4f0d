"""Stamps as integers: counters and clocks that come round, bad ones, and stamps that are coarser than the samples or come in bursts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from session.base.errors import DataError
from session.base.numeric import MEDIAN_SIGMAS, running_sum, runs_of
from session.base.texts import significant
from session.base.units import NS, NS_PER_S

# The true time between two samples, where single samples are missing, and where stamps are coarse or jitter.

#: data rates of session.toml: any sensor's, with room
SLOWEST_HZ, FASTEST_HZ = 0.1, 50_000.0
GAP_PERIODS = 2.5  #: a longer step between two stamps is a gap
ROUNDS = 20  #: of counting, for a period that the counts confirm; two are usual
#: long steps come evenly where a clock is coarse, and by chance where samples are lost: variance of a window's span, in periods,
#: to the number of long steps in it
EVEN = 0.4
WINDOW_LONG_STEPS = 4  #: in one window, on average
LEAST_WINDOWS = 4
STEP_OFF = 0.45  #: of a period: a step that is off by more is counted; below the half, which steps of a coarse clock may hit
#: samples on either side of a step, of which the least delayed counts: a burst of a telephone is over after 5 to 20
WINDOW = 32
LOST = 0.75  #: of a period: a step that stays and is larger has lost a sample
LAG = 512  #: samples over which late stamps give the period, where there are four times as many
LOST_SIGMA = 5  #: by which long steps must outnumber the short ones that late stamps make as often
#: steps that are counted at once
TOGETHER = 1 << 17


@dataclass(frozen=True)
class Pace:
    """period_s: the true time between two samples; coarse: stamps too coarse, or off by too much, to show that one sample is missing."""

    period_s: float
    coarse: bool = False

    @property
    def rate_hz(self) -> float:
        """The true data rate, Hz."""
        return 1 / self.period_s

    def periods(self, steps_s: np.ndarray) -> np.ndarray:
        """How many periods each of consecutive steps (N,) s holds, whole numbers: one, or more where samples are missing."""
        counts = np.rint(steps_s / self.period_s)
        return np.where(steps_s <= GAP_PERIODS * self.period_s, 1.0, counts) if self.coarse else counts

    def missing(self, steps_s: np.ndarray) -> int:
        """Samples that are missing in consecutive steps (N,) s."""
        parts = (steps_s[start : start + TOGETHER] for start in range(0, len(steps_s), TOGETHER))
        return max(0, int(sum((self.periods(part) - 1).sum() for part in parts)))


def pace_of(t_ns: np.ndarray) -> Pace:
    """The pace of stamps (N,) ns that do not go backward; those that repeat are passed over, and stamps that do not go on have none.

    Each step is counted in periods, and the period is their sum by their number: a missing sample does no harm, whether it is
    a gap or not.  A clock of 1 ms under 833 samples a second shows steps of 1 and 2 ms without a loss: there what is no gap is one period.
    """
    steps = np.diff(t_ns)
    if not (fresh := steps > 0).all():
        steps = steps[fresh]
    del fresh  # a day has as many of them as of samples
    if not len(steps):
        return Pace(np.nan)
    fine = _confirmed(steps)
    usual = _of_many(steps) if len(steps) >= 4 * WINDOW and steps.min() < (1 - STEP_OFF) * fine else fine
    # Where stamps are late by half a period, some steps count as none and the period comes out too short: then many samples give it.
    late = _late(steps, fine) or (float(steps.min()) < usual / 2 and _late(steps, usual))
    if not (late or (_even(steps, fine) and np.gcd.reduce(steps) >= fine / 2)):
        return Pace(fine * NS)
    rows = np.flatnonzero(steps > GAP_PERIODS * usual)
    if len(steps) >= 4 * WINDOW:
        rows = rows[not_caught_up(running_sum(steps), rows, usual * NS)]
    within = float(steps.sum() - steps[rows].sum()) / max(len(steps) - len(rows), 1)
    return Pace(float(steps.sum()) / (len(steps) - len(rows) + float(np.rint(steps[rows] / within).sum())) * NS, coarse=True)


def _of_many(steps: np.ndarray) -> float:
    t, lag = np.cumsum(steps), min(LAG, len(steps) // 4)
    return float(np.median(t[lag:] - t[:-lag])) / lag


def not_caught_up(t_ns: np.ndarray, rows: np.ndarray, period_s: float) -> np.ndarray:
    """(K,) bool: whether the long steps behind these rows (K,) of stamps (N,) ns last: the least late behind them are later than those
    before."""
    around = np.arange(WINDOW)
    before = np.maximum(rows[:, None] - around, 0)
    behind = np.minimum(rows[:, None] + 1 + around, len(t_ns) - 1)
    least = [((t_ns[some] - t_ns[0]) * NS - period_s * some).min(axis=1) for some in (before, behind)]
    return np.asarray(least[1] - least[0] > LOST * period_s)


def _late(steps: np.ndarray, period: float) -> bool:
    """Whether steps of two periods are as likely late stamps as lost samples."""
    short = np.count_nonzero(steps < (1 - STEP_OFF) * period)
    long = np.count_nonzero((steps > (1 + STEP_OFF) * period) & (steps <= GAP_PERIODS * period))
    return bool(long - short < LOST_SIGMA * np.sqrt(2 * short))


def _confirmed(steps: np.ndarray) -> float:
    """The period, ns, that steps (N,) of whole periods have; begun at those near the median, which lies on a tick of a coarse clock."""
    median = float(np.median(steps))
    near = steps[np.abs(steps - median) <= median / 2]
    # Of two steps or so, none may lie near the middle between them: then the shorter of its two neighbours.
    period = float(near.mean()) if len(near) else float(np.quantile(steps, 0.5, method="lower"))
    del near
    whole = float(steps.sum())
    for _ in range(ROUNDS):
        counts = steps / period
        before, period = period, whole / float(np.rint(counts, out=counts).sum())
        if abs(period / before - 1) < 1e-12:
            break
    return period


def _even(steps: np.ndarray, period: float) -> bool:
    """Whether steps that count as more than one period come too evenly for samples lost by chance."""
    gap = steps > GAP_PERIODS * period
    long = (np.rint(steps / period) > 1) & ~gap
    windows = int(long.sum()) // WINDOW_LONG_STEPS
    if windows < LEAST_WINDOWS:
        return False
    size = len(steps) // windows
    # Of spans, not of long steps: one that only a late stamp has made has a short one near it.
    spans = np.where(gap, period, steps)[: size * windows].reshape(windows, size).sum(axis=1) / period
    return float(spans.var()) < EVEN * min(WINDOW_LONG_STEPS, size - WINDOW_LONG_STEPS)


# A counter that comes round: where its stamps may be carried on, and where time only goes backward.

#: a counter of 32 bits, and a clock
COUNTER = 2**32
DAY_NS = 86_400 * NS_PER_S
#: of the span of these two: what may lie between the last stamp before it comes round and the first after; at 32 bits of us, 9 minutes
NEAR_ENDS = 1 / 8
#: rows of one round at least: with fewer a step forward cannot be distinguished from one back
LEAST_A_ROUND = 4
#: stamps up to here, 146 years, are distinct in ns without overflow
ERA_NS = 2**62
#: no time, whatever its unit
BEYOND = Decimal(10) ** 40


def decimal_ns(text: str, unit_ns: float) -> int:
    """A decimal number of a unit as integer nanoseconds, to the last digit.  Raises ValueError for anything else."""
    if isinstance(unit_ns, int):
        with suppress(ValueError):
            return int(text) * unit_ns
    try:
        scaled = Decimal(text) * Decimal(unit_ns)
        if not abs(scaled) < BEYOND:  # also of "nan", and before an exponent of six digits is written out
            raise ValueError
        return int(scaled.to_integral_value())
    except (ArithmeticError, ValueError):
        raise ValueError(f"{text[:20]!r} is no time") from None


#: share of rows that repeat the stamp before them, from which on stamps are coarse and not merely stuttering
COARSE = 0.02
#: of the stamps' own step: how far counted samples may lie from coarse stamps before samples must be missing
OFF = 2.0
#: changes of coarse stamps, with fewer of which they give no rate
FEW_CHANGES = 4


def _span_of_counter(fall: float, usual: float, lowest: float, highest: float, unit: float) -> float | None:
    """The span of a counter that has come round where its stamps fall by ``fall``; None where no counter falls so.

    It is a power of two of its tick, and the stamp behind its end is as far from the one before it as stamps usually are.  Its values,
    lowest to highest, do not reach beyond it.  The tick is the stamps' unit, or a thousandth or millionth of it, as where micros() is
    written in ms.
    """
    found = []
    for tick in (unit, unit * 1e-3, unit * 1e-6):
        span = tick * 2.0 ** math.ceil(math.log2(fall / tick))
        sound = max(-lowest, highest) < span and highest - lowest < span and usual * LEAST_A_ROUND <= span
        if sound and fall < span <= fall + GAP_PERIODS * usual:
            found.append(span)
    return min(found, default=None)


class Unroll:
    """Carries a counter or clock that comes round on, piece after piece.

    span_ns: of a usual one, in which samples may be missing where it comes round; None where there is none; unit_ns: of the stamps, a
    power of two of which any other counter's span is.
    """

    def __init__(self, span_ns: int | None, unit_ns: float | None):
        self._usual_span, self._unit, self._span = span_ns, unit_ns, 0.0
        self._last: np.ndarray | None = None  # (1,) ns as written
        self._lowest = self._highest = 0
        self.wraps = 0

    def __call__(self, t_ns: np.ndarray) -> np.ndarray:
        """(N,) ns that go on from those before, from stamps (N,) ns as written."""
        if self._last is None:
            self._last, self._lowest, self._highest = t_ns[:1], int(t_ns[0]), int(t_ns[0])
        self._lowest, self._highest = min(self._lowest, int(t_ns.min())), max(self._highest, int(t_ns.max()))
        before, self._last = self._last, t_ns[-1:]
        if t_ns[0] >= before[0] and (t_ns[1:] >= t_ns[:-1]).all():
            return t_ns + round(self.wraps * self._span) if self.wraps else t_ns
        steps = np.diff(t_ns, prepend=before)
        self._span = self._span or self._found(steps, np.flatnonzero(steps < 0))
        near = max(NEAR_ENDS * self._span, GAP_PERIODS * _usual(steps))
        count = self.wraps + np.cumsum((steps < 0) & (steps + self._span <= near) & (steps + self._span > 0))
        self.wraps = int(count[-1])
        return t_ns + np.rint(count * self._span).astype(np.int64)

    def _found(self, steps: np.ndarray, falls: np.ndarray) -> float:
        """The span of the counter that comes round, ns; 0 where none does."""
        span, fall = self._usual_span, -int(steps[falls].min())
        # Nanoseconds of an epoch, of which some are lost, are no counter.
        if span and fall >= span * (1 - NEAR_ENDS) and any(a <= self._lowest and self._highest < a + span for a in (0, -span // 2)):
            return float(span)
        usual = _usual(steps)
        if self._unit is None or not usual:
            return 0.0
        return _span_of_counter(float(np.median(-steps[falls])), usual, self._lowest, self._highest, self._unit) or 0.0


def _usual(steps: np.ndarray) -> float:
    later = steps[steps > 0]
    return float(np.median(later)) if len(later) else 0.0


#: in usual steps, between the good stamps on either side of a bad one: two, and not the one of stamps that are in the wrong order
BETWEEN = (1.5, 2 * GAP_PERIODS)


def bad_stamps(t_ns: np.ndarray) -> np.ndarray:
    """Rows (K,) of single stamps that lie beyond both neighbours, which are two steps apart; none where there are too many of them."""
    usual, apart = _usual(np.diff(t_ns)), t_ns[2:] - t_ns[:-2]
    beyond = (t_ns[1:-1] > np.maximum(t_ns[2:], t_ns[:-2])) | (t_ns[1:-1] < np.minimum(t_ns[2:], t_ns[:-2]))
    rows = np.flatnonzero(beyond & (apart > BETWEEN[0] * usual) & (apart <= BETWEEN[1] * usual)) + 1
    return rows if len(rows) <= COARSE * len(t_ns) else rows[:0]


#: a clock's own hour, by which it leaps where summer time begins or ends
HOUR_NS = 3600 * NS_PER_S
#: a board's time at its first sample after a start, at most
BOOTED_NS = 10 * NS_PER_S
#: of what it falls by: where a clock that begins again stands
BEGINS_AGAIN = 0.1
TWO_PIECES = "two pieces: split the log there, or take one with --lines FIRST-LAST"


def why_back(t_ns: np.ndarray, before_ns: int, name: str, is_clock: bool, else_do: str) -> tuple[int, str, str] | None:
    """The row from which stamps (N,) go back, what happened there and what to do; None where they go on.

    before_ns: the stamp before them; is_clock: of the day, which has not gone on where it leaps an hour forward either; else_do: what to do
    in addition to the usual.
    """
    if t_ns[0] >= before_ns and not is_clock and (t_ns[1:] >= t_ns[:-1]).all():
        return None
    steps = np.diff(t_ns, prepend=before_ns)
    back = np.flatnonzero(steps < 0)
    usual = _usual(steps)
    if is_clock:
        hour = np.flatnonzero(np.abs(np.abs(steps - usual) - HOUR_NS) <= GAP_PERIODS * usual)
        if len(hour):
            way = "forward, as where summer time begins" if steps[hour[0]] > 0 else "back, as where summer time ends"
            return int(hour[0]), f"{name} leaps 3600 s {way}", f"write the stamps in UTC or with their zone (02:30:00+01:00), {else_do}"
    if not len(back):
        return None
    row = int(back[0])
    by_s, at_ns = -int(steps[row]) / NS_PER_S, int(t_ns[row])
    if 0 <= at_ns < BOOTED_NS and at_ns < BEGINS_AGAIN * by_s * NS_PER_S:
        return row, f"{name} begins again at {at_ns / NS_PER_S:g} s: a restart", TWO_PIECES
    places = f" (and in {len(back) - 1} more places)" if len(back) > 1 else ""
    return row, f"{name} goes backward by {by_s:g} s{places}", f"split the log there, {else_do}"


def fresh(t_ns: np.ndarray) -> np.ndarray:
    """(N,) bool: stamps that are later than the one before; the first is."""
    later = np.ones(len(t_ns), dtype=bool)
    np.greater(t_ns[1:], t_ns[:-1], out=later[1:])
    return later


# Gaps among stamps that are late by chance: what came late is caught up, what is lost never is.

#: of a period: a step that stays and is larger has lost samples, if it is so many sigmas of what they usually are
STAYS, SURE = 1.5, 8.0


def lasting_gaps(t_ns: np.ndarray, period_s: float, stays: float = STAYS) -> tuple[np.ndarray, np.ndarray]:
    """Rows (G,) after which samples are lost, and by how much longer than a period each such step is, (G,) s, for stamps (N,) ns."""
    if len(t_ns) <= 2 * WINDOW:
        steps = np.diff(t_ns) * NS
        rows = np.flatnonzero(steps > (1 + stays) * period_s)
        return rows, steps[rows] - period_s
    least = sliding_window_view((t_ns - t_ns[0]) * NS - period_s * np.arange(len(t_ns)), WINDOW).min(axis=1)
    # Row i + WINDOW - 1 is the last one of window i, and the first of the window behind it is the next row.
    jumps = least[WINDOW:] - least[:-WINDOW]
    usual = float(np.median(np.abs(jumps))) / MEDIAN_SIGMAS
    firsts = runs_of(jumps > max(stays * period_s, SURE * usual))[0]
    return firsts + WINDOW - 1, np.array([jumps[first : first + WINDOW].max() for first in firsts])


#: of the mean step: a shorter one is a burst's, and the share of them from which on stamps are those of bursts
BURST, BURSTS = 0.3, 0.15
#: samples among which one was handed over at once
AMONG = 64
#: in the note of stamps along which no samples were counted
UNCOUNTED = "stamps stay as they are"
#: so many times as many samples are such a number of groups at least
FEW_GROUPS = 8
#: of a period: within it the least late of stamps that many share show that no sample is missing
STRICTLY = 0.5


def evenly(t_ns: np.ndarray, odr_hz: float | None, name: str) -> tuple[np.ndarray, str | None, float | None]:
    """Stamps as they are, and None; or, where many samples share one or come in bursts, the samples counted along them, a note, and the
    rate's relative sigma, ppm, where it is that of the stamps.

    A burst's samples were taken one after the other and stamped when they were handed over.  Raises DataError where samples must be
    missing, which coarse stamps cannot place.
    """
    steps = np.diff(t_ns)
    shared = np.count_nonzero(steps == 0)
    if len(steps) < 10:
        return t_ns, None, None
    bursts = np.count_nonzero(steps < BURST * steps.mean())
    if shared <= COARSE * len(steps) and bursts <= BURSTS * len(steps):
        return t_ns, None, None
    count = np.arange(len(t_ns))
    if shared <= COARSE * len(steps):
        shares = f"{bursts} of {len(t_ns)} samples come in bursts"
        if (found := _along_least_late(t_ns, OFF)) is not None:
            return found[0], f"{shares}: samples were counted along their stamps, {found[1]:.3f} Hz", found[2]
        return t_ns, f"{shares}, and counting along them misses them: samples are missing, or the rate changes; {UNCOUNTED}", None
    step_ns = float(np.median(steps[steps > 0])) if shared < len(steps) else 0.0
    shares = f"{shared} of {len(t_ns)} samples share a stamp with the one before"
    if odr_hz is None and len(steps) - shared < FEW_CHANGES:
        stand = f"steps of {step_ns / NS_PER_S:g} s" if step_ns else "all are one"
        raise DataError(f"{name}: the stamps have too few digits ({stand}): write at least milliseconds, or give --odr HZ")
    if step_ns:
        # Where a stamp changes, it is right to within a sample; everywhere else only to within its own step.
        change = np.flatnonzero(steps > 0) + 1
        at = change if len(change) > 2 else count
        slope, start, sigma_ppm = _line(at, (t_ns[at] - t_ns[0]).astype(float), step_ns)
        fits = np.abs(t_ns - t_ns[0] - start - slope * count).max() <= OFF * step_ns
        if fits and not _misses_samples(change, t_ns):
            even = t_ns[0] + np.rint(start + slope * count).astype(np.int64)
            note = f"{shares} (stamps of {step_ns * 1e-6:g} ms): samples were counted along them, {NS_PER_S / slope:.3f} Hz"
            return even, note, sigma_ppm
        if not fits and (found := _along_least_late(t_ns, STRICTLY)) is not None:
            return found[0], f"{shares}, those that came late: samples were counted along the least late, {found[1]:.3f} Hz", found[2]
    shares += ", and counting along them misses them"
    if odr_hz is None:
        do = "log finer stamps, or give --odr HZ"
        raise DataError(f"{name}: {shares}: samples are missing, or stamps come too late; {do}")
    return counted(len(t_ns), odr_hz), f"{shares}: samples were counted at {odr_hz:g} Hz instead", None


def _along_least_late(t_ns: np.ndarray, within: float) -> tuple[np.ndarray, float, float] | None:
    """Stamps (N,) ns on a straight line, Hz and its sigma, ppm; None where the least late lie on none, within so many periods.

    A stamp is late by the wait for the hand-over; the least late among dozens, or more, are right, and show whether samples are missing.
    """
    count, t = np.arange(len(t_ns)), (t_ns - t_ns[0]).astype(float)
    for among in (AMONG, 4 * AMONG, 16 * AMONG, 64 * AMONG):
        groups = [*np.split(count, range(among, len(count) - among + 1, among))[:-1], count[-among:]]
        if len(groups) < (2 if among == AMONG else FEW_GROUPS):
            break
        least = count
        for _ in range(2):  # by all, then by the least late of these
            slope, start = np.polyfit(least, t[least], 1)
            late_ns = t - start - slope * count
            least = np.array([group[late_ns[group].argmin()] for group in groups])
        if np.ptp(late_ns[least]) <= within * slope:
            # A few do not show how they scatter: each is known to a period.
            slope, start, sigma_ppm = _line(least, t[least], np.inf if len(least) < PARTS else float(np.gcd.reduce(np.diff(t_ns))))
            return t_ns[0] + np.rint(start + slope * count).astype(np.int64), NS_PER_S / slope, sigma_ppm
    return None


#: parts of a log whose errors are taken for independent
PARTS = 16


def _line(count: np.ndarray, t: np.ndarray, grid: float) -> tuple[float, float, float]:
    """Slope, start and the slope's relative sigma, ppm, of a line through stamps (N,) of samples with these numbers (N,).

    Each is right to within a sample, or the grid where that is finer; what is rounded in a regular pattern
    scatters less than its error.
    """
    slope, start = np.polyfit(count, t, 1)
    sigma_ppm = _sigma_ppm(count - count.mean(), t - start - slope * count, slope)
    return slope, start, max(sigma_ppm, min(grid, slope) / math.sqrt(12) / float(np.ptp(t)) * 1e6)


def _sigma_ppm(count: np.ndarray, off: np.ndarray, slope: float) -> float:
    """Relative sigma, ppm, of the slope of a line that stamps are off (N,), of samples with these numbers (N,) about their mean."""
    sums = [float(part.sum()) for part in np.array_split(count * off, PARTS)]
    return float(np.linalg.norm(sums) / (count @ count) / slope * 1e6)


def placed_between(t_ns: np.ndarray) -> np.ndarray:
    """Stamps (N,) ns in which rows that share one lie evenly between the stamps before and behind, where these are as far apart as so many
    rows take: the stamp was late, or stood still.  Others stay."""
    first = np.flatnonzero(fresh(t_ns))
    counts, period = np.diff(np.append(first, len(t_ns))), pace_of(t_ns).period_s * NS_PER_S
    placed = t_ns.copy()
    for group in np.flatnonzero(counts[1:-1] > 1) + 1 if len(counts) > 2 else ():
        begin, count = int(first[group]), int(counts[group])
        before, behind = int(t_ns[begin - 1]), int(t_ns[begin + count])
        alone = counts[group - 1] == counts[group + 1] == 1
        if alone and abs((behind - before) / (count + 1) - period) <= period / 2:
            placed[begin : begin + count] = before + np.arange(1, count + 1) * (behind - before) // (count + 1)
    return placed


#: of the rows that share a stamp with the one before: so many that are the same in all else were written twice
TWICE = 0.99


def written_once(t_ns: np.ndarray, columns: Sequence[np.ndarray]) -> np.ndarray:
    """(N,) bool: rows that do not repeat the row before them, its stamp and its readings of columns (N, …)."""
    once, shares = np.ones(len(t_ns), dtype=bool), np.flatnonzero(np.diff(t_ns) == 0)
    if len(shares):
        same = [(column[shares + 1] == column[shares]).reshape(len(shares), -1).all(axis=1) for column in columns]
        once[shares[np.all(same, axis=0)] + 1] = False
    return once


#: of a period: how far one of ``PARTS`` of a log may lie off the line
ASIDE = 0.5


def along_line(t_ns: np.ndarray, name: str) -> tuple[np.ndarray, str, float]:
    """Samples on straight lines of one slope through their stamps (N,) ns, a line between two gaps: what ``evenly`` returns.

    Raises DataError where samples are missing and no gap shows where, and where the lines miss the stamps: their rate changes.
    """
    if len(t_ns) < 2 * AMONG:
        raise DataError(f"{name}: {len(t_ns)} samples are too few for --even, expected {2 * AMONG} or more; leave it out")
    period_s = pace_of(t_ns).period_s
    gaps, lost_s = lasting_gaps(t_ns, period_s, LOST)
    if len(hidden := gaps[lost_s <= (GAP_PERIODS - 1) * period_s]):
        at_s = (t_ns[hidden[0]] - t_ns[0]) * NS
        more = f" (and in {len(hidden) - 1} more places)" if len(hidden) > 1 else ""
        raise DataError(
            f"{name}: samples are missing near {at_s:.1f} s{more}, where no gap shows it: --even would misplace all behind; leave it out"
        )
    group = np.zeros(len(t_ns), dtype=int)
    group[gaps + 1] = 1
    group = np.cumsum(group)
    size, count = np.bincount(group), np.arange(len(t_ns), dtype=float)
    t_s = (t_ns - t_ns[0]) * NS
    middle, mean_s = (np.bincount(group, weights=each) / size for each in (count, t_s))
    count -= middle[group]
    slope_s = float(count @ (t_s - mean_s[group]) / (count @ count))
    even_s = mean_s[group] + slope_s * count
    off = t_s - even_s
    aside = np.abs([np.median(part) for part in np.array_split(off, PARTS)])
    if aside.max() > ASIDE * slope_s:
        at_s = t_s[int(np.argmax(aside)) * len(t_s) // PARTS]
        what = f"counting along the stamps misses them by {aside.max() * 1e3:.4g} ms at {at_s:.1f} s"
        raise DataError(f"{name}: {what}: the rate changes, or samples are missing; leave --even out, and look at `calibrate.py check`")
    sigma_ppm = _sigma_ppm(count, off, slope_s)
    rate = f"{1 / slope_s:.3f} Hz ± {significant(sigma_ppm, 2)} ppm"
    note = f"stamps scatter by {significant(off.std() * 1e3, 2)} ms rms: counted evenly, {rate}"
    return t_ns[0] + np.rint(even_s * NS_PER_S).astype(np.int64), note, sigma_ppm


#: samples that a stamp's group may miss, in addition to so many times what groups usually differ by
FEW, USUALLY = 2.0, 4.0


def _misses_samples(change: np.ndarray, t_ns: np.ndarray) -> bool:
    """Whether between two changes of the stamp (rows ``change``) far fewer samples lie than the time between them asks for."""
    if len(change) < 4:
        return False
    rows, spans = np.diff(change), np.diff(t_ns[change]).astype(float)
    each_ns = np.median(spans / rows) if (rows > 0).all() else np.inf
    lacking = spans / each_ns - rows
    usual = float(np.median(np.abs(lacking - np.median(lacking)))) / MEDIAN_SIGMAS
    return bool((lacking - np.median(lacking) > FEW + USUALLY * usual).any())


def counted(rows: int, odr_hz: float) -> np.ndarray:
    """Stamps (N,) ns of samples that are only counted."""
    return np.rint(np.arange(rows) * (NS_PER_S / odr_hz)).astype(np.int64)
