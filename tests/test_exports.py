"""What other programs read, read back by an independent reader, gives the same rates."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import DEG
from exports_read_back import CELSIUS, FORCE, LINEAR, MEASURED, MODELS, OFFSETS, UNBENT, agree, context, physics, rates

from session.io.units import G
from tinygc import models
from tinygc.deploy.calibration import Calibration
from tinygc.deploy.exports import ExportError, exporter
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import CarriedNet


def test_the_example_of_contributing_exports_and_passes_its_own_test():
    from types import SimpleNamespace

    from conftest import ROOT

    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    module, test = re.findall(r"```python\n(.*?)```", page, re.S)
    made: dict = {}
    exec(module, made)
    with_it = globals() | {"exporter": {made["NAME"]: SimpleNamespace(**made)}.__getitem__}
    exec(test, with_it)
    for name in ("linear", "net that does not bend"):
        with_it["test_plain_by_its_formula"](name)
    (text,) = made["export"](LINEAR, context()).values()
    assert "frame" in text.lower()
    assert all(line.strip() for line in text.splitlines())


# Read back: an independent reader and the other program's own formula, over 10 000 random samples


@pytest.mark.parametrize("name", MODELS)
def test_kalibr_by_its_own_formula(name):
    files = exporter("kalibr").export(MODELS[name], context())
    block = yaml.safe_load(files["imu-intrinsics.yaml"])["imu0"]
    assert block["model"] == "scale-misalignment"
    M, C, A = (np.array(block["gyroscopes"][key]) for key in ("M", "C_gyro_i", "A"))
    assert np.array_equal(M, np.tril(M))
    assert (np.diag(M) > 0).all()
    np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(C) == pytest.approx(1)
    # Forward, as Kalibr has it: the rates of ours must give back what was measured.
    true = rates(MODELS[name])
    forward = true @ (M @ C).T + FORCE @ (A @ C).T + block["gyroscopes"]["b"]
    assert np.abs(forward - MEASURED).max() <= 1e-9 * np.abs(MEASURED).max()
    np.testing.assert_array_equal(block["accelerometers"]["M"], np.eye(3))


@pytest.mark.parametrize("name", MODELS)
def test_ros_parameters(name):
    (text,) = exporter("ros").export(MODELS[name], context()).values()
    assert "# No program reads this file as it is: its parameters are for a node of your own, which declares them.\n" in text
    table = yaml.safe_load(text)["/**"]["ros__parameters"]
    gyro = table["gyroscope"]
    matrix, K = (np.reshape(gyro[key], (3, 3)) for key in ("matrix", "g_sensitivity"))
    agree(MEASURED @ matrix.T + gyro["offset"] - FORCE @ K.T, MODELS[name])
    assert table["orientation_covariance"][0] == -1
    noise = np.reshape(table["angular_velocity_covariance"], (3, 3))
    assert np.sqrt(noise[0, 0]) == pytest.approx(5e-3 * DEG * np.sqrt(104), rel=0.1)
    assert np.linalg.eigvalsh(noise).min() > 0
    assert len(table["calibration_covariance"]) == 144


@pytest.mark.parametrize("name", ["linear", "net that does not bend"])
def test_xio_in_json_and_in_c(name):
    files = exporter("xio").export(MODELS[name], context())
    table = json.loads(files["ximu3_settings.json"])
    header = files["fusion_calibration.h"]

    def numbers(word):
        text = header[header.index(f"{word} = ") :].split(";")[0]
        return np.array([float(x) for x in re.findall(r"(-?[\d.]+(?:e[-+]?\d+)?)f", text)], dtype=np.float32)

    for source in (lambda word: np.array(table[word]), numbers):
        M, s, b = np.reshape(source("gyroscopeMisalignment"), (3, 3)), source("gyroscopeSensitivity"), source("gyroscopeOffset")
        agree(((MEASURED / DEG - b) * s) @ M.T * DEG, MODELS[name])


#: our own stand-ins: what Fusion's types hold before release 1.3.0 and since, as far as a calibration needs them
FUSION_MATRIX = "typedef union {{ float array{}; struct {{ float xx, xy, xz, yx, yy, yz, zx, zy, zz; }} element; }} FusionMatrix;"
FUSION_VECTOR = "typedef union { float array[3]; struct { float x, y, z; } axis; } FusionVector;"
FUSION_FORMULA = """static inline FusionVector FusionModelInertial(FusionVector in, FusionMatrix m, FusionVector s, FusionVector o) {
    const float a = s.array[0] * (in.array[0] - o.array[0]), b = s.array[1] * (in.array[1] - o.array[1]);
    const float c = s.array[2] * (in.array[2] - o.array[2]);
    const float *M = (const float *)m.array;
    return (FusionVector){.array = {M[0] * a + M[1] * b + M[2] * c, M[3] * a + M[4] * b + M[5] * c, M[6] * a + M[7] * b + M[8] * c}};
}"""
#: folders of Fusion's own headers, such as Fusion/ of a clone, one for each release to try
FUSION_FOLDERS = [folder for folder in os.environ.get("FUSION_HEADERS", "").split(os.pathsep) if folder]


def fusion(layout):
    """The C that stands before the exported header, and the compiler's options: our stand-in of a layout, or a folder of Fusion's own."""
    if layout in FUSION_FOLDERS:
        old = (Path(layout) / "FusionCalibration.h").is_file()
        return '#include "Fusion.h"\n' + "#define FusionModelInertial FusionCalibrationInertial\n" * old, [f"-isystem{layout}"]
    return "\n".join((FUSION_VECTOR, FUSION_MATRIX.format(layout), FUSION_FORMULA)), []


@pytest.mark.parametrize("layout", ["[3][3]", "[9]", *FUSION_FOLDERS])
@pytest.mark.parametrize("name", ["linear", "net that does not bend"])
def test_xio_compiled_with_fusions_own_types_and_formula(name, layout, tmp_path):
    """Every layout that ``FusionMatrix`` had: no warning of a C compiler, and in single precision 1e-6 of the rate."""
    import ctypes
    import shutil

    import processes

    if shutil.which("gcc") is None:
        pytest.skip("not installed: gcc")
    before, options = fusion(layout)
    (tmp_path / "fusion_calibration.h").write_text(exporter("xio").export(MODELS[name], context())["fusion_calibration.h"])
    (tmp_path / "there.c").write_text(
        before
        + """
        #include "fusion_calibration.h"
        void calibrate(int count, const FusionVector *gyro, const FusionVector *accel, FusionVector *rates, FusionVector *forces) {
            for (int n = 0; n < count; n++) {
                rates[n] = FusionModelInertial(gyro[n], gyroscopeMisalignment, gyroscopeSensitivity, gyroscopeOffset);
                forces[n] = FusionModelInertial(accel[n], accelerometerMisalignment, accelerometerSensitivity, accelerometerOffset);
            }
        }"""
    )
    flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", *options]
    processes.run(["gcc", *flags, "-shared", "-fPIC", "there.c", "-o", "there.so"], cwd=tmp_path, check=True)
    inputs = [np.ascontiguousarray(values, np.float32) for values in (MEASURED / DEG, FORCE / G)]
    outputs = [np.zeros_like(values) for values in inputs]
    library = ctypes.CDLL(str(tmp_path / "there.so"))
    library.calibrate(len(MEASURED), *(ctypes.c_void_p(values.ctypes.data) for values in (*inputs, *outputs)))
    agree(outputs[0].astype(float) * DEG, MODELS[name])
    np.testing.assert_allclose(outputs[1], inputs[1], rtol=1e-6)  # the context's accelerometer is one that needs none


AUTOPILOTS = {"offsets": OFFSETS, "thermal bias": physics(OFFSETS, "gyro.thermal_bias")}


def autopilot_rates(name, model, said):
    made = context(said)
    object.__setattr__(made, "temperature_c", lambda: (24.0, 28.0))
    (text,) = exporter(name).export(model, made).values()
    rows = [line.split("\t")[2:4] if name == "px4" else line.split(",") for line in text.splitlines() if not line.startswith("#")]
    table = {key: np.float64(np.float32(value)) for key, value in rows}
    axes = [[table.get(key.format(i=i, a="XYZ"[i]), 0.0) for i in range(3)] for key in ("CAL_GYRO0_{a}OFF", "INS_GYROFFS_{a}")]
    offset = np.array(axes[0 if name == "px4" else 1])
    if name == "px4":
        if table.get("TC_G_ENABLE") != 1:
            return MEASURED - offset
        away = (np.clip(CELSIUS, table["TC_G0_TMIN"], table["TC_G0_TMAX"]) - table["TC_G0_TREF"])[:, None]
        return MEASURED - offset - sum(np.array([table[f"TC_G0_X{n}_{i}"] for i in range(3)]) * away**n for n in range(4))
    if table.get("INS_TCAL1_ENABLE") != 1:
        return MEASURED - offset
    clip = lambda celsius: np.clip(celsius, table["INS_TCAL1_TMIN"], table["INS_TCAL1_TMAX"]) - 35  # noqa: E731
    coefficients = [np.array([table[f"INS_TCAL1_GYR{n}_{axis}"] for axis in "XYZ"]) for n in (1, 2, 3)]
    polynomial = lambda away: 1e-6 * sum(c * np.reshape(away, (-1, 1)) ** (n + 1) for n, c in enumerate(coefficients))  # noqa: E731
    return MEASURED - offset - polynomial(clip(CELSIUS)) + polynomial(clip(table["INS_GYR1_CALTEMP"]))


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
@pytest.mark.parametrize("which", AUTOPILOTS)
def test_autopilots_hold_offsets_and_temperature(name, which):
    agree(autopilot_rates(name, AUTOPILOTS[which], []), AUTOPILOTS[which])


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_autopilots_say_that_they_hold_no_scale(name):
    """At rest they are right; the error that they leave is the one that is said."""
    said = []
    (text,) = exporter(name).export(LINEAR, context(said)).values()
    assert "SCALE CANNOT BE CARRIED" in text
    assert "no scale" in said[0]
    worst = float(re.search(r"up to ([\d.]+) %", said[0])[1]) / 100
    at_rest = -np.linalg.solve(LINEAR.E, LINEAR.B)
    left = autopilot_rates(name, LINEAR, []) - LINEAR(MEASURED)
    assert np.abs(left).max() <= 1.001 * worst * np.abs(MEASURED - at_rest).max() + 1e-6
    assert np.abs(left).max() > 0.5 * worst * np.abs(MEASURED).max()


@pytest.mark.parametrize("name", ["kalibr", "openvins", "ros", "xio", "px4", "ardupilot"])
@pytest.mark.parametrize(
    ("model", "words"),
    [
        (CalibrationNet.from_vector(UNBENT.vector + np.r_[np.zeros(12), 0.01, 0, 0, np.zeros(12)]), "bends"),
        (physics(LINEAR, "gyro.g2_sensitivity"), "gyro.g2_sensitivity"),
        (physics(LINEAR, "gyro.scale_asymmetry"), "gyro.scale_asymmetry"),
        (CarriedNet(physics(LINEAR), UNBENT), "net behind physics"),
        (DenoisedNet(LINEAR, Denoiser.identity(), 208.0), "denoises"),
    ],
    ids=["bend", "g2", "asymmetry", "carried net", "denoiser"],
)
def test_what_a_format_cannot_carry_is_refused_in_one_line(name, model, words):
    with pytest.raises(ExportError) as caught:
        exporter(name).export(model, context())
    assert words in str(caught.value)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_json_self_test_of_every_kind_of_model():
    """The file read again gives the self-test's rates, models with a memory too."""
    models_ = [
        *MODELS.values(),
        DenoisedNet(UNBENT, Denoiser.identity(), 208.0),
        physics(LINEAR, "gyro.thermal_bias", "gyro.bandwidth"),
    ]
    for model in models_:
        (text,) = exporter("json").export(model, context()).values()
        table = json.loads(text)
        test = table["self_test"]
        again = Calibration(models.from_dict(table), test["rate_hz"])
        omega = again(np.array(test["measured_rps"]), np.array(test["specific_force_mps2"]), np.array(test["temperature_c"]))
        np.testing.assert_allclose(omega, test["omega_rps"], rtol=1e-12, atol=1e-14)
