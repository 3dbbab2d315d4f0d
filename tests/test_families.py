"""Slow motions of the zero-rate offset are one statement with its alternatives, where the recording does not tell them apart."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG

from tinygc.effects import Movement, catalogue
from tinygc.explanation.claims import Claim
from tinygc.explanation.families import SLOW_ZERO, alternatives, shares_of, slow_zero

STATE = SimpleNamespace(claims=())


def twin_of(thermometer=False, seconds=100):
    t = np.arange(0.0, seconds, 1.0)
    temp = np.linspace(25, 30, len(t)) if thermometer else np.full(len(t), np.nan)
    zero = np.zeros((len(t), 3))
    more = {"vibration_g2": np.zeros(len(t)), "first_temp_c": 25.0}
    return SimpleNamespace(
        movements=[Movement(t_s=t, rate=zero, force_g=zero, temp_c=temp, dt_s=1.0, fs_rps=1.0, duration_s=seconds, **more)]
    )


def claim(name, parameters, probability, rivals):
    effect = catalogue()[name]
    return Claim(effect, parameters, {}, 1e-6, "says", probability=probability, rivals=rivals)


def drift(probability, **rivals):
    named = {"warm": "unknown.warm_up", "step": "gyro.bias_step", "asymmetry": "gyro.scale_asymmetry"}
    return claim("gyro.bias_drift", {"dps_over_log": [0.05, -0.2, 0.1]}, probability, {named[k]: p for k, p in rivals.items()})


def test_the_size_is_from_lowest_to_highest_on_the_axis_where_it_is_most():
    found = slow_zero(twin_of(), [drift(0.9)], STATE)
    assert found.size_rps == pytest.approx(0.2 * DEG * 0.99)  # the last sample is a hundredth before the end
    assert found.axis == 1
    step = slow_zero(twin_of(), [drift(0.9), claim("gyro.bias_step", {"dps": [0.0, 0.3, 0.0]}, 0.9, {})], STATE)
    assert step.size_rps == pytest.approx(0.298 * DEG)  # from -0.098 just before the jump to 0.2 just after it


def test_alternatives_share_the_familys_probability_without_others():
    found = slow_zero(twin_of(), [drift(0.6, warm=0.2, asymmetry=0.2)], STATE)
    assert found.shares == pytest.approx({"gyro.bias_drift": 0.75, "unknown.warm_up": 0.25})
    assert "most likely a steady drift or slow warm-up (0.75 among those weighed), or a warm-up within the session (0.25)" in found.words
    assert found.words.endswith("temperature was not recorded")
    assert not slow_zero(twin_of(thermometer=True), [drift(0.6, warm=0.2)], STATE).words.endswith("not recorded")


def test_one_with_nearly_all_of_the_probability_is_named_alone():
    assert alternatives({"unknown.warm_up": 0.95, "gyro.bias_step": 0.05}, True) == "as a warm-up within the session (0.95)"
    assert (
        alternatives({"unknown.warm_up": 0.94, "gyro.bias_step": 0.06}, True)
        == "most likely a warm-up within the session (0.94), or a jump (0.06)"
    )
    assert (
        alternatives({"unknown.warm_up": 0.94, "gyro.bias_step": 0.04, "gyro.bias_drift": 0.02}, True)
        == "most likely a warm-up within the session (0.94)"
    )


def test_what_temperature_did_is_not_weighed_without_a_thermometer():
    assert alternatives({"gyro.bias_drift": 1.0}, True) == "as a steady drift or slow warm-up (1.00)"
    said = alternatives({"gyro.bias_drift": 1.0}, False)
    assert said == "as a steady drift or slow warm-up (1.00 among those weighed); temperature was not recorded"


def test_a_thermometer_closes_the_question_where_one_member_has_nearly_all():
    assert not slow_zero(twin_of(thermometer=True), [drift(0.95, warm=0.05)], STATE).is_open
    assert slow_zero(twin_of(thermometer=True), [drift(0.94, warm=0.06)], STATE).is_open
    assert slow_zero(twin_of(), [drift(0.95, warm=0.05)], STATE).is_open


def test_shares_are_sorted_and_sum_to_one():
    assert list(shares_of({"a": 1.0, "b": 3.0}).items()) == [("b", 0.75), ("a", 0.25)]


def test_other_effects_have_no_family():
    other = claim("gyro.scale_asymmetry", {"half_difference": [0.0, 0.0, 0.0]}, 1.0, {"gyro.bias_drift": 0.1})
    assert slow_zero(twin_of(), [other], STATE) is None


def test_no_member_claims_to_know_a_temperature_that_was_not_recorded():
    for name in SLOW_ZERO.keys() & catalogue().keys():
        if "temperature" not in catalogue()[name].inputs:
            assert "temperature" not in catalogue()[name].describe(np.ones(3))
