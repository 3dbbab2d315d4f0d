"""Pass, fail, or not decided: by which figures, and alike on the terminal, the page and in the JSON."""

import json
import re

import numpy as np
import pytest

import calibrate
from tinygc.estimation.choice import tilt_rms
from tinygc.estimation.verdict import JudgedFit, decide


@pytest.mark.parametrize(
    ("segments", "angles_rad", "limit", "answer"),
    [
        (40, 1.3, None, "pass"),
        (40, 1.3, 1.0, "pass"),
        (40, 2.1, None, "not decided"),
        (12, 1.3, None, "not decided"),
        (13, 1.3, None, "pass"),
        (12, 1.3, 1.0, "doubtful pass"),
        (12, 1.3, 1e-9, "fail"),
    ],
)
def test_a_pass_needs_segments_and_a_closure_near_its_floor(segments, angles_rad, limit, answer):
    angles = np.full((segments, 2), angles_rad * 1e-4 / np.sqrt(2))
    judged = JudgedFit(angles, list(range(segments)), np.zeros(12), 1e-4, 0.5, 4, [], [], [])
    assert tilt_rms(angles) / judged.floor_rms == pytest.approx(angles_rad)
    decision = decide(judged, [], limit)
    assert decision.answer == answer
    assert bool(decision.doubts) == (answer in ("not decided", "doubtful pass") or segments < 13)
    assert decision.passed == (answer != "fail")  # the exit code knows no doubt


@pytest.mark.slow
def test_few_segments_far_above_the_floor_are_no_pass(simulated, tmp_path, capsys):
    """Eight turns: the fit follows the noise of what it has, and p tells nothing."""
    folder, out, table = simulated(segments=8, closure_s=0.0), tmp_path / "r.html", tmp_path / "r.json"
    # With the biases from the stills three parameters less are fitted, and p would tell something.
    arguments = ["report", str(folder), "--out", str(out), "--methods", "raw,least_squares", "--no-explain", "--json", str(table)]
    arguments += ["--bias", "ends"]
    assert calibrate.main(arguments) == 0
    report, printed = json.loads(table.read_text()), capsys.readouterr().out
    ratio = report["closure"]["holdout_tilt_rms_deg"] / report["closure"]["floor_rms_deg"]
    assert ratio > 2
    assert report["passed"] is None
    assert report["answer"] == "not decided"
    assert report["closure"]["degrees_of_freedom"] == 4
    words = re.sub("<[^>]*>", " ", out.read_text(encoding="utf-8"))
    for text in (printed, words):
        assert "NOT DECIDED" in text
        assert "8 segments for 12 parameters" in text.replace("\n", " ")
        assert "4 degrees of freedom" in text
    assert "a little" not in words
    assert "PASS" not in words
