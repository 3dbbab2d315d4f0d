"""Still phases: found where the table rested, measured right, and nothing taken for rest that is none."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, GRAVITY, Table

from session.detect.stills import find_stills
from session.io.samples import Samples
from session.io.units import MDPS, MG
from tinygc.simulation.simulator import low_pass, oversampling

BENCHES = [(100.0, 10.0), (208.0, 5.0), (208.0, 3.0), (833.0, 5.0), (1600.0, 7.0)]


def edges(samples, stills):
    return np.array([[still.start_s, still.start_s + still.duration_s] for still in stills])


@pytest.mark.parametrize(("odr_hz", "mdps"), BENCHES)
@pytest.mark.parametrize("seed", [1, 2])
def test_every_rest_is_found_and_its_edges_are_right(odr_hz, mdps, seed):
    table = Table().tumble(10, rest_s=1.6, seed=seed)
    samples = table.samples(odr_hz, mdps, seed=seed)
    stills, _ = find_stills(samples)
    assert [still.problem for still in stills] == [None] * len(table.rests)
    np.testing.assert_allclose(edges(samples, stills), table.rests, atol=0.2)


@pytest.mark.parametrize(("odr_hz", "mdps"), BENCHES)
def test_nothing_of_a_turn_is_in_a_still(odr_hz, mdps):
    """The true rate inside a still stays below what its noise could hide: a few hundredths of a degree over its length."""
    table = Table().tumble(6, seed=3)
    samples = table.samples(odr_hz, mdps)
    rate, _ = table.truth(samples.t_s)
    for still in find_stills(samples)[0]:
        turned = np.abs(rate[still.start : still.stop].sum(axis=0)) / odr_hz
        assert turned.max() < 0.1 * DEG


def test_a_still_is_measured_as_it_was_made():
    table = Table().rest(20).turn(60, (1, 0, 0), 3).rest(20)
    bias_dps = np.array([0.5, -0.3, 0.6])
    samples = table.samples(208, 5.0, 60.0, bias_dps, registers=False)
    for still, (_, attitude) in zip(find_stills(samples)[0], [table.truth(np.array([1.0])), table.truth(np.array([40.0]))], strict=True):
        of_mean = 5.0 * MDPS / np.sqrt(2 * still.duration_s)
        np.testing.assert_allclose(still.gyro_mean, bias_dps * DEG, atol=4 * of_mean)
        np.testing.assert_allclose(still.gyro_std, 5.0 * MDPS * np.sqrt(104), rtol=0.05)
        assert np.abs(still.gyro_slope).max() < 4 * of_mean * np.sqrt(12) / still.duration_s
        down = attitude.inv().apply([0, 0, -GRAVITY])[0]
        np.testing.assert_allclose(still.accel_mean, down, atol=4 * 0.06 * MG / np.sqrt(2 * still.duration_s))
        assert abs(still.gravity_mps2 - GRAVITY) < 4 * 0.06 * MG / np.sqrt(2 * still.duration_s)
        np.testing.assert_allclose(still.accel_std, 0.06 * MG * np.sqrt(104), rtol=0.05)
        assert abs(still.temp_c - 25.0) < 0.01


def test_a_bias_that_drifts_within_a_still_is_its_slope():
    samples = Table().rest(30).samples(registers=False)
    drift = np.array([0.002, -0.001, 0.0]) * DEG  # rad/s^2: 0.06 dps in the whole still
    samples = Samples(samples.t_ns, samples.gyro + samples.t_s[:, None] * drift, samples.accel)
    (still,) = find_stills(samples)[0]
    std = 5 * MDPS / np.sqrt(2 * 30) * np.sqrt(12) / 30
    np.testing.assert_allclose(still.gyro_slope, drift, atol=4 * std)


@pytest.mark.parametrize(("odr_hz", "mdps", "ug"), [(100.0, 10.0, 120.0), (208.0, 5.0, 60.0), (833.0, 5.0, 60.0), (1600.0, 3.0, 60.0)])
def test_the_noise_densities_are_recovered(odr_hz, mdps, ug):
    """168 s of rest tell them to 3 % an axis (1 sigma), three axes to 2 %."""
    _, noise = find_stills(Table().tumble(20, rest_s=8.0).samples(odr_hz, mdps, ug, registers=False))
    for found, true in ((noise.gyro / MDPS, mdps), (noise.accel / MG * 1e3, ug)):
        np.testing.assert_allclose(found, true, rtol=0.1)
        assert np.mean(found) == pytest.approx(true, rel=0.06)


def test_the_sensors_own_filter_hides_little_of_the_noise():
    """Behind a low-pass of ODR/4 at 104 Hz, neighbouring blocks of 0.1 s hang together and would hide 3 % of the noise; three hide 1 %."""
    still = Table().rest(1000).samples(104, gyro_mdps=0, accel_ug=0, registers=False)
    factor, rng = oversampling(104), np.random.default_rng(0)
    filtered = [low_pass(np.zeros((len(still) * factor, 3)), 26.0, density, 104, factor, rng) for density in (5 * MDPS, 0.06 * MG)]
    _, noise = find_stills(replace(still, gyro=still.gyro + filtered[0], accel=still.accel + filtered[1]))
    found = np.concatenate([noise.gyro / (5 * MDPS), noise.accel / (0.06 * MG)])
    assert found.mean() == pytest.approx(0.99, abs=0.013)  # six axes of 1 % each: three sigmas


@pytest.mark.parametrize("rest_s", [0.3, 0.45, 0.6])
def test_stills_too_short_for_twice_three_blocks_still_tell_the_noise(rest_s):
    """Spans of one or two blocks then; the estimate is rough, and neither missing nor wrong."""
    stills, noise = find_stills(Table().tumble(120, rest_s=rest_s, turn_s=1.5).samples(), still_s=0.2)
    assert len(stills) == 121
    ratios = np.concatenate([noise.gyro / (5 * MDPS), noise.accel / (0.06 * MG)])
    np.testing.assert_allclose(ratios, 1, rtol=0.4)
    assert ratios.mean() == pytest.approx(1, abs=0.15)


def test_the_angle_random_walk_is_the_spread_of_the_integral():
    """500 integrals over 4 s at rest spread by walk x sqrt(4 s)."""
    samples = Table().rest(500).samples(registers=False, bias_dps=(0, 0, 0))
    _, noise = find_stills(samples)
    size = 4 * 208
    integrals = samples.gyro[: 125 * size].reshape(125, size, 3).sum(axis=1) / 208
    np.testing.assert_allclose(noise.angle_random_walk * 2, integrals.std(axis=0), rtol=0.2)


def covered(samples, stills, start, stop):
    """Seconds of (start, stop) that lie in good stills."""
    good = edges(samples, [still for still in stills if still.problem is None])
    return np.clip(np.minimum(good[:, 1], stop) - np.maximum(good[:, 0], start), 0, None).sum()


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, -1, 0), (1, 1, 0)])
@pytest.mark.parametrize("seed", range(3))
def test_a_slow_creep_between_turns_is_no_reference(axis, seed):
    """0.1 dps about a horizontal axis turns gravity by 0.2 deg in 2 s: sixteen times what a segment closes to."""
    table = Table().rest(2).turn(80, (1, 0, 0)).rest(2).turn(-80, (1, 0, 0))
    start = table.duration_s
    table.steady(0.1, axis, 2.0).turn(-120, (0, 1, 0)).rest(2).turn(50, (0, 0, 1)).rest(2)
    samples = table.samples(seed=seed)
    stills, _ = find_stills(samples)
    assert covered(samples, stills, start, start + 2.0) == 0
    (creeping,) = [still for still in stills if still.problem]
    assert float(creeping.problem.split()[1]) == pytest.approx(0.1, abs=0.02)
    assert start - 0.1 < creeping.start_s < start + 0.3
    for rest in table.rests:
        assert covered(samples, stills, *rest) > 1.6


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_a_creep_that_comes_to_rest_is_cut_off(first, seed):
    """The hand lets go, or takes hold, slowly: the rest is used, the creep hardly."""
    table = Table().rest(2).turn(80, (1, 0, 0)).rest(2).turn(-80, (1, 0, 0))
    start = table.duration_s
    if first:
        table.steady(0.1, (1, 0, 0), 2.0).rest(2.5)
    else:
        start += 2.5
        table.rest(2.5).steady(0.1, (1, 0, 0), 2.0)
    table.turn(-120, (0, 1, 0)).rest(2)
    samples = table.samples(seed=seed)
    stills, _ = find_stills(samples)
    assert covered(samples, stills, start, start + 2.0) < 0.5
    assert covered(samples, stills, *table.rests[2]) > 1.5


@pytest.mark.parametrize("dps", [0.3, 10.0, 60.0])
def test_a_steady_turn_about_a_horizontal_axis_is_no_still(dps):
    table = Table().tumble(4).steady(dps, (0, 1, 0), 4.0).tumble(4, seed=1)
    start = 2 + 4 * 5
    for still in find_stills(table.samples())[0]:
        if still.problem is None:
            inside = min(still.start_s + still.duration_s, start + 4.0) - max(still.start_s, start)
            assert inside < 0.5


@pytest.mark.parametrize("dps", [10.0, -10.0, 40.0])
def test_a_steady_turn_about_the_vertical_is_no_still(dps):
    """Gravity does not move in it and its rate is as quiet as rest: only the rest of the log tells."""
    table = Table().rest(2).turn(90, (1, 0, 0)).rest(2).turn(-90, (1, 0, 0)).rest(2)
    start = table.duration_s
    table.steady(dps, (0, 0, 1), 5.0).rest(2).turn(50, (0, 1, 0)).rest(2)
    samples = table.samples()
    stills, _ = find_stills(samples)
    np.testing.assert_allclose(edges(samples, stills), table.rests, atol=0.2)
    assert all(still.start_s + still.duration_s < start + 0.2 or still.start_s > start + 4.8 for still in stills)


@pytest.mark.parametrize("seed", range(3))
def test_a_short_bump_does_not_end_a_still(seed):
    """A knock on the table: 0.15 s of shaking that leaves the attitude where it was."""
    table = Table().tumble(3, rest_s=3.0, seed=seed)
    samples = table.samples(seed=seed)
    (start, _), number = table.rests[2], 2
    t = samples.t_s - (start + 1.5)
    knock = np.where((t > 0) & (t < 0.15), 3 * DEG * np.sin(2 * np.pi * t / 0.05), 0.0)
    gyro = samples.gyro + knock[:, None] * [1, 0.5, 0.2]
    accel = samples.accel + knock[:, None] / DEG * 0.05 * [0.3, 1, 0.2]
    stills, _ = find_stills(Samples(samples.t_ns, gyro, accel, samples.temp_c))
    assert len(stills) == 4
    assert stills[number].bumps == 1
    assert stills[number].problem is None
    np.testing.assert_allclose(edges(samples, stills), table.rests, atol=0.2)
    # What is measured leaves the bump out.
    np.testing.assert_allclose(stills[number].gyro_std, stills[1].gyro_std, rtol=0.3)


def test_a_small_turn_is_not_taken_for_a_bump():
    """1 deg in 0.4 s: another attitude, so another still."""
    table = Table().rest(3).turn(1.0, (1, 0, 0), 0.4).rest(3)
    stills, _ = find_stills(table.samples())
    assert len(stills) == 2


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 1), (0, 0, 1)])
def test_a_log_that_never_rests_has_no_still(axis):
    table = Table()
    for i in range(20):
        table.turn(150 * (-1) ** i, np.roll(axis, i), 2.5)
    stills, noise = find_stills(table.samples())
    assert [still for still in stills if still.problem is None] == []
    assert noise is None


@pytest.mark.parametrize("odr_hz", [100.0, 208.0, 1600.0])
def test_a_log_that_only_rests_is_one_still(odr_hz):
    samples = Table().rest(40).samples(odr_hz)
    (still,), _ = find_stills(samples)
    assert still.problem is None
    assert still.duration_s > 39.5


def test_rests_shorter_than_the_protocol_asks_for_do_not_count():
    table = Table().rest(3).turn(90, (1, 0, 0)).rest(0.4).turn(90, (0, 1, 0)).rest(3)
    samples = table.samples()
    stills, _ = find_stills(samples, still_s=1.0)
    assert len(stills) == 2
    stills, _ = find_stills(samples, still_s=0.4)
    assert len(stills) == 3


@pytest.mark.parametrize("count", [0, 1, 2, 5, 30])
def test_a_log_of_a_few_samples_has_no_stills_and_no_failure(count):
    samples = Table().rest(1).samples().between(0, max(count, 2))
    assert find_stills(samples) == ([], None)


def test_registers_that_never_move_hold_no_stills():
    """A sensor without noise is a sensor that does not answer: nothing is rest, and no noise is claimed."""
    samples = Table().rest(10).samples()
    frozen = Samples(samples.t_ns, np.zeros_like(samples.gyro), np.zeros_like(samples.accel) + np.array([0, 0, -9.8]))
    assert find_stills(frozen) == ([], None)


@pytest.mark.parametrize("fraction", [0.1, 0.9])
def test_much_or_little_rest_makes_no_difference(fraction):
    """The noise is measured on the log itself, whatever share of it is rest."""
    rest = 3.5 * fraction / (1 - fraction)
    table = Table()
    rng = np.random.default_rng(4)
    table.rest(max(rest, 1.0))
    for _ in range(6):
        for _ in range(1 if rest > 1 else 3):
            table.turn(rng.uniform(60, 150), rng.normal(size=3), 3.5)
        table.rest(max(rest, 1.0))
    stills, _ = find_stills(table.samples())
    assert len(stills) == 7


def test_the_unit_of_the_rate_does_not_matter_to_what_is_found():
    """A log in deg/s that says rad/s still has its stills: the first look needs them to say so."""
    table = Table().tumble(8)
    samples = table.samples()
    wrong = Samples(samples.t_ns, samples.gyro / DEG, samples.accel, samples.temp_c)
    stills, _ = find_stills(wrong)
    np.testing.assert_allclose(edges(wrong, stills), table.rests, atol=0.2)
