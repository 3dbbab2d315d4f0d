"""Segments and known turns, from stills that are given: each window, reason and threshold, on both sides."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import config
from numpy.testing import assert_allclose

from session.base.units import DEG, NS
from session.detect.segments import (
    FoundTurn,
    _find_known_turns,
    _span_space,
    angle_read,
    contradiction,
    cut_segments,
    moments_of,
    moved_at,
    run_ends,
    session_segments,
    why_broken,
    why_too_few,
    without_excluded,
)
from session.detect.stills import LogStills, Noise, Still
from session.log.config import LeftOut
from session.log.folder import Session
from session.log.logfile import KnownTurn, Log
from session.log.samples import Samples

G = 9.8


DOWN = np.array([0.0, 0, -G])


CONFIG = config(odr_hz=100.0)  # 500 dps, whose register ends at 573; stills of 1 s, segments of 5 s


def still(start, stop, down=DOWN, bias=(0.0, 0, 0), problem=None):
    none = np.zeros(3)
    return Still(start, stop, start / 100, (stop - start) / 100, np.array(bias), none, np.array(down), none, none, 25.0, 0, problem)


def samples_of(count, gyro=0.0):
    """100 samples a second, at rest but for a rate, from 7 s of the clock on."""
    return Samples(7_000_000_000 + np.arange(count) * 10_000_000, np.zeros((count, 3)) + gyro, np.tile(DOWN, (count, 1)))


def cut(samples, stills, **more):
    return cut_segments(samples, stills, CONFIG.sensor, CONFIG.protocol, **more)


def turning(turn_s, dps=30.0, rest_s=4.0):
    """A rest, a turn at one rate about x and a rest; the bias is 0.3 mrad/s before it and 0.5 after."""
    rest, turn = round(100 * rest_s), round(100 * turn_s)
    samples = samples_of(2 * rest + turn - 1)
    samples.gyro[:, 0] = 4e-4
    samples.gyro[rest : rest + turn - 1, 0] += dps * DEG
    stills = [still(0, rest, bias=[3e-4, 0, 0]), still(rest + turn - 1, 2 * rest + turn - 1, bias=[5e-4, 0, 0])]
    return samples, stills


@pytest.mark.parametrize(
    ("turn_s", "rest_s", "start", "stop"),
    [
        (3.0, 4.0, 399 - 100, 699 + 100),  # 5 s in all
        (3.0, 1.0, 50, 399 + 50),  # from middle to middle
        (4.79, 4.0, 399 - 10, 878 + 10),  # half of what is left, 0.105 s
        (4.9, 4.0, 399 - 10, 889 + 10),  # and no less than 0.1 s
        (7.0, 4.0, 399 - 10, 1099 + 10),
    ],
)
def test_a_segment_is_centred_on_its_turn(turn_s, rest_s, start, stop):
    samples, stills = turning(turn_s, rest_s=rest_s)
    (segment,) = cut(samples, stills, log=3, number=8)
    assert (segment.start, segment.stop, segment.log, segment.number) == (start, stop + 1, 3, 8)
    assert (segment.start_s, segment.duration_s, segment.turn_s) == pytest.approx((start / 100, (stop - start) / 100, turn_s), abs=1e-9)
    # Trapezia from the last sample of rest to the first: of turn_s - 10 ms at the full rate, and a last one of half.
    assert segment.turn_deg == pytest.approx(30 * (turn_s - 0.015), rel=1e-6)
    assert segment.stills == tuple(stills)


@pytest.mark.parametrize(
    ("dps", "turn_s", "note"),
    [
        (1.999 / 2.985, 3.0, "hardly a turn (2.0 deg): a bump?"),
        (2.001 / 2.985, 3.0, None),
        (30, 6.0, None),
        (30, 6.01, "a long or double turn (6.0 s, 180 deg)"),
    ],
)
def test_an_unusual_turn_is_noted(dps, turn_s, note):
    assert [segment.note for segment in cut(*turning(turn_s, dps))] == [note]


@pytest.mark.parametrize(
    ("seconds", "problem"), [(29.79, None), (29.81, "30 s from still to still: too long for a segment; make it a closure run")]
)
def test_a_segment_is_at_most_six_times_the_protocols(seconds, problem):
    (segment,) = cut(*turning(seconds, dps=1.0))
    assert (segment.problem, segment.breaks_yaw, segment.accepted) == (problem, False, problem is None)


@pytest.mark.parametrize(("periods", "lost"), [(2.49, None), (2.51, 2), (21, 20)])
def test_a_step_of_two_and_a_half_periods_is_a_gap(periods, lost):
    """From the last sample before the turn to its last one; a step outside of it is none of its."""
    samples, says = samples_of(1000), lost and f"{lost} samples are missing during the turn (gap of {periods / 100:.3f} s)"
    for row, broken in ((399, None), (400, says), (401, says), (550, says), (551, None)):
        late = (np.arange(1000) >= row) * round((periods - 1) * 10_000_000)
        assert why_broken(replace(samples, t_ns=samples.t_ns + late), slice(400, 551), CONFIG.sensor) == broken


def test_a_turn_that_clips_names_its_axes_unless_its_readings_were_put_in():
    samples = samples_of(300)
    samples.gyro[100:110, 1] = samples.gyro[105:112, 2] = -573.5 * DEG
    says = "the gyro clips at 574 dps on y, z: turn slower or choose a larger full scale"
    assert why_broken(samples, slice(50, 200), CONFIG.sensor) == says
    assert why_broken(samples, slice(110, 200), CONFIG.sensor) == says.replace("y, z", "z")
    assert why_broken(replace(samples, gyro=samples.gyro * 570 / 573.5), slice(50, 200), CONFIG.sensor) is not None  # stands there
    put_in = np.zeros(300, dtype=bool)
    put_in[100:112] = True
    assert why_broken(samples, slice(50, 200), CONFIG.sensor, put_in) is None
    samples.gyro[:, 2] = 0.0
    (segment,) = cut(samples, [still(0, 50), still(200, 300)])
    assert segment.breaks_yaw
    assert cut(samples, [still(0, 50), still(200, 300)], put_in=put_in)[0].accepted


@pytest.mark.parametrize(("past", "turns", "leaps"), [(-0.01, 4, 0), (0.01, 4, 1), (0.01, 3, 0)])
def test_gravity_moves_by_no_more_than_the_way_of_the_rate(past, turns, leaps):
    """5 deg and a tenth of the way more are left to an uncalibrated gyro; of more than a quarter of the turns it is not believed."""
    samples = samples_of(400 * turns + 100)
    stills = [still(400 * i, 400 * i + 100) for i in range(turns + 1)]
    samples.gyro[100:399, 0] = 20 * DEG
    way = 20 * (2.99 - 0.005)  # from the last sample of rest, whose neighbour turns already
    angle = (5 + 1.1 * way + past) * DEG
    down = G * np.array([0, -np.sin(angle), -np.cos(angle)])
    stills[1:] = [replace(each, accel_mean=down) for each in stills[1:]]
    samples.accel[251:] = down
    samples.accel[[98, 401]] *= 9.0  # in the stills
    found = cut(samples, stills)
    assert [segment.problem is not None for segment in found] == [bool(leaps)] + [False] * (turns - 1)
    if leaps:
        where = f"by {angle / DEG:.0f} deg, most of it at 2.50 s, and the gyro turned by {found[0].turn_deg:.1f} deg"
        assert found[0].problem == f"gravity leaps {where}: samples are missing"
        assert found[0].breaks_yaw


def test_a_run_begins_and_ends_in_one_attitude_to_half_a_degree():
    samples = samples_of(1000)
    for angle_deg, returned in ((0.499, True), (0.501, False)):
        down = G * np.array([np.sin(angle_deg * DEG), 0, -np.cos(angle_deg * DEG)])
        stills = [still(0, 100), still(300, 400, down=[G, 0, 0]), still(800, 900, down=down), still(950, 1000, problem="creeps")]
        ends = run_ends(samples, stills, CONFIG.sensor)
        assert (ends.first, ends.last, ends.broken, ends.returned) == (stills[0], stills[2], None, returned)
        assert ends.away_rad == pytest.approx(angle_deg * DEG)
    assert run_ends(samples, [stills[0], stills[3]], CONFIG.sensor) is None
    assert run_ends(samples, [stills[0], stills[2]], CONFIG.sensor).last is stills[2]
    samples.gyro[800] = 574 * DEG  # the first sample of the last still belongs to it, and no later one
    assert run_ends(samples, stills, CONFIG.sensor).broken is not None
    assert run_ends(samples, stills, CONFIG.sensor, np.arange(1000) == 800).broken is None
    samples.gyro[800:802] = [[0.0], [574 * DEG]]
    assert run_ends(samples, stills, CONFIG.sensor).broken is None


def test_a_turn_is_left_out_by_a_moment_in_which_it_moved():
    """Of the log's own clock, which begins at 7 s: from the last sample of rest to the first."""
    samples, stills = turning(3.0)
    (segment,) = cut(samples, stills)
    moments = [7 + 3.989, 7 + 3.9901, 7 + 6.9899, 7 + 6.9911]
    assert [moved_at(segment, samples, at_s) for at_s in moments] == [False, True, True, False]
    between = replace(segment, first=None, last=None)  # of moments of a truth file
    edges = np.array([segment.start, segment.stop - 1]) / 100 + 7
    moments = edges[0] - 1e-3, edges[0] + 1e-6, edges[1] - 1e-6, edges[1] + 1e-3
    assert [moved_at(between, samples, at_s) for at_s in moments] == [False, True, True, False]
    rows = [LeftOut("log2.csv.gz", 12.0), LeftOut("log1.csv", 12.0)]
    assert moments_of(Path("a/log1.csv.gz"), rows) == [12.0]
    assert [s.accepted for s in without_excluded([segment], samples, Path("log1.csv"), rows)] == [False]
    assert without_excluded([segment], samples, Path("log3.csv"), rows) == [segment]


def test_stills_and_turns_are_counted_over_all_logs():
    """A log without a still is not counted; stills that are known to move by their number are none."""
    stills = [still(0, 100), still(400, 500), still(800, 900)]
    samples = samples_of(900, [0, 0, 30 * DEG])
    logs = [Log(Path(name), samples) for name in ("a.csv", "b.csv", "c.csv")]
    found = [
        LogStills(samples, stills if log.path.stem != "b" else [], Noise(DOWN, DOWN) if log.path.stem != "b" else None) for log in logs
    ]
    session = Session(Path("s"), replace(CONFIG, exclude=(LeftOut("c.csv", 7 + 6.0),)), tuple(logs), ())
    of = SimpleNamespace(of=lambda log: found[logs.index(log)])
    said = []
    first, second = session_segments(session, of, (), said.append)
    assert said == ["stills of a.csv", "stills of b.csv", "stills of c.csv"]
    assert [(s.number, s.log, s.problem) for s in (*first.segments, *second.segments)] == [
        (0, 0, None), (1, 0, None), (2, 1, None), (3, 1, "it was left out by hand (session.toml)"),
    ]  # fmt: skip
    first, second = session_segments(session, of, (1, 3))
    moving = "turns about the vertical"
    assert [s.problem for s in (*first.stills, *second.stills)] == [None, moving, None, moving, None, None]
    assert [(s.number, s.note) for s in (*first.segments, *second.segments)] == [(0, f"passes over a still that {moving}"), (1, None)]


def test_the_angle_that_the_gyro_reads_is_its_integral_less_a_bias_that_changes_evenly():
    rng, stills = np.random.default_rng(0), [still(0, 100, bias=[1e-3, 2e-3, -1e-3]), still(400, 500, bias=[3e-3, 0, 5e-3])]
    samples = samples_of(500, rng.normal(size=(500, 3)))
    (segment,) = cut(samples, stills)
    part = slice(segment.start, segment.stop)
    t_s = (samples.t_ns[part] - samples.t_ns[segment.start]) * NS
    mean = (stills[0].gyro_mean + stills[1].gyro_mean) / 2
    assert_allclose(angle_read(samples, segment), np.trapezoid(samples.gyro[part], t_s, axis=0) - mean * t_s[-1], atol=1e-12)
    bent = replace(samples, gyro=np.tile(stills[0].gyro_mean, (500, 1)))
    first_half = np.trapezoid((stills[1].gyro_mean - stills[0].gyro_mean)[:, None] * -t_s / t_s[-1], t_s, axis=1)
    assert_allclose(angle_read(bent, segment), first_half, atol=1e-12)


def known(angle_deg, axis=(0, 0, 1.0), turn=0, log=None):
    return KnownTurn(turn, log, np.array(axis), "z", angle_deg * DEG, 1e-3)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_stated_angle_may_be_off_by_a_tenth_and_five_degrees(sign):
    """Of 180 deg by 23; and, of ten circles, by 150; then the sense, then the circles are doubted."""

    def doubted(stated, read):
        return contradiction(known(sign * stated), np.array([0, 0, sign * read * DEG]))

    for stated, off in ((180, 23), (3600, 150), (180, -23), (3600, -150)):
        assert doubted(stated, stated + off * (1 - 1e-4)) is None
        assert doubted(stated, stated + off * (1 + 1e-4)) is not None
    for stated, read, says in (
        (-90, 90, ": the other way round"),
        (450, 90, ": 1 full circle fewer than stated"),
        (70, 90, ""),
        (300, 90, ""),  # nearly, but for a circle, it is not either
        (-630, 90, ": 2 full circles fewer than stated"),  # of those in the stated sense
        (90, 450, ": 1 full circle more than stated"),
    ):
        assert doubted(stated, read) == f"the gyro reads {sign * read:.1f} deg about z{says}"
    assert contradiction(known(90), np.zeros(3)) == "the gyro turned 0.0 deg about 0.00;0.00;0.00, not about z"


@pytest.mark.parametrize(("apart_deg", "same"), [(29.99, True), (30.01, False)])
def test_an_axis_may_be_thirty_degrees_from_where_it_was_mounted(apart_deg, same):
    """A turn about its own axis loses nothing by it."""
    read = 90 * DEG * np.array([np.sin(apart_deg * DEG), 0, np.cos(apart_deg * DEG)])
    assert (contradiction(known(90), read) is None) == same
    assert same or contradiction(known(90), read) == "the gyro turned 90.0 deg about 0.50;0.00;0.87, not about z"
    found = FoundTurn(known(-90), None, -read, None)
    assert_allclose(found.axis, read / np.linalg.norm(read))
    assert found.along_rad == pytest.approx(-90 * DEG * np.cos(apart_deg * DEG))


def test_known_turns_are_counted_over_all_logs_or_in_their_own():
    samples = samples_of(900, [0, 0, 30 * DEG])
    stills = [still(0, 100), still(400, 500), still(800, 900)]
    first, second = cut(samples, stills, log=0), cut(samples, stills, log=1, number=2)
    second[1] = replace(second[1], problem="clips")
    angle = angle_read(samples, first[0])[2] / DEG
    for turn, log, number, problem in (
        (2, None, 2, None),
        (1, "b", 3, "the turn is not used: clips"),
        (4, None, None, "there is no such turn: 4 turns, counted from 0"),
        (2, "b", None, "there is no such turn: 2 turns, counted from 0"),
        (0, "c", None, "there is no such turn: no turn between two stills"),
    ):
        (found,) = _find_known_turns([known(angle, turn=turn, log=log)], [*first, *second], [samples, samples], ["a", "b"])
        assert (found.segment and found.segment.number, found.problem) == (number, problem)
    asked = [known(angle, turn=2), known(angle, turn=0, log="b"), known(-angle, turn=0, log="a")]
    one, again, other = _find_known_turns(asked, [*first, *second], [samples, samples], ["a", "b"])
    assert (one.segment, one.problem, again.problem) == (again.segment, None, "an earlier line names the same turn")
    assert (other.segment.number, other.problem[-19:]) == (0, "the other way round")


def test_three_axes_span_space_down_to_a_singular_value_of_three_tenths():
    def turns(lift, problem=None):
        axes = ([1, 0, 0], [0, 1, 0], [np.sqrt((1 - lift**2) / 2), np.sqrt((1 - lift**2) / 2), lift])
        return [FoundTurn(known(90), None, np.array(axis) * 1.5, problem) for axis in axes]

    lifts = np.linspace(0.2, 0.9, 15)
    smallest = [np.linalg.svd(np.array([turn.axis for turn in turns(lift)]))[1][2] for lift in lifts]
    assert [_span_space(turns(lift)) for lift in lifts] == [bool(value > 0.3) for value in smallest]
    assert min(smallest) < 0.3 < max(smallest)
    assert not _span_space(turns(0.9)[:2])
    assert not _span_space(turns(0.9, "clips"))


def test_too_few_segments_say_what_is_missing_and_where_the_last_ends():
    samples, stills = turning(3.0)
    (segment,) = cut(samples, stills)
    bad, axes = replace(segment, problem="it clips"), [FoundTurn(known(90), None, axis, None) for axis in np.eye(3)]
    dial, creeping = FoundTurn(known(90), None, None, "a dial"), replace(stills[0], problem="creeps")
    for found, segments, turns, said in (
        ([], [], [], "no still phase of 1.5 s found; was the table ever left alone?"),
        ([creeping, *stills], [], [], "3 still phases but no turn between two that are usable (creeps)"),
        (stills, [bad, bad], [], "all 2 segments are rejected, the first because it clips"),
        (stills, [segment] * 6 + [bad], [dial], "6 usable segments, expected at least 7"),
        (stills, [segment] * 6 + [bad], [], "6 usable segments, expected at least 7 for a fit; the last ends at 8 s: record more turns"),
    ):
        assert why_too_few(found, segments, turns, 1.5).startswith(said)
    assert why_too_few(stills, [segment] * 7, [], 1.0) is why_too_few(stills, [segment], axes, 1.0) is None
