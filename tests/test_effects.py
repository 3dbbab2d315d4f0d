"""The catalogue: every effect that docs/formats.md lists, its parameters, units and sentence."""

import re

import numpy as np
import pytest
from known_effects import IDS, PARAMETERS, theta_of

from session.io.units import DEG, EARTH_RATE_RPS
from tinygc.effects import axis_of, catalogue, diagonal, full, largest
from tinygc.effects.entries.earth_rotation import latitude_deg


def test_none_of_them_is_lost_and_each_has_its_own_name():
    """More may be there: test_formats_page.py holds the whole catalogue against docs/formats.md, test_effect_checks.py proves it."""
    assert set(IDS) <= set(catalogue())
    assert all(name == effect.id for name, effect in catalogue().items())


@pytest.mark.parametrize("name", IDS)
def test_each_says_what_it_is(name):
    effect = catalogue()[name]
    assert effect.equation.strip()
    assert effect.discriminating_motion.strip()
    assert effect.conditions is not None
    assert effect.kind in ("rate", "register", "force", "earth")
    assert effect.observable_in
    assert set(effect.observable_in) <= {"still", "turn", "reference", "timing"}


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
    says = effect.describe(theta)
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
    assert words in effect.describe(theta_of(effect, value))


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
