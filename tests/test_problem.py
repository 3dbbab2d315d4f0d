"""From a session to the problem: what is counted, the yaw that is carried, the references, and why a session is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from scipy.spatial.transform import Rotation

from session.detect.segments import FEWEST_SEGMENTS
from session.io.errors import DataError, SegmentError
from session.io.samples import Samples
from tinygc import SimulationOptions, check, closure, read_session
from tinygc.attitude import rotation
from tinygc.closure import prepared
from tinygc.closure.build import build_problem
from tinygc.closure.problem import CLIPPED, LEFT_OUT, NOT_TAKEN
from tinygc.models.linear import LinearModel
from tinygc.simulation.movement import move
from tinygc.simulation.simulator import simulate_session


def true_model(folder):
    truth = json.loads((folder / "truth.json").read_text())
    return LinearModel(np.array(truth["E"]), np.array(truth["B_dps"]) * DEG)


def true_attitudes(folder, problem):
    """q_tb (Q, 4) in the middle of each still, from the simulation's own gimbals."""
    options = json.loads((folder / "truth.json").read_text())["options"]
    simulation = simulate_session(SimulationOptions(**{**options, "lever_m": tuple(options["lever_m"])}))
    log = problem.logs[0]
    middle_s = np.array([log.samples.t_s[still.middle] for still in log.stills])
    outer, middle, inner = move(simulation.plan, middle_s).angles
    return rotation.from_euler(inner, middle, outer)


@pytest.fixture(scope="module")
def folder(simulated):
    return simulated()


@pytest.fixture(scope="module")
def problem(folder):
    return build_problem(read_session(folder))


def test_counts(problem):
    assert len(problem.stills) == 11
    assert len(problem.segments) == len(problem.used) == len(problem.batch) == 10
    assert problem.still_rates.rate.shape == (11, 3)
    assert not problem.batch.yaw_known
    assert problem.floor.own.shape == (10, 2, 2)
    assert problem.noise.gyro / DEG == pytest.approx(0.005, rel=0.2)


def test_batch_holds_the_logs_samples_and_times(problem):
    samples = problem.logs[0].samples
    for i, segment in enumerate(problem.used):
        count = segment.stop - segment.start
        np.testing.assert_array_equal(problem.batch.rate[i, :count], samples.gyro[segment.start : segment.stop])
        assert problem.batch.duration_s[i] == pytest.approx(segment.duration_s, abs=1e-12)
        assert not problem.batch.dt[i, count - 1 :].any()


def test_yaw_is_carried_to_the_true_attitude(problem, folder):
    """Against the simulation's gimbals, turned about the vertical so that the first still agrees: to the closure of ten turns."""
    true = true_attitudes(folder, problem)
    carried = problem.logs[0].q_tb
    turn = Rotation.from_quat(true[0], scalar_first=True) * Rotation.from_quat(carried[0], scalar_first=True).inv()
    assert np.linalg.norm(turn.as_rotvec()[:2]) / DEG < 0.02  # the table is level: they differ by a yaw only
    error = Rotation.from_quat(true, scalar_first=True).inv() * turn * Rotation.from_quat(carried, scalar_first=True)
    assert error.magnitude().max() / DEG < 0.5
    heading = rotation.matrix(carried[:1])[0]
    assert heading[1, 0] == pytest.approx(0, abs=1e-6)  # the first still is the table's index: yaw 0


def test_excluded_segments_are_said_and_not_used(folder):
    problem = build_problem(read_session(folder), exclude=(0, 7))
    assert [s.number for s in problem.segments if not s.accepted] == [0, 7]
    assert all(s.problem == "left out by request" for s in problem.segments if not s.accepted)
    assert len(problem.batch) == 8


def test_no_attitude_is_carried_through_a_clipped_segment(folder):
    session = read_session(folder)
    left_out, clipped = build_problem(session, exclude=(4,)), build_problem(session, clipped=(4,))
    assert (left_out.segments[4].problem, clipped.segments[4].problem) == (LEFT_OUT, CLIPPED)
    assert len(left_out.earths) == 1
    assert len(clipped.earths) == 2
    stills = clipped.logs[0].stills
    behind = stills.index(clipped.segments[4].last)
    assert np.diff(clipped.logs[0].group).nonzero()[0].tolist() == [behind - 1]


def test_earth_is_left_out_on_request_and_without_a_latitude(folder):
    session = read_session(folder)
    assert build_problem(session, use_earth=False).earth.source == "none"
    nowhere = replace(session, config=replace(session.config, site=replace(session.config.site, latitude_deg=None)))
    problem = build_problem(nowhere)
    assert problem.earth.source == "none"
    assert not problem.batch.earth.any()


def with_dials(folder, problem, tmp_path, skip=()):
    """The same session with dial readings, exact to what a person would read: 0.01 degrees."""
    roll, pitch, yaw = np.moveaxis(Rotation.from_quat(true_attitudes(folder, problem), scalar_first=True).as_euler("ZYX")[:, ::-1], -1, 0)
    rows = ["still,roll_deg,pitch_deg,yaw_deg"]
    rows += [
        f"{i},{r / DEG:.2f},{p / DEG:.2f},{y / DEG:.2f}" for i, (r, p, y) in enumerate(zip(roll, pitch, yaw, strict=True)) if i not in skip
    ]
    made = tmp_path / "dials"
    made.mkdir()
    (made / "attitudes.csv").write_text("\n".join(rows) + "\n")
    (made / "log0001.csv.gz").write_bytes((folder / "log0001.csv.gz").read_bytes())
    (made / "session.toml").write_text((folder / "session.toml").read_text().replace('reference = "gravity"', 'reference = "table"'))
    return made


def test_dials_observe_yaw_too(folder, problem, tmp_path):
    made = build_problem(read_session(with_dials(folder, problem, tmp_path)))
    assert made.batch.yaw_known
    assert made.batch.angles == 3
    angles = closure.error_angles(closure.segment_residuals(made.batch, true_model(folder)(made.batch.rate)))
    assert angles.shape == (10, 3)
    # Three angles at the floor of dials read to a hundredth of a degree: yaw, too.
    assert np.abs(angles).max() / DEG < 0.06
    assert np.sqrt(np.mean(angles[:, 2] ** 2)) / DEG < 0.03
    np.testing.assert_array_equal(made.logs[0].q_tb[:-1], made.batch.start)


def test_a_still_without_a_dial_reading_costs_its_segments(folder, problem, tmp_path):
    made = build_problem(read_session(with_dials(folder, problem, tmp_path, skip=(4,))))
    assert [s.number for s in made.segments if not s.accepted] == [3, 4]
    assert "attitudes.csv" in made.segments[3].problem


def test_two_logs_are_one_problem():
    parts = [Table().tumble(5, seed=seed).samples(odr_hz=104, seed=seed) for seed in (1, 2)]
    one, two = (session_of(part, odr_hz=104) for part in parts)
    problem = build_problem(replace(one, logs=one.logs + two.logs))
    assert len(problem.logs) == 2
    assert [segment.log for segment in problem.used] == [0] * 5 + [1] * 5
    assert [segment.number for segment in problem.used] == list(range(10))
    assert not problem.floor.shared[4].any()  # no still is common to the two logs
    # Rests of 2 s, turns of 3 s: the middles of the turns, the second log after the first.
    first_s = 3.5 + 5 * np.arange(5)
    np.testing.assert_allclose(problem.middle_s, [*first_s, *(first_s + parts[0].duration_s)], atol=0.2)


def test_a_session_without_stills_is_refused():
    samples = Table().turn(300, (1, 0, 0), 10).turn(-300, (0, 1, 0), 10).samples(odr_hz=104)
    shaken = replace(
        samples, gyro=samples.gyro + np.random.default_rng(0).normal(size=samples.gyro.shape) * np.linspace(0, 5, len(samples))[:, None]
    )
    with pytest.raises(SegmentError, match=r"still|turn"):
        build_problem(session_of(shaken, odr_hz=104))


def test_a_single_still_is_refused_and_says_what_to_record():
    with pytest.raises(SegmentError, match=r"1 still phase but no turn.*still - turn - still"):
        build_problem(session_of(Table().rest(5).samples(odr_hz=104), odr_hz=104))


def test_too_few_segments_are_refused_with_the_number_that_is_needed():
    samples = Table().tumble(3).samples(odr_hz=104)
    with pytest.raises(SegmentError, match=f"3 usable segments, expected at least {FEWEST_SEGMENTS}"):
        build_problem(session_of(samples, odr_hz=104))


def test_all_rejected_says_why():
    samples = Table().tumble(8).samples(odr_hz=104)
    with pytest.raises(SegmentError, match="all 8 segments are rejected, the first because left out by request"):
        build_problem(session_of(samples, odr_hz=104), exclude=tuple(range(8)))


def test_a_gyro_without_any_noise_is_refused():
    made = Table().tumble(8).samples(odr_hz=104, gyro_mdps=0.0, bias_dps=(0, 0, 0))
    quiet = Samples(made.t_ns, made.gyro, made.accel, made.temp_c)
    with pytest.raises((DataError, SegmentError), match=r"noise|still"):
        build_problem(session_of(quiet, odr_hz=104))


# A long session: a first look builds the problem of some turns only, which stand for all.


def test_some_turns_stand_for_a_longer_session(problem, folder):
    """Runs of neighbours from the first turn to the last; each run's yaw begins anew, and the calibration is that of the whole."""
    part = build_problem(read_session(folder), most=8)
    assert [segment.number for segment in part.used] == [0, 1, 3, 4, 5, 6, 8, 9]
    assert [segment.problem for segment in part.segments if not segment.accepted] == [NOT_TAKEN] * 2
    assert len(part.batch) == len(part.floor.sigma) == 8
    assert len(part.still_rates.rate) == 11  # the turns left out lie between stills of others
    assert part.logs[0].group.tolist() == [0, 0, 0, 1, 1, 1, 1, 1, 2, 2, 2]
    np.testing.assert_allclose(part.first.E, problem.first.E, atol=5e-3)


def test_stills_of_no_turn_that_is_taken_are_none_of_the_problem(folder):
    part = build_problem(read_session(folder), most=7)
    assert [segment.number for segment in part.used] == [0, 3, 6, 9]
    left_out = [number for number, still in enumerate(part.logs[0].stills) if still.problem == NOT_TAKEN]
    assert left_out == [2, 5, 8]


def test_a_session_that_is_not_longer_is_taken_whole(problem, folder):
    same = build_problem(read_session(folder), most=10)
    np.testing.assert_array_equal(same.batch.rate, problem.batch.rate)
    np.testing.assert_array_equal(same.first.vector, problem.first.vector)


def test_check_says_how_many_turns_stand_for_all(folder, monkeypatch):
    assert "turns fitted here" not in {finding.what for finding in check(folder)}
    monkeypatch.setattr(prepared, "LOOKED_AT", 8)
    (said,) = [finding for finding in check(folder) if finding.what == "turns fitted here"]
    assert said.level == "note"
    assert "8 of 10 turns" in said.says
