"""Lost samples: found at their rows, and put back as well as the movement allows."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table
from spoilt_registers import RATES, clean, closed_up, noise_std, rows_in_turns, with_glitches, with_losses

from session.detect import bridging
from session.io.samples import Samples
from tinygc.explanation import faulty_readings
from tinygc.explanation.faulty_readings import find_glitches, find_jumps, find_losses, with_lost

# Losses


@pytest.mark.parametrize("odr_hz", RATES)
@pytest.mark.parametrize("lost_s", [0.045, 0.06, 0.12])
def test_losses_are_found_at_their_rows(odr_hz, lost_s):
    """All whose step, which is twice as large in the third difference, stands well out of that difference's noise (root 20)."""
    count, found_all = round(lost_s * odr_hz), 0
    for seed in range(4):
        samples, table = clean(odr_hz, seed)
        rows = rows_in_turns(table, samples, 1, seed)
        spoilt = with_losses(samples, rows, count)
        found = set(find_losses(find_jumps(spoilt), spoilt.duration_s))
        assert found <= set(closed_up(rows, count))
        true, attitude = table.truth(samples.t_s)
        values = np.concatenate([true, attitude.inv().apply([0, 0, -9.7946])], axis=1)
        step = np.abs(values[rows + count + 1] - values[rows])
        size = np.linalg.norm(2 * step / (np.sqrt(20) * noise_std(odr_hz)), axis=1)
        clear = set(closed_up(rows, count)[size > 2 * faulty_readings.JUMP])
        assert clear <= found
        found_all += len(clear)
    assert found_all >= 3


@pytest.mark.parametrize("odr_hz", RATES)
def test_what_was_lost_is_put_back(odr_hz):
    """Stamps as they were; readings on a cubic through four neighbours on either side: its own noise, and what it does not bend."""
    count = round(0.06 * odr_hz)
    samples, table = clean(odr_hz, 2)
    rows = rows_in_turns(table, samples, 1, 2)
    back = with_lost(with_losses(samples, rows, count), closed_up(rows, count), count, 3)
    assert len(back) == len(samples)
    np.testing.assert_allclose(back.t_ns, samples.t_ns, atol=500 * (count * len(rows) + 2))  # stamps are whole microseconds
    assert (np.diff(back.t_ns) > 0).all()
    lost = (rows[:, None] + 1 + np.arange(count)).ravel()
    others = np.delete(np.arange(len(samples)), lost)
    for name in ("gyro", "accel", "temp_c"):
        np.testing.assert_array_equal(getattr(back, name)[others], getattr(samples, name)[others])
    known = np.concatenate([np.arange(-4, 0), np.arange(count, count + 4)])
    gain = np.linalg.norm(np.vander(np.arange(count), 4) @ np.linalg.pinv(np.vander(known, 4)), axis=1).max()
    true, attitude = table.truth(samples.t_s)
    noise = noise_std(odr_hz)
    assert np.abs(back.gyro - true - np.array([0.5, -0.3, 0.6]) * DEG)[lost].max() < 0.05 * DEG + 4 * gain * noise[0]
    level = attitude.inv().apply([0, 0, -9.7946])
    assert np.abs(back.accel - level)[lost].max() < 0.005 + 4 * gain * noise[5]


def test_false_readings_are_no_losses():
    samples, table = clean(208.0, 3)
    rows = rows_in_turns(table, samples, 2, 3)
    spoilt = with_glitches(samples, rows, np.full(len(rows), 4), 3)
    assert len(find_losses(find_jumps(spoilt), spoilt.duration_s)) == 0


@pytest.mark.parametrize("odr_hz", [104.0, 208.0])
def test_corners_of_a_clipped_rate_are_no_losses(odr_hz):
    """They are jumps of the gyro alone: what was lost would be missing from the accelerometer as well."""
    table = Table().rest(2)
    for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0)):
        table.turn(170, axis, 0.8).rest(2)
    samples = table.samples(odr_hz=odr_hz)
    clipped = replace(samples, gyro=np.clip(samples.gyro, -200 * DEG, 200 * DEG))
    jumps = find_jumps(clipped)
    assert len(jumps.rows) >= 4
    assert len(find_losses(jumps, clipped.duration_s)) == 0
    assert find_glitches(clipped) is None


# In whole sessions: rows and times go on from log to log


@pytest.mark.parametrize(("shaking_hz", "noise_dps", "expected"), [(5.0, 0.02, 5), (0.3, 0.5, 1)])
def test_a_rough_hand_asks_for_a_high_order_and_a_noisy_sensor_for_a_low_one(shaking_hz, noise_dps, expected):
    t = np.arange(8000) / 208
    gyro = 100 * DEG * np.sin(2 * np.pi * shaking_hz * t[:, None] + [0, 1, 2])
    gyro += noise_dps * DEG * np.random.default_rng(2).standard_normal(gyro.shape)
    samples = Samples((t * 1e9).astype(np.int64), gyro, np.zeros_like(gyro), None)
    order, missed_rad = bridging.best_order(samples, np.array([4000]), 9)
    assert order == expected
    assert missed_rad > 0.9 * noise_dps * DEG * np.sqrt(9) / 208  # what was not read holds noise of its own
