"""The bias of the day: from gravity over a run that never rests, from a still, from the user (numbers: ``test_bias_from_gravity.py``)."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, GRAVITY, Table, broad, write_session
from scipy.spatial.transform import Rotation

import calibrate
from session.detect.truth_segments import find_rests
from session.io.samples import Samples
from tinygc import models
from tinygc.attitude.rotation import accumulate, conjugate, log, multiply, steps
from tinygc.estimation.bias_of_day import bias_from_gravity
from tinygc.models.linear import LinearModel

RATE_HZ = 200
STATED = np.array([0.08, -0.05, 0.06]) * DEG


def flight(seconds=100.0, bias=STATED, seed=0, accel_bias=(0.03, -0.02, 0.05), rest_s=0.0):
    """A vehicle that flies about in a room of some metres, tilting as it accelerates and turning slowly: samples and true q_nb (N, 4)."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / RATE_HZ)
    frequency, phase = rng.uniform(0.03, 0.25, (3, 6)), rng.uniform(0, 2 * np.pi, (3, 6))
    size = rng.uniform(0.1, 0.4, (3, 6))
    w = 2 * np.pi * frequency
    flying = np.clip((t - rest_s) / 2, 0, 1) ** 2 if rest_s else np.ones_like(t)
    acceleration = -(size * w**2 * np.sin(w * t[:, None, None] + phase)).sum(-1) * flying[:, None]
    thrust = acceleration - np.array([0, 0, GRAVITY])
    yaw = (1.5 * np.sin(2 * np.pi * 0.02 * t) + 0.5 * np.sin(2 * np.pi * 0.11 * t)) * flying
    down = -thrust / np.linalg.norm(thrust, axis=1, keepdims=True)
    x = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)])
    y = np.cross(down, x)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    q = Rotation.from_matrix(np.stack([np.cross(y, down), y, down], axis=-1)).as_quat(scalar_first=True)
    q *= np.sign(np.sum(q * np.roll(q, 1, axis=0), axis=1, keepdims=True)).cumprod(axis=0)
    half = log(multiply(conjugate(q[:-1]), q[1:])) * RATE_HZ  # mean rate from sample to sample
    rate = np.concatenate([half[:1], (half[1:] + half[:-1]) / 2, half[-1:]])
    force = Rotation.from_quat(q, scalar_first=True).inv().apply(thrust)
    noise = rng.normal(size=(2, len(t), 3))
    gyro = rate + bias + noise[0] * 0.01 * DEG * np.sqrt(RATE_HZ / 2)
    return Samples(np.rint(t * 1e9).astype(np.int64), gyro, force + accel_bias + noise[1] * 0.03), q


def test_gravity_finds_the_two_that_it_sees_and_keeps_the_third_at_its_prior():
    samples, q = flight(seed=1)
    found = bias_from_gravity(samples, samples.gyro, q[0])
    error = found.change + STATED
    # About the two best directions, a 3-sigma bound that is itself sharp; about the vertical, the prior.
    best = found.directions @ error
    assert np.abs(best[:2] / found.direction_sigma[:2]).max() < 3
    assert found.direction_sigma[1] < 0.02 * DEG
    assert abs(found.directions[2, 2]) > 0.9  # the worst known is about the vertical
    assert found.direction_sigma[2] > 3 * found.direction_sigma[1]
    assert np.linalg.norm(best[:2]) < 0.3 * np.linalg.norm((found.directions @ STATED)[:2])

    def tilt_at_end(change):
        end = multiply(q[0], accumulate(steps(samples.gyro + change, samples.dt_s))[-1])
        down = [Rotation.from_quat(each, scalar_first=True).as_matrix()[2] for each in (end, q[-1])]
        return np.arccos(np.clip(down[0] @ down[1], -1, 1)) / DEG

    assert tilt_at_end(np.zeros(3)) > 4
    assert tilt_at_end(found.change) < 1.5


def test_a_flight_holds_no_rest():
    assert find_rests(flight(seed=4)[0]) == []


@pytest.fixture(scope="module")
def two_days(tmp_path_factory):
    """The same sensor on two days: a session of 20 tumbles, and one of 8 with another bias."""
    parent = tmp_path_factory.mktemp("days")
    for name, turns, bias, seed in (("first", 20, (0.5, -0.3, 0.6), 1), ("second", 8, (0.62, -0.35, 0.51), 2)):
        write_session(parent / name, Table().tumble(turns, seed=seed).samples(bias_dps=bias, seed=seed))
    calibrate.main(
        ["fit", str(parent / "first"), "--methods", "least_squares", "--bias", "ends", "--quiet"]
    )  # its verdict is another test's
    return parent


@pytest.fixture(scope="module")
def with_nets(two_days, tmp_path_factory):
    """The same two days, the first one with nets too."""
    parent = shutil.copytree(two_days, tmp_path_factory.mktemp("nets") / "days")
    words = ["--methods", "least_squares,tinygc,tinygc_denoised", "--bias", "ends", "--quiet"]
    calibrate.main(["fit", str(parent / "first"), *words])
    return parent


@pytest.mark.broad
@pytest.mark.parametrize("method", ["tinygc", "tinygc_denoised"])
@pytest.mark.parametrize("source", ["start", "gravity", "given"])
def test_a_stored_net_in_a_new_session(with_nets, tmp_path, method, source):
    stored_in_a_new_session(with_nets, tmp_path, method, source)


@pytest.mark.parametrize("source", ["start", "gravity", "given"])
def test_a_stored_calibration_in_a_new_session(two_days, tmp_path, source):
    stored_in_a_new_session(two_days, tmp_path, "least_squares", source)


def stored_in_a_new_session(two_days, tmp_path, method, source):
    arguments = ["fit", str(two_days / "second"), "--model", str(two_days / "first" / "fit" / f"model_{method}.json"), "--bias", source]
    arguments += ["--bias-dps=0.62,-0.35,0.51"] if source == "given" else []
    assert calibrate.main([*arguments, "--out", str(tmp_path), "--quiet"]) == 0
    table = json.loads((tmp_path / "rebiased.json").read_text())
    tilt = {name: fit["holdout"]["tilt_rms_deg"] for name, fit in table["methods"].items()}
    assert tilt["stored"] > 0.3  # 0.16 dps over 5 s
    assert tilt[f"stored_{source}"] < {"start": 0.04, "gravity": 0.06, "given": 0.03}[source]
    model = json.loads((tmp_path / "model_rebiased.json").read_text())
    assert model["kind"] == {"least_squares": "linear"}.get(method, method)
    change = np.array(table["bias"]["change_dps"][source])
    assert np.abs(change - [-0.12, 0.05, 0.09]).max() < 0.02
    assert table["bias"]["fitted_here"] is False
    assert "fitted to other logs (first)" in table["bias"]["remarks"][0]
    assert len(table["bias"]["remarks"]) == 1  # a calibrated E: start and gravity agree


@pytest.mark.broad
def test_what_was_fitted_stays_and_still_compares_and_exports(two_days, tmp_path, capsys):
    folder = tmp_path / "second"
    shutil.copytree(two_days / "second", folder)
    assert calibrate.main(["fit", str(folder), "--methods", "least_squares", "--quiet"]) == 0
    before = {path.name: path.read_bytes() for path in (folder / "fit").iterdir()}
    stored = two_days / "first" / "fit" / "model_least_squares.json"
    assert calibrate.main(["fit", str(folder), "--model", str(stored), "--bias", "start", "--quiet"]) == 0
    after = {path.name: path.read_bytes() for path in (folder / "fit").iterdir()}
    assert {name: after[name] for name in before} == before
    assert set(after) - set(before) == {"model_rebiased.json", "rebiased.json"}
    assert calibrate.main(["compare", str(two_days / "first"), str(folder), "--quiet"]) == 0
    # With nothing but the new bias there, its own figures tell the noise.
    for name in before:
        (folder / "fit" / name).unlink()
    for model in ("rebiased", str(folder / "fit" / "model_rebiased.json")):
        assert calibrate.main(["export", str(folder), "--to", "kalibr", "--model", model, "--quiet"]) == 0
    noise = json.loads(after["rebiased.json"])["noise"]
    assert noise.items() <= json.loads(before["fit.json"])["noise"].items()
    assert f"{noise['accel_g_rthz'][0] * 9.80665:.3g}"[:4] in (folder / "export" / "imu.yaml").read_text()
    assert calibrate.main(["export", str(folder), "--to", "json", "--model", "rebiased", "--quiet"]) == 0


def rebiased(folder, model, out, *more):
    assert calibrate.main(["fit", str(folder), "--model", str(model), *(["--out", str(out)] if out else []), "--quiet", *more]) == 0
    return json.loads(((out or folder / "fit") / "rebiased.json").read_text())


@pytest.mark.broad
def test_a_model_of_this_very_session_is_said_to_be_that(two_days, tmp_path):
    first = two_days / "first"
    model = first / "fit" / "model_least_squares.json"
    table = rebiased(first, model, tmp_path, "--bias", "start")
    assert table["bias"]["fitted_here"] is True
    assert "fitted to this very session" in table["bias"]["remarks"][0]
    # With the bias of another day it is still the model of this one.
    rebiased(two_days / "second", model, tmp_path, "--bias", "start")
    again = tmp_path / "model_rebiased.json"
    assert rebiased(first, again, tmp_path / "x", "--bias", "start")["bias"]["fitted_here"] is True
    there = rebiased(two_days / "second", again, tmp_path / "y", "--bias", "start")
    assert there["bias"]["fitted_here"] is False
    assert "had its bias from this very session" in there["bias"]["remarks"][0]


@pytest.mark.broad
def test_a_bias_under_a_wrong_matrix_is_said_to_be_doubtful(two_days, tmp_path):
    E = np.eye(3) + np.array([[0.02, 0.01, 0], [0, -0.02, 0.01], [0.01, 0, 0.02]])
    (tmp_path / "wrong.json").write_text(json.dumps(models.to_dict(LinearModel(E, np.zeros(3)))))
    table = rebiased(two_days / "first", tmp_path / "wrong.json", tmp_path / "o", "--bias", "gravity")
    assert any("start and gravity differ by" in line and "uncalibrated" in line for line in table["bias"]["remarks"])
    assert max(table["bias"]["sigma_dps"]["gravity"]) > 0.015  # 0.007 with a calibrated E


@pytest.mark.parametrize(("turning_dps", "drift_dps"), [(0.298, 0.0), broad(0.0, 0.0), broad(0.0, 0.16)])
def test_a_first_still_that_turns_about_the_vertical_sets_no_bias(two_days, tmp_path, turning_dps, drift_dps):
    """And one of a sensor that warms up is none of these: it is near to the next."""
    bias = (0.62, -0.35, 0.51)
    table, rng = Table().steady(turning_dps, (0, 0, 1), 2), np.random.default_rng(7)
    for _ in range(9):
        table.turn(rng.uniform(90, 200), rng.normal(size=3)).rest(2)
    samples = table.samples(bias_dps=bias, seed=9)
    warm = drift_dps * np.exp(-samples.t_s / 15)
    day = write_session(tmp_path / "day", replace(samples, gyro=samples.gyro + warm[:, None] * [0, 0, DEG]))
    model = two_days / "first" / "fit" / "model_least_squares.json"
    table = rebiased(day, model, None, "--bias", "start")
    passed_over = [line for line in table["bias"]["remarks"] if "the first still is passed over" in line]
    assert bool(passed_over) == (turning_dps > 0)
    if passed_over:
        assert "0.298 dps otherwise than the other 9" in passed_over[0]
    expected = np.subtract([0.5, -0.3, 0.6], bias) - [0, 0, drift_dps]
    assert np.abs(table["bias"]["change_dps"]["start"] - expected).max() < 0.02


@pytest.mark.broad
def test_a_segment_left_out_is_not_judged(two_days, tmp_path):
    model = two_days / "first" / "fit" / "model_least_squares.json"
    whole = rebiased(two_days / "second", model, tmp_path / "a", "--bias", "start")
    less = rebiased(two_days / "second", model, tmp_path / "b", "--bias", "start", "--exclude", "2", "--no-earth")
    assert less["segments"]["used"] == whole["segments"]["used"] - 1
    assert {entry["segment"] for entry in less["segments"]["rejected"]} == {2}
    assert less["methods"]["stored"]["holdout"] != whole["methods"]["stored"]["holdout"]


@pytest.mark.parametrize(
    "more",
    [
        ["--resume"],
        ["--as-in-paper"],
        ["--physics", "auto"],
        ["--methods", "raw"],
        ["--folds", "3"],
        ["--still-rates"],
        ["--bias-per-log"],
    ],
)
def test_what_a_bias_of_the_day_does_not_heed_is_refused(two_days, more, capsys):
    model = two_days / "first" / "fit" / "model_least_squares.json"
    assert calibrate.main(["fit", str(two_days / "second"), "--model", str(model), "--bias", "start", *more]) == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith(f"calibrate: {more[0]}: ")
    assert "\n" not in said


@pytest.mark.broad
@pytest.mark.parametrize("more", [["--methods", "raw"], ["--methods", "tinygc"], ["--methods", "raw", "--as-in-paper"]])
def test_nothing_to_resume_is_said(two_days, more, capsys):
    assert calibrate.main(["fit", str(two_days / "second"), "--resume", *more]) == 2
    assert "--as-in-paper" in capsys.readouterr().err


@pytest.mark.broad
def test_the_limit_looks_at_what_was_asked_for(two_days, tmp_path, capsys):
    model = str(two_days / "first" / "fit" / "model_least_squares.json")
    arguments = ["fit", str(two_days / "second"), "--model", model, "--out", str(tmp_path), "--limit", "0.06"]
    assert calibrate.main([*arguments, "--bias", "start"]) == 0
    assert calibrate.main([*arguments, "--bias", "given", "--bias-dps=0,0,0"]) == 1
    assert "stored_given" in capsys.readouterr().err


@pytest.mark.parametrize(
    "more", [["--bias", "start"], ["--model", "x.json"], ["--model", "x.json", "--bias", "given"], ["--bias-dps=1,2,3"]]
)
def test_half_a_request_is_refused(two_days, more, capsys):
    assert calibrate.main(["fit", str(two_days / "second"), *more]) == 2
    assert "--model FILE --bias start" in capsys.readouterr().err


def test_a_model_that_is_none_is_refused(two_days, tmp_path, capsys):
    (tmp_path / "x.json").write_text("{}")
    assert calibrate.main(["fit", str(two_days / "second"), "--model", str(tmp_path / "x.json"), "--bias", "start"]) == 2
    assert capsys.readouterr().err.strip().split("\n")[-1].startswith("calibrate: ")
