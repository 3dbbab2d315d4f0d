"""A session as the problem that is fitted: counts, carried yaw, references, two logs, some turns for all; closure runs; refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import Table, session_of
from scipy.spatial.transform import Rotation

from session.detect.segments import FEWEST_SEGMENTS
from session.io.errors import DataError, SegmentError
from session.io.units import DEG
from tinygc import SimulationOptions, closure, read_session
from tinygc.attitude import rotation
from tinygc.attitude.earth import with_heading
from tinygc.closure.build import build_problem
from tinygc.closure.problem import CLIPPED, LEFT_OUT, NOT_TAKEN
from tinygc.closure.runs import read_closure_runs
from tinygc.models.linear import LinearModel
from tinygc.simulation.movement import move
from tinygc.simulation.simulator import simulate_session


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


def test_no_attitude_is_carried_through_a_clipped_segment(folder):
    session = read_session(folder)
    left_out, clipped = build_problem(session, exclude=(4,)), build_problem(session, clipped=(4,))
    assert (left_out.segments[4].problem, clipped.segments[4].problem) == (LEFT_OUT, CLIPPED)
    assert len(left_out.earths) == 1
    assert len(clipped.earths) == 2
    stills = clipped.logs[0].stills
    behind = stills.index(clipped.segments[4].last)
    assert np.diff(clipped.logs[0].group).nonzero()[0].tolist() == [behind - 1]


def with_dials(folder, problem, tmp_path):
    """The same session with dial readings, exact to what a person would read: 0.01 degrees."""
    roll, pitch, yaw = np.moveaxis(Rotation.from_quat(true_attitudes(folder, problem), scalar_first=True).as_euler("ZYX")[:, ::-1], -1, 0)
    rows = ["still,roll_deg,pitch_deg,yaw_deg"]
    rows += [f"{i},{r / DEG:.2f},{p / DEG:.2f},{y / DEG:.2f}" for i, (r, p, y) in enumerate(zip(roll, pitch, yaw, strict=True))]
    made = tmp_path / "dials"
    made.mkdir()
    (made / "attitudes.csv").write_text("\n".join(rows) + "\n")
    (made / "log0001.csv.gz").write_bytes((folder / "log0001.csv.gz").read_bytes())
    (made / "session.toml").write_text((folder / "session.toml").read_text().replace('reference = "gravity"', 'reference = "table"'))
    return made


def test_dials_observe_yaw_too(folder, problem, tmp_path):
    made = build_problem(read_session(with_dials(folder, problem, tmp_path)))
    assert made.batch.yaw_known
    truth = json.loads((folder / "truth.json").read_text())
    true = LinearModel(np.array(truth["E"]), np.array(truth["B_dps"]) * DEG)
    angles = closure.error_angles(closure.segment_residuals(made.batch, true(made.batch.rate)))
    assert angles.shape == (10, 3)
    assert np.abs(angles).max() / DEG < 0.06  # the floor of dials read to a hundredth of a degree: yaw, too


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


def test_some_turns_stand_for_a_longer_session(problem, folder):
    """Runs of neighbours from the first turn to the last; each run's yaw begins anew, and the calibration is that of the whole."""
    part = build_problem(read_session(folder), most=8)
    assert [segment.number for segment in part.used] == [0, 1, 3, 4, 5, 6, 8, 9]
    assert [segment.problem for segment in part.segments if not segment.accepted] == [NOT_TAKEN] * 2
    assert len(part.batch) == len(part.floor.sigma) == 8
    assert len(part.still_rates.rate) == 11  # the turns left out lie between stills of others
    assert part.logs[0].group.tolist() == [0, 0, 0, 1, 1, 1, 1, 1, 2, 2, 2]
    np.testing.assert_allclose(part.first.E, problem.first.E, atol=5e-3)


def as_run(problem, samples):
    """The problem's session with another closure run; stamps long after the log's, so that the table may have been touched."""
    late = replace(samples, t_ns=samples.t_ns + 3_600_000_000_000)
    log = replace(problem.session.logs[0], path=problem.session.logs[0].path.with_name("closure0009.csv"), samples=late)
    bare = replace(problem.session.config.accelerometer, matrix=np.eye(3), bias_mps2=np.zeros(3))
    session = replace(problem.session, closures=(log,), config=replace(problem.session.config, accelerometer=bare))
    return replace(problem, session=session)


def test_a_bias_error_shows_in_the_yaw_of_a_level_run(problem):
    """0.01 dps too much about the vertical for ten seconds and both margins of 0.1 s at rest is 0.1 degrees."""
    samples = Table().rest(2).turn(360, (0, 0, 1), 10).rest(2).samples(odr_hz=104, bias_dps=(0, 0, 0.01), gyro_mdps=1.0)
    (run,) = read_closure_runs(as_run(problem, samples))
    roll, pitch, yaw = run.errors(LinearModel(np.eye(3), np.zeros(3))) / DEG
    earth_deg = 7.75 / 3600 * run.batch.duration_s[0]
    assert yaw == pytest.approx(0.01 * run.batch.duration_s[0] + earth_deg, abs=0.01)
    assert abs(roll) < 0.02
    assert abs(pitch) < 0.02
    assert run.earth.source == "unknown"  # the table may have been moved in the hour between


def test_the_covariance_of_a_run_is_that_of_its_heading_times_its_length(problem):
    """Against runs with all headings: the error moves by the horizontal rate times the seconds; the clock began at 0 again."""
    log = problem.session.closures[0]
    again = replace(log, samples=replace(log.samples, t_ns=log.samples.t_ns - log.samples.t_ns[0]))
    (run,) = read_closure_runs(problem.changed(session=replace(problem.session, closures=(again,))))
    assert (run.time_known, run.yaw_carried, run.earth.source) == (False, False, "unknown")
    rate = problem.first(run.batch.rate)[0]
    known = replace(run, yaw_carried=True)
    moved = []
    for heading in range(0, 360, 15):
        more = with_heading(problem.session.config.site.latitude_deg, float(heading)).rate_t * [1, 1, 0]
        moved.append(known.with_earth(more, rate).errors_at(rate) - run.errors_at(rate))
    np.testing.assert_allclose(np.mean([np.outer(x, x) for x in moved], axis=0), run.heading_covariance, rtol=0.001, atol=1e-7)


def test_samples_lost_in_a_turn_begin_a_new_group_of_yaw_and_an_exclusion_does_not():
    samples = Table().tumble(8, seed=3).samples(odr_hz=104)
    lost = samples.pick(np.abs(samples.t_s - 18.5) > 0.7)  # rests of 2 s and turns of 3 s
    assert len(build_problem(session_of(lost, odr_hz=104)).earths) == 2
    assert len(build_problem(session_of(samples, odr_hz=104), exclude=(3,)).earths) == 1


REFUSED = {
    "never still": (Table().turn(300, (1, 0, 0), 10).turn(-300, (0, 1, 0), 10), {}, "still|turn"),
    "one still": (Table().rest(5), {}, "1 still phase but no turn.*still - turn - still"),
    "too few": (Table().tumble(3), {}, f"3 usable segments, expected at least {FEWEST_SEGMENTS}"),
    "all excluded": (Table().tumble(8), {"exclude": tuple(range(8))}, "all 8 segments are rejected, the first because left out by request"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_session_without_enough_to_fit_is_refused_with_what_to_record(name):
    table, given, says = REFUSED[name]
    with pytest.raises(SegmentError, match=says):
        build_problem(session_of(table.samples(odr_hz=104), odr_hz=104), **given)


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (Table().rest(2).turn(200, (1, 0, 0), 5).turn(-190, (1, 0, 0), 5).rest(2), r"does not return: .* 10\.0\d deg"),
        (Table().rest(2).turn(360, (1, 0, 0), 8), "1 still phases.*still - long turn - still"),
    ],
)
def test_a_closure_run_that_does_not_come_back_is_refused(problem, table, says):
    with pytest.raises(DataError, match=rf"closure0009\.csv: {says}"):
        read_closure_runs(as_run(problem, table.samples(odr_hz=104)))
