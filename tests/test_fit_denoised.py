"""`fit` with the further nets: what the command line gives a user."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

import calibrate
from session.io.units import DEG
from tinygc import SimulationOptions, models
from tinygc.estimation import adamw, network
from tinygc.simulation.write import write_session


@pytest.fixture(scope="module")
def warm(tmp_path_factory) -> Path:
    """A session whose zero follows the temperature."""
    options = SimulationOptions(seed=11, closure_s=20.0, warm_up_c=9.0, segments=40)
    slope = np.array([0.014, -0.037, 0.018]) * DEG

    def distort(t_s, rate, force, temp_c):
        return rate + slope * (temp_c - options.temperature_start_c)[:, None]

    return write_session(options, tmp_path_factory.mktemp("warm") / "warm", distort=distort)


def fit(folder, out, *more):
    code = calibrate.main(["fit", str(folder), "--out", str(out), "--json", str(out / "table.json"), "--quiet", *more])
    return code, json.loads((out / "table.json").read_text())


@pytest.mark.slow
def test_denoised_beside_calibrated(tmp_path):
    """195 parameters: noise at rest a third, the stated delay, and the closure as before."""
    code, table = fit(ROOT / "data" / "session1", tmp_path, "--methods", "tinygc,tinygc_denoised")
    calibrated, denoised = (table["methods"][name] for name in ("tinygc", "tinygc_denoised"))
    assert code == 0
    assert denoised["parameters"] == 195
    assert min(denoised["denoiser"]["noise_reduction"]) > 3
    assert denoised["denoiser"]["delay_samples"] == 12
    assert denoised["holdout"]["tilt_rms_deg"] < 1.05 * calibrated["holdout"]["tilt_rms_deg"]
    run = table["closure_runs"][0]
    assert run["tinygc_denoised"]["rmse_deg"] == pytest.approx(run["tinygc"]["rmse_deg"], abs=0.005)
    assert models.load(tmp_path / "model_tinygc_denoised.json").parameters == 195
    assert len(json.loads((tmp_path / "fitted.json").read_text())["methods"]["tinygc_denoised"]["notes"]["loss"]) > 5


@pytest.mark.slow
def test_a_net_that_is_told_the_temperature(warm, tmp_path):
    """33 parameters take most of what the linear model with one bias leaves; the model file carries it."""
    _, table = fit(warm, tmp_path, "--methods", "least_squares", "--conditions", "temperature", "--bias", "ends")
    linear, told = (table["methods"][name]["holdout"]["tilt_rms_deg"] for name in ("least_squares", "tinygc_conditions"))
    assert table["methods"]["tinygc_conditions"]["parameters"] == 33
    assert told < 0.7 * linear
    bias = models.load(tmp_path / "model_tinygc_conditions.json").net.bias[:, 0] / DEG
    np.testing.assert_allclose(bias, [-0.014, 0.037, -0.018], atol=0.004)


@pytest.mark.slow
def test_where_conditions_do_not_matter_they_are_left_alone(tmp_path):
    _, table = fit(ROOT / "data" / "session1", tmp_path, "--methods", "least_squares", "--conditions", "temperature,force", "--folds", "2")
    linear, told = (table["methods"][name]["holdout"]["tilt_rms_deg"] for name in ("least_squares", "tinygc_conditions"))
    assert table["methods"]["tinygc_conditions"]["parameters"] == 51
    assert told == pytest.approx(linear, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    "more",
    [
        [],
        ["--parts", "3"],
        pytest.param(["--variant", "published", "--still-rates"], marks=pytest.mark.slow),
        pytest.param(["--optimizer", "adamw", "--epochs", "3"], marks=pytest.mark.slow),
    ],
)
def test_the_papers_own_loss(tmp_path, more):
    """On one day it is nearly the squared loss; it goes with every kind of net and of training."""
    how = ["--methods", "tinygc", "--loss", "distance", "--folds", "2", *more]
    _, table = fit(ROOT / "data" / "session1", tmp_path, *how)
    assert table["options"]["loss"] == "distance"
    assert table["methods"]["tinygc"]["holdout"]["tilt_rms_deg"] < (3.0 if "adamw" in more else 0.02)


@pytest.mark.slow
def test_an_interrupted_fit_repeats_no_training_that_had_ended(tmp_path, monkeypatch):
    """Ctrl-C in the second of six trainings; resumed, the numbers are those of a fit that was left alone."""
    how = ["--methods", "tinygc", "--optimizer", "adamw", "--epochs", "8", "--folds", "2"]
    alone = fit(ROOT / "data" / "session1", tmp_path / "alone", *how)[1]
    told, train = [], adamw.minimise

    def watched(*args, progress, **more):
        def tell(done, of):
            told.append(done)
            if len(told) == 12:
                raise KeyboardInterrupt
            progress(done, of)

        return train(*args, progress=tell, **more)

    monkeypatch.setattr(network, "minimise", watched)
    out = tmp_path / "out"
    out.mkdir()
    assert calibrate.main(["fit", str(ROOT / "data" / "session1"), "--out", str(out), "--quiet", *how]) == 130
    assert sorted(path.name for path in out.glob("checkpoint*")) == ["checkpoint_tinygc_fold0.json", "checkpoint_tinygc_whole.json"]
    resumed = fit(ROOT / "data" / "session1", out, "--resume", *how)[1]
    assert told[12:] == [5, 6, 7, 8, *range(1, 9)]
    assert resumed["methods"]["tinygc"]["holdout"] == alone["methods"]["tinygc"]["holdout"]
    assert not list(out.glob("checkpoint*"))


def test_unknown_conditions_are_refused(capsys):
    with pytest.raises(SystemExit) as left:
        calibrate.main(["fit", "x", "--conditions", "weather"])
    assert left.value.code == 2
    assert "temperature,force" in capsys.readouterr().err
