"""The catalogue's first nineteen effects, each the physics that its equation says, forwards, backwards and linearised."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.signal import lsim

from session.common.units import DEG, EARTH_RATE_RPS, MG
from tinygc.effects import Effect, Movement, axis_of, catalogue, diagonal, full, largest
from tinygc.effects.entries.earth_rotation import latitude_deg

IDS = (
    "gyro.g_sensitivity",
    "gyro.g2_sensitivity",
    "gyro.angular_acceleration",
    "gyro.scale_nonlinearity",
    "gyro.scale_asymmetry",
    "gyro.saturation",
    "gyro.thermal_bias",
    "gyro.thermal_scale",
    "gyro.bias_drift",
    "gyro.bias_step",
    "gyro.vibration_rectification",
    "gyro.bandwidth",
    "timing.axis_skew",
    "timing.gyro_accel_offset",
    "timing.dropped_samples",
    "data.glitches",
    "reference.accelerometer",
    "reference.not_still",
    "earth.rotation",
)
#: docs/formats.md, the table of effects: JSON name, shape, and the size of one unit in SI
PARAMETERS = {
    "gyro.g_sensitivity": ("matrix_dps_per_g", (3, 3), DEG),
    "gyro.g2_sensitivity": ("dps_per_g2", (3,), DEG),
    "gyro.angular_acceleration": ("cross", (3, 3), 1),
    "gyro.scale_nonlinearity": ("cubic_at_fs", (3,), 1),
    "gyro.scale_asymmetry": ("half_difference", (3,), 1),
    "gyro.saturation": ("dps", (), DEG),
    "gyro.thermal_bias": ("dps_per_c", (3,), DEG),
    "gyro.thermal_scale": ("per_c", (3,), 1),
    "gyro.bias_drift": ("dps_over_log", (3,), DEG),
    "gyro.bias_step": ("dps", (3,), DEG),
    "gyro.vibration_rectification": ("dps_per_g2", (3,), DEG),
    "gyro.bandwidth": ("tau_s", (3,), 1),
    "timing.axis_skew": ("seconds", (3,), 1),
    "timing.gyro_accel_offset": ("seconds", (), 1),
    "timing.dropped_samples": ("length", (), 1),
    "data.glitches": ("samples", (), 1),
    "reference.accelerometer": ("bias_mg", (3,), MG),
}
#: a strong one of each, as docs/formats.md would have it; and how much of what it does may be left when it is undone
STRONG = {
    "gyro.g_sensitivity": ([[0.05, -0.03, 0.02], [0.04, 0.06, -0.05], [-0.07, 0.02, 0.03]], 1e-12),
    "gyro.g2_sensitivity": ([0.08, -0.07, 0.13], 1e-12),
    # The derivative of a derivative, three times: what is left is the fourth power of an effect of some per cent.
    "gyro.angular_acceleration": ([[0.0036, 0.002, -0.002], [0.001, 0.002, 0.0008], [0.0007, 0.0006, -0.0007]], 1e-3),
    "gyro.scale_nonlinearity": ([0.026, -0.013, 0.018], 1e-3),
    "gyro.scale_asymmetry": ([-0.002, 0.0016, -0.0033], 1e-6),
    "gyro.thermal_bias": ([0.014, -0.037, 0.019], 1e-12),
    "gyro.thermal_scale": ([0.001, 0.0008, -0.0008], 1e-5),
    "gyro.bias_drift": ([0.28, -0.15, 0.23], 1e-12),
    "gyro.bias_step": ([0.13, -0.08, 0.24], 1e-12),
    "gyro.vibration_rectification": ([-1.1, 1.4, -2.2], 1e-12),
    # Central differences: a quarter per cent of a derivative at 2 Hz and 104 Hz.
    "gyro.bandwidth": ([0.004, 0.012, 0.008], 5e-3),
    "timing.axis_skew": ([0.0, 0.008, 0.004], 1e-4),
}
RATE = sorted(STRONG)
FS = 500 * DEG


def smooth(t_s: np.ndarray) -> np.ndarray:
    """Rates (N, 3) rad/s of a hand: at rest, six seconds of movement up to some 200 dps and 2 Hz, at rest again.

    Any t_s.  The window is a B-spline of degree 7, six times differentiable.
    """
    window = BSpline.basis_element(np.linspace(2, 8, 9), extrapolate=False)
    waves = np.stack([np.sin(2 * np.pi * f * t_s + p) for f, p in ((0.5, 0.3), (0.9, 1.1), (2.0, 2.0))], axis=-1)
    return 500 * DEG * np.nan_to_num(window(t_s))[:, None] * waves


def movement(odr_hz: float = 104.0, stop_s: float = 10.0) -> Movement:
    t_s = np.arange(0, stop_s, 1 / odr_hz)
    turn = np.stack([np.sin(0.7 * t_s), np.cos(0.7 * t_s) * np.sin(0.4 * t_s), -np.cos(0.7 * t_s) * np.cos(0.4 * t_s)], axis=-1)
    vibration = 0.2 * np.exp(-((t_s - 5) ** 2))
    return Movement(t_s, 1 / odr_hz, smooth(t_s), turn, 25 + 0.8 * t_s, vibration, stop_s, FS, 25.0)


def theta_of(effect: Effect, value=None) -> np.ndarray:
    return np.ravel(STRONG[effect.id][0] if value is None else value) * effect.parameter.si


# The catalogue


def test_none_of_them_is_lost_and_each_has_its_own_name():
    """More may be there: test_formats_page.py holds the whole catalogue against docs/formats.md, test_effect_checks.py proves it."""
    assert set(IDS) <= set(catalogue())
    assert all(name == effect.id for name, effect in catalogue().items())


def test_the_list_of_ids_is_that_of_formats(shared):
    assert set(re.findall(r"^\| `([a-z]+\.[a-z0-9_]+)` \|", (shared / "FORMATS.md").read_text(encoding="utf-8"), re.M)) == set(IDS)


@pytest.mark.parametrize("name", IDS)
def test_each_says_what_it_is(name):
    effect = catalogue()[name]
    assert effect.equation.strip()
    assert effect.splits.strip()
    assert effect.regime is not None
    assert effect.kind in ("rate", "register", "force", "earth")
    assert effect.seen_in
    assert set(effect.seen_in) <= {"still", "turn", "reference", "timing"}


@pytest.mark.parametrize("name", sorted(PARAMETERS))
def test_parameters_have_the_names_shapes_and_units_of_formats(name):
    parameter = catalogue()[name].parameter
    assert (parameter.name, parameter.shape) == PARAMETERS[name][:2]
    assert parameter.si == pytest.approx(PARAMETERS[name][2], rel=1e-12)
    assert parameter.size == int(np.prod(parameter.shape))


@pytest.mark.parametrize("name", IDS)
def test_it_says_one_sentence_with_a_number(name):
    effect = catalogue()[name]
    if name == "earth.rotation":
        theta = EARTH_RATE_RPS * np.array([0.5, 0.1, -0.8])
    else:
        theta = np.linspace(0.3, 1, effect.parameter.size) * effect.parameter.plausible
    if effect.scan:
        effect = effect.variants(np.array([12.0]))[0]
    says = effect.says(theta)
    assert re.search(r"\d", says)
    assert "\n" not in says
    assert not re.search(r"[.!?] +[A-Z]", says), says  # one sentence
    assert "nan" not in says
    assert len(says) < 200


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("gyro.g_sensitivity", np.diag([0, 0.05, 0.01]), "0.050 dps per g (most on y)"),
        ("gyro.thermal_bias", [0.001, 0, -0.02], "0.0200 dps per °C on z"),
        ("gyro.thermal_scale", [3e-4, 0, 0], "300 ppm per °C on x"),
        ("gyro.scale_asymmetry", [0, 0.002, 0], "0.40 % on y"),
        ("gyro.scale_nonlinearity", [0, 0, -0.02], "read less than slow ones (cubic, 2.00 % at full scale on z"),
        ("gyro.bandwidth", [0, 0.012, 0], "the y axis answers 12.0 ms late"),
        ("timing.axis_skew", [0, 0.001, 0.004], "z 4.0 ms after the first"),
        ("timing.gyro_accel_offset", [-0.015], "15.0 ms before the accelerometer"),
        ("gyro.saturation", [217], "beyond 217 dps"),
        ("reference.accelerometer", [1, -9, 2], "9.0 mg on y"),
        ("timing.dropped_samples", [9], "9 samples at a time"),
    ],
)
def test_the_sentence_has_the_right_number_unit_and_axis(name, value, words):
    effect = catalogue()[name]
    assert words in effect.says(theta_of(effect, value))


@pytest.mark.parametrize("latitude", [-75, -10, 0, 31.03, 60.17, 90])
def test_latitude_is_that_of_the_earths_rate_in_north_east_down(latitude):
    """Groves: w = Omega (cos L, 0, -sin L) in north-east-down; the table is turned about the vertical."""
    earth = EARTH_RATE_RPS * np.array([np.cos(latitude * DEG) * np.cos(2.0), np.cos(latitude * DEG) * np.sin(2.0), -np.sin(latitude * DEG)])
    assert latitude_deg(earth) == pytest.approx(latitude, abs=1e-9)


def test_a_matrix_is_told_by_its_row_and_its_greatest_entry():
    matrix = np.array([[0.1, 0, 0], [0, 0, -0.7], [0.2, 0.3, 0]])
    assert largest(matrix.ravel()) == -0.7
    assert axis_of(matrix.ravel()) == "y"


def test_columns_of_a_matrix_multiply_what_they_are_given():
    rng = np.random.default_rng(0)
    matrix, inputs = rng.normal(size=(3, 3)), rng.normal(size=(7, 3))
    np.testing.assert_allclose(full(inputs) @ matrix.ravel(), inputs @ matrix.T, rtol=1e-12)
    np.testing.assert_allclose(diagonal(inputs) @ matrix[0], inputs * matrix[0], rtol=1e-12)
    np.testing.assert_allclose(diagonal(inputs[:, 0]) @ matrix[0], np.outer(inputs[:, 0], matrix[0]), rtol=1e-12)


# The physics


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


def test_asymmetry_is_even_and_nonlinearity_is_odd():
    moved = movement()
    other = moved.with_rate(-moved.rate)
    for name, sign in (("gyro.scale_asymmetry", 1), ("gyro.scale_nonlinearity", -1), ("gyro.thermal_scale", -1)):
        effect = catalogue()[name]
        theta = theta_of(effect)
        there, back = (effect.distort(m, theta) - m.rate for m in (moved, other))
        np.testing.assert_allclose(back, sign * there, rtol=1e-12, atol=1e-14)
    there, back = (catalogue()["gyro.g2_sensitivity"].columns(m) for m in (moved, replace(moved, force_g=-moved.force_g)))
    np.testing.assert_array_equal(there, back)
    there, back = (catalogue()["gyro.g_sensitivity"].columns(m) for m in (moved, replace(moved, force_g=-moved.force_g)))
    np.testing.assert_array_equal(there, -back)


def test_asymmetry_is_the_difference_of_two_sensitivities():
    """IEEE 528: half the difference between the scale of positive and of negative turns."""
    effect, moved = catalogue()["gyro.scale_asymmetry"], movement()
    half = np.array([0.001, -0.002, 0.003])
    scale = effect.distort(moved, half)[moved.rate != 0] / moved.rate[moved.rate != 0]
    axis = np.broadcast_to(np.arange(3), moved.rate.shape)[moved.rate != 0]
    positive = moved.rate[moved.rate != 0] > 0
    for i in range(3):
        np.testing.assert_allclose(scale[(axis == i) & positive], 1 + half[i], rtol=1e-9)
        np.testing.assert_allclose(scale[(axis == i) & ~positive], 1 - half[i], rtol=1e-9)


def test_the_cubic_is_its_parameter_at_full_scale():
    effect = catalogue()["gyro.scale_nonlinearity"]
    moved = movement().with_rate(np.full((len(movement().t_s), 3), FS))
    np.testing.assert_allclose(effect.distort(moved, np.array([0.01, 0.02, -0.03])) / FS, np.tile([1.01, 1.02, 0.97], (len(moved.t_s), 1)))


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
    assert "4 s" in effect.says(np.array([0.1, -0.2, 0.3]) * DEG)


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
