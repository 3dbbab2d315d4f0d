"""Streams a source in real time, or so many times faster."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from session.common.texts import comment
from session.stream import frames
from session.stream.form import HEADER
from tinygc.simulation.board.clock import Clock
from tinygc.simulation.board.faults import Faults, spoil
from tinygc.simulation.board.source import Source
from tinygc.simulation.board.terminal import Terminal

TICK_S = 0.004
#: physical units with the digits of a float32, which a board's printf has
ROW, PHYSICAL_ROW = ",".join(["%d"] * 8) + "\n", ",".join(["%d"] + ["%.7g"] * 7) + "\n"
PHYSICAL_HEADER = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c"
CATCH_UP_S = 0.02  #: of lateness made up for in a tick
RESET_S = 0.5  #: a board starts up in about this time
UNPLUGGED_S = 1.0  #: host time that a pulled cable stays out


@dataclass
class Board:
    """frames: instead of text lines; physical: the lines are in dps, g and degC.

    lead_s: still time between the first reader and the session; tail_s: still time behind it, then ``run`` returns; None: never
    returns; uptime_s: device time at the start (its 32 bits wrap after 71.6 minutes); clock: what time passes by.

    Counts: sent (samples that were put on the wire, or spoilt by the faults), starts (of the device).
    """

    source: Source
    terminal: Terminal
    frames: bool = False
    physical: bool = False
    speed: float = 1.0
    lead_s: float = 10.0
    tail_s: float | None = None
    uptime_s: float = 0.0
    faults: Faults = field(default_factory=Faults)
    seed: int = 0
    say: Callable[[str], None] = lambda what: None
    clock: Clock = field(default_factory=Clock)
    sent: int = 0
    starts: int = 0

    def run(self) -> None:
        """Stream until the tail is over."""
        self._rng = np.random.default_rng(self.seed)
        odr_hz = self.source.info.odr_hz
        lead, length = round(self.lead_s * odr_hz), len(self.source.rows)
        last = None if self.tail_s is None else length + round(self.tail_s * odr_hz)
        self._position = -lead  # of the next sample in the source
        began, self._begun, told = self.clock.now_s(), False, False
        self._reset_at, self._unplug_at = (self._next(period) for period in (self.faults.reset, self.faults.unplug))
        self._plug_at = np.inf  # host time
        self._start(self.uptime_s)
        while last is None or self._position < last:
            self.clock.sleep(TICK_S)
            if not self._begun:
                if not self.terminal.has_reader:
                    continue
                self._begun, began = True, self.clock.now_s()
                self.say(f"a reader is there: {self.lead_s:g} s still, then the session")
                self._start(self.uptime_s)
            due = -lead + int((self.clock.now_s() - began) * odr_hz * self.speed)
            # A board that the machine let wait catches up in small steps: a burst would overrun its own memory.
            due = min(due, self._position + max(64, int(CATCH_UP_S * odr_hz * self.speed)))
            self._send(due if last is None else min(due, last))
            if not told and self._position >= length:
                told = True
                self.say("the session is over: still from here on")
            self._mishaps()

    def _next(self, period_s: float) -> float:
        return self._position + period_s * self.source.info.odr_hz if period_s else np.inf

    def _start(self, uptime_s: float) -> None:
        """Switch on: sequence and time begin anew."""
        self._sequence, self._zero_us, self._zero = 0, uptime_s * 1e6, self._position
        self._next_info = self._position
        self._silent_until = self._position
        self.starts += 1
        if self.faults.garbage:
            self.terminal.write(self._rng.bytes(int(self.faults.garbage)))
        if not self.frames:
            self.terminal.write(f"{PHYSICAL_HEADER if self.physical else HEADER}\n".encode())

    def _send(self, due: int) -> None:
        """All samples before ``due``."""
        while self._position < due:
            stop = min(due, self._next_info) if self._next_info > self._position else self._position
            if stop > self._position:
                self._samples(stop)
            if self._position == self._next_info:
                self._info()
                self._next_info += max(1, round(self.source.info.odr_hz))

    def _samples(self, stop: int) -> None:
        rows = self.source.take(self._position, stop, self._rng)
        t_us = np.rint(self._zero_us + (np.arange(self._position, stop) - self._zero) / self.source.info.odr_hz * 1e6).astype(np.int64)
        if self.frames:
            table = frames.encode_samples(self._sequence + np.arange(len(rows)), t_us, rows)
            self._sequence += len(rows)
            messages = [table.tobytes()] if self.faults == Faults() else [row.tobytes() for row in table]
        else:
            table = np.column_stack([t_us % 2**32, self.source.in_units(rows) if self.physical else rows])
            text = (PHYSICAL_ROW if self.physical else ROW) * len(table) % tuple(table.ravel().tolist())
            messages = [text.encode()] if self.faults == Faults() else [line.encode() for line in text.splitlines(keepends=True)]
        if self._position >= self._silent_until and self.terminal.write(spoil(messages, self.faults, self._rng)):
            self.sent += len(rows)
        self._position = stop

    def _info(self) -> None:
        if self.frames:
            message = frames.encode_info(self._sequence, self.source.info)
            self._sequence += 1
        else:
            message = f"# {comment(self.source.info.text)}\n".encode()  # a serial number is one line, whatever it says
        if self._position >= self._silent_until:
            self.terminal.write(spoil([message], self.faults, self._rng))

    def _mishaps(self) -> None:
        if self._position >= self._unplug_at:
            self.say("the cable is pulled")
            self.terminal.unplug()
            self._unplug_at, self._plug_at = np.inf, self.clock.now_s() + UNPLUGGED_S
        elif self.clock.now_s() >= self._plug_at:
            self.say("the cable is back, and the board starts up")
            self.terminal.plug()
            self._unplug_at, self._plug_at = self._next(self.faults.unplug), np.inf
            self._start(0.0)
        elif self._position >= self._reset_at:
            self.say("the board resets")
            self._reset_at = self._next(self.faults.reset)
            self._start(0.0)
            self._silent_until = self._position + round(RESET_S * self.source.info.odr_hz)
