"""The sensor's driver against an array of registers: how it starts, its settings, and the samples that come through."""

from __future__ import annotations

import numpy as np
import pytest
from driver_under_test import (
    ASM330LHH,
    CTRL1_XL,
    CTRL2_G,
    CTRL3_C,
    CTRL4_C,
    CTRL6_C,
    CTRL8_XL,
    CTRL9_XL,
    CTRL10_C,
    FIFO_CTRL1,
    FIFO_CTRL2,
    FIFO_CTRL3,
    FIFO_CTRL4,
    FREQ_FINE,
    INT1_CTRL,
    LSM6DSO,
    WHO_AM_I,
    accesses,
    faults,
    library,
    number,
    poll,
    push,
    registers,
    registers_of,
    slots,
    started,
    streamed_by_time,
    warmth,
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


@pytest.mark.parametrize(("dps", "code"), [(125, 2), (250, 0), (500, 4), (1000, 8), (2000, 12), (4000, 1)])
@pytest.mark.parametrize(("g", "bits"), [(2, 0), (16, 1), (4, 2), (8, 3)])
def test_ranges_and_rates_in_their_registers(dps, code, g, bits):
    for odr in range(1, 11):
        started(odr=odr, gyro_fs_dps=dps, accel_fs_g=g, settles=False)
        assert (registers()[CTRL1_XL], registers()[CTRL2_G]) == (odr << 4 | bits << 2, odr << 4 | code)
        assert registers()[FIFO_CTRL3] == odr << 4 | odr
        assert registers()[FIFO_CTRL1] == 3 * min(16, max(1, int((12.5, 26, 52, 104, 208, 417, 833, 1667, 3333, 6667)[odr - 1] / 100)))


@pytest.mark.parametrize(("divisor", "code"), [(4, 0), (10, 1), (20, 2), (45, 3), (100, 4), (200, 5), (400, 6), (800, 7)])
def test_the_accelerometers_second_filter(divisor, code):
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
    number("busy_polls").value = 2
    count, found = 20_000, []
    for first in range(0, count, 10):
        push(slots(first, 10) if first != 10_000 else np.concatenate([warmth(10_000, 512), slots(first, 10)]))
        found.append(poll(6))
    found = np.concatenate([*found, poll(20)])
    held = count - len(found)
    assert 1 <= held <= 17  # the last slot, and what is below the watermark
    assert not faults()
    np.testing.assert_array_equal(np.diff(found["number"].astype(int)), 1)
    np.testing.assert_array_equal(found["registers"][:, :6], registers_of(np.arange(len(found))))
    np.testing.assert_array_equal(found["registers"][:, 6], np.where(np.arange(len(found)) <= 10_000, 0, 512))


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
