"""Exports carry the accelerometer's calibration that the fit used: other programs' formulas, by independent readers, give its force."""

import json
import re

import numpy as np
import pytest
import yaml
from exports_read_back import FORCE, LINEAR, MEASURED, context, physics, rates
from scipy.spatial.transform import Rotation

from session.io.config import Accelerometer
from session.io.units import G
from tinygc.deploy.exports import exporter
from tinygc.models.model import accelerometer_table

UPPER = np.array([[1.0102, 0.0021, -0.0043], [0, 0.9891, 0.0032], [0, 0, 1.0051]])
BIAS = np.array([0.31, -0.22, 0.13])
TURN = Rotation.from_rotvec([0.004, -0.006, 0.003]).as_matrix()
ACCELEROMETERS = {
    "triad": Accelerometer(UPPER, BIAS, "stills"),
    "with a turn of the frame": Accelerometer(TURN @ UPPER, BIAS, "prior"),
    "diagonal": Accelerometer(np.diag([1.01, 0.99, 1.005]), BIAS, "stills"),
}
CALIBRATIONS = pytest.mark.parametrize("name", ACCELEROMETERS)


def told(name, said=None, **changes):
    """A context whose model was fitted with one of these; session.toml gives none."""
    made = context(said, **changes)
    made.table["accelerometer"] = accelerometer_table(ACCELEROMETERS[name])
    return made


def agree(there, accelerometer, source=FORCE):
    expected = accelerometer.correct(source)
    assert np.abs(there - expected).max() <= 1e-6 * np.abs(expected).max()


@CALIBRATIONS
def test_kalibr_by_its_own_formula_in_its_own_frame(name):
    """a_meas = M a_i + b with M lower triangular; the gyroscope in the same frame i."""
    model = physics(LINEAR, "gyro.g_sensitivity")
    block = yaml.safe_load(exporter("kalibr").export(model, told(name))["imu-intrinsics.yaml"])["imu0"]
    R = np.array(block["T_i_b"])[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    M, b = np.array(block["accelerometers"]["M"]), np.array(block["accelerometers"]["b"])
    assert np.array_equal(M, np.tril(M))
    assert (np.diag(M) > 0).all()
    agree(np.linalg.solve(M, (FORCE - b).T).T @ R, ACCELEROMETERS[name])
    gyro = block["gyroscopes"]
    M, C, A = (np.array(gyro[key]) for key in ("M", "C_gyro_i", "A"))
    # FORCE is the true one here, as in `rates`; true rates and forces of the body, seen in i, give what was measured.
    forward = rates(model) @ R.T @ (M @ C).T + FORCE @ R.T @ (A @ C).T + gyro["b"]
    assert np.abs(forward - MEASURED).max() <= 1e-9 * np.abs(MEASURED).max()


@CALIBRATIONS
def test_ros(name):
    (text,) = exporter("ros").export(LINEAR, told(name)).values()
    table = yaml.safe_load(text)["/**"]["ros__parameters"]["accelerometer"]
    agree((FORCE - table["bias"]) @ np.reshape(table["matrix"], (3, 3)).T, ACCELEROMETERS[name])


@CALIBRATIONS
def test_xio_in_json_and_in_c(name):
    files = exporter("xio").export(LINEAR, told(name))
    table, header = json.loads(files["ximu3_settings.json"]), files["fusion_calibration.h"]

    def numbers(word):
        text = header[header.index(f"{word} = ") :].split(";")[0]
        return np.array([float(x) for x in re.findall(r"(-?[\d.]+(?:e[-+]?\d+)?)f", text)])

    for source in (lambda word: np.array(table[word]), numbers):
        M, s, b = (source(f"accelerometer{word}") for word in ("Misalignment", "Sensitivity", "Offset"))
        agree(((FORCE / G - b) * s) @ np.reshape(M, (3, 3)).T * G, ACCELEROMETERS[name])


KEYS = {"px4": ("CAL_ACC0_{}OFF", "CAL_ACC0_{}SCALE"), "ardupilot": ("INS_ACCOFFS_{}", "INS_ACCSCAL_{}")}


def autopilot(format_name, made):
    (text,) = exporter(format_name).export(LINEAR, made).values()
    rows = [line.split("\t")[2:4] if format_name == "px4" else line.split(",") for line in text.splitlines() if not line.startswith("#")]
    table = {key: float(value) for key, value in rows}
    keys = [[key.format(axis) for axis in "XYZ"] for key in KEYS[format_name]]
    return text, None if keys[0][0] not in table else [np.array([table[key] for key in group]) for group in keys]


@pytest.mark.parametrize("format_name", KEYS)
def test_autopilots_take_offset_and_scale(format_name):
    _, (offset, scale) = autopilot(format_name, told("diagonal"))
    agree((FORCE - offset) * scale, ACCELEROMETERS["diagonal"])


@pytest.mark.parametrize("format_name", KEYS)
@pytest.mark.parametrize("name", ["triad", "with a turn of the frame"])
def test_autopilots_say_what_they_cannot_hold(format_name, name):
    """What is left is what is said, and no more."""
    said = []
    text, (offset, scale) = autopilot(format_name, told(name, said))
    assert "cannot be carried" in text
    lost = float(re.search(r"what leans between them stays: up to ([\d.]+) mrad", "\n".join(said))[1]) * 1e-3
    measured = FORCE - offset
    left = np.abs(measured * scale - ACCELEROMETERS[name].correct(FORCE))
    assert left.max() <= 1.05 * lost * np.abs(measured).max()
    assert left.max() > 0.5 * lost * np.abs(measured).max()


@pytest.mark.parametrize("format_name", KEYS)
def test_autopilots_get_no_scale_of_turned_axes_or_of_what_nobody_calibrated(format_name):
    turned = context(said := [])
    turned.table["accelerometer"] = accelerometer_table(Accelerometer(np.array([[0, 1.0, 0], [-1, 0, 0], [0, 0, 1]]), BIAS))
    assert autopilot(format_name, turned)[1] is None
    bare = context(said)
    bare.table["accelerometer"] = accelerometer_table(Accelerometer(source="none"))
    object.__setattr__(bare, "config", bare.config.__class__(**{**vars(bare.config), "accelerometer": Accelerometer(source="none")}))
    assert autopilot(format_name, bare)[1] is None
    left_out = [line for line in said if "left out" in line]
    assert len(left_out) == 2
    assert "turns its axes" in left_out[0]
    assert "nobody has calibrated" in left_out[1]


def test_what_the_session_did_not_observe_is_said():
    made = told("triad", fit={**context().fit, "accelerometer": {"unobserved": ["scale z"]}})
    for name in ("kalibr", "openvins", "ros", "xio", "px4", "ardupilot", "c"):
        assert "not observed: scale z" in "".join(exporter(name).export(LINEAR, made).values()), name
