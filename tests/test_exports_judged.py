"""A model leaves the tool only beside figures that say that it may: ``fit.json`` without them is refused, in one line."""

import json
import shutil

import pytest

import calibrate


@pytest.fixture(scope="module")
def fitted(simulated, tmp_path_factory):
    folder = tmp_path_factory.mktemp("judged") / "session"
    shutil.copytree(simulated(segments=24, closure_s=0.0), folder)
    assert calibrate.main(["fit", str(folder), "--methods", "least_squares", "--quiet"]) == 0
    return folder


@pytest.fixture
def fitted_here(fitted, tmp_path):
    shutil.copytree(fitted, tmp_path / "session")
    return tmp_path / "session"


@pytest.mark.parametrize(
    ("without", "says"),
    [
        ("session noise methods segments against_raw", "session is missing, expected text"),  # a schema and nothing else
        ("against_raw", "against_raw is missing, expected a table"),
        ("segments", "segments is missing, expected a table"),
        ("segments.used", "segments.used is missing, expected a whole number of at least 0"),
        ("methods", "methods is missing, expected a table"),
        ("methods.least_squares", "methods.least_squares is missing, expected how well that model closes held-out turns"),
        ("noise.gyro_dps_rthz", "noise.gyro_dps_rthz is missing, expected 3 numbers"),
        ("against_raw.tilt_rms_deg", "against_raw.tilt_rms_deg is missing, expected a number from 0 to 10000 or null"),
    ],
)
def test_a_fit_that_does_not_say_whether_its_model_may_leave_is_no_permission(without, says, fitted_here, run):
    path = fitted_here / "fit" / "fit.json"
    whole = json.loads(path.read_text())
    for dotted in without.split():
        *above, last = dotted.split(".")
        table = whole
        for key in above:
            table = table[key]
        del table[last]
    path.write_text(json.dumps(whole))
    code, _, err = run("export", fitted_here, "--to", "px4")
    assert (code, err) == (2, f"calibrate: {path}: {says}; run `python calibrate.py fit {fitted_here}` again\n")
    assert not (fitted_here / "export").exists()


@pytest.mark.parametrize("raw", ["a number", None])
def test_a_held_out_tilt_that_is_no_number_is_worse_than_raw(raw, fitted_here, run):
    path = fitted_here / "fit" / "fit.json"
    whole = json.loads(path.read_text())
    whole["methods"]["least_squares"]["holdout"]["tilt_rms_deg"] = None
    if raw is None:
        whole["against_raw"]["tilt_rms_deg"] = None
    path.write_text(json.dumps(whole))
    code, _, err = run("export", fitted_here, "--to", "px4")
    assert code == 2
    assert "by no number that fit.json knows, worse than the raw rates" in err
