"""The first look: each mistake, put into good data, is found and named; good data is left in peace."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, SESSION_TOML, Table, config, session_of, write_session

from session.check import Finding, check_folder, first_look, worst
from session.checks.axes import axes_in_words
from session.config import Accelerometer
from session.folder import Session, read_session
from session.logfile import Log
from session.samples import Samples
from session.stills import find_stills
from session.tilt import SIGNED_PERMUTATIONS, agreement

G = 9.80665
IDENTITY = np.eye(3)
X_Y_EXCHANGED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1.0]])


def name_of(axes):
    """A permutation as a test's name: ``+y-x+z`` and the like."""
    if isinstance(axes, str):
        return "words"
    return "".join(("-" if row.sum() < 0 else "+") + "xyz"[np.argmax(np.abs(row))] for row in axes)


@pytest.fixture(scope="module", params=["made", "recorded"])
def good(request) -> Session:
    """A session with nothing wrong: made here, and by another bench."""
    if request.param == "made":
        return session_of(Table().tumble(16, seed=5).samples())
    shared = request.getfixturevalue("shared")
    return read_session(shared / "closure" / "case001")


def look(session: Session, **changes) -> list[Finding]:
    """First look at the session's log with some of its samples' fields, or the whole log, changed."""
    log = changes.pop("log", session.logs[0])
    log = replace(log, samples=replace(log.samples, **changes))
    session = replace(session, logs=(log,))
    stills, noise = find_stills(session.calibrated(log), session.config.protocol.still_s)
    return first_look(session, log, stills, noise)


def of(findings: list[Finding], what: str) -> Finding:
    (finding,) = [finding for finding in findings if finding.what == what]
    return finding


def serious(findings: list[Finding]) -> set[tuple[str, str]]:
    return {(finding.what, finding.level) for finding in findings if finding.level in ("warning", "error")}


def with_sensor(session: Session, **changes) -> Session:
    return replace(session, config=replace(session.config, sensor=replace(session.config.sensor, **changes)))


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


def test_no_recording_of_the_other_bench_has_an_error(shared):
    """What is concealed there are effects, not mistakes of units, axes or files."""
    for folder in sorted((shared / "concealed").glob("case*")):
        assert worst(check_folder(folder)) != "error", folder.name


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


# Axes


def test_each_wrong_order_of_the_gyros_axes_is_found(good):
    right = good.calibrated(good.logs[0])
    stills, _ = find_stills(right)
    for axes in SIGNED_PERMUTATIONS:
        # m = axes^T omega, so omega = axes m; the gyro's means in the stills turn with it.
        wrong = replace(right, gyro=right.gyro @ axes)
        found = agreement(wrong, [replace(still, gyro_mean=still.gyro_mean @ axes) for still in stills])
        np.testing.assert_array_equal(found.axes, axes, err_msg=name_of(axes))
        assert found.scale == pytest.approx(1, abs=0.05)
        assert found.misfit < 0.1


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        (np.diag([1, 1, -1.0]), "the gyro's z has the wrong sign; its triad is left-handed"),
        (np.diag([-1, -1, 1.0]), "the gyro's x and y have the wrong sign"),
        (-IDENTITY, "all three axes of the gyro have the wrong sign; its triad is left-handed"),
        (
            X_Y_EXCHANGED,
            "the gyro's x and y are exchanged; true x is the logged +y, y is the logged +x, z is the logged +z; its triad is left-handed",
        ),
        (
            np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]),
            "the gyro's x and y are exchanged; true x is the logged -y, y is the logged +x, z is the logged +z",
        ),
        (
            X_Y_EXCHANGED @ np.diag([1, 1, -1.0]),
            "the gyro's x and y are exchanged; z has the wrong sign; true x is the logged +y, y is the logged +x, z is the logged -z",
        ),
        (
            np.roll(IDENTITY, 1, axis=1),
            "the gyro's axes are in a wrong order; true x is the logged +y, y is the logged +z, z is the logged +x",
        ),
    ],
    ids=name_of,
)
def test_the_mistake_of_axes_is_said_in_words(good, axes, words):
    assert axes_in_words(axes) == words
    findings = look(good, gyro=good.logs[0].samples.gyro @ axes)
    finding = of(findings, "axes")
    assert finding.level == "error"
    assert finding.says.startswith(words + ":")
    assert serious(findings) == {("axes", "error")}


def test_a_mirrored_gyro_is_not_blamed_on_the_mounting_but_a_turned_one_can_be_the_accelerometer():
    made = session_of(Table().tumble(16, seed=5).samples())
    samples = made.logs[0].samples
    assert "a rotation of the board cannot" in of(look(made, gyro=samples.gyro * [1, 1, -1]), "axes").do
    # Of the accelerometer one wrong sign is the same, to gravity's movement, as two of the gyro.
    advice = of(look(made, accel=samples.accel * [1, 1, -1]), "axes").do
    assert "or it is the accelerometer: the accelerometer's z has the wrong sign" in advice
    advice = of(look(made, accel=samples.accel[:, [1, 0, 2]]), "axes").do
    assert "the accelerometer's x and y are exchanged" in advice


def test_gravity_turned_over_does_not_show():
    """Axes forward-left-up for both, or +g at rest: the movement is the same, and nothing is claimed."""
    made = session_of(Table().tumble(16, seed=5).samples())
    samples = made.logs[0].samples
    assert serious(look(made, accel=-samples.accel)) == set()
    assert serious(look(made, accel=samples.accel * [1, -1, -1], gyro=samples.gyro * [1, -1, -1])) == set()


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0)])
def test_turns_about_one_axis_accuse_nobody(axis):
    """Only one axis is seen: what its neighbours do stays unknown, and the least changed order is as logged."""
    table = Table().rest(2)
    for i in range(14):
        table.turn((120 + 10 * i) * (-1) ** i, axis).rest(2)
    findings = look(session_of(table.samples()))
    assert of(findings, "axes").level == "ok"
    assert of(findings, "gyro scale").level == "ok"


@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_turns_of_more_than_a_circle_know_their_scale(factor):
    """At 1000 dps gravity goes round three corners in a quarter of a second."""
    table, rng = Table().rest(2), np.random.default_rng(2)
    for _ in range(16):
        table.turn(rng.uniform(500, 1100) * rng.choice([-1, 1]), rng.normal(size=3), 2.0).rest(2)
    samples = table.samples(odr_hz=416, registers=False)
    assert np.abs(samples.gyro).max() > 800 * DEG
    found = agreement(samples, find_stills(samples)[0])
    assert agreement(replace(samples, gyro=factor * samples.gyro), find_stills(samples)[0]).scale == pytest.approx(1 / factor, rel=0.02)
    assert found.residual < 4 * DEG


def test_turns_about_the_vertical_say_that_nothing_is_seen():
    table = Table().rest(2)
    for i in range(14):
        table.turn(90 * (-1) ** i, (0, 0, 1)).rest(2)
    findings = look(session_of(table.samples()))
    assert of(findings, "gyro against gravity").level == "note"
    assert not [finding for finding in findings if finding.what in ("axes", "gyro scale")]


def test_a_gyro_of_another_board_agrees_with_nothing():
    made = session_of(Table().tumble(16, seed=5).samples())
    other = Table().tumble(16, seed=6).samples()
    findings = look(made, gyro=other.gyro)
    assert ("gyro against gravity", "warning") in serious(findings)
    assert not [finding for finding in findings if finding.what in ("axes", "gyro scale")]


def test_a_closure_run_that_returns_to_its_start_is_no_argument_for_a_scale_of_zero():
    table = Table().rest(3)
    for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)):
        table.turn(400, axis, 4).turn(-400, axis, 4)
    made = session_of(table.rest(3).samples())
    findings = look(made)
    assert of(findings, "axes").level == "ok"
    assert of(findings, "gyro scale").level == "ok"
    assert "deg/s" in of(look(made, gyro=made.logs[0].samples.gyro / DEG), "gyro scale").do


# Stamps


@pytest.mark.parametrize(("declared", "level"), [(208.0, "ok"), (211.3, "note"), (200.0, "note"), (104.0, "error"), (416.0, "error")])
def test_the_true_rate_is_told_from_the_declared_one(good, declared, level):
    finding = of(look(with_sensor(good, odr_hz=declared)), "sample rate")
    assert finding.level == level
    assert "208.00 Hz by the stamps" in finding.says
    if level == "error":
        assert "the sensor has 208 Hz" in finding.do


def test_a_comment_that_contradicts_the_stamps_is_a_warning(good):
    for said, levels in (("208.3", ["ok"]), ("211.3", ["ok", "warning"]), ("unknown", ["ok"])):
        log = replace(good.logs[0], comments={"odr_hz": said})
        assert [finding.level for finding in look(good, log=log) if finding.what == "sample rate"] == levels


@pytest.mark.parametrize(("key", "said"), [("gyro_fs_dps", "1000"), ("accel_fs_g", "8")])
def test_a_comment_that_contradicts_the_full_scale_is_an_error(good, key, said):
    finding = of(look(good, log=replace(good.logs[0], comments={key: said})), "full scale")
    assert finding.level == "error"
    assert f"{key}={said}" in finding.says
    good_ones = {"gyro_fs_dps": "500", "accel_fs_g": "4.0", "serial": good.config.sensor.serial}
    assert serious(look(good, log=replace(good.logs[0], comments=good_ones))) == set()


def test_another_sensors_serial_is_a_warning(good):
    assert of(look(good, log=replace(good.logs[0], comments={"serial": "other"})), "serial").level == "warning"


def test_gaps_are_counted_with_what_they_lost(good):
    samples = good.logs[0].samples
    kept = np.ones(len(samples), bool)
    kept[1000:1010] = kept[5000:5100] = False
    part = Samples(samples.t_ns[kept], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept])
    finding = of(look(good, log=replace(good.logs[0], samples=part)), "gaps")
    assert finding.level == "warning"
    assert finding.says.startswith("2 gaps, 110 samples lost, the longest 0.486 s, the first at 4.8 s")


@pytest.mark.parametrize("share", [0.0005, 0.005, 0.05])
def test_samples_lost_singly_are_counted_and_are_neither_rate_nor_jitter(good, share):
    samples = good.logs[0].samples
    kept = np.random.default_rng(2).random(len(samples)) >= share
    kept[[0, -1]] = True
    part = Samples(samples.t_ns[kept], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept])
    whole, findings = look(good), look(good, log=replace(good.logs[0], samples=part))
    assert of(findings, "sample rate").says == of(whole, "sample rate").says
    assert f"{np.count_nonzero(~kept)} samples lost" in of(findings, "gaps").says
    assert of(findings, "gaps").level == ("warning" if share > 0.001 else "note")
    assert of(findings, "jitter").level == "ok"


def test_stamps_made_on_arrival_are_told_by_what_they_cost(good):
    """A stamp moved by up to 2 ms misplaces rotation while the rate changes.  The number is what turns really are off by."""
    log = good.logs[0]
    jitter_ns = np.random.default_rng(1).uniform(-2e6, 2e6, size=len(log.samples)).astype(np.int64)
    finding = of(look(good, t_ns=log.samples.t_ns + jitter_ns), "jitter")
    said_deg, noise_deg = (float(word) for word in finding.says.replace(",", "").split() if word.startswith("0."))
    off = np.cumsum((log.samples.gyro[1:] + log.samples.gyro[:-1]) / 2 * np.diff(jitter_ns)[:, None] * 1e-9, axis=0) / DEG
    stills, _ = find_stills(log.samples)
    off_per_turn = np.diff(off[[still.middle for still in stills]], axis=0).std(axis=0).max()
    assert said_deg == pytest.approx(off_per_turn, rel=0.5)
    assert finding.level == ("warning" if said_deg > noise_deg else "ok")
    assert of(look(good, t_ns=log.samples.t_ns + jitter_ns // 100), "jitter").level == "ok"


def test_what_the_reader_mended_is_passed_on(good):
    log = replace(good.logs[0], notes=("line 7, the last, is cut off (2 columns, expected 8): left out",))
    finding = of(look(good, log=log), "reading")
    assert finding.level == "note"
    assert "cut off" in finding.says


# Registers


@pytest.mark.parametrize("lsb", [4000, 6000])
def test_a_plateau_below_the_full_scale_is_clipping(good, lsb):
    samples = good.logs[0].samples
    level = lsb * 0.0175 * DEG
    gyro = samples.gyro.copy()
    gyro[:, 1] = np.clip(gyro[:, 1], -level, level)
    finding = of(look(good, gyro=gyro), "gyro clipping")
    assert finding.level == "warning"
    assert f"{lsb * 0.0175:g} dps" in finding.says
    assert "y stands at" in finding.says
    assert "x stands" not in finding.says


def test_a_single_reading_at_the_registers_end_is_clipping(good):
    gyro, accel = good.logs[0].samples.gyro.copy(), good.logs[0].samples.accel.copy()
    gyro[500, 2] = -32768 * 0.0175 * DEG
    accel[700, 0] = 32767 * 0.122e-3 * G
    findings = look(good, gyro=gyro, accel=accel)
    assert "z stands at -573.44 dps in 1 samples, first at 2.4 s" in of(findings, "gyro clipping").says
    assert of(findings, "accelerometer clipping").level == "warning"


def test_a_peak_beyond_the_full_scale_is_no_clipping():
    table = Table().tumble(14, seed=5).turn(800, (0, 1, 0), 3.0).rest(2)
    finding = of(look(session_of(table.samples())), "gyro clipping")
    assert finding.level == "note"
    assert "full scale 500 is passed" in finding.says


@pytest.mark.parametrize("seed", range(5))
def test_the_peak_of_a_noisy_turn_is_no_plateau(seed):
    made = session_of(Table().tumble(14, seed=seed).samples(gyro_mdps=3.0, seed=seed))
    assert of(look(made), "gyro clipping").level == "ok"


@pytest.mark.parametrize(("sensor", "axis"), [("gyro", 0), ("gyro", 2), ("accel", 1)])
def test_an_axis_that_never_moves_is_named(good, sensor, axis):
    values = getattr(good.logs[0].samples, sensor).copy()
    values[:, axis] = values[0, axis]
    findings = look(good, **{sensor: values})
    finding = of(findings, {"gyro": "gyro stuck", "accel": "accelerometer stuck"}[sensor])
    assert finding.level == "error"
    assert finding.says.startswith("xyz"[axis])


def test_rows_that_repeat_are_told_with_the_true_rate(good):
    """A loop that reads twice as fast as the sensor measures."""
    samples = good.logs[0].samples
    twice = np.repeat(np.arange(len(samples)), 2)
    t_ns = np.round(np.arange(len(twice)) * 1e9 / 416).astype(np.int64)
    doubled = Samples(t_ns, samples.gyro[twice], samples.accel[twice], samples.temp_c[twice])
    session = with_sensor(good, odr_hz=416.0)
    finding = of(look(session, log=replace(good.logs[0], samples=doubled)), "repeats")
    assert finding.level == "warning"
    assert "50%" in finding.says
    assert "208 Hz" in finding.says


# Temperature


def test_temperature_missing_stuck_implausible_and_moving(good):
    count = len(good.logs[0].samples)
    for temp_c, level, said in (
        (None, "note", "not recorded"),
        (np.full(count, 25.0), "note", "stands at 25.00"),
        (np.linspace(6400, 6656, count), "warning", "the sensor works from -40 to 105"),
        (np.linspace(22, 33, count), "note", "the bias is likely to follow"),
        (np.linspace(24, 25, count), "ok", "degC"),
    ):
        finding = of(look(good, temp_c=temp_c), "temperature")
        assert finding.level == level
        assert said in finding.says


# Stills


def test_noise_that_is_not_the_sensors_is_a_warning_for_the_sensor_it_is_known_of():
    samples = Table().tumble(14, seed=5).samples(gyro_mdps=25.0, accel_ug=600.0)
    findings = look(session_of(samples))
    assert serious(findings) == {("gyro noise", "warning"), ("accelerometer noise", "warning")}
    assert "bar 3" in of(findings, "gyro noise").says
    assert serious(look(session_of(samples, model="another"))) == set()


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
    assert {finding.where for finding in findings} == {"log0001.csv", "log0002.csv", "closure0001.csv", "s"}
    assert of(findings, "turns").says.startswith("16 turns")


def test_too_few_turns_for_the_parameters_are_a_warning(tmp_path):
    findings = check_folder(write_session(tmp_path / "s", Table().tumble(6).samples()))
    assert serious(findings) == {("turns", "warning")}
    assert "6 turns from still to still, 12 angles for 12 parameters; expected 13" in of(findings, "turns").says


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
    folder = write_session(tmp_path / "s", Table().tumble(3).samples())
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


# A ceiling, and axes that die


@pytest.mark.parametrize("level_dps", [26.0, 50.0])
def test_a_ceiling_far_below_the_turns_is_said_and_neither_scale_nor_stills_are_blamed(good, level_dps):
    gyro = good.logs[0].samples.gyro
    findings = look(good, gyro=np.clip(gyro, -level_dps * DEG, level_dps * DEG))
    (error,) = [finding for finding in findings if finding.level == "error"]
    assert error.what == "gyro ceiling"
    assert f"±{level_dps:g} dps" in error.says
    assert error.says.startswith("x, y")
    assert {"gyro scale", "axes", "gyro against gravity"}.isdisjoint(finding.what for finding in findings)


def test_a_ceiling_without_stills_is_the_ceilings_fault(good):
    samples = good.logs[0].samples
    clipped = np.clip(samples.gyro, -26 * DEG, 26 * DEG)
    log = replace(good.logs[0], samples=replace(samples, gyro=clipped))
    findings = first_look(replace(good, logs=(log,)), log, [], None)
    assert [finding.what for finding in findings if finding.level == "error"] == ["gyro ceiling"]


def test_a_ceiling_that_few_turns_reach_leaves_the_others_to_be_looked_at(good):
    gyro = good.logs[0].samples.gyro
    level = 0.9 * np.abs(gyro).max()
    findings = look(good, gyro=np.clip(gyro, -level, level))
    assert of(findings, "gyro scale").level == "ok"
    assert "error" not in {finding.level for finding in findings}


@pytest.mark.parametrize(("axis", "column"), [(0, "gx"), (2, "gz")])
def test_an_axis_that_dies_is_named_with_its_row_and_time(good, axis, column):
    samples = good.logs[0].samples
    gyro = samples.gyro.copy()
    row = 2 * len(gyro) // 3
    gyro[row:, axis] = 0.0
    dead = of(look(good, gyro=gyro), "gyro dead")
    assert dead.level == "error"
    assert f"{column} reads 0 dps from row {row} to row {len(gyro) - 1}" in dead.says
    assert f"{samples.t_s[row]:.1f} to {samples.t_s[-1]:.1f} s" in dead.says


def test_an_accelerometers_axis_that_dies_for_two_seconds_is_named(good):
    samples = good.logs[0].samples
    accel = samples.accel.copy()
    row, count = len(accel) // 2, round(2 / samples.period_s)
    accel[row : row + count, 1] = accel[row - 1, 1] + 1e-3 * G
    dead = of(look(good, accel=accel), "accelerometer dead")
    assert f"ay reads {accel[row, 1] / G:.4g} g from row {row} to row {row + count - 1}" in dead.says


def test_a_log_that_is_coarser_than_its_noise_is_not_dead(good):
    """Rates in whole degrees per second: every still is one value, on all axes."""
    gyro = np.round(good.logs[0].samples.gyro / DEG) * DEG
    assert "gyro dead" not in {finding.what for finding in look(good, gyro=gyro)}


def test_half_a_second_of_one_value_is_no_death(good):
    samples = good.logs[0].samples
    gyro = samples.gyro.copy()
    row = len(gyro) // 2
    gyro[row : row + round(0.5 / samples.period_s), 0] = gyro[row, 0]
    assert "gyro dead" not in {finding.what for finding in look(good, gyro=gyro)}
