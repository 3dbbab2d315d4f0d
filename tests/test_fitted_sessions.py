"""What ``fit`` makes of a whole session: its verdict and exit code, the bias of the day, figures at rest beside it, what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import Table, write_session
from formats_page import strangers
from noise_records import axis_of, figures_of

import tinygc
from session.base.errors import FitError
from session.base.records import table_of
from session.base.units import DEG
from tinygc.closure.least_squares import fit_least_squares
from tinygc.models.linear import LinearModel, bias_only
from tinygc.noise.figures import SensorNoise


def distorted(readings):
    """A simulated session with its only log's samples changed."""
    session = tinygc.simulate(segments=8, closure_s=0.0, odr_hz=104.0, seed=3).session
    return replace(session, logs=(replace(session.logs[0], samples=readings(session.logs[0].samples)),))


def test_an_accelerometer_that_never_moves_is_refused():
    level = np.random.default_rng(0).normal([0, 0, -9.79], 6e-3, (10_000, 3))
    with pytest.raises(tinygc.CalibrationError, match="gravity moves: stays within"):
        tinygc.fit(distorted(lambda samples: samples.with_accel(level[: len(samples)])), methods=("least_squares",))


def test_a_fit_whose_residuals_are_fine_is_refused_if_no_gyroscope_has_its_scale():
    """One axis reads too much and one too little: the scale common to all axes looks right."""
    with pytest.raises(FitError, match="no gyroscope has this calibration: it multiplies rates about"):
        tinygc.fit(distorted(lambda samples: replace(samples, gyro=samples.gyro * [1.0, 1.35, 0.74])), methods=("least_squares",))


def test_the_model_of_a_fold_is_a_fit_to_the_other_turns_alone():
    """To a few thousandths of a sigma, though one turn is far off; which of them is left out moves it by several sigmas."""
    off = distorted(lambda it: replace(it, gyro=it.gyro * np.where(np.abs(np.arange(len(it)) - 2674.5) < 75, 1.1, 1.0)[:, None]))
    problem = (result := tinygc.fit(off, methods="least_squares", folds=8).result).problem
    for left_out, model in zip(np.eye(8, dtype=bool), result.methods["least_squares"].fold_models, strict=True):
        batch, sigma = problem.joint.without(left_out, problem.batch).pick(~left_out), problem.floor.sigma[~left_out]
        alone = fit_least_squares(batch, sigma, bias_only(problem.still_rates.rate[0]))
        off_by = [np.abs(each.vector - alone.model.vector) / np.sqrt(np.diag(alone.covariance)) for each in (model, result.linear.model)]
        assert off_by[0].max() < 5e-3 < 1 < off_by[1].max()


def test_the_exit_code_is_the_verdict_s(tmp_path, simulated, run):
    words = ("--methods", "least_squares", "--json", tmp_path / "fit.json", "--out", tmp_path / "fit", "--exclude", "1,2", "--strict")
    code, out, _ = run("fit", simulated(segments=13, closure_s=0.0), *words)
    assert (code, json.loads((tmp_path / "fit.json").read_text())["verdict"]["answer"]) == (1, "not decided")
    assert out.startswith("NOT DECIDED")


# The bias of the day.


@pytest.fixture(scope="module")
def another_day(tmp_path_factory):
    """A session of eight tumbles with another bias than the stored model has."""
    folder = write_session(tmp_path_factory.mktemp("day") / "s", Table().tumble(8, seed=2).samples(bias_dps=(0.62, -0.35, 0.51), seed=2))
    stored = LinearModel(np.eye(3), -np.array([0.5, -0.3, 0.6]) * DEG)
    path = folder / "stored.json"
    path.write_text(json.dumps(tinygc.models.to_dict(stored, session="first", sha256={"log0001.csv": "0" * 64})))
    return folder, path


def test_a_stored_calibration_takes_the_bias_of_the_day(another_day):
    folder, stored = another_day
    found = tinygc.rebias(folder, stored)
    assert found.closure["stored"]["tilt_rms_deg"] > 0.3  # 0.16 dps over 5 s
    assert found.closure["gravity"]["tilt_rms_deg"] < 0.06
    change = np.array([each.value for each in found.change.values()]) / DEG
    assert np.abs(change - [-0.12, 0.05, 0.09]).max() < 0.02


def test_a_fit_takes_the_figures_of_the_noise_beside_it(folder):
    white, instability = 5e-3 * DEG / np.sqrt(2), 3 * DEG / 3600
    axis = axis_of(N=(white, 0.02 * white), B=(instability, 0.2 * instability))
    (folder / "fit").mkdir(exist_ok=True)
    (folder / "fit" / "noise.json").write_text(json.dumps(table_of(figures_of(SensorNoise((axis,) * 3)))))
    after = tinygc.fit(folder, methods="least_squares")
    assert strangers(after.to_json()) == []
    noise = after.to_json()["noise"]
    assert noise["gyro_bias_instability_source"] == "measured at rest (noise.json)"
    assert noise["gyro_bias_instability_dph"] == pytest.approx(3.0, rel=1e-9)
    assert [each["contradicted"] for each in noise["at_rest"]["white"]] == [False] * 3
    assert "not contradicted by this session: white noise within" in " ".join(str(after.summary()).split())
