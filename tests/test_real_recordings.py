"""How ``benchmarks/real_recordings.py`` counts: wrong names by the truth, what was missed, faults that are not expected."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))

from real_recordings import missed, row, said_wrongly, summary

TRUTH = {
    "none": {"effects": {}},
    "skew": {"effects": {"timing.axis_skew": {}}},
    "outside": {"effects": {"outside.magnetic": {}}},
}


def result(set_name, name, *claims, before=0.5, after=0.2):
    """claims: each an id, or an id with those that cannot be told from it."""
    effects = [{"id": claim, "equivalent": []} if isinstance(claim, str) else {"id": claim[0], "equivalent": claim[1:]} for claim in claims]
    closure = {"before": before, "after": after, "floor": 0.1}
    explained = {"verdict": "partly_explained", "effects": effects, "fit": {"holdout_closure_rms_deg": closure}}
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


def test_the_lines_below_the_table_count():
    refused = {"set": "mikov", "name": "imu2", "explain": None, "refused": "no stills", "seconds": 1.0}
    results = [result("mikov", "imu0", "data.glitches"), result("mikov", "imu4", after=0.6), refused]
    for each in results:
        each |= {"said_wrongly": said_wrongly(each, TRUTH), "missed": missed(each, TRUTH)}
    assert summary(results) == ["- mikov: 3 recordings, 1 refused; after ≤ before in 1 of 2; glitches or dropped samples claimed: 1."]
    assert row(results[2])[1] == "refused: no stills"
    assert row(results[0])[3] == "0.500 → 0.200"
