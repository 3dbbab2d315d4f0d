"""The emulated board at the end of a cable: simulated time against the clock's, bytes through a pseudo-terminal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from tinygc.simulation.asm330lhh.port import Port
from tinygc.simulation.asm330lhh.sensor import Asm330lhh
from tinygc.simulation.board.clock import Clock
from tinygc.simulation.emulated.replayed import Replayed
from tinygc.simulation.stm32f405.machine import UID, Machine

SLICE_S = 0.004
READ_AGAIN_S = 0.001
BEHIND_S = 0.2  #: what is not made up for: the board's clock then loses against the host's


class Cable(Protocol):
    """The board's end, as ``terminal.Terminal`` has it."""

    @property
    def has_reader(self) -> bool:
        """Whether somebody listens."""

    @property
    def waiting(self) -> int:
        """Bytes that have not been read yet, as far as it knows."""

    def write(self, data: bytes) -> bool:
        """To the host; False where nobody listens."""

    def read(self) -> bytes:
        """From the host."""


class EmulatedBoard:
    """The firmware of an ELF file, a sensor, a motion and a cable on USART1.

    speed: simulated seconds in one of the clock's; None: as quickly as it goes and is read, once there is a reader.
    lead_s: still time between the first reader and the
    session; tail_s: still time behind it, then ``run`` returns; None: never returns.

    uid: the microcontroller's unique id, 12 bytes, from which it may make its serial number.

    late_s: by how much the clock went on without it, since this machine was too slow or too busy.
    """

    def __init__(
        self,
        elf: Path,
        sensor: Asm330lhh,
        cable: Cable,
        motion: Replayed | None = None,
        speed: float | None = 1.0,
        lead_s: float = 10.0,
        tail_s: float | None = None,
        clock: Clock | None = None,
        uid: bytes = UID,
        say: Callable[[str], None] = lambda what: None,
    ):
        self.machine = Machine(elf, Port(sensor), uid)
        self.sensor, self._cable, self._motion, self._speed = sensor, cable, motion, speed
        self._lead_s, self._tail_s, self._clock, self._say = lead_s, tail_s, clock or Clock(), say
        self.late_s = 0.0

    def run(self) -> None:
        """Until the tail is over."""
        machine, cable = self.machine, self._cable
        end_s: float | None = None
        began_s, t_s = self._clock.now_s(), 0.0
        while end_s is None or t_s < end_s:
            t_s += SLICE_S
            machine.run_until(t_s)
            if sent := machine.usart1.take():
                cable.write(sent)
            if heard := cable.read():
                machine.usart1.feed(heard)
            if end_s is None and cable.has_reader:
                end_s = self._begin(t_s)
            if self._speed or not cable.has_reader:
                began_s = self._pace(began_s, t_s / (self._speed or 1.0))
            while not self._speed and cable.waiting:
                self._clock.sleep(READ_AGAIN_S)
                cable.write(b"")

    def _begin(self, t_s: float) -> float:
        """Somebody reads: when all will be over."""
        self._say(f"a reader is there: {self._lead_s:g} s still, then the session")
        duration_s = 0.0
        if self._motion:
            self._motion.start(t_s + self._lead_s)
            duration_s = self._motion.duration_s
        return float("inf") if self._tail_s is None else t_s + self._lead_s + duration_s + self._tail_s

    def _pace(self, began_s: float, due_s: float) -> float:
        """Wait for the clock, or give up what cannot be made up for."""
        ahead_s = due_s - (self._clock.now_s() - began_s)
        if ahead_s > 0:
            self._clock.sleep(ahead_s)
        elif ahead_s < -BEHIND_S:
            self.late_s -= ahead_s if self._speed else 0.0
            began_s -= ahead_s
        return began_s
