"""Every effect is the physics that its equation says, forwards, backwards and linearised."""

from dataclasses import replace

import numpy as np
import pytest
from known_effects import FS, IDS, RATE, STRONG, movement, smooth, theta_of
from scipy.signal import lsim

from session.io.units import DEG
from tinygc.effects import catalogue
from tinygc.effects.movement import vibration


def test_every_rate_effect_of_theirs_is_in_these_tests():
    assert {name for name in IDS if catalogue()[name].kind == "rate"} == set(RATE)


@pytest.mark.parametrize("name", RATE)
def test_undoing_it_gives_the_true_rate_back(name):
    """In shares of what the effect does at most; away from the ends.  At 208 Hz."""
    effect, moved = catalogue()[name], movement(208.0)
    theta = theta_of(effect)
    distorted = effect.distort(moved, theta)
    done = np.abs(distorted - moved.rate).max()
    assert done > 0.05 * DEG
    back = effect.correct(distorted, moved.with_rate(distorted), theta)
    assert np.abs(back - moved.rate)[50:-50].max() < STRONG[name][1] * done


@pytest.mark.parametrize("name", RATE)
def test_without_parameters_it_changes_nothing(name):
    effect, moved = catalogue()[name], movement()
    zero = np.zeros(effect.parameter.size)
    np.testing.assert_allclose(effect.distort(moved, zero), moved.rate, atol=1e-15)
    np.testing.assert_allclose(effect.correct(moved.rate, moved, zero), moved.rate, atol=1e-15)


@pytest.mark.parametrize("name", RATE)
def test_columns_are_the_derivative_of_what_it_does(name):
    """One-sided finite differences from zero: a lag is never negative.  At 3332 Hz: a lag far below the period is a backward difference."""
    effect, moved = catalogue()[name], movement(3332.0)
    size, step = effect.parameter.size, 1e-4 * effect.parameter.plausible
    numeric = np.stack([(effect.distort(moved, step * e) - moved.rate) / step for e in np.eye(size)], axis=-1)
    columns = effect.columns(moved)
    assert columns.shape == (*moved.rate.shape, size)
    greatest = np.abs(columns).max(axis=(0, 1))
    assert (greatest > 0).all()
    assert (np.abs(numeric - columns)[50:-50].max(axis=(0, 1)) < 5e-3 * greatest).all()


@pytest.mark.parametrize("name", RATE)
def test_correcting_is_the_inverse_of_distorting_to_first_order(name):
    """The slope that the refit uses: minus the columns."""
    effect, moved = catalogue()[name], movement(833.0)
    size, step = effect.parameter.size, 1e-4 * effect.parameter.plausible
    numeric = np.stack([(effect.correct(moved.rate, moved, step * e) - moved.rate) / step for e in np.eye(size)], axis=-1)
    columns = effect.columns(moved)
    assert (np.abs(numeric + columns)[50:-50].max(axis=(0, 1)) < 5e-3 * np.abs(columns).max(axis=(0, 1))).all()


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
    np.testing.assert_allclose(added, what(moved, value), rtol=1e-9, atol=1e-13)


def test_angular_acceleration_multiplies_the_rates_derivative():
    """The movement's own derivative by finer differences than the effect has."""
    effect, moved = catalogue()["gyro.angular_acceleration"], movement(833.0)
    small = 1e-4
    slope = (smooth(moved.t_s + small) - smooth(moved.t_s - small)) / (2 * small)
    matrix = np.array(STRONG[effect.id][0])
    added = effect.distort(moved, matrix.ravel()) - moved.rate
    np.testing.assert_allclose(added, slope @ matrix.T, atol=1e-3 * np.abs(added).max())


@pytest.mark.parametrize("odr_hz", [104.0, 208.0, 833.0])
def test_bandwidth_is_the_first_order_filter_of_scipy(odr_hz):
    """lsim with a linear input between the samples (first-order hold) integrates the same equation."""
    effect, moved = catalogue()["gyro.bandwidth"], movement(odr_hz)
    theta = np.array([0.004, 0.012, 0.03])
    distorted = effect.distort(moved, theta)
    for axis, tau in enumerate(theta):
        _, expected, _ = lsim(([1.0], [tau, 1.0]), moved.rate[:, axis], moved.t_s)
        np.testing.assert_allclose(distorted[:, axis], expected, atol=1e-9 * np.abs(expected).max())


def test_a_lag_starts_at_rest_wherever_the_rate_stands():
    effect, moved = catalogue()["gyro.bandwidth"], movement()
    steady = moved.with_rate(np.full_like(moved.rate, 40 * DEG))
    np.testing.assert_allclose(effect.distort(steady, np.array([0.004, 0.012, 0.03])), 40 * DEG, rtol=1e-12)


@pytest.mark.parametrize("odr_hz", [104.0, 208.0])
def test_a_lag_is_undone_at_the_rates_of_a_hand(odr_hz):
    """A steady sine of 4 Hz, a hand's tremor, that a first-order filter has made smaller by cos(phase) and late by phase.

    Central differences are short of the derivative by (2 pi f dt)^2 / 6.
    """
    effect, moved = catalogue()["gyro.bandwidth"], movement(odr_hz)
    tau, omega = np.array([0.004, 0.012, 0.02]), 2 * np.pi * 4
    phase = np.arctan(omega * tau)
    true = np.repeat(np.sin(omega * moved.t_s)[:, None], 3, axis=1)
    late = np.cos(phase) * np.sin(omega * moved.t_s[:, None] - phase)
    back = effect.correct(late, moved.with_rate(late), tau)
    lost = np.abs(late - true).max(axis=0)
    assert (np.abs(back - true)[1:-1].max(axis=0) < 1.05 * (omega / odr_hz) ** 2 / 6 * lost).all()


def test_skewed_axes_show_the_rate_of_seconds_ago():
    """Against the same movement evaluated at the shifted moments."""
    effect, moved = catalogue()["timing.axis_skew"], movement()
    seconds = np.array([0.0, 0.0031, 0.0177])
    distorted = effect.distort(moved, seconds)
    expected = np.stack([smooth(moved.t_s - shift)[:, axis] for axis, shift in enumerate(seconds)], axis=-1)
    np.testing.assert_allclose(distorted, expected, atol=1e-4 * np.abs(expected).max())
    back = effect.correct(expected, moved.with_rate(expected), seconds)
    np.testing.assert_allclose(back, moved.rate, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["gyro.thermal_bias", "gyro.thermal_scale"])
def test_temperature_effects_are_nothing_at_the_first_temperature(name):
    """And need a thermometer."""
    effect, moved = catalogue()[name], movement()
    assert effect.inputs == ("temperature",)
    cold = replace(moved, temp_c=np.full_like(moved.temp_c, moved.first_temp_c))
    np.testing.assert_array_equal(effect.distort(cold, theta_of(effect)), moved.rate)
    warmer = replace(moved, temp_c=moved.temp_c + 7, first_temp_c=moved.first_temp_c + 7)
    np.testing.assert_allclose(effect.columns(warmer), effect.columns(moved), atol=1e-13)


def test_a_step_is_nothing_before_its_time_and_itself_afterwards():
    (effect,) = catalogue()["gyro.bias_step"].variants(np.array([4.2]))
    assert effect.id == "gyro.bias_step"
    assert effect.shape == {"at_s": 4.2}
    moved = movement()
    added = effect.distort(moved, np.array([0.1, -0.2, 0.3]) * DEG) - moved.rate
    np.testing.assert_array_equal(added[moved.t_s < 4.2], 0)
    np.testing.assert_allclose(added[moved.t_s >= 4.2], np.tile(np.array([0.1, -0.2, 0.3]) * DEG, ((moved.t_s >= 4.2).sum(), 1)), rtol=1e-9)
    assert "4 s" in effect.describe(np.array([0.1, -0.2, 0.3]) * DEG)


def test_a_step_is_scanned_at_every_time_that_is_asked_for():
    variants = catalogue()["gyro.bias_step"].variants(np.array([1.0, 5.0, 9.0]))
    counts = [int(effect.columns(movement())[:, 0, 0].sum()) for effect in variants]
    t_s = movement().t_s
    assert counts == [int((t_s >= at).sum()) for at in (1, 5, 9)]


def test_drift_reaches_its_parameter_at_the_end_of_the_session():
    effect, moved = catalogue()["gyro.bias_drift"], movement()
    late = replace(moved, t_s=moved.t_s + 90, duration_s=100.0)
    theta = np.array([0.1, 0.2, -0.3]) * DEG
    added = effect.distort(late, theta) - late.rate
    np.testing.assert_allclose(added[-1], theta, rtol=2e-4)
    np.testing.assert_allclose(added[0], 0.9 * theta, rtol=1e-9)


def test_saturation_clips_both_ways_and_touches_nothing_below():
    effect, moved = catalogue()["gyro.saturation"], movement()
    level = 100 * DEG
    clipped = effect.distort(moved, np.array([level]))
    inside = np.abs(moved.rate) <= level
    assert not inside.all()
    np.testing.assert_array_equal(clipped[inside], moved.rate[inside])
    np.testing.assert_array_equal(clipped[~inside], level * np.sign(moved.rate[~inside]))


@pytest.mark.parametrize("name", sorted(set(IDS) - set(RATE)))
def test_what_is_no_rate_effect_adds_nothing_to_the_rate(name):
    effect, moved = catalogue()[name], movement()
    columns = effect.columns(moved)
    assert columns.shape == (*moved.rate.shape, effect.parameter.size)
    assert not columns.any()


@pytest.mark.parametrize("dt_s", [1 / 208, 1 / 416])
@pytest.mark.parametrize(("f_hz", "share"), [(2.0, 0.0), (20.0, 1.0), (25.0, 0.95), (30.0, 0.92), (45.0, 0.98), (70.0, 1.0), (90.0, 1.0)])
def test_vibration_is_seen_with_its_energy_and_a_hand_is_not(f_hz, share, dt_s):
    """One pass of the mean would turn 30 Hz upside down, and see half as much again."""
    t = np.arange(0, 10, dt_s)
    seen = vibration(np.outer(np.sin(2 * np.pi * f_hz * t), [0.3, 0.4, 0.5]), dt_s)[200:-200].mean()
    assert seen / (np.mean([0.09, 0.16, 0.25]) / 2) == pytest.approx(share, abs=0.06)
