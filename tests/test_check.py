"""The first look: each mistake, put into good data, is found and named alone; good data is left in peace."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, SESSION_TOML, Table, session_of, write_session
from looks import G, look, of, serious, with_sensor
from processes import as_it_stands

import tinygc
from session.base.errors import CalibrationError
from session.detect.findings import Finding, worst
from session.detect.first_look import check_folder, check_session, first_look
from session.log.config import Accelerometer, LeftOut

RATES = {1.0: "give sensor.gyro_noise_mdps_rthz", 1 / DEG: "are these rates in dps?", DEG: "are these rates in rad/s?"}

REACH_RPS = 32767 * 17.5e-3 * DEG
LSB = 0.0175 * DEG


@pytest.fixture(scope="module")
def good():
    """A session of eight turns with nothing wrong."""
    return session_of(Table().tumble(8, rest_s=1.5, turn_s=2.5, seed=5).samples())


@pytest.fixture(scope="module")
def short():
    """Enough for what needs no turns."""
    return session_of(Table().tumble(3, seed=5).samples())


@pytest.mark.parametrize("times", RATES)
def test_at_rest_the_noise_of_an_unknown_sensor_asks_for_the_unit(times):
    samples = Table().rest(20).samples()
    findings = look(session_of(samples, raw=False, model="unknown"), gyro=times * samples.gyro)
    assert RATES[times] in of(findings, "gyro noise").do


def test_good_data_has_no_warning_every_check_says_its_number_and_nothing_is_changed(good):
    before = good.logs[0].samples.gyro.copy()
    findings = look(good)
    assert serious(findings) == set()
    assert {finding.what for finding in findings} >= {"sample rate", "gaps", "jitter", "stills", "gravity", "axes", "gyro scale"}
    for finding in findings:
        assert finding.where == good.logs[0].path.name
        assert any(letter.isdigit() for letter in finding.description)
    assert look(good) == findings
    np.testing.assert_array_equal(good.logs[0].samples.gyro, before)


def rows_of(values, row, column, new):
    values = values.copy()
    values[row, column] = new
    return values


def held(values, rows):
    return values[(np.arange(len(values)) // rows * rows).astype(int)]


ST = 17.5 / (500 / 32.768)
#: what is done to gyro, accelerometer and temperature of a session with turns
OF_TURNS = {
    "forces in g": lambda s: {"accel": s.accel / G},
    "forces times g": lambda s: {"accel": s.accel * G},
    "another full scale": lambda s: {"accel": s.accel * 2},
    "10 mg, by up to 0.57 deg seventy times the gyro's noise": lambda s: {"accel": s.accel + np.array([0.01 * G, 0, 0])},
    "rates in deg/s": lambda s: {"gyro": s.gyro / DEG},
    "full scale / 32768": lambda s: {"gyro": s.gyro / ST},
    "half as much again, which no usual mistake makes": lambda s: {"gyro": s.gyro / 1.5},
    "a sign": lambda s: {"gyro": s.gyro * [1, 1, -1]},
    "two axes exchanged and a sign": lambda s: {"gyro": s.gyro[:, [1, 0, 2]] * [1, 1, -1]},
    "a sign of the accelerometer, as two of the gyro": lambda s: {"accel": s.accel * [1, 1, -1]},
    "gravity turned over, which does not show": lambda s: {"accel": -s.accel},
    "clipped at 26 dps": lambda s: {"gyro": np.clip(s.gyro, -26 * DEG, 26 * DEG)},
    "y clipped on one side": lambda s: {"gyro": np.clip(s.gyro, [-9, -4000 * LSB, -9], [9, 4000 * LSB, 9])},
    "one sample at the register's end": lambda s: {"gyro": rows_of(s.gyro, 500, 2, -32768 * LSB)},
    "ay dead for two seconds": lambda s: {"accel": rows_of(s.accel, slice(2000, 2416), 1, 0.01)},
}
#: and of one that needs none
OF_READINGS = {
    "ax at the register's end": lambda s: {"accel": rows_of(s.accel, 700, 0, 32767 * 0.122e-3 * G)},
    "gz stuck": lambda s: {"gyro": rows_of(s.gyro, slice(None), 2, s.gyro[0, 2])},
    "ay stuck": lambda s: {"accel": rows_of(s.accel, slice(None), 1, s.accel[0, 1])},
    "gx dead from row 2000 on": lambda s: {"gyro": rows_of(s.gyro, slice(2000, None), 0, 0.0)},
    "six rows alike": lambda s: {"gyro": held(s.gyro, 6), "accel": held(s.accel, 6)},
    "forces of 1.5 rows": lambda s: {"accel": held(s.accel, 1.5)},
    "rates of three rows": lambda s: {"gyro": held(s.gyro, 3)},
    "no temperature": lambda s: {"temp_c": None},
    "a temperature that stands": lambda s: {"temp_c": np.full(len(s), 25.0)},
    "11 degrees": lambda s: {"temp_c": np.linspace(22, 33, len(s))},
    "kelvin": lambda s: {"temp_c": s.temp_c + 273.15},
    "tenths of a degree": lambda s: {"temp_c": s.temp_c * 10},
    "Fahrenheit": lambda s: {"temp_c": s.temp_c * 1.8 + 32},
    "the register": lambda s: {"temp_c": np.rint((s.temp_c - 25) * 256)},
    "80 degrees": lambda s: {"temp_c": s.temp_c + 55},
    "time in ns as us": lambda s: {"t_ns": s.t_ns * 1000},
}


#: what is an error beside another by one mistake
BESIDE = ({"accelerometer stuck", "gravity"}, {"gyro dead", "quantisation"}, {"time unit", "gyro scale"})


def test_a_mistake_is_named_and_nothing_else_is_blamed(good, short):
    said = []
    for session, mistakes in ((good, OF_TURNS), (short, OF_READINGS)):
        before = look(session)
        for name, change in mistakes.items():
            findings = [each for each in look(session, **change(session.logs[0].samples)) if each.level != "ok" and each not in before]
            errors = {each.what for each in findings if each.level == "error"}
            assert len(errors) <= 1 or errors in BESIDE, name
            said += [f"# {name}", *(f"{each.level}: {each.line}" for each in findings), ""]
    as_it_stands("mistakes.txt", "\n".join(said))


SETTINGS = [
    ({"odr_hz": 208.1}, {}, "sample rate", "ok", "208.00 Hz by the stamps"),
    ({"odr_hz": 104.0}, {}, "sample rate", "error", "the sensor has 208 Hz"),
    ({"model": "another", "odr_hz": 120.0}, {}, "sample rate", "warning", "how far this sensor's clock may be off is not known"),
    ({"gyro_fs_dps": 250}, {"gyro_fs_dps": "500"}, "full scale", "error", "gyro_fs_dps=500"),
    ({}, {"serial": "other"}, "serial", "warning", ""),
    ({"gyro_noise_mdps_rthz": 1.0}, {}, "gyro noise", "warning", "session.toml has 1"),
    ({"gyro_noise_mdps_rthz": 100.0}, {}, "gyro noise", "note", "session.toml has 100"),
    ({"model": "another"}, {}, "zero-rate level", "note", "not known"),
    ({"model": "BMI088"}, {}, "gyro noise", "note", "not known"),  # whose figures are remembered, not read
]


@pytest.mark.parametrize(("settings", "comments", "what", "level", "words"), SETTINGS)
def test_a_log_is_held_against_what_is_declared(short, settings, comments, what, level, words):
    findings = look(with_sensor(short, **settings), log=replace(short.logs[0], comments=comments))
    finding = of(findings, what)
    assert (finding.level, words in f"{finding.description} {finding.do}") == (level, True), finding.line


def test_a_log_of_another_sensor_is_refused_among_those_of_the_stated_one(short):
    mine, other = (replace(short.logs[0], comments={"serial": serial}) for serial in ("A", "B"))
    for logs, answer in (((mine, other), ("error", "move it out")), ((other,), ("warning", "correct sensor.serial"))):
        session = replace(with_sensor(short, serial="A"), logs=logs)
        finding = of(first_look(session, other, [], None), "serial")
        assert (finding.level, answer[1] in finding.do) == (answer[0], True)


def test_a_rate_that_the_board_states_is_held_against_the_stamps(short):
    for said, levels in (("208.3", ["ok"]), ("211.3", ["ok", "warning"]), ("unknown", ["ok"])):
        log = replace(short.logs[0], comments={"odr_hz": said}, notes=("line 7, the last, is cut off: left out",))
        findings = look(with_sensor(short, odr_hz=208.1), log=log)
        assert [finding.level for finding in findings if finding.what == "sample rate"] == levels
        assert (of(findings, "reading").level, "cut off" in of(findings, "reading").description) == ("note", True)


@pytest.mark.parametrize(("odr_hz", "level"), [(190.5, "note"), (188.0, "error")])
def test_a_declared_rate_may_be_off_by_a_tenth(short, odr_hz, level):
    assert of(look(with_sensor(short, odr_hz=odr_hz)), "sample rate").level == level


def test_noise_and_zero_that_are_not_the_sensors_are_warnings_for_the_sensor_they_are_known_of():
    samples = Table().tumble(14, seed=5, rest_s=6.0).samples(odr_hz=104, gyro_mdps=25.0, accel_ug=600.0, bias_dps=(0.2, -4.5, 0.1))
    session = session_of(samples, odr_hz=104.0)
    findings = look(session)
    assert serious(findings) == {(what, "warning") for what in ("gyro noise", "accelerometer noise", "zero-rate level")}
    assert "bar 3" in of(findings, "gyro noise").description
    assert "vibrate" in of(findings, "gyro noise").do
    assert serious(look(with_sensor(session, model="another"))) == set()


def test_gaps_are_counted_with_what_they_lost_and_single_losses_are_neither_rate_nor_jitter(good):
    samples = good.logs[0].samples
    lost = np.random.default_rng(2).random(len(samples)) < 0.05
    lost[[0, -1]] = False
    for rows, says in (
        (np.r_[1000:1010, 5000:5100], "2 gaps, 110 samples lost, the longest 0.486 s, the first at 4.8 s"),
        (lost, "samples lost"),
    ):
        kept = np.ones(len(samples), bool)
        kept[rows] = False
        findings = look(good, log=replace(good.logs[0], samples=samples.pick(kept)))
        assert says in of(findings, "gaps").description
        assert f"{np.count_nonzero(~kept)} samples lost" in of(findings, "gaps").description
        assert of(findings, "jitter").level == "ok"
    for each, level in ((500, "warning"), (2000, "note")):  # one in a thousand
        kept = samples.pick(np.arange(len(samples)) % each != 300)
        assert of(look(good, log=replace(good.logs[0], samples=kept)), "gaps").level == level


def test_logs_without_a_still_that_creep_or_lie_in_one_attitude():
    restless = Table()
    for i in range(6):
        restless.turn(100, np.roll((1, 0.3, 0), i), 2.0)
    findings = look(session_of(restless.samples(odr_hz=104), odr_hz=104.0))
    assert of(findings, "stills").level == "error"
    assert not [finding for finding in findings if finding.what in ("gravity", "axes", "gyro noise")]
    creeps = Table().rest(2).turn(80, (1, 0, 0)).rest(2).turn(-80, (1, 0, 0)).steady(0.2, (1, 0, 0), 2.0).turn(90, (0, 1, 1)).rest(2)
    finding = of(look(session_of(creeps.samples())), "not still")
    assert (finding.level, "1 of 4 are no reference: still 2 at " in finding.description) == ("warning", True)
    level = Table().rest(2)
    for number in range(4):
        level.turn(40, (0, 0, 1)).turn(0.05 * (-1) ** number, (1, 0, 0)).rest(2)
    session = session_of(level.samples(odr_hz=104), odr_hz=104.0)
    findings = look(session)
    assert "5 stills that are all one attitude (within 0." in of(findings, "gravity spread").description
    assert of(findings, "gyro against gravity").level == "note"
    assert not [finding for finding in findings if finding.what in ("axes", "gyro scale")]
    # The same samples as a log and as a closure run: only the log is asked for other attitudes.
    run = replace(session.logs[0], path=Path("closure0001.csv"))
    as_log, as_run = (f for f in check_session(replace(session, closures=(run,))) if f.what == "gravity spread")
    assert (as_log.level, as_run.level, as_run.where, as_run.do) == ("note", "ok", "closure0001.csv", "")
    assert "6 or more" in as_log.do


def test_a_gyro_of_another_board_agrees_with_nothing_and_the_fit_says_it_too(good):
    other = replace(good.logs[0], samples=replace(good.logs[0].samples, gyro=Table().tumble(8, 1.5, 2.5, seed=6).samples().gyro))
    findings = look(good, log=other)
    assert ("gyro against gravity", "warning") in serious(findings)
    assert not [finding for finding in findings if finding.what in ("axes", "gyro scale")]
    session = replace(good, logs=(other,))
    with pytest.raises(CalibrationError, match="turns miss gravity by more than 10% of their angle") as refused:
        tinygc.fit(session, methods=("least_squares",))
    finding = of(tinygc.check(session), "fit")
    assert (finding.level, finding.description) == ("error", str(refused.value))


# Turns, as ``fit`` uses them


def shaken(turns):
    """Turns from still to still, and at the end shaking that the gyro clips in."""
    table, rng = Table().tumble(turns, seed=5), np.random.default_rng(5)
    for _ in range(8):
        table.turn(rng.uniform(300, 500) * rng.choice([-1, 1]), rng.normal(size=3), 0.7)
    samples = table.rest(2).samples()
    return session_of(replace(samples, gyro=np.clip(samples.gyro, -REACH_RPS, REACH_RPS)))


def test_clipped_shaking_that_no_fit_uses_accuses_neither_scale_nor_axes():
    findings = check_session(shaken(9))
    assert of(findings, "axes").level == of(findings, "gyro scale").level == "ok"
    turns = of(findings, "turns")
    assert turns.description.startswith("9 of 10 turns from still to still, 18 angles for 12 parameters")
    assert "not used: turn 9 at 4" in turns.description
    assert "the gyro clips at 573 dps" in turns.description


def test_check_refuses_what_fit_refuses_in_the_same_words():
    session = session_of(Table().tumble(6, seed=5).samples())
    with pytest.raises(CalibrationError) as refused:
        tinygc.fit(session, methods=("least_squares",))
    finding = of(tinygc.check(session), "turns")
    assert (finding.level, "6 usable segments, expected at least 7" in finding.description) == ("error", True)
    assert finding.description.startswith(str(refused.value).removeprefix("made: "))


def test_a_turn_is_left_out_by_a_moment_and_a_moment_that_cannot_be_is_said(good):
    def found(*rows):
        return check_session(replace(good, config=replace(good.config, exclude=rows)))

    assert "left out by hand (session.toml)" in of(found(LeftOut("log0001.csv", 23.5)), "turns").description
    says = [each.description for each in found(LeftOut("log0001.csv", 500.0), LeftOut("log0009.csv", 3.0)) if each.what == "exclude"]
    assert says == [
        "log0001.csv at 500 s is left out, which lies outside of it",
        "log0009.csv at 3 s is left out, which is no log of this session",
    ]


def test_a_copy_is_an_error_whatever_its_stamps_and_its_length(good):
    (log,) = good.logs
    late = replace(log, path=Path("late.csv"), samples=replace(log.samples, t_ns=log.samples.t_ns + 7))
    run = replace(log, path=Path("closure0001.csv"), samples=log.samples.between(0, len(log.samples) // 2))
    findings = [each for each in check_session(replace(good, logs=(log, late), closures=(run,))) if each.what == "copy"]
    assert {each.where for each in findings} == {"late.csv", "closure0001.csv"}  # a run that judges must not be what was fitted
    assert {each.level for each in findings} == {"error"}


# Folders


def test_a_folder_is_looked_at_as_a_whole_and_a_log_that_cannot_be_read_does_not_hide_the_others(tmp_path):
    folder = write_session(tmp_path / "s", Table().tumble(8, seed=1).samples())
    write_session(folder, Table().tumble(6, seed=2).samples(), "log0002.csv", SESSION_TOML.replace("latitude_deg", "latitude"))
    (folder / "log0003.csv").write_text("t_us,gx,gy,gz,ax,ay,az\n0,1,2,3,4,5,x\n1,1,2,3,4,5,6\n")
    (folder / "closure0001.csv.gz").write_bytes(b"no gzip")
    findings = check_folder(folder)
    errors = {finding.where: finding.description for finding in findings if finding.level == "error"}
    assert set(errors) == {"log0003.csv", "closure0001.csv.gz"}
    assert "line 2: az is 'x'" in errors["log0003.csv"]
    assert {"log0001.csv", "log0002.csv", "s", "session.toml"} <= {finding.where for finding in findings}
    assert any(finding.do == "did you mean site.latitude_deg?" for finding in findings)
    assert of(findings, "turns").description.startswith("14 turns")
    assert of(findings, "accelerometer").level in ("note", "warning")  # which session.toml does not give


@pytest.mark.parametrize(
    ("toml", "said"),
    [
        (None, "session.toml"),
        (SESSION_TOML.replace("500", "501"), "gyro_fs_dps = 501"),
        (SESSION_TOML.replace("208.0", '"fast"'), "odr_hz"),
    ],
)
def test_a_folder_with_a_mistake_in_its_settings_gives_an_error_finding(tmp_path, toml, said):
    folder = write_session(tmp_path / "s", Table().rest(1).samples())
    (folder / "session.toml").unlink()
    if toml:
        (folder / "session.toml").write_text(toml)
    (error,) = [finding for finding in check_folder(folder) if finding.level == "error"]
    assert said in error.description
    assert worst(check_folder(tmp_path / "nowhere")) == "error"


def test_a_calibration_that_is_not_this_sensors_is_a_warning(good):
    other = Accelerometer(1.05 * np.eye(3), good.config.accelerometer.bias_mps2)
    assert of(look(replace(good, config=replace(good.config, accelerometer=other))), "gravity").level == "warning"


def test_levels_are_ordered_and_closed():
    assert worst([Finding(level, "here", "what", "1") for level in ("note", "error", "ok", "warning")]) == "error"
    assert worst([]) == "ok"
    with pytest.raises(ValueError, match="expected one of"):
        Finding("bad", "here", "what", "1")
