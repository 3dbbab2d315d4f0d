"""Closure runs: a long turn that comes back, never fitted."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table

from session.io.errors import DataError
from session.io.logfile import Log
from tinygc import closure, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.runs import read_closure_runs
from tinygc.models.linear import LinearModel


@pytest.fixture(scope="module")
def folder(simulated):
    return simulated(segments=10, closure_s=30.0, with_heading=True, bias_instability_dph=0.0)


@pytest.fixture(scope="module")
def problem(folder):
    return build_problem(read_session(folder))


@pytest.fixture(scope="module")
def true_model(folder):
    truth = json.loads((folder / "truth.json").read_text())
    return LinearModel(np.array(truth["E"]), np.array(truth["B_dps"]) * DEG)


def as_run(problem, samples):
    """The problem's session with another closure run; stamps long after the log's, so that the table may have been touched."""
    late = replace(samples, t_ns=samples.t_ns + 3_600_000_000_000)
    log = replace(problem.session.logs[0], path=problem.session.logs[0].path.with_name("closure0009.csv"), samples=late)
    bare = replace(problem.session.config.accelerometer, matrix=np.eye(3), bias_mps2=np.zeros(3))
    session = replace(problem.session, closures=(log,), config=replace(problem.session.config, accelerometer=bare))
    return replace(problem, session=session)


def test_true_parameters_close_at_the_floor(problem, true_model):
    """Over many seeds the floor would be the standard deviation; one run must lie within 4 of them, angle by angle."""
    (run,) = read_closure_runs(problem)
    errors = run.errors(true_model)
    assert np.all(np.abs(errors) < 4 * run.floor_rad)
    assert run.earth.source == "given"
    # A floor of the right size: angle random walk over the run.
    assert run.floor_rad[2] / DEG == pytest.approx(0.005 / np.sqrt(2) * np.sqrt(run.duration_s), rel=0.25)
    assert np.sqrt(np.mean(errors**2)) / DEG < 0.05


def test_without_the_earth_the_error_is_the_earths(folder, true_model):
    """15 degrees an hour: over the run some hundredths to tenths of a degree, and never the floor."""
    session = read_session(folder)
    (run,) = read_closure_runs(build_problem(session, use_earth=False))
    (with_earth,) = read_closure_runs(build_problem(session))
    turned = closure.error_angles(closure.segment_residuals(run.batch, true_model(run.batch.rate)))
    difference = np.linalg.norm(turned[0] - with_earth.errors(true_model)) / DEG
    most = 15.04 / 3600 * (run.duration_s + 0.5)
    assert 0.2 * most < difference < 1.01 * most


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


def test_a_run_that_does_not_return_is_refused_with_the_angle(problem):
    samples = Table().rest(2).turn(200, (1, 0, 0), 5).turn(-190, (1, 0, 0), 5).rest(2).samples(odr_hz=104)
    with pytest.raises(DataError, match=r"closure0009\.csv: does not return: .* 10\.0\d deg"):
        read_closure_runs(as_run(problem, samples))


def test_a_run_with_one_still_is_refused(problem):
    samples = Table().rest(2).turn(360, (1, 0, 0), 8).samples(odr_hz=104)
    with pytest.raises(DataError, match=r"closure0009\.csv: 1 still phases.*still - long turn - still"):
        read_closure_runs(as_run(problem, samples))


def test_a_run_that_never_rests_is_refused(problem):
    rng = np.random.default_rng(0)
    samples = Table().turn(360, (1, 0, 0), 8).samples(odr_hz=104)
    samples = replace(samples, gyro=samples.gyro + rng.normal(size=samples.gyro.shape) * np.linspace(0.2, 2, len(samples))[:, None])
    with pytest.raises(DataError, match=r"closure0009\.csv: \d still phases"):
        read_closure_runs(as_run(problem, samples))


def test_no_runs_no_errors(problem):
    assert read_closure_runs(replace(problem, session=replace(problem.session, closures=()))) == []
    assert isinstance(problem.session.closures[0], Log)
