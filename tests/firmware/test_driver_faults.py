"""What the sensor's driver does when the bus or the sensor fails."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from driver_under_test import (
    ANSWERS,
    ASM330LHH,
    BUSY_FOR_EVER,
    CTRL1_XL,
    CTRL2_G,
    CTRL3_C,
    CTRL6_C,
    CTRL10_C,
    FIFO_CTRL1,
    FIFO_CTRL3,
    FIFO_CTRL4,
    HANGS,
    LSM6DSO,
    ONES,
    PERIOD,
    WHO_AM_I,
    ZEROS,
    accessed_us,
    accesses,
    attached,
    discard,
    fail_behind,
    faults,
    keep_fine,
    library,
    number,
    poll,
    push,
    registers,
    registers_of,
    settle,
    slots,
    started,
    streamed,
    streamed_by_time,
    tag,
    warmth,
)


def test_a_fifo_that_ran_over_is_counted_once_and_the_gap_is_numbered():
    started()
    before = streamed(0, 64)
    number("overrun").value = 1
    number("now_us", ctypes.c_uint32).value += 600_000
    after = streamed(1000, 64)
    assert faults()["overrun"] == 1
    assert faults().get("order", 0) == faults().get("incomplete", 0) == 0
    np.testing.assert_array_equal(after["registers"][:, :6], registers_of(after["number"] - before["number"][0]))
    assert faults()["lost"] == 1000 - len(before)


@pytest.mark.parametrize(
    ("name", "behaviour"),
    [("hang", HANGS), ("hang", BUSY_FOR_EVER), ("zeros", ZEROS), ("ones", ONES)],
    ids=["hangs", "busy", "zeros", "ones"],
)
def test_a_bus_that_fails_is_counted_once_and_survived(name, behaviour):
    """For two seconds, amid samples.  The sensor has gone on, as its registers show: it is not started again, and each sample behind
    the gap has the number and the time that it would have had."""
    started()
    now_us = number("now_us", ctypes.c_uint32)
    before, began_us = streamed(0, 100), now_us.value
    push(slots(100, 50))
    fail_behind(behaviour)
    assert len(poll(2000)) == 0
    assert not library().running()
    assert faults() == {name: 1}
    fail_behind(ANSWERS)
    number("overrun").value = 1  # which goes without saying
    waited_ms = 0
    while not library().running():
        waited_ms += 1
        assert len(poll(1)) == 0
        assert waited_ms < 10
    ran_over = 100 + int((now_us.value - began_us) * 1667e-6)
    discard()
    push(np.concatenate([slots(ran_over, 1), warmth(ran_over + 1)]))  # the one of before is too old
    after = np.concatenate([streamed(first, 100) for first in range(ran_over + 1, ran_over + 500, 100)])
    assert len(after) >= 480
    both = np.concatenate([before, after])
    np.testing.assert_array_equal(both["registers"][:, :6], registers_of(both["number"] - both["number"][0]))
    times_us = (both["number"] - both["number"][0]) * PERIOD * 25
    np.testing.assert_allclose(both["t_us"] - both["t_us"][0], times_us, atol=26)
    assert faults() == {name: 1, "lost": int(after["number"][0] - before["number"][-1]) - 1}


@pytest.mark.parametrize("into", range(1, 60))
def test_a_bus_that_dies_within_a_burst_makes_no_sample(into):
    """Zeros from some word on, the second half of a word among them: the burst does not count, nor what was begun."""
    started()
    before = streamed(0, 64)
    number("breaks_after", ctypes.c_uint32).value = number("words_out", ctypes.c_uint32).value + into
    assert len(streamed(64, 20)) == 0
    assert faults()["zeros"] == 1
    np.testing.assert_array_equal(before["registers"][:, :6], registers_of(np.arange(len(before))))


def test_a_sensor_that_resets_itself():
    started(fine=9)
    streamed(0, 100)
    library().reset_registers()
    keep_fine(12)
    assert len(poll(40)) == 0
    assert library().running()
    assert (registers()[CTRL2_G], library().freq_fine()) == (0x84, 12)
    assert faults()["reset"] == 1
    assert faults()["starts"] == 1
    settle(fine=12)
    assert len(streamed(0, 100)) >= 80


@pytest.mark.parametrize(
    ("register", "value"), [(CTRL2_G, 0x8C), (CTRL1_XL, 0x84), (CTRL6_C, 3), (CTRL10_C, 0), (FIFO_CTRL3, 0x78), (FIFO_CTRL4, 0x26)]
)
def test_a_register_that_changed_spoils_the_burst_before_it(register, value):
    """No sample counts at a range that is not the one that was set."""
    started()
    streamed(0, 100)
    registers()[register] = value
    assert len(streamed(100, 30, polls=3)) == 0
    assert faults()["changed"] == 1
    poll(300)
    assert library().running()
    assert registers()[register] != value


@pytest.mark.parametrize("who", [0x6A, LSM6DSO])
def test_another_chip_in_its_place(who):
    """Whose registers are as they were set: nobody has set another chip so."""
    started()
    registers()[WHO_AM_I] = who
    assert len(streamed(0, 100)) == 0
    assert faults() == {"identity": 1}
    assert not library().running()
    registers()[WHO_AM_I] = ASM330LHH
    poll(10)
    assert library().running()


@pytest.mark.parametrize("lasts_ms", [300, 2000])
@pytest.mark.parametrize("behaviour", [ZEROS, ONES])
def test_a_line_that_sticks_while_writes_arrive_restarts_no_sensor(behaviour, lasts_ms):
    """What is written meanwhile, ten times a second, is what CTRL3_C holds anyhow."""
    started()
    streamed(0, 100)
    number("logged", ctypes.c_uint32).value = 0
    number("line").value = behaviour
    number("line_from_us", ctypes.c_uint32).value = number("now_us", ctypes.c_uint32).value
    number("line_until_us", ctypes.c_uint32).value = number("now_us", ctypes.c_uint32).value + 1000 * lasts_ms
    poll(lasts_ms)
    written = [access for access in accesses() if not access[0] & 0x80]
    assert written == [(CTRL3_C, 0x44)] * len(written)
    assert 2 <= len(written) <= lasts_ms / 100
    poll(5)
    assert library().running()
    discard()
    streamed(100 + round(1.667 * lasts_ms), 100)
    assert "starts" not in faults()


@pytest.mark.parametrize("behaviour", [ZEROS, ONES])
def test_a_line_that_comes_back_amid_the_registers_restarts_no_sensor(behaviour):
    """Half of them read wrong, as if they had changed: they are read once more."""
    look_us = 0
    for until_us in (1 << 20, *range(2, 46, 2)):
        started()
        streamed(0, 100)
        number("logged", ctypes.c_uint32).value = 0
        began_us = number("now_us", ctypes.c_uint32).value
        number("line").value = behaviour
        number("line_from_us", ctypes.c_uint32).value = began_us
        number("line_until_us", ctypes.c_uint32).value = began_us + look_us + until_us
        poll(30)
        if not look_us:
            look_us = accessed_us()[8] - began_us
            assert accesses()[8] == (0x80 | FIFO_CTRL1, 0)
        else:
            assert library().running()
            assert "starts" not in faults()


FIRST, LAST, IF_INC, SIM = 0x07, 0x19, 0x04, 0x08
#: reserved in the ASM330LHH, or they clear themselves: nothing comes of them
RESERVED = {0x08: 0x6E, 0x0A: 0x08, 0x0B: 0x5C, 0x10: 0x01, 0x12: 0x02, 0x13: 0x91, 0x14: 0x90, 0x15: 0x10, 0x16: 0x8D, 0x17: 0x02}
RESERVED |= {0x18: 0x01, 0x19: 0xDF}


@pytest.mark.parametrize("register", [address for address in range(FIRST, LAST + 1) if address != WHO_AM_I])
def test_no_bit_that_flips_ends_the_stream(register):
    """Samples come again within 0.4 s.  Without IF_INC, and with SIM, no register can be read: that is mended without a restart.  A
    reserved bit that flips is none of ours."""
    for bit in (1 << place for place in range(8)):
        started()
        streamed_by_time(0, 100)
        registers()[register] ^= bit
        found, place = [], 100
        while place < 100 + int(0.4 * 1667):
            push(warmth(place))
            found.append(streamed_by_time(place, 10))
            place += 10
        last = np.concatenate(found[-4:])
        assert len(last) > 15
        np.testing.assert_array_equal(last["registers"][:, 3], last["registers"][:, 0] + 15000)
        if RESERVED.get(register, 0) & bit:
            assert len(np.concatenate(found)) > 600
            assert not faults()
        elif register == CTRL3_C and bit in (IF_INC, SIM):
            assert not {"starts", "changed", "rate"} & faults().keys()
            assert registers()[CTRL3_C] == 0x44
        else:
            assert (faults()["changed"], faults()["starts"]) == (1, 1)
        assert library().running()


@pytest.mark.parametrize("bit", [IF_INC, SIM])
def test_a_sensor_that_cannot_be_read_at_a_start_is_found(bit):
    """The board has begun anew, and the sensor has not."""
    lib = attached()
    registers()[CTRL3_C] ^= bit
    while not lib.running():
        poll(1)
        assert number("now_us", ctypes.c_uint32).value < 250_000


def test_a_sensor_that_falls_silent_is_started_again():
    started()
    streamed(0, 100)
    assert len(poll(60)) == 0
    assert faults() == {"silent": 1, "starts": 1}
    poll(25)
    settle()
    assert len(streamed(0, 100)) > 80


@pytest.mark.parametrize("places", [((20, 21), (20, 60), (87,)), ((89,), (88,), (87, 88, 89))])
def test_tags_that_there_are_none_of(places):
    """Of a burst with two of them no word counts, nor where one is so near its end that the bytes may have slipped.  Behind three such
    bursts in a row the sensor is started again."""
    started()
    streamed(0, 30)
    for first, bad in zip((30, 60, 90), places, strict=True):
        assert "silent" not in faults()
        words = slots(first, 30)
        words[list(bad), 0] = tag(9, 2)
        push(words)
        assert len(poll(3)) == 0
    assert faults() == {"tag": 3, "silent": 1, "starts": 1}
    poll(30)
    assert library().running()


@pytest.mark.parametrize("bad", range(3, 84))
def test_one_tag_that_there_is_none_of_costs_its_slot(bad):
    """And that of the word before: a line that stuck for so long may have spoilt its values."""
    started()
    streamed(0, 30)
    words = slots(30, 30)
    words[bad, 0] = tag(9, 2)
    push(words)
    after = np.concatenate([poll(5), streamed(60, 30)])
    gone = {30 + bad // 3, 30 + (bad - 1) // 3}
    np.testing.assert_array_equal(
        after["registers"][:, :6], registers_of(np.setdiff1d(np.arange(29, 29 + len(after) + len(gone)), list(gone)))
    )
    assert faults() == {"tag": 1, "lost": len(gone)}


def test_a_sensor_that_misses_an_address_is_written_nothing():
    """It takes the next byte for one.  A zero there would begin a write of zeros to all its registers."""
    for from_us in range(0, 2500, 7):
        started()
        streamed(0, 30)
        set_up = bytes(registers())[: CTRL10_C + 1]
        number("line").value = HANGS
        number("line_from_us", ctypes.c_uint32).value = number("now_us", ctypes.c_uint32).value + from_us
        number("line_until_us", ctypes.c_uint32).value = number("line_from_us", ctypes.c_uint32).value + 5
        streamed(30, 30, polls=10)
        assert bytes(registers())[: CTRL10_C + 1] == set_up
        assert "starts" not in faults()


@pytest.mark.parametrize("lost", [3, 12, 14, 24, 25])
def test_a_fifo_that_runs_over_amid_a_burst_drops_the_burst(lost):
    """Where a target is held whose transfers wait.  Behind four lost slots TAG_CNT goes on, and a slot would be made of two."""
    for place in range(1, 96):
        started()
        before = streamed(0, 64)
        first = number("words_out", ctypes.c_uint32).value
        push(slots(64, 96))
        number("held_at", ctypes.c_uint32).value, number("lost", ctypes.c_uint32).value = first + place, lost
        after = np.concatenate([poll(9), streamed(160, 64)])
        assert faults()["overrun"] == 1
        assert faults().keys() <= {"overrun", "lost"}
        assert len(after) >= 64 + 96 - 32 - lost // 3 - 3
        np.testing.assert_array_equal(after["registers"][:, :6], registers_of(after["number"] - before["number"][0]))


@pytest.mark.parametrize(("bad", "starts"), [(3, 0), (4, 1)])
def test_four_stamps_in_a_row_that_do_not_go_on_start_the_sensor_again(bad, starts):
    started()
    streamed(0, 64)
    discard()
    words = slots(64, 32)  # a burst, whose last slot is not over yet
    words[3 * (31 - bad) + 2 : 3 * 31 : 3, 4] ^= 0x40
    push(words)
    poll(1)
    push(slots(96, 32))
    poll(20)
    assert faults().get("starts", 0) == starts
    assert faults()["stamp"] == bad + starts  # the start has its reason
