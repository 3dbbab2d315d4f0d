"""A session as the problem that is fitted: carried yaw, dials, two logs, some turns for all; closure runs; what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import GRAVITY, Table, session_of, write_session
from scipy.spatial.transform import Rotation

from session.base.errors import DataError, SegmentError
from session.base.units import DEG, EARTH_RATE_RPS
from session.detect.segments import FEWEST_SEGMENTS
from tinygc import read_session
from tinygc.closure import residual
from tinygc.closure.build import build_problem
from tinygc.closure.floor import DIALS
from tinygc.closure.runs import read_closure_runs
from tinygc.models.linear import LinearModel

HEADINGS = np.arange(24) * 15 * DEG
TEN = Table().tumble(10, seed=3)
BIAS_DPS = (0.5, -0.3, 0.6)
TRUE = LinearModel(np.eye(3), -np.multiply(BIAS_DPS, DEG))


@pytest.fixture(scope="module")
def session():
    return session_of(TEN.samples(odr_hz=104, bias_dps=BIAS_DPS), odr_hz=104)


@pytest.fixture(scope="module")
def problem(session):
    """Its table stands on no turning Earth."""
    return build_problem(session, use_earth=False)


def true_attitudes(problem):
    """In the middle of each still, from the table's own plan."""
    log = problem.logs[0]
    return TEN.truth(np.array([log.samples.t_s[still.middle] for still in log.stills]))[1]


def test_yaw_is_carried_to_the_true_attitude(problem):
    """To the closure of ten turns; the first still is the table's index, yaw 0."""
    carried = Rotation.from_quat(problem.logs[0].q_tb, scalar_first=True)
    assert (true_attitudes(problem).inv() * carried).magnitude().max() / DEG < 0.5
    assert carried[0].as_matrix()[1, 0] == pytest.approx(0, abs=1e-6)


def test_no_attitude_is_carried_through_a_clipped_turn_or_lost_samples(session):
    left_out, clipped = build_problem(session, exclude=(4,)), build_problem(session, clipped=(4,))
    assert (len(left_out.earths), len(clipped.earths)) == (1, 2)
    behind = clipped.logs[0].stills.index(clipped.segments[4].last)
    assert np.diff(clipped.logs[0].group).nonzero()[0].tolist() == [behind - 1]
    samples = session.logs[0].samples
    lost = samples.pick(np.abs(samples.t_s - 18.5) > 0.7)  # rests of 2 s and turns of 3 s
    assert len(build_problem(session_of(lost, odr_hz=104)).earths) == 2


def test_dials_observe_yaw_too(problem, tmp_path):
    """Read to a hundredth of a degree, as a person would: three angles that close at their floor."""
    roll, pitch, yaw = true_attitudes(problem).as_euler("ZYX")[:, ::-1].T / DEG
    rows = [f"{i},{r:.2f},{p:.2f},{y:.2f}" for i, (r, p, y) in enumerate(zip(roll, pitch, yaw, strict=True))]
    folder = write_session(tmp_path, problem.logs[0].samples)
    (folder / "attitudes.csv").write_text("\n".join(["still,roll_deg,pitch_deg,yaw_deg", *rows]) + "\n")
    toml = (folder / "session.toml").read_text().replace("208.0", "104.0")
    (folder / "session.toml").write_text(toml + '[protocol]\nreference = "table"\ndial_sigma_deg = 0.03\n')
    read = build_problem(read_session(folder), use_earth=False)
    assert read.floor.parts[DIALS].own[:, 2, 2] == pytest.approx(np.full(10, 2 * (0.03 * DEG) ** 2))
    batch = read.batch
    angles = residual.error_angles(residual.segment_residuals(batch, TRUE(batch.rate)))
    assert angles.shape == (10, 3)
    assert np.abs(angles).max() / DEG < 0.06


def test_two_logs_are_one_problem():
    parts = [Table().tumble(5, seed=seed).samples(odr_hz=104, seed=seed) for seed in (1, 2)]
    one, two = (session_of(part, odr_hz=104) for part in parts)
    problem = build_problem(replace(one, logs=one.logs + two.logs))
    assert [segment.log for segment in problem.used] == [0] * 5 + [1] * 5
    assert [segment.number for segment in problem.used] == list(range(10))
    assert not problem.floor.shared[4].any()  # no still is common to the two logs
    # Rests of 2 s, turns of 3 s: the middles of the turns, the second log after the first.
    first_s = 3.5 + 5 * np.arange(5)
    np.testing.assert_allclose(problem.middle_s, [*first_s, *(first_s + parts[0].duration_s)], atol=0.2)


def test_some_turns_stand_for_a_longer_session(problem, session):
    """Runs of neighbours from the first turn to the last; each run's yaw begins anew, and the calibration is that of the whole."""
    part = build_problem(session, use_earth=False, most=8)
    assert [segment.number for segment in part.used] == [0, 1, 3, 4, 5, 6, 8, 9]
    assert len(part.still_rates.rate) == 11  # the turns left out lie between stills of others
    assert part.logs[0].group.tolist() == [0, 0, 0, 1, 1, 1, 1, 1, 2, 2, 2]
    np.testing.assert_allclose(part.first.E, problem.first.E, atol=5e-3)


# Closure runs.


def run_of(session, table, **more):
    """The session with a closure run, whose stamps are long after the log's: the table may have been touched."""
    samples = table.samples(odr_hz=104, **more)
    log = replace(session.logs[0], path=session.logs[0].path.with_name("closure0009.csv"), samples=samples)
    late = replace(log, samples=replace(samples, t_ns=samples.t_ns + 3_600_000_000_000))
    return read_closure_runs(build_problem(replace(session, closures=(late,))))


def test_a_bias_error_shows_in_the_yaw_of_a_level_run(session):
    """0.01 dps too much about the vertical for ten seconds and both margins at rest is 0.1 degrees, beside the Earth's."""
    (run,) = run_of(session, Table().rest(2).turn(360, (0, 0, 1), 10).rest(2), bias_dps=(0, 0, 0.01), gyro_mdps=1.0)
    seconds = run.batch.duration_s[0]
    errors = run.errors(LinearModel(np.eye(3), np.zeros(3))) / DEG
    np.testing.assert_allclose(errors, [0, 0, 0.01 * seconds + 7.75 / 3600 * seconds], atol=0.015)
    assert run.began_s == pytest.approx(3600, abs=0.02)
    # Its floor: a walk of the angle, and gravity's direction in both stills, by the noise of the session.
    noise = build_problem(session).noise
    walk, tilt = noise.gyro**2 / 2 * seconds, np.mean(noise.accel**2) / 2 / 2.0 / GRAVITY**2
    variance = run.floor_rad**2
    np.testing.assert_allclose([variance[:2].sum(), variance[2]], [walk[:2].sum() + 4 * tilt, walk[2]], rtol=0.004)
    # What it may be off by is the spread over all headings of what the Earth's horizontal rate turns it by.
    assert (run.time_known, run.yaw_carried, run.earth.source) == (True, False, "unknown")
    rate, horizontal, known = run.batch.rate[0], EARTH_RATE_RPS * np.cos(31.03 * DEG), replace(run, yaw_carried=True)
    ways = horizontal * np.stack([np.cos(HEADINGS), np.sin(HEADINGS), 0 * HEADINGS], axis=1)
    moved = np.array([known.with_earth(way, rate).errors_at(rate) for way in ways]) - run.errors_at(rate)
    np.testing.assert_allclose(run.heading_covariance, moved.T @ moved / len(moved), rtol=0.001, atol=1e-9)


TURNED = Table().rest(2).turn(200, (1, 0, 0), 5).turn(-190, (1, 0, 0), 5).rest(2)


@pytest.mark.parametrize(
    ("table", "says"),
    [(TURNED, r"does not return: .* 10\.0\d deg"), (Table().rest(2).turn(360, (1, 0, 0), 8), "1 still phases.*still - long turn - still")],
)
def test_a_closure_run_that_does_not_come_back_is_refused(session, table, says):
    with pytest.raises(DataError, match=rf"closure0009\.csv: {says}"):
        run_of(session, table)


@pytest.mark.parametrize(
    ("table", "given", "says"),
    [
        (Table().turn(300, (1, 0, 0), 10).turn(-300, (0, 1, 0), 10), {}, "still|turn"),
        (Table().rest(5), {}, "1 still phase but no turn.*still - turn - still"),
        (Table().tumble(3), {}, f"3 usable segments, expected at least {FEWEST_SEGMENTS}"),
        (Table().tumble(8), {"exclude": tuple(range(8))}, "all 8 segments are rejected, the first because left out by request"),
    ],
)
def test_a_session_without_enough_to_fit_is_refused_with_what_to_record(table, given, says):
    with pytest.raises(SegmentError, match=says):
        build_problem(session_of(table.samples(odr_hz=104), odr_hz=104), **given)
