"""``calibrate.py apply``: specific force, whose calibration holds for it, and that nobody calibrates a log twice."""

import json

import numpy as np
import pytest
from conftest import SESSION_TOML, write_session
from models_in_use import LINEAR, RATE_HZ, SAMPLES
from scipy.spatial.transform import Rotation

import calibrate
import tinygc
from session.io.config import Accelerometer, Sensor
from session.io.errors import DataError, FormatError
from session.io.folder import sha256_of
from session.io.logfile import read_log
from tinygc import CalibrationError, models, read_session
from tinygc.deploy.calibration import in_frame_of
from tinygc.models.model import accelerometer_of, accelerometer_table

TURN = Rotation.from_rotvec([4e-3, -2e-3, 3e-3]).as_matrix()
UPPER = np.array([[1.01, 0.002, -0.004], [0, 0.99, 0.003], [0, 0, 1.005]])
OWN = Accelerometer(TURN @ UPPER, np.array([0.3, -0.2, 0.1]), "prior")
OTHER = Accelerometer(UPPER @ np.diag([1.002, 0.999, 1.0]), np.array([0.25, -0.2, 0.12]))


def toml(accelerometer):
    return SESSION_TOML + f"[accelerometer]\nmatrix = {accelerometer.matrix.tolist()}\nbias_mps2 = {accelerometer.bias_mps2.tolist()}\n"


def model_file(path, accelerometer=OWN, **more):
    beside = {} if accelerometer is None else {"accelerometer": accelerometer_table(accelerometer)}
    path.write_text(json.dumps(models.to_dict(LINEAR, **beside, **more)))
    return path


def applied(*arguments):
    return calibrate.main(["apply", *map(str, arguments), "--force", "--quiet"])


def read(path):
    return read_log(path, Sensor("", "", RATE_HZ, 500, 4)).samples


@pytest.fixture
def folder(tmp_path):
    return write_session(tmp_path / "session", SAMPLES)


@pytest.mark.parametrize(
    ("own", "beside", "named", "expected", "source"),
    [
        (OWN, None, False, OWN, "model"),
        (OWN, OTHER, False, OWN, "model"),
        (OWN, OTHER, True, in_frame_of(OWN, OTHER)[0], "session"),
        (OWN, None, True, OWN, "model"),
        (None, OTHER, False, OTHER, "session"),
        (None, OTHER, True, OTHER, "session"),
        (None, None, True, Accelerometer(), "none"),
        (Accelerometer(source="none"), None, False, Accelerometer(), "none"),
    ],
)
def test_whose_calibration_the_specific_force_has(own, beside, named, expected, source, folder, tmp_path):
    (folder / "session.toml").write_text(SESSION_TOML if beside is None else toml(beside))
    path, out = model_file(tmp_path / "m.json", own), tmp_path / "out.csv"
    assert applied(path, folder / "log0001.csv", "-o", out, *(["--session", folder] if named else []), "--json", tmp_path / "a.json") == 0
    logged, made = read(folder / "log0001.csv"), read(out)
    np.testing.assert_allclose(made.accel, expected.correct(logged.accel), rtol=0, atol=6e-7)
    assert json.loads((tmp_path / "a.json").read_text())["accelerometer"] == source


def test_the_session_that_a_model_was_fitted_with_does_not_know_better(folder, tmp_path):
    """Named or not: the fit sharpened what stands there."""
    (folder / "session.toml").write_text(toml(OTHER))
    path = model_file(tmp_path / "m.json", OWN, sha256={"session.toml": sha256_of(folder / "session.toml")})
    assert applied(path, folder / "log0001.csv", "-o", tmp_path / "out.csv", "--session", folder) == 0
    np.testing.assert_allclose(read(tmp_path / "out.csv").accel, OWN.correct(read(folder / "log0001.csv").accel), rtol=0, atol=6e-7)


def test_what_apply_wrote_is_read_again_and_calibrated_once(folder, tmp_path, capsys):
    (folder / "session.toml").write_text(toml(OTHER))
    path, again = model_file(tmp_path / "m.json"), tmp_path / "again"
    again.mkdir()
    assert applied(path, folder / "log0001.csv", "-o", again / "log0001.csv") == 0
    (again / "session.toml").write_text(toml(OTHER))
    session = read_session(again)
    force = OWN.correct(read(folder / "log0001.csv").accel)
    np.testing.assert_allclose(session.calibrated(session.logs[0]).accel, force, rtol=0, atol=6e-7)
    assert "calibrated already" in session.logs[0].notes[-1]
    # Through replay, too; and a second apply is refused in one line.
    assert (
        calibrate.main(["import", str(again / "log0001.csv"), "--out", str(tmp_path / "copy"), "--gyro-fs", "500", "--accel-fs", "4"]) == 0
    )
    (tmp_path / "copy" / "session.toml").write_text(toml(OTHER))
    copy = read_session(tmp_path / "copy")
    np.testing.assert_allclose(copy.calibrated(copy.logs[0]).accel, force, rtol=0, atol=6e-7)
    capsys.readouterr()
    assert applied(path, again / "log0001.csv", "-o", tmp_path / "twice.csv") == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "twice.csv").exists()


def test_calibrated_logs_beside_measured_ones_are_refused(folder, tmp_path):
    assert applied(model_file(tmp_path / "m.json"), folder / "log0001.csv", "-o", folder / "log0002.csv") == 0
    with pytest.raises(DataError, match=r"log0002\.csv has calibrated specific force, log0001\.csv has not"):
        read_session(folder)


def test_in_python_the_model_calibrates_force_as_apply_does(tmp_path):
    model = tinygc.load(model_file(tmp_path / "m.json"))
    np.testing.assert_allclose(model.force(SAMPLES.accel), OWN.correct(SAMPLES.accel), rtol=0, atol=1e-12)
    np.testing.assert_allclose(model.force(SAMPLES.accel[3]), OWN.correct(SAMPLES.accel)[3], rtol=0, atol=1e-12)
    for wrong in ([1.0, 2.0], np.zeros((2, 2, 3)), [np.nan, 0, 0], "x"):
        with pytest.raises(CalibrationError):
            model.force(wrong)
    with pytest.raises(CalibrationError, match="no calibration of the accelerometer"):
        tinygc.load(model_file(tmp_path / "n.json", None)).force(SAMPLES.accel)


@pytest.mark.parametrize(
    "entry",
    [{}, {"matrix": 1, "bias_mps2": 2}, {"matrix": np.zeros((3, 3)).tolist(), "bias_mps2": [0, 0, 0]}, 3, {"source": []}],
)
def test_a_damaged_accelerometer_in_a_model_file_is_refused(entry, tmp_path, folder, capsys):
    path = tmp_path / "m.json"
    path.write_text(json.dumps(models.to_dict(LINEAR, accelerometer=entry)))
    with pytest.raises(FormatError, match="accelerometer"):
        accelerometer_of(json.loads(path.read_text()))
    assert applied(path, folder / "log0001.csv", "-o", tmp_path / "out.csv") == 2
    assert capsys.readouterr().err.count("\n") == 1
