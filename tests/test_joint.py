"""Accelerometer and gyroscope of a session estimated together; the estimate itself is pinned down in test_joint_exact.py."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from calibrate import main as calibrate
from session.detect import accelerometer
from session.detect.accelerometer import IDENTITY, units
from session.io.config import Accelerometer
from session.io.units import DEG, MG
from tinygc import CalibrationError, FitOptions, read_session
from tinygc.closure.joint import fit_joint, recalibrated
from tinygc.closure.prepared import prepare
from tinygc.estimation.fit import fit_session
from tinygc.explanation.decision import tilt_rms
from tinygc.models.linear import LinearModel
from tinygc.simulation.options import SimulatedUnit

ROOT = Path(__file__).resolve().parent.parent
SESSION1 = ROOT / "data" / "session1"

LEAST_SQUARES = FitOptions(methods=("least_squares",))
GRAVITY = 9.7946


def triad(unit):
    """Q, U: f = Q U (m - b), Q (3, 3) the turn from the triad's frame to the simulator's body, U upper triangular."""
    q, u = np.linalg.qr(unit.accel_matrix)
    sign = np.sign(np.diag(u))
    return q * sign, u * sign[:, None]


def errors_of(joint, unit):
    """(9,) of the correction of the accelerometer."""
    before = np.linalg.inv(accelerometer.matrix_of(joint.x)) @ joint.accelerometer.matrix
    start = joint.accelerometer.bias_mps2 - np.linalg.solve(before, joint.x[accelerometer.BIAS])
    matrix = triad(unit)[1] @ np.linalg.inv(before)
    return joint.x - np.concatenate([matrix[accelerometer.UPPER], before @ (unit.accel_bias - start)])


def with_accelerometer(session, accelerometer):
    return dataclasses.replace(session, config=dataclasses.replace(session.config, accelerometer=accelerometer))


def spoilt(session, matrix, bias_mps2):
    """Readings with further errors on top of what the sensor has, and no calibration of them known."""
    logs, closures = (
        tuple(dataclasses.replace(log, samples=log.samples.with_accel(log.samples.accel @ matrix.T + bias_mps2)) for log in each)
        for each in (session.logs, session.closures)
    )
    return with_accelerometer(dataclasses.replace(session, logs=logs, closures=closures), Accelerometer(source="none"))


def spoilt_unit(session, matrix, bias_mps2):
    """The unit that ``spoilt`` makes of the one of data/session1: f = A (m - b) of what was measured, which became matrix m + bias_mps2."""
    truth, exact = json.loads((SESSION1 / "truth.json").read_text()), session.config.accelerometer
    return SimulatedUnit(
        E=np.array(truth["E"]),
        B=np.array(truth["B_dps"]) * DEG,
        accel_matrix=exact.matrix @ np.linalg.inv(matrix),
        accel_bias=matrix @ exact.bias_mps2 + bias_mps2,
        accel_shift=np.zeros(3),
        odr_hz=truth["odr_hz"],
        heading_deg=truth["heading_deg"],
    )


@pytest.fixture(scope="module")
def session1():
    return read_session(SESSION1)


@pytest.fixture(scope="module")
def given(session1):
    return prepare(session1, accelerometer="given").problem


def test_a_given_calibration_that_holds_is_a_prior_and_hardly_moves(session1, given):
    joint = prepare(session1).problem.joint
    assert joint.mode == "prior"
    assert joint.p_value > 0.01
    moved = (joint.x - IDENTITY) / units(GRAVITY)
    assert 0 < np.abs(moved).max() < 0.1 * MG
    assert given.joint is None


@pytest.mark.broad
def test_session1_without_its_calibration_and_with_more_errors_is_as_good(session1):
    """30 mg, 1 % and 5 mrad more, and no [accelerometer]: held out 0.0151 deg with the one given and the bias from the ends."""
    more = np.eye(3) + np.array([[0.01, 0.005, 0], [0, -0.01, 0.005], [0.005, 0, 0.01]])
    zero = 30 * MG * np.array([1.0, -1.0, 1.0])
    result = fit_session(spoilt(session1, more, zero), dataclasses.replace(LEAST_SQUARES, bias="ends"))
    assert tilt_rms(result.linear.held_out) / DEG <= 0.0155
    (errors,) = result.run_errors
    assert np.sqrt(np.mean(errors["least_squares"] ** 2)) / DEG <= 0.040
    assert result.joint_covariance.shape == (21, 21)
    unit = spoilt_unit(session1, more, zero)
    joint = result.problem.joint
    q, _ = triad(unit)
    gyroscope = result.linear.model.vector - LinearModel(q.T @ unit.E, q.T @ unit.B).vector
    error = np.concatenate([errors_of(joint, unit), gyroscope])
    assert np.abs(error / np.sqrt(np.diag(result.joint_covariance))).max() < 4
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 21)
    assert low < error @ np.linalg.solve(result.joint_covariance, error) < high


def test_held_out_turns_are_judged_by_an_accelerometer_that_has_not_seen_them(given):
    problem = recalibrated(given, fit_joint(given, "fit"))
    nothing = np.zeros(len(problem.batch), dtype=bool)
    np.testing.assert_allclose(problem.joint.without(nothing, problem.batch).end, problem.batch.end, atol=1e-12)
    some = nothing.copy()
    some[::5] = True
    apart = problem.joint.without(some, problem.batch)
    assert 1e-8 < np.abs(apart.end - problem.batch.end).max() < 1e-3


@pytest.mark.broad
def test_one_that_no_longer_holds_is_said_and_not_believed(session1):
    wrong = session1.config.accelerometer
    shear = np.eye(3) + np.array([[0.002, 0.001, 0], [0, -0.001, 0], [0, 0, 0]])
    stale = with_accelerometer(session1, dataclasses.replace(wrong, matrix=shear @ wrong.matrix))
    result = fit_session(stale, LEAST_SQUARES)
    said = [w.says for w in result.warnings if w.what == "accelerometer"]
    assert any("no longer agrees" in words and "scale x by -1.7" in words and "nonorthogonality xy by -0.9" in words for words in said)
    assert result.accelerometer.mode == "fit"
    assert tilt_rms(result.linear.held_out) / DEG < 0.0155
    kept = fit_session(stale, dataclasses.replace(LEAST_SQUARES, accelerometer="given"))
    assert kept.accelerometer.mode == "given"
    assert tilt_rms(kept.linear.held_out) / DEG > 0.03


@pytest.mark.broad
@pytest.mark.parametrize("stretched", [(1.002, 1.0, 0.999), (1.12, 1.0, 1.0)])
def test_what_is_prepared_beside_one_that_is_refuted_is_what_would_be_prepared_without_it(session1, stretched):
    """Stills and model that were found with the stale one only show where to look; where it is far off, not even that."""
    wrong = session1.config.accelerometer
    stale = with_accelerometer(session1, dataclasses.replace(wrong, matrix=np.diag(stretched) @ wrong.matrix))
    beside, alone = prepare(stale), prepare(stale, accelerometer="fit")
    assert beside.given is not None
    assert [finding.what for finding in beside.findings[1:]] == [finding.what for finding in alone.findings]
    found, expected = beside.problem, alone.problem
    np.testing.assert_allclose(found.first.vector, expected.first.vector, atol=1e-9)
    np.testing.assert_allclose(found.batch.end, expected.batch.end, atol=1e-9)
    np.testing.assert_allclose(found.floor.sigma, expected.floor.sigma, rtol=1e-6)
    for one, other in zip(found.logs, alone.problem.logs, strict=True):
        np.testing.assert_allclose(one.noise.accel, other.noise.accel, rtol=1e-4)
        assert [(still.start, still.stop) for still in one.stills] == [(still.start, still.stop) for still in other.stills]
        for still, same in zip(one.stills, other.stills, strict=True):
            np.testing.assert_allclose(still.accel_std, same.accel_std, rtol=1e-3)
    sigma = np.sqrt(np.diag(expected.joint.covariance))
    assert np.abs((found.joint.x - expected.joint.x) / sigma).max() < 1e-3


@pytest.mark.parametrize("mode", ["given", "prior"])
def test_none_cannot_be_taken_as_given(session1, mode):
    with pytest.raises(CalibrationError, match=r"session\.toml gives no \[accelerometer\] to take as"):
        prepare(with_accelerometer(session1, Accelerometer(source="none")), accelerometer=mode)


def test_the_command_writes_a_copy_and_leaves_the_recording(tmp_path, capsys):
    folder = shutil.copytree(SESSION1, tmp_path / "s", ignore=shutil.ignore_patterns("fit", "explain"))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert calibrate(["accelerometer", str(folder)]) == 0
    assert "41 stills in 28 attitudes" in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    copy = tmp_path / "s_calibrated"
    assert {path.name for path in copy.iterdir()} == set(before)
    found, was = read_session(copy).config, read_session(folder).config
    assert found.unknown == ()
    assert dataclasses.replace(found, accelerometer=was.accelerometer, truth=was.truth) == was
    np.testing.assert_array_equal(found.accelerometer.matrix, np.triu(found.accelerometer.matrix))
    lengths = np.linalg.norm(found.accelerometer.correct(was.accelerometer.measured(GRAVITY * np.eye(3))), axis=1)
    np.testing.assert_allclose(lengths, GRAVITY, atol=0.1 * MG)
    assert calibrate(["accelerometer", str(folder)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
