"""Pictures that show the cause: what each turn asks for by itself lies on the law that was put in, and what is left lies about zero."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from known_effects import movement

from session.base.units import DEG
from tinygc.effects import catalogue
from tinygc.noise.twin import Variable
from tinygc.reporting.pictures import in_turns
from tinygc.reporting.pictures.values import ahead_of, at_constant

FS, FIRST_C = 500.0, 25.0  #: dps, degC


@pytest.mark.parametrize(
    ("name", "variable", "at", "one"),
    [
        ("gyro.scale_nonlinearity", Variable("rate"), 250.0, 0.25),
        ("gyro.scale_asymmetry", Variable("rate"), -30.0, -1.0),
        ("gyro.thermal_scale", Variable("temperature"), FIRST_C + 3, 3.0),
        ("gyro.vibration_rectification", Variable("vibration"), 0.2, 0.2),
        ("gyro.thermal_bias", Variable("temperature"), FIRST_C + 3, 3.0),
        ("gyro.g2_sensitivity", Variable("attitude", 1), -0.5, 0.25),
        ("gyro.bias_drift", Variable("time"), 30.0, 0.5),
    ],
)
def test_a_law_at_a_constant_movement_is_its_equation(name, variable, at, one):
    like = replace(movement(), first_temp_c=FIRST_C, fs_rps=FS * DEG, duration_s=60.0)
    share = name in ("gyro.scale_nonlinearity", "gyro.scale_asymmetry", "gyro.thermal_scale")
    found = at_constant(catalogue()[name], np.array([0.0, 1e-3, 0.0]), like, variable, 1, np.array([at]), per_rate=share)
    assert found == pytest.approx([1e-3 * one], rel=1e-9)


def test_what_turns_miss_is_seen_along_what_an_effect_moves_them_by():
    """3, 4, 5; the largest angle's sign; a turn that it does not move; sigmas of two angles apart."""
    own, missed = np.array([[3.0, -4.0], [-0.6, 0.0], [0.0, 0.0]]), np.array([[1.0, 2.0], [5.0, 7.0], [1.0, 1.0]])
    signed, (along,), sigma = ahead_of(own, [missed], np.array([[1.0, 2.0], [3.0, 9.0], [1.0, 1.0]]))
    assert signed == pytest.approx([-5.0, -0.6, 0.0])
    assert along == pytest.approx([-0.6 + 1.6, 5.0, 0.0])
    assert sigma == pytest.approx([np.hypot(0.6, 1.6), 3.0, 0.0])


def test_the_closure_over_the_data_rate_leads_to_the_native_one():
    """Made-up: motion that closes by 0.4° at 100 Hz, and by the square of the interval."""
    rates = 100.0 / np.arange(1, 5)
    told = {"rates_hz": rates, "closure_deg": 0.4 * (rates / 100) ** -2.0, "exponent": -2.0, "predicted_deg": 0.4}
    explained = SimpleNamespace(proof=SimpleNamespace(floor_rms=0.02 * DEG))
    panel = in_turns.over_rate(explained, SimpleNamespace(parameters=told))
    assert panel.x.log
    assert panel.y.log
    (line,), (thinned,) = ([each for each in panel.marks if word in each.name] for word in ("motion", "left out"))
    assert thinned.x == pytest.approx(rates[1:])
    assert line.y == pytest.approx([0.4, *thinned.y])
