"""Sessions of plain arrays: refused in the words of the arguments, converted on the way in, saved and read to the same numbers."""

import contextlib

import numpy as np
import pytest
from conftest import DEG

import tinygc
from session.base import features
from session.base.units import G
from tinygc import CalibrationError, Protocol, Session, Site

ARRAYS = (np.arange(5) / 100, np.zeros((5, 3)), np.tile([0, 0, -G], (5, 1)))


@pytest.fixture(scope="module")
def simulated():
    return tinygc.simulate(segments=8, closure_s=12.0, odr_hz=62.5, seed=4, stop_sigma_deg=0.05).session


def arrays_of(log):
    samples = log.samples
    return samples.t_ns * 1e-9, samples.gyro, samples.accel, samples.temp_c


def same(one, other):
    """Every number of two sessions, to the last bit."""
    for mine, theirs in zip((*one.logs, *one.closures), (*other.logs, *other.closures), strict=True):
        for name in ("t_ns", "gyro", "accel", "temp_c"):
            here, there = getattr(mine.samples, name), getattr(theirs.samples, name)
            assert (here is None) == (there is None)
            np.testing.assert_array_equal(here, there)
    assert (one.config.sensor, one.config.site, one.config.protocol) == (other.config.sensor, other.config.site, other.config.protocol)
    np.testing.assert_array_equal(one.config.accelerometer.matrix, other.config.accelerometer.matrix)
    for mine, theirs in zip(one.turns, other.turns, strict=True):
        assert (mine.turn, mine.words, mine.angle_rad, mine.sigma_rad) == (theirs.turn, theirs.words, theirs.angle_rad, theirs.sigma_rad)
        np.testing.assert_array_equal(mine.axis, theirs.axis)


def test_a_session_is_saved_and_read_to_the_same_numbers_and_over_nothing(simulated, tmp_path):
    assert simulated.turns
    registers = tinygc.simulate(segments=3, closure_s=0.0, odr_hz=62.5, seed=2).save(tmp_path / "registers")
    # stamps that were counted, and force that is calibrated already, are so in the copy, too
    packed = tinygc.read_session(registers).save(tmp_path / "counted")
    log = packed / "log0001.csv"
    log.write_text("# stamps=counted calibrated=gyro,accel\n" + log.read_text())
    for number, session in enumerate((simulated, tinygc.read_session(registers), tinygc.read_session(packed))):
        again = tinygc.read_session(session.save(tmp_path / "new" / f"copy{number}"))
        same(session, again)
        same(session, tinygc.read_session(again.save(tmp_path / f"once more{number}")))
        assert (again.logs[0].counted, again.nominal_rate) == (session.logs[0].counted, session.nominal_rate)
    assert session.logs[0].counted
    before = sorted(tmp_path.rglob("*"))
    for place in (tmp_path, log):
        with pytest.raises(CalibrationError, match="holds something already; give a new or an empty folder"):
            simulated.save(place)
    with pytest.raises(CalibrationError, match=r"^arrays: site\.latitude_deg is 1000.0, expected a number within 90"):
        Session.from_arrays(*ARRAYS, site=Site(latitude_deg=1000.0)).save(tmp_path / "no")
    assert sorted(tmp_path.rglob("*")) == before


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


def test_units_are_converted_on_the_way_in_and_full_scales_hold_what_was_measured(simulated):
    t_s, gyro, accel, temp = arrays_of(simulated.logs[0])
    samples = Session.from_arrays(t_s, gyro / DEG, accel / G, temp, rate_unit="dps", force_unit="g", gyro_fs_dps=500).logs[0].samples
    np.testing.assert_allclose(samples.gyro, gyro, rtol=1e-15)
    np.testing.assert_allclose(samples.accel, accel, rtol=1e-15)
    rate = np.zeros((200, 3))
    rate[50] = [300 * DEG, 0, 0]
    sensor = Session.from_arrays(np.arange(200) / 100, rate, np.tile([0, 0, -9.8], (200, 1))).config.sensor
    assert (sensor.gyro_fs_dps, sensor.accel_fs_g, sensor.odr_hz) == (500, 2, pytest.approx(100))


def test_findings_on_arrays_and_remarks_of_their_fit_name_arguments_and_no_columns(simulated):
    """Slow rates in another unit, too: the turns move gravity by an angle 57 times as small, or as large."""
    t_s, gyro, accel, temp = arrays_of(simulated.logs[0])
    wrong = {"g": {"accel_mps2": accel / G}, "axes": {"gyro_rps": gyro[:, [1, 0, 2]]}, "ms": {"t_s": 1000 * t_s}}
    wrong |= {"turns": {"turns": [(99, "x", 90, 0.1)]}, "kelvin": {"temp_c": temp + 273.15}}
    wrong |= {unit: {"gyro_rps": gyro * factor, "gyro_fs_dps": 9e4} for unit, factor in (("dps", 1 / DEG), ("rad/s", DEG))}
    for name, changes in wrong.items():
        given = {"t_s": t_s, "gyro_rps": gyro, "accel_mps2": accel, "temp_c": temp, "accelerometer": simulated.config.accelerometer}
        session = Session.from_arrays(**given | changes)
        findings = [each for each in tinygc.check(session) if each.level in ("warning", "error")]
        lines = " ".join(each.line for each in findings)
        assert lines, name
        assert not any(word in lines for word in ("session.toml", "turns.csv", "header", "columns gx", "converted the log")), name
        if "gyro_fs_dps" in changes:
            assert f'give rate_unit="{name}"' in " ".join(each.do for each in findings if each.level == "error")
            with pytest.raises(CalibrationError, match=f'give rate_unit="{name}"'):
                tinygc.fit(session, methods=("least_squares",))


def test_a_fit_of_arrays_names_arguments_and_is_saved_with_readings_alone(tmp_path):
    """What the fit has put into a gap is no reading, and a calibration by these very stills is no prior of them."""
    t_s, gyro, accel, temp = arrays_of(tinygc.simulate(segments=10, closure_s=0.0, odr_hz=62.5, seed=6).session.logs[0])
    kept = np.ones(len(t_s), dtype=bool)
    kept[600:602] = False
    arrays = (t_s[kept], gyro[kept], accel[kept], temp[kept])
    made = tinygc.fit(Session.from_arrays(*arrays, gyro_fs_dps=500, accel_fs_g=4, turns=[(0, "x", 1, 0.1)]), methods="least_squares")
    for words in ("First look: arguments: accelerometer: none is given", "no latitude_deg in site=", "turns=: none of 1 turns of known"):
        assert words in made.summary()
    assert "session.toml" not in made.summary()
    assert [(bridge.row, bridge.count) for bridge in made.session.logs[0].bridges] == [(600, 2)]
    again = tinygc.read_session(made.session.save(tmp_path / "s"))
    np.testing.assert_array_equal(again.logs[0].samples.gyro, gyro[kept])
    assert again.config.accelerometer.own_stills


# What is refused

LOG = {"logs": [ARRAYS]}


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"logs": [ARRAYS, ARRAYS[:2]]}, r"^each of logs is \(t_s, gyro_rps, accel_mps2\) or .*; logs\[1\] is not"),
        ({"logs": [ARRAYS, (ARRAYS[0][::-1], *ARRAYS[1:])]}, r"^logs\[1\]: t_s\[1\] = 0.03 s does not go on"),
        ({"logs": [(*ARRAYS[:2], [[0, 0, "g"]] * 5)]}, "accel_mps2 is not made of numbers"),
        ({"logs": [(ARRAYS[0], ARRAYS[1] * np.nan, ARRAYS[2])]}, r"gyro_rps\[0, 0\] is nan"),
        ({"logs": [(*ARRAYS, [20.0, 21.0])]}, r"temp_c has shape \(2,\), expected \(5,\)"),
        (
            {**LOG, "closures": [(ARRAYS[0], np.zeros((4, 3)), ARRAYS[2])]},
            r"^closures\[0\]: gyro_rps has shape \(4, 3\), expected \(5, 3\)",
        ),
        ({**LOG, "turns": [(0, "x", 90, 0.1), (0, "y", 90, 0.1)]}, r"^turns\[1\]: turn 0 is given twice"),
        *(
            ({**LOG, "protocol": Protocol(reference=word)}, f'^protocol.reference is "{word}"; arrays have "gravity"')
            for word in ("table", "turns", "nothing")
        ),
        ({**LOG, "gyro_fs_dps": -5}, "gyro_fs_dps is -5, expected the full scale"),
    ],
)
def test_arrays_that_are_no_session_are_refused_by_the_name_of_the_argument(given, complaint):
    with pytest.raises(CalibrationError, match=complaint) as caught:
        Session.from_arrays(**given)
    assert "\n" not in str(caught.value)


JUNK = [3, -1.5, float("nan"), "x", "", "a\0b", b"x", [1, 2], {"a": 1}, object(), np.zeros(3), [["a"]], True, [None], 10**400]


@pytest.mark.parametrize("junk", JUNK)
def test_whatever_an_argument_is_the_answer_is_a_session_or_one_line(junk):
    given = dict(zip(("t_s", "gyro_rps", "accel_mps2"), ARRAYS, strict=True))
    further = [kind.word for kind in features.each("reference") if kind.accelerometer]
    for name in ("t_s", "gyro_rps", "accel_mps2", "temp_c", "logs", "closures", "turns", "rate_unit", "name", *further):
        with contextlib.suppress(CalibrationError):
            Session.from_arrays(**given | {name: junk})
    with pytest.raises(CalibrationError):
        Session.from_arrays(**given | {"protocol": junk})
    with pytest.raises(CalibrationError):
        Session.from_arrays(logs=[ARRAYS], turns=[(0, "x", 90, 0.1, junk)])
