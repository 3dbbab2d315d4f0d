"""A calibration that closes turns it never saw worse than the raw rates do is a fail: in fit, in the report, and for export."""

import json
import shutil

import pytest

import calibrate
from tinygc import SimulationOptions
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
