"""What the driver takes at most, of time above all; and settings that a sensor does not take, or has not."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from driver_under_test import (
    ANSWERS,
    ASM330LHH,
    BUSY_FOR_EVER,
    CTRL2_G,
    CTRL3_C,
    FAILS_LATE,
    FAULTS,
    FREQ_FINE,
    HANGS,
    LSM6DSO,
    NONE,
    ONES,
    ZEROS,
    accessed_us,
    accesses,
    attached,
    discard,
    fail_behind,
    faults,
    library,
    number,
    poll,
    push,
    registers,
    slots,
    started,
    streamed_by_time,
    warmth,
)

CHANGED, IMPOSSIBLE = FAULTS.index("changed"), NONE + 1
#: microseconds: a poll on a bus of 1.6 MHz, a byte each 5; a start that blocks; no call of its own waits
LONGEST_POLL_US, SLOW_BYTE_US, LONGEST_START_US = 5000, 5, 300_000


#: bits with a meaning, by the maker's headers: of the ASM330LHH, and of the LSM6DSO where they differ; COUNTER_BDR_REG1 without one
KNOWN = {0x07: 0xFF, 0x08: 0x91, 0x09: 0xFF, 0x0A: 0xF7, 0x0B: 0xA3, 0x0C: 0xFF, 0x0D: 0xFF, 0x0E: 0xFF, 0x10: 0xFE, 0x11: 0xFF}
KNOWN |= {0x12: 0xFD, 0x13: 0x6E, 0x14: 0x6F, 0x15: 0xEF, 0x16: 0x72, 0x17: 0xFD, 0x18: 0xFE, 0x19: 0x20}
DIFFERS = {0x08: 0xD7, 0x0B: 0xA7, 0x11: 0xFE, 0x14: 0xEF, 0x15: 0xFF, 0x16: 0xF7, 0x17: 0xFF}


@pytest.mark.parametrize("register", KNOWN)
@pytest.mark.parametrize("who", [ASM330LHH, LSM6DSO])
def test_each_bit_that_makes_up_a_sample_is_proved_at_the_start(register, who):
    """FIFO_CTRL1 to CTRL10_C.  What is reserved may read as it likes."""
    lib = started(who=who, settles=False)
    number("turned", ctypes.c_uint8).value = register
    for bit in range(8):
        number("turned_bits", ctypes.c_uint8).value = 1 << bit
        known = (KNOWN | (DIFFERS if who == LSM6DSO else {}))[register] >> bit & 1
        assert (lib.start() == NONE) == (not known)


@pytest.mark.parametrize("odr", [0, 11, 200, 255])
def test_a_rate_that_there_is_none_of_is_refused_before_any_transfer(odr):
    lib = attached(odr)
    assert lib.start() == IMPOSSIBLE
    poll(500)
    assert (accesses(), faults(), lib.running(), lib.starting()) == ([], {}, 0, 0)
    lib.restart(500, 4, 8, 0xFF, 2)
    poll(30)
    assert lib.running()


def test_4000_dps_are_the_asm330lhhs():
    assert attached(gyro_fs_dps=4000).start() == NONE
    lib = attached(gyro_fs_dps=4000, who=LSM6DSO)
    assert lib.start() == IMPOSSIBLE
    assert registers()[CTRL2_G] == 0  # never switched on
    poll(500)
    assert (faults(), lib.running()) == ({}, 0)
    lib.restart(2000, 4, 8, 0xFF, 2)
    poll(30)
    assert (registers()[CTRL2_G], lib.running()) == (0x8C, 1)


def test_the_gyroscope_is_off_for_10_ms_before_it_is_on_again():
    started(settles=False)
    for restart in (library().start, lambda: (library().reset_registers(), poll(150))):
        number("logged", ctypes.c_uint32).value = 0
        restart()
        written = [(access, t_us) for access, t_us in zip(accesses(), accessed_us(), strict=True) if access[0] == CTRL2_G]
        (off, off_us), (on, on_us) = written
        assert (off, on) == ((CTRL2_G, 0x00), (CTRL2_G, 0x84))
        assert 10_000 <= on_us - off_us < 15_000


@pytest.mark.parametrize("after_s", [0.005, 0.05, 0.3, 3.0])
def test_a_sensor_that_answers_late_is_found(after_s):
    """Ten tries a second; within 0.1 s of power-up no fault is counted, as every sensor is late then."""
    lib = attached()
    number("wakes_us", ctypes.c_uint32).value = int(1e6 * after_s)
    while not lib.running():
        poll(1)
        assert number("now_us", ctypes.c_uint32).value < 1e6 * after_s + 130_000
    assert faults() == ({"zeros": 1} if after_s > 0.1 else {})


@pytest.mark.parametrize("behaviour", [HANGS, BUSY_FOR_EVER, ZEROS, ONES])
def test_no_start_is_without_an_end(behaviour):
    lib = attached(1, lpf2=800)
    fail_behind(behaviour)
    assert lib.start() == FAULTS.index({HANGS: "hang", BUSY_FOR_EVER: "hang", ZEROS: "zeros", ONES: "ones"}[behaviour])
    assert number("now_us", ctypes.c_uint32).value < LONGEST_START_US
    fail_behind(ANSWERS)
    assert lib.start() == NONE
    assert number("now_us", ctypes.c_uint32).value < 2 * LONGEST_START_US


@pytest.mark.parametrize("behaviour", [ANSWERS, HANGS, BUSY_FOR_EVER, ZEROS, ONES, FAILS_LATE])
@pytest.mark.parametrize("spins", [0, 3])
def test_no_poll_takes_more_than_5_ms_and_none_waits(behaviour, spins):
    """Whatever it is in the midst of when the bus fails: each step of a start, a burst, a search; and when it is back."""
    for fails_ms in range(0, 160, 3):
        attached()
        number("byte_us", ctypes.c_uint32).value = SLOW_BYTE_US
        number("busy_polls").value = spins
        place = 0
        for ms in range(0, 220, 6):
            if ms >= fails_ms and number("behaviour").value == ANSWERS:
                fail_behind(behaviour)
            if ms >= fails_ms + 30:
                fail_behind(ANSWERS)
            streamed_by_time(place, 10)
            place += 10
        assert number("longest_us", ctypes.c_uint32).value <= LONGEST_POLL_US
        assert number("waits", ctypes.c_uint32).value == 0


def test_a_reset_that_does_not_end_is_said():
    lib = attached()
    number("turned", ctypes.c_uint8).value, number("turned_bits", ctypes.c_uint8).value = CTRL3_C, 0x01
    assert lib.start() == FAULTS.index("reset")
    assert 100_000 < number("now_us", ctypes.c_uint32).value < LONGEST_START_US
    assert faults() == {"reset": 1}


def test_a_freq_fine_that_was_misread_is_no_start():
    """It is read on either side of the registers, and would be in every stamp."""
    lib = attached()
    assert lib.start() == NONE
    first_us, second_us = (t_us for access, t_us in zip(accesses(), accessed_us(), strict=True) if access[0] == 0x80 | FREQ_FINE)
    attached()
    number("turned", ctypes.c_uint8).value, number("turned_bits", ctypes.c_uint8).value = FREQ_FINE, 0x10
    number("turned_until_us", ctypes.c_uint32).value = (first_us + second_us) // 2
    assert lib.start() == CHANGED
    assert lib.start() == NONE


def test_a_backlog_is_as_old_as_the_fifo_is_deep():
    """The first sample's time: 137 slots of a FIFO that was not read since the start, in bursts of 96 words, and five more each poll."""
    started(settles=False)
    number("byte_us", ctypes.c_uint32).value = 1
    read_us = number("now_us", ctypes.c_uint32).value
    push(np.concatenate([slots(0, 1), warmth(1), slots(1, 136)]))
    found, later = [], slots(137, 20)
    for words in np.split(later, 12):
        found.append(poll(1))
        push(words)
    first = np.concatenate(found)[0]
    age_us = (137 - (int(first["registers"][0]) + 15_000)) * 600
    assert int(first["t_us"]) == pytest.approx(read_us - age_us, abs=1200)


@pytest.mark.parametrize("held_ms", [20, 100, 700])
@pytest.mark.parametrize("behind", [0, 350, 840])
def test_a_core_that_is_held_amid_a_look_at_the_level_restarts_no_sound_sensor(held_ms, behind):
    """What the look says is of an unknown time: it ends no window of the rate, and no words is no silence.  The FIFO holds 87 ms."""
    started()
    found = [streamed_by_time(0, 1600 + behind)]
    number("held_us", ctypes.c_uint32).value = 1000 * held_ms
    found.append(poll(1))
    place = 1600 + behind
    lost = max(0, int(held_ms * 1.667) - 140)
    if lost:
        discard()
        number("overrun").value = 1
    place += lost
    for begin in range(place, place + int(held_ms * 1.667) - lost, 10):
        push(slots(begin, 10))
        place = begin + 10
    found += [poll(6), streamed_by_time(place, 3400)]
    assert not {"rate", "starts", "silent", "stamp"} & faults().keys()
    assert (faults().get("lost", 0) > 0) == (lost > 0)


@pytest.mark.parametrize("away_ms", [500, 3000])
def test_behind_an_absence_samples_wait_for_a_temperature_and_are_counted(away_ms):
    """The one of before is older than a second: no sample has it."""
    started()
    push(np.concatenate([warmth(0, 111), slots(0, 10)]))
    poll(6)
    before = streamed_by_time(10, 200)
    number("behaviour").value = ONES
    poll(away_ms)
    number("behaviour").value = ANSWERS
    discard()  # the FIFO ran over
    number("overrun").value = 1
    place = 210 + int(away_ms * 1.667)
    behind = [streamed_by_time(place, 60)]
    push(np.concatenate([warmth(place + 60, 222), slots(place + 60, 10)]))
    behind = np.concatenate([*behind, poll(6), streamed_by_time(place + 70, 100)])
    old = np.flatnonzero(behind["registers"][:, 6] != 222)
    assert (len(old) > 30) == (away_ms < 1000)
    everything = np.concatenate([before, behind])
    assert faults()["lost"] == np.sum(np.diff(everything["number"].astype(int)) - 1)
