"""The sensor's self-test, and the serial number that the chip's unique id gives."""

from __future__ import annotations

import ctypes
import zlib

import numpy as np
import pytest
from driver_under_test import (
    HANGS,
    NONE,
    fail_behind,
    library,
    number,
    registers,
    started,
)


class SelfTest(ctypes.Structure):
    _fields_ = (("failed", ctypes.c_uint16), ("gyro_dps", ctypes.c_float * 3), ("accel_mg", ctypes.c_float * 3))


@pytest.mark.parametrize(
    ("pushed", "failed"),
    [(0, 0x3F), (2, 0x3F), (3, 0x07), (8, 0x07), (9, 0), (39, 0), (40, 0x07), (54, 0x07), (55, 0x3F), (127, 0x3F)],
)
def test_the_limits_of_the_self_test(pushed, failed):
    """In steps of 256 LSB: 2142 to 10000 LSB of the gyroscope, 737 to 13934 of the accelerometer."""
    lib = started()
    number("pushed").value = pushed
    tested = SelfTest()
    lib.self_test(ctypes.byref(tested))
    assert tested.failed == failed
    assert list(tested.gyro_dps) == pytest.approx([pushed * 256 * 0.070] * 3)
    assert list(tested.accel_mg) == pytest.approx([pushed * 256 * 0.122] * 3)
    assert registers()[0x14] == 0  # switched off again
    assert not lib.running()
    assert lib.start() == NONE


def test_a_self_test_of_nobody_fails():
    lib = started()
    fail_behind(HANGS)
    tested = SelfTest()
    lib.self_test(ctypes.byref(tested))
    assert tested.failed == 0x8000


def test_the_serial_number_is_the_crc_of_the_chips_id_and_never_0():
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(100):
        words = rng.integers(0, 2**32, 3, np.uint32)
        (ctypes.c_uint32 * 3).in_dll(library(), "unique_id")[:] = words.tolist()
        assert library().identity_serial() == zlib.crc32(words.astype("<u4").tobytes())
        seen.add(library().identity_serial())
    assert len(seen) == 100
    # The one id of its first two words whose CRC would be 0.
    (ctypes.c_uint32 * 3).in_dll(library(), "unique_id")[:] = [0, 0, crc_to_zero(bytes(8))]
    assert zlib.crc32(bytes(8) + crc_to_zero(bytes(8)).to_bytes(4, "little")) == 0
    assert library().identity_serial() == 1


def crc_to_zero(head: bytes) -> int:
    """The four bytes, little-endian, that make the CRC-32 of head and them 0: the register is driven to all ones, backwards."""
    wanted = 0xFFFFFFFF
    for _ in range(32):
        wanted = ((wanted ^ 0xEDB88320) << 1 | 1) & 0xFFFFFFFF if wanted >> 31 else wanted << 1
    return wanted ^ (zlib.crc32(head) ^ 0xFFFFFFFF)
