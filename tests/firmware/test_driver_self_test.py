"""The sensor's self-test, and the serial number that the chip's unique id gives."""

from __future__ import annotations

import ctypes
import zlib

import numpy as np
import pytest
from driver_under_test import (
    ASM330LHH,
    CTRL1_XL,
    CTRL2_G,
    CTRL3_C,
    HANGS,
    LSM6DSO,
    NONE,
    ONES,
    WHO_AM_I,
    ZEROS,
    accessed_us,
    accesses,
    faults,
    library,
    number,
    poll,
    push,
    registers,
    slots,
    started,
)

NOTHING_MEASURED = 0x8000
CTRL5_C = 0x14
#: microseconds: how long it takes, a poll of it on a bus of 1.6 MHz
TAKES_US, LONGEST_POLL_US = 1_350_000, 500
GOOD, BAD = 30, 2  # times 256 LSB


class SelfTest(ctypes.Structure):
    _fields_ = (("failed", ctypes.c_uint16), ("gyro_dps", ctypes.c_float * 3), ("accel_mg", ctypes.c_float * 3))


def self_tested(by_steps: bool = True) -> SelfTest:
    result = SelfTest()
    (library().self_test_by_steps if by_steps else library().self_test)(ctypes.byref(result))
    return result


@pytest.mark.parametrize(
    ("pushed", "failed"),
    [(0, 0x3F), (2, 0x3F), (3, 0x07), (8, 0x07), (9, 0), (39, 0), (40, 0x07), (54, 0x07), (55, 0x3F), (127, 0x3F)],
)
@pytest.mark.parametrize("who", [ASM330LHH, LSM6DSO])
def test_the_limits_of_the_self_test(pushed, failed, who):
    """In steps of 256 LSB: 2142 to 10000 LSB of the gyroscope, 737 to 13934 of the accelerometer."""
    lib = started(who=who, settles=False)
    number("pushed").value = pushed
    for by_steps in (True, False):
        found = self_tested(by_steps)
        assert found.failed == failed
        assert list(found.gyro_dps) == pytest.approx([pushed * 256 * 0.070] * 3)
        assert list(found.accel_mg) == pytest.approx([pushed * 256 * 0.122] * 3)
        assert [registers()[address] for address in (CTRL1_XL, CTRL2_G, CTRL5_C)] == [0, 0, 0]  # switched off again
        assert not lib.running()
    assert lib.start() == NONE
    assert not faults()


def test_it_takes_its_time_in_steps():
    """150 ms behind the reset, 100 ms behind each switch; no step waits for what comes next."""
    started(settles=False)
    number("pushed").value = GOOD
    number("byte_us", ctypes.c_uint32).value = 5
    waits = number("waits", ctypes.c_uint32).value
    number("longest_us", ctypes.c_uint32).value = number("logged", ctypes.c_uint32).value = 0
    began_us = number("now_us", ctypes.c_uint32).value
    assert self_tested().failed == 0
    assert number("now_us", ctypes.c_uint32).value - began_us < TAKES_US
    assert number("longest_us", ctypes.c_uint32).value < LONGEST_POLL_US
    assert number("waits", ctypes.c_uint32).value == waits
    log = list(zip(accesses(), accessed_us(), strict=True))
    reset_us = next(t_us for access, t_us in log if access == (CTRL3_C, 0x05))
    on_us = next(t_us for access, t_us in log if access[0] == CTRL2_G and access[1])
    assert on_us - reset_us >= 150_000
    switched = [t_us for access, t_us in log if access[0] in (CTRL1_XL, CTRL2_G, CTRL5_C) and t_us >= on_us]
    read = [t_us for access, t_us in log if access[0] == 0x80 | WHO_AM_I and t_us > switched[0]]
    assert all(not any(t_us < first_us < t_us + 100_000 for first_us in read) for t_us in switched[:-3])


@pytest.mark.parametrize("pushed", [GOOD, BAD])
@pytest.mark.parametrize("behaviour", [ZEROS, ONES, HANGS])
@pytest.mark.parametrize("lasts_us", [20, 300, 40_000])
def test_a_line_that_sticks_never_fails_a_good_part_nor_passes_a_bad_one(pushed, behaviour, lasts_us):
    """At any moment of the procedure: then nothing was measured."""
    outcomes = set()
    for from_us in moments(lasts_us):
        started(settles=False)
        number("pushed").value = pushed
        begin_us = number("now_us", ctypes.c_uint32).value
        number("line").value = behaviour
        number("line_from_us", ctypes.c_uint32).value = begin_us + from_us
        number("line_until_us", ctypes.c_uint32).value = begin_us + from_us + lasts_us
        outcomes.add(self_tested().failed)
    assert outcomes <= {NOTHING_MEASURED, 0 if pushed == GOOD else 0x3F}
    assert NOTHING_MEASURED in outcomes


def moments(lasts_us: int) -> np.ndarray:
    """Where something goes over the line, mostly."""
    started(settles=False)
    number("pushed").value = GOOD
    number("logged", ctypes.c_uint32).value = 0
    begin_us = number("now_us", ctypes.c_uint32).value
    assert self_tested().failed == 0
    busy_us = np.array(accessed_us()) - begin_us
    rng = np.random.default_rng(lasts_us)
    return np.maximum(0, rng.choice(busy_us, 2000) + rng.integers(-min(lasts_us, 300), 70, 2000)).astype(int)


@pytest.mark.parametrize("register", [CTRL1_XL, CTRL2_G, CTRL3_C, CTRL5_C])
def test_a_register_that_does_not_take_it_is_nothing_measured(register):
    """Neither a range or a rate, nor the force."""
    started(settles=False)
    number("pushed").value = GOOD
    number("stuck", ctypes.c_uint8).value = register
    found = self_tested()
    assert found.failed == NOTHING_MEASURED
    assert not any([*found.gyro_dps, *found.accel_mg])


def test_a_part_that_does_not_lie_still_is_nothing_measured():
    """300 LSB of the gyroscope, 21 dps, from one output to the next."""
    started(settles=False)
    number("pushed").value = GOOD
    for lsb, failed in ((200, 0), (300, NOTHING_MEASURED)):
        number("shaken").value = lsb
        assert self_tested().failed == failed


@pytest.mark.parametrize("dps_per_s2", [-900, -800, -500, -300, -100, 100, 300, 500, 800, 900])
@pytest.mark.parametrize("pushed", [6, 9, 12])
def test_a_table_that_accelerates_is_nothing_measured(dps_per_s2, pushed):
    """A force of 108, 161 and 215 dps: the turn would pass the first for a good one, or fail the others."""
    started(settles=False)
    number("pushed").value = pushed
    number("ramp").value = round(dps_per_s2 / 0.070)
    begin_at_rest()
    assert self_tested().failed == NOTHING_MEASURED


def begin_at_rest() -> None:
    """The table's rate is that of the fake's time: it begins anew, so that it stays within 16 bits."""
    number("now_us", ctypes.c_uint32).value = 0


@pytest.mark.parametrize("dps_per_s2", [-60, -20, 20, 60])
@pytest.mark.parametrize(("pushed", "failed"), [(8, 0x07), (9, 0), (39, 0), (40, 0x07)])
def test_a_slow_acceleration_changes_no_verdict(dps_per_s2, pushed, failed):
    """The force's change is against what is measured on either side of it: a turn that grows evenly leaves it as it is."""
    started(settles=False)
    number("pushed").value = pushed
    number("ramp").value = round(dps_per_s2 / 0.070)
    begin_at_rest()
    found = self_tested()
    assert found.failed == failed
    assert list(found.gyro_dps) == pytest.approx([pushed * 256 * 0.070] * 3, abs=0.3)


def test_a_burst_that_is_on_its_way_is_ended_first():
    started()
    number("pushed").value = GOOD
    number("busy_polls").value = 3
    push(slots(0, 20))
    poll(1)
    assert self_tested().failed == 0


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
