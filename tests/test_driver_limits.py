"""What the driver holds against a limit: registers that did not take what was written, and the sensor's self-test."""

from __future__ import annotations

import ctypes

import pytest
from driver_under_test import FAULTS, NONE, faults, library, number, started

CTRL4_C, CTRL6_C, CTRL8_XL, CTRL9_XL = 0x13, 0x15, 0x17, 0x18
CHANGED = FAULTS.index("changed")


class SelfTest(ctypes.Structure):
    _fields_ = (("failed", ctypes.c_uint16), ("gyro_dps", ctypes.c_float * 3), ("accel_mg", ctypes.c_float * 3))


@pytest.mark.parametrize(
    ("stuck", "lpf1", "lpf2", "fault"),
    [
        (CTRL4_C, 3, 2, CHANGED),  # without LPF1, which was asked for
        (CTRL6_C, 3, 2, CHANGED),  # another LPF1
        (CTRL8_XL, 0xFF, 20, CHANGED),  # another LPF2
        (CTRL6_C, 0xFF, 2, NONE),  # LPF1 is off: which it would be does not matter
        (CTRL8_XL, 0xFF, 4, NONE),  # its code is 0
    ],
)
def test_a_filter_that_was_not_taken_is_no_start(stuck, lpf1, lpf2, fault):
    """Its bandwidth and its delay would be in every sample."""
    started(lpf1=lpf1, lpf2=lpf2)
    number("stuck", ctypes.c_uint8).value = stuck
    assert library().start() == fault
    assert faults().get("changed", 0) == (fault == CHANGED)
    number("stuck", ctypes.c_uint8).value = 0
    assert library().start() == NONE


@pytest.mark.parametrize(
    ("pushed", "failed"),
    [(2, 0x3F), (3, 0x07), (8, 0x07), (9, 0), (39, 0), (40, 0x07), (54, 0x07), (55, 0x3F)],
)
def test_the_limits_of_the_self_test(pushed, failed):
    """In steps of 256 LSB: 2142 to 10000 LSB of the gyroscope, 737 to 13934 of the accelerometer."""
    lib = started()
    number("pushed").value = pushed
    tested = SelfTest()
    lib.self_test(ctypes.byref(tested))
    assert tested.failed == failed
    assert list(tested.gyro_dps) == pytest.approx([pushed * 256 * 0.070] * 3)
    assert lib.start() == NONE
