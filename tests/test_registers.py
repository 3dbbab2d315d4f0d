"""False readings and ceilings in the registers: found where they are, not invented, repaired, and nothing else is touched."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table
from spoilt_registers import FS, GYRO_STD, RATES, clean, rows_in_turns, with_glitches

from session.io.samples import Samples
from tinygc.explanation.clipped_turns import find_ceiling
from tinygc.explanation.faulty_readings import find_glitches, find_jumps, find_losses, without_glitches

# Nothing is invented


@pytest.mark.parametrize("odr_hz", RATES)
def test_a_clean_movement_has_no_jumps_and_no_ceiling(odr_hz):
    for seed in range(12):
        samples, _ = clean(odr_hz, seed, turns=3)
        jumps = find_jumps(samples)
        assert len(jumps.rows) == 0, (seed, jumps.rows, jumps.size)
        assert find_glitches(samples) is None
        assert len(find_losses(jumps, samples.duration_s)) == 0
        assert find_ceiling(samples, FS) is None


@pytest.mark.broad
@pytest.mark.parametrize("noise", [(1.0, 20.0), (20.0, 300.0)])
def test_nor_has_a_quieter_or_noisier_sensor(noise):
    for seed in range(8):
        samples = Table().tumble(3, seed=seed).samples(odr_hz=208, seed=seed, gyro_mdps=noise[0], accel_ug=noise[1])
        assert len(find_jumps(samples).rows) == 0
        assert find_ceiling(samples, FS) is None


@pytest.mark.parametrize("share", [0.005, 0.02, 0.05])
def test_samples_that_are_openly_missing_are_neither_losses_nor_false_readings(share):
    """A cable that drops single samples: the stamps say where, so no step there is a secret."""
    for seed in range(4):
        samples, _ = clean(208.0, seed)
        kept = np.random.default_rng(seed).random(len(samples)) > share
        some = Samples(samples.t_ns[kept], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept])
        jumps = find_jumps(some)
        assert len(jumps.rows) == 0
        assert find_glitches(some) is None


def test_a_turn_that_starts_at_once_is_no_jump():
    """A short strong turn after a long rest: its neighbourhood's scatter is that of the rest until it begins."""
    samples = Table().rest(5).turn(90, (1, 2, 0), 0.6).rest(5).samples(odr_hz=208)
    assert len(find_jumps(samples).rows) == 0


def test_a_short_recording_has_no_jumps():
    samples = Table().rest(0.5).samples(odr_hz=104)
    assert len(find_jumps(samples).rows) == 0
    assert find_glitches(samples) is None


# False readings


@pytest.mark.slow
@pytest.mark.parametrize("odr_hz", RATES)
@pytest.mark.parametrize("length", [1, 2, 4, 8])
def test_false_readings_are_found_with_their_rows_and_lengths(odr_hz, length):
    for seed in range(3):
        samples, table = clean(odr_hz, seed)
        rows = rows_in_turns(table, samples, 2, seed)
        glitches = find_glitches(with_glitches(samples, rows, np.full(len(rows), length), seed))
        np.testing.assert_array_equal(glitches.rows, rows)
        np.testing.assert_array_equal(glitches.samples, length)


@pytest.mark.parametrize("odr_hz", [208.0])
def test_repaired_readings_are_within_noise_and_bending_of_the_true_ones(odr_hz):
    """A straight line over n samples of a rate w misses by at most w'' ((n + 1) dt)^2 / 8; noise of both ends comes on top."""
    samples, table = clean(odr_hz, 1)
    rows, length = rows_in_turns(table, samples, 2, 1), 4
    spoilt = with_glitches(samples, rows, np.full(len(rows), length), 1)
    repaired = without_glitches(spoilt, find_glitches(spoilt))
    true, _ = table.truth(samples.t_s)
    second = np.abs(np.gradient(np.gradient(true, axis=0), axis=0)).max() * odr_hz**2
    bias = np.array([0.5, -0.3, 0.6]) * DEG
    bent = second * ((length + 1) / odr_hz) ** 2 / 8
    touched = (rows[:, None] + np.arange(length)).ravel()
    assert np.abs(repaired.gyro - true - bias)[touched].max() < bent + 5 * GYRO_STD * np.sqrt(odr_hz / 2) + 0.5 * 17.5e-3 * DEG
    others = np.delete(np.arange(len(samples)), touched)
    np.testing.assert_array_equal(repaired.gyro[others], samples.gyro[others])
    for name in ("t_ns", "accel", "temp_c"):
        np.testing.assert_array_equal(getattr(repaired, name), getattr(samples, name))
    assert np.abs(spoilt.gyro - samples.gyro).max() > 10 * DEG  # the record that was given is not changed


# Ceilings


@pytest.mark.parametrize("odr_hz", RATES)
@pytest.mark.parametrize("level_dps", [40.0, 55.0])
def test_a_level_that_is_never_passed_is_found(odr_hz, level_dps):
    for seed in range(3):
        samples, _ = clean(odr_hz, seed)
        level = np.rint(level_dps / 17.5e-3) * 17.5e-3 * DEG
        clipped = replace(samples, gyro=np.clip(samples.gyro, -level, level))
        ceiling = find_ceiling(clipped, FS)
        assert ceiling.level == pytest.approx(level, rel=1e-9)
        over = (np.abs(samples.gyro) > level).any(axis=1)
        assert ceiling.mask[over].mean() > 0.6  # of the axes and senses that stay there long enough
        assert not ceiling.mask[(np.abs(samples.gyro) < 0.98 * level).all(axis=1)].any()
