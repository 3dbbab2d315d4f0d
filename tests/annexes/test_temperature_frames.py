"""Sessions at several temperatures whose accelerometers define different body frames: E of all in one."""

import json
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calibrate
from session.io.config import Accelerometer
from session.io.logfile import read_log
from tinygc import read_session
from tinygc.annexes.temperature.sessions_fit import SessionPoint, in_frame_of_first, join, point_of, zero_form
from tinygc.models.linear import MATRIX, LinearModel

#: 14 mrad
TURN = Rotation.from_rotvec([0.010, -0.006, 0.008]).as_matrix()
UPPER = np.array([[1.01, 0.004, -0.003], [0, 0.99, 0.002], [0, 0, 1.005]])


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    """Two sessions of one unit: one with a full matrix that turns its frame, the other without a calibration; read only."""
    top = tmp_path_factory.mktemp("frames")
    for name, seed in (("turned", 1), ("bare", 2)):
        options = ["--segments", "20", "--closure", "0", "--odr-hz", "104", "--quiet", "--unit-seed", "9"]
        assert calibrate.main(["simulate", "--out", str(top / name), "--seed", str(seed), *options]) == 0
    text = (top / "turned" / "session.toml").read_text()
    matrix = (TURN @ np.array(tomllib.loads(text)["accelerometer"]["matrix"])).tolist()
    (top / "turned" / "session.toml").write_text(re.sub(r"matrix = .*", f"matrix = {matrix}", text))
    text = (top / "bare" / "session.toml").read_text()
    head, rest = text.split("[accelerometer]")
    (top / "bare" / "session.toml").write_text(head + "[" + rest.split("\n[", 1)[1])
    return top


def test_a_point_turned_is_the_point_of_the_turned_model():
    """By the model itself: Q (E m + B), with the covariance of Q E and Q B, has the zero that E m + B has."""
    rng = np.random.default_rng(0)
    model, root = LinearModel(np.eye(3) + 0.01 * rng.normal(size=(3, 3)), 0.01 * rng.normal(size=3)), 1e-4 * rng.normal(size=(12, 12))
    both = np.block([[np.kron(TURN, np.eye(3)), np.zeros((9, 3))], [np.zeros((3, 9)), TURN]])
    bare = SessionPoint("bare", 20.0, 19.0, 21.0, *zero_form(model, root @ root.T), 20, Accelerometer(UPPER, source="stills"))
    turned = replace(bare, accelerometer=Accelerometer(TURN @ UPPER))
    expected = zero_form(LinearModel(TURN @ model.E, TURN @ model.B), both @ root @ root.T @ both.T)
    found = in_frame_of_first([turned, bare])[1]
    np.testing.assert_allclose(found.values, expected[0], atol=1e-12)
    np.testing.assert_allclose(found.covariance, expected[1], atol=1e-18)
    np.testing.assert_array_equal(in_frame_of_first([bare, bare])[1].values, bare.values)


def test_sessions_in_two_frames_do_not_scatter(days):
    points = [point_of(read_session(days / name), None) for name in ("turned", "bare")]
    as_they_stand = join([replace(point, accelerometer=Accelerometer()) for point in points], None)
    assert as_they_stand.p_value < 1e-6
    assert as_they_stand.widened > 1000
    found = join(points, None)
    assert found.p_value > 0.01
    assert found.widened < 2.5
    np.testing.assert_array_equal(found.points[0].values, points[0].values)
    sigma = np.sqrt(np.diag(points[0].covariance)[MATRIX] + np.diag(points[1].covariance)[MATRIX])
    assert (np.abs(found.model.E_terms[0].ravel() - points[0].values[MATRIX]) < 4 * sigma).all()


@pytest.mark.broad
def test_the_model_holds_the_first_sessions_accelerometer_and_apply_takes_it(days, tmp_path, run):
    """The force that ``apply`` writes is in E's frame, though the log's own session.toml says nothing of an accelerometer."""
    code, _, err = run("fit", days / "turned", days / "bare", "--temperature", "--out", tmp_path / "fit")
    assert code == 0, err
    table = json.loads((tmp_path / "fit" / "model_thermal.json").read_text())
    first = point_of(read_session(days / "turned"), None).accelerometer
    np.testing.assert_array_equal(table["accelerometer"]["matrix"], first.matrix)
    np.testing.assert_array_equal(table["accelerometer"]["bias_mps2"], first.bias_mps2)
    session = read_session(days / "bare")
    log, out = session.logs[0], tmp_path / "out.csv"
    code, _, err = run("apply", tmp_path / "fit" / "model_thermal.json", log.path, "-o", out, "--json", tmp_path / "x.json")
    assert code == 0, err
    assert json.loads((tmp_path / "x.json").read_text())["accelerometer"] == "model"
    written = read_log(out, session.config.sensor).samples.accel
    np.testing.assert_allclose(written, first.correct(log.samples.accel), atol=1e-5)
