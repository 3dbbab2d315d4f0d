"""``tinygc-frame/1`` on the wire (docs/formats.md): COBS frames, and commands to a board.

Frames stand between zero bytes; they are little-endian and carry a CRC-16/CCITT-FALSE.  Both directions handle many frames at once.  One
counter numbers samples and infos.  A frame is shorter than 254 bytes, so COBS replaces each zero by the distance to the next, puts the
first distance in front, and adds nothing else (Cheshire and Baker 1999).
"""

from __future__ import annotations

import binascii
import struct

import numpy as np

from session.bench.events import FAULTS, BoardStatus, Event, Info

SAMPLE_TYPE, INFO_TYPE = 0x01, 0x02
#: a sample frame without its CRC
SAMPLE = np.dtype([("type", "u1"), ("sequence", "<u2"), ("t_us", "<u4"), ("registers", "<i2", (7,))])
INFO = struct.Struct("<BHHHfI")
#: bytes between two delimiters
SAMPLE_BYTES, INFO_BYTES = SAMPLE.itemsize + 3, INFO.size + 3
#: frames of other types (docs/formats.md): bytes between two delimiters, and the range of types
SHORTEST_OTHER, LONGEST_OTHER = 6, 81
FIRST_OTHER, LAST_OTHER = 0x03, 0x1F
CRC_START = 0xFFFF


def damaged_words(crc_errors: int) -> str:
    """How many damaged frames may have passed the check, in words; crc_errors: the number of those that failed it."""
    by_chance = crc_errors / 2**16
    many = f"about {by_chance:.0f}" if by_chance >= 1 else "fewer than one"
    return f"{many} may pass the check by chance: most stand out and are left out, but one that differs in low bits alone is not detected"


def encode_samples(sequence: np.ndarray, t_us: np.ndarray, registers: np.ndarray) -> np.ndarray:
    """Encode sample frames with their delimiter: (n, 25) uint8.  sequence and t_us (n,) wrap; registers (n, 7) int16."""
    table = np.zeros(len(t_us), dtype=SAMPLE)
    table["type"] = SAMPLE_TYPE
    table["sequence"] = np.asarray(sequence) & 0xFFFF
    table["t_us"] = np.asarray(t_us) & 0xFFFFFFFF
    table["registers"] = registers
    return encode_blocks(table.view(np.uint8).reshape(len(table), SAMPLE.itemsize))


def encode_info(sequence: int, info: Info) -> bytes:
    """Encode an info frame with its delimiter.  A serial number that does not fit 32 bits is sent as 0."""
    serial = int(info.serial) if info.serial.isascii() and info.serial.isdigit() else 0
    body = INFO.pack(INFO_TYPE, sequence & 0xFFFF, int(info.gyro_fs_dps), int(info.accel_fs_g), info.odr_hz, serial & 0xFFFFFFFF)
    return encode_blocks(np.frombuffer(body, np.uint8)[None]).tobytes()


def encode_blocks(bodies: np.ndarray) -> np.ndarray:
    """Add CRC, COBS and delimiter to bodies (n, k) uint8 of one length, k + 2 < 254: (n, k + 4) uint8."""
    count, size = bodies.shape
    plain = np.empty((count, size + 2), np.uint8)
    plain[:, :size] = bodies
    check = crc(bodies)
    plain[:, size], plain[:, size + 1] = check & 0xFF, check >> 8
    coded = np.zeros((count, size + 4), np.uint8)
    coded[:, 1:-1] = plain
    # From the end: each zero, and the first place, holds the distance to the next zero or the end.
    following = np.full(count, size + 3, np.int64)
    for place in range(size + 2, 0, -1):
        zero = plain[:, place - 1] == 0
        coded[zero, place] = following[zero] - place
        following[zero] = place
    coded[:, 0] = following
    return coded


def decode_blocks(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Decode COBS and check the CRC of blocks (n, k) uint8 without delimiter: bodies (n, k - 3) uint8 and good (n,) bool."""
    size = blocks.shape[1]
    plain = blocks[:, 1:].copy()
    place = blocks[:, 0].astype(np.int64)
    rows = np.flatnonzero(place < size)
    while len(rows):
        plain[rows, place[rows] - 1] = 0
        place[rows] += blocks[rows, place[rows]]
        rows = rows[place[rows] < size]
    body = plain[:, :-2]
    sent = plain[:, -2].astype(np.uint16) | plain[:, -1].astype(np.uint16) << 8
    return body, (place == size) & (sent == crc(body))


def decode_info(body: bytes) -> Info | None:
    """Decode an info frame's body; None where no sensor has such values."""
    _, _, gyro_fs, accel_fs, odr_hz, serial = INFO.unpack(body)
    if not (gyro_fs and accel_fs and 0.1 <= odr_hz <= 1e5):
        return None
    return Info(float(gyro_fs), float(accel_fs), float(odr_hz), str(serial))


# Messages of a board about itself: frames 0x05 to 0x08 (docs/firmware.md).

BOARD_TYPE, FAULTS_TYPE, DONE_TYPE, TESTED_TYPE = 0x05, 0x06, 0x07, 0x08
FIRST_FAULTS_BYTES = 64  #: of firmware 1.0, which counted all but "rate"
_HEAD = struct.Struct("<BH")
_CONTENT = {
    BOARD_TYPE: struct.Struct("<BBBBBBb10sIf"),
    FAULTS_TYPE: struct.Struct(f"<{len(FAULTS)}I"),
    DONE_TYPE: struct.Struct("<BB"),
    TESTED_TYPE: struct.Struct("<H6f"),
}


def decode_message(body: bytes) -> BoardStatus | Event | None:
    """Decode a frame's body without its CRC; None where its type or its length is none of the four."""
    if len(body) < _HEAD.size or body[0] not in _CONTENT:
        return None
    if body[0] == FAULTS_TYPE and len(body) == _HEAD.size + FIRST_FAULTS_BYTES:
        body += bytes(_CONTENT[FAULTS_TYPE].size - FIRST_FAULTS_BYTES)
    if len(body) != _HEAD.size + _CONTENT[body[0]].size:
        return None
    kind, sequence = _HEAD.unpack_from(body)
    values = _CONTENT[kind].unpack_from(body, _HEAD.size)
    if kind == BOARD_TYPE:
        source, state, major, minor, patch, who, fine, registers, baud, odr_hz = values
        firmware, states = f"{major}.{minor}.{patch}", [bool(state >> bit & 1) for bit in range(5)]
        return BoardStatus(source, states[0], states[1], firmware, who, fine, registers, baud, odr_hz, *states[2:])
    if kind == DONE_TYPE:
        return Event("done", numbers=(sequence, *values))
    return Event("faults" if kind == FAULTS_TYPE else "tested", numbers=values)


def crc(bodies: np.ndarray) -> np.ndarray:
    """CRC-16/CCITT-FALSE of each row of (n, k) uint8: (n,) uint16."""
    return np.array([binascii.crc_hqx(body, CRC_START) for body in bodies], np.uint16)


# Commands of a host to a board, frames 0x11 to 0x18, and the board's answers (docs/firmware.md).

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
#: bits on the wire for a sample, and each second for everything else
SAMPLE_BITS, OTHER_BITS = 250, 2000


def encode_command(command: int, sequence: int, *values: float) -> bytes:
    """Encode a command with its delimiter."""
    body = struct.pack("<BH", command, sequence & 0xFFFF) + struct.pack(_BODY[command], *values)
    return encode_blocks(np.frombuffer(body, np.uint8)[None]).tobytes()


def least_baud(true_odr_hz: float) -> float:
    """The lowest baud rate that carries so many samples a second."""
    return true_odr_hz * SAMPLE_BITS + OTHER_BITS
