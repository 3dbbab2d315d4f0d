"""A board that takes commands is set as the user wants it, each time that its port is opened; one that takes none is only listened to."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import serial

from session.common.errors import CalibrationError, DeviceError
from session.stream import commands, frames
from session.stream.board import STANDIN, Board, Done
from session.stream.decoder import StreamDecoder
from session.stream.events import Event, Info

#: a board that speaks says so each second
SPEAKS_S = 2.5
#: for an answer: the slowest filters settle in 2.1 s; a command that was lost is sent again
ANSWER_S, TRIES = 3.5, 2
#: both divide the STM32F405's 84 MHz exactly
FASTER = (2_000_000, 3_000_000)
#: the board takes the nominal rate that is so near; a true rate is within 19 % of its nominal one, the next is half or double
RATE_WITHIN, TRUE_RATE_WITHIN = 0.05, 0.25
#: a board that says otherwise sooner than this after it was set means it
MEANS_IT_S = 5.0
FINE_STEP = 0.0015  #: of the data rate, for each step of INTERNAL_FREQ_FINE
RATES = "12.5, 26, 52, 104, 208, 417, 833, 1667, 3333, 6667 Hz"


@dataclass(frozen=True)
class Wanted:
    """What the user wants of the board; None: as it is."""

    odr_hz: float | None = None
    gyro_fs_dps: float | None = None
    accel_fs_g: float | None = None

    @property
    def anything(self) -> bool:
        """Whether there is something to be set."""
        return any(value is not None for value in (self.odr_hz, self.gyro_fs_dps, self.accel_fs_g))


class BoardSetting:
    """Called with an open port; gives the bytes that belong to the recording: all where the board takes no commands, else none of those
    before it was set.  said: what was done, in words.  CalibrationError where the board refuses, DeviceError where it does not answer.

    ``forgotten`` hears what the board sends: one that was switched on again meanwhile, its port open all the time, is as it was made."""

    def __init__(self, wanted: Wanted):
        self._wanted = wanted
        self.said: list[str] = []
        self._set_s: float | None = None  # when a board was set
        self._cut = b""  # what may be the beginning of a frame

    @property
    def speaks(self) -> bool:
        """Whether the board was set: such a one says what it is each second."""
        return self._set_s is not None

    def forgotten(self, data: bytes) -> int | None:
        """Where in these bytes, the next that came, the board says that it is not set as it was; None: nowhere."""
        if self._set_s is None:
            return None
        whole, before, place = self._cut + data, len(self._cut), 0
        *blocks, self._cut = whole.split(b"\0")
        self._cut = self._cut[-frames.INFO_BYTES :]
        for block in blocks:
            if len(block) == frames.INFO_BYTES and self._differs(block):
                if time.monotonic() - self._set_s < MEANS_IT_S:
                    self._set_s = None
                    return None
                self._cut = b""
                return max(0, place - before)
            place += len(block) + 1
        return None

    def _differs(self, block: bytes) -> bool:
        bodies, good = frames.decode_blocks(np.frombuffer(block, np.uint8)[None])
        info = frames.decode_info(bodies[0].tobytes()) if good.all() and bodies[0, 0] == frames.INFO_TYPE else None
        if info is None:
            return False
        wanted = self._wanted
        rate = wanted.odr_hz is not None and abs(info.odr_hz / wanted.odr_hz - 1) > TRUE_RATE_WITHIN
        ranges = ((wanted.gyro_fs_dps, info.gyro_fs_dps), (wanted.accel_fs_g, info.accel_fs_g))
        return rate or any(asked is not None and asked != said for asked, said in ranges)

    def __call__(self, port: serial.Serial) -> bytes:
        """Bounded: some seconds for each step."""
        if not self._wanted.anything:
            return b""
        self.said, self._set_s, self._cut = [], None, b""
        talk = _Talk(port)
        talk.listen(lambda: talk.board is not None or talk.is_mute, SPEAKS_S)
        own_baud = port.baudrate
        for baud in FASTER:  # as an earlier recording has left it
            if talk.decoder.taken and talk.decoder.mode is None and not talk.decoder.samples:
                port.baudrate = baud
                talk.listen(lambda: talk.board is not None or talk.is_mute, SPEAKS_S)
        if talk.board is None:
            port.baudrate = own_baud
            return bytes(talk.heard)
        self._set(talk)
        self._set_s = time.monotonic()
        return b""

    def _set(self, talk: _Talk) -> None:
        wanted, board = self._wanted, talk.board
        assert board is not None
        if wanted.odr_hz is not None and (board.source == STANDIN or abs(wanted.odr_hz / board.odr_hz - 1) > RATE_WITHIN):
            needed = commands.least_baud(wanted.odr_hz * (1 + FINE_STEP * board.freq_fine))
            if board.baud < needed:
                self._raise_baud(talk, next((baud for baud in FASTER if baud >= needed), FASTER[-1]))
            talk.ask(commands.DATA_RATE, f"--odr {wanted.odr_hz:g}", wanted.odr_hz, hint=f"the data rates are {RATES}")
            self.said.append(f"data rate {wanted.odr_hz:g} Hz")
        talk.listen(lambda: talk.info is not None, ANSWER_S)
        if (info := talk.info) is None:
            raise DeviceError("the board does not say its ranges; switch it off and on")
        gyro_fs, accel_fs = wanted.gyro_fs_dps or info.gyro_fs_dps, wanted.accel_fs_g or info.accel_fs_g
        if board.source == STANDIN or (gyro_fs, accel_fs) != (info.gyro_fs_dps, info.accel_fs_g):
            what = f"--gyro-fs {gyro_fs:g} --accel-fs {accel_fs:g}"
            hint = "the ranges are 125, 250, 500, 1000, 2000, 4000 dps and 2, 4, 8, 16 g"
            if gyro_fs % 1 or accel_fs % 1 or max(gyro_fs, accel_fs) > 0xFFFF:
                raise CalibrationError(f"{what}: {commands.REFUSALS[commands.IMPOSSIBLE]}; {hint}")
            talk.ask(commands.RANGES, what, int(gyro_fs), int(accel_fs), hint=hint)
            self.said.append(f"ranges {gyro_fs:g} dps, {accel_fs:g} g")

    def _raise_baud(self, talk: _Talk, baud: int) -> None:
        talk.ask(commands.BAUD, f"{baud} baud", baud)
        talk.port.baudrate = baud
        try:
            talk.ask(commands.IDENTIFY, f"{baud} baud")
        except DeviceError:
            raise DeviceError(
                f"nothing is heard at the {baud} baud that this data rate needs: the port or its adapter does not do them; a lower --odr"
            ) from None
        self.said.append(f"{baud} baud")


class _Talk:
    """heard: all bytes so far; board, info: the last of each; is_mute: whether it is plain by now that the board takes no commands."""

    def __init__(self, port: serial.Serial):
        self.port, self.decoder, self.heard = port, StreamDecoder(), bytearray()
        self.board: Board | None = None
        self.info: Info | None = None
        self._infos = self._sequence = 0
        self._asked: tuple[int, int] | None = None  # sequence and command
        self._answer: int | None = None  # to it

    @property
    def is_mute(self) -> bool:
        return (self.decoder.mode == "text" and self.decoder.samples > 0) or (self.board is None and self._infos > 1)

    def listen(self, enough: Callable[[], bool], seconds: float) -> bool:
        """Until enough has come, at most so long; whether it has."""
        until_s = time.monotonic() + seconds
        while not enough() and time.monotonic() < until_s:
            data = self.port.read(max(1, self.port.in_waiting))
            self.heard += data
            for event in self.decoder.feed(data):
                self._take(event)
        return enough()

    def ask(self, command: int, what: str, *values: float, hint: str = "") -> None:
        """Send a command and wait for its answer."""
        for _ in range(TRIES):
            self._sequence += 1
            self._answer, self._asked = None, (self._sequence, command)
            self.port.write(commands.encode_command(command, self._sequence, *values))
            self.listen(lambda: self._answer is not None, ANSWER_S)
            if self._answer == commands.DONE:
                return
            if self._answer is not None:
                why = commands.REFUSALS.get(self._answer, f"result {self._answer}")
                more = f"; {hint}" if hint and self._answer == commands.IMPOSSIBLE else ""
                raise CalibrationError(f"the board refuses {what}: {why}{more}")
        raise DeviceError(f"the board does not answer ({what}); is its receive line (PA10) connected? else switch it off and on")

    def _take(self, event: Event) -> None:
        if isinstance(event, Board):
            self.board = event
        elif isinstance(event, Info):
            self.info, self._infos = event, self._infos + 1
        elif isinstance(event, Done) and (event.sequence, event.command) == self._asked:
            self._answer = event.result
