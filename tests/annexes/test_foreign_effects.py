"""Three effects in a folder that the tool does not know of, one with temperature, one with memory, one with a scanned moment, through every
command: named, fitted, applied from a file and live, drawn, exported to C or refused in one line."""

import importlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import tinygc
from tinygc import CalibrationError, read_session
from tinygc.annexes.challenge.proof_sessions import SIZE, inject
from tinygc.effects import load_folder, using

FOREIGN = Path(__file__).parents[1] / "foreign_effects"
IDS = ("gyro.rate_memory", "gyro.shock_recovery", "gyro.thermal_curvature")


@pytest.fixture(scope="module")
def known():
    """The three, by id, loaded for this module alone."""
    with using([]):
        yield {effect.id: effect for effect in load_folder(FOREIGN)}


@pytest.fixture
def strangers():
    """A process that has not loaded the folder: what a command must be told by --effects."""
    catalogue = importlib.import_module("tinygc.effects.catalogue")
    before = dict(catalogue._folders)
    catalogue._folders.clear()
    yield
    catalogue._folders.update(before)


@pytest.fixture(scope="module")
def made(known, tmp_path_factory):
    """``made(id)``: a session with the effect in it, and what was injected; once each."""
    found = {}

    def make(name: str):
        if name not in found:
            effect = known[name]
            found[name] = inject(effect, tmp_path_factory.mktemp("foreign") / name, 2 * SIZE * effect.parameter.plausible, 4)
        return found[name]

    return make


def all_but(quick: str) -> list:
    """Parameters, of which all but one are tried at night."""
    return [pytest.param(name, marks=[pytest.mark.slow] * (name != quick)) for name in IDS]


@pytest.mark.broad
@pytest.mark.parametrize("name", all_but("gyro.shock_recovery"))
def test_it_is_named_fitted_applied_drawn_and_exported(name, made, known, strangers, run, tmp_path):
    injected, effect = made(name), known[name]
    folder = tmp_path / "session"
    shutil.copytree(injected.folder, folder)

    # Without its folder it has no name, and nothing of the folder is looked at.
    code, _, err = run("fit", folder, "--physics", name)
    assert code == 2
    assert f"{name!r} is no effect" in err
    assert "--effects DIR" in err

    # Named, with its parameters, and drawn.
    code, _, err = run("explain", folder, "--effects", FOREIGN, "--json", tmp_path / "explain.json")
    assert code == 0, err
    said = json.loads((tmp_path / "explain.json").read_text())
    (named,) = said["effects"]
    assert named["id"] == name
    parameter = effect.parameter
    found, std = (np.ravel(named[key][parameter.name]) * parameter.si for key in ("parameters", "std"))
    assert (np.abs(found - injected.theta) < 5 * std).all(), (found, injected.theta, std)
    assert (std < 0.5 * np.abs(injected.theta).max()).all()
    if effect.scan is not None:
        assert named["parameters"]["shock_min"] == pytest.approx(injected.value / 60, abs=0.02)
    assert (folder / "explain" / "explain.png").stat().st_size > 20_000

    # Fitted, and saved with its numbers.
    code, _, err = run("fit", folder, "--physics", "auto", "--methods", "least_squares", "--effects", FOREIGN)
    assert code == 0, err
    path = folder / "fit" / "model_physics.json"
    (entry,) = json.loads(path.read_text())["effects"]
    assert entry["id"] == name

    # Applied from a file; without the folder refused in one line.
    log, out = folder / "log0001.csv.gz", tmp_path / "calibrated.csv"
    code, _, err = run("apply", path, log, "-o", out)
    assert (code, err.count("\n")) == (2, 1)
    assert f"effect {name!r} is not on this machine" in err
    assert run("apply", path, log, "-o", out, "--effects", FOREIGN)[0] == 0
    applied = np.loadtxt(out, delimiter=",", skiprows=1, usecols=(1, 2, 3))
    samples = read_session(folder).logs[0].samples
    with using([FOREIGN]):
        model = tinygc.models.load(path)
        whole = model.calibrate(samples)
        # The file's data rate is what its stamps say, to a microsecond.
        np.testing.assert_allclose(applied, whole, atol=2e-6)
        assert np.abs(whole - model.linear(samples.gyro)).max() > 1e-4  # the effect does something

        # Live: what is needed is asked for; then sample by sample as whole.
        rate_hz = 1 / samples.period_s
        calibration = tinygc.load(path, rate_hz)
        assert calibration.needs == (("temp",) if name == "gyro.thermal_curvature" else ("rate_hz",))
        if "rate_hz" in calibration.needs:
            with pytest.raises(CalibrationError, match="load it with rate_hz="):
                tinygc.load(path)(samples.gyro[:10])
        if "temp" in calibration.needs:
            with pytest.raises(CalibrationError, match="the model needs temp"):
                calibration.live()(samples.gyro[0])
        if effect.of_one_session:  # and no longer of any use, 25 s after the shock
            with pytest.raises(CalibrationError, match=f"{name} follows the time of a past session: no live use"):
                calibration.live()
            calibration = tinygc.load(folder / "fit" / "model_physics_at_end.json", rate_hz)
            model = calibration.model
        live = calibration.live()
        one_by_one = [live(*sample) for sample in zip(samples.gyro[:800], samples.accel, samples.temp_c, strict=False)]
        np.testing.assert_allclose(one_by_one, model.calibrate(samples.between(0, 800), live=True), atol=1e-6)

    # C, or a reason in one line.
    code, _, err = run("export", folder, "--to", "c", "--model", "physics", "--effects", FOREIGN, "--out", tmp_path / "c")
    if name == "gyro.thermal_curvature":
        assert code == 0, err
        assert "THERMAL_CURVATURE[3] =" in (tmp_path / "c" / "tinygc_model.c").read_text()
    else:
        assert (code, err.count("\n")) == (2, 1)
        why = (
            "follows the time of its own session"
            if effect.of_one_session
            else f"cannot be exported to C: {effect.device.why}; json carries"
        )
        assert name in err
        assert why in err
    assert run("export", folder, "--to", "ros", "--model", "physics", "--effects", FOREIGN, "--out", tmp_path / "ros")[0] == 2
