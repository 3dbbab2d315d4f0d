"""Which reading can follow which: sequence and time unrolled, what is missing counted, what does not fit left out.

A CRC of 16 bits lets some 10⁻⁵ of heavily damaged frames through, and a text line has none.  So a reading counts only if number and
stamp agree with the one before: as many sample periods later as the number is higher.  One that does not fit waits: if the next goes
on from before, it was damaged and is left out; if two more go on from it, the device has begun anew (or changed its rate, or in text
skipped), and all three count.  The period is measured, from the stamps.  Decisions depend on the readings alone, not on how they are cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.stream.events import Trouble

TIME_WRAP, SEQUENCE_WRAP = 2**32, 2**16
CHAIN = 3  #: readings that must go on from each other before they count
TEXT_RESET_CHAIN = 8  #: damaged digits look like a reset more easily than damaged frames
NUMBERED_TOLERANCE = 0.35  #: periods; stamps of 25 us ticks at 6667 Hz scatter by 0.17
TEXT_TOLERANCE = 0.7  #: periods; below one, or a lost line would pass
GAP_TOLERANCE = 0.005  #: of a gap; the period is known better
STRETCH = 2048  #: readings looked at in one go
LONGEST_SKIP = 4096  #: numbers that a stretch may skip between two readings, seen at once
LONGEST_GAP_US = 600_000_000  #: beyond ten minutes of silence it is another recording
SHORTEST_US, LONGEST_US = 50.0, 2e6  #: a sample period may be
RATE_CHANGE_US = 2_000_000  #: what another rate sets in within, is no reset


@dataclass(frozen=True, eq=False)
class Readings:
    """What frames or lines said: sequence (n,) int64, or None in text; t_us (n,) int64, as sent; registers (n, 7) int16;
    damaged (n,) bool, whether something unreadable came just before."""

    sequence: np.ndarray | None
    t_us: np.ndarray
    registers: np.ndarray
    damaged: np.ndarray

    def __len__(self) -> int:
        return len(self.t_us)

    def part(self, start: int, stop: int) -> Readings:
        """Those from start up to stop."""
        sequence = None if self.sequence is None else self.sequence[start:stop]
        return Readings(sequence, self.t_us[start:stop], self.registers[start:stop], self.damaged[start:stop])


@dataclass(frozen=True, eq=False)
class Accepted:
    """Readings that count.  t_us (n,) int64 unrolled; registers (n, 7); damaged (n,); periods (n,): sample periods since the one
    before, 1 without a loss."""

    t_us: np.ndarray
    registers: np.ndarray
    damaged: np.ndarray
    periods: np.ndarray


class Continuity:
    """For one connection.  ``take`` readings, tell it of the numbers that info frames used up (``info``), ``finish``."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self.period_us: float | None = None
        self._last: Readings | None = None  # the last that counted
        self._t_us = 0  # its unrolled time
        self._chain: list[Readings] = []
        self._infos: list[int] = []
        self._count = self._since = 0  # periods since the lock, and the unrolled time of the lock
        self._next_period = 0
        self._held: Accepted | None = None  # text: a line counts when the next one follows it

    def info(self, sequence: int) -> None:
        """An info frame had this number."""
        self._infos = [*self._infos[-15:], sequence]

    def take(self, readings: Readings) -> list[Accepted | Trouble]:
        """What counts of these, in order."""
        out: list[Accepted | Trouble] = []
        start, total = 0, len(readings)
        while start < total:
            taken = 0
            if self._last is not None and not self._chain and not self._infos:
                taken = self._take_smooth(readings.part(start, min(total, start + STRETCH)), out)
            if not taken:
                self._take_one(readings.part(start, start + 1), out)
            start += taken or 1
        return out

    def finish(self) -> list[Accepted | Trouble]:
        """Nothing more comes: what waits for another is left out."""
        out: list[Accepted | Trouble] = []
        self._leave_out(len(self._chain), out)
        if self._held is not None:
            out.append(self._held)
        self._begin()
        return out

    def _take_smooth(self, readings: Readings, out: list) -> int:
        """Accept the readings at the beginning of these of which each follows the one before; returns how many."""
        last, period_us = self._last, self._period
        assert last is not None
        step_us = np.diff(readings.t_us, prepend=last.t_us[-1])
        if readings.sequence is None or last.sequence is None:
            periods = np.ones(len(readings), np.int64)
            smooth = np.abs(step_us - period_us) <= TEXT_TOLERANCE * period_us
        else:
            step_us %= TIME_WRAP
            periods = np.diff(readings.sequence, prepend=last.sequence[-1]) % SEQUENCE_WRAP
            bar = (NUMBERED_TOLERANCE + GAP_TOLERANCE * periods) * period_us
            smooth = (np.abs(step_us - periods * period_us) <= bar) & (periods >= 1) & (periods <= LONGEST_SKIP)
        count = len(readings) if smooth.all() else int(np.argmin(smooth))
        if count:
            # Stop where the period is measured anew, so that it is measured at the same reading however they are cut.
            count = min(count, 1 + int(np.searchsorted(self._count + np.cumsum(periods[:count]), self._next_period)))
            self._accept(readings.part(0, count), self._t_us + np.cumsum(step_us[:count]), periods[:count], out)
        return count

    def _take_one(self, one: Readings, out: list) -> None:
        """A reading that needs a closer look."""
        if self._last is not None and (step := self._step(self._last, one)) is not None:
            self._leave_out(len(self._chain), out)
            self._chain = []
            self._accept(one, np.array([self._t_us + step[0]]), np.array([step[1]]), out)
            return
        if self._chain and not self._chains(one):
            # The last of the chain may be good and what was before it not.
            kept = self._chain[-1:] if _rate(self._chain[-1], one, self._infos) else []
            self._leave_out(len(self._chain) - len(kept), out)
            self._chain = kept
        self._chain.append(one)
        if len(self._chain) >= (TEXT_RESET_CHAIN if self._looks_like_text_reset() else CHAIN):
            self._lock(out)

    @property
    def _period(self) -> float:
        """us; known as soon as a reading has counted."""
        assert self.period_us is not None
        return self.period_us

    def _looks_like_text_reset(self) -> bool:
        return self._chain[0].sequence is None and self._last is not None and self._gap(self._chain[0]) is None

    def _step(self, last: Readings, one: Readings) -> tuple[int, int] | None:
        """Time and sample periods from the last that counted; None where they do not fit."""
        step_us = int(one.t_us[0] - last.t_us[-1])
        if one.sequence is None:
            step_us += TIME_WRAP if -TIME_WRAP < step_us < -TIME_WRAP // 2 else 0
            return (step_us, 1) if abs(step_us - self._period) <= TEXT_TOLERANCE * self._period else None
        step_us %= TIME_WRAP
        if step_us > LONGEST_GAP_US:
            return None
        numbers = _numbers(last, one, self._infos)
        periods = step_us / self._period
        numbers += SEQUENCE_WRAP * max(0, round((periods - numbers) / SEQUENCE_WRAP))
        # Once a second a number belongs to an info frame, which may be lost like any other.
        for lost_infos in range(2 + step_us // 1_000_000):
            count = numbers - lost_infos
            if count >= 1 and abs(periods - count) <= NUMBERED_TOLERANCE + GAP_TOLERANCE * count:
                return step_us, count
        return None

    def _chains(self, one: Readings) -> bool:
        """Whether a reading goes on from those that wait, at a steady rate."""
        rate = _rate(self._chain[-1], one, self._infos)
        if rate is None or len(self._chain) < 2:
            return rate is not None
        before = _rate(self._chain[-2], self._chain[-1], self._infos)
        assert before is not None  # or the last had not been chained to the one before
        tolerance = TEXT_TOLERANCE if one.sequence is None else NUMBERED_TOLERANCE
        return abs(rate - before) <= tolerance * min(rate, before)

    def _lock(self, out: list) -> None:
        """The chain counts: the stream begins, or begins anew, or goes on after a gap."""
        chain = Readings(
            None if self._chain[0].sequence is None else np.concatenate([one.sequence for one in self._chain]),
            np.concatenate([one.t_us for one in self._chain]),
            np.concatenate([one.registers for one in self._chain]),
            np.concatenate([one.damaged for one in self._chain]),
        )
        pairs = list(zip(self._chain, self._chain[1:], strict=False))
        steps_us = [int(b.t_us[0] - a.t_us[0]) % TIME_WRAP for a, b in pairs]
        periods = [1 if a.sequence is None else _numbers(a, b, self._infos) for a, b in pairs]
        first_us, first_periods = int(chain.t_us[0]), 1
        if self._last is not None:
            gap = self._gap(self._chain[0])
            if gap is None:
                if self._held is not None:
                    self._held = None
                    out.append(Trouble("lost", 1, self._t_us))
                out.append(Trouble("reset", 1, self._t_us))
            else:
                first_us, first_periods = self._t_us + gap[0], gap[1]
        self.period_us = sum(steps_us) / sum(periods)
        t_us = first_us + np.concatenate([[0], np.cumsum(steps_us)]).astype(np.int64)
        self._chain, self._since, self._count, self._next_period = [], int(t_us[0]), -first_periods, 16
        self._accept(chain, t_us, np.array([first_periods, *periods], np.int64), out)

    def _gap(self, one: Readings) -> tuple[int, int] | None:
        """Time and sample periods from the last that counted to a stretch that begins with this one; None: it began anew."""
        assert self._last is not None
        step_us = int(one.t_us[0] - self._last.t_us[-1])
        if one.sequence is None:
            step_us += TIME_WRAP if -TIME_WRAP < step_us < -TIME_WRAP // 2 else 0
            return (step_us, max(1, round(step_us / self._period))) if 0 < step_us <= LONGEST_GAP_US else None
        step_us %= TIME_WRAP
        numbers = _numbers(self._last, one, self._infos)
        return (step_us, numbers) if 0 < step_us <= RATE_CHANGE_US and 1 <= numbers <= LONGEST_SKIP else None

    def _accept(self, readings: Readings, t_us: np.ndarray, periods: np.ndarray, out: list) -> None:
        lost = int(periods.sum()) - len(periods)
        accepted: Accepted | None = Accepted(t_us, readings.registers, readings.damaged, periods)
        if readings.sequence is None:
            # Bytes lost in the middle of one line up to the middle of another make one line of two.  It looks whole, and a gap
            # follows: so the line before a gap does not count.
            if self._held is not None and (periods[0] > 1 or lost):
                self._held = None
                lost += 1
            accepted = self._hold(Accepted(t_us, readings.registers, readings.damaged, periods))
        if lost:
            out.append(Trouble("lost", lost, self._t_us if self._last is not None else None))
        if accepted is not None:
            out.append(accepted)
        self._last, self._t_us, self._infos = readings.part(len(readings) - 1, len(readings)), int(t_us[-1]), []
        self._count += int(periods.sum())
        if self._count >= self._next_period:
            self.period_us = (self._t_us - self._since) / self._count
            self._next_period = self._count + min(max(self._count, 16), 1024)

    def _hold(self, accepted: Accepted) -> Accepted | None:
        arrays = [accepted.t_us, accepted.registers, accepted.damaged, accepted.periods]
        if self._held is not None:
            held = (self._held.t_us, self._held.registers, self._held.damaged, self._held.periods)
            arrays = [np.concatenate(pair) for pair in zip(held, arrays, strict=True)]
        self._held = Accepted(*(array[-1:] for array in arrays))
        return Accepted(*(array[:-1] for array in arrays)) if len(arrays[0]) > 1 else None

    def _leave_out(self, count: int, out: list) -> None:
        if count:
            out.append(Trouble("implausible", count, self._t_us if self._last is not None else None))


def _numbers(a: Readings, b: Readings, infos: list[int]) -> int:
    """By how much b's number is higher than a's, those of the info frames between them taken off."""
    assert a.sequence is not None
    assert b.sequence is not None
    first = int(a.sequence[-1])
    numbers = (int(b.sequence[0]) - first) % SEQUENCE_WRAP
    return numbers - len({info for info in infos if 0 < (info - first) % SEQUENCE_WRAP < numbers})


def _rate(a: Readings, b: Readings, infos: list[int]) -> float | None:
    """us per sample from a to b, if b can follow a at all."""
    step_us = int(b.t_us[0] - a.t_us[-1]) % TIME_WRAP
    numbers = 1 if a.sequence is None else _numbers(a, b, infos)
    if not 1 <= numbers <= LONGEST_SKIP or not SHORTEST_US <= step_us / numbers <= LONGEST_US:
        return None
    return step_us / numbers
