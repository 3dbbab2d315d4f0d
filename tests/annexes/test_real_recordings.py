"""How ``benchmarks/real_recordings.py`` counts and prints: wrong names by the truth, what was missed, faults that are not expected."""

import sys
from pathlib import Path

import pytest
from test_explain_truth import write

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import real_recordings
from real_recordings_page import HEADER, PREFACE, is_predicted, missed, page, row, said_wrongly, summary

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


REFUSED = {"set": "mikov", "name": "imu2", "explain": None, "refused": "no stills", "seconds": 1.0}


def test_a_row_has_names_with_their_probability_stand_ins_shapes_and_what_undersampling_predicts():
    undersampled = claim("motion.undersampled", probability=0.996, predicted_deg=0.404)
    ambiguous = claim("gyro.bias_step", "unknown.periodic", "gyro.bias_drift", probability=0.894)
    told = result("mimu", "e1u0", undersampled, ambiguous, "unknown.slow_bias", findings=("unknown.curve_over_rate",))
    assert row(told) == (
        "mimu/e1u0",
        "partly_explained",
        "`motion.undersampled` > 0.99 (0.40°), `gyro.bias_step` 0.89 or `unknown.periodic` or `gyro.bias_drift`",
        "`unknown.slow_bias`, `unknown.curve_over_rate`",
        "0.500 → 0.200",
        "0.100",
    )
    assert row(result("xsens", "xsens"))[:4] == ("xsens", "partly_explained", "–", "–")
    assert row(REFUSED) == ("mikov/imu2", "refused: no stills", "–", "–", "–", "–")


@pytest.mark.parametrize(("predicted_deg", "right"), [(0.11, False), (0.12, True), (0.25, True), (0.27, False)])
def test_undersampling_is_right_within_a_factor_of_the_excess_over_the_floor(predicted_deg, right):
    # sqrt(0.2**2 - 0.1**2) is 0.173
    assert is_predicted(result("mimu", "e1u0", claim("motion.undersampled", predicted_deg=predicted_deg))) is right
    assert is_predicted(result("mimu", "e1u0", claim("motion.undersampled", predicted_deg=predicted_deg), after=0.1)) is False
    assert is_predicted(result("mimu", "e1u0")) is None


def test_the_lines_below_the_table_count():
    results = [
        result("mikov", "imu0", "data.glitches"),
        REFUSED,
        result("mimu", "e1u0", claim("motion.undersampled", predicted_deg=0.17), after=0.6),
        result("mimu", "e1u1", claim("motion.undersampled", predicted_deg=0.17)),
        result("mimu", "e1u2"),
        result("injected", "none", "gyro.bias_step"),
        result("injected", "skew"),
        result("injected", "outside", "gyro.g_sensitivity"),
    ]
    lines = summary(results, TRUTH)
    assert lines[:2] == ["- 1 of 8 recordings are refused.", "- The held-out closure after is worse than before in 1 of 7."]
    assert lines[2].startswith("- False readings or lost samples are claimed in 1 of the 4 recordings of `mikov` and `mimu`,")
    assert lines[3].startswith("- Undersampled motion is said in 2 of the 3 of `mimu`,")
    assert lines[3].endswith("within a factor of 1.5 of the excess, √(after² − floor²), in 1 of these 2.")
    assert lines[4].endswith("`gyro.g_sensitivity`: `gyro.bias_step` (none). Put in and not named: `timing.axis_skew` (skew).")
    assert lines[5:] == ["- What no catalogue has was put into outside."]
    assert summary([result("xsens", "xsens")], TRUTH) == ["- The held-out closure after is worse than before in 0 of 1."]


def test_what_is_printed_is_the_page_s_table():
    printed = page([result("xsens", "xsens"), result("injected", "none")], TRUTH)
    text = (Path(__file__).resolve().parents[2] / "docs" / "measured" / "real-recordings.md").read_text(encoding="utf-8")
    table = text.split("<!-- table -->\n", 1)[1]
    assert table.startswith(PREFACE + "\n\n| " + " | ".join(HEADER) + " |\n| --- | --- | --- | --- | --- | --- |\n| injected/case01 |")
    assert printed.startswith(table[: table.index("| injected/case01")] + "| injected/none |")


@pytest.mark.broad
def test_a_recording_beside_a_truth_file_is_explained_against_it(tmp_path):
    """A short simulated session, its truth written beside it."""
    folder = write(tmp_path / "session")
    told = real_recordings.one_recording(real_recordings.Job("euroc", folder))
    assert told["refused"] is None
    assert "truth" in told["explain"]
    assert row(told)[0] == "euroc/session"
    assert float(row(told)[4].split()[0]) > 0
