"""``verify`` from the command line and in Python: verdicts of a sensor that changed, exit codes, files, and one line for what is wrong."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from formats_page import strangers
from processes import refused
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import tinygc
from session.base.errors import DataError
from session.base.units import DEG, G
from session.log.folder import input_hashes
from session.log.written import toml_text
from tinygc import SimulationOptions, models
from tinygc.library.simulations import Simulated
from tinygc.models.linear import LinearModel
from tinygc.models.model import accelerometer_table, sensor_table
from tinygc.simulation.simulator import simulate_session, unit_of

OPTIONS = SimulationOptions(segments=8, closure_s=0.0, odr_hz=62.5, seed=5, unit_seed=3)


SIGMA = np.r_[np.full(9, 1e-4), np.full(3, 0.003 * DEG)]


def session_of(unit, distort=None, **more):
    """A session of a unit; distort: its measured rates, by t_s, rate, force and temp_c."""
    return Simulated({}, simulate_session(replace(OPTIONS, **more), distort, unit=unit)).session


def write(path, vector, config, **more):
    table = models.to_dict(
        LinearModel.from_vector(vector), sensor=sensor_table(config.sensor), accelerometer=accelerometer_table(config.accelerometer), **more
    )
    path.write_text(json.dumps(table))
    return path


def rest_log(folder, session, shift=0.0, seconds=30):
    """A session of one log, a rest of the first still's readings."""
    samples, rng = session.logs[0].samples, np.random.default_rng(1)
    rows = rng.integers(0, 90, int(seconds * 62.5))
    gyro, accel = samples.gyro[rows] / DEG + shift, samples.accel[rows] / G
    gyro += 1e-3 * rng.normal(size=gyro.shape) * (np.ptp(gyro, axis=0) > 0)  # no reading twice, but of an axis that is stuck
    lines = ["t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"]
    lines += [f"{k / 62.5:.6f}," + ",".join(f"{v:.7f}" for v in (*g, *a)) for k, (g, a) in enumerate(zip(gyro, accel, strict=True))]
    folder.mkdir()
    (folder / "session.toml").write_text(toml_text(session.config))
    (folder / "log0001.csv").write_text("\n".join(lines) + "\n")
    return folder / "log0001.csv"


#: noise of the old fit, as fit.json holds it
COMPONENTS = [("noise.bias_wander", 2.0, 1.0), ("noise.still_rate", 0.001, 0.001), ("noise.turn", 1, 1)]
CALM = {"schema": "tinygc-fit/2", "noise": {"components": [dict(zip(("name", "size", "sigma"), each, strict=True)) for each in COMPONENTS]}}


@pytest.fixture(scope="module")
def unit():
    return unit_of(OPTIONS)


@pytest.fixture(scope="module")
def today(unit):
    return session_of(unit)


@pytest.fixture(scope="module")
def model(unit, today, tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    (folder / "fit.json").write_text(json.dumps(CALM))
    return write(folder / "model.json", np.r_[unit.E.ravel(), unit.B], today.config, covariance=np.diag(SIGMA**2).tolist())


@pytest.fixture(scope="module")
def folder(unit, tmp_path_factory):
    """A session of the unit as it was calibrated."""
    return Simulated({"effects": {}}, simulate_session(OPTIONS, unit=unit)).save(tmp_path_factory.mktemp("verify") / "today")


def test_another_sensors_recording_is_refused_unless_that_is_accepted_and_what_holds_says_so(model, folder, run, tmp_path):
    table = json.loads(model.read_text())
    table["sensor"]["serial"] = "OTHER"
    (tmp_path / "other.json").write_text(json.dumps(table))
    (tmp_path / "fit.json").write_text(json.dumps(CALM))
    refused(run("verify", tmp_path / "other.json", folder, "--quiet"), "--other-serial")
    files = ("--json", tmp_path / "found.json", "--write", tmp_path / "anew.json")
    code, out, _ = run("verify", tmp_path / "other.json", folder, "--other-serial", *files)
    assert (code, out.startswith("HOLDS: ")) == (0, True)
    assert json.loads((tmp_path / "anew.json").read_text())["stored"]["method"] is None
    found = json.loads((tmp_path / "found.json").read_text())
    assert strangers(found) == []
    assert [question["holds"] for question in found["questions"]] == [True, True, True, True]
    for question in found["questions"][:3]:
        assert chi2.sf(question["chi_square"], question["freedom"]) == pytest.approx(question["p_value"], rel=1e-6)
    assert found["false_alarm"] == 0.05
    assert np.abs(found["cost"]["as_it_is_deg"]).max() < 1.0


def test_a_zero_that_moved_is_taken_anew_and_the_new_model_holds(model, unit, tmp_path):
    moved = np.array([1.0, -0.6, 0.8]) * DEG
    today = session_of(replace(unit, B=unit.B + moved))
    found = tinygc.verify(model, today)
    assert (found.answer, found.exit_code) == ("holds with a new bias", 1)
    assert found.bias_dps == pytest.approx((unit.B + moved) / DEG, abs=0.01)
    assert found.diagnosis.best.names == ("bias",)
    assert any("no temperature in the model" in note for note in found.notes)
    x, y, z = re.findall(r"[xyz] ([-+][\d.]+)", " ".join(found.diagnosis.best.stated[0].numbers))
    assert [float(x), float(y), float(z)] == pytest.approx(-moved / DEG, abs=0.01)  # it reads less where B is more
    printed = re.search(r"New bias, dps: x (\S+) ± \S+, y (\S+) ± \S+, z (\S+) ±", found.summary())
    assert [float(each) for each in printed.groups()] == pytest.approx(-np.linalg.solve(unit.E, unit.B + moved) / DEG, abs=0.01)
    written = found.save_model(tmp_path / "anew.json")
    assert pytest.approx(found.bias_dps) == tinygc.load(written).model.B / DEG
    table = json.loads(written.read_text())
    covariance = np.array(table["covariance"])
    assert table["temperature_c"] == pytest.approx(today.temperature_c, abs=0.01)  # the mean over its stills
    assert covariance[9:, 9:] == pytest.approx(found.bias_covariance)
    assert not covariance[9:, :9].any()
    assert covariance[:9, :9] == pytest.approx(np.diag(SIGMA**2)[:9, :9])
    again = tinygc.verify(written, today)  # whose file says how warm it was
    assert (again.answer, any("no temperature" in note for note in again.notes)) == ("holds", False)


def test_what_changed_in_e_is_named_and_b_anew_is_not_written(model, unit, tmp_path):
    turned = [0.02, -0.01, 0.015]
    R = Rotation.from_rotvec(turned).as_matrix()
    found = tinygc.verify(model, session_of(replace(unit, E=R @ unit.E, B=R @ unit.B)))
    best, cost = found.diagnosis.best, found.cost
    assert (found.answer, found.exit_code, best.names) == ("does not hold", 1, ("rotation",))
    assert best.theta == pytest.approx(turned, abs=5e-4)
    assert np.linalg.norm(cost.with_new_bias) > 0.5 * np.linalg.norm(cost.as_it_is)  # another B does not repair E
    with pytest.raises(DataError, match="not written with a new bias: gyroscope is turned against the accelerometer: "):
        found.save_model(tmp_path / "anew.json")
    assert not (tmp_path / "anew.json").exists()


@pytest.mark.parametrize(
    ("shift", "code", "words"),
    [
        (0.0, 0, ["HOLDS: bias is fine; ", "Not tested: a scale error of ", "  1. "]),
        (0.15, 5, []),
        (4.0, 1, ["then record the turns above"]),
    ],
)
def test_verify_and_watch_say_the_same_of_a_rest(model, today, run, tmp_path, shift, code, words):
    """Within the noise; as a switch-on may move it, and more than a minute bears; beyond any switch-on, by more than a turn in a minute."""
    log = rest_log(tmp_path / "rest", today, shift=shift)
    said = [run("verify", model, log.parent)[:2], run("watch", model, log)[:2]]
    assert [code for code, _ in said] == [code, code]
    assert [each for each in words if each not in said[0][1]] == []
    costs = [float(re.search(r"(?:next minute|zero error) ([\d.]+)°", " ".join(out.splitlines())).group(1)) for _, out in said]
    assert costs == pytest.approx([60 * np.sqrt(3) * shift] * 2, rel=0.05, abs=1.0)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("missing.json", "TODAY"), "cannot be read"),
        (("MODEL", "missing"), "not found"),
        (("MODEL", "MODEL"), "no session folder; `"),
        (("TODAY", "TODAY"), "run `"),
        (("MODEL", "TODAY", "--write", "MODEL"), "model.json"),
        (("MODEL", "TODAY", "--false-alarm", "0"), "--false-alarm"),
        (("MODEL", "TODAY", "--limit", "nan"), "--limit"),
    ],
)
def test_what_is_wrong_is_said(model, folder, run, words, says):
    code, _, error = run("verify", *({"MODEL": model, "TODAY": folder}.get(each, each) for each in words), "--quiet")
    assert (code, says in error) == (2, True)


def test_a_zero_that_differs_from_rest_to_rest_is_seen_where_the_old_rests_were_calm(model, unit):
    found = tinygc.verify(model, session_of(unit, lambda t_s, rate, force, temp_c: rate + 0.1 * DEG * force / G))
    noise = {question.name: question for question in found.questions}["noise"]
    assert (noise.holds, found.answer) == (False, "does not hold")
    assert 60 * noise.left_rps / DEG == pytest.approx(60 * 0.1 / np.sqrt(3), rel=0.7)


def test_rates_in_another_unit_are_said_to_be(model, today):
    (log,) = today.logs
    wrong = replace(log, samples=replace(log.samples, gyro=np.asarray(log.samples.gyro) * DEG), raw=False)
    found = tinygc.verify(model, replace(today, logs=(wrong,)))
    assert (found.answer, found.bias_serves, "the rates are in rad/s" in found.headline) == ("does not hold", False, True)


@pytest.mark.parametrize(("factor", "axis", "says"), [(2.0, 1.0, "gravity: 19"), (1.0, 0.0, "gyro stuck: y")])
def test_a_minute_at_rest_refuses_what_the_first_look_refuses(model, today, tmp_path, factor, axis, says):
    (log,) = today.logs
    samples = replace(log.samples, gyro=log.samples.gyro * np.array([1, axis, 1]), accel=log.samples.accel * factor)
    with pytest.raises(DataError, match=says):
        tinygc.verify(model, rest_log(tmp_path / "rest", replace(today, logs=(replace(log, samples=samples),))).parent)


def rests_with(folder, session, jump_dps):
    """Six rests of 8 s in one attitude, moved to and fro between them; the zero jumps after the third."""
    path = rest_log(folder, session, seconds=60)
    lines = path.read_text().splitlines()
    for number, line in enumerate(lines[1:]):
        t, *rates, ax, ay, az = line.split(",")
        moved = jump_dps if number >= 30 * 62.5 else 0.0
        knock = 2.0 * np.sin(2 * np.pi * (number % 625) / 125) if number >= 625 and number % 625 < 125 else 0.0
        lines[1 + number] = ",".join([t, *(f"{float(rate) + moved + knock:.7f}" for rate in rates), ax, ay, az])
    path.write_text("\n".join(lines) + "\n")
    return folder


def test_a_jump_between_rests_is_seen_and_knocks_are_no_turns(model, today, tmp_path):
    found = tinygc.verify(model, rests_with(tmp_path / "rests", today, jump_dps=0.1))
    noise = {question.name: question for question in found.questions}["noise"]
    assert (found.rows.turns, found.rows.stills, noise.rank, noise.holds) == (0, 6, 15, False)
    assert (found.diagnosis.best.names, found.answer) == (("step",), "does not hold")


def test_a_recording_does_not_verify_the_model_that_was_fitted_to_it(unit, today, tmp_path):
    path = write(tmp_path / "own.json", np.r_[unit.E.ravel(), unit.B], today.config, sha256=input_hashes(today))
    found = tinygc.verify(path, today)
    assert (found.answer, found.exit_code, "fitted to this very recording" in found.headline) == ("undecided", 5, True)


def test_a_board_whose_clock_is_off_is_compared_by_the_clock_of_the_model(unit, today, model, tmp_path):
    """Stamps that run 0.45 % fast, E by either clock: it holds, as sharply as by true stamps; a clock that is not to be had is said."""
    ratio = 1.0045
    logs = tuple(replace(log, samples=replace(log.samples, t_ns=np.rint(log.samples.t_ns * ratio).astype(np.int64))) for log in today.logs)

    def on(logs, **clock):
        return replace(today, logs=logs, config=replace(today.config, sensor=replace(today.config.sensor, **clock)))

    def of(clock, scale):
        how = {"covariance": np.diag(SIGMA**2).tolist(), "clock": clock}
        return write(tmp_path / f"{clock}.json", np.r_[unit.E.ravel(), unit.B] * scale, today.config, **how)

    found = tinygc.verify(of("board", 1 / ratio), on(logs, clock_ratio=ratio, clock_sigma_ppm=20.0))
    assert (found.answer, found.bounds[0].is_seen) == ("holds", True)
    assert any("Model by the computer's clock" in each for each in tinygc.verify(of("arrivals", 1.0), on(logs)).facts)
