"""``tinygc-frame/1`` on the wire: COBS frames, commands to a board, and the bandwidth that a stream needs."""

from __future__ import annotations

import binascii
import struct

import numpy as np

from session.bench.events import Info

# ``tinygc-frame/1`` (docs/formats.md): COBS between zero bytes, little-endian, CRC-16/CCITT-FALSE.  Both ways, many at a time.
#
# One counter numbers samples and infos.  A frame is shorter than 254 bytes, so COBS replaces each zero by the distance to
# the next, puts the first distance in front, and adds nothing else (Cheshire and Baker 1999).

SAMPLE_TYPE, INFO_TYPE = 0x01, 0x02
#: a sample frame without its CRC
SAMPLE = np.dtype([("type", "u1"), ("sequence", "<u2"), ("t_us", "<u4"), ("registers", "<i2", (7,))])
INFO = struct.Struct("<BHHHfI")
#: bytes between two delimiters
SAMPLE_BYTES, INFO_BYTES = SAMPLE.itemsize + 3, INFO.size + 3
#: of frames of other types (docs/formats.md): bytes between two delimiters, and the types that there may be
SHORTEST_OTHER, LONGEST_OTHER = 6, 81
FIRST_OTHER, LAST_OTHER = 0x03, 0x1F
CRC_START = 0xFFFF


def cannot_be_told(crc_errors: int) -> str:
    """Of frames of which so many failed their check: what may have passed it, in words."""
    by_chance = crc_errors / 2**16
    many = f"about {by_chance:.0f}" if by_chance >= 1 else "fewer than one"
    return f"{many} may pass the check by chance: most stand out and are left out, but one that differs in low bits alone cannot be told"


def encode_samples(sequence: np.ndarray, t_us: np.ndarray, registers: np.ndarray) -> np.ndarray:
    """Sample frames with their delimiter: (n, 25) uint8.  sequence and t_us (n,) wrap; registers (n, 7) int16."""
    table = np.zeros(len(t_us), dtype=SAMPLE)
    table["type"] = SAMPLE_TYPE
    table["sequence"] = np.asarray(sequence) & 0xFFFF
    table["t_us"] = np.asarray(t_us) & 0xFFFFFFFF
    table["registers"] = registers
    return encode_blocks(table.view(np.uint8).reshape(len(table), SAMPLE.itemsize))


def encode_info(sequence: int, info: Info) -> bytes:
    """An info frame with its delimiter.  A serial that is no number of 32 bits is sent as 0."""
    serial = int(info.serial) if info.serial.isascii() and info.serial.isdigit() else 0
    body = INFO.pack(INFO_TYPE, sequence & 0xFFFF, int(info.gyro_fs_dps), int(info.accel_fs_g), info.odr_hz, serial & 0xFFFFFFFF)
    return encode_blocks(np.frombuffer(body, np.uint8)[None]).tobytes()


def encode_blocks(bodies: np.ndarray) -> np.ndarray:
    """CRC, COBS and delimiter for bodies (n, k) uint8 of one length, k + 2 < 254: (n, k + 4) uint8."""
    count, size = bodies.shape
    plain = np.empty((count, size + 2), np.uint8)
    plain[:, :size] = bodies
    check = crc(bodies)
    plain[:, size], plain[:, size + 1] = check & 0xFF, check >> 8  # little-endian, like all else
    coded = np.zeros((count, size + 4), np.uint8)
    coded[:, 1:-1] = plain
    # From the end: each zero, and the place in front, holds the distance to the next zero or the end.
    following = np.full(count, size + 3, np.int64)
    for place in range(size + 2, 0, -1):
        zero = plain[:, place - 1] == 0
        coded[zero, place] = following[zero] - place
        following[zero] = place
    coded[:, 0] = following
    return coded


def decode_blocks(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Undo COBS and check the CRC of blocks (n, k) uint8, delimiter taken off.  Returns bodies (n, k - 3) uint8 and good (n,) bool."""
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


def is_other(types: np.ndarray) -> np.ndarray:
    """Whether the first byte of a body (n,) uint8 is a type that is neither a sample's nor an info's."""
    return (types >= FIRST_OTHER) & (types <= LAST_OTHER)


def decode_info(body: bytes) -> Info | None:
    """An info frame's body as ``Info``; None where it holds what no sensor has."""
    _, _, gyro_fs, accel_fs, odr_hz, serial = INFO.unpack(body)
    if not (gyro_fs and accel_fs and 0.1 <= odr_hz <= 1e5):
        return None
    return Info(float(gyro_fs), float(accel_fs), float(odr_hz), str(serial))


def crc(bodies: np.ndarray) -> np.ndarray:
    """CRC-16/CCITT-FALSE of each row of (n, k) uint8, k <= 78: (n,) uint16.

    A CRC is linear over bits: that of a row is the exclusive or of what each byte contributes from its place.
    """
    size = bodies.shape[1]
    contributions = _CONTRIBUTION[_LONGEST - size :]
    terms = contributions[np.arange(size), bodies]
    return np.bitwise_xor.reduce(terms, axis=1) ^ np.uint16(_START[size])


_LONGEST = LONGEST_OTHER - 3


def _contributions() -> np.ndarray:
    """(78, 256) uint16: what each value of the byte that has 77 … 0 bytes behind it adds to a CRC."""
    table = np.empty((_LONGEST, 256), np.uint16)
    table[-1] = [binascii.crc_hqx(bytes([value]), 0) for value in range(256)]
    for place in range(_LONGEST - 2, -1, -1):
        table[place] = (table[place + 1] << 8) ^ table[-1][table[place + 1] >> 8]
    return table


_CONTRIBUTION = _contributions()
#: what the start value alone leaves after so many bytes
_START = [binascii.crc_hqx(bytes(size), CRC_START) for size in range(_LONGEST + 1)]


# What a host asks of a board, as frames 0x11 to 0x18, and what the board's answers mean (docs/firmware.md).

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


# What a board's stream needs of its port: bytes of each frame, bits a second, and which ports carry them (docs/firmware.md).

#: on the wire, with CRC, COBS and delimiter; once for each sample, and once a second
SAMPLE_WIRE_BYTES, INFO_WIRE_BYTES, BOARD_BYTES, FAULTS_BYTES = 25, 19, 32, 71
#: start bit, eight, stop bit
BITS_A_BYTE = 10
BAUDS = (115_200, 230_400, 460_800, 921_600, 2_000_000)
#: INTERNAL_FREQ_FINE reaches 127 steps of 0.15 %
HIGHEST_FACTOR = 1 + 127 * 0.0015


def bits_per_second(true_odr_hz: float) -> float:
    """Of a stream without faults, at a true data rate."""
    return BITS_A_BYTE * (SAMPLE_WIRE_BYTES * true_odr_hz + INFO_WIRE_BYTES + BOARD_BYTES + FAULTS_BYTES)


def share(nominal_odr_hz: float, baud: int) -> float | None:
    """The part of a port that it takes at the nominal rate; None where the quickest unit of that nominal rate is refused by the board."""
    if least_baud(HIGHEST_FACTOR * nominal_odr_hz) > baud:
        return None
    return bits_per_second(nominal_odr_hz) / baud


def table(rates_hz: tuple[float, ...]) -> str:
    """In Markdown: a line for each nominal rate."""
    lines = ["| data rate, Hz | kbit/s | at most | " + " | ".join(map(str, BAUDS)) + " |", "| ---: " * (3 + len(BAUDS)) + "|"]
    for rate_hz in rates_hz:
        bits, most = bits_per_second(rate_hz), bits_per_second(HIGHEST_FACTOR * rate_hz)
        parts = [share(rate_hz, baud) for baud in BAUDS]
        cells = ["–" if part is None else f"{100 * part:.1f} %" for part in parts]
        lines.append(f"| {rate_hz:g} | {bits / 1000:.1f} | {most / 1000:.1f} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
