"""Filters that did not take what was written: the driver does not start with another bandwidth than was asked for."""

from __future__ import annotations

import ctypes

import pytest
from driver_under_test import CTRL4_C, CTRL6_C, CTRL8_XL, FAULTS, NONE, faults, library, number, started

CHANGED = FAULTS.index("changed")


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
