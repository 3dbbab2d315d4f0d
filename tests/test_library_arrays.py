"""Sessions of plain arrays: logs, units, truth, turns; refused in the words of the arguments; saved, and read to the same numbers."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG

import tinygc
from session.io.config import TruthGiven
from session.io.units import G
from tinygc import CalibrationError, Protocol, Session, Site

ARRAYS = (np.arange(5) / 100, np.zeros((5, 3)), np.tile([0, 0, -G], (5, 1)))


@pytest.fixture(scope="module")
def simulated():
    return tinygc.simulate(segments=12, closure_s=20.0, odr_hz=104.0, seed=4, stop_sigma_deg=0.05).session


def arrays_of(log):
    samples = log.samples
    return samples.t_ns * 1e-9, samples.gyro, samples.accel, samples.temp_c


def same(one: Session, other: Session) -> None:
    """Every number of two sessions, to the last bit."""
    for mine, theirs in zip((*one.logs, *one.closures), (*other.logs, *other.closures), strict=True):
        for name in ("t_ns", "gyro", "accel", "temp_c"):
            here, there = getattr(mine.samples, name), getattr(theirs.samples, name)
            assert (here is None) == (there is None)
            if here is not None:
                np.testing.assert_array_equal(here, there)
    assert (one.config.sensor, one.config.site, one.config.protocol) == (other.config.sensor, other.config.site, other.config.protocol)
    np.testing.assert_array_equal(one.config.accelerometer.matrix, other.config.accelerometer.matrix)
    assert [(t.turn, t.words, t.angle_rad, t.sigma_rad) for t in one.turns] == [
        (t.turn, t.words, t.angle_rad, t.sigma_rad) for t in other.turns
    ]
    for mine, theirs in zip(one.turns, other.turns, strict=True):
        np.testing.assert_array_equal(mine.axis, theirs.axis)


def test_a_saved_session_is_read_to_the_same_numbers(simulated, tmp_path):
    assert simulated.turns
    again = tinygc.read_session(simulated.save(tmp_path / "new" / "session"))
    same(simulated, again)
    same(simulated, tinygc.read_session(again.save(tmp_path / "once more")))


def test_several_logs_with_numbers_of_any_digits_their_turns_and_closures_come_back(tmp_path):
    rng = np.random.default_rng(5)
    t_s = np.cumsum(rng.uniform(0.009, 0.011, 500)) - 2.0  # a clock may begin below 0
    logs = [(t_s + 10 * k, rng.normal(size=(500, 3)), rng.normal(size=(500, 3)) * 9) for k in range(2)]
    logs[1] = (*logs[1], rng.normal(size=500) + 25)
    turns = [(0, "-y", -123.456789012345, 0.1 / 3), (3, (0.1, 0.2, -1 / 3), 720, 0.05, 1)]
    more = {"name": "bench", "serial": 'say "no"', "site": Site(latitude_deg=48.1, gravity_mps2=9.807)}
    session = Session.from_arrays(logs=logs, closures=[logs[1]], turns=turns, **more)
    assert [log.path.name for log in session.logs] == ["bench.log1", "bench.log2"]
    assert [turn.log for turn in session.turns] == [None, "bench.log2"]
    again = tinygc.read_session(session.save(tmp_path / "s"))
    same(session, again)
    assert [turn.log for turn in again.turns] == [None, "log0002.csv"]


def test_a_truth_comes_back(tmp_path):
    t_s = np.arange(400) / 100
    half = np.linspace(0, 1, 40) / 2
    q = np.stack([np.cos(half), 0 * half, np.sin(half), 0 * half], axis=1) * 1.001  # nearly of length 1
    truth = (np.arange(40) / 10, q, np.repeat([0, 1], 20))
    session = Session.from_arrays(t_s, np.zeros((400, 3)), np.tile([0, 0, -G], (400, 1)), truth=[truth])
    assert session.config.protocol.reference == "truth"
    (mine,), (theirs,) = session.truths, tinygc.read_session(session.save(tmp_path / "s")).truths
    np.testing.assert_array_equal(mine.t_ns, theirs.t_ns)
    np.testing.assert_array_equal(mine.window, theirs.window)
    np.testing.assert_allclose(mine.q_nb, theirs.q_nb, rtol=0, atol=np.finfo(float).eps)  # the reader makes each of length 1
    np.testing.assert_allclose(np.linalg.norm(mine.q_nb, axis=1), 1, rtol=1e-15)


@pytest.mark.parametrize(
    "given",
    [
        TruthGiven(offset_s=0.25, sense="world_to_body"),
        TruthGiven(order="xyzw", frame="enu", mounting=np.eye(3)[[1, 2, 0]]),
    ],
)
def test_a_truth_that_is_read_in_another_way_is_written_in_that_way(given, tmp_path):
    """Its file holds what the reading makes these very attitudes of."""
    q = np.random.default_rng(3).normal(size=(20, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    made = Session.from_arrays(*ARRAYS, truth=[(np.arange(20) / 10, q)])
    session = replace(made, config=replace(made.config, truth=given))
    (mine,), (theirs,) = session.truths, tinygc.read_session(session.save(tmp_path / "s")).truths
    np.testing.assert_array_equal(mine.t_ns, theirs.t_ns)
    np.testing.assert_allclose(mine.q_nb, theirs.q_nb, rtol=0, atol=4 * np.finfo(float).eps)
    plain = tinygc.read_session(made.save(tmp_path / "plain")).truths[0]
    np.testing.assert_allclose(plain.q_nb, mine.q_nb, rtol=0, atol=np.finfo(float).eps)
    first = (tmp_path / "s" / "truth0001.csv").read_text().splitlines()[1]
    assert first != (tmp_path / "plain" / "truth0001.csv").read_text().splitlines()[1]


def test_the_readings_of_a_recording_come_back_from_its_copy(folder_of_registers, tmp_path):
    read = tinygc.read_session(folder_of_registers)
    same(read, tinygc.read_session(read.save(tmp_path / "copy")))


@pytest.fixture(scope="module")
def folder_of_registers(tmp_path_factory):
    return tinygc.simulate(segments=8, closure_s=0.0, odr_hz=104.0, seed=2).save(tmp_path_factory.mktemp("registers") / "s")


def test_nothing_is_saved_over_what_is_there(simulated, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(CalibrationError, match="holds something already; give a new or an empty folder"):
        simulated.save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    with pytest.raises(CalibrationError, match="holds something"):
        simulated.save(tmp_path / "mine.txt")


def test_units_are_converted_on_the_way_in(simulated):
    t_s, gyro, accel, temp = arrays_of(simulated.logs[0])
    told = Session.from_arrays(t_s, gyro / DEG, accel / G, temp, rate_unit="dps", force_unit="g", gyro_fs_dps=500)
    samples = told.logs[0].samples
    np.testing.assert_allclose(samples.gyro, gyro, rtol=1e-15)
    np.testing.assert_allclose(samples.accel, accel, rtol=1e-15)
    with pytest.raises(CalibrationError, match="rate_unit is 'degrees', expected one of mdps, dps, "):
        Session.from_arrays(t_s, gyro, accel, rate_unit="degrees")
    with pytest.raises(CalibrationError, match="force_unit is 'lsb', expected one of mg, g, "):
        Session.from_arrays(t_s, gyro, accel, force_unit="lsb")


@pytest.mark.parametrize(("full_scale", "factor"), [(None, 1.0), (500.0, 1.2)])
def test_rates_that_no_such_gyroscope_reads_are_refused_just_beyond_the_bar(full_scale, factor):
    bar = factor * (full_scale or 4000.0) * DEG
    rate = np.zeros((10, 3))
    for value, refused in ((0.999 * bar, False), (-1.001 * bar, True)):
        rate[4, 1] = value
        arrays = (np.arange(10) / 100, rate, np.tile([0, 0, -G], (10, 1)))
        if not refused:
            assert Session.from_arrays(*arrays, gyro_fs_dps=full_scale).logs[0].samples.gyro[4, 1] == value
            continue
        with pytest.raises(CalibrationError, match=r'^gyro_rps\[4, 1\] is -.* rad/s, .*are the rates in degrees\? give rate_unit="dps"'):
            Session.from_arrays(*arrays, gyro_fs_dps=full_scale)


@pytest.mark.parametrize(("factor", "unit"), [(1 / DEG, "dps"), (DEG, "rad/s")])
def test_slow_rates_in_another_unit_are_told_by_gravity(simulated, factor, unit):
    """No rate is beyond the full scale, but the turns move gravity by an angle 57 times as small, or as large."""
    t_s, gyro, accel, temp = arrays_of(simulated.logs[0])
    more = {"accelerometer": simulated.config.accelerometer, "gyro_fs_dps": 90_000.0}
    session = Session.from_arrays(t_s, gyro * factor, accel, temp, **more)
    with pytest.raises(CalibrationError, match=f'gravity requires rates x .*; give rate_unit="{unit}"|: give rate_unit="{unit}"'):
        tinygc.fit(session, methods=("least_squares",))
    (finding,) = [finding for finding in tinygc.check(session) if finding.level == "error"]
    assert f'give rate_unit="{unit}"' in finding.do


def test_findings_on_arrays_name_arguments_and_no_columns(simulated):
    t_s, gyro, accel, temp = arrays_of(simulated.logs[0])
    wrong = {"g": {"accel_mps2": accel / G}, "twice": {"accel_mps2": 2 * accel}, "axes": {"gyro_rps": gyro[:, [1, 0, 2]]}}
    wrong |= {"ms": {"t_s": 1000 * t_s}, "turns": {"turns": [(99, "x", 90, 0.1)]}, "kelvin": {"temp_c": temp + 273.15}}
    for name, changes in wrong.items():
        given = {"t_s": t_s, "gyro_rps": gyro, "accel_mps2": accel, "temp_c": temp, "accelerometer": simulated.config.accelerometer}
        findings = [each for each in tinygc.check(Session.from_arrays(**given | changes)) if each.level in ("warning", "error")]
        assert findings, name
        for finding in findings:
            assert not any(word in finding.line for word in ("session.toml", "turns.csv", "header", "columns gx", "converted the log")), (
                name
            )


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({}, "^give one log as t_s, gyro_rps and accel_mps2, or several as logs="),
        ({"t_s": ARRAYS[0], "logs": [ARRAYS]}, "^give one log as t_s"),
        ({"t_s": ARRAYS[0]}, "^give one log as t_s"),
        ({"logs": [ARRAYS, ARRAYS[:2]]}, r"^each of logs is \(t_s, gyro_rps, accel_mps2\) or .*; logs\[1\] is not"),
        ({"logs": [ARRAYS, (ARRAYS[0][::-1], *ARRAYS[1:])]}, r"^logs\[1\]: t_s\[1\] = 0.03 s does not go on"),
        ({"logs": [ARRAYS], "closures": [(ARRAYS[0], np.zeros((4, 3)), ARRAYS[2])]}, r"^closures\[0\]: gyro_rps has shape \(4, 3\)"),
        ({"logs": [ARRAYS], "truth": [1, 2]}, r"^truth has 2 entries, expected 1, one \(t_s, q_nb\)"),
        ({"logs": [ARRAYS], "truth": [(ARRAYS[0], np.ones((5, 4)))]}, r"^truth\[0\]: q_nb\[0\] has length 2, expected a quaternion"),
        ({"logs": [ARRAYS], "truth": [(ARRAYS[0], np.eye(4)[[0] * 5], np.arange(5) / 2)]}, r"^truth\[0\]: window\[1\] is no whole number"),
        ({"logs": [ARRAYS], "turns": [(0, "x", 90)]}, r"^turns\[0\] is \(0, 'x', 90\), expected \(number, axis"),
        ({"logs": [ARRAYS], "turns": [(0, "x", 90, 0.1), (0, "y", 90, 0.1)]}, r"^turns\[1\]: turn 0 is given twice"),
        ({"logs": [ARRAYS], "turns": [(0, "q", 90, 0.1)]}, r"^turns\[0\]: axis is 'q', expected x, y or z"),
        ({"logs": [ARRAYS], "turns": [(0, "x", 90, 0.1, 3)]}, r"^turns\[0\]: log is 3, expected the number of a log, 0 to 0"),
        ({"logs": [ARRAYS], "turns": [(0, "x", 0, 0.1)]}, r"^turns\[0\]: angle_deg is '0', expected degrees"),
        ({"logs": [ARRAYS], "protocol": Protocol(reference="table")}, 'protocol.reference is "table"; arrays have "gravity"'),
    ],
)
def test_arrays_that_are_no_session_are_refused_by_the_name_of_the_argument(given, complaint):
    with pytest.raises(CalibrationError, match=complaint) as caught:
        Session.from_arrays(**given)
    assert "\n" not in str(caught.value)


def test_samples_become_a_table_of_pandas(simulated):
    pandas = pytest.importorskip("pandas")
    table = simulated.logs[0].samples.to_frame()
    assert isinstance(table, pandas.DataFrame)
    assert list(table)[:4] == ["t_ns", "gx_rps", "gy_rps", "gz_rps"]
    np.testing.assert_array_equal(table["ay_mps2"], simulated.logs[0].samples.accel[:, 1])


def test_a_fitted_session_is_saved_with_readings_alone(tmp_path):
    """What the fit has put into a gap is no reading, and a calibration by these very stills is no prior of them."""
    session = tinygc.simulate(segments=16, closure_s=0.0, odr_hz=104.0, seed=6).session
    t_s, gyro, accel, temp = arrays_of(session.logs[0])
    kept = np.ones(len(t_s), dtype=bool)
    kept[1000:1002] = False
    of_arrays = Session.from_arrays(t_s[kept], gyro[kept], accel[kept], temp[kept], gyro_fs_dps=500, accel_fs_g=4)
    fitted = tinygc.fit(of_arrays, methods="least_squares").session
    assert [(bridge.row, bridge.count) for bridge in fitted.logs[0].bridges] == [(1000, 2)]
    again = tinygc.read_session(fitted.save(tmp_path / "s"))
    np.testing.assert_array_equal(again.logs[0].samples.gyro, gyro[kept])
    assert again.config.accelerometer.own_stills


def test_a_fit_of_arrays_names_arguments(simulated):
    """Its remarks, too: on the accelerometer that nobody gave, a latitude that is missing, turns that are not used."""
    arrays = arrays_of(simulated.logs[0])
    session = Session.from_arrays(*arrays, gyro_fs_dps=500, accel_fs_g=4, turns=[(0, "x", 1, 0.1)])
    summary = tinygc.fit(session, methods="least_squares").summary()
    assert "First look: arguments: accelerometer: none is given" in summary
    assert "no latitude_deg in site=" in summary
    assert "turns=: none of 1 turns of known angle is used" in summary
    assert "session.toml" not in summary
    assert "turns.csv" not in summary
    with pytest.raises(CalibrationError, match=r"^arrays: it has no accelerometer= to take as given"):
        tinygc.fit(session, accelerometer="given")


JUNK = [3, -1.5, float("nan"), "x", "", "a\0b", b"x", [1, 2], {"a": 1}, object(), np.zeros(3), [["a"]], True, [None], 10**400]


@pytest.mark.parametrize("name", ["t_s", "gyro_rps", "accel_mps2", "temp_c", "logs", "closures", "truth", "turns", "rate_unit", "name"])
def test_whatever_an_argument_is_the_answer_is_a_session_or_one_line(name):
    given = dict(zip(("t_s", "gyro_rps", "accel_mps2"), ARRAYS, strict=True))
    for junk in JUNK:
        with contextlib.suppress(CalibrationError):
            Session.from_arrays(**given | {name: junk})
    for junk in JUNK:
        with pytest.raises(CalibrationError):
            Session.from_arrays(**given | {"protocol": junk})
        with pytest.raises(CalibrationError):
            Session.from_arrays(logs=[ARRAYS], turns=[(0, "x", 90, 0.1, junk)])


def test_a_setting_that_no_file_may_hold_is_not_saved(tmp_path):
    session = Session.from_arrays(*ARRAYS, site=Site(latitude_deg=1000.0))
    with pytest.raises(CalibrationError, match=r"^arrays: site\.latitude_deg is 1000.0, expected a number within 90"):
        session.save(tmp_path / "s")
    assert not (tmp_path / "s").exists()
    with pytest.raises(CalibrationError, match="folder is 3, expected the path of a new folder"):
        session.save(3)
