"""SysTick, cycle counter, exceptions (ARMv7-M, B1.5), and the pins' interrupts."""

from __future__ import annotations

from collections.abc import Callable

from tinygc.annexes.emulated.bus import NEVER, CycleClock, Poll, TimedCall

# Exceptions: which are pending, which are enabled, and which is taken next (ARMv7-M, B1.5).

HARD_FAULT, SVCALL, PENDSV, SYSTICK, EXTERNAL = 3, 11, 14, 15, 16
LINES = 82
IDLE = 256  #: the priority without an exception
PRIORITY_BITS = 0xF0  #: of eight, those that this part has


class Nvic:
    """pending, active (innermost last): numbers of exceptions; priority: by number, the lower the more urgent."""

    def __init__(self) -> None:
        self.pending: set[int] = set()
        self.active: list[int] = []
        self.enabled = {SVCALL, PENDSV, SYSTICK}
        self.priority = [0] * (EXTERNAL + LINES)
        self.priority[HARD_FAULT] = -1
        self._high: set[int] = set()  # interrupt lines that are high

    def line(self, interrupt: int, high: bool) -> None:
        """Set a peripheral's interrupt line: while it is high the interrupt is pending again as soon as its handler has returned."""
        number = EXTERNAL + interrupt
        if not high:
            self._high.discard(number)
        elif number not in self._high:
            self._high.add(number)
            self.pending.add(number)

    def pend(self, number: int) -> None:
        """Set an exception pending that has no interrupt line."""
        self.pending.add(number)

    @property
    def wakes(self) -> bool:
        """Whether a core that waits for an interrupt continues: masked interrupts wake it, too."""
        return any(number in self.enabled and self.priority[number] < self._running() for number in self.pending)

    def _running(self) -> int:
        return min((self.priority[number] for number in self.active), default=IDLE)

    def due(self, primask: int, basepri: int) -> int:
        """Return the exception that preempts the running code; 0 where none does."""
        ready = [number for number in self.pending if number in self.enabled]
        if not ready:
            return 0
        number = min(ready, key=lambda number: (self.priority[number], number))
        bar = min(self._running(), 0 if primask else IDLE, basepri or IDLE)
        return number if self.priority[number] < bar else 0

    def enter(self, number: int) -> None:
        """Mark an exception as active."""
        self.pending.discard(number)
        self.active.append(number)

    def leave(self) -> None:
        """End the innermost active exception."""
        number = self.active.pop()
        if number in self._high:
            self.pending.add(number)

    # Registers, offsets from 0xE000E100

    def read(self, offset: int) -> int:
        """Read a word of ISER, ICER, ISPR, ICPR, IABR or IPR."""
        block, place = offset >> 7, offset & 0x7F
        if offset >= 0x300:
            first = EXTERNAL + (offset - 0x300)
            return sum(priority << 8 * n for n, priority in enumerate(self.priority[first : first + 4]))
        numbers = {0: self.enabled, 1: self.enabled, 2: self.pending, 3: self.pending, 4: set(self.active)}.get(block, set())
        first = EXTERNAL + 8 * place
        return sum(1 << n for n in range(32) if first + n in numbers)

    def write(self, offset: int, value: int) -> None:
        """Write a word."""
        if offset >= 0x300:
            for n in range(4):
                if EXTERNAL + offset - 0x300 + n < len(self.priority):
                    self.priority[EXTERNAL + offset - 0x300 + n] = value >> 8 * n & PRIORITY_BITS
            return
        first = EXTERNAL + 8 * (offset & 0x7F)
        numbers = {first + n for n in range(32) if value >> n & 1}
        if offset < 0x80:
            self.enabled |= numbers
        elif offset < 0x100:
            self.enabled -= numbers
        elif offset < 0x180:
            self.pending |= numbers
        elif offset < 0x200:
            self.pending -= numbers - self._high


# The core's own registers: SysTick, the cycle counter, the NVIC and the system control block.

CPUID, ICSR, VTOR, AIRCR, SHPR = 0xE000ED00, 0xE000ED04, 0xE000ED08, 0xE000ED0C, range(0xE000ED18, 0xE000ED24, 4)
DEMCR, DWT_CTRL, CYCCNT = 0xE000EDFC, 0xE0001000, 0xE0001004
DEBUG_FREEZE, IWDG_STOP = 0xE0042008, 1 << 12
SYSTICK_CSR, SYSTICK_RVR, SYSTICK_CVR = 0xE000E010, 0xE000E014, 0xE000E018
NVIC_FIRST, NVIC_LAST = 0xE000E100, 0xE000E4EF
RESET_KEY, RESET_REQUEST = 0x05FA0000, 1 << 2
TURN, TURNS, SKIP = 60, 3, 168  #: a wait for CYCCNT: iterations of at most so many cycles; after so many, each takes a microsecond


class SysTick:
    """Counter that runs down at the core's clock, or at an eighth of it."""

    def __init__(self, clock: CycleClock, nvic: Nvic):
        self._clock, self._nvic = clock, nvic
        self._csr, self._rvr, self._zero = 0, 0, 0.0
        self._counted = False
        self._event: TimedCall | None = None

    @property
    def _period(self) -> int:
        return (self._rvr + 1) * (1 if self._csr & 4 else 8)

    def _restart(self) -> None:
        if self._event:
            self._event.cancel()
        self._zero = self._clock.now()
        self._event = self._clock.at(self._zero + self._period, self._tick) if self._csr & 1 and self._rvr else None

    def _tick(self) -> None:
        self._zero += self._period
        self._counted = True
        if self._csr & 2:
            self._nvic.pend(SYSTICK)
        self._event = self._clock.at(self._zero + self._period, self._tick)

    def read(self, address: int) -> int:
        """Read CSR, RVR or CVR."""
        if address == SYSTICK_CSR:
            value, self._counted = self._csr | self._counted << 16, False
            return value
        if address == SYSTICK_RVR:
            return self._rvr
        if not self._csr & 1 or not self._rvr:
            return 0
        gone = int((self._clock.now() - self._zero) / (1 if self._csr & 4 else 8))
        return max(0, self._rvr - gone)

    def write(self, address: int, value: int) -> None:
        """Write CSR, RVR or CVR, which any value sets to 0."""
        if address == SYSTICK_RVR:
            self._rvr = value & 0xFFFFFF
            return
        if address == SYSTICK_CSR:
            started = value & 1 and not self._csr & 1
            self._csr = value & 7
            if self._csr & 1 and not started:
                return
        self._restart()


class CycleCounter:
    """CYCCNT of the DWT.  Most iterations of a loop that waits for it are skipped."""

    def __init__(self, clock: CycleClock):
        self._clock, self._zero, self._on, self._stood = clock, 0.0, False, 0
        self._last, self._turns = -1e9, 0

    def switch(self, on: bool) -> None:
        """Start or stop counting."""
        if on and not self._on:
            self._zero = self._clock.now() - self._stood
        elif not on:
            self._stood = self.read()
        self._on = on

    def read(self) -> int:
        """Read the cycles, 32 bits."""
        if not self._on:
            return self._stood
        now = self._clock.now()
        self._turns = self._turns + 1 if now - self._last < TURN else 0
        if self._turns > TURNS:
            self._clock.skip_to(now + SKIP)
        self._last = self._clock.now()
        return int(self._last - self._zero) & 0xFFFFFFFF

    def write(self, value: int) -> None:
        """Set the counter."""
        self._stood, self._zero = value, self._clock.now() - value

    def broken(self) -> None:
        """Reset the detection of a waiting loop after another access."""
        self._turns = 0


class Core:
    """vectors: address of the vector table; reset: called when the program requests a reset."""

    def __init__(self, clock: CycleClock, nvic: Nvic, reset: Callable[[], None]):
        self.vectors = 0x08000000
        self._nvic, self._reset = nvic, reset
        self.ticks, self.cycles = SysTick(clock, nvic), CycleCounter(clock)
        self._kept: dict[int, int] = {CPUID: 0x410FC241, AIRCR: 0xFA050000, DWT_CTRL: 0x40000000}

    @property
    def watchdog_stops(self) -> bool:
        """Whether the watchdog stands still while a debugger holds the core (DBG_IWDG_STOP)."""
        return bool(self._kept.get(DEBUG_FREEZE, 0) & IWDG_STOP)

    def read(self, address: int, size: int) -> int:
        """Read some bytes."""
        word = self._word(address & ~3)
        return word >> 8 * (address & 3) & (1 << 8 * size) - 1

    def _word(self, address: int) -> int:
        if address == CYCCNT:
            return self.cycles.read()
        if SYSTICK_CSR <= address <= SYSTICK_CVR:
            return self.ticks.read(address)
        if NVIC_FIRST <= address <= NVIC_LAST:
            return self._nvic.read(address - NVIC_FIRST)
        if address == VTOR:
            return self.vectors
        if address == ICSR:
            pending = self._nvic.pending
            active = self._nvic.active[-1] if self._nvic.active else 0
            return (PENDSV in pending) << 28 | (SYSTICK in pending) << 26 | max(pending, default=0) << 12 | active
        if address in SHPR:
            first = 4 + address - SHPR[0]
            return sum(priority << 8 * n for n, priority in enumerate(self._nvic.priority[first : first + 4]))
        return self._kept.get(address, 0)

    def write(self, address: int, size: int, value: int) -> None:
        """Write some bytes."""
        self.cycles.broken()
        word = address & ~3
        if size < 4:
            shift, mask = 8 * (address & 3), (1 << 8 * size) - 1
            others = self._word(word) if 0xE000E400 <= word <= NVIC_LAST or word in SHPR or word in self._kept else 0
            value = others & ~(mask << shift) | (value & mask) << shift
        self._set_word(word, value)

    def _set_word(self, address: int, value: int) -> None:
        if address == CYCCNT:
            self.cycles.write(value)
        elif SYSTICK_CSR <= address <= SYSTICK_CVR:
            self.ticks.write(address, value)
        elif NVIC_FIRST <= address <= NVIC_LAST:
            self._nvic.write(address - NVIC_FIRST, value)
        elif address == VTOR:
            self.vectors = value & ~0x7F
        elif address == ICSR:
            for bit, number, sets in ((28, PENDSV, True), (27, PENDSV, False), (26, SYSTICK, True), (25, SYSTICK, False)):
                if value >> bit & 1:
                    (self._nvic.pending.add if sets else self._nvic.pending.discard)(number)
        elif address in SHPR:
            for n in range(4):
                self._nvic.priority[4 + address - SHPR[0] + n] = value >> 8 * n & PRIORITY_BITS
        elif address == AIRCR:
            if value & 0xFFFF0000 == RESET_KEY and value & RESET_REQUEST:
                self._reset()
        else:
            self._kept[address] = value
            if address in (DEMCR, DWT_CTRL):
                self.cycles.switch(bool(self._kept.get(DEMCR, 0) & 1 << 24 and self._kept.get(DWT_CTRL, 0) & 1))


# Ports, and the interrupts of their pins.

MODER, IDR, ODR, BSRR, AFRL, AFRH = 0x00, 0x10, 0x14, 0x18, 0x20, 0x24
ANALOG, OUTPUT, ALTERNATE = 3, 1, 2
EXTI_IRQS = {0: 6, 1: 7, 2: 8, 3: 9, 4: 10} | dict.fromkeys(range(5, 10), 23) | dict.fromkeys(range(10, 16), 40)


class Gpio:
    """inputs: pin -> function that returns its level; outputs: pin -> function called with its level.  An undriven pin is high.

    changes: the next cycle at which an input may change, for a waiting loop.
    """

    def __init__(self, clock: CycleClock, moder: int = 0) -> None:
        self._words = {MODER: moder}
        self._clock, self._poll = clock, Poll(clock, 8)
        self.changes: Callable[[], float] = lambda: NEVER
        self.inputs: dict[int, Callable[[], bool]] = {}
        self.outputs: dict[int, Callable[[bool], None]] = {}

    def mode(self, pin: int) -> int:
        """0 input, 1 output, 2 alternate, 3 analog."""
        return self._words[MODER] >> 2 * pin & 3

    def alternate(self, pin: int) -> int:
        """Return the alternate function, or -1."""
        function = self._words.get(AFRH if pin > 7 else AFRL, 0) >> 4 * (pin & 7) & 15
        return function if self.mode(pin) == ALTERNATE else -1

    def level(self, pin: int) -> bool:
        """Return the logic level of a pin."""
        if self.mode(pin) == OUTPUT:
            return bool(self._words.get(ODR, 0) >> pin & 1)
        source = self.inputs.get(pin)
        return source() if source else True

    def read(self, offset: int) -> int:
        """Read a word."""
        if offset == IDR:
            value = sum(self.level(pin) << pin for pin in range(16))
            if self._poll.again(value):
                self._clock.skip_to(self.changes())
            return value
        self._poll.broken()
        return 0 if offset == BSRR else self._words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write a word."""
        before = {pin: self.level(pin) for pin in self.outputs}
        if offset == BSRR:
            self._words[ODR] = self._words.get(ODR, 0) & ~(value >> 16) | value & 0xFFFF
        elif offset != IDR:
            self._words[offset] = value
        for pin, tell in self.outputs.items():
            if self.level(pin) != before[pin]:
                tell(self.level(pin))


class Exti:
    """Interrupts from the edges of pins; SYSCFG selects the port.  watched: whether the program uses a pin's edges."""

    IMR, EMR, RTSR, FTSR, SWIER, PR = range(0, 24, 4)

    def __init__(self, nvic: Nvic, changed: Callable[[], None]):
        self._nvic, self._changed = nvic, changed
        self._words = dict.fromkeys((self.IMR, self.EMR, self.RTSR, self.FTSR, self.SWIER, self.PR), 0)
        self.ports = {n: 0 for n in range(4)}  # SYSCFG_EXTICR

    def watched(self, port: int, pin: int) -> bool:
        """Whether an edge there would be detected."""
        return bool(self._words[self.IMR] >> pin & 1 and self.ports[pin >> 2] >> 4 * (pin & 3) & 15 == port)

    def edge(self, port: int, pin: int, rising: bool) -> None:
        """Handle an edge of a pin."""
        if self.watched(port, pin) and self._words[self.RTSR if rising else self.FTSR] >> pin & 1:
            self._words[self.PR] |= 1 << pin
            self._lines()

    def _lines(self) -> None:
        for interrupt in set(EXTI_IRQS.values()):
            pins = [pin for pin, irq in EXTI_IRQS.items() if irq == interrupt]
            self._nvic.line(interrupt, any(self._words[self.PR] & self._words[self.IMR] >> pin << pin & 1 << pin for pin in pins))

    def read(self, offset: int) -> int:
        """Read a word."""
        return self._words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write a word; ones written to PR clear its bits."""
        if offset == self.PR:
            self._words[self.PR] &= ~value
        elif offset == self.SWIER:
            self._words[self.PR] |= value & self._words[self.IMR]
        elif offset in self._words:
            self._words[offset] = value
        self._lines()
        self._changed()


class Syscfg:
    """Selection of the port for each pin's interrupt."""

    def __init__(self, exti: Exti, changed: Callable[[], None]):
        self._exti, self._changed = exti, changed

    def read(self, offset: int) -> int:
        """Read a word."""
        return self._exti.ports.get((offset - 8) // 4, 0) if offset >= 8 else 0

    def write(self, offset: int, value: int) -> None:
        """Write a word."""
        if 8 <= offset < 24:
            self._exti.ports[(offset - 8) // 4] = value
            self._changed()
