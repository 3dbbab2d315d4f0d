"""Ports, and the interrupts of their pins."""

from __future__ import annotations

from collections.abc import Callable

from tinygc.simulation.stm32f405.clock import NEVER, Clock, Poll
from tinygc.simulation.stm32f405.nvic import Nvic

MODER, IDR, ODR, BSRR, AFRL, AFRH = 0x00, 0x10, 0x14, 0x18, 0x20, 0x24
ANALOG, OUTPUT, ALTERNATE = 3, 1, 2
EXTI_IRQS = {0: 6, 1: 7, 2: 8, 3: 9, 4: 10} | dict.fromkeys(range(5, 10), 23) | dict.fromkeys(range(10, 16), 40)


class Gpio:
    """inputs: pin -> its level now; outputs: pin -> told of its level.  An undriven pin is high.

    changes: the next cycle at which an input may change, for a loop that waits for it.
    """

    def __init__(self, clock: Clock, moder: int = 0) -> None:
        self._words = {MODER: moder}
        self._clock, self._poll = clock, Poll(clock, 8)
        self.changes: Callable[[], float] = lambda: NEVER
        self.inputs: dict[int, Callable[[], bool]] = {}
        self.outputs: dict[int, Callable[[bool], None]] = {}

    def mode(self, pin: int) -> int:
        """0 input, 1 output, 2 alternate, 3 analog."""
        return self._words[MODER] >> 2 * pin & 3

    def alternate(self, pin: int) -> int:
        """The alternate function, or -1."""
        function = self._words.get(AFRH if pin > 7 else AFRL, 0) >> 4 * (pin & 7) & 15
        return function if self.mode(pin) == ALTERNATE else -1

    def level(self, pin: int) -> bool:
        """What can be measured at it."""
        if self.mode(pin) == OUTPUT:
            return bool(self._words.get(ODR, 0) >> pin & 1)
        source = self.inputs.get(pin)
        return source() if source else True

    def read(self, offset: int) -> int:
        """A word."""
        if offset == IDR:
            value = sum(self.level(pin) << pin for pin in range(16))
            if self._poll.again(value):
                self._clock.skip_to(self.changes())
            return value
        self._poll.broken()
        return 0 if offset == BSRR else self._words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """A word."""
        before = {pin: self.level(pin) for pin in self.outputs}
        if offset == BSRR:
            self._words[ODR] = self._words.get(ODR, 0) & ~(value >> 16) | value & 0xFFFF
        elif offset != IDR:
            self._words[offset] = value
        for pin, tell in self.outputs.items():
            if self.level(pin) != before[pin]:
                tell(self.level(pin))


class Exti:
    """The edges of pins; SYSCFG says of which port.  watched: whether a pin's edges matter to the program."""

    IMR, EMR, RTSR, FTSR, SWIER, PR = range(0, 24, 4)

    def __init__(self, nvic: Nvic, changed: Callable[[], None]):
        self._nvic, self._changed = nvic, changed
        self._words = dict.fromkeys((self.IMR, self.EMR, self.RTSR, self.FTSR, self.SWIER, self.PR), 0)
        self.ports = {n: 0 for n in range(4)}  # SYSCFG_EXTICR

    def watched(self, port: int, pin: int) -> bool:
        """Whether an edge there would be noticed."""
        return bool(self._words[self.IMR] >> pin & 1 and self.ports[pin >> 2] >> 4 * (pin & 3) & 15 == port)

    def edge(self, port: int, pin: int, rising: bool) -> None:
        """A pin has changed."""
        if self.watched(port, pin) and self._words[self.RTSR if rising else self.FTSR] >> pin & 1:
            self._words[self.PR] |= 1 << pin
            self._lines()

    def _lines(self) -> None:
        for interrupt in set(EXTI_IRQS.values()):
            pins = [pin for pin, irq in EXTI_IRQS.items() if irq == interrupt]
            self._nvic.line(interrupt, any(self._words[self.PR] & self._words[self.IMR] >> pin << pin & 1 << pin for pin in pins))

    def read(self, offset: int) -> int:
        """A word."""
        return self._words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """A word; ones written to PR are taken back."""
        if offset == self.PR:
            self._words[self.PR] &= ~value
        elif offset == self.SWIER:
            self._words[self.PR] |= value & self._words[self.IMR]
        elif offset in self._words:
            self._words[offset] = value
        self._lines()
        self._changed()


class Syscfg:
    """Which port each pin's interrupt is of."""

    def __init__(self, exti: Exti, changed: Callable[[], None]):
        self._exti, self._changed = exti, changed

    def read(self, offset: int) -> int:
        """A word."""
        return self._exti.ports.get((offset - 8) // 4, 0) if offset >= 8 else 0

    def write(self, offset: int, value: int) -> None:
        """A word."""
        if 8 <= offset < 24:
            self._exti.ports[(offset - 8) // 4] = value
            self._changed()
