"""A calibration that closes turns it never saw worse than the raw rates do is a fail: in fit, in the report, and for export."""

import json
import shutil

import numpy as np
import pytest
from test_report_decision import JudgedFit, decide

import calibrate
import tinygc
from session.io.units import DEG
from tinygc import SimulationOptions
from tinygc.estimation.choice import AgainstRaw
from tinygc.simulation.write import write_session


@pytest.fixture(scope="module")
def perfect(tmp_path_factory):
    """A sensor without any error, and few turns, so that twelve parameters follow their noise: raw is better."""
    none = dict.fromkeys(("gyro_scale_error", "gyro_misalignment", "gyro_bias_dps"), 0.0)
    chosen = SimulationOptions(segments=13, closure_s=0.0, odr_hz=104.0, seed=2, latitude_deg=0.0, bias_instability_dph=0.0, **none)
    return write_session(chosen, tmp_path_factory.mktemp("perfect") / "unit")


def test_a_sensor_without_errors_is_better_off_without_twelve_parameters(perfect, tmp_path, capsys):
    folder = tmp_path / "unit"
    shutil.copytree(perfect, folder)
    assert calibrate.main(["fit", str(folder), "--methods", "least_squares", "--bias", "ends", "--quiet"]) == 1
    said = capsys.readouterr().err
    assert "Held out worse than raw" in said
    table = json.loads((folder / "fit" / "fit.json").read_text())
    against, held = table["against_raw"], table["methods"]["least_squares"]["holdout"]["tilt_rms_deg"]
    assert held > against["tilt_rms_deg"]
    assert (against["worse"], against["passed"]) == (["least_squares"], False)
    # and so do the export, unless somebody insists, and the report
    assert calibrate.main(["export", str(folder), "--to", "json", "--quiet"]) == 2
    assert "worse than the raw rates" in capsys.readouterr().err
    assert not (folder / "export").exists()
    assert calibrate.main(["export", str(folder), "--to", "json", "--quiet", "--anyway"]) == 0
    assert "--anyway" in capsys.readouterr().err
    page = ["report", str(folder), "--no-explain", "--methods", "least_squares", "--bias", "ends", "--json", str(tmp_path / "r.json")]
    assert calibrate.main([*page, "--quiet"]) == 1
    assert "worse than the raw rates" in capsys.readouterr().err
    assert json.loads((tmp_path / "r.json").read_text())["answer"] == "fail"


def test_a_usual_session_is_far_better_than_raw(simulated):
    fit = tinygc.fit(simulated(), methods=("least_squares",), folds=2)
    against = fit.result.against_raw
    assert against.worse == ()
    assert against.words == ""
    assert against.tilt_rms_deg > 10 * against.held_out["least_squares"]
    assert fit.to_json()["against_raw"] == {
        "method": against.method,
        "tilt_rms_deg": against.tilt_rms_deg,
        "worse": [],
        "passed": True,
    }


@pytest.mark.parametrize(
    ("held_out", "worse", "failed"),
    [
        ({"least_squares": 0.9, "pso": 1.1}, ("pso",), False),
        ({"least_squares": 1.2, "pso": 1.1}, ("least_squares", "pso"), True),
        ({"least_squares": 1.0}, (), False),
        ({"least_squares": float("nan")}, ("least_squares",), True),
        ({}, (), False),
    ],
)
def test_nothing_better_than_raw_is_a_fail_and_one_that_is_worse_is_said(held_out, worse, failed):
    against = AgainstRaw("raw_bias_removed", 1.0, held_out)
    assert (against.worse, against.failed) == (worse, failed)
    assert bool(against.words) == bool(worse)


@pytest.mark.parametrize("limit_deg", [None, 5.0])
def test_no_limit_makes_a_pass_of_what_is_worse_than_raw(limit_deg):
    adopted = JudgedFit(np.full((40, 2), DEG / np.sqrt(2)), list(range(40)), np.zeros(12), 0.9 * DEG, 0.5, None, [], [], [])
    assert decide(adopted, [], limit_deg, AgainstRaw("raw", 1.1, {})).answer == "pass"
    worse = decide(adopted, [], limit_deg, AgainstRaw("raw", 0.9, {}))
    assert worse.answer == "fail"
    assert any("worse than the 0.90° of the raw rates" in text for met, text in worse.reasons if not met)
