"""The sensor's driver against an array of registers: how it starts, what it does when the bus or the sensor fails, how long it waits."""

from __future__ import annotations

import ctypes
import zlib

import numpy as np
import pytest
from driver_under_test import (
    ANSWERS,
    BUSY_FOR_EVER,
    FAULTS,
    HANGS,
    NONE,
    ONES,
    TEMPERATURE,
    ZEROS,
    accesses,
    discard,
    faults,
    keep_fine,
    library,
    number,
    poll,
    push,
    registers,
    registers_of,
    started,
    tag,
    words_of,
)

#: 1667 Hz in ticks
PERIOD = 4 * 40000 / 6667
CTRL1_XL, CTRL2_G, CTRL3_C, CTRL4_C, CTRL6_C, CTRL8_XL, CTRL9_XL, CTRL10_C = 0x10, 0x11, 0x12, 0x13, 0x15, 0x17, 0x18, 0x19
FIFO_CTRL1, FIFO_CTRL2, FIFO_CTRL3, FIFO_CTRL4, INT1_CTRL = 0x07, 0x08, 0x09, 0x0A, 0x0D
WHO_AM_I, FREQ_FINE = 0x0F, 0x63
#: microseconds: the longest that a start may take, filters and all
LONGEST_START_US = 2_500_000


def slots(first: int, count: int) -> np.ndarray:
    numbers = np.arange(first, first + count)
    return words_of(numbers, np.floor(100.5 + numbers * PERIOD).astype(np.int64))


def streamed(first: int, count: int, polls: int = 20) -> np.ndarray:
    push(slots(first, count))
    return poll(polls)


def test_the_start_in_its_order():
    """Identity, both sensors off, reset; all set before the sensors are on; FREQ_FINE behind that; the FIFO last."""
    started(odr=8, lpf1=3, lpf2=20, fine=-5)
    said = accesses()
    writes = [entry for entry in said if not entry[0] & 0x80]
    assert said[0][0] == 0x80 | WHO_AM_I
    assert writes[:3] == [(CTRL1_XL, 0), (CTRL2_G, 0), (CTRL3_C, 0x05)]
    assert writes[-1] == (FIFO_CTRL4, 0x66)  # continuous; temperature at 12.5 Hz; a stamp for each slot
    assert (FIFO_CTRL4, 0) in writes[3:-1]  # emptied before
    on = said.index((CTRL2_G, 0x84))
    fine = said.index((0x80 | FREQ_FINE, 0))
    assert said.index((CTRL1_XL, 0x8A)) < fine > on
    assert fine < said.index((FIFO_CTRL4, 0x66))
    assert library().freq_fine() == -5
    kept = registers()
    assert kept[CTRL3_C] == 0x44  # block data update, addresses that count up
    assert kept[CTRL4_C] == 0x06  # LPF1, no I2C
    assert (kept[CTRL6_C], kept[CTRL8_XL], kept[CTRL9_XL], kept[CTRL10_C]) == (3, 2 << 5, 0xE2, 0x20)
    assert (kept[FIFO_CTRL3], kept[INT1_CTRL], kept[FIFO_CTRL2]) == (0x88, 0x08, 0)
    assert not faults()
    assert not number("selected").value


@pytest.mark.parametrize(("dps", "code"), [(125, 2), (250, 0), (500, 4), (1000, 8), (2000, 12), (4000, 1)])
@pytest.mark.parametrize(("g", "bits"), [(2, 0), (16, 1), (4, 2), (8, 3)])
def test_ranges_and_rates_in_their_registers(dps, code, g, bits):
    for odr in range(1, 11):
        started(odr=odr, gyro_fs_dps=dps, accel_fs_g=g)
        assert (registers()[CTRL1_XL], registers()[CTRL2_G]) == (odr << 4 | bits << 2, odr << 4 | code)
        assert registers()[FIFO_CTRL3] == odr << 4 | odr
        assert registers()[FIFO_CTRL1] == 3 * min(16, max(1, int((12.5, 26, 52, 104, 208, 417, 833, 1667, 3333, 6667)[odr - 1] / 100)))


@pytest.mark.parametrize(("divisor", "code"), [(4, 0), (10, 1), (20, 2), (45, 3), (100, 4), (200, 5), (400, 6), (800, 7)])
def test_the_accelerometers_second_filter(divisor, code):
    started(lpf2=divisor)
    assert registers()[CTRL1_XL] & 2
    assert registers()[CTRL8_XL] == code << 5


@pytest.mark.parametrize(
    "settings",
    [(300, 4, 8, 255, 2), (500, 6, 8, 255, 2), (500, 4, 0, 255, 2), (500, 4, 11, 255, 2), (500, 4, 8, 8, 2), (500, 4, 8, 255, 3)],
)
def test_settings_that_no_sensor_has(settings):
    assert library().possible(500, 4, 8, 0, 2)
    assert not library().possible(*settings)


def test_samples_come_through_and_none_is_lost():
    """In bursts that go on by themselves, with the temperature of the register until the FIFO has one."""
    started()
    number("warmth", ctypes.c_uint8).value = 1
    assert library().start() == NONE
    number("busy_polls").value = 2
    count, found = 20_000, []
    warm = np.array([[tag(TEMPERATURE, 10_000), 0x00, 0x02, 0, 0, 0, 0]], np.uint8)
    for first in range(0, count, 10):
        push(slots(first, 10) if first != 10_000 else np.concatenate([warm, slots(first, 10)]))
        found.append(poll(6))
    found = np.concatenate([*found, poll(20)])
    held = count - len(found)
    assert 1 <= held <= 17  # the last slot, and what is below the watermark
    assert not faults()
    np.testing.assert_array_equal(np.diff(found["number"].astype(int)), 1)
    np.testing.assert_array_equal(found["registers"][:, :6], registers_of(np.arange(len(found))))
    np.testing.assert_array_equal(found["registers"][:, 6], np.where(np.arange(len(found)) < 10_000, 256, 512))


@pytest.mark.parametrize("fine", [-128, -1, 0, 35, 127])
def test_the_rate_that_the_stamps_show_is_the_sensors(fine):
    started(fine=fine)
    found = np.concatenate([streamed(first, 1000, polls=40) for first in range(0, 20_000, 1000)])
    (passed_us,) = np.diff(found["t_us"][[0, -1]])  # of 32 bits, which wrap
    rate_hz = 1e6 * (len(found) - 1) / passed_us
    assert rate_hz == pytest.approx(6667 * (1 + 0.0015 * fine) / 4, rel=10e-6)


def fail_behind(behaviour: int) -> None:
    number("behaviour").value = behaviour


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
    waited_ms = 0
    while not library().running():
        waited_ms += 1
        assert len(poll(1)) == 0
        assert waited_ms < 10
    ran_over = 100 + int((now_us.value - began_us) * 1667e-6)
    discard()
    after = np.concatenate([streamed(first, 100) for first in range(ran_over, ran_over + 500, 100)])
    assert len(after) >= 480
    both = np.concatenate([before, after])
    np.testing.assert_array_equal(both["registers"][:, :6], registers_of(both["number"] - both["number"][0]))
    times_us = (both["number"] - both["number"][0]) * PERIOD * 25
    np.testing.assert_allclose(both["t_us"] - both["t_us"][0], times_us, atol=26)
    assert faults() == {name: 1, "lost": int(after["number"][0] - before["number"][-1]) - 1}


def test_a_sensor_that_was_away_with_its_bus_is_started_again():
    """Its registers are not as they were: nothing of it counts before it was set, and its time goes on by the board's clock."""
    started()
    now_us = number("now_us", ctypes.c_uint32)
    before, began_us = streamed(0, 100), now_us.value
    fail_behind(ONES)
    poll(300)
    library().reset_registers()
    fail_behind(ANSWERS)
    poll(10)
    assert library().running()
    after, passed_us = streamed(0, 100), now_us.value - began_us
    assert faults().keys() == {"ones", "reset", "starts", "lost"}
    np.testing.assert_array_equal(after["registers"][:, :6], registers_of(np.arange(len(after))))
    step_us = int(after["t_us"][0] - before["t_us"][-1])
    assert step_us == pytest.approx(passed_us, abs=150_000)  # samples are pushed at once, and were made by and by
    assert int(after["number"][0] - before["number"][-1]) == pytest.approx(step_us * 1667e-6, abs=1)


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
    assert len(streamed(0, 100)) >= 80


@pytest.mark.parametrize(("register", "value"), [(CTRL2_G, 0x8C), (CTRL1_XL, 0x84), (CTRL6_C, 3), (CTRL10_C, 0)])
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


def test_another_chip_in_its_place():
    started()
    registers()[WHO_AM_I] = 0x6C
    assert len(streamed(0, 100)) == 0
    assert faults()["identity"] == 1
    assert not library().running()


def test_a_sensor_that_falls_silent_is_started_again():
    started()
    streamed(0, 100)
    assert len(poll(60)) == 0
    assert faults() == {"silent": 1, "starts": 1}
    assert len(streamed(0, 100)) > 80


def test_tags_that_there_are_none_of():
    """Of a burst with two of them no word counts, nor where one is so near its end that the bytes may have slipped."""
    started()
    streamed(0, 30)
    for bad, first in (((20, 21), 30), ((20, 60), 60), ((87,), 90), ((89,), 120)):
        words = slots(first, 30)
        words[list(bad), 0] = tag(9, 2)
        push(words)
        assert len(poll(5)) == 0
    assert faults() == {"tag": 4, "silent": 1, "starts": 1}


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


def test_a_time_that_begins_anew_restarts_the_sensor():
    started()
    streamed(5000, 100)
    rest = streamed(0, 20, polls=8)
    assert set(rest["registers"][:, 0]) <= set(registers_of(np.arange(5080, 5100))[:, 0])
    assert faults()["stamp"] >= 4
    assert faults()["starts"] == 1


@pytest.mark.parametrize("behaviour", [HANGS, BUSY_FOR_EVER, ZEROS, ONES])
def test_no_wait_is_without_a_bound(behaviour):
    lib = library()
    lib.attach(500, 4, 1, 0xFF, 800)
    fail_behind(behaviour)
    assert lib.start() == FAULTS.index({HANGS: "hang", BUSY_FOR_EVER: "hang", ZEROS: "zeros", ONES: "ones"}[behaviour])
    assert number("now_us", ctypes.c_uint32).value < LONGEST_START_US
    assert number("transfers", ctypes.c_uint32).value < 100_000
    fail_behind(ANSWERS)
    assert lib.start() == NONE
    assert number("now_us", ctypes.c_uint32).value < 2 * LONGEST_START_US


class SelfTest(ctypes.Structure):
    _fields_ = (("failed", ctypes.c_uint16), ("gyro_dps", ctypes.c_float * 3), ("accel_mg", ctypes.c_float * 3))


@pytest.mark.parametrize(("pushed", "failed"), [(20, 0), (0, 0x3F), (127, 0x3F)])
def test_the_self_test_weighs_the_change(pushed, failed):
    """20 x 256 LSB are 358 dps and 625 mg: within the limits; none, or 2276 dps and 3966 mg, are not."""
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
