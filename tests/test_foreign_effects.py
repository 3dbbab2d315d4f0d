"""Effects in a folder that the tool does not know of, with temperature, memory or a moment: applied from a file and live, or refused."""

import json
from pathlib import Path

import numpy as np
import pytest

import tinygc
from session.base.units import DEG
from tinygc import CalibrationError, SimulationOptions, read_session
from tinygc.effects import AppliedEffect, Conditions, load_folder, using
from tinygc.models import to_dict
from tinygc.models.linear import LinearModel
from tinygc.models.physics import PhysicsModel
from tinygc.simulation.write import write_session

FOREIGN = Path(__file__).parent / "foreign_effects"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_session(
        SimulationOptions(segments=2, closure_s=0.0, odr_hz=104.0, warm_up_c=8.0), tmp_path_factory.mktemp("foreign") / "session"
    )


@pytest.mark.parametrize("name", ["gyro.rate_memory", "gyro.thermal_curvature", "gyro.shock_recovery"])
def test_it_is_applied_from_a_file_and_live_or_refused_in_one_line(name, folder, run, tmp_path):
    path, log, out = tmp_path / "model_physics.json", folder / "log0001.csv.gz", tmp_path / "calibrated.csv"
    samples = read_session(folder).logs[0].samples
    with using([]):
        (effect,) = (each for each in load_folder(FOREIGN) if each.id == name)
        effect = effect if effect.scan is None else effect.at(10.0)
        theta = 0.3 * effect.parameter.plausible * np.array([1.0, -0.5, 0.2])
        known = Conditions(samples.duration_s, 500 * DEG, float(samples.temp_c[0]))
        model = PhysicsModel(LinearModel(np.eye(3), np.zeros(3)), (AppliedEffect(effect, theta),), known)
        path.write_text(json.dumps(to_dict(model)))
        whole = model.calibrate(samples)
    if effect.of_one_session:
        with using([FOREIGN]), pytest.raises(CalibrationError, match=f"{name} follows the time of a past session: no live use"):
            tinygc.load(path, 104.0).live()
        return
    code, _, err = run("apply", path, log, "-o", out)
    assert (code, err.count("\n"), f"effect {name!r} is not on this machine" in err) == (2, 1, True)
    assert run("apply", path, log, "-o", out, "--effects", FOREIGN)[0] == 0
    np.testing.assert_allclose(np.loadtxt(out, delimiter=",", skiprows=1, usecols=(1, 2, 3)), whole, atol=2e-6)
    assert np.abs(whole - samples.gyro).max() > 1e-4  # the effect does something
    with using([FOREIGN]):
        live = tinygc.load(path, 1 / samples.period_s).live()
        one_by_one = [live(*sample) for sample in zip(samples.gyro[:300], samples.accel, samples.temp_c, strict=False)]
        np.testing.assert_allclose(one_by_one, model.calibrate(samples.between(0, 300), live=True), atol=1e-6)
