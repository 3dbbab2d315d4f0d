"""The machine's word: device time of its answers, its file, and where gyroscope and gravity contradict it."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from table_recordings import table_toml

from session.annexes.machines.angles import header, read_angles
from session.annexes.machines.comparison import WordAgainstSensor
from session.annexes.machines.description import read_description
from session.annexes.machines.driver import AngleFile, DeviceTime, TableDriver
from session.annexes.machines.kinematics import attitudes, body_axes
from session.annexes.machines.mover import TableMover
from session.annexes.machines.verbs import Where
from session.bench.messages import Stage
from session.bench.mover import Moment
from session.detect.segments import Segment
from session.io.errors import StorageError
from session.io.samples import Samples
from session.io.units import DEG


@pytest.fixture
def table(tmp_path):
    (tmp_path / "table.toml").write_text(table_toml("middle", "inner"))
    return read_description(tmp_path / "table.toml")


def test_device_time_is_that_of_the_least_late_arrival():
    """Arrivals are late by 2 to 30 ms; the line through the earliest is right to 2 ms, at a ratio of the clocks of 1.002."""
    rng, time = np.random.default_rng(3), DeviceTime()
    assert time.at(5.0) is None
    for host_s in np.arange(100, 120, 0.1):
        time.add(host_s, 1.002 * (host_s - 100 - rng.uniform(0.002, 0.03)))
    assert time.at(120.5) == pytest.approx(1.002 * 20.5 - 0.002, abs=0.003)
    time.add(121.0, 0.5)  # the board was reset
    assert time.at(121.2) == pytest.approx(0.7)


@pytest.mark.parametrize(("place", "late_s"), [(0, 0.04), (-1, 0.04), (0, 0.2)])
def test_one_late_arrival_at_either_end_does_not_move_the_device_time(place, late_s):
    """A line through the first and the last arrival would be late by all of it, at one end or the other."""
    rng, time = np.random.default_rng(5), DeviceTime()
    sent_s = np.arange(0.0, 15.0, 0.01)
    sent_s = sent_s[(sent_s == 0) | (sent_s > 0.3)]
    late = rng.uniform(0.001, 0.005, len(sent_s))
    late[place] = late_s
    for each_s, each in zip(sent_s, late, strict=True):
        time.add(each_s + each, 1.0005 * each_s)
    assert time.at(15.1) == pytest.approx(1.0005 * (15.1 - 0.001), abs=2e-4)


def test_an_answer_has_the_time_between_question_and_answer():
    """The table is asked at 7.0 s and answers 0.03 s later."""
    now, rows = [7.0], []

    def where():
        now[0] += 0.03
        return Where(np.zeros(2), False)

    guarded = SimpleNamespace(where=where, is_at_rest=True, by_hand=False)
    file = SimpleNamespace(add=lambda log, t_us, said: rows.append((log, t_us)))
    driver = TableDriver(guarded, file, lambda: now[0], in_thread=False)
    driver.heard(Moment("log0001.csv", 7_000_000, 7_000_000_000))
    driver.tick()
    assert rows == [("log0001.csv", 7_015_000)]


def test_a_file_that_a_crash_has_cut_goes_on(tmp_path, table):
    path = tmp_path / "table.csv"
    file = AngleFile(path, table)
    file.add("log0001.csv", 1000, Where(np.array([0.1, 0.2]), False))
    file.add("", 1500, Where(np.array([0.1, 0.2]), False))  # no log is written
    file.add("log0001.csv", 900, Where(np.array([0.1, 0.2]), False))  # before the last one
    file.close()
    with path.open("a") as cut:
        cut.write("log0001.csv,20")
    file = AngleFile(path, table)
    file.add("unclosed0001.csv", 10, Where(np.array([0.3, 0.2]), True))
    file.rename("unclosed0001.csv", "closure0001.csv")
    file.add("closure0001.csv", 20, Where(np.array([0.4, 0.2]), True))
    file.close()
    found = read_angles(path, table)
    assert {log: each.t_ns.tolist() for log, each in found.items()} == {"log0001.csv": [1_000_000], "closure0001.csv": [10_000, 20_000]}
    path.write_text(header(table).replace("inner", "outer") + "\n")
    with pytest.raises(StorageError, match="is of a table with other axes"):
        AngleFile(path, table)


def stills(table, angles_deg, true_deg=None):
    """What the sensor sees of stills at these angles: up, and the turn from the still before about the body's axes."""
    said, true = np.array(angles_deg, float) * DEG, np.array(angles_deg if true_deg is None else true_deg, float) * DEG
    up = -attitudes(table, true)[:, 2] * 9.8
    turned = [None] + [body_axes(table, after[None])[0].T @ (after - before) for before, after in itertools.pairwise(true)]
    return list(zip(said, up, turned, strict=True))


@pytest.mark.parametrize(
    ("true_deg", "says"),
    [
        ([(0, 0), (90, 0), (90, 90), (0, 90), (0, 0)], []),
        ([(0, 0), (0, 0)], ["middle: the machine says 90 deg, the gyroscope saw 0.0: it is stalled", "gravity lies 90.0 deg"]),
        ([(0, 0), (-90, 0)], ["middle: the gyroscope turned the other way round", "gravity lies 180.0 deg"]),
        ([(0, 0), (0, 90)], ["middle: the gyroscope turned about another axis", "gravity lies 90.0 deg"]),
        ([(0, 0), (75, 0)], ["middle: the machine says 90.0 deg, the gyroscope saw 75.0: lost steps?", "gravity lies 15.0 deg"]),
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


def test_a_mounting_that_is_some_degrees_off_contradicts_nothing_later(table):
    """Nobody sets a sensor on a table to a degree: the first stills show how it lies."""
    from scipy.spatial.transform import Rotation

    word = WordAgainstSensor(table)
    off = Rotation.from_rotvec([4 * DEG, -3 * DEG, 2 * DEG])
    said = [(0, 0), (90, 0), (90, 90), (0, 90), (0, 0), (45, 180)]
    assert [line for angles, force, _ in stills(table, said) for line in word.still(angles, off.apply(force), None)] == []


def test_a_table_that_says_it_rested_while_it_was_turned(table):
    word = WordAgainstSensor(table)
    word.still(np.zeros(2), np.array([0, 0, -9.8]), None)
    (line,) = word.still(np.zeros(2), np.array([0, 0, -9.8]), np.array([0, 0, 1.5]))
    assert line == "the gyroscope turned by 86 deg, and the machine says that it rested"


@pytest.mark.parametrize(("begins_s", "says"), [(1.0, []), (9.0, ["middle: the machine says 90.0 deg, the gyroscope saw 60.0"])])
def test_a_turn_that_holds_the_one_before_is_not_compared(table, begins_s, says):
    """A still that counted may be none when it is seen again: then the segment holds two turns, and the machine's word is of one."""
    angles = np.array([(0, 0), (0, 90), (90, 90)]) * DEG
    t_s = np.arange(begins_s, 18.0, 0.01)
    rates = np.column_stack([(abs(t_s - 13.5) < 1.5) * 20 * DEG, (abs(t_s - 5.5) < 1.5) * 30 * DEG])  # the last turn is short
    gyro = rates @ body_axes(table, angles[1:2])[0]
    samples = Samples(np.round(t_s * 1e9).astype(np.int64), gyro, np.zeros((len(t_s), 3)), np.full(len(t_s), np.nan))
    stills = [SimpleNamespace(accel_mean=-9.8 * row, duration_s=1.5, gyro_mean=np.zeros(3)) for row in attitudes(table, angles)[:, 2]]
    first = SimpleNamespace(stop=100, gyro_mean=np.zeros(3))
    segment = Segment(0, 0, first, stills[2], 0, len(t_s), begins_s, t_s[-1] - begins_s, 3.0, 60.0)
    taken = SimpleNamespace(stills=[], turns=[], own=None, coverage=SimpleNamespace(corrected=lambda force: force))
    guide = SimpleNamespace(taken=taken, stage=Stage.TURN, turning=True, now_s=0.0)
    driver = SimpleNamespace(
        table=SimpleNamespace(description=table), trouble=None, fault="", busy=False, where=Where(angles[0], False), now_s=lambda: 0.0
    )
    driver.heard, driver.tick_if_alone = lambda moment: None, lambda: None
    mover, said = TableMover(driver, SimpleNamespace(angles=None)), []
    for number, now_s in enumerate((0.5, 2.0, 10.0, 17.0)):
        driver.where = Where(angles[max(number - 1, 0)], False)
        taken.stills, taken.turns = stills[:number], [SimpleNamespace(segment=segment, samples=samples)] if number == 3 else []
        said += [each.text for each in mover.step(guide, Moment("log0001.csv", round(now_s * 1e6), 0), False)]
    assert len(said) == len(says)
    assert all(text.startswith(begins) for text, begins in zip(said, says, strict=True))
