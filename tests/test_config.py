"""session.toml: what it means, and that every complaint names file, key, expectation and value."""

import numpy as np
import pytest
from conftest import SESSION_TOML, Table, write_session

from session.bench.session_file import toml_text
from session.detect.first_look import check_folder, check_keys
from session.io.config import Accelerometer, Sensor, read_config
from session.io.errors import FormatError
from session.io.units import STANDARD_GRAVITY_MPS2
from tinygc import CalibrationError


def read(tmp_path, text):
    path = tmp_path / "session.toml"
    path.write_text(text)
    return read_config(path)


def test_a_full_file_is_read(tmp_path):
    config = read(
        tmp_path,
        SESSION_TOML
        + "heading_deg = -12.5\n[accelerometer]\nmatrix = [[1.01,0,0],[0,0.99,0],[0,0,1]]\nbias_mps2 = [0.1,-0.2,0.3]\n"
        + '[protocol]\nstill_s = 2\nsegment_s = 6.5\nreference = "table"\n',
    )
    assert config.sensor.odr_hz == 208.0
    assert (config.sensor.gyro_fs_dps, config.sensor.accel_fs_g, config.sensor.serial) == (500, 4, "42")
    assert (config.site.latitude_deg, config.site.gravity_mps2, config.site.heading_deg) == (31.03, 9.7946, -12.5)
    assert (config.protocol.still_s, config.protocol.segment_s, config.protocol.reference) == (2.0, 6.5, "table")
    assert config.accelerometer.matrix[0, 0] == 1.01


def test_what_is_optional_has_the_defaults_of_formats(tmp_path):
    config = read(tmp_path, 'schema = "tinygc-session/1"\n[sensor]\nodr_hz = 104\ngyro_fs_dps = 250\naccel_fs_g = 2\n')
    assert config.site.latitude_deg is None
    assert config.site.expected_gravity_mps2 == STANDARD_GRAVITY_MPS2
    assert (config.protocol.still_s, config.protocol.segment_s, config.protocol.reference) == (1.0, 5.0, "gravity")
    np.testing.assert_array_equal(config.accelerometer.matrix, np.eye(3))
    np.testing.assert_array_equal(config.accelerometer.bias_mps2, np.zeros(3))


def test_the_gyro_s_own_figures_are_read_and_need_not_be_there(tmp_path):
    none = read(tmp_path, SESSION_TOML).sensor
    assert (none.gyro_bias_instability_dph, none.gyro_noise_mdps_rthz) == (None, None)
    text = SESSION_TOML.replace("[site]", "gyro_bias_instability_dph = 0\ngyro_noise_mdps_rthz = 12.5\n[site]")
    config = read(tmp_path, text)
    assert (config.sensor.gyro_bias_instability_dph, config.sensor.gyro_noise_mdps_rthz) == (0.0, 12.5)
    assert config.unknown == ()
    assert read(tmp_path, toml_text(config)).sensor == config.sensor  # as ``record --like`` hands it on
    assert read(tmp_path, SESSION_TOML.replace("[site]", "gyro_noise_mdps = 5\n[site]")).unknown[0] == (
        "sensor.gyro_noise_mdps",
        "sensor.gyro_noise_mdps_rthz",
    )


@pytest.mark.parametrize(
    ("model", "known"),
    [("ASM330LHH", True), ("asm330lhh", True), ("ST ASM330LHHTR, unit 2", True), ("ASM330LHHX", False), ("ISM330", False), ("", False)],
)
def test_typical_figures_are_of_that_model_only(model, known):
    assert (Sensor(model, "", 208.0, 500, 4).typical("gyro_noise_mdps_rthz") is not None) == known


def test_the_pre_calibration_undoes_offset_and_matrix():
    matrix = np.array([[1.01, 0.002, 0], [-0.003, 0.99, 0.004], [0, 0, 1.02]])
    bias = np.array([0.1, -0.2, 0.3])
    truth = np.array([[0, 0, -9.8], [9.8, 0, 0], [1.0, 2.0, 3.0]])
    measured = truth @ np.linalg.inv(matrix).T + bias
    np.testing.assert_allclose(Accelerometer(matrix, bias).correct(measured), truth, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "schema"),
        ('schema = "tinygc-session/2"\n', "tinygc-session/2"),
        ('schema = "tinygc-session/1"\n', "sensor.odr_hz is missing"),
        (SESSION_TOML.replace("odr_hz = 208.0\n", ""), "sensor.odr_hz is missing"),
        (SESSION_TOML.replace("208.0", '"208"'), 'sensor.odr_hz is "208"'),
        (SESSION_TOML.replace("208.0", "true"), "sensor.odr_hz is true"),
        (SESSION_TOML.replace("208.0", "nan"), "sensor.odr_hz is NaN"),
        (SESSION_TOML.replace("[site]", "gyro_bias_instability_dph = -1\n[site]"), "sensor.gyro_bias_instability_dph is -1"),
        (SESSION_TOML.replace("[site]", "gyro_bias_instability_dph = inf\n[site]"), "sensor.gyro_bias_instability_dph is Infinity"),
        (SESSION_TOML.replace("[site]", "gyro_bias_instability_dph = 1e4\n[site]"), "expected a number from 0 to 1000"),
        (SESSION_TOML.replace("[site]", "gyro_noise_mdps_rthz = 0\n[site]"), "sensor.gyro_noise_mdps_rthz is 0"),
        (SESSION_TOML.replace("208.0", "-208"), "sensor.odr_hz is -208"),
        (SESSION_TOML.replace("31.03", "131.03"), "site.latitude_deg is 131.03"),
        (SESSION_TOML.replace("9.7946", "979.46"), "site.gravity_mps2 is 979.46"),
        (SESSION_TOML.replace('"42"', "42"), "sensor.serial is 42"),
        (SESSION_TOML.replace("[sensor]", "sensor = 3\n[other]"), "sensor is 3, expected a table"),
        (SESSION_TOML + '[protocol]\nreference = "dial"\n', '"dial"'),
        (SESSION_TOML + "[protocol]\nstill_s = 0\n", "protocol.still_s is 0"),
        (SESSION_TOML + "[accelerometer]\nmatrix = [[1,0],[0,1]]\n", "accelerometer.matrix"),
        (SESSION_TOML + "[accelerometer]\nmatrix = [[1,0,0],[0,1,0],[0,1,0]]\n", "singular"),
        (SESSION_TOML + '[accelerometer]\nbias_mps2 = "none"\n', "accelerometer.bias_mps2"),
        (SESSION_TOML + "[accelerometer]\nsigma_mg = 0.3\n", "accelerometer.sigma_mg is of a calibration that is not there"),
        (SESSION_TOML + "[accelerometer]\nown_stills = true\n", "accelerometer.own_stills is of a calibration that is not there"),
        (SESSION_TOML.replace("208.0", "1" + "0" * 400), "sensor.odr_hz is 1000"),
        (SESSION_TOML.replace("208.0", "1" + "0" * 5000), "broken TOML"),
        (SESSION_TOML.replace("208.0", "0x" + "f" * 5000), "sensor.odr_hz is a number of thousands of digits"),
        (SESSION_TOML + f"[accelerometer]\nbias_mps2 = [0, 0, 1{'0' * 400}]\n", "accelerometer.bias_mps2[2] is 1000"),
        (SESSION_TOML + "[accelerometer]\nmatrix = [[1e200,0,0],[0,1e200,0],[0,0,1e200]]\n", "accelerometer.matrix"),
        ("x = " + "[" * 5000, "broken TOML"),
        ("schema = tinygc\n", "broken TOML"),
        (SESSION_TOML + "[site\n", "broken TOML"),
    ],
)
def test_a_complaint_names_the_key_and_the_value(tmp_path, text, said):
    with pytest.raises(FormatError) as error:
        read(tmp_path, text)
    assert said in str(error.value)
    assert "session.toml" in str(error.value)


def test_a_file_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "session.toml").write_bytes(b"\xff\xfe\x00s\x00c")
    with pytest.raises(FormatError, match="broken TOML"):
        read_config(tmp_path / "session.toml")


def test_a_missing_file_says_what_a_folder_holds(tmp_path):
    with pytest.raises(CalibrationError, match=r"session.toml.*log\*\.csv"):
        read_config(tmp_path / "session.toml")


def test_a_folder_in_the_place_of_the_file_is_refused(tmp_path):
    (tmp_path / "session.toml").mkdir()
    with pytest.raises(CalibrationError):
        read_config(tmp_path / "session.toml")


def test_a_byte_order_mark_of_an_editor_does_no_harm(tmp_path):
    (tmp_path / "session.toml").write_text(SESSION_TOML, encoding="utf-8-sig")
    assert read_config(tmp_path / "session.toml").sensor.odr_hz == 208.0


@pytest.mark.parametrize(
    ("old", "new", "key", "near"),
    [
        ("latitude_deg", "latitude", "site.latitude", "site.latitude_deg"),
        ("latitude_deg", "Latitude_Deg", "site.Latitude_Deg", "site.latitude_deg"),
        ("serial =", "heading_deg = 3.0\nserial =", "sensor.heading_deg", "site.heading_deg"),
        ("[sensor]", "still_s = 2\n[sensor]", "still_s", "protocol.still_s"),
        ("[site]", "[protocl]\nsegment_s = 3\n[site]", "protocl.segment_s", "protocol.segment_s"),
        ("[site]", "[weather]\nkind = 3\n[site]", "weather.kind", None),
    ],
)
def test_a_key_that_nothing_reads_is_named_with_the_nearest_known_one(tmp_path, old, new, key, near):
    config = read(tmp_path, SESSION_TOML.replace(old, new, 1))
    assert config.unknown == ((key, near),)
    (finding,) = check_keys(config)
    assert (finding.level, key in finding.says, near is None or near in finding.do) == ("warning", True, True)


def test_known_keys_are_all_known(tmp_path):
    assert check_keys(read(tmp_path, SESSION_TOML)) == []


def test_check_warns_of_an_unknown_key(tmp_path):
    folder = write_session(tmp_path / "s", Table().tumble(2).samples(), toml=SESSION_TOML.replace("latitude_deg", "latitude"))
    assert any(finding.do == "did you mean site.latitude_deg?" for finding in check_folder(folder))
