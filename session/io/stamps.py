"""Stamps as integers: counters and clocks that come round, and stamps that are coarser than the samples or come in bursts."""

from __future__ import annotations

import numpy as np

from session.io.errors import DataError
from session.io.numeric import MEDIAN_SIGMAS
from session.io.units import NS_PER_S

# A counter that comes round: where its stamps may be carried on, and where time only goes backward.

#: of a counter's span: what may lie between the last stamp before it comes round and the first after; at 32 bits of us, 9 minutes
NEAR_ENDS = 1 / 8


def comes_round(steps: np.ndarray, lowest: int, highest: int, span: int) -> np.ndarray:
    """Which of the steps (N,) of integer stamps are a counter of ``span`` that has come round.

    Such a step falls by nearly the whole span, and no stamp, lowest to highest, lies outside the counter: nanoseconds of an epoch, of
    which some are lost, are no counter.  A counter may be written with a sign.
    """
    counter = any(first <= lowest and highest < first + span for first in (0, -span // 2))
    return steps <= -span * (1 - NEAR_ENDS) if counter else np.zeros(len(steps), dtype=bool)


# Stamps as integers: decimal text, clocks, counters that wrap, and stamps that are coarser than the samples.

#: a counter of 32 bits, and a clock
COUNTER = 2**32
DAY_NS = 86_400 * NS_PER_S
#: stamps up to here, 146 years, can be told apart in ns without overflow
ERA_NS = 2**62
#: share of rows that repeat the stamp before them, from which on stamps are coarse and not merely stuttering
COARSE = 0.02
#: of the stamps' own step: how far counted samples may lie from coarse stamps before samples must be missing
OFF = 2.0


class Unroll:
    """Carries a wrapping counter or clock on, piece after piece; span_ns: None for stamps that count on for ever."""

    def __init__(self, span_ns: int | None):
        self._span, self._offset = span_ns, 0
        self._last: np.ndarray | None = None  # (1,) ns as written
        self._lowest = self._highest = 0
        self.wraps = 0

    def __call__(self, t_ns: np.ndarray) -> np.ndarray:
        """(N,) ns that go on from those before, from stamps (N,) ns as written."""
        if self._span is None:
            return t_ns
        before = t_ns[:1] if self._last is None else self._last
        self._lowest, self._highest = min(self._lowest, int(t_ns.min())), max(self._highest, int(t_ns.max()))
        self._last = t_ns[-1:]
        if t_ns[0] >= before[0] and (t_ns[1:] >= t_ns[:-1]).all():
            return t_ns + self._offset if self._offset else t_ns
        wrapped = comes_round(np.diff(t_ns, prepend=before), self._lowest, self._highest, self._span)
        offset = self._offset + self._span * np.cumsum(wrapped)
        self._offset, self.wraps = int(offset[-1]), self.wraps + int(wrapped.sum())
        return t_ns + offset


def fresh(t_ns: np.ndarray) -> np.ndarray:
    """(N,) bool: stamps that are later than the one before; the first is."""
    later = np.ones(len(t_ns), dtype=bool)
    np.greater(t_ns[1:], t_ns[:-1], out=later[1:])
    return later


#: of the mean step: a shorter one is a burst's, and the share of them from which on stamps are those of bursts
BURST, BURSTS = 0.3, 0.15
#: samples among which one was handed over at once
AMONG = 64


def evenly(t_ns: np.ndarray, odr_hz: float | None, name: str) -> tuple[np.ndarray, str | None]:
    """Stamps as they are, and None; or, where many samples share one or come in bursts, the samples counted along them, and a note.

    A burst's samples were taken one after the other and stamped when they were handed over.  Raises DataError where samples must be
    missing, which coarse stamps cannot place.
    """
    steps = np.diff(t_ns)
    shared = np.count_nonzero(steps == 0)
    if len(steps) < 10:
        return t_ns, None
    bursts = np.count_nonzero(steps < BURST * steps.mean())
    if shared <= COARSE * len(steps) and bursts <= BURSTS * len(steps):
        return t_ns, None
    count = np.arange(len(t_ns))
    if shared <= COARSE * len(steps):
        shares = f"{bursts} of {len(t_ns)} samples come in bursts"
        # A stamp is late by the wait for the hand-over; the least late of some dozens are right, and show whether samples are missing.
        slope, start = np.polyfit(count, (t_ns - t_ns[0]).astype(float), 1)
        late_ns = (t_ns - t_ns[0] - start - slope * count)[: len(t_ns) // AMONG * AMONG].reshape(-1, AMONG)
        if len(late_ns) > 1 and np.ptp(late_ns.min(axis=1)) <= OFF * slope:
            least = np.arange(len(late_ns)) * AMONG + late_ns.argmin(axis=1)
            slope, start = np.polyfit(least, (t_ns[least] - t_ns[0]).astype(float), 1)
            even = t_ns[0] + np.rint(start + slope * count).astype(np.int64)
            return even, f"{shares}: samples were counted along their stamps, {NS_PER_S / slope:.3f} Hz"
        return t_ns, f"{shares}, and counting along them misses them: samples are missing, or the rate changes; stamps stay as they are"
    step_ns = float(np.median(steps[steps > 0])) if shared < len(steps) else 0.0
    shares = f"{shared} of {len(t_ns)} samples share a stamp with the one before"
    if step_ns:
        # Where a stamp changes, it is right to within a sample; everywhere else only to within its own step.
        change = np.flatnonzero(steps > 0) + 1
        at = change if len(change) > 2 else count
        slope, start = np.polyfit(at, (t_ns[at] - t_ns[0]).astype(float), 1)
        fits = np.abs(t_ns - t_ns[0] - start - slope * count).max() <= OFF * step_ns
        if fits and not _lacks_samples(change, t_ns):
            even = t_ns[0] + np.rint(start + slope * count).astype(np.int64)
            return even, f"{shares} (stamps of {step_ns * 1e-6:g} ms): samples were counted along them, {NS_PER_S / slope:.3f} Hz"
    if odr_hz is None:
        raise DataError(f"{name}: {shares}, and counting along them misses them: samples are missing; log finer stamps, or give --odr HZ")
    return counted(len(t_ns), odr_hz), f"{shares}, and counting along them misses them: samples were counted at {odr_hz:g} Hz instead"


#: samples that a stamp's group may lack, beside so many times what groups usually differ by
FEW, USUALLY = 2.0, 4.0


def _lacks_samples(change: np.ndarray, t_ns: np.ndarray) -> bool:
    """Whether between two changes of the stamp (rows ``change``) far fewer samples lie than the time between them asks for."""
    if len(change) < 4:
        return False
    rows, spans = np.diff(change), np.diff(t_ns[change]).astype(float)
    each_ns = np.median(spans / rows) if (rows > 0).all() else np.inf
    lacking = spans / each_ns - rows
    usual = float(np.median(np.abs(lacking - np.median(lacking)))) / MEDIAN_SIGMAS
    return bool((lacking - np.median(lacking) > FEW + USUALLY * usual).any())


def counted(rows: int, odr_hz: float, first: int = 0) -> np.ndarray:
    """Stamps (N,) ns of samples that are only counted; first: how many came before."""
    return np.rint(np.arange(first, first + rows) * (NS_PER_S / odr_hz)).astype(np.int64)
