"""Stamps as integers: decimal text, clocks, counters that wrap, and stamps that are coarser than the samples."""

from __future__ import annotations

from decimal import Decimal

import numpy as np

from session.common.errors import DataError
from session.common.units import NS_PER_S
from session.dialects.counter import comes_round

#: a counter of 32 bits, and a clock
COUNTER = 2**32
DAY_NS = 86_400 * NS_PER_S
#: stamps up to here, 146 years, can be told apart in ns without overflow
ERA_NS = 2**62
#: share of rows that repeat the stamp before them, from which on stamps are coarse and not merely stuttering
COARSE = 0.02
#: no time, whatever its unit
BEYOND = Decimal(10) ** 40
#: of the stamps' own step: how far counted samples may lie from coarse stamps before samples must be missing
OFF = 2.0


def exact_ns(text: str, unit_ns: int) -> int:
    """A decimal number or a clock (hh:mm:ss.ss) as integer nanoseconds.  Raises ValueError for anything else."""
    text = text.strip().strip('"')
    if ":" in text:
        hours, minutes, seconds = text.split(" ")[-1].split("T")[-1].split(":")
        return (int(hours) * 60 + int(minutes)) * 60 * NS_PER_S + exact_ns(seconds, NS_PER_S)
    try:
        return int(text) * unit_ns
    except ValueError:
        pass
    try:
        scaled = Decimal(text) * unit_ns
        if not abs(scaled) < BEYOND:  # also of "nan", and before an exponent of six digits is written out
            raise ValueError
        return int(scaled.to_integral_value())
    except (ArithmeticError, ValueError):
        raise ValueError(f"{text[:20]!r} is no time") from None


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
        steps = np.diff(t_ns, prepend=t_ns[:1] if self._last is None else self._last)
        self._lowest, self._highest = min(self._lowest, int(t_ns.min())), max(self._highest, int(t_ns.max()))
        self._last = t_ns[-1:]
        if steps.min() >= 0:
            return t_ns + self._offset
        wrapped = comes_round(steps, self._lowest, self._highest, self._span)
        offset = self._offset + self._span * np.cumsum(wrapped)
        self._offset, self.wraps = int(offset[-1]), self.wraps + int(wrapped.sum())
        return t_ns + offset


def fresh(t_ns: np.ndarray) -> np.ndarray:
    """(N,) bool: stamps that are later than the one before; the first is."""
    return np.diff(t_ns, prepend=t_ns[:1] - 1) > 0


def evenly(t_ns: np.ndarray, odr_hz: float | None, name: str) -> tuple[np.ndarray, str | None]:
    """Stamps as they are, and None; or, where many samples share one, the samples counted along the stamps, and a note.

    Raises DataError where samples must be missing, which coarse stamps cannot place.
    """
    steps = np.diff(t_ns)
    shared = np.count_nonzero(steps == 0)
    if len(steps) < 10 or shared <= COARSE * len(steps):
        return t_ns, None
    count = np.arange(len(t_ns))
    step_ns = float(np.median(steps[steps > 0])) if shared < len(steps) else 0.0
    said = f"{shared} of {len(t_ns)} samples share a stamp with the one before"
    if step_ns:
        slope, start = np.polyfit(count, (t_ns - t_ns[0]).astype(float), 1)
        if np.abs(t_ns - t_ns[0] - start - slope * count).max() <= OFF * step_ns:
            even = t_ns[0] + np.rint(start + slope * count).astype(np.int64)
            return even, f"{said} (stamps of {step_ns * 1e-6:g} ms): samples were counted along them, {NS_PER_S / slope:.3f} Hz"
    if odr_hz is None:
        raise DataError(f"{name}: {said}, and counting along them misses them: samples are missing; log finer stamps, or give --odr HZ")
    return counted(len(t_ns), odr_hz), f"{said}, and counting along them misses them: samples were counted at {odr_hz:g} Hz instead"


def counted(rows: int, odr_hz: float) -> np.ndarray:
    """Stamps (N,) ns of samples that are only counted."""
    return np.rint(np.arange(rows) * (NS_PER_S / odr_hz)).astype(np.int64)
