"""What a board says of itself beside its samples: frames 0x05 to 0x08 (docs/firmware.md).  The same said again is no event."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from session.common.sources import SENSOR_NAME, STANDIN_NAME

BOARD_TYPE, FAULTS_TYPE, DONE_TYPE, TESTED_TYPE = 0x05, 0x06, 0x07, 0x08
STANDIN, SENSOR = 0, 1
#: counts of a faults frame, in its order
FAULTS = (
    "overrun",
    "order",
    "parity",
    "tag",
    "hang",
    "zeros",
    "ones",
    "reset",
    "changed",
    "identity",
    "silent",
    "stamp",
    "incomplete",
    "starts",
    "lost",
    "crowded_out",
)
_HEAD = struct.Struct("<BH")
_BOARD = struct.Struct("<BBBBBBb10sIf")
_FAULTS = struct.Struct("<16I")
_DONE = struct.Struct("<BB")
_TESTED = struct.Struct("<H6f")
_LENGTHS = {
    BOARD_TYPE: _HEAD.size + _BOARD.size,
    FAULTS_TYPE: _HEAD.size + _FAULTS.size,
    DONE_TYPE: _HEAD.size + _DONE.size,
    TESTED_TYPE: _HEAD.size + _TESTED.size,
}


@dataclass(frozen=True)
class Board:
    """Who gives the samples, and how it is set.  source: STANDIN or SENSOR (a number beyond them is a newer firmware's); registers:
    CTRL1_XL to CTRL10_C as read back; baud of the host's port; odr_hz: nominal."""

    source: int
    streams: bool
    runs: bool
    firmware: str
    who_am_i: int
    freq_fine: int
    registers: bytes
    baud: int
    odr_hz: float

    @property
    def source_name(self) -> str:
        """In a word."""
        return {STANDIN: STANDIN_NAME, SENSOR: SENSOR_NAME}.get(self.source, str(self.source))

    @property
    def text(self) -> str:
        """As a log's comment says it, without the ``#``."""
        said = f"board source={self.source_name} firmware={self.firmware}"
        if self.source == STANDIN:  # which has no registers
            return said
        return f"{said} who_am_i=0x{self.who_am_i:02X} freq_fine={self.freq_fine} registers={self.registers.hex()}"


@dataclass(frozen=True)
class Faults:
    """How often each of ``FAULTS`` has been counted since power-up."""

    counts: tuple[int, ...]

    @property
    def text(self) -> str:
        """As a log's comment says it, without the ``#``: those that there are."""
        return " ".join(["faults", *(f"{name}={count}" for name, count in zip(FAULTS, self.counts, strict=True) if count)])

    def since(self, before: Faults | None) -> dict[str, int]:
        """What has risen, by how much.  A count that fell is a board that was switched on again: it counts from nothing."""
        old = before.counts if before is not None else (0,) * len(FAULTS)
        if any(now < then for now, then in zip(self.counts, old, strict=True)):
            old = (0,) * len(FAULTS)
        return {name: now - then for name, now, then in zip(FAULTS, self.counts, old, strict=True) if now > then}


@dataclass(frozen=True)
class Done:
    """The answer to a command: its type, its sequence number, and 0 or why not."""

    sequence: int
    command: int
    result: int


@dataclass(frozen=True)
class SelfTest:
    """The sensor's self-test: failed, a bit for each axis; how far it moved the outputs, (3,) dps and (3,) mg."""

    failed: int
    gyro_dps: tuple[float, ...]
    accel_mg: tuple[float, ...]


Said = Board | Faults | Done | SelfTest


def decode_said(body: bytes) -> Said | None:
    """A frame's body without its CRC; None where it is none of the four, or not as long as it must be."""
    if len(body) < _HEAD.size or _LENGTHS.get(body[0]) != len(body):
        return None
    kind, sequence = _HEAD.unpack_from(body)
    rest = body[_HEAD.size :]
    if kind == BOARD_TYPE:
        source, state, major, minor, patch, who, fine, registers, baud, odr_hz = _BOARD.unpack(rest)
        return Board(source, bool(state & 1), bool(state & 2), f"{major}.{minor}.{patch}", who, fine, registers, baud, odr_hz)
    if kind == FAULTS_TYPE:
        return Faults(_FAULTS.unpack(rest))
    if kind == DONE_TYPE:
        return Done(sequence, *_DONE.unpack(rest))
    failed, *moved = _TESTED.unpack(rest)
    return SelfTest(failed, tuple(moved[:3]), tuple(moved[3:]))


class BoardFrames:
    """Which frames say something new: a board and its faults are sent each second."""

    def __init__(self) -> None:
        self._last: dict[int, bytes] = {}

    def fresh(self, bodies: Mapping[int, np.ndarray]) -> dict[int, Said]:
        """Of bodies by block, in order, those that differ from the last of their type, and every answer."""
        found: dict[int, Said] = {}
        for row in sorted(bodies):
            body = bodies[row].tobytes()
            content = body[_HEAD.size :]
            if body[0] in (BOARD_TYPE, FAULTS_TYPE) and self._last.get(body[0]) == content:
                continue
            if (said := decode_said(body)) is not None:
                self._last[body[0]] = content
                found[row] = said
        return found
