"""A drift or a step belongs to the time of its own session: a model that undoes one refuses every other, and has a form for any time."""

import json
import shutil
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from conftest import config
from models_in_use import KNOWN, LINEAR, NET, SAMPLES, physics

import calibrate
import tinygc
from session.base.units import DEG
from session.log.config import Sensor
from session.log.logfile import read_log
from tinygc import CalibrationError, SimulationOptions, models
from tinygc.deploy.calibration import Calibration
from tinygc.effects import AppliedEffect, catalogue
from tinygc.estimation.session_times import YEAR_S, Moment, moment_of, parsed, times_of
from tinygc.models.physics import CarriedNet, PhysicsModel
from tinygc.simulation.write import write_session

RATE_HZ = 1 / SAMPLES.period_s


def stepped(at_s):
    step = catalogue()["gyro.bias_step"].at(at_s)
    return PhysicsModel(LINEAR, (*physics("gyro.g_sensitivity").claims, AppliedEffect(step, np.array([1e-3, 2e-3, -3e-3]))), KNOWN)


BYGONE = {
    "drift": physics("gyro.bias_drift"),
    "step beside others": stepped(12.003),
    "net behind a drift": CarriedNet(physics("gyro.bias_drift"), NET),
    "net behind more": CarriedNet(physics("gyro.g_sensitivity", "gyro.bias_drift"), NET),
}


@pytest.mark.parametrize("name", BYGONE)
def test_within_the_session_it_calibrates_and_nowhere_else_and_live_is_refused(name):
    model, end_s = BYGONE[name], KNOWN.duration_s
    assert np.isfinite(model.calibrate(SAMPLES, end_s - SAMPLES.duration_s)).all()
    for began_s in (-10.0, end_s - SAMPLES.duration_s / 2, float("nan"), float("inf")):
        with pytest.raises(CalibrationError, match=r"known from 0 to .* s of its session.*_at_end"):
            model.calibrate(SAMPLES, began_s)
    calibration = Calibration(model, RATE_HZ)
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


# The commands


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A session with a drift, fitted with it; and a folder with another session."""
    at = tmp_path_factory.mktemp("time")
    options = {"segments": 12, "odr_hz": 62.5, "closure_s": 0.0}
    drift = lambda t_s, rate, force, temp_c: rate + np.outer(t_s / 100.0, [0.3, -0.2, 0.25]) * DEG  # noqa: E731
    folder = write_session(SimulationOptions(**options, seed=5), at / "drifting", distort=drift)
    words = ["fit", str(folder), "--physics", "gyro.bias_drift", "--methods", "least_squares", "--quiet"]
    assert calibrate.main(words) in (0, 1)
    return folder, write_session(SimulationOptions(**options, seed=6), at / "other")


def test_apply_knows_the_sessions_own_log_and_refuses_others(fitted, tmp_path, run):
    folder, other = fitted
    model, ended = (folder / "fit" / f"model_physics{end}.json" for end in ("", "_at_end"))
    own = tmp_path / "under_another_name.csv.gz"
    shutil.copy(folder / "log0001.csv.gz", own)
    shutil.copy(folder / "session.toml", tmp_path)
    assert run("apply", model, own, "-o", tmp_path / "own.csv", "--quiet")[0] == 0
    code, _, err = run("apply", model, other / "log0001.csv.gz", "-o", tmp_path / "x.csv", "--quiet")
    assert (code, err.count("\n")) == (2, 1)
    assert "no log of the session whose time model_physics.json follows (gyro.bias_drift); apply model_physics_at_end" in err
    assert not (tmp_path / "x.csv").exists()
    assert run("apply", ended, own, "-o", tmp_path / "ended.csv", "--quiet")[0] == 0
    sensor = Sensor("", "", 62.5, 500, 4)
    off = np.subtract(*(read_log(tmp_path / f"{name}.csv", sensor).samples.gyro[:] for name in ("ended", "own"))) / DEG
    np.testing.assert_allclose(off[-1], 0, atol=1e-3)  # dps: at the end they are one
    table = json.loads(model.read_text())
    np.testing.assert_allclose(off[0], np.array([-0.3, 0.2, -0.25]) * table["conditions"]["duration_s"] / 100, atol=0.03)
    for name, broken in (("sha256", {}), ("began_s", "x"), ("began_s", {"log0001.csv.gz": None})):
        (tmp_path / "m.json").write_text(json.dumps(table | {name: broken}))
        code, _, err = run("apply", tmp_path / "m.json", folder / "log0001.csv.gz", "-o", tmp_path / "x.csv", "--quiet")
        assert (code, err.count("\n")) == (2, 1)


def test_export_refuses_it_and_takes_the_one_for_any_time(fitted, tmp_path, run):
    folder, _ = fitted
    words = ["export", folder, "--to", "json", "--out", tmp_path, "--quiet", "--model"]
    code, _, err = run(*words, "physics")
    assert (code, err.count("\n")) == (2, 1)
    assert "corrects gyro.bias_drift" in err
    assert "--model physics_at_end" in err
    assert run(*words, "physics_at_end")[0] == 0
    saved = tinygc.load(folder / "fit" / "model_physics_at_end.json").to_json()
    assert saved["method"] == "physics_at_end"
    bias = np.sqrt(np.diag(np.array(saved["covariance"])))[9:12] / DEG
    assert (bias < 0.02).all()
    assert (bias > 1e-4).all()


# When a session was recorded: by its port, its notes, its log's stamps, its folder's name, and never by a file's time

NOTED = replace(config(), notes={"date": "2026-03-04T10:00:00+02:00"})


def log(folder, first_ns):
    rows = "".join(f"{first_ns + 10_000_000 * i},0,0,0,0,0,-1000\n" for i in range(5))
    (folder / "log0001.csv").write_text("t_ns,gx,gy,gz,ax,ay,az\n" + rows)


def test_the_first_of_port_notes_stamps_and_name_counts(tmp_path):
    folder = tmp_path / "bench_20250607_a"
    folder.mkdir()
    assert moment_of(folder, config()) == Moment(datetime(2025, 6, 7, tzinfo=UTC), "name")
    assert moment_of(folder, None) == Moment(datetime(2025, 6, 7, tzinfo=UTC), "name")
    log(folder, 1_700_000_000 * 10**9)
    assert moment_of(folder, config()) == Moment(datetime(2023, 11, 14, 22, 13, 20, tzinfo=UTC), "stamps")
    assert moment_of(folder, NOTED) == Moment(datetime(2026, 3, 4, 8, tzinfo=UTC), "notes")
    (folder / "raw.times").write_text("0,0,open 2026-01-02T03:04:05+00:00\n")
    assert moment_of(folder, NOTED).source == "port"


def test_a_boards_own_clock_a_files_time_and_other_text_are_no_date(tmp_path):
    log(tmp_path, 5 * 10**9)
    plain = tmp_path / "day1"
    plain.mkdir()
    log(plain, 5 * 10**9)
    assert moment_of(plain, config()) is None
    assert moment_of(plain, replace(config(), notes={"date": "a rainy Tuesday"})) is None
    assert parsed("2026-02-30") is None
    assert parsed("0001-01-01T00:00:00+14:00") is None
    assert [parsed(text) for text in ("", "5", "x" * 1000)] == [None, None, None]


@pytest.mark.parametrize("name", ["a1202506071", "2025-16-07", "r20250647"])
def test_digits_that_are_no_day_are_none(tmp_path, name):
    (tmp_path / name).mkdir()
    assert moment_of(tmp_path / name, None) is None


def test_sessions_are_in_the_order_of_their_dates_or_as_they_come():
    days = [Moment(datetime(2026, month, 1, tzinfo=UTC), "notes") for month in (5, 1, 9)]
    order, at = times_of(days)
    assert order.tolist() == [1, 0, 2]
    np.testing.assert_allclose(at, np.array([0, 120, 243]) * 86400 / YEAR_S)
    for without in ([*days, None], [days[0], days[0]]):
        order, at = times_of(without)
        assert order.tolist() == at.tolist() == list(range(len(without)))
