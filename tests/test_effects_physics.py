"""Every effect is the physics that its equation says, forwards, backwards and linearised; and so are the signals it is made of."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from known_effects import FS, RATE, STRONG, movement, smooth, theta_of
from numpy.testing import assert_allclose
from scipy.ndimage import uniform_filter1d
from scipy.signal import lsim
from scipy.spatial.transform import Rotation

from session.base.units import EARTH_RATE_RPS
from tinygc.effects import Effect, EffectError, Movement, NoC, Parameter, Reach, axis_of, catalogue, diagonal, full, largest, signals
from tinygc.effects.catalogue import tried
from tinygc.effects.device import MOST_PASSES
from tinygc.effects.entries.earth_rotation import latitude_deg
from tinygc.effects.movement import _mean, vibration


def test_every_own_effect_passes_the_first_test_of_an_external_one():
    assert all(tried(effect, name) is effect for name, effect in catalogue().items())


@pytest.mark.parametrize("name", RATE)
def test_columns_are_the_derivative_of_what_it_does_and_it_is_undone(name):
    """Of distorting and, with the other sign, of correcting, away from the ends; one-sided from zero, since a lag is never negative.  At
    3332 Hz: a lag far below the period is a backward difference.  Undone at 208 Hz, in shares of what it does at most; without parameters
    it changes nothing."""
    effect, fast, slow = catalogue()[name], movement(3332.0), movement(208.0)
    size, step = effect.parameter.size, 1e-4 * effect.parameter.plausible
    columns = effect.columns(fast)
    assert columns.shape == (*fast.rate.shape, size)
    greatest = np.abs(columns).max(axis=(0, 1))
    assert (greatest > 0).all()
    for number, theta in enumerate(step * np.eye(size)):
        for sign, changed in ((1, effect.distort(fast, theta)), (-1, effect.correct(fast.rate, fast, theta))):
            apart = (changed - fast.rate) / step - sign * columns[..., number]
            assert np.abs(apart[50:-50]).max() < 5e-3 * greatest[number]
    distorted = effect.distort(slow, theta_of(effect))
    done = np.abs(distorted - slow.rate).max()
    assert done > 0.05 * DEG
    back = effect.correct(distorted, slow.with_rate(distorted), theta_of(effect))
    assert np.abs(back - slow.rate)[50:-50].max() < STRONG[name][1] * done
    for same in (effect.distort(slow, np.zeros(size)), effect.correct(slow.rate, slow, np.zeros(size))):
        assert_allclose(same, slow.rate, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("gyro.g_sensitivity", lambda m, k: m.force_g @ (k.reshape(3, 3) * DEG).T),
        ("gyro.g2_sensitivity", lambda m, k: k * DEG * m.force_g**2),
        ("gyro.scale_nonlinearity", lambda m, k: k * m.rate**3 / FS**2),
        ("gyro.scale_asymmetry", lambda m, k: k * np.abs(m.rate)),
        ("gyro.thermal_bias", lambda m, k: np.outer(m.temp_c - 25, k * DEG)),
        ("gyro.thermal_scale", lambda m, k: (m.temp_c - 25)[:, None] * k * m.rate),
        ("gyro.bias_drift", lambda m, k: np.outer(m.t_s / 10, k * DEG)),
        ("gyro.vibration_rectification", lambda m, k: np.outer(m.vibration_g2, k * DEG)),
    ],
)
def test_it_adds_what_its_equation_says(name, what):
    """The equations of docs/formats.md written out by hand, parameters in people's units."""
    effect, moved = catalogue()[name], movement()
    value = np.ravel(STRONG[name][0])
    added = effect.distort(moved, value * effect.parameter.si) - moved.rate
    assert_allclose(added, what(moved, value), rtol=1e-9, atol=1e-13)


def test_bandwidth_is_the_first_order_filter_of_scipy():
    """lsim with a linear input between the samples (first-order hold) integrates the same equation; it starts at rest.
    A sine of 4 Hz, a hand's tremor, is undone: central differences are short of the derivative by (2 pi f dt)^2 / 6."""
    effect, moved = catalogue()["gyro.bandwidth"], movement()
    tau, omega = np.array([0.004, 0.012, 0.03]), 2 * np.pi * 4
    distorted = effect.distort(moved, tau)
    for axis, each in enumerate(tau):
        _, expected, _ = lsim(([1.0], [each, 1.0]), moved.rate[:, axis], moved.t_s)
        assert_allclose(distorted[:, axis], expected, atol=1e-9 * np.abs(expected).max())
    steady = moved.with_rate(np.full_like(moved.rate, 40 * DEG))
    assert_allclose(effect.distort(steady, tau), 40 * DEG, rtol=1e-12)
    phase = np.arctan(omega * tau)
    true = np.repeat(np.sin(omega * moved.t_s)[:, None], 3, axis=1)
    late = np.cos(phase) * np.sin(omega * moved.t_s[:, None] - phase)
    back = effect.correct(late, moved.with_rate(late), tau)
    assert (np.abs(back - true)[1:-1].max(axis=0) < 1.05 * (omega * moved.dt_s) ** 2 / 6 * np.abs(late - true).max(axis=0)).all()


def test_skewed_axes_show_the_rate_of_seconds_ago():
    """Against the same movement evaluated at the shifted moments."""
    effect, moved = catalogue()["timing.axis_skew"], movement()
    seconds = np.array([0.0, 0.0031, 0.0177])
    distorted = effect.distort(moved, seconds)
    expected = np.stack([smooth(moved.t_s - shift)[:, axis] for axis, shift in enumerate(seconds)], axis=-1)
    assert_allclose(distorted, expected, atol=1e-4 * np.abs(expected).max())
    back = effect.correct(expected, moved.with_rate(expected), seconds)
    assert_allclose(back, moved.rate, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["gyro.thermal_bias", "gyro.thermal_scale"])
def test_temperature_effects_are_counted_from_the_first_temperature_of_a_thermometer(name):
    effect, moved = catalogue()[name], movement()
    assert effect.inputs == ("temperature",)
    warmer = replace(moved, temp_c=moved.temp_c + 7, first_temp_c=moved.first_temp_c + 7)
    assert_allclose(effect.columns(warmer), effect.columns(moved), atol=1e-13)


def test_a_step_is_nothing_before_its_time_and_a_drift_reaches_its_parameter_at_the_end():
    theta, moved = np.array([0.1, -0.2, 0.3]) * DEG, movement()
    early, step = catalogue()["gyro.bias_step"].variants(np.array([1.0, 4.2]))
    assert (step.id, step.shape, early.shape) == ("gyro.bias_step", {"at_s": 4.2}, {"at_s": 1.0})
    assert_allclose(step.distort(moved, theta) - moved.rate, np.outer(moved.t_s >= 4.2, theta), atol=1e-15)
    late = replace(moved, t_s=moved.t_s + 90, duration_s=100.0)
    added = catalogue()["gyro.bias_drift"].distort(late, theta) - late.rate
    assert_allclose(added, np.outer(late.t_s / 100, theta), rtol=1e-9)


def test_saturation_clips_both_ways_and_touches_nothing_below():
    moved, level = movement(), 100 * DEG
    clipped = catalogue()["gyro.saturation"].distort(moved, np.array([level]))
    np.testing.assert_array_equal(clipped, np.clip(moved.rate, -level, level))
    assert (clipped.min(), clipped.max()) == (-level, level)


def test_what_is_no_rate_effect_adds_nothing_to_the_rate():
    others = [effect for effect in catalogue().values() if effect.kind != "rate" and effect.scan is None]
    assert others
    for effect in others:
        assert not effect.columns(movement()).any(), effect.id


@pytest.mark.parametrize("size", [3, 4, 9, 10, 70])
def test_a_moving_mean_holds_the_ends_and_takes_one_more_before_where_it_is_even(size):
    values = np.random.default_rng(size).normal(size=(50, 3))
    for each in (values, values[:, 0]):
        assert_allclose(_mean(each, size / 208, 1 / 208), uniform_filter1d(each, size, axis=0, mode="nearest"), atol=1e-13)


@pytest.mark.parametrize(("f_hz", "share"), [(2.0, 0.0), (20.0, 1.0), (30.0, 0.92), (90.0, 1.0)])
def test_vibration_is_seen_with_its_energy_and_a_hand_is_not(f_hz, share):
    """One pass of the mean would turn 30 Hz upside down, and see half as much again."""
    dt_s = 1 / 208
    t = np.arange(0, 10, dt_s)
    seen = vibration(np.outer(np.sin(2 * np.pi * f_hz * t), [0.3, 0.4, 0.5]), dt_s)[200:-200].mean()
    assert seen / (np.mean([0.09, 0.16, 0.25]) / 2) == pytest.approx(share, abs=0.06)


# What it says.


@pytest.mark.parametrize("latitude", [-75, 0, 60.17])
def test_latitude_is_that_of_the_earths_rate_in_north_east_down(latitude):
    """Groves: w = Omega (cos L, 0, -sin L) in north-east-down; the table is turned about the vertical."""
    earth = EARTH_RATE_RPS * np.array([np.cos(latitude * DEG) * np.cos(2.0), np.cos(latitude * DEG) * np.sin(2.0), -np.sin(latitude * DEG)])
    assert latitude_deg(earth) == pytest.approx(latitude, abs=1e-9)


def test_a_matrix_is_told_by_its_row_and_its_columns_multiply_what_they_are_given():
    rng = np.random.default_rng(0)
    matrix, inputs = rng.normal(size=(3, 3)), rng.normal(size=(7, 3))
    assert_allclose(full(inputs) @ matrix.ravel(), inputs @ matrix.T, rtol=1e-12)
    assert_allclose(diagonal(inputs[:, 0]) @ matrix[0], np.outer(inputs[:, 0], matrix[0]), rtol=1e-12)
    told = np.array([[0.1, 0, 0], [0, 0, -0.7], [0.2, 0.3, 0]]).ravel()
    assert (largest(told), axis_of(told)) == (-0.7, "y")


# Signals with a memory.


def hand(rate_hz=208.0, length_s=40.0, began_s=0.0):
    """A still of two seconds, ten turns of three seconds about changing axes with a rest of one after each, warming up."""
    t_s = began_s + np.arange(0, length_s, 1 / rate_hz)
    since = np.clip(t_s - 2, 0, None)
    along, number = np.minimum(since % 4, 3), np.minimum(since // 4, 9).astype(int)
    axes = Rotation.random(10, random_state=3).as_matrix()[:, 0]
    rate = 90 * DEG * np.sin(np.pi * along / 3)[:, None] * axes[number]
    temp_c = 25 + 5 * -np.expm1(-np.maximum(t_s, 0) / 30)
    force = np.tile([0.3, -0.2, -0.93], (len(t_s), 1))
    return Movement(t_s, 1 / rate_hz, rate, force, temp_c, 0 * t_s, length_s, 500 * DEG, 25.0)


def test_a_lag_of_a_ramp_is_the_ramp_late_by_tau():
    """Exactly, with what is left of the beginning: dy/dt = (x - y) / tau from y(0) = 0.  It begins as if nothing had changed; what is not
    known is not known there alone; it looks back no farther than its reach; of thinned rows, as of long rests, it is that of all rows."""
    t_s, rng = np.arange(0, 60, 0.01), np.random.default_rng(0)
    assert signals.lagged(2 * t_s, 1.5, t_s) == pytest.approx(2 * (t_s - 1.5 * -np.expm1(-t_s / 1.5)), abs=1e-9)
    assert signals.lagged(np.full((50, 3), 7.0), 0.5, t_s[:50]) == pytest.approx(np.full((50, 3), 7.0), abs=1e-12)
    for values in (np.full(50, np.nan), np.where(np.arange(50) == 20, np.nan, 3.0)):
        found = signals.lagged(values, 0.1, t_s[:50])
        assert np.array_equal(np.isnan(found), np.isnan(values))
        assert found[np.isfinite(values)] == pytest.approx(3.0)
    behind, ahead = signals.lag_reach(0.5).rows(100.0)
    values, other = rng.normal(size=(2, len(t_s)))
    other[len(t_s) - behind - 1 :] = values[len(t_s) - behind - 1 :]
    assert ahead == 0
    assert abs(signals.lagged(values, 0.5, t_s)[-1] - signals.lagged(other, 0.5, t_s)[-1]) < 1e-11
    values = np.where((t_s > 20) & (t_s < 25), np.sin(t_s * 3), 0.0)
    keep = np.flatnonzero(((t_s > 19.5) & (t_s < 25.5)) | (np.arange(len(t_s)) % 100 == 0))
    assert np.abs(signals.lagged(values[keep], 2.0, t_s[keep]) - signals.lagged(values, 2.0, t_s)[keep]).max() < 1e-9


def test_the_rate_of_temperature_of_a_ramp_and_of_none():
    moved = hand()

    def slope(temp_c):
        return signals.temperature_rate(replace(moved, temp_c=temp_c))

    assert slope(25 + 0.3 * moved.t_s)[moved.t_s > 10.01] == pytest.approx(0.3, abs=1e-9)
    assert slope(np.full(len(moved.t_s), 31.0)) == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(slope(np.full(len(moved.t_s), np.nan))).all()
    behind, ahead = signals.SLOPE.rows(208.0)
    other = moved.temp_c.copy()
    other[: len(other) - behind - 1] += 7.0
    assert (ahead, slope(other)[-1]) == (0, pytest.approx(signals.temperature_rate(moved)[-1], abs=1e-9))


def test_seconds_at_rest_count_from_the_end_of_a_turn():
    moved = hand(began_s=100.0)
    t_s = moved.t_s
    turns = (t_s > 105) & (t_s < 107)
    rest = signals.seconds_at_rest(replace(moved, rate=np.where(turns[:, None], [0.0, 0.5, 0.0], [0.01, 0.02, -0.01])))
    assert rest[t_s <= 105] == pytest.approx(t_s[t_s <= 105] - 100)  # it has not turned yet
    assert not rest[turns].any()
    assert rest[t_s > 107.01] == pytest.approx(t_s[t_s > 107.01] - 107, abs=0.01)


def test_the_last_sense_stays_after_a_turn_and_a_latch_keeps_a_sign():
    moved = hand()
    sense, turning = signals.last_sense(moved), np.abs(moved.rate) > signals.TURNING_RPS
    assert not sense[moved.t_s < 2].any()
    for axis in range(3):
        last = np.maximum.accumulate(np.where(turning[:, axis], np.arange(len(turning)), -1))
        assert np.array_equal(sense[:, axis], np.where(last >= 0, np.sign(moved.rate[last, axis]), 0))
    values = np.array([0.0, 0.9, 1.1, 0.2, -0.9, -1.2, 0.0, 1.0, 3.0, -0.5])
    expected = [0, 0, 1, 1, 1, -1, -1, -1, 1, 1]
    assert signals.latched(values, 1.0).tolist() == expected
    assert signals.latched(np.outer(values, [1.0, -1.0]), 1.0).T.tolist() == [expected, [-each for each in expected]]


def test_angles_and_level_directions_by_another_program():
    """scipy's rotations, step by step, from gravity at the beginning; the angle turned about one axis is that angle."""
    moved = hand(104.0, 7.0)
    turned = signals.angle_turned(replace(moved, rate=np.outer(np.sin(moved.t_s), [1.0, 0, -2.0])))
    assert turned == pytest.approx(np.outer(1 - np.cos(moved.t_s), [1.0, 0, -2.0]), abs=2e-4)
    up = -moved.force_g[0] / np.linalg.norm(moved.force_g[0])  # the specific force at rest points against z, which is down
    first = np.cross(np.cross(up, [1.0, 0, 0]), up)
    first /= np.linalg.norm(first)
    attitude, expected = Rotation.identity(), []
    for number, rate in enumerate(moved.rate):
        if number:
            attitude *= Rotation.from_rotvec((rate + moved.rate[number - 1]) / 2 / 104)
        expected.append(attitude.inv().apply([first, np.cross(up, first)]).T)
    assert signals.level_directions(moved) == pytest.approx(np.array(expected), abs=1e-9)


@pytest.mark.parametrize("name", ["seconds_at_rest", "last_sense", "angle_turned", "level_directions", "temperature_rate"])
def test_signals_are_those_of_a_finer_grid_that_begins_before_the_log(name):
    """The simulation's: so many points for each sample, from 0.2 s before the first on."""
    signal, coarse = getattr(signals, name), hand(208.0)
    fine = hand(208.0 * 8, 40.2, began_s=-0.2)
    at = np.searchsorted(fine.t_s, coarse.t_s - 1e-9)
    differs = np.abs(signal(fine)[at] - signal(coarse)).reshape(len(at), -1).max(axis=1)
    # A threshold is crossed between two samples: then they differ for one of them.
    assert np.quantile(differs, 0.99) < 1 / 208
    assert np.mean(differs > 0.05) < 0.01


def test_angular_acceleration_is_the_same_at_any_data_rate_and_smooths_noise():
    slow, fast = (movement(hz) for hz in (104.0, 833.0))
    there = np.stack([np.interp(slow.t_s, fast.t_s, column) for column in signals.angular_acceleration(fast).T], axis=1)
    assert np.abs(signals.angular_acceleration(slow) - there).max() < 6e-3 * np.abs(there).max()
    noisy = fast.with_rate(np.random.default_rng(0).standard_normal(fast.rate.shape))
    assert signals.angular_acceleration(noisy)[20:-20].std() < 0.15 * noisy.acceleration[20:-20].std()
    jerk = signals.angular_jerk(fast)
    assert np.abs(jerk - np.gradient(np.gradient(fast.rate, fast.dt_s, axis=0), fast.dt_s, axis=0)).max() < 0.02 * np.abs(jerk).max()


# How a strong effect is taken off again.


def law(columns, size=3, **more):
    shape = (3, 3) if size == 9 else (3,)
    return Effect("mine.law", "…", Parameter("dps", shape, "dps", DEG), ("turn",), columns, str, "turn", device=NoC("a test"), **more)


def left_of(effect, dps, odr_hz=104.0):
    """Of what it adds at most."""
    moved, theta = movement(odr_hz), np.array(dps, dtype=float) * DEG
    distorted = effect.distort(moved, theta)
    back = effect.correct(distorted, moved.with_rate(distorted), theta)
    return float(np.abs(back - moved.rate).max() / np.abs(distorted - moved.rate).max())


@pytest.mark.parametrize(
    ("columns", "dps"),
    [
        (lambda m: full(np.clip(m.rate / m.fs_rps, -0.2, 0.2)), [60, -30, 50, 25, 65, -30, 50, 30, -70]),  # a third of the rate, in sum
        (lambda m: diagonal(np.tanh(m.rate / (5 * DEG))), [6, 7, 8]),  # its slope at zero is above 1
        (lambda m: diagonal(m.rate**3 / m.fs_rps**2), [-20 / DEG / 100, 30, 60]),
    ],
)
def test_a_strong_effect_is_taken_off_to_the_last_digit(columns, dps):
    assert left_of(law(columns, len(dps)), dps) < 1e-8


def test_who_looks_around_takes_the_passes_that_it_declares():
    """As many of all rows, so that a log in pieces gives the same, and the declared number is how far it looks."""

    def columns(m):
        return full(signals.lagged(m.rate / m.fs_rps, 0.05, m.t_s))

    dps, reach = np.full(9, 60.0) * np.where(np.eye(3).ravel() > 0, 1, -1), signals.lag_reach(0.05)
    three, twelve = (law(columns, 9, reach=reach, passes=passes) for passes in (None, 12))
    assert left_of(three, dps) > 2e-3
    assert left_of(twelve, dps) < 1e-4
    assert twelve.total_reach(dps).before_s == pytest.approx(4 * three.total_reach(dps).before_s)
    with pytest.raises(EffectError, match=f"passes is 99, expected a number from 1 to {MOST_PASSES}"):
        law(columns, 9, reach=Reach(1), passes=99)
    bent = law(lambda m: diagonal(np.abs(signals.angular_acceleration(m))), reach=signals.DERIVATIVE)
    assert left_of(bent, np.array([1.5e-3, -1e-3, 1.2e-3]) / DEG, 833.0) < 1e-3
