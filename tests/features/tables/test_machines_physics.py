"""A table's attitudes, its errors and the motion of its axes; its word against the sensor; what the movers of a recording send."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock, Mock

import numpy as np
import pytest
from imperfect_tables import AxisErrors, AxisTrack
from scipy.spatial.transform import Rotation
from table_recordings import table_toml

from session.base.errors import StorageError
from session.base.units import DEG, NS
from session.bench.guide import Moment
from session.bench.messages import Stage
from tinygc.features.tables.machines.angles import AngleFile, AngleLog, header, on_its_clock, read_angles
from tinygc.features.tables.machines.description import Axis, Description, attitudes, body_axes, read_description, roll_pitch_yaw
from tinygc.features.tables.machines.link import Where
from tinygc.features.tables.machines.mover import PAUSE, TableDriver, TableMover, WordAgainstSensor, _DeviceTime


def axis(name, direction, backlash_deg=0.0):
    return Axis(name, np.array(direction, dtype=float), 90 * DEG, 200 * DEG, 0.01 * DEG, backlash_rad=backlash_deg * DEG)


TABLE = Description("three", "virtual", (axis("outer", (0, 0, 1)), axis("middle", (0, 1, 0)), axis("inner", (1, 0, 0))))


def test_three_axes_are_yaw_pitch_and_roll():
    angles = np.array([[30.0, 20.0, 10.0], [-170.0, -50.0, 120.0]]) * DEG
    found = attitudes(TABLE, angles)
    assert np.allclose(found, Rotation.from_euler("ZYX", angles).as_matrix(), atol=1e-12)
    assert np.allclose(roll_pitch_yaw(found), angles[:, ::-1], atol=1e-12)


def test_the_rate_of_each_axis_is_the_derivative_of_the_attitude():
    angles = np.array([[0.4, -0.7, 1.1]])
    for k, about in enumerate(body_axes(TABLE, angles)[0]):
        later = angles + 1e-6 * np.eye(3)[k]
        step = Rotation.from_matrix(attitudes(TABLE, angles)[0]).inv() * Rotation.from_matrix(attitudes(TABLE, later)[0])
        assert step.as_rotvec() / 1e-6 == pytest.approx(about, abs=1e-5)


@pytest.mark.parametrize(
    ("errors", "reported", "sense", "expected"),
    [
        (AxisErrors(index=np.array([1e-3, 0, 0, 0])), 0.5, 0, 0.5 + 1e-3 * np.sin(0.5)),
        (AxisErrors(index=np.array([0, 0, 0, 1e-3])), 0.5, 0, 0.5 + 1e-3 * np.cos(1.0)),
        (AxisErrors(backlash=2e-3), 0.5, 1, 0.499),
        (AxisErrors(backlash=2e-3), 0.5, -1, 0.501),
        (AxisErrors(lost=4e-3), 0.5, 0, 0.504),
        (AxisErrors(ripple=1e-3, ripple_cycles=3, ripple_phase=0.2), 0.5, 0, 0.5 + 1e-3 * np.sin(1.7)),
    ],
)
def test_each_error_moves_the_true_angle(errors, reported, sense, expected):
    assert errors.true_angle(np.array([reported]), np.array([sense]))[0] == pytest.approx(expected, abs=1e-15)


def test_an_axis_goes_from_rest_to_rest_at_its_rate():
    track = AxisTrack(0.2)
    track.turn_to(1.0, 2.2, 1.0, 4.0)
    assert track.busy_until_s == pytest.approx(1.0 + 2.0 + 0.25)
    t = np.linspace(0, 4, 4001)
    reported, sense = track.said_and_sense(t)
    rate = np.gradient(reported, t)
    assert reported[0] == 0.2
    assert reported[-1] == pytest.approx(2.2, abs=1e-12)
    assert rate.max() == pytest.approx(1.0, abs=1e-9)
    assert np.abs(np.diff(rate)).max() <= 4.0 * 1e-3 + 1e-9
    assert sense[0] == 0
    assert sense[-1] == 1


def test_a_short_way_never_reaches_the_rate():
    track = AxisTrack()
    track.turn_to(0.0, -0.04, 1.0, 4.0)
    assert track.busy_until_s == pytest.approx(0.2)
    assert track.state(0.1) == pytest.approx((-0.02, -0.4))


def test_play_is_taken_up_before_the_stage_moves():
    track = AxisTrack(backlash=0.1)
    track.turn_to(0.0, 1.0, 1.0, 100.0)
    track.turn_to(10.0, 0.9, 0.1, 100.0)
    track.turn_to(20.0, 0.5, 1.0, 100.0)
    reported, sense = track.said_and_sense(np.array([10.0, 10.5, 15.0, 25.0]))
    assert sense.tolist() == pytest.approx([1.0, 0.0, -1.0, -1.0], abs=0.02)
    stage = reported - sense * 0.05
    assert stage == pytest.approx([0.95, 0.95, 0.95, 0.55], abs=1e-3)


def test_a_rate_is_reversed_through_rest():
    track = AxisTrack()
    track.turn_at(0.0, 1.0, 2.0)
    assert track.busy_until_s == np.inf
    track.turn_at(3.0, -1.0, 2.0)
    track.turn_at(6.0, 0.0, 2.0)
    assert track.state(2.0) == pytest.approx((1.75, 1.0))
    assert track.state(3.5) == pytest.approx((3.0, 0.0))
    assert track.state(4.0)[1] == pytest.approx(-1.0)
    assert track.busy_until_s == pytest.approx(6.5)


def test_a_description_is_read(tmp_path):
    (tmp_path / "table.toml").write_text(
        'schema = "tinygc-table/1"\nmake = "grbl"\nport = "/dev/ttyUSB0"\n[[axis]]\nname = "outer"\ndirection = [0, 0, 2]\n'
        'least_deg = -90\nmost_deg = 270\nfastest_dps = 60\nacceleration_dps2 = 100\nsigma_deg = 0.05\nbacklash_deg = 0.1\nword = "X"\n'
    )
    table = read_description(tmp_path / "table.toml")
    (outer,) = table.axes
    assert (table.name, table.make, outer.word) == ("table", "grbl", "X")
    assert outer.direction.tolist() == [0, 0, 1]
    assert outer.allows(-90 * DEG)
    assert not outer.allows(271 * DEG)
    assert outer.backlash_rad == pytest.approx(0.1 * DEG)


# The machine's word.


@pytest.fixture
def table(tmp_path):
    (tmp_path / "table.toml").write_text(table_toml("middle", "inner", limits={"middle": (-90, 270)}))
    return read_description(tmp_path / "table.toml")


def test_device_time_is_that_of_the_least_late_arrival():
    """Arrivals are late by 2 to 30 ms; the line through the earliest is right to 2 ms, at a ratio of the clocks of 1.002."""
    rng, time = np.random.default_rng(3), _DeviceTime()
    assert time.at(5.0) is None
    for host_s in np.arange(100, 120, 0.1):
        time.add(host_s, 1.002 * (host_s - 100 - rng.uniform(0.002, 0.03)))
    assert time.at(120.5) == pytest.approx(1.002 * 20.5 - 0.002, abs=0.003)
    time.add(121.0, 0.5)  # the board was reset
    assert time.at(121.2) == pytest.approx(0.7)


def test_an_answer_has_the_time_between_question_and_answer():
    """The table is asked at 7.0 s and answers 0.03 s later."""
    now, rows = [7.0], []

    def where():
        now[0] += 0.03
        return Where(np.zeros(2), False)

    guarded = SimpleNamespace(where=where, is_at_rest=True)
    file = SimpleNamespace(add=lambda log, t_us, reported: rows.append((log, t_us)))
    driver = TableDriver(guarded, file, lambda: now[0], in_thread=False)
    driver.heard(Moment("log0001.csv", 7_000_000, 7_000_000_000))
    driver.tick()
    assert rows == [("log0001.csv", 7_015_000)]


def test_what_a_table_says_is_read_back_and_a_file_that_a_crash_has_cut_goes_on(tmp_path, table):
    path = tmp_path / "table.csv"
    file = AngleFile(path, table)
    reported = Where(np.array([0.1, -0.2]), True, 0.5)
    file.add("log0001.csv", 1000, reported)
    file.add("", 1500, reported)  # no log is written
    file.add("log0001.csv", 900, reported)  # before the last one
    file.close()
    with path.open("a") as cut:
        cut.write("log0001.csv,20")
    file = AngleFile(path, table)
    file.add("unclosed0001.csv", 10, Where(np.array([3.0, 0.2]), False))
    file.rename("unclosed0001.csv", "closure0001.csv")
    file.add("closure0001.csv", 20, reported)
    file.close()
    found = read_angles(path, table)
    assert {log: each.t_ns.tolist() for log, each in found.items()} == {"log0001.csv": [1_000_000], "closure0001.csv": [10_000, 20_000]}
    closure = found["closure0001.csv"]
    assert closure.angles == pytest.approx(np.array([[3.0, 0.2], [0.1, -0.2]]), abs=2e-8)
    assert closure.table_s == pytest.approx([np.nan, 0.5], nan_ok=True)
    assert closure.moving.tolist() == [False, True]
    path.write_text(header(table).replace("inner", "outer") + "\n")
    with pytest.raises(StorageError, match="is of a table with other axes"):
        AngleFile(path, table)


def stills(table, angles_deg, true_deg=None):
    """What the sensor sees of stills at these angles: up, and the turn from the still before about the body's axes."""
    reported, true = np.array(angles_deg, float) * DEG, np.array(angles_deg if true_deg is None else true_deg, float) * DEG
    up = -attitudes(table, true)[:, 2] * 9.8
    turned = [None] + [body_axes(table, after[None])[0].T @ (after - before) for before, after in itertools.pairwise(true)]
    return list(zip(reported, up, turned, strict=True))


@pytest.mark.parametrize(
    ("true_deg", "says"),
    [
        ([(0, 0), (90, 0), (90, 90), (0, 90), (0, 0)], []),
        ([(0, 0), (-90, 0)], ["middle: the gyroscope turned the other way round", "gravity lies 180.0 deg"]),
        ([(0, 0), (0, 0)], ["middle: the machine reports 90 deg, the gyroscope saw 0.0: it is stalled", "gravity lies 90.0 deg"]),
        ([(0, 0), (90, 0), (90, 90), (0, 90), (3, 0)], ["gravity lies 3.0 deg from where the machine's angles put it (2.0 at most): lost"]),
    ],
)
def test_what_contradicts_the_machine_is_named(table, true_deg, says):
    said_deg = [(0, 0), (90, 0), (90, 90), (0, 90), (0, 0)][: len(true_deg)]
    word, found = WordAgainstSensor(table), []
    for each in stills(table, said_deg, true_deg):
        found += word.still(*each)
    assert len(found) == len(says)
    for line, begins in zip(found, says, strict=True):
        assert line.startswith(begins), line


def test_a_table_that_says_it_rested_while_it_was_turned(table):
    word = WordAgainstSensor(table)
    word.still(np.zeros(2), np.array([0, 0, -9.8]), None)
    (line,) = word.still(np.zeros(2), np.array([0, 0, -9.8]), np.array([0, 0, 1.5]))
    assert line == "the gyroscope turned by 86 deg, and the machine reports that it rested"


def test_a_machines_clock_takes_the_jitter_out_of_its_stamps():
    rng = np.random.default_rng(3)
    table_s = 100 + np.arange(200) * 0.02
    late = rng.uniform(0, 0.01, 200)
    word = AngleLog(
        "log", np.rint((np.arange(200) * 0.02 * 1.001 - late + 1) / NS).astype(np.int64), table_s, table_s > 0, np.zeros((200, 1))
    )
    mended = on_its_clock(word)
    left = mended.t_ns * NS - (np.arange(200) * 0.02 * 1.001 + 1)
    assert np.std(left) < 0.2 * np.std(late)
    assert np.mean(left) == pytest.approx(-np.mean(late), abs=1e-6)
    without = replace(word, table_s=np.full(200, np.nan))
    assert on_its_clock(without) is without


# Movers, without a table and without samples.


@pytest.mark.parametrize(("silent_s", "told"), [(1.9, []), (2.1, ["stop"])])
def test_a_table_that_moves_unseen_is_stopped(table, silent_s, told):
    driver, was_told = Mock(trouble=None, fault="", busy=True, table=SimpleNamespace(description=table)), []
    driver.now_s, driver.stop = lambda: 100.0, lambda: was_told.append("stop")
    guide = MagicMock(stage=Stage.TURN, turning=True, closure=None, coached=False)
    TableMover(driver, Mock(angles=None)).step(guide, Moment("log0001.csv", 0, round((100.0 - silent_s) * 1e9)), False)
    assert was_told == told


@pytest.mark.parametrize(("lies", "paused"), [((0, 1, 1, 1), True), ((0, 1, 1, 0, 1, 1), False)])
def test_three_stills_in_a_row_that_contradict_the_machine_pause_the_recording(table, lies, paused):
    driver = Mock(trouble=None, fault="", busy=False, where=Where(np.zeros(2), False), table=SimpleNamespace(description=table))
    driver.now_s = lambda: 0.0
    mover, stills, reported = TableMover(driver, Mock()), [], []
    guide = MagicMock(stage=Stage.TURN, turning=True, taken=MagicMock(stills=stills, turns=[], own=None))
    guide.taken.corrected = lambda force: force
    for lie in lies:  # of gravity, by a right angle
        reported += mover.step(guide, Moment("log0001.csv", 0, 0), False)
        stills.append(SimpleNamespace(accel_mean=np.array([9.8 * lie, 0, -9.8 * (1 - lie)]), duration_s=1.0))
    reported += mover.step(guide, Moment("log0001.csv", 0, 0), False)
    assert (mover.wants is PAUSE, driver.stop.called) == (paused, paused)
    assert any(each.text.startswith("3 stills in a row contradict the machine") for each in reported) == paused
