"""What other programs read, read back by an independent reader with the program's own formula, gives the same rates and forces."""

import ctypes
import json
import re
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import processes
import pytest
import yaml
from conftest import DEG, ROOT, config
from exports_read_back import (
    ACCELEROMETERS,
    BIAS,
    CELSIUS,
    FORCE,
    LINEAR,
    MEASURED,
    MODELS,
    OFFSETS,
    UNBENT,
    agree,
    autopilot_parameters,
    autopilot_zero,
    context,
    physics,
    rates,
)

from session.base.units import G
from session.log.config import Accelerometer
from tinygc import models
from tinygc.deploy.calibration import Calibration
from tinygc.deploy.exports import ExportError, exporter
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import CarriedNet

each_model = pytest.mark.parametrize("name", MODELS)
each_accelerometer = pytest.mark.parametrize("force", ACCELEROMETERS)


def test_the_example_of_contributing_exports_and_passes_its_own_test():
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = page.partition("## Add an export\n")[2].partition("\n## ")[0]
    module, test = re.findall(r"```python\n(.*?)```", section, re.S)
    made: dict = {}
    exec(module, made)
    with_it = globals() | {"exporter": {made["NAME"]: SimpleNamespace(**made)}.__getitem__}
    exec(test, with_it)
    for name in ("linear", "net that does not bend"):
        with_it["test_plain_by_its_formula"](name)
    (text,) = made["export"](LINEAR, context()).values()
    assert "frame" in text.lower()
    assert all(line.strip() for line in text.splitlines())


def rotation(matrix):
    R = np.array(matrix)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)
    return R


def lower(matrix):
    M = np.array(matrix)
    assert np.array_equal(M, np.tril(M))
    assert (np.diag(M) > 0).all()
    return M


def near(there, expected):
    assert np.abs(there - expected).max() <= 1e-9 * np.abs(expected).max()


@each_accelerometer
@each_model
def test_kalibr_by_its_own_formula_in_its_own_frame(name, force):
    """a_meas = M a_i + b with M lower triangular; true rates and forces of the body, seen in i, give what was measured."""
    block = yaml.safe_load(exporter("kalibr").export(MODELS[name], context(None, ACCELEROMETERS[force]))["imu-intrinsics.yaml"])["imu0"]
    assert (block["model"], block["time_offset"], block["update_rate"], block["T_i_b"][3]) == ("scale-misalignment", 0, 208, [0, 0, 0, 1])
    R, accel, gyro = rotation(np.array(block["T_i_b"])[:3, :3]), block["accelerometers"], block["gyroscopes"]
    near(FORCE @ R.T @ lower(accel["M"]).T + accel["b"], ACCELEROMETERS[force].measured(FORCE))
    M, C, A = lower(gyro["M"]), rotation(gyro["C_gyro_i"]), np.array(gyro["A"])
    near(rates(MODELS[name]) @ R.T @ (M @ C).T + FORCE @ R.T @ (A @ C).T + gyro["b"], MEASURED)


@each_accelerometer
@each_model
def test_openvins_by_its_own_formula(name, force):
    """As its Propagator computes them: Dw and Da, of which it keeps the lower triangles."""
    (text,) = exporter("openvins").export(MODELS[name], context(None, ACCELEROMETERS[force])).values()
    assert text.startswith("%YAML:1.0\n")  # by which OpenCV knows it; rows of a matrix are indented as it wants them
    assert "\n  Tw:\n    - [" in text
    table = yaml.safe_load(text.removeprefix("%YAML:1.0\n"))["imu0"]
    Tw, Ta, Tg = (np.array(table[key]) for key in ("Tw", "Ta", "Tg"))
    bg, ba = (np.array(yaml.safe_load(text.split(f"# init_dyn_bias_{which}: ")[1].split("\n")[0])) for which in "ga")
    a = (ACCELEROMETERS[force].measured(FORCE) - ba) @ (rotation(table["R_IMUtoACC"]).T @ np.tril(np.linalg.inv(Ta))).T
    near(a, FORCE)
    near((MEASURED - bg - a @ Tg.T) @ (rotation(table["R_IMUtoGYRO"]).T @ np.tril(np.linalg.inv(Tw))).T, rates(MODELS[name]))
    assert (table["model"], table["T_i_b"]) == ("kalibr", np.eye(4).tolist())


@each_accelerometer
@each_model
def test_ros_parameters(name, force):
    (text,) = exporter("ros").export(MODELS[name], context(None, ACCELEROMETERS[force])).values()
    assert "# No program reads this file as it is: its parameters are for a node of your own, which declares them.\n" in text
    table = yaml.safe_load(text)["/**"]["ros__parameters"]
    gyro, accel = table["gyroscope"], table["accelerometer"]
    matrix, K = (np.reshape(gyro[key], (3, 3)) for key in ("matrix", "g_sensitivity"))
    agree(MEASURED @ matrix.T + gyro["offset"] - FORCE @ K.T, MODELS[name])
    agree((FORCE - accel["bias"]) @ np.reshape(accel["matrix"], (3, 3)).T, ACCELEROMETERS[force])
    assert table["orientation_covariance"][0] == -1
    expected = LINEAR.E @ np.diag(np.square([5e-3, 6e-3, 4e-3])) @ LINEAR.E.T * DEG**2 * 104  # one-sided, at 208 Hz
    np.testing.assert_allclose(np.reshape(table["angular_velocity_covariance"], (3, 3)), expected, rtol=0.05, atol=1e-7)
    for spread, of in (({}, "the session that was fitted"), ({"bias_sigma_rps": [1e-3, 2e-3, 3e-3]}, "any session")):
        told = context()
        told.table.update(spread)
        (text,) = exporter("ros").export(MODELS[name], told).values()
        assert f"# It holds for {of}: " in text
        variance = np.diag(np.reshape(yaml.safe_load(text)["/**"]["ros__parameters"]["calibration_covariance"], (12, 12)))
        np.testing.assert_allclose(variance - 1, np.r_[np.zeros(9), np.square(spread.get("bias_sigma_rps", [0, 0, 0])) * 2], atol=1e-12)
    (text,) = exporter("ros").export(UNBENT, context(said := [], table={})).values()
    assert "calibration_covariance" not in yaml.safe_load(text)["/**"]["ros__parameters"]
    assert "no covariance" in said[0]


#: our own stand-ins: what Fusion's types hold before release 1.3.0 and since, as far as a calibration needs them
FUSION_MATRIX = "typedef union {{ float array{}; struct {{ float xx, xy, xz, yx, yy, yz, zx, zy, zz; }} element; }} FusionMatrix;"
FUSION_VECTOR = "typedef union { float array[3]; struct { float x, y, z; } axis; } FusionVector;"
FUSION_FORMULA = """static inline FusionVector FusionModelInertial(FusionVector in, FusionMatrix m, FusionVector s, FusionVector o) {
    const float a = s.array[0] * (in.array[0] - o.array[0]), b = s.array[1] * (in.array[1] - o.array[1]);
    const float c = s.array[2] * (in.array[2] - o.array[2]);
    const float *M = (const float *)m.array;
    return (FusionVector){.array = {M[0] * a + M[1] * b + M[2] * c, M[3] * a + M[4] * b + M[5] * c, M[6] * a + M[7] * b + M[8] * c}};
}"""
FUSION_CALLS = """
#include "fusion_calibration.h"
void calibrate(int count, const FusionVector *gyro, const FusionVector *accel, FusionVector *rates, FusionVector *forces) {
    for (int n = 0; n < count; n++) {
        rates[n] = FusionModelInertial(gyro[n], gyroscopeMisalignment, gyroscopeSensitivity, gyroscopeOffset);
        forces[n] = FusionModelInertial(accel[n], accelerometerMisalignment, accelerometerSensitivity, accelerometerOffset);
    }
}"""


@pytest.mark.parametrize(
    ("name", "layout", "force"),
    [("linear", "[3][3]", "triad"), ("net that does not bend", "[9]", "with a turn of the frame")],
)
def test_xio_in_json_and_compiled_with_fusions_own_types_and_formula(name, layout, force, tmp_path):
    """Every layout that ``FusionMatrix`` had: no warning of a C compiler, and in single precision 1e-6 of the rate."""
    files = exporter("xio").export(MODELS[name], context(None, ACCELEROMETERS[force]))
    table, pairs = json.loads(files["ximu3_settings.json"]), ((MEASURED / DEG, DEG, MODELS[name]), (FORCE / G, G, ACCELEROMETERS[force]))
    for sensor, (values, si, model) in zip(("gyroscope", "accelerometer"), pairs, strict=True):
        M, s, b = (np.array(table[f"{sensor}{word}"]) for word in ("Misalignment", "Sensitivity", "Offset"))
        agree(((values - b) * s) @ np.reshape(M, (3, 3)).T * si, model)
    if shutil.which("gcc") is None:
        pytest.skip("not installed: gcc")
    before = "\n".join((FUSION_VECTOR, FUSION_MATRIX.format(layout), FUSION_FORMULA))
    (tmp_path / "fusion_calibration.h").write_text(files["fusion_calibration.h"])
    (tmp_path / "there.c").write_text(before + FUSION_CALLS)
    flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror"]
    processes.run(["gcc", *flags, "-shared", "-fPIC", "there.c", "-o", "there.so"], cwd=tmp_path, check=True)
    inputs = [np.ascontiguousarray(values, np.float32) for values, _, _ in pairs]
    outputs = [np.zeros_like(values) for values in inputs]
    ctypes.CDLL(str(tmp_path / "there.so")).calibrate(len(MEASURED), *(ctypes.c_void_p(each.ctypes.data) for each in (*inputs, *outputs)))
    for found, (_, si, model) in zip(outputs, pairs, strict=True):
        agree(found.astype(float) * si, model)


# Autopilots


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_autopilots_hold_offsets_and_temperature_and_say_that_they_hold_no_scale(name):
    """At rest they are right; the error that they leave is the one that is said."""
    for model in (OFFSETS, physics(OFFSETS, "gyro.thermal_bias")):
        made = context()
        object.__setattr__(made, "temperature_c", lambda: (24.0, 28.0))
        (text,) = exporter(name).export(model, made).values()
        agree(MEASURED - autopilot_zero(name, autopilot_parameters(text), CELSIUS), model)
    (text,) = exporter(name).export(LINEAR, context(said := [])).values()
    assert "SCALE CANNOT BE CARRIED" in text
    worst = float(re.search(r"no scale.*up to ([\d.]+) %", said[0])[1]) / 100
    at_rest = -np.linalg.solve(LINEAR.E, LINEAR.B)
    left = np.abs(MEASURED - autopilot_zero(name, autopilot_parameters(text), CELSIUS) - LINEAR(MEASURED)).max()
    assert left <= 1.001 * worst * np.abs(MEASURED - at_rest).max() + 1e-6
    assert left > 0.5 * worst * np.abs(MEASURED).max()


@pytest.mark.parametrize(("name", "keys"), [("px4", "CAL_ACC0_{}OFF CAL_ACC0_{}SCALE"), ("ardupilot", "INS_ACCOFFS_{} INS_ACCSCAL_{}")])
def test_autopilots_take_offset_and_scale_of_an_accelerometer_and_say_what_they_cannot_hold(name, keys):
    """What leans between the axes stays: what is left is what is said, and no more."""

    def told(accelerometer, **changes):
        (text,) = exporter(name).export(LINEAR, context(said := [], accelerometer, **changes)).values()
        table = autopilot_parameters(text)
        groups = [[table.get(key.format(axis), np.nan) for axis in "XYZ"] for key in keys.split()]
        formula = "corrected = (measured - {}) {}, m/s^2\n".format(*keys.replace("{}", "*").split())
        assert (formula in text) == np.isfinite(groups).all()
        return text, "\n".join(said), (FORCE - groups[0]) * groups[1]

    agree(told(ACCELEROMETERS["diagonal"])[2], ACCELEROMETERS["diagonal"])
    for force in ("triad", "with a turn of the frame"):
        text, said, there = told(ACCELEROMETERS[force])
        assert "cannot be carried" in text
        lost = float(re.search(r"what leans between them stays: up to ([\d.]+) mrad", said)[1]) * 1e-3
        left = np.abs(there - ACCELEROMETERS[force].correct(FORCE)).max() / np.abs(FORCE - BIAS).max()
        assert 0.5 * lost < left <= 1.05 * lost
    for bad, why in (
        (Accelerometer(np.array([[0, 1.0, 0], [-1, 0, 0], [0, 0, 1]]), BIAS), "turns its axes"),
        (Accelerometer(source="none"), "is not calibrated"),
    ):
        _, said, there = told(bad, config=replace(config(), accelerometer=bad))
        assert np.isnan(there).all()
        assert re.search(f"left out.*{why}|{why}.*left out", said)


def test_what_the_session_did_not_observe_is_said():
    made = context(None, ACCELEROMETERS["triad"], fit={**context().fit, "accelerometer": {"unobserved": ["scale z"]}})
    for name in ("kalibr", "openvins", "ros", "xio", "px4", "ardupilot", "c"):
        assert "not observed: scale z" in "".join(exporter(name).export(LINEAR, made).values()), name


@pytest.mark.parametrize("name", ["kalibr", "openvins", "ros", "xio", "px4", "ardupilot"])
@pytest.mark.parametrize(
    ("model", "words"),
    [
        (CalibrationNet.from_vector(UNBENT.vector + np.r_[np.zeros(12), 0.01, 0, 0, np.zeros(12)]), "bends"),
        (CarriedNet(physics(LINEAR), UNBENT), "net behind physics"),
        (DenoisedNet(LINEAR, Denoiser.identity(), 208.0), "denoises"),
    ],
)
def test_what_a_format_cannot_carry_is_refused_in_one_line(name, model, words):
    with pytest.raises(ExportError, match=f"(?s)(?=.*{name})(?=.*{words})") as caught:
        exporter(name).export(model, context())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "model", [*MODELS.values(), DenoisedNet(UNBENT, Denoiser.identity(), 208.0), physics(LINEAR, "gyro.thermal_bias", "gyro.bandwidth")]
)
def test_json_read_again_gives_its_self_test(model):
    """Models with a memory, too."""
    (text,) = exporter("json").export(model, context(None, ACCELEROMETERS["triad"])).values()
    table = json.loads(text)
    test = table["self_test"]
    again = Calibration(models.from_dict(table), test["rate_hz"])
    omega = again(np.array(test["measured_rps"]), np.array(test["specific_force_mps2"]), np.array(test["temperature_c"]))
    np.testing.assert_allclose(omega, test["omega_rps"], rtol=1e-12, atol=1e-14)
    accelerometer = table["accelerometer"]
    agree((FORCE - accelerometer["bias_mps2"]) @ np.transpose(accelerometer["matrix"]), ACCELEROMETERS["triad"])
    assert accelerometer["source"] == "stills"
