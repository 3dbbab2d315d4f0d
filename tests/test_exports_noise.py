"""Measured noise in other programs' files: their own discretisation of it is that of the figures; where the figures are found."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from conftest import config
from exports_read_back import LINEAR, context
from noise_records import ACCEL, GYRO, SIGMA, WALKING, axis, figures, sensor

import tinygc
from session.base.errors import CalibrationError
from session.base.records import table_of
from session.base.units import DEG_PER_HOUR, G
from session.bench.session_file import toml_text
from tinygc.deploy import FORMATS, NOISE_FORMATS
from tinygc.deploy.exports import ExportError, exporter
from tinygc.noise.figures import Term

each_format = pytest.mark.parametrize("name", NOISE_FORMATS)


def files(name, noise=None, said=None, **changes):
    """Files of a format from noise figures alone."""
    return exporter(name).export_noise(context(said, fit={}, noise=noise or figures(), **changes))


def values(text):
    """Numbers by key, as the other program reads them."""
    if "EKF2_" in text or "EK3_" in text:
        rows = [line.split("\t")[2:4] if "\t" in line else line.split(",") for line in text.splitlines() if not line.startswith("#")]
        return {key: float(value) for key, value in rows}
    return json.loads(text) if text.startswith("{") else yaml.safe_load(text.removeprefix("%YAML:1.0\n"))


def plain(text):
    """Comments as one line of words."""
    return " ".join(line.removeprefix("#").strip() for line in text.splitlines())


# The other program's own step: its white noise and its walk are those that the figures state.

#: format -> step s; keys of the white noise and the walk of gyroscope and accelerometer; what the program makes of them in one step
KEYS = {
    "px4": (0.01, "EKF2_GYR_NOISE EKF2_GYR_B_NOISE EKF2_ACC_NOISE EKF2_ACC_B_NOISE"),
    "ardupilot": (0.012, "EK3_GYRO_P_NSE EK3_GBIAS_P_NSE EK3_ACC_P_NSE EK3_ABIAS_P_NSE"),
    "vins": (1 / 208, "gyr_n gyr_w acc_n acc_w"),
    "kalibr": (1 / 208, "gyroscope_noise_density gyroscope_random_walk accelerometer_noise_density accelerometer_random_walk"),
    "openvins": (1 / 208, "gyroscope_noise_density gyroscope_random_walk accelerometer_noise_density accelerometer_random_walk"),
    "gtsam": (0.005, "gyroscopeCovariance biasOmegaCovariance accelerometerCovariance biasAccCovariance"),
}


def steps(name, table, dt, white, walk):
    """Sigmas of angle (velocity) and bias that the program adds at a step, as its source computes them."""
    if name == "gtsam":  # covariances: over dt, and times dt
        return dt * np.sqrt(table[white][0][0] / dt), np.sqrt(table[walk][0][0] * dt)
    if name == "vins":  # half of each of two samples, taken as independent; the bias takes dt times its own
        return np.sqrt(2) * dt / 2 * table[white], dt * table[walk]
    if name in ("kalibr", "openvins"):  # densities: sigma_d = sigma / sqrt(dt), walk sigma sqrt(dt)
        return dt * table[white] / np.sqrt(dt), table[walk] * np.sqrt(dt)
    return dt * table[white], dt * table[walk]


@pytest.mark.parametrize("name", KEYS)
def test_the_programs_own_steps_are_those_of_the_figures(name):
    """Of the worst axis of each; GTSAM has all, and x is looked at."""
    (text, *_) = (text for file, text in files(name).items() if not file.endswith(".py"))
    table = values(text)
    table = table.get("imu0", table.get("covariances", table))
    dt, keys = KEYS[name]
    assert table.get("update_rate", 208.0) == 208.0
    gyro, gyro_walk, accel, accel_walk = keys.split()
    for white, walk, N, K in ((gyro, gyro_walk, 4e-4 if name == "gtsam" else 5e-4, 2e-5), (accel, accel_walk, 5e-3, 2e-4)):
        angle_sigma, bias_sigma = steps(name, table, dt, white, walk)
        assert (angle_sigma**2, bias_sigma**2) == pytest.approx((N**2 * dt, K**2 * dt), rel=1e-6)


def test_ros_has_the_variance_of_one_sample_in_motion_too_and_carries_it_through_a_models_matrix():
    moving = files("ros", figures(inflations=(WALKING,)), inflation=WALKING)
    fitted = exporter("ros").export(LINEAR, context(noise=figures()))
    for made, matrix in ((files("ros"), np.eye(3)), (fitted, LINEAR.E), (moving, np.diag([2.0, 3, 4]))):
        (text,) = made.values()
        table = yaml.safe_load(text)["/**"]["ros__parameters"]
        expected = matrix @ np.diag(GYRO.values("N") ** 2 * 208) @ matrix.T
        np.testing.assert_allclose(table["angular_velocity_covariance"], expected.ravel(), rtol=1e-12)
        np.testing.assert_allclose(table["linear_acceleration_covariance"], np.diag(ACCEL.values("N") ** 2 * 208).ravel())
        assert table["orientation_covariance"][0] == -1


# Which K: measured, from the floor, a limit, a guess


def imu(noise, said=None, **changes):
    text = files("kalibr", noise, said, **changes)["imu.yaml"]
    return yaml.safe_load(text), text


FLOOR = 8 * DEG_PER_HOUR
#: of a flicker floor B, by the Allan deviation of both at 100 s: K sqrt(100 / 3) = sqrt(2 ln 2 / pi) B
FROM_FLOOR = np.sqrt(3 / 100) * np.sqrt(2 * np.log(2) / np.pi) * FLOOR
VAGUE = Term(7e-6, 4e-6, 0.7, 2e-5)


def vague(name, **known):
    """An axis of which one term is not determined."""
    of = axis(N=1e-4, **known)
    return replace(of, terms={**of.terms, name: VAGUE})


@pytest.mark.parametrize(
    ("axes", "walk", "says"),
    [
        (GYRO.axes, 2e-5, f"gyroscope K 2e-05 +- {SIGMA * 2e-5:.2g} measured; 1e-05 +- {SIGMA * 1e-5:.2g} measured; 1.5e-05"),
        ([axis({"K": limit}, N=1e-4) for limit in (3e-7, 5e-7, 4e-7)], 5e-7, "# rad/s^2/sqrt(Hz), UPPER LIMIT (95 %), NOT MEASURED"),
        # A short log excludes little: the limit of y is no evidence of a walk, and x has one.
        ([axis(N=1e-4, K=1e-6), axis({"K": 9e-6}, N=1e-4), axis({"K": 2e-6}, N=1e-4)], 1e-6, "9e-06 UPPER LIMIT"),
        ([axis(N=1e-4, B=FLOOR)], FROM_FLOOR, "Measured, and not in this format: B (bias instability)"),
        ([axis(N=1e-4, K=0.0, B=FLOOR)], FROM_FLOOR, "from the flicker floor at 100 s"),
        ([vague("K")], 2e-5, "UPPER LIMIT (95 %)"),
        ([vague("K", B=FLOOR)], FROM_FLOOR, "from the flicker floor at 100 s"),
        ([vague("B", K=7e-6)], 7e-6, ""),
        ([axis(N=1e-4, G=3e-5, tau_s=1e6)], 3e-5 * np.sqrt(2 / 1e6), ""),  # far below its correlation time a walk of density G sqrt(2 / T)
        ([axis(N=1e-4, K=2e-6), axis(N=3e-4, K=1e-6), axis(N=2e-4)], 2e-6, "1e-06 +- 5e-08 measured; not known [rad/s^2/sqrt(Hz)]"),
    ],
)
def test_which_walk_is_given_and_where_it_is_from(axes, walk, says):
    table, text = imu(figures(sensor(*axes)), said := [])
    assert table["gyroscope_random_walk"] == pytest.approx(walk, rel=1e-3)
    assert says in text
    assert "GUESS" not in text
    (line,) = (line for line in text.splitlines() if line.startswith("gyroscope_random_walk"))
    assert said == ("UPPER LIMIT" in line) * [
        "kalibr: the gyroscope's random walk is an upper limit (95 %): the log at rest does not show it"
    ]
    assert ("Measured, and not in this format: B" in text) == (axes[0].terms["B"].value == FLOOR)


def test_what_the_figures_lack_is_guessed_loudly_from_the_stills_left_out_or_refused():
    silent, without = figures(sensor(axis(N=1e-4))), figures(accel=None)
    table, text = imu(silent, said := [])  # of an ASM330LHH a bias instability is typical
    assert table["gyroscope_random_walk"] == pytest.approx(FROM_FLOOR / 8 * 3, rel=0.01)
    assert "GUESSED, NOT MEASURED" in text
    assert said == ["kalibr: the gyroscope's random walk is guessed: the log at rest does not show it"]
    with pytest.raises(ExportError, match="needs a bias instability, since no log shows the gyroscope's random walk"):
        imu(silent, config=config(model="unheard of"))
    made = exporter("kalibr").export(LINEAR, context(noise=without))
    assert yaml.safe_load(made["imu.yaml"])["accelerometer_noise_density"] == pytest.approx(6e-5 * G / np.sqrt(2))
    assert "# m/s^2/sqrt(Hz), measured in the stills" in made["imu.yaml"]
    undescribed = figures(accel=sensor(misfit(axis(N=5e-3, K=2e-4))))
    for noise, why in ((without, ": measure it on a log at rest"), (undescribed, ", and the terms describe none")):
        with pytest.raises(ExportError, match=f"kalibr needs the noise of the accelerometer{why}"):
            imu(noise)
        assert "EKF2_ACC_NOISE" not in values(files("px4", noise, said)["px4-noise.params"])
        assert "px4: the accelerometer's noise is not known: its parameters are left out" in said


# Axes that the terms do not describe


def misfit(axis):
    """The axis, with data that its terms do not describe."""
    return replace(axis, p_value=1e-5, excess=9.0)


#: x is the worst axis of both terms
SHAKEN = sensor(misfit(axis(N=9e-4, K=9e-5)), axis(N=5e-4, K=1e-5), axis(N=3e-4, K=1.5e-5))
LEFT_OUT = "gyroscope x: the terms do not describe its data (p < 0.001): left out"


@each_format
def test_an_axis_that_is_not_described_is_left_out_and_said(name):
    made = files(name, figures(SHAKEN), said := [])
    assert f"{name}: {LEFT_OUT}" in said
    for text in made.values():
        assert LEFT_OUT in plain(text)
        assert not any(white in text for white in ("9e-04", "0.0009", "9e-05"))
    files(name, figures(), quiet := [])
    assert not any("left out" in line for line in quiet)
    none = figures(sensor(misfit(axis(N=9e-4, K=9e-5))))
    expected = rf"^{name} needs the noise of the gyroscope, and the terms describe none of its axes \(p < 0.001, p < 0.001, p < 0.001\): "
    with pytest.raises(ExportError, match=expected + "record again away from what shakes or warms it$"):
        files(name, none)
    with pytest.raises(ExportError, match=r"or move noise\.json away to export the noise of the stills$"):
        exporter(name).export(LINEAR, context(noise=none))


# Motion


def test_inflation_is_a_factor_of_each_axis_or_the_walk_that_a_motion_needs():
    """Where no K shows there is nothing to multiply: the motion states the walk that it needs, of the axes that have one."""
    table, text = imu(figures(inflations=(WALKING,)), inflation=WALKING)
    assert table["gyroscope_noise_density"] == pytest.approx(max(4e-4 * 2, 5e-4 * 3, 3e-4 * 4))
    assert table["gyroscope_random_walk"] == pytest.approx(max(2e-5 * 5, 1e-5 * 6, 1.5e-5 * 7))
    assert (table["accelerometer_noise_density"], "IN THE VALUES" in text) == (5e-3, True)
    assert f"gyroscope K 0.0001 +- {SIGMA * 1e-4:.2g} measured" in plain(text)  # the sigma of x, five times as well
    walking = replace(WALKING, motion="a walk (2 km)", walk_density=np.array([3e-5, 4e-5, 0.0]))
    known = figures(sensor(axis({"K": 1e-5}, N=4e-4)), inflations=(walking,))
    assert "--inflation 'a walk (2 km)' puts them in" in plain(imu(known)[1])  # as a shell takes it
    table, text = imu(known, inflation=walking)
    assert table["gyroscope_random_walk"] == 4e-5
    assert "# rad/s^2/sqrt(Hz), with the slow terms, in motion" in text
    assert "1e-05 UPPER LIMIT" in text  # of z
    assert "a walk (2 km) (two walks): N x 2, 3, 4, K 3e-05, 4e-05, 0: IN THE VALUES BELOW" in text


IN_MOTION = "with the slow terms, in motion"
LIMIT = "UPPER LIMIT (95 %), NOT MEASURED"


@pytest.mark.parametrize(
    ("axes", "walk", "expected"),
    [
        ([axis(N=4e-4, K=2e-5)], 5e-5, [(5e-5, IN_MOTION)] * 3),
        ([axis(N=4e-4, B=FLOOR)], 1e-7, [(FROM_FLOOR, "from the flicker floor at 100 s")] * 3),
        (
            [axis({"K": limit}, N=4e-4) for limit in (1e-6, 9e-6, 2e-6)],
            3e-6,
            [(3e-6, f"{IN_MOTION}; no log at rest shows it"), (9e-6, LIMIT), (3e-6, f"{IN_MOTION}; no log at rest shows it")],
        ),
        ([axis({"K": 9e-6}, N=4e-4), axis(N=4e-4, K=2e-6), axis(N=4e-4)], 3e-6, [(9e-6, LIMIT), *[(3e-6, IN_MOTION)] * 2]),
    ],
)
def test_no_walk_becomes_smaller_by_an_inflation(axes, walk, expected):
    walking = replace(WALKING, walk=np.array([0.5, 1.0, 1.0]), walk_density=np.full(3, walk))
    known = figures(sensor(*axes), inflations=(walking,))
    without = imu(known)[0]["gyroscope_random_walk"]
    assert imu(known, inflation=walking)[0]["gyroscope_random_walk"] >= without
    written = json.loads(files("gtsam", known, inflation=walking)["gtsam_imu.json"])
    np.testing.assert_array_equal(written["covariances"]["integrationCovariance"], 1e-8 * np.eye(3))  # 0.1 mm after a second
    found = np.sqrt(np.diag(written["covariances"]["biasOmegaCovariance"]))
    np.testing.assert_allclose(found, [value for value, _ in expected], rtol=1e-3)
    assert written["sources"]["biasOmegaCovariance"] == "; ".join(source for _, source in expected)
    assert imu(known, inflation=replace(walking, walk_density=None))[0]["gyroscope_random_walk"] == without


# Autopilots


#: parameter -> its default and range, as the programs document them
RANGES = {
    "EKF2_GYR_NOISE": (0.015, 1e-4, 0.1), "EKF2_ACC_NOISE": (0.35, 0.01, 1.0),
    "EKF2_GYR_B_NOISE": (0.001, 0.0, 0.01), "EKF2_ACC_B_NOISE": (0.003, 0.0, 0.01),
    "EK3_GYRO_P_NSE": (0.015, 1e-4, 0.1), "EK3_ACC_P_NSE": (0.35, 0.01, 1.0),
    "EK3_GBIAS_P_NSE": (0.001, 1e-5, 0.001), "EK3_ABIAS_P_NSE": (0.02, 1e-5, 0.02),
}  # fmt: skip


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_an_autopilot_has_a_file_of_noise_whose_values_are_within_their_documented_range(name):
    made = exporter(name).export(LINEAR, context(said := [], noise=figures()))
    calibration, usual = made.values()
    assert "IS WRITTEN" not in usual
    for size, end in ((1e-15, 1), (9e3, 2)):
        (text,) = files(name, figures(*[sensor(axis(N=size, K=size))] * 2)).values()
        found = values(text)
        assert len(found) == 4
        for key, value in found.items():
            default, limit = RANGES[key][0], RANGES[key][end]
            assert value == pytest.approx(limit, rel=1e-6, abs=1e-12)
            written = f"; {limit:g} IS WRITTEN" if limit else ""
            assert re.search(rf"{key}: [NK] / sqrt\(dt\) = \S+, measured; default {default:g}{written}", plain(text))
        assert name == "px4" or all(len(line.encode()) <= 96 for line in text.splitlines())
    assert any("do not fly with them as they are" in line for line in said)
    assert not any("NSE" in line or "_NOISE" in line for line in calibration.splitlines())


# Where export finds noise figures, and exports without a model

KNOWN = figures(inflations=(WALKING,), sensor="asm330lhh", serial="test")


def written(path, known=KNOWN, **changes):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(table_of(known) | changes), encoding="utf-8")
    return path


@pytest.fixture
def rests(tmp_path):
    """A session folder of rest logs: no model, and noise figures in its ``fit``."""
    folder = tmp_path / "rests"
    folder.mkdir()
    (folder / "session.toml").write_text(toml_text(config()), encoding="utf-8")
    written(folder / "fit" / "noise.json")
    return folder


@pytest.mark.parametrize("name", FORMATS)
def test_a_folder_of_rest_logs_goes_to_each_format_that_needs_no_model(name, rests, tmp_path):
    """A data rate that is a guess is said by formats that depend on it."""
    if name not in NOISE_FORMATS:
        with pytest.raises(
            CalibrationError, match=f"{name} carries a model, and there are noise figures alone; these go to kalibr, openvins"
        ):
            tinygc.export(rests, name)
        return
    made = tinygc.export(rests, name, rests / "export")
    assert any("there is no model: the noise alone is exported, no calibration" in line for line in made.remarks)
    for file, text in made.files.items():
        assert (rests / "export" / file).read_text(encoding="utf-8") == text
        if file != "gtsam_imu.json":
            assert text.removeprefix("%YAML:1.0\n").startswith("# TinyGC noise at rest of rests: ASM330LHH test\n")
            assert {"noise.json", "session.toml"} < set(text.replace(":", " ").split())  # with their hashes
    guessed = tinygc.export(written(tmp_path / "noise.json", replace(KNOWN, rate_known=False)), name).remarks
    said = [line for line in guessed if line.startswith(f"{name}: its data rate, 208 Hz, is a guess, 1 over the shortest averaging time")]
    assert len(said) == (name in ("kalibr", "openvins", "vins", "ros"))


@pytest.mark.parametrize("name", ["file", "folder", "fit of the folder", "record"])
def test_figures_from_elsewhere_take_the_place_of_those_beside(name, rests, tmp_path):
    other = replace(KNOWN, duration_s=7200.0)
    path = written(tmp_path / "other" / ("fit" if name == "fit of the folder" else "") / "noise.json", other)
    given = {"file": path, "folder": str(path.parent), "fit of the folder": tmp_path / "other", "record": other}[name]
    assert "Noise at rest, 2 h" in tinygc.export(rests, "kalibr", noise=given).files["imu.yaml"]
    assert "Noise at rest, 10 h" in (beside := tinygc.export(rests, "kalibr")).files["imu.yaml"]
    alone = tinygc.export(written(path), "kalibr").files["imu.yaml"]  # a file of figures is enough
    assert yaml.safe_load(alone) == yaml.safe_load(beside.files["imu.yaml"])


def in_unit(kind, name, unit):
    """A sensor's table of which one term of y has a unit."""
    table = table_of(KNOWN)[kind]
    table["y"]["terms"][name]["unit"] = unit
    return {kind: table}


@pytest.mark.parametrize(
    ("changes", "words", "says"),
    [
        ({"sensor": "BMI088"}, (), "noise of sensor BMI088, but the session's is ASM330LHH; give that of this unit with --noise"),
        ({"serial": "0815"}, (), "noise of serial number 0815, but the session's is test"),
        ({"schema": "tinygc-noise/2"}, (), 'schema is "tinygc-noise/2", expected one of tinygc-noise/1'),
        (in_unit("gyro", "N", "deg/s/sqrt(Hz)"), (), 'gyro.y.terms.N.unit is "deg/s/sqrt(Hz)", expected one of rad/s/sqrt(Hz); measure'),
        ({}, ("--inflation", "flying"), "noise.json: no inflation for motion flying; there are walking"),
        (
            {},
            ("--noise", "nowhere"),
            "nowhere: no noise.json there; measure it at rest, or give the file itself",
        ),
        ({}, ("--to", "xio", "--inflation", "walking"), "xio has no noise densities to inflate; --inflation goes with kalibr"),
    ],
)
def test_what_does_not_belong_or_is_not_there_is_one_line(changes, words, says, rests, run):
    written(rests / "fit" / "noise.json", **changes)
    code, _, err = run("export", rests, *(() if "--to" in words else ("--to", "kalibr")), *words)
    assert (code, err.count("\n"), says in err) == (2, 1, True), err
    assert not (rests / "export").exists()
