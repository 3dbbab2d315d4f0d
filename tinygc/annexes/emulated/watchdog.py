"""The independent watchdog (IWDG): a counter of the low-speed oscillator that resets a program which does not reload it in time.

RM0090, chapter 21.  A new prescaler or reload value counts from the next reload on.
"""

from __future__ import annotations

from collections.abc import Callable

from tinygc.annexes.emulated.bus import CORE_HZ, NEVER, CycleClock, Poll, TimedCall

KR, PR, RLR, SR = range(0, 16, 4)
ACCESS, RELOAD, START = 0x5555, 0xAAAA, 0xCCCC
LSI_HZ = 32_000.0  #: typical; the STM32F405's data sheet allows 17 to 47 kHz
UPDATE_CYCLES = 5  #: of the oscillator, until a written value is taken over
FULL = 0xFFF
NAMES = {PR: "IWDG_PR", RLR: "IWDG_RLR"}


class Iwdg:
    """expire: called when the counter reaches its end; oscillator_on: whether the program has switched the oscillator on.

    running: whether the counter was started, which only a reset undoes; longest_s: the longest time between two reloads, since the start or
    since it was last set to 0.
    """

    def __init__(
        self,
        clock: CycleClock,
        lsi_hz: float,
        oscillator_on: Callable[[], bool],
        expire: Callable[[], None],
        object_to: Callable[[str], None],
    ):
        self._clock, self._tick = clock, CORE_HZ / lsi_hz
        self._oscillator_on, self._expire, self._object = oscillator_on, expire, object_to
        self.running, self.longest_s = False, 0.0
        self._unlocked = False
        self._words = {PR: 0, RLR: FULL}
        self._written: dict[int, tuple[int, float]] = {}  # register -> value that is being taken over, and when it will have been
        self._reloaded = 0.0
        self._end: TimedCall | None = None
        self._poll = Poll(clock)

    def _take_over(self) -> None:
        now = self._clock.now()
        for offset, (value, cycle) in list(self._written.items()):
            if cycle <= now:
                self._words[offset] = value
                del self._written[offset]

    def _count_from(self, reload: int) -> None:
        if self._end:
            self._end.cancel()
        period = (reload + 1) * (4 << min(self._words[PR], 6)) * self._tick
        self._end = self._clock.at(self._clock.now() + period, self._expire)

    def read(self, offset: int) -> int:
        """Read a word."""
        self._take_over()
        if offset == SR:
            value = (PR in self._written) | (RLR in self._written) << 1
            if self._poll.again(value):
                self._clock.skip_to(min((cycle for _, cycle in self._written.values()), default=NEVER))
            return value
        return self._words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write a word."""
        self._poll.broken()
        self._take_over()
        if offset in NAMES:
            self._write_protected(offset, value)
        elif offset == KR:
            self._unlocked = value == ACCESS
            if value == START:
                self._start()
            elif value == RELOAD:
                self._reload()

    def _write_protected(self, offset: int, value: int) -> None:
        if not self._unlocked:
            self._object(f"{NAMES[offset]} is written without its key, and stays as it was")
        elif offset in self._written:
            self._object(f"{NAMES[offset]} is written before its last value was taken over")
        else:
            ticks = self.running or self._oscillator_on()
            self._written[offset] = value, self._clock.now() + UPDATE_CYCLES * self._tick if ticks else NEVER

    def _start(self) -> None:
        if self.running:
            return
        self.running, now = True, self._clock.now()
        self._written = {offset: (value, now + UPDATE_CYCLES * self._tick) for offset, (value, _) in self._written.items()}
        self._reloaded = now
        self._count_from(FULL)

    def _reload(self) -> None:
        if not self.running:
            return
        now = self._clock.now()
        self.longest_s, self._reloaded = max(self.longest_s, (now - self._reloaded) / CORE_HZ), now
        self._count_from(self._words[RLR])

    def stand_still(self, cycles: float) -> None:
        """Do not count these cycles: a debugger has stopped the core, and the program has set DBG_IWDG_STOP."""
        if self._end and self._end.do:
            cycle, self._reloaded = self._end.cycle + cycles, self._reloaded + cycles
            self._end.cancel()
            self._end = self._clock.at(cycle, self._expire)
