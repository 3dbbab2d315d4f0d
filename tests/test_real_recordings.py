"""How ``benchmarks/real_recordings.py`` counts: wrong names by the truth, what was missed, faults that are not expected."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from real_recordings_page import is_predicted, missed, said_wrongly

TRUTH = {
    "none": {"effects": {}},
    "skew": {"effects": {"timing.axis_skew": {}}},
    "outside": {"effects": {"outside.magnetic": {}}},
}


def claim(name, *equivalent, probability=0.97, predicted_deg=None):
    parameters = {} if predicted_deg is None else {"predicted_deg": predicted_deg}
    return {"id": name, "equivalent": list(equivalent), "probability": probability, "parameters": parameters}


def result(set_name, name, *claims, before=0.5, after=0.2, findings=()):
    """claims: each an id, an id with those that cannot be told from it, or an entry."""
    effects = [each if isinstance(each, dict) else claim(each) if isinstance(each, str) else claim(*each) for each in claims]
    closure = {"before": before, "after": after, "floor": 0.1}
    explained = {
        "verdict": "partly_explained",
        "effects": effects,
        "findings": [claim(each) for each in findings],
        "fit": {"holdout_closure_rms_deg": closure},
    }
    return {"set": set_name, "name": name, "explain": explained, "refused": None, "seconds": 1.0}


@pytest.mark.parametrize(
    ("name", "claims", "wrong", "not_named"),
    [
        ("none", ["gyro.g_sensitivity"], [], []),
        ("none", ["gyro.bias_step"], ["gyro.bias_step"], []),
        ("skew", ["timing.axis_skew", "gyro.g_sensitivity"], [], []),
        ("skew", [["gyro.bandwidth", "timing.axis_skew"]], [], []),
        ("skew", ["gyro.bandwidth"], ["gyro.bandwidth"], ["timing.axis_skew"]),
        ("skew", [], [], ["timing.axis_skew"]),
        ("outside", ["unknown.slow_bias"], [], []),
        ("outside", ["gyro.thermal_bias"], ["gyro.thermal_bias"], []),
    ],
)
def test_names_are_held_against_what_was_injected(name, claims, wrong, not_named):
    found = result("injected", name, *claims)
    assert said_wrongly(found, TRUTH) == wrong
    assert missed(found, TRUTH) == not_named


def test_real_sets_have_no_truth_but_no_faults_of_the_log_either():
    assert said_wrongly(result("mimu", "e1u0", "data.glitches", "gyro.bandwidth"), TRUTH) == ["data.glitches"]
    assert said_wrongly(result("xsens", "none", "data.glitches"), TRUTH) == []
    assert missed(result("mimu", "skew"), TRUTH) == []


def test_undersampling_is_right_within_a_factor_of_the_excess_over_the_floor():
    # sqrt(0.2**2 - 0.1**2) is 0.173
    told = [is_predicted(result("mimu", "e1u0", claim("motion.undersampled", predicted_deg=deg))) for deg in (0.11, 0.12, 0.25, 0.27)]
    assert told == [False, True, True, False]
    assert is_predicted(result("mimu", "e1u0")) is None
