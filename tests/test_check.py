"""The first look: each mistake, put into good data, is found and named; good data is left in peace."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, SESSION_TOML, Table, config, session_of, write_session
from looks import G, look, of, serious

from session.detect.findings import Finding, worst
from session.detect.first_look import check_folder
from session.io.config import Accelerometer
from session.io.logfile import Log

# Nothing wrong


def test_good_data_has_no_warning_and_every_check_says_its_number(good):
    findings = look(good)
    assert serious(findings) == set()
    assert {finding.what for finding in findings} >= {"sample rate", "gaps", "jitter", "stills", "gravity", "axes", "gyro scale"}
    for finding in findings:
        assert finding.where == good.logs[0].path.name
        assert any(letter.isdigit() for letter in finding.says)


def test_a_look_changes_nothing(good):
    before = good.logs[0].samples.gyro.copy()
    assert look(good) == look(good)
    np.testing.assert_array_equal(good.logs[0].samples.gyro, before)


@pytest.mark.parametrize("name", ["xsens", "closure/case001", "closure/case002"])
def test_recordings_with_nothing_wrong_have_no_warning(shared, name):
    assert serious(check_folder(shared / name)) == set()


# Units and full scales


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1 / G, "values are in g, but the header says ax_mps2"),
        (G, "values are in m/s², but the header says ax_g"),
        (2.0, "accel_fs_g = 2 "),
        (4.0, "accel_fs_g = 1 "),
        (0.5, "accel_fs_g = 8 "),
        (0.25, "accel_fs_g = 16 "),
    ],
)
def test_a_wrong_unit_of_the_accelerometer_is_named(good, factor, said):
    findings = look(good, accel=good.logs[0].samples.accel * factor)
    gravity = of(findings, "gravity")
    assert gravity.level == "error"
    assert said in gravity.do
    # Gravity's direction is still good, so the gyro is not blamed.
    assert of(findings, "axes").level == "ok"
    assert of(findings, "gyro scale").level == "ok"


def test_a_pre_calibration_that_is_not_this_sensors_is_a_warning(good):
    accelerometer = Accelerometer(1.05 * np.eye(3), good.config.accelerometer.bias_mps2)
    findings = look(replace(good, config=replace(good.config, accelerometer=accelerometer)))
    assert of(findings, "gravity").level == "warning"


def test_an_offset_of_the_accelerometer_is_seen_in_the_spread(good):
    """10 mg turn the vertical by up to 0.57 deg: seventy times the gyro's noise over a segment."""
    findings = look(good, accel=good.logs[0].samples.accel + np.array([0.01 * G, 0, 0]))
    assert serious(findings) == {("gravity spread", "warning")}


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1 / DEG, "the rates are in deg/s, but are read as rad/s"),
        (DEG, "the rates are in rad/s, but are read as dps"),
        (1000.0, "the rates are in mdps"),
        (2.0, "250 dps would match"),
        (4.0, "125 dps would match"),
        (0.5, "1000 dps would match"),
        (0.25, "2000 dps would match"),
        (0.125, "4000 dps would match"),
        (17.5 / (500 / 32.768), "this sensor's is full scale / 32768 = 15.259"),
        ((500 / 32.768) / 17.5, "converted with full scale / 32768 = 15.259 mdps per LSB; the datasheet says 17.50"),
    ],
)
def test_a_wrong_unit_of_the_gyro_is_named(good, factor, said):
    findings = look(good, gyro=good.logs[0].samples.gyro * factor)
    scale = of(findings, "gyro scale")
    assert scale.level == "error"
    assert said in scale.do
    assert of(findings, "axes").level == "ok"
    assert of(findings, "gravity").level == "ok"


@pytest.mark.parametrize("factor", [0.97, 1.0, 1.03])
def test_a_sensitivity_within_tolerance_is_no_mistake_of_units(factor):
    made = session_of(Table().tumble(16, seed=5).samples())
    assert of(look(made, gyro=made.logs[0].samples.gyro * factor), "gyro scale").level == "ok"


def test_a_scale_that_no_mistake_explains_gets_no_name(good):
    scale = of(look(good, gyro=good.logs[0].samples.gyro / 1.5), "gyro scale")
    assert scale.level == "error"
    assert "no usual mistake" in scale.do


def test_several_mistakes_at_once_are_all_named(good):
    """g for m/s², deg/s for rad/s, and x and y exchanged."""
    samples = good.logs[0].samples
    findings = look(good, accel=samples.accel / G, gyro=samples.gyro[:, [1, 0, 2]] / DEG)
    assert "values are in g" in of(findings, "gravity").do
    assert "deg/s" in of(findings, "gyro scale").do
    assert "x and y are exchanged" in of(findings, "axes").says


# Stills


def test_noise_that_is_not_the_sensors_is_a_warning_for_the_sensor_it_is_known_of():
    samples = Table().tumble(14, seed=5).samples(gyro_mdps=25.0, accel_ug=600.0)
    findings = look(session_of(samples))
    assert serious(findings) == {("gyro noise", "warning"), ("accelerometer noise", "warning")}
    assert "bar 3" in of(findings, "gyro noise").says
    assert serious(look(session_of(samples, model="another"))) == set()


@pytest.mark.parametrize(("given", "level"), [(25.0, "ok"), (6.0, "warning"), (100.0, "note")])
def test_noise_is_held_against_what_session_toml_says_of_the_sensor(given, level):
    session = session_of(Table().tumble(14, seed=5).samples(gyro_mdps=25.0), model="another")
    sensor = replace(session.config.sensor, gyro_noise_mdps_rthz=given)
    finding = of(look(replace(session, config=replace(session.config, sensor=sensor))), "gyro noise")
    assert finding.level == level
    assert f"session.toml says {given:g}" in finding.says


def test_a_zero_rate_level_beyond_the_datasheet_is_a_warning():
    findings = look(session_of(Table().tumble(14, seed=5).samples(bias_dps=(0.2, -4.5, 0.1))))
    assert serious(findings) == {("zero-rate level", "warning")}
    assert "-4.5" in of(findings, "zero-rate level").says


def test_a_log_without_a_still_says_so_and_no_more_of_stills():
    table = Table()
    for i in range(10):
        table.turn(100, np.roll((1, 0.3, 0), i), 2.0)
    findings = look(session_of(table.samples()))
    assert of(findings, "stills").level == "error"
    assert not [finding for finding in findings if finding.what in ("gravity", "axes", "gyro noise")]


def test_a_still_that_creeps_is_listed_with_its_place():
    table = Table().rest(2).turn(80, (1, 0, 0)).rest(2).turn(-80, (1, 0, 0)).steady(0.2, (1, 0, 0), 2.0).turn(90, (0, 1, 1))
    finding = of(look(session_of(table.tumble(14).samples())), "not still")
    assert finding.level == "warning"
    assert "1 of 18 are no reference: still 2 at " in finding.says
    assert "creeps 0.2" in finding.says


# Folders


def test_a_folder_is_looked_at_as_a_whole(tmp_path):
    folder = write_session(tmp_path / "s", Table().tumble(8, seed=1).samples())
    write_session(folder, Table().tumble(8, seed=2).samples(), "log0002.csv")
    write_session(folder, Table().tumble(2, seed=3).samples(), "closure0001.csv")
    findings = check_folder(folder)
    assert serious(findings) == set()
    assert {finding.where for finding in findings} == {"log0001.csv", "log0002.csv", "closure0001.csv", "s", "session.toml"}
    assert of(findings, "turns").says.startswith("16 turns")


def test_turns_that_are_hardly_enough_for_the_parameters_are_a_warning(tmp_path):
    findings = check_folder(write_session(tmp_path / "s", Table().tumble(8).samples()))
    assert serious(findings) == {("turns", "warning"), ("accelerometer", "warning")}
    assert "8 turns from still to still, 16 angles for 12 parameters; expected 13" in of(findings, "turns").says


def test_a_log_that_cannot_be_read_does_not_hide_the_others(tmp_path):
    folder = write_session(tmp_path / "s", Table().tumble(14).samples())
    (folder / "log0002.csv").write_text("t_us,gx,gy,gz,ax,ay,az\n0,1,2,3,4,5,x\n1,1,2,3,4,5,6\n")
    (folder / "closure0001.csv.gz").write_bytes(b"no gzip")
    findings = check_folder(folder)
    assert serious(findings) == {("reading", "error")}
    errors = {finding.where: finding.says for finding in findings if finding.level == "error"}
    assert set(errors) == {"log0002.csv", "closure0001.csv.gz"}
    assert "line 2: az is 'x'" in errors["log0002.csv"]
    assert of(findings, "axes").where == "log0001.csv"


@pytest.mark.parametrize(
    ("toml", "said"),
    [
        (None, "session.toml"),
        (SESSION_TOML.replace("500", "501"), "gyro_fs_dps = 501"),
        (SESSION_TOML.replace("208.0", '"fast"'), "odr_hz"),
        (SESSION_TOML + '[protocol]\nreference = "table"\n', "attitudes.csv"),
    ],
)
def test_a_folder_with_a_mistake_in_its_settings_gives_an_error_finding(tmp_path, toml, said):
    folder = write_session(tmp_path / "s", Table().tumble(7).samples())
    (folder / "session.toml").unlink()
    if toml:
        (folder / "session.toml").write_text(toml)
    errors = [finding for finding in check_folder(folder) if finding.level == "error"]
    assert len(errors) == 1
    assert said in errors[0].says


def test_a_folder_that_is_not_there_is_an_error_finding(tmp_path):
    assert worst(check_folder(tmp_path / "nowhere")) == "error"


def test_levels_are_ordered_and_closed():
    made = [Finding(level, "here", "what", "1") for level in ("note", "error", "ok", "warning")]
    assert worst(made) == "error"
    assert worst([]) == "ok"
    with pytest.raises(ValueError, match="expected one of"):
        Finding("bad", "here", "what", "1")
    assert config().sensor.odr_hz == 208.0
    assert Log(Path("a"), made).notes == ()
