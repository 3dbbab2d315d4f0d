"""Pass, fail, or not decided: by which figures, and alike on the terminal, the page and in the JSON."""

import json
import re

import pytest

import calibrate


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
