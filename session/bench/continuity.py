"""Continuity of a stream: sequence and time unrolled, missing readings counted, impossible steps left out."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from session.base.numeric import running_sum
from session.bench.events import REGISTERS, Event, SampleChunk, StreamFormat, joined_chunk

# The step filter: a step out and back within one sample, while the wire is bad, is an error and no motion.
#
# A frame whose damage is confined to its registers can pass its CRC with the right number and stamp.  Then one register differs from what
# is before and behind it, which agree.  A knock on the table can do the same, so a sample is doubted only if something unreadable came
# shortly before; on a wire without errors no wrong frame passes a CRC by chance.

#: samples that are doubted after something unreadable
DOUBT = 1000


class StepFilter:
    """Passes samples on; holds a doubtful last one that jumps until the next has come.  form: the columns, and the largest plausible step
    in each."""

    def __init__(self, form: StreamFormat = REGISTERS) -> None:
        self._form = form
        self._doubt = 0  # samples still to be doubted
        self._before: np.ndarray | None = None  # (7,) the last sample that does not wait
        self._held: list[SampleChunk] = []  # the one that waits

    def take(self, accepted: SampleChunk) -> list[SampleChunk | Event]:
        """The samples that are passed on, and counts of those that are left out."""
        count = len(accepted)
        if not (self._doubt or self._held or accepted.damaged.any()):
            self._before = accepted.registers[-1].astype(float)
            return [SampleChunk(accepted.t_us, accepted.registers, self._form)]
        last_damage = np.maximum.accumulate(np.where(accepted.damaged, np.arange(count), -count - DOUBT))
        doubted = (np.arange(count) - last_damage < DOUBT) | (np.arange(count) < self._doubt)
        self._doubt = max(0, self._doubt - count, DOUBT - int(count - last_damage[-1]))
        chunk, doubted = joined_chunk([*self._held, accepted]), np.concatenate([np.ones(len(self._held), bool), doubted])
        values = chunk.registers.astype(float)
        steps = np.diff(values, axis=0, prepend=values[:1] if self._before is None else self._before[None], append=values[-1:])
        out, back, bars = steps[:-1], steps[1:], self._form.bars * chunk.periods[:, None]
        jumps = doubted & (np.abs(out) > bars).any(axis=1)
        # Some register steps out and back: beyond the bar on both sides, while its neighbours agree.
        far = np.minimum(np.abs(out), np.abs(back))
        returns = (far > (bars + np.roll(bars, -1, axis=0)) / 2) & (out * back < 0) & (2 * np.abs(out + back) < far)
        stop = len(chunk) - int(jumps[-1])
        self._held, self._before = [chunk.part(stop)] * int(jumps[-1]), values[stop - 1] if stop else self._before
        found: list[SampleChunk | Event] = []
        start = 0
        for place in [*np.flatnonzero(jumps & returns.any(axis=1)).tolist(), stop]:
            if place > start:
                found.append(SampleChunk(chunk.t_us[start:place], chunk.registers[start:place], self._form))
            if place < stop:
                found.append(Event("implausible", 1, int(chunk.t_us[place])))
            start = place + 1
        return found

    def finish(self) -> list[SampleChunk | Event]:
        """The stream ends: a doubtful last sample is left out."""
        held, self._held, self._before, self._doubt = self._held, [], None, 0
        return [Event("implausible", 1, int(each.t_us[0])) for each in held]


# The continuity check: it unrolls sequence and time, counts missing readings, and leaves out those that do not fit.
#
# A CRC of 16 bits lets some 10⁻⁵ of heavily damaged frames through, and a text line has none.  So a reading counts only if its number and
# its stamp agree with the reading before: as many sample periods later as the number is higher.  One that does not fit waits.  If the next
# one follows the reading before it, it was damaged and is left out.  If two more follow it, the device has restarted (or changed its
# rate, or in text skipped), and all three count.  The period is measured from the stamps.  Decisions depend on the readings alone, not on
# how they are divided.  A device that restarts again and again must show more readings each time, up to ``LONGEST_CHAIN``.

TIME_WRAP, SEQUENCE_WRAP = 2**32, 2**16
CHAIN = 3  #: readings that must follow each other before they count
TEXT_RESET_CHAIN = 8  #: damaged digits look like a reset more easily than damaged frames
LONGEST_CHAIN = 64  #: of a device that keeps restarting: twice as many each time, up to so many
NUMBERED_TOLERANCE = 0.35  #: periods; stamps of 25 us ticks at 6667 Hz scatter by 0.17
TEXT_TOLERANCE = 0.7  #: periods; below one, since a lost line must not pass
GAP_TOLERANCE = 0.005  #: of a gap; the period is known better
LONGEST_SKIP = 4096  #: numbers that may be missing between two readings
LONGEST_GAP_US = 600_000_000  #: after ten minutes of silence it is another recording
SHORTEST_US, LONGEST_US = 50.0, 2e6  #: range of a sample period
RATE_CHANGE_US = 2_000_000  #: a change of rate takes effect within this; it is no reset
#: readings checked at once: twice as many each time, as long as all follow each other
FEWEST, MOST = 32, 2048
SINGLY = 8  #: readings that are taken one by one where they do not follow each other


class _Candidate(NamedTuple):
    """A reading that waits for those after it."""

    sequence: int | None
    t_us: int
    registers: np.ndarray
    damaged: bool


class Continuity:
    """Checks one connection: ``take`` readings, pass the numbers of info frames to ``info``, ``finish``."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self.period_us: float | None = None
        self._begun = False  # whether a reading has counted
        self._sequence: int | None = None  # of the last that has
        self._stamp = self._t_us = 0  # its time as it was sent, and unrolled
        self._chain: list[_Candidate] = []
        self._infos: list[int] = []
        self._infos_have_numbers = True
        self._count = self._since = 0  # periods since the lock, and the unrolled time of the lock
        self._next_period = 0
        self._held: SampleChunk | None = None  # text: a line counts when the next one follows it
        self._needed, self._shown = CHAIN, 0  # readings that a new start must show, and that the present one has
        self._at_once, self._singly = FEWEST, 0

    def info(self, sequence: int) -> None:
        """An info frame had this number."""
        if self._infos_have_numbers:
            self._infos = [*self._infos[-15:], sequence]

    def take(self, readings: SampleChunk) -> list[SampleChunk | Event]:
        """The readings that count, and troubles, in order."""
        out: list[SampleChunk | Event] = []
        start, total = 0, len(readings)
        while start < total:
            if self._begun and not (self._chain or self._infos or self._singly):
                start += self._take_smooth(readings.part(start, min(total, start + self._at_once)), out)
            else:
                start += self._take_singly(readings.part(start, min(total, start + MOST)), out)
        return out

    def finish(self) -> list[SampleChunk | Event]:
        """The stream ends: readings that wait are left out."""
        out: list[SampleChunk | Event] = []
        self._leave_out(len(self._chain), out)
        if self._held is not None:
            out.append(self._held)
        self._begin()
        return out

    def _take_smooth(self, readings: SampleChunk, out: list) -> int:
        """Accept the first readings as long as each follows the one before; returns how many."""
        step_us = np.diff(readings.t_us, prepend=self._stamp)
        if readings.sequence is None or self._sequence is None:
            periods = np.ones(len(readings), np.int64)
            smooth = np.abs(step_us - self._period) <= TEXT_TOLERANCE * self._period
        else:
            step_us %= TIME_WRAP
            periods = np.diff(readings.sequence, prepend=self._sequence) % SEQUENCE_WRAP
            bar = (NUMBERED_TOLERANCE + GAP_TOLERANCE * periods) * self._period
            smooth = (np.abs(step_us - periods * self._period) <= bar) & (periods >= 1)
            smooth &= step_us <= LONGEST_GAP_US
        follow = len(readings) if smooth.all() else int(np.argmin(smooth))
        count = follow
        if count:
            # Stop where the period is updated, so that this happens at the same reading however they are divided.
            count = min(count, 1 + int(np.searchsorted(self._count + np.cumsum(periods[:count]), self._next_period)))
            t_us = self._t_us + np.cumsum(step_us[:count])
            self._emit(replace(readings.part(0, count), t_us=t_us, periods=periods[:count]), readings.sequence, out)
            last = None if readings.sequence is None else int(readings.sequence[count - 1])
            self._advance(last, int(readings.t_us[count - 1]), int(t_us[-1]), int(periods[:count].sum()), count)
        broken = count == follow < len(readings)
        self._at_once, self._singly = (FEWEST, SINGLY) if broken else (min(MOST, 2 * self._at_once), 0)
        return count

    def _take_singly(self, readings: SampleChunk, out: list) -> int:
        """Take readings one by one until some have followed each other; returns how many were taken."""
        run: list[tuple[int, int, int, int]] = []  # that count: index, unrolled time before it, its own, periods
        numbers = [None] * len(readings) if readings.sequence is None else readings.sequence.tolist()
        for place, (sequence, stamp) in enumerate(zip(numbers, readings.t_us.tolist(), strict=True)):
            if self._begun and (step := self._step(sequence, stamp)) is not None:
                if self._chain:
                    self._flush(run, readings, out)
                    self._leave_out(len(self._chain), out)
                    self._chain = []
                run.append((place, self._t_us, self._t_us + step[0], step[1]))
                self._advance(sequence, stamp, self._t_us + step[0], step[1], 1)
                self._singly = max(0, self._singly - 1)
                if not self._singly:
                    break
                continue
            one = _Candidate(sequence, stamp, readings.registers[place], bool(readings.damaged[place]))
            if self._chain and not self._chains(one):
                # The last of the chain may be good and what was before it not.
                kept = self._chain[-1:] if _rate(self._chain[-1], one, self._infos) else []
                self._flush(run, readings, out)
                self._leave_out(len(self._chain) - len(kept), out)
                self._chain = kept
            self._chain.append(one)
            first, needed = self._chain[0], CHAIN
            if self._begun and self._gap(first) is None:  # a restart
                needed = max(self._needed, TEXT_RESET_CHAIN if first.sequence is None else CHAIN)
            if len(self._chain) >= needed:
                self._flush(run, readings, out)
                self._lock(out)
        self._flush(run, readings, out)
        return place + 1

    def _flush(self, run: list[tuple[int, int, int, int]], readings: SampleChunk, out: list) -> None:
        """Pass a run on, and begin another."""
        if run:
            places, before_us, t_us, periods = np.array(run, np.int64).T
            accepted = SampleChunk(t_us, readings.registers[places], readings.form, readings.damaged[places], None, periods)
            self._emit(accepted, readings.sequence, out, int(before_us[0]))
            run.clear()

    @property
    def _period(self) -> float:
        assert self.period_us is not None  # as soon as a reading has counted
        return self.period_us

    def _step(self, sequence: int | None, stamp: int) -> tuple[int, int] | None:
        """Time and sample periods since the last that counted; None where they do not fit."""
        period_us = self._period
        if sequence is None:
            step_us = self._text_step(stamp)
            return (step_us, 1) if abs(step_us - period_us) <= TEXT_TOLERANCE * period_us else None
        step_us = (stamp - self._stamp) % TIME_WRAP
        if step_us > LONGEST_GAP_US:
            return None
        if sequence in self._infos:  # then an info's number is the next sample's, and none is lost for it
            self._infos, self._infos_have_numbers = [], False
        numbers = _numbers(self._sequence, sequence, self._infos)
        periods = step_us / period_us
        numbers += SEQUENCE_WRAP * max(0, round((periods - numbers) / SEQUENCE_WRAP))
        # Once a second a number belongs to an info frame, which may be lost like any other.  The most periods that fit count.
        most = min(numbers, int((periods + NUMBERED_TOLERANCE) / (1 - GAP_TOLERANCE)) + 1)
        for count in (most, most - 1, most - 2):
            fits = abs(step_us - count * period_us) <= (NUMBERED_TOLERANCE + GAP_TOLERANCE * count) * period_us
            if fits and count >= 1 and numbers - count <= 1 + step_us // 1_000_000:
                return step_us, count
        return None

    def _text_step(self, stamp: int) -> int:
        """us since the last that counted; a stamp of text may wrap like a board's counter, or be longer."""
        step_us = stamp - self._stamp
        return step_us + TIME_WRAP if -TIME_WRAP < step_us < -TIME_WRAP // 2 else step_us

    def _chains(self, one: _Candidate) -> bool:
        """Whether a reading follows those that wait, at a steady rate."""
        rate = _rate(self._chain[-1], one, self._infos)
        if rate is None or len(self._chain) < 2:
            return rate is not None
        before = _rate(self._chain[-2], self._chain[-1], self._infos)
        assert before is not None  # or the last had not been chained to the one before
        tolerance = TEXT_TOLERANCE if one.sequence is None else NUMBERED_TOLERANCE
        return abs(rate - before) <= tolerance * min(rate, before)

    def _lock(self, out: list) -> None:
        """Accept the chain: the stream begins, restarts, or continues after a gap."""
        chain = self._chain
        pairs = list(pairwise(chain))
        steps_us = [(b.t_us - a.t_us) % TIME_WRAP for a, b in pairs]
        periods = [_numbers(a.sequence, b.sequence, self._infos) for a, b in pairs]
        first_us, first_periods = chain[0].t_us, 1
        if self._begun:
            gap = self._gap(chain[0])
            if gap is None:
                if self._held is not None:
                    self._held = None
                    out.append(Event("lost", 1, self._t_us))
                out.append(Event("reset", 1, self._t_us))
                self._needed = CHAIN if self._shown >= LONGEST_CHAIN else min(LONGEST_CHAIN, 2 * self._needed)
                self._shown = 0
            else:
                first_us, first_periods = self._t_us + gap[0], gap[1]
        self.period_us = sum(steps_us) / sum(periods)
        t_us = first_us + running_sum(steps_us).astype(np.int64)
        registers, damaged = np.array([one.registers for one in chain]), np.array([one.damaged for one in chain])
        self._chain, self._since, self._count, self._next_period = [], int(t_us[0]), -first_periods, 16
        accepted = SampleChunk(t_us, registers, damaged=damaged, periods=np.array([first_periods, *periods], np.int64))
        self._emit(accepted, chain[-1].sequence, out, self._t_us if self._begun else None)
        self._begun, self._singly = True, SINGLY
        self._advance(chain[-1].sequence, chain[-1].t_us, int(t_us[-1]), first_periods + sum(periods), len(chain))

    def _gap(self, one: _Candidate) -> tuple[int, int] | None:
        """Time and sample periods from the last that counted to a chain that begins with this one; None: the device has restarted."""
        if one.sequence is None:
            step_us = self._text_step(one.t_us)
            return (step_us, max(1, round(step_us / self._period))) if 0 < step_us <= LONGEST_GAP_US else None
        step_us = (one.t_us - self._stamp) % TIME_WRAP
        numbers = _numbers(self._sequence, one.sequence, self._infos)
        return (step_us, numbers) if 0 < step_us <= RATE_CHANGE_US and 1 <= numbers <= LONGEST_SKIP else None

    def _emit(self, accepted: SampleChunk, sequence: object, out: list, before_us: int | None = None) -> None:
        """Pass accepted readings on; sequence: None in text; before_us: unrolled time of the reading before, the last one without it."""
        lost = int(accepted.periods.sum()) - len(accepted.periods)
        if sequence is None:
            # Bytes lost from the middle of one line to the middle of another leave one line made of two.  It looks whole, and a gap
            # follows.  So the line before a gap does not count.
            if self._held is not None and lost:
                self._held = None
                lost += 1
            if self._held is not None:
                accepted = joined_chunk([self._held, accepted])
            self._held, accepted = accepted.part(len(accepted) - 1), accepted.part(0, len(accepted) - 1)
        if lost:
            out.append(Event("lost", lost, self._t_us if before_us is None and self._begun else before_us))
        if len(accepted):
            out.append(accepted)

    def _advance(self, sequence: int | None, stamp: int, t_us: int, periods: int, count: int) -> None:
        """Note the last of so many readings that count."""
        self._sequence, self._stamp, self._t_us, self._infos = sequence, stamp, t_us, []
        self._count += periods
        self._shown += count
        if self._count >= self._next_period:
            self.period_us = (t_us - self._since) / self._count
            self._next_period = self._count + min(self._count, 1024)

    def _leave_out(self, count: int, out: list) -> None:
        if count:
            out.append(Event("implausible", count, self._t_us if self._begun else None))


def _numbers(first: int | None, second: int | None, infos: list[int]) -> int:
    """The difference of two numbers, without those of the info frames between them; 1 in text."""
    if first is None or second is None:
        return 1
    numbers = (second - first) % SEQUENCE_WRAP
    return numbers - len({info for info in infos if 0 < (info - first) % SEQUENCE_WRAP < numbers}) if infos else numbers


def _rate(a: _Candidate, b: _Candidate, infos: list[int]) -> float | None:
    """us per sample from a to b, if b can follow a at all."""
    step_us = (b.t_us - a.t_us) % TIME_WRAP
    numbers = _numbers(a.sequence, b.sequence, infos)
    if not 1 <= numbers <= LONGEST_SKIP or not SHORTEST_US <= step_us / numbers <= LONGEST_US:
        return None
    return step_us / numbers
