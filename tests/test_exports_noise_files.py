"""Where ``export`` finds noise figures, what it refuses of them, and exports without a model."""

import json
from dataclasses import replace

import pytest
import yaml
from conftest import config
from noise_records import WALKING, figures

import tinygc
from session.bench.session_file import toml_text
from session.io.errors import CalibrationError
from tinygc.deploy import FORMATS, NOISE_FORMATS
from tinygc.noise.figures import SensorNoise, to_json

KNOWN = figures(inflations=(WALKING,), sensor="asm330lhh", serial="test")


def written(path, known=KNOWN, **changes):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(to_json(known) | changes), encoding="utf-8")
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
def test_a_folder_of_rest_logs_goes_to_each_format_that_needs_no_model(name, rests):
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
            assert "noise.json" in text  # its hash
            assert "session.toml" in text


def test_a_file_of_figures_is_enough(tmp_path, rests):
    path = written(tmp_path / "elsewhere" / "noise.json")
    alone = tinygc.export(path, "kalibr").files["imu.yaml"]
    assert "TinyGC noise at rest of noise.json: asm330lhh test" in alone
    assert yaml.safe_load(alone) == yaml.safe_load(tinygc.export(rests, "kalibr").files["imu.yaml"])
    assert tinygc.export(path.parent, "kalibr").files["imu.yaml"] == alone  # of its folder, which has no session.toml
    assert "GUESSED" not in tinygc.export(path, "openvins").files["kalibr_imu_chain.yaml"]
    with pytest.raises(CalibrationError, match="holds noise figures alone: --model and --noise go with a session folder"):
        tinygc.export(path, "kalibr", noise=path)


@pytest.mark.parametrize("name", ["file", "folder", "fit of the folder", "record"])
def test_figures_from_elsewhere_take_the_place_of_those_beside(name, rests, tmp_path):
    other = replace(KNOWN, duration_s=7200.0)
    path = written(tmp_path / "other" / ("fit" if name == "fit of the folder" else "") / "noise.json", other)
    given = {"file": path, "folder": str(path.parent), "fit of the folder": tmp_path / "other", "record": other}[name]
    assert "Noise at rest, 2 h" in tinygc.export(rests, "kalibr", noise=given).files["imu.yaml"]
    assert "Noise at rest, 10 h" in tinygc.export(rests, "kalibr").files["imu.yaml"]


# What is refused, in one line


def in_unit(kind, name, unit):
    """A sensor's table of which one term of y has a unit."""
    table = to_json(KNOWN)[kind]
    table["y"]["terms"][name]["unit"] = unit
    return table


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"sensor": "BMI088"}, "noise of sensor BMI088, but the session's is ASM330LHH; give that of this unit with --noise"),
        ({"serial": "0815"}, "noise of serial number 0815, but the session's is test"),
        ({"schema": "tinygc-noise/2"}, 'schema is "tinygc-noise/2", expected one of tinygc-noise/1'),
        ({"schema": "tinygc-fit/2"}, "schema"),
        ({"gyro": None}, "gyro"),
        ({"rate_hz": "fast"}, "rate_hz"),
        (
            {"gyro": in_unit("gyro", "N", "deg/s/sqrt(Hz)")},
            'gyro.y.terms.N.unit is "deg/s/sqrt(Hz)", expected one of rad/s/sqrt(Hz); write',
        ),
        ({"accel": in_unit("accel", "B", "mg")}, 'accel.y.terms.B.unit is "mg", expected one of m/s^2'),
    ],
)
def test_figures_of_another_sensor_or_file_are_refused(changes, says, rests, run):
    path = written(rests / "fit" / "noise.json", **changes)
    code, _, err = run("export", rests, "--to", "kalibr")
    assert code == 2
    assert err.startswith(f"calibrate: {path}: ")
    assert says in err
    assert err.count("\n") == 1
    assert not (rests / "export").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--inflation", "flying"), "noise.json: no inflation for motion flying; there are walking"),
        (("--noise", "nowhere"), "nowhere: no noise.json there; run `calibrate noise` first, or give the file itself"),
        (("--model", "least_squares"), "no model; run "),
    ],
)
def test_what_is_not_there_is_named(words, says, rests, run):
    code, _, err = run("export", rests, "--to", "kalibr", *words)
    assert code == 2
    assert says in err
    assert err.count("\n") == 1


def test_factors_on_an_axis_that_is_not_described_are_refused(rests, run):
    x, *others = KNOWN.gyro.axes
    written(rests / "fit" / "noise.json", replace(KNOWN, gyro=SensorNoise((replace(x, p_value=1e-6, excess=3.0), *others))))
    assert run("export", rests, "--to", "kalibr")[0] == 0
    code, _, err = run("export", rests, "--to", "kalibr", "--inflation", "walking")
    assert (code, err.count("\n")) == (2, 1)
    assert "the terms do not describe the gyroscope at rest, to which the factors for walking are; record again" in err


def test_figures_of_no_named_sensor_are_taken_and_another_rate_is_said(rests):
    written(rests / "fit" / "noise.json", replace(KNOWN, sensor="", serial="", rate_hz=104.0))
    made = tinygc.export(rests, "kalibr")
    assert "the noise was recorded at 104 Hz, the session at 208 Hz: another filter may shape it" in made.remarks
    assert yaml.safe_load(made.files["imu.yaml"])["update_rate"] == 208.0


@pytest.mark.parametrize("name", NOISE_FORMATS)
def test_a_data_rate_that_is_a_guess_is_said_by_formats_that_depend_on_it(name, tmp_path):
    path = written(tmp_path / "noise.json", replace(KNOWN, rate_known=False))
    made = tinygc.export(path, name)
    said = [line for line in made.remarks if "is a guess, 1 over the shortest averaging time of a curve" in line]
    assert len(said) == (name in ("kalibr", "openvins", "vins", "ros"))
    assert all(line.startswith(f"{name}: its data rate, 208 Hz,") for line in said)
    assert not any("guess" in line for line in tinygc.export(written(path), name).remarks)
