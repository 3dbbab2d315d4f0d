"""The first look's numbers by hand: axes by closure, stamps' jitter, clipping, held readings, wraps, dead axes."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from looks import G, look, of, with_sensor
from scipy.spatial.transform import Rotation

from session.detect.axes import IDENTITY, SIGNED_PERMUTATIONS, agreement, axes_in_words, check_gravity_moves, cut_turns
from session.detect.check_samples import check_stamps, find_ceiling
from session.detect.events import clips, plateau, run_bar
from session.detect.stills import find_stills
from session.io.numeric import held_for, new_readings, smallest_step

# Readings that repeat, and steps


def test_new_readings_are_rows_that_differ_in_any_axis():
    rows = np.repeat(np.arange(12.0).reshape(4, 3), [1, 3, 2, 1], axis=0)
    assert new_readings(rows).tolist() == [True, True, False, False, True, False, True]
    rows[2, 1] += 1
    assert new_readings(rows).tolist() == [True, True, True, True, True, False, True]
    long = np.repeat(np.arange(9000.0), 2)[:, None] * np.ones(3)
    assert new_readings(long).sum() == 9000


def test_a_reading_is_held_for_the_median_of_its_rows():
    assert held_for(new_readings(np.repeat(np.arange(30.0), 6)[:, None] * np.ones(3))) == 6
    assert held_for(new_readings(np.repeat(np.arange(30.0), np.resize([1, 1, 9], 30))[:, None] * np.ones(3))) == 1
    assert held_for(np.ones(2, dtype=bool)) == 1


def test_the_smallest_step_is_beyond_rounding():
    assert smallest_step(np.array([1.0, 1.5, 1.5, 3.0])) == 0.5
    assert smallest_step(np.array([1000.0, 1000.0 + 5e-7, 1002.0])) == pytest.approx(2.0)
    assert smallest_step(np.ones(4)) == 0.0


# Limits


def test_a_run_that_noise_hardly_makes():
    """Two neighbours fall on one step with a chance of step / (2 sqrt(pi) sigma); n of them by chance^(n - 1), once in ten thousand."""
    chance = 1 / (2 * np.sqrt(np.pi) * 3)
    bar = run_bar(3.0, 1.0)
    assert chance ** (bar - 1) <= 1e-4 < chance ** (bar - 2)
    assert run_bar(0.0, 1.0) == 200
    assert run_bar(1 / (2 * np.sqrt(np.pi) * 0.9), 1.0) == 200
    assert run_bar(1 / (2 * np.sqrt(np.pi) * 0.89), 1.0) < 100
    assert run_bar(1e9, 1.0) == 4
    assert run_bar(1.0, 0.0) == 4


def test_a_plateau_has_as_many_readings_in_a_row():
    values = np.array([1, 1, 0, 1, 1, 1, 0, 1, 1, 1, 1.0])
    assert np.flatnonzero(plateau(values, 1.0, 3)).tolist() == [3, 4, 5, 7, 8, 9, 10]
    assert np.flatnonzero(plateau(values, 1.0, 4)).tolist() == [7, 8, 9, 10]


def test_readings_clip_at_the_registers_end_or_standing_at_the_full_scale():
    assert clips(np.array([1.0, 573.4]), 500.0, 573.4)
    assert not clips(np.array([1.0, 573.3]), 500.0, 573.4)
    assert clips(np.array([1.0, 500.0, 500.0, 500.0, 500.0]), 500.0, 573.4)
    assert not clips(np.array([1.0, 500.0, 500.0, 500.0]), 500.0, 573.4)
    assert clips(np.full(4, 499.6), 500.0, 573.4)
    assert not clips(np.full(4, 499.4), 500.0, 573.4)


def test_a_ceiling_is_the_mean_of_both_sides_and_has_all_their_rows():
    t = np.arange(4000) / 100
    gyro = np.stack([np.sin(t), np.sin(1.3 * t), 0.1 * np.sin(t)], axis=1) * 200 * DEG
    gyro += np.random.default_rng(1).normal(size=gyro.shape) * 0.05 * DEG
    limited = gyro.copy()
    limited[:, 0] = np.clip(limited[:, 0], -149 * DEG, 151 * DEG)
    found = find_ceiling(limited)
    at = (limited[:, 0] == 151 * DEG) | (limited[:, 0] == -149 * DEG)
    assert found.levels_dps[0] == pytest.approx(np.abs(limited[at, 0]).mean() / DEG, abs=0.02)
    assert np.isnan(found.levels_dps[1:]).all()
    assert found.at[at].mean() > 0.97
    assert not found.at[~at].any()
    assert find_ceiling(gyro) is None
    assert find_ceiling(np.maximum(limited, -140 * DEG) * [1, 1, 1]) is not None
    assert find_ceiling(np.minimum(gyro, 151 * DEG)) is None  # of one side alone


# Stamps


def test_jitter_is_what_a_stamp_misplaces(good):
    """A stamp that errs by e moves e times the change of the rate around it; over a segment these add up as a random walk."""
    log = good.logs[0]
    rng, t_ns = np.random.default_rng(1), log.samples.t_ns
    stamps = t_ns + np.rint(rng.normal(size=len(t_ns)) * 2e5).astype(np.int64)
    stamps[0] = t_ns[0] - 10**6
    samples = replace(log.samples, t_ns=stamps)
    _, noise = find_stills(log.samples)
    findings = check_stamps(replace(log, samples=samples), noise, 5.0)
    (jitter,) = [finding for finding in findings if finding.what == "jitter"]
    steps = np.diff(stamps) * 1e-9
    size = np.sqrt(steps.var() / 2)
    change = (samples.gyro[2:] - samples.gyro[:-2]) / 2
    angle = np.sqrt((change**2).sum(axis=0).max() / (len(samples) - 2) * 5.0 / np.median(steps)) * size / DEG
    assert f"{size * 1e6:.1f} us rms" in jitter.says
    assert f"{angle:.4f} deg per turn" in jitter.says


# Axes


def test_a_signed_permutation_and_its_scale_are_found_exactly():
    """From turns whose gravity and rates are exact, in any of the 48 orders; closure from still to still is nought."""
    table = Table().tumble(10, seed=3)
    samples = table.samples(gyro_mdps=1e-6, accel_ug=1e-6, registers=False, odr_hz=104)
    stills, _ = find_stills(samples)
    for axes in SIGNED_PERMUTATIONS[::7]:
        wrong = replace(samples, gyro=samples.gyro @ axes / 1.25)
        found = agreement(wrong, [replace(still, gyro_mean=still.gyro_mean @ axes / 1.25) for still in stills])
        np.testing.assert_array_equal(found.axes, axes)
        assert found.scale == pytest.approx(1.25, rel=3e-3)
        assert found.scale_std == 0.03
        assert found.residual < 0.6 * DEG
        assert found.others == ()
        assert found.misfit < 0.02
        assert (found.turns, found.ends) == (9, 9)  # one stays about the vertical
    assert np.trace(SIGNED_PERMUTATIONS[IDENTITY]) == 3


def test_the_median_angle_of_turns_is_along_their_way():
    table = Table().rest(2)
    for angle in (100, -120, 140, -160, 180):
        table.turn(angle, (1, 1, 0.2), 3.0).rest(2)
    samples = table.samples(gyro_mdps=1e-6, accel_ug=1e-6, registers=False, odr_hz=104)
    assert agreement(samples, find_stills(samples)[0]).turned == pytest.approx(140 * DEG, rel=5e-3)


def test_turns_are_cut_into_blocks_that_add_up_to_their_angle():
    """The integral of the rate, less the stills' means: about a fixed axis, the turn's angle."""
    samples = Table().rest(2).turn(150, (1, 2, 0), 3.0).rest(2).samples(gyro_mdps=1e-6, accel_ug=1e-6, registers=False, odr_hz=104)
    stills, _ = find_stills(samples)
    turns = cut_turns(samples, [tuple(stills)])
    axis = np.array([1, 2, 0]) / np.sqrt(5)
    np.testing.assert_allclose(turns.angle.sum(axis=(0, 1)), 150 * DEG * axis, atol=2e-4)
    turned = Rotation.from_rotvec(150 * DEG * axis).inv()
    np.testing.assert_allclose(turns.first, [[0, 0, 1]], atol=1e-6)
    np.testing.assert_allclose(turns.last, turned.apply([[0, 0, 1]]), atol=1e-6)
    apart = np.linalg.norm(np.diff(turns.down[0], axis=0), axis=1)
    assert np.nanmax(apart) < 150 * DEG * 2 / 3 * 0.05 * 1.05


@pytest.mark.parametrize(("follows", "error"), [(0.0, True), (1.0, False)])
def test_gravity_must_move_where_rates_turn_it(follows, error):
    samples = Table().tumble(8, seed=2).samples(registers=False, odr_hz=104)
    stills, _ = find_stills(samples)
    level = np.tile(samples.accel[:1], (len(samples), 1))
    moved = samples.with_accel(follows * samples.accel + (1 - follows) * level)
    found = check_gravity_moves("log", moved, list(pairwise(stills)))
    assert bool(found) == error
    if error:
        assert "stays within 0 deg in 8 of 8 turns in which the rates tilt it by" in found[0].says


def test_words_for_a_swap_with_a_sign():
    axes = np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]])
    assert axes_in_words(axes) == "the gyro's x and z are exchanged; true x is the logged -z, y is the logged +y, z is the logged +x"


def test_a_scale_is_said_with_the_usual_mistake_within_three_per_cent_or_its_bar():
    made = session_of(Table().tumble(12, seed=5).samples(registers=False), raw=False, model="unknown")
    gyro = made.logs[0].samples.gyro
    for factor, level, words in (
        (1.04, "ok", ""),
        (1.06, "warning", "no usual mistake"),
        (1.3, "error", "no usual mistake"),
        (2.0, "error", "250 dps"),
    ):
        finding = of(look(made, gyro=gyro * factor), "gyro scale")
        assert (finding.level, words in finding.do) == (level, True)
    assert of(look(made, gyro=gyro * 2.06), "gyro scale").corrections[0].factor == 0.5
    assert of(look(made, gyro=gyro * 2.2), "gyro scale").corrections == ()


def test_a_comment_of_a_full_scale_is_held_against_the_declared_one(good):
    narrow = with_sensor(good, gyro_fs_dps=250)
    finding = of(look(narrow, log=replace(good.logs[0], comments={"gyro_fs_dps": "500"})), "full scale")
    assert finding.corrections[0].settings == (("gyro_fs_dps", 500.0),)


def test_an_impact_counts_from_one_g_between_two_readings(good):
    samples = good.logs[0].samples
    stills, _ = find_stills(good.calibrated(good.logs[0]))
    row = (stills[3].stop + stills[4].start) // 2
    for size, found in ((0.97, False), (1.03, True)):
        accel = samples.accel.copy()
        accel[row] *= (np.linalg.norm(accel[row]) + size * G) / np.linalg.norm(accel[row])
        accel[row - 1] *= np.linalg.norm(samples.accel[row]) / np.linalg.norm(accel[row - 1])
        findings = [each for each in look(good, accel=accel) if each.what == "impacts"]
        assert bool(findings) == found
