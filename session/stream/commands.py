"""What a host asks of a board, as frames 0x11 to 0x18, and what the board's answers mean (docs/firmware.md)."""

from __future__ import annotations

import struct

import numpy as np

from session.stream.frames import encode_blocks

DATA_RATE, RANGES, FILTERS, START, STOP, SELF_TEST, IDENTIFY, BAUD = range(0x11, 0x19)
_BODY = {DATA_RATE: "<f", RANGES: "<HH", FILTERS: "<BH", START: "<", STOP: "<", SELF_TEST: "<", IDENTIFY: "<", BAUD: "<I"}
DONE, UNKNOWN, IMPOSSIBLE, NO_SENSOR, TOO_QUICK, NOT_TAKEN, TEST_FAILED = range(7)
REFUSALS = {
    UNKNOWN: "its firmware does not know the command; flash a newer one",
    IMPOSSIBLE: "its sensor has no such value",
    NO_SENSOR: "it has no sensor; look at the wiring",
    TOO_QUICK: "its port is too slow for this data rate",
    NOT_TAKEN: "its sensor did not start; look at supply and wires",
    TEST_FAILED: "the sensor's self-test failed",
}
#: bits on the wire for a sample, and each second for all else
SAMPLE_BITS, OTHER_BITS = 250, 2000


def encode_command(command: int, sequence: int, *values: float) -> bytes:
    """A command's frame with its delimiters."""
    body = struct.pack("<BH", command, sequence & 0xFFFF) + struct.pack(_BODY[command], *values)
    return encode_blocks(np.frombuffer(body, np.uint8)[None]).tobytes()


def least_baud(true_odr_hz: float) -> float:
    """Of a port that carries so many samples a second."""
    return true_odr_hz * SAMPLE_BITS + OTHER_BITS
