"""A drift or a step belongs to the time of its own session: a model that undoes one refuses every other, and has a form for any time."""

import json
import shutil

import numpy as np
import pytest
from models_in_use import KNOWN, LINEAR, NET, SAMPLES, physics

import calibrate
import tinygc
from session.io.config import Sensor
from session.io.logfile import read_log
from session.io.units import DEG
from tinygc import CalibrationError, SimulationOptions, models
from tinygc.deploy.calibration import Calibration
from tinygc.effects import AppliedEffect, Effect, Parameter, catalogue, diagonal
from tinygc.models.linear import PARAMETERS
from tinygc.models.physics import CarriedNet, PhysicsModel
from tinygc.simulation.write import write_session

RATE_HZ = 1 / SAMPLES.period_s
DRIFT_DPS = np.array([0.3, -0.2, 0.25])  #: over the session
LENGTH_S = 140.0  #: over which the drift below grows by as much; the sessions are about as long


def stepped(at_s: float) -> PhysicsModel:
    step = catalogue()["gyro.bias_step"].at(at_s)
    return PhysicsModel(LINEAR, (*physics("gyro.g_sensitivity").claims, AppliedEffect(step, np.array([1e-3, 2e-3, -3e-3]))), KNOWN)


BYGONE = {
    "drift": physics("gyro.bias_drift"),
    "step beside others": stepped(12.003),
    "net behind a drift": CarriedNet(physics("gyro.bias_drift"), NET),
    "net behind more": CarriedNet(physics("gyro.g_sensitivity", "gyro.bias_drift"), NET),
}


@pytest.mark.parametrize("name", BYGONE)
def test_within_the_session_it_calibrates_and_nowhere_else(name):
    model, end_s = BYGONE[name], KNOWN.duration_s
    for began_s in (0.0, 10.0, end_s - SAMPLES.duration_s):
        assert np.isfinite(model.calibrate(SAMPLES, began_s)).all()
    for began_s in (-10.0, end_s - SAMPLES.duration_s / 2, end_s, 3600.0, float("nan"), float("inf")):
        with pytest.raises(CalibrationError, match=r"known from 0 to .* s of its session.*_at_end"):
            model.calibrate(SAMPLES, began_s)


@pytest.mark.parametrize("name", BYGONE)
def test_in_use_the_moment_is_asked_for_and_live_is_refused(name):
    calibration = Calibration(BYGONE[name], RATE_HZ)
    arrays = SAMPLES.gyro, SAMPLES.accel, SAMPLES.temp_c
    with pytest.raises(CalibrationError, match=r"gyro.bias_(drift|step) follows the time of .* session.*began_s=.*at_end"):
        calibration(*arrays)
    with pytest.raises(CalibrationError, match=r"gyro.bias_(drift|step) .*no live use; take at_end\(\)"):
        calibration.live()
    with pytest.raises(CalibrationError, match="take the model for any time"):
        calibration(*arrays, began_s=3600.0)
    whole = calibration(*arrays, began_s=5.0)
    np.testing.assert_allclose(whole, BYGONE[name].calibrate(SAMPLES, 5.0), atol=1e-6)
    stream, parts = calibration.stream(5.0), []
    for start in range(0, len(SAMPLES), 100):
        part = SAMPLES.between(start, start + 100)
        parts.append(stream.push(part.gyro, part.accel, part.temp_c))
    np.testing.assert_allclose(np.concatenate([*parts, stream.flush()]), whole, atol=1e-11)


@pytest.mark.parametrize("name", BYGONE)
def test_at_the_end_it_is_the_model_that_holds_for_any_time(name):
    model = BYGONE[name]
    ended = model.at_end()
    assert ended.session_s is None
    assert ended.at_end() is ended
    assert not any(claim.effect.of_one_session for claim in ended.undone)
    last = SAMPLES.between(len(SAMPLES) - 3, len(SAMPLES))
    rates = model.calibrate(last, KNOWN.duration_s - last.duration_s)
    for began_s in (0.0, 3600.0):
        np.testing.assert_allclose(ended.calibrate(last, began_s), rates, atol=3e-6)  # the drift of 0.02 s
    Calibration(ended, RATE_HZ).live()(SAMPLES.gyro[0], SAMPLES.accel[0], SAMPLES.temp_c[0])
    again = models.from_dict(json.loads(json.dumps(models.to_dict(ended))))
    np.testing.assert_allclose(again.calibrate(SAMPLES), ended.calibrate(SAMPLES), atol=1e-12)


@pytest.mark.parametrize("name", ["drift", "step beside others"])
def test_its_covariance_follows_by_the_slope(name):
    model, rng = BYGONE[name], np.random.default_rng(1)

    def parameters(of) -> np.ndarray:
        linear = of.linear if isinstance(of, PhysicsModel) else of
        return np.concatenate([linear.vector, *(claim.theta for claim in of.undone)])

    def moved(change) -> PhysicsModel:
        vector, at, claims = parameters(model) + change, PARAMETERS, []
        for claim in model.claims:
            claims.append(AppliedEffect(claim.effect, vector[at : at + len(claim.theta)]))
            at += len(claim.theta)
        return PhysicsModel(type(LINEAR).from_vector(vector), tuple(claims), KNOWN)

    change = 1e-3 * rng.normal(size=model.parameters)
    by = parameters(moved(change).at_end()) - parameters(model.at_end())
    np.testing.assert_allclose(model.at_end_slope() @ change, by, atol=1e-12)


def test_what_cannot_stand_still_is_left_in_the_rates():
    """A scale that drifts follows the rate, too: after the session it is as at its beginning."""
    effect = Effect(
        id="gyro.scale_drift",
        equation="ω_i += s_i t ω_i",
        parameter=Parameter("per_s", (3,), "1/s", plausible=0.01),
        observable_in=("turn",),
        columns=lambda movement: diagonal(movement.t_s[:, None] * movement.rate),
        describe=lambda theta: "1",
        discriminating_motion="",
        inputs=("time",),
    )
    model = PhysicsModel(LINEAR, (AppliedEffect(effect, np.full(3, 1e-4)),), KNOWN)
    np.testing.assert_allclose(model.at_end().vector, LINEAR.vector)
    assert not model.at_end_slope()[:, PARAMETERS:].any()


# The commands


def drifting(t_s, rate, force, temp_c):
    return rate + np.outer(t_s / LENGTH_S, DRIFT_DPS) * DEG


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A session with a drift and a closure run, fitted with it; and a folder with another session."""
    at = tmp_path_factory.mktemp("time")
    options = {"segments": 20, "seed": 5, "odr_hz": 104.0}
    folder = write_session(SimulationOptions(**options, closure_s=15.0), at / "drifting", distort=drifting)
    words = ["fit", str(folder), "--physics", "gyro.bias_drift", "--methods", "least_squares", "--quiet"]
    # The linear model, which the held-out segments do not refute, fails in the closure run.
    assert calibrate.main([*words, "--json", str(at / "fit.json")]) == 1
    other = write_session(SimulationOptions(**options | {"seed": 6}, closure_s=0.0), at / "other")
    return folder, other, json.loads((at / "fit.json").read_text())


def apply(model, log, out, capsys):
    code = calibrate.main(["apply", str(model), str(log), "-o", str(out), "--quiet"])
    return code, capsys.readouterr().err


def gyro(path):
    return read_log(path, Sensor("", "", 104.0, 500, 4)).samples.gyro


def test_apply_knows_the_sessions_own_log_and_refuses_others(fitted, tmp_path, capsys):
    folder, other, _ = fitted
    model = folder / "fit" / "model_physics.json"
    own = tmp_path / "under_another_name.csv.gz"
    shutil.copy(folder / "log0001.csv.gz", own)
    shutil.copy(folder / "session.toml", tmp_path)
    assert apply(model, own, tmp_path / "own.csv", capsys)[0] == 0
    for log in (other / "log0001.csv.gz", folder / "closure0001.csv.gz"):
        code, err = apply(model, log, tmp_path / "x.csv", capsys)
        assert (code, err.count("\n")) == (2, 1)
        assert "no log of the session whose time model_physics.json follows (gyro.bias_drift); apply model_physics_at_end" in err
        assert "_at_end" in err
        assert not (tmp_path / "x.csv").exists()
    ended = folder / "fit" / "model_physics_at_end.json"
    assert apply(ended, own, tmp_path / "ended.csv", capsys)[0] == 0
    off = (gyro(tmp_path / "ended.csv") - gyro(tmp_path / "own.csv")) / DEG
    np.testing.assert_allclose(off[-1], 0, atol=1e-3)  # dps: at the end they are one
    duration_s = json.loads(model.read_text())["conditions"]["duration_s"]
    np.testing.assert_allclose(off[0], -DRIFT_DPS * duration_s / LENGTH_S, atol=0.02)
    assert apply(ended, other / "log0001.csv.gz", tmp_path / "y.csv", capsys)[0] == 0


def test_a_file_that_does_not_know_its_logs_refuses_all(fitted, tmp_path, capsys):
    folder, _, _ = fitted
    table = json.loads((folder / "fit" / "model_physics.json").read_text())
    for name in ("sha256", "began_s"):
        for broken in ({}, None, {"log0001.csv.gz": None}, "x"):
            (tmp_path / "m.json").write_text(json.dumps(table | {name: broken}))
            code, err = apply(tmp_path / "m.json", folder / "log0001.csv.gz", tmp_path / "x.csv", capsys)
            assert (code, err.count("\n")) == (2, 1)


def test_the_saved_model_for_any_time_knows_how_well_it_is_known(fitted):
    folder, _, table = fitted
    ended = tinygc.load(folder / "fit" / "model_physics_at_end.json")
    assert ended.model.kind == "linear"
    saved = ended.to_json()
    assert saved["method"] == "physics_at_end"
    own = json.loads((folder / "fit" / "model_physics.json").read_text())
    assert set(own["began_s"]) == {"log0001.csv.gz"}
    bias = np.sqrt(np.diag(np.array(saved["covariance"])))[9:12] / DEG
    assert (bias < 0.01).all()
    assert (bias > 1e-4).all()
    # The true bias of the session's end, and the closure run closed with it.
    truth = json.loads((folder / "truth.json").read_text())
    at_end = np.array(truth["B_dps"]) - DRIFT_DPS * own["conditions"]["duration_s"] / LENGTH_S
    np.testing.assert_allclose(ended.model.B / DEG, at_end, atol=0.02)
    (run,) = table["closure_runs"]
    assert run["physics"]["rmse_deg"] < 0.3 * run["least_squares"]["rmse_deg"]


@pytest.mark.broad
def test_another_fit_leaves_no_stale_model(fitted, tmp_path):
    folder, _, _ = fitted
    out = tmp_path / "fit"
    words = ["fit", str(folder), "--methods", "least_squares", "--quiet", "--out", str(out), "--physics"]
    assert calibrate.main([*words, "gyro.bias_drift"]) == 1
    assert (out / "model_physics_at_end.json").exists()
    assert calibrate.main([*words, "gyro.g_sensitivity"]) == 1
    assert not (out / "model_physics_at_end.json").exists()


@pytest.mark.parametrize("to", ["json", "c", "kalibr"])
def test_export_refuses_it_and_takes_the_one_for_any_time(fitted, tmp_path, capsys, to):
    folder, _, _ = fitted
    words = ["export", str(folder), "--to", to, "--out", str(tmp_path), "--quiet", "--model"]
    assert calibrate.main([*words, "physics"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "undoes gyro.bias_drift" in err
    assert "--model physics_at_end" in err
    assert calibrate.main([*words, "physics_at_end"]) == 0
