"""Measured noise in other programs' files: their own discretisation of it is that of the figures."""

import json
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from exports_read_back import FORCE, LINEAR, MEASURED, MODELS, context, rates
from noise_records import ACCEL, GYRO, WALKING, axis, figures, sensor
from test_exports_force import ACCELEROMETERS, told

from session.io.units import DEG_PER_HOUR, G
from tinygc.deploy import FORMATS, NOISE_FORMATS
from tinygc.deploy.exports import ExportError, exporter
from tinygc.noise.figures import Term, read_figures


def files(name, noise=None, said=None, **changes):
    """Files of a format from noise figures alone."""
    return exporter(name).export_noise(context(said, fit={}, noise=noise or figures(), **changes))


def values(name, text):
    """Numbers by key, as the other program reads them."""
    if name in ("px4-noise.params", "ardupilot-noise.param"):
        rows = [line.replace("\t", ",").split(",")[-3:-1] if "\t" in line else line.split(",") for line in text.splitlines()]
        return {row[0]: float(row[1]) for row, line in zip(rows, text.splitlines(), strict=True) if not line.startswith("#")}
    return yaml.safe_load(text.removeprefix("%YAML:1.0\n"))


def test_formats_that_take_noise_alone_are_those_that_say_so():
    assert tuple(name for name in FORMATS if hasattr(exporter(name), "export_noise")) == NOISE_FORMATS


# The other program's own step: its white noise and its walk are those that the figures state.


def steps(name, kind):
    """Sigmas of angle (velocity) and bias that the program adds at a step dt, from its file: as its source computes them."""
    gyro = kind == "gyro"
    made = files(name)
    if name in ("kalibr", "openvins"):  # densities: sigma_d = sigma / sqrt(dt), walk sigma sqrt(dt)
        table = values(name, next(iter(made.values())))
        table, dt = table.get("imu0", table), 1 / table.get("imu0", table)["update_rate"]
        word = "gyroscope" if gyro else "accelerometer"
        return dt * table[f"{word}_noise_density"] / np.sqrt(dt), table[f"{word}_random_walk"] * np.sqrt(dt), dt
    if name == "vins":  # half of each of two samples, taken as independent; the bias takes dt times its own
        table, dt = values(name, made["vins_imu.yaml"]), 1 / 208.0
        white, walk = (table["gyr_n"], table["gyr_w"]) if gyro else (table["acc_n"], table["acc_w"])
        return np.sqrt(2) * dt / 2 * white, dt * walk, dt
    if name == "gtsam":  # covariances: over dt, and times dt
        table, dt = json.loads(made["gtsam_imu.json"])["covariances"], 0.005
        white, walk = ("gyroscopeCovariance", "biasOmegaCovariance") if gyro else ("accelerometerCovariance", "biasAccCovariance")
        return dt * np.sqrt(table[white][0][0] / dt), np.sqrt(table[walk][0][0] * dt), dt
    ((file, text),) = made.items()
    table = values(file, text)
    if name == "px4":
        dt, keys = 0.01, ("EKF2_GYR_NOISE", "EKF2_GYR_B_NOISE") if gyro else ("EKF2_ACC_NOISE", "EKF2_ACC_B_NOISE")
    else:
        dt, keys = 0.012, ("EK3_GYRO_P_NSE", "EK3_GBIAS_P_NSE") if gyro else ("EK3_ACC_P_NSE", "EK3_ABIAS_P_NSE")
    return dt * table[keys[0]], dt * table[keys[1]], dt


#: densities in the file: the worst axis of each; GTSAM has all, and x is looked at
WORST = {"gyro": (5e-4, 2e-5), "accel": (5e-3, 2e-4)}


@pytest.mark.parametrize("kind", ["gyro", "accel"])
@pytest.mark.parametrize("name", [name for name in NOISE_FORMATS if name != "ros"])
def test_the_programs_own_steps_are_those_of_the_figures(name, kind):
    N, K = WORST[kind] if name != "gtsam" else (4e-4, 2e-5) if kind == "gyro" else (5e-3, 2e-4)
    angle_sigma, bias_sigma, dt = steps(name, kind)
    assert angle_sigma**2 == pytest.approx(N**2 * dt, rel=1e-6)
    assert bias_sigma**2 == pytest.approx(K**2 * dt, rel=1e-6)


def test_ros_has_the_variance_of_one_sample():
    (text,) = files("ros").values()
    table = yaml.safe_load(text)["/**"]["ros__parameters"]
    assert set(table) == {"orientation_covariance", "angular_velocity_covariance", "linear_acceleration_covariance"}
    np.testing.assert_allclose(table["angular_velocity_covariance"], np.diag(GYRO.values("N") ** 2 * 208).ravel())
    np.testing.assert_allclose(table["linear_acceleration_covariance"], np.diag(ACCEL.values("N") ** 2 * 208).ravel())
    assert table["orientation_covariance"][0] == -1


# OpenVINS' intrinsics, by its formula


def openvins(text, matrix_of, wm, am):
    """(rate, force) as its Propagator computes them: Dw, Da of which it keeps the lower triangles; matrix_of: reads a matrix."""
    table = yaml.safe_load(text.removeprefix("%YAML:1.0\n"))["imu0"]
    Tw, Ta, Tg, to_gyro, to_accel = (matrix_of(table[key]) for key in ("Tw", "Ta", "Tg", "R_IMUtoGYRO", "R_IMUtoACC"))
    bg, ba = (np.array(yaml.safe_load(text.split(f"# init_dyn_bias_{which}: ")[1].split("\n")[0])) for which in "ga")
    Dw, Da = np.tril(np.linalg.inv(Tw)), np.tril(np.linalg.inv(Ta))
    force = (am - ba) @ (to_accel.T @ Da).T
    return (wm - bg - force @ Tg.T) @ (to_gyro.T @ Dw).T, force, table


@pytest.mark.parametrize("accelerometer", ACCELEROMETERS)
@pytest.mark.parametrize("name", MODELS)
def test_openvins_by_its_own_formula(name, accelerometer):
    (text,) = exporter("openvins").export(MODELS[name], told(accelerometer)).values()
    assert text.startswith("%YAML:1.0\n")  # by which OpenCV knows it
    measured = ACCELEROMETERS[accelerometer].measured(FORCE)
    rate, force, table = openvins(text, np.array, MEASURED, measured)
    assert np.abs(force - FORCE).max() <= 1e-9 * np.abs(FORCE).max()
    expected = rates(MODELS[name])  # of the true force
    assert np.abs(rate - expected).max() <= 1e-9 * np.abs(expected).max()
    assert table["model"] == "kalibr"
    assert table["T_i_b"] == np.eye(4).tolist()
    for rotation in (np.array(table["R_IMUtoGYRO"]), np.array(table["R_IMUtoACC"])):
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)


# GTSAM's Python


def test_the_python_for_gtsam_sets_what_the_json_holds(tmp_path, monkeypatch):
    made = files("gtsam")
    for name, text in made.items():
        (tmp_path / name).write_text(text, encoding="utf-8")

    class Params:
        def __init__(self, n_gravity):
            self.set = {"n_gravity": n_gravity}

        def __getattr__(self, name):
            if not name.startswith("set"):
                raise AttributeError(name)
            return lambda value: self.set.update({name.removeprefix("set"): value})

    monkeypatch.setitem(sys.modules, "gtsam", SimpleNamespace(PreintegrationCombinedParams=Params))
    run = {"__file__": str(tmp_path / "gtsam_imu.py")}
    exec(made["gtsam_imu.py"], run)
    found = run["preintegration_params"]((0, 0, -9.81)).set
    assert found.pop("n_gravity").tolist() == [0, 0, -9.81]
    assert not found.pop("BiasAccOmegaInit").any()
    for name, matrix in found.items():
        written = json.loads(made["gtsam_imu.json"])["covariances"][name[0].lower() + name[1:]]
        np.testing.assert_array_equal(matrix, written)
    np.testing.assert_allclose(np.diag(found["GyroscopeCovariance"]), GYRO.values("N") ** 2)
    np.testing.assert_allclose(np.diag(found["BiasAccCovariance"]), ACCEL.values("K") ** 2)
    np.testing.assert_allclose(found["IntegrationCovariance"], 1e-8 * np.eye(3))
    assert len(found) == 5


# Which K: measured, from the floor, a limit, a guess


def imu(noise, said=None, **changes):
    text = files("kalibr", noise, said, **changes)["imu.yaml"]
    return yaml.safe_load(text), text


def test_a_walk_that_no_log_shows_is_its_upper_limit_and_says_so():
    said = []
    table, text = imu(figures(sensor(axis({"K": 3e-7}, N=1e-4), axis({"K": 5e-7}, N=1e-4), axis({"K": 4e-7}, N=1e-4))), said=said)
    assert table["gyroscope_random_walk"] == 5e-7
    (line,) = [line for line in text.splitlines() if line.startswith("gyroscope_random_walk")]
    assert line.endswith("# rad/s^2/sqrt(Hz), UPPER LIMIT (95 %), NOT MEASURED")
    assert said == ["kalibr: the gyroscope's random walk is an upper limit (95 %): the log at rest does not show it"]


def test_a_limit_of_one_axis_does_not_outweigh_what_another_shows():
    """A short log excludes little: the limit of y is no evidence of a walk, and x has one."""
    table, text = imu(figures(sensor(axis(N=1e-4, K=1e-6), axis({"K": 9e-6}, N=1e-4), axis({"K": 2e-6}, N=1e-4))))
    assert table["gyroscope_random_walk"] == 1e-6
    assert "9e-06 UPPER LIMIT" in text


def test_a_flicker_floor_becomes_the_walk_of_its_allan_deviation_at_100_s():
    B = 8 * DEG_PER_HOUR
    table, text = imu(figures(sensor(axis(N=1e-4, B=B))))
    K = table["gyroscope_random_walk"]
    assert np.sqrt(K**2 * 100 / 3) == pytest.approx(np.sqrt(2 * np.log(2) / np.pi) * B)
    assert pytest.approx(0.664 * B * np.sqrt(0.03), rel=1e-3) == K
    assert "from the flicker floor at 100 s" in text
    assert "Measured, and not in this format: B (bias instability)" in text
    both, _ = imu(figures(sensor(axis(N=1e-4, B=B, K=7e-6))))
    assert both["gyroscope_random_walk"] == 7e-6  # what is measured stands


def test_a_walk_that_is_not_determined_is_a_limit_or_the_floor_and_no_number():
    vague = Term(7e-6, 4e-6, 0.7, 2e-5)
    for others, said in (({}, "UPPER LIMIT (95 %)"), ({"B": 8 * DEG_PER_HOUR}, "from the flicker floor at 100 s")):
        known = axis(N=1e-4, **others)
        table, text = imu(figures(sensor(replace(known, terms={**known.terms, "K": vague}))))
        assert said in text
        assert table["gyroscope_random_walk"] == pytest.approx(0.664 * others["B"] * np.sqrt(0.03) if others else 2e-5, rel=1e-3)
    known = axis(N=1e-4, K=7e-6)
    _, text = imu(figures(sensor(replace(known, terms={**known.terms, "B": vague}))))
    assert "Measured, and not in this format" not in text


def test_a_gauss_markov_process_becomes_a_walk_likewise():
    table, _ = imu(figures(sensor(axis(N=1e-4, G=3e-5, tau_s=1e6))))
    # far below its correlation time it is a walk of density G sqrt(2 / T)
    assert table["gyroscope_random_walk"] == pytest.approx(3e-5 * np.sqrt(2 / 1e6), rel=1e-3)


def test_without_limit_and_floor_the_walk_is_guessed_loudly_or_refused():
    silent = figures(sensor(axis(N=1e-4)))
    said = []
    table, text = imu(silent, said=said)  # of an ASM330LHH a bias instability is typical
    assert table["gyroscope_random_walk"] > 0
    assert "GUESSED, NOT MEASURED" in text
    assert said == ["kalibr: the gyroscope's random walk is guessed: the log at rest does not show it"]
    from conftest import config

    with pytest.raises(ExportError, match="needs a bias instability, since no log shows the gyroscope's random walk"):
        imu(silent, config=config(model="unheard of"))


def test_an_accelerometer_that_the_figures_lack_is_the_stills_or_refused():
    without = figures(accel=None)
    made = exporter("kalibr").export(LINEAR, context(noise=without))
    assert yaml.safe_load(made["imu.yaml"])["accelerometer_noise_density"] == pytest.approx(6e-5 * G / np.sqrt(2))
    assert "# m/s^2/sqrt(Hz), measured in the stills" in made["imu.yaml"]
    with pytest.raises(ExportError, match="kalibr needs the noise of the accelerometer: run `calibrate noise`"):
        imu(without)
    said = []
    assert "EKF2_ACC" not in "".join(line for line in files("px4", without, said)["px4-noise.params"].splitlines() if line[0] != "#")
    assert "px4: the accelerometer's noise is not known: its parameters are left out" in said


# Axes that the terms do not describe


def misfit(axis):
    """The axis, with data that its terms do not describe."""
    return replace(axis, p_value=1e-5, excess=9.0)


#: x is the worst axis of both terms
SHAKEN = sensor(misfit(axis(N=9e-4, K=9e-5)), axis(N=5e-4, K=1e-5), axis(N=3e-4, K=1.5e-5))
LEFT_OUT = "gyroscope x: the terms do not describe its data (p = 1e-05): left out"


@pytest.mark.parametrize("name", NOISE_FORMATS)
def test_an_axis_that_is_not_described_is_left_out_and_said(name):
    said = []
    made = files(name, figures(SHAKEN), said)
    assert f"{name}: {LEFT_OUT}" in said
    for text in made.values():
        assert LEFT_OUT in " ".join(line.removeprefix("#").strip() for line in text.splitlines())
    for white in ("9e-04", "0.0009", "9e-05"):
        assert all(white not in text for text in made.values())
    quiet = []
    files(name, figures(), quiet)
    assert not any("left out" in line for line in quiet)


def test_the_worst_of_the_others_stands_for_an_axis_that_is_left_out():
    table, text = imu(figures(SHAKEN))
    assert (table["gyroscope_noise_density"], table["gyroscope_random_walk"]) == (5e-4, 1.5e-5)
    assert "gyroscope N NOT DESCRIBED: the worst axis stands for it; 0.0005 +- 2.5e-05 measured; " in text
    written = json.loads(files("gtsam", figures(SHAKEN))["gtsam_imu.json"])
    np.testing.assert_allclose(np.diag(written["covariances"]["gyroscopeCovariance"]), np.square([5e-4, 5e-4, 3e-4]))
    np.testing.assert_allclose(np.diag(written["covariances"]["biasOmegaCovariance"]), np.square([1.5e-5, 1e-5, 1.5e-5]))
    assert written["sources"]["biasOmegaCovariance"] == "NOT DESCRIBED: the worst axis stands for it; measured; measured"
    (text,) = files("ros", figures(SHAKEN)).values()
    covariance = yaml.safe_load(text)["/**"]["ros__parameters"]["angular_velocity_covariance"]
    np.testing.assert_allclose(covariance[::4], np.square([5e-4, 5e-4, 3e-4]) * 208)


@pytest.mark.parametrize("name", NOISE_FORMATS)
def test_a_gyroscope_without_a_described_axis_is_refused_whatever_the_stills_say(name):
    none = figures(sensor(misfit(axis(N=9e-4, K=9e-5))))
    expected = rf"^{name} needs the noise of the gyroscope, and the terms describe none of its axes \(p = 1e-05, 1e-05, 1e-05\): "
    with pytest.raises(ExportError, match=expected + "record again .*`calibrate noise`$"):
        files(name, none)
    with pytest.raises(ExportError, match=r"or move noise\.json away to export the noise of the stills$"):
        exporter(name).export(LINEAR, context(noise=none))


def test_an_accelerometer_without_a_described_axis_is_left_out_where_one_may_be_missing():
    none = figures(accel=sensor(misfit(axis(N=5e-3, K=2e-4))))
    said = []
    text = files("px4", none, said)["px4-noise.params"]
    assert not any("EKF2_ACC" in line for line in text.splitlines() if line[0] != "#")
    assert "px4: the accelerometer's noise is not known: its parameters are left out" in said
    assert "px4: accelerometer z: the terms do not describe its data (p = 1e-05): left out" in said
    with pytest.raises(ExportError, match="kalibr needs the noise of the accelerometer, and the terms describe none"):
        imu(none)


def test_factors_for_motion_on_an_axis_that_is_not_described_are_not_stated():
    _, text = imu(figures(SHAKEN, inflations=(WALKING,)))
    assert "The factors of the figures for motion are not used" in text
    assert "walking" not in text


# Motion


def test_inflation_is_a_factor_of_each_axis():
    table, _ = imu(figures(inflations=(WALKING,)), inflation=WALKING)
    assert table["gyroscope_noise_density"] == pytest.approx(max(4e-4 * 2, 5e-4 * 3, 3e-4 * 4))
    assert table["gyroscope_random_walk"] == pytest.approx(max(2e-5 * 5, 1e-5 * 6, 1.5e-5 * 7))
    assert table["accelerometer_noise_density"] == 5e-3


def test_the_walk_of_a_motion_takes_the_place_of_a_factor():
    """Where no K shows there is nothing to multiply: the motion states the walk that it needs, of the axes that have one."""
    walking = replace(WALKING, motion="a walk (2 km)", walk_density=np.array([3e-5, 4e-5, 0.0]))
    known = figures(sensor(axis({"K": 1e-5}, N=4e-4)), inflations=(walking,))
    assert "--inflation 'a walk (2 km)' puts them in" in imu(known)[1]  # as a shell takes it
    table, text = imu(known, inflation=walking)
    assert table["gyroscope_random_walk"] == 4e-5
    assert "# rad/s^2/sqrt(Hz), with the slow terms, in motion" in text
    assert "1e-05 UPPER LIMIT" in text  # of z
    assert "a walk (2 km) (two walks): N x 2, 3, 4, K 3e-05, 4e-05, 0: IN THE VALUES BELOW" in text


@pytest.mark.parametrize(
    ("axes", "walk", "expected"),
    [
        ((axis(N=4e-4, K=2e-5),), 1e-5, [(2e-5, "measured")] * 3),
        ((axis(N=4e-4, K=2e-5),), 5e-5, [(5e-5, "with the slow terms, in motion")] * 3),
        ((axis(N=4e-4, B=1e-4),), 1e-7, [(0.664 * 1e-4 * np.sqrt(0.03), "from the flicker floor at 100 s")] * 3),
        ((axis({"K": 2e-5}, N=4e-4),), 1e-7, [(2e-5, "UPPER LIMIT (95 %), NOT MEASURED")] * 3),
        (
            (axis({"K": 1e-6}, N=4e-4), axis({"K": 9e-6}, N=4e-4), axis({"K": 2e-6}, N=4e-4)),
            3e-6,
            [
                (3e-6, "with the slow terms, in motion; no log at rest shows it"),
                (9e-6, "UPPER LIMIT (95 %), NOT MEASURED"),
                (3e-6, "with the slow terms, in motion; no log at rest shows it"),
            ],
        ),
        (
            (axis({"K": 9e-6}, N=4e-4), axis(N=4e-4, K=2e-6), axis(N=4e-4)),
            3e-6,
            [(9e-6, "UPPER LIMIT (95 %), NOT MEASURED"), *[(3e-6, "with the slow terms, in motion")] * 2],
        ),
    ],
)
def test_no_walk_becomes_smaller_by_an_inflation(axes, walk, expected):
    walking = replace(WALKING, walk=np.array([0.5, 1.0, 1.0]), walk_density=np.full(3, walk))
    known = figures(sensor(*axes), inflations=(walking,))
    plain, _ = imu(known)
    table, _ = imu(known, inflation=walking)
    assert table["gyroscope_random_walk"] >= plain["gyroscope_random_walk"]
    written = json.loads(files("gtsam", known, inflation=walking)["gtsam_imu.json"])
    found = np.sqrt(np.diag(written["covariances"]["biasOmegaCovariance"]))
    np.testing.assert_allclose(found, [value for value, _ in expected], rtol=1e-3)
    assert written["sources"]["biasOmegaCovariance"] == "; ".join(source for _, source in expected)
    factor = replace(walking, walk_density=None)
    assert imu(known, inflation=factor)[0]["gyroscope_random_walk"] == plain["gyroscope_random_walk"]


# Autopilots


@pytest.mark.parametrize(
    ("name", "file", "key", "least"),
    [
        ("px4", "px4-noise.params", "EKF2_ACC_NOISE", 0.01),
        ("ardupilot", "ardupilot-noise.param", "EK3_GBIAS_P_NSE", 1e-5),
    ],
)
def test_a_value_outside_its_documented_range_is_written_as_its_end(name, file, key, least):
    text = files(name, figures(sensor(axis(N=4e-4, K=1e-9)), sensor(axis(N=1e-4, K=1e-5))))[file]
    assert values(file, text)[key] == pytest.approx(least)
    assert f"{least:g} IS WRITTEN" in " ".join(line.removeprefix("#").strip() for line in text.splitlines())
    assert "NOISE AT REST" in text
    assert all(len(line.encode()) <= 96 for line in text.splitlines()) or name == "px4"


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_noise_of_an_autopilot_is_a_file_beside_its_calibration(name):
    said = []
    made = exporter(name).export(LINEAR, context(said, noise=figures()))
    assert list(made) == [exporter(name).FILE, exporter(name).NOISE_FILE]
    assert any("do not fly with them as they are" in line for line in said)
    assert not any("NSE" in line or "_NOISE" in line for line in made[exporter(name).FILE].splitlines())


def test_json_holds_the_figures_whole(tmp_path):
    known = figures(inflations=(WALKING,), sensor="ASM330LHH")
    (text,) = exporter("json").export(LINEAR, context(noise=known)).values()
    (tmp_path / "noise.json").write_text(json.dumps(json.loads(text)["noise_figures"]))
    again = read_figures(tmp_path / "noise.json")
    np.testing.assert_array_equal(again.gyro.values("K"), GYRO.values("K"))
    assert again.inflations[0].source == "two walks"
