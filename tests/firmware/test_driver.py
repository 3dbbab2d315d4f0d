"""The sensor's driver against an array of registers: start, samples, faults, limits of time, the self-test."""

import ctypes
import itertools
import zlib

import numpy as np
import pytest
from driver_under_test import (
    ACCEL,
    ANSWERS,
    ASM330LHH,
    BUSY_FOR_EVER,
    CTRL1_XL,
    CTRL2_G,
    CTRL3_C,
    CTRL4_C,
    CTRL6_C,
    CTRL8_XL,
    CTRL9_XL,
    CTRL10_C,
    FAILS_LATE,
    FIFO_CTRL1,
    FIFO_CTRL2,
    FIFO_CTRL3,
    FIFO_CTRL4,
    FREQ_FINE,
    GYRO,
    HANGS,
    INT1_CTRL,
    LSM6DSO,
    NONE,
    ONES,
    PERIOD,
    RATES_HZ,
    STAMP,
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
    period_of,
    poll,
    push,
    put,
    registers,
    registers_of,
    settle,
    slots,
    started,
    streamed,
    streamed_by_time,
    tag,
    warmth,
    words_of,
)


def test_the_start_in_its_order():
    """Identity, both sensors off, reset; all set before the sensors are on; FREQ_FINE behind that; the FIFO last."""
    started(lpf1=3, lpf2=20, fine=-5, settles=False)
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
    assert kept[CTRL4_C] == 0x0E  # LPF1, no I2C, no sample but marked ones before they have settled
    assert (kept[CTRL6_C], kept[CTRL8_XL], kept[CTRL9_XL], kept[CTRL10_C]) == (3, 2 << 5, 0xE2, 0x20)
    assert (kept[FIFO_CTRL3], kept[INT1_CTRL], kept[FIFO_CTRL2]) == (0x88, 0x08, 0)
    assert not faults()
    assert not number("selected").value


def test_ranges_and_rates_in_their_registers():
    gyro, accel = ((125, 2), (250, 0), (500, 4), (1000, 8), (2000, 12), (4000, 1)), ((2, 0), (16, 1), (4, 2), (8, 3))
    for place, ((dps, code), (g, bits)) in enumerate(itertools.product(gyro, accel)):
        odr = 1 + place % len(RATES_HZ)
        started(odr=odr, gyro_fs_dps=dps, accel_fs_g=g, settles=False)
        assert (registers()[CTRL1_XL], registers()[CTRL2_G]) == (odr << 4 | bits << 2, odr << 4 | code)
        assert registers()[FIFO_CTRL3] == odr << 4 | odr
        assert registers()[FIFO_CTRL1] == 3 * min(16, max(1, int(RATES_HZ[odr - 1] / 100)))
    for code, divisor in enumerate((4, 10, 20, 45, 100, 200, 400, 800)):
        started(lpf2=divisor, settles=False)
        assert registers()[CTRL1_XL] & 2
        assert registers()[CTRL8_XL] == code << 5


@pytest.mark.parametrize(
    "settings",
    [(300, 4, 8, 255, 2), (500, 6, 8, 255, 2), (500, 4, 0, 255, 2), (500, 4, 11, 255, 2), (500, 4, 8, 8, 2), (500, 4, 8, 255, 3)],
)
def test_settings_that_no_sensor_has(settings):
    for chip in (ASM330LHH, LSM6DSO):
        assert library().possible(chip, 500, 4, 8, 0, 2)
        assert not library().possible(chip, *settings)


def test_samples_come_through_and_none_is_lost():
    """In bursts that go on by themselves, each with the last temperature before it."""
    started()
    put(busy_polls=2)
    count, found = 3000, []
    for first in range(0, count, 10):
        push(slots(first, 10) if first != 1000 else np.concatenate([warmth(1000, 512), slots(first, 10)]))
        found.append(poll(6))
    found = np.concatenate([*found, poll(20)])
    held = count - len(found)
    assert 1 <= held <= 17  # the last slot, and what is below the watermark
    assert not faults()
    np.testing.assert_array_equal(np.diff(found["number"].astype(int)), 1)
    np.testing.assert_array_equal(found["registers"][:, :6], registers_of(np.arange(len(found))))
    np.testing.assert_array_equal(found["registers"][:, 6], np.where(np.arange(len(found)) <= 1000, 0, 512))


def test_no_sample_before_the_fifo_has_brought_a_temperature():
    """Nothing proves what OUT_TEMP reads, so it is never read.  Where none comes for a second, the sensor is started again."""
    started(settles=False)
    assert 0x20 not in {address & 0x7F for address, _ in accesses()}
    assert len(streamed_by_time(0, 400)) == 0
    assert library().has_settled()
    push(np.concatenate([warmth(400, -300), slots(400, 10)]))
    found = np.concatenate([poll(6), streamed_by_time(410, 40)])
    np.testing.assert_array_equal(found["registers"], np.insert(registers_of(np.arange(401, 401 + len(found))), 6, -300, axis=1))
    assert len(found) > 30
    assert not faults()
    started(settles=False)
    streamed_by_time(0, 2800)
    assert faults() == {"rate": 1, "starts": 1}


# Faults.


@pytest.mark.parametrize(
    ("name", "behaviour"),
    [("hang", HANGS), ("hang", BUSY_FOR_EVER), ("zeros", ZEROS), ("ones", ONES)],
    ids=["hangs", "busy", "zeros", "ones"],
)
def test_a_bus_that_fails_is_counted_once_and_survived(name, behaviour):
    """For two seconds, amid samples.  The sensor has gone on, as its registers show: it is not started again, and each sample behind
    the gap has the number and the time that it would have had."""
    started()
    now_us = number("now_us")
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


@pytest.mark.parametrize("into", [1, 2, 3, 20, 59])
def test_a_bus_that_dies_within_a_burst_makes_no_sample(into):
    """Zeros from some word on, the second half of a word among them: the burst does not count, nor what was begun."""
    started()
    before = streamed(0, 64)
    number("breaks_after").value = number("words_out").value + into
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


IF_INC, SIM = 0x04, 0x08  #: of CTRL3_C


#: reserved in the ASM330LHH, or they clear themselves: nothing comes of them
RESERVED = {FIFO_CTRL4: 0x08, CTRL1_XL: 0x01, CTRL3_C: 0x02, CTRL9_XL: 0x01}


@pytest.mark.parametrize("register", [FIFO_CTRL3, FIFO_CTRL4, CTRL1_XL, CTRL3_C, CTRL9_XL])
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


def test_a_sensor_that_cannot_be_read_at_a_start_is_found():
    """The board has begun anew, and the sensor has not."""
    lib = attached()
    registers()[CTRL3_C] ^= IF_INC
    while not lib.running():
        poll(1)
        assert number("now_us").value < 250_000


def test_a_sensor_that_falls_silent_is_started_again():
    started()
    streamed(0, 100)
    assert len(poll(60)) == 0
    assert faults() == {"silent": 1, "starts": 1}
    poll(25)
    settle()
    assert len(streamed(0, 100)) > 80


@pytest.mark.parametrize("bad", [3, 4, 5, 40, 83])
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
    for from_us in range(0, 2500, 61):
        started()
        streamed(0, 30)
        set_up = bytes(registers())[: CTRL10_C + 1]
        put(line=HANGS)
        number("line_from_us").value = number("now_us").value + from_us
        number("line_until_us").value = number("line_from_us").value + 5
        streamed(30, 30, polls=10)
        assert bytes(registers())[: CTRL10_C + 1] == set_up
        assert "starts" not in faults()


@pytest.mark.parametrize("lost", [12, 25])
def test_a_fifo_that_runs_over_amid_a_burst_drops_the_burst(lost):
    """Where a target is held whose transfers wait.  Behind four lost slots TAG_CNT goes on, and a slot would be made of two."""
    for place in range(1, 96, 9):
        started()
        before = streamed(0, 64)
        first = number("words_out").value
        push(slots(64, 96))
        put(held_at=first + place, lost=lost)
        after = np.concatenate([poll(9), streamed(160, 64)])
        assert faults()["overrun"] == 1
        assert faults().keys() <= {"overrun", "lost"}
        assert len(after) >= 64 + 96 - 32 - lost // 3 - 3
        np.testing.assert_array_equal(after["registers"][:, :6], registers_of(after["number"] - before["number"][0]))


# Limits of time, and what a sensor has not.


#: microseconds: a poll on a bus of 1.6 MHz, a byte each 5; a start that blocks; no call of its own waits
LONGEST_POLL_US, SLOW_BYTE_US, LONGEST_START_US = 5000, 5, 300_000


def test_the_gyroscope_is_off_for_10_ms_before_it_is_on_again():
    started(settles=False)
    for restart in (library().start, lambda: (library().reset_registers(), poll(150))):
        put(logged=0)
        restart()
        written = [(access, t_us) for access, t_us in zip(accesses(), accessed_us(), strict=True) if access[0] == CTRL2_G]
        (off, off_us), (on, on_us) = written
        assert (off, on) == ((CTRL2_G, 0x00), (CTRL2_G, 0x84))
        assert 10_000 <= on_us - off_us < 15_000


@pytest.mark.parametrize("after_s", [0.05, 0.3])
def test_a_sensor_that_answers_late_is_found(after_s):
    """Ten tries a second; within 0.1 s of power-up no fault is counted, as every sensor is late then."""
    lib = attached()
    put(wakes_us=int(1e6 * after_s))
    while not lib.running():
        poll(1)
        assert number("now_us").value < 1e6 * after_s + 130_000
    assert faults() == ({"zeros": 1} if after_s > 0.1 else {})


@pytest.mark.parametrize("behaviour", [HANGS, BUSY_FOR_EVER, ONES, FAILS_LATE])
def test_no_poll_takes_more_than_5_ms_and_none_waits(behaviour):
    """Whatever it is in the midst of when the bus fails: each step of a start, a burst, a search; and when it is back."""
    for fails_ms in range(1, 160, 23):
        attached()
        put(byte_us=SLOW_BYTE_US, busy_polls=3)
        place = 0
        for ms in range(0, 220, 6):
            if ms >= fails_ms and number("behaviour").value == ANSWERS:
                fail_behind(behaviour)
            if ms >= fails_ms + 30:
                fail_behind(ANSWERS)
            streamed_by_time(place, 10)
            place += 10
        assert number("longest_us").value <= LONGEST_POLL_US
        assert number("waits").value == 0


# The rate that arrives.


#: samples at 1667 Hz: a window of a second, and a burst
WINDOW = 1700


def kinds(words):
    return words[:, 0] >> 3


def slot_of(words):
    """The slot of each word, counted from the first: three to a slot."""
    return np.arange(len(words)) // 3


def without(kind, each):
    """Of that kind only each so many-th word is batched."""
    return lambda words: words[(kinds(words) != kind) | (slot_of(words) % each == 0)]


def halved(words):
    """Every second slot is batched, and TAG_CNT counts those: five of them in ten slots."""
    kept = words[slot_of(words) % 2 == 0].copy()
    first = int(kept[2, 1:5].copy().view("<u4")[0] / PERIOD) // 2
    kept[:, 0] = [tag(int(kind), first + place // 3) for place, kind in enumerate(kinds(kept))]
    return kept


def one_slot_for_all(words):
    words[:, 0] = [tag(int(kind), 0) for kind in kinds(words)]
    return words


@pytest.mark.parametrize(
    "change",
    [without(GYRO, 2), without(ACCEL, 100), without(STAMP, 8), halved, one_slot_for_all],
    ids=["BDR_GY halved", "no accelerometer", "each eighth stamp", "all halved", "TAG_CNT stands"],
)
def test_another_rate_than_the_registers_say_is_counted_once_and_restarted(change):
    """Within a second and a burst.  What is delivered until then is right."""
    started()
    during, place = [streamed_by_time(0, 100)], 100
    while "starts" not in faults():
        during.append(streamed_by_time(place, 10, change))
        place += 10
        assert place < WINDOW + 100
    assert place < 200 or change is not halved  # all the stamps say so
    assert (faults()["rate"], faults()["starts"]) == (1, 1)
    assert not {"silent", "changed", "overrun", "parity", "tag"} & faults().keys()
    delivered = np.concatenate(during)
    np.testing.assert_array_equal(delivered["registers"][:, :6], registers_of(delivered["number"] - delivered["number"][0]))
    poll(25)
    settle()
    assert len(streamed_by_time(0, 100)) > 80


@pytest.mark.parametrize(("milliseconds", "wrong"), [(27, True), (29, False), (31, False), (33, True)])
def test_the_sensors_clock_against_the_targets(milliseconds, wrong):
    """50 slots take 30 ms: a tenth off is no rate that was set, 3 % are a target's RC oscillator at its worst."""
    started()
    for place in range(0, 2 * WINDOW, 50):
        push(slots(place, 50))
        poll(milliseconds)
    assert ("rate" in faults()) == wrong


# Settling.


LPF1 = {
    0: (0, 0, 0, 0, 0, 2, 3),
    1: (0, 0, 0, 0, 1, 2, 4),
    2: (0, 0, 0, 1, 1, 3, 5),
    3: (0, 0, 0, 0, 0, 1, 2),
    4: (0, 0, 1, 1, 2, 4, 9),
    5: (0, 1, 1, 2, 4, 9, 18),
    6: (0, 1, 2, 3, 6, 12, 24),
    7: (1, 2, 3, 6, 12, 24, 48),
    0xFF: (0,) * 7,
}


def unsettled(odr, lpf1=0xFF, lpf2=2, fine=0):
    return library().unsettled(odr, lpf1, lpf2, fine)


@pytest.mark.parametrize(("odr", "longer"), [(3, 1.05), (5, 1.5), (8, 1.2), (10, 2.0)])
def test_a_sensor_whose_first_slots_are_irregular_is_late_and_not_dead(odr, longer):
    """The first 40 ms and three slots come at longer steps: its first sample waits for steps that follow, and nothing is restarted."""
    settling, count = started(odr, settles=False).unsettled(odr, 0xFF, 2, 0), 600
    early, each = 3 + int(0.04 * RATES_HZ[odr - 1]), max(1, int(0.006 * RATES_HZ[odr - 1]))
    ticks = np.floor(100.5 + np.cumsum(np.where(np.arange(count) < early, longer, 1.0) * period_of(odr))).astype(np.int64)
    found = []
    for place in range(0, count, each):
        push(np.concatenate([warmth(place), words_of(np.arange(place, min(place + each, count)), ticks[place : place + each])]))
        found.append(poll(max(1, round(1e3 * each / RATES_HZ[odr - 1]))))
    found = np.concatenate(found)
    first = int(found["registers"][0, 0]) + 15000
    assert not faults()
    assert settling <= first <= max(settling, early) + 17
    np.testing.assert_array_equal(found["registers"][:, :6], registers_of(np.arange(first, first + len(found))))
    assert len(found) > count - first - 40


# The self-test, and the serial number.


NOTHING_MEASURED = 0x8000


CTRL5_C = 0x14


GOOD, BAD = 30, 2  # times 256 LSB


class SelfTest(ctypes.Structure):
    _fields_ = (("failed", ctypes.c_uint16), ("gyro_dps", ctypes.c_float * 3), ("accel_mg", ctypes.c_float * 3))


def self_tested(by_steps=True):
    result = SelfTest()
    (library().self_test_by_steps if by_steps else library().self_test)(ctypes.byref(result))
    return result


@pytest.mark.parametrize(
    ("pushed", "failed"),
    [(2, 0x3F), (3, 0x07), (8, 0x07), (9, 0), (39, 0), (40, 0x07), (54, 0x07), (55, 0x3F)],
)
def test_the_limits_of_the_self_test(pushed, failed):
    """In steps of 256 LSB: 2142 to 10000 LSB of the gyroscope, 737 to 13934 of the accelerometer."""
    lib = started(settles=False)
    put(pushed=pushed)
    for by_steps in (True, False):
        found = self_tested(by_steps)
        assert found.failed == failed
        assert list(found.gyro_dps) == pytest.approx([pushed * 256 * 0.070] * 3)
        assert list(found.accel_mg) == pytest.approx([pushed * 256 * 0.122] * 3)
        assert [registers()[address] for address in (CTRL1_XL, CTRL2_G, CTRL5_C)] == [0, 0, 0]  # switched off again
        assert not lib.running()
    assert lib.start() == NONE
    assert not faults()


@pytest.mark.parametrize(("pushed", "verdict"), [(GOOD, 0), (BAD, 0x3F)])
def test_a_line_that_sticks_never_fails_a_good_part_nor_passes_a_bad_one(pushed, verdict):
    """At any moment of the procedure, mostly where something goes over the line: then nothing was measured."""
    started(settles=False)
    put(pushed=pushed, logged=0)
    begun_us = number("now_us").value
    assert self_tested().failed == verdict
    busy_us, rng = np.array(accessed_us()) - begun_us, np.random.default_rng(1)
    for behaviour, lasts_us in itertools.product((ZEROS, ONES, HANGS), (20, 300, 40_000)):
        outcomes = set()
        for from_us in rng.choice(busy_us, 150) + rng.integers(-min(lasts_us, 300), 70, 150):
            started(settles=False)
            line_us = number("now_us").value + max(0, int(from_us))
            put(pushed=pushed, line=behaviour, line_from_us=line_us, line_until_us=line_us + lasts_us)
            outcomes.add(self_tested().failed)
        assert NOTHING_MEASURED in outcomes
        assert outcomes <= {NOTHING_MEASURED, verdict}


@pytest.mark.parametrize("register", [CTRL2_G, CTRL5_C])
def test_a_register_that_does_not_take_it_is_nothing_measured(register):
    """Neither a range or a rate, nor the force."""
    started(settles=False)
    put(pushed=GOOD, stuck=register)
    found = self_tested()
    assert found.failed == NOTHING_MEASURED
    assert not any([*found.gyro_dps, *found.accel_mg])


def test_a_part_that_does_not_lie_still_is_nothing_measured():
    """300 LSB of the gyroscope, 21 dps, from one output to the next."""
    started(settles=False)
    put(pushed=GOOD)
    for lsb, failed in ((200, 0), (300, NOTHING_MEASURED)):
        put(shaken=lsb)
        assert self_tested().failed == failed


def test_the_serial_number_is_the_crc_of_the_chips_id_and_never_0():
    id_words = (ctypes.c_uint32 * 3).in_dll(library(), "unique_id")
    # the CRC of the last is 0
    for words in ([1, 2, 3], [0xFFFFFFFF, 0, 7], [0, 0, 0x08FBD5F4]):
        id_words[:] = words
        assert library().identity_serial() == (zlib.crc32(np.array(words, "<u4").tobytes()) or 1)
