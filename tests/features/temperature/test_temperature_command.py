"""``temperature`` from the command line: what it prints, writes and refuses, and what the other commands make of it."""

import json
import re
import shutil
import tomllib

import numpy as np
import pytest
from formats_page import told
from scipy.spatial.transform import Rotation

import calibrate
from session.log.config import Accelerometer
from session.log.logfile import read_log
from tinygc import SimulationOptions, read_session
from tinygc.features.temperature.feature import RestOptions
from tinygc.features.temperature.rest_simulation import write_rest


@pytest.fixture(scope="module")
def rests(tmp_path_factory):
    """A folder of one rest log, fitted by nobody yet; read only."""
    options = RestOptions(cycles=2.0, cycle_s=300.0, cold_c=5.0, warm_c=55.0, lag_s=25.0, slope_dps_per_c=0.034)
    return write_rest(options, SimulationOptions(odr_hz=62.5, seed=3), tmp_path_factory.mktemp("rest") / "rests")


@pytest.fixture(scope="module")
def fitted(rests, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fitted") / "rests"
    shutil.copytree(rests, folder)
    return folder, told(folder.parent / "x.json", "temperature", folder)


def test_the_numbers_are_the_truths_and_applied_nothing_is_left(fitted, tmp_path, run):
    folder, table = fitted
    for axis, sign in zip(table["gyro"], (1, -1, 1), strict=True):
        assert axis["terms_dps"][1] == pytest.approx(sign * 0.034, abs=4 * axis["terms_std_dps"][1])
        assert axis["lag_s"] == pytest.approx(25, abs=4 * axis["lag_std_s"])
        assert axis["held_out_dps"] < 0.05 * axis["held_out_constant_dps"]
    assert table["remaining_dps"] == [axis["held_out_dps"] for axis in table["gyro"]]
    assert (folder / "fit" / "temperature.svg").read_bytes()[:4] == b"<svg"
    out = tmp_path / "out.csv"
    code, _, err = run("apply", folder / "fit" / "model_thermal.json", folder / "rest0001.csv.gz", "-o", out, "--unit", "dps")
    assert code == 0, err
    rates = np.loadtxt(out, delimiter=",", skiprows=1, usecols=(1, 2, 3))
    assert np.abs(rates[: len(rates) // 2000 * 2000].reshape(-1, 2000, 3).mean(axis=1)).max() < 0.01


def test_export_takes_the_only_model_that_there_is(fitted, tmp_path, run):
    code, _, err = run("export", fitted[0], "--to", "px4", "--out", tmp_path / "export")
    assert code == 0, err
    assert any((tmp_path / "export").iterdir())


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("fit RESTS", "or temperature reads them"),
        ("temperature EMPTY", "neither a rest log nor a log"),
        ("temperature RESTS OTHER", "sensor.serial is 'SIM-4'"),
        ("simulate --out EMPTY/s --rest-cycles 1 --rest-warm-c 200", "--rest-warm-c"),
    ],
)
def test_what_is_wrong_is_refused(folder, rests, tmp_path, run, words, says):
    text = (rests / "session.toml").read_text()
    shutil.copytree(rests, tmp_path / "other")
    (tmp_path / "other" / "session.toml").write_text(text.replace('serial = "SIM-3"', 'serial = "SIM-4"'))
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "session.toml").write_text(text)
    for name, path in (("RESTS", rests), ("FOLDER", folder), ("OTHER", tmp_path / "other"), ("EMPTY", tmp_path / "empty")):
        words = words.replace(name, str(path))
    code, _, err = run(*words.split())
    assert (code, says in err) == (2, True)


def test_one_recording_is_not_two(folder, rests, tmp_path, run):
    """As the same folder, as a copy of it, and a rest log as a copy."""
    shutil.copytree(folder, tmp_path / "copy")
    shutil.copytree(rests, tmp_path / "rests")
    for one, other, name in ((folder, folder, "log"), (folder, tmp_path / "copy", "log"), (rests, tmp_path / "rests", "rest")):
        code, _, err = run("temperature", one, other, "--out", tmp_path / "fit")
        assert code == 2
        assert f"{one / name}0001.csv" in err
        assert f"{other / name}0001.csv" in err
        assert "are the same recording" in " ".join(err.split())
        assert not (tmp_path / "fit").exists()


#: 14 mrad
TURN = Rotation.from_rotvec([0.010, -0.006, 0.008]).as_matrix()


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    """Two sessions of one unit: one with a full matrix that turns its frame, the other without a calibration; read only."""
    top = tmp_path_factory.mktemp("frames")
    for name, seed in (("turned", 1), ("bare", 2)):
        options = ["--segments", "8", "--closure", "0", "--odr-hz", "62.5", "--quiet", "--unit-seed", "9"]
        assert calibrate.main(["simulate", "--out", str(top / name), "--seed", str(seed), *options]) == 0
    text = (top / "turned" / "session.toml").read_text()
    matrix = (TURN @ np.array(tomllib.loads(text)["accelerometer"]["matrix"])).tolist()
    (top / "turned" / "session.toml").write_text(re.sub(r"matrix = .*", f"matrix = {matrix}", text))
    text = (top / "bare" / "session.toml").read_text()
    head, rest = text.split("[accelerometer]")
    (top / "bare" / "session.toml").write_text(head + "[" + rest.split("\n[", 1)[1])
    return top


def test_sessions_in_two_frames_do_not_scatter_and_the_model_is_in_the_first(days, tmp_path, run):
    """The force that ``apply`` writes is in E's frame, though the log's own session.toml says nothing of an accelerometer."""
    code, _, err = run("temperature", days / "turned", days / "bare", "--out", tmp_path / "fit", "--json", tmp_path / "fit.json")
    assert code == 0, err
    found = json.loads((tmp_path / "fit.json").read_text())["E_goodness"]
    assert (found["p_value"] > 0.01, found["variance_inflation"] < 2.5) == (True, True)
    table, first = json.loads((tmp_path / "fit" / "model_thermal.json").read_text()), read_session(days / "turned").config.accelerometer
    own = Accelerometer(*(np.array(table["accelerometer"][key]) for key in ("matrix", "bias_mps2")))
    np.testing.assert_allclose(own.matrix, first.matrix, atol=5e-4)  # but for what the stills add
    session, out = read_session(days / "bare"), tmp_path / "out.csv"
    (log,) = session.logs
    code, _, err = run("apply", tmp_path / "fit" / "model_thermal.json", log.path, "-o", out, "--json", tmp_path / "x.json")
    assert code == 0, err
    assert json.loads((tmp_path / "x.json").read_text())["accelerometer"] == "model"
    np.testing.assert_allclose(read_log(out, session.config.sensor).samples.accel, own.correct(log.samples.accel), atol=1e-5)
