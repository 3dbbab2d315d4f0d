"""Impacts: found by the specific force, and weighed down by as much as the closure of their own turns asks for."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, GRAVITY, Table, session_of
from scipy.spatial.transform import Rotation

from session.base.units import G
from session.detect.check_samples import IMPACTS
from session.detect.events import find_impacts
from session.detect.first_look import check_session
from session.log.samples import Samples
from tinygc.closure.build import build_problem, restricted

ODR_HZ = 104.0


TURNS = 24


def hit(seed, missed_deg, turns=(2, 7, 11, 16, 20), jump_g=3.0, odr_hz=ODR_HZ):
    """A log whose given turns end at a stop: 0.1 s before the rest the specific force jumps, and the body turns by ``missed_deg`` about a
    random axis between two readings, of which the gyro sees nothing."""
    table, rng = Table().tumble(TURNS, seed=seed), np.random.default_rng(seed + 1000)
    t_ns = np.rint(np.arange(0, table.duration_s, 1 / odr_hz) * 1e6).astype(np.int64) * 1000
    rate, attitude = table.truth(t_ns * 1e-9)
    force_more = np.zeros_like(rate)
    jolted = attitude.as_quat()
    nyquist = np.sqrt(odr_hz / 2)
    noise = rng.normal(size=(2, *rate.shape)) * nyquist
    for turn in turns:
        row = int((table.rests[turn + 1][0] - 0.1) * odr_hz)
        axis = rng.normal(size=3)
        after = Rotation.from_rotvec(missed_deg * rng.normal() * DEG * axis / np.linalg.norm(axis))
        # What follows starts from where the jolt has left the body.
        before = Rotation.from_quat(jolted[row - 1])
        jolted[row:] = (before * after * before.inv() * Rotation.from_quat(jolted[row:])).as_quat()
        force_more[row] = jump_g * G * (Rotation.from_quat(jolted[row]).inv().apply([0, 0, -1]))
    # A calibration that is not the identity: 1 %, 5 mrad, and a bias.
    error = np.eye(3) + 0.01 * np.random.default_rng(7).normal(size=(3, 3))
    gyro = rate @ error.T + np.multiply((0.5, -0.3, 0.6), DEG) + 5e-3 * DEG * noise[0]
    accel = Rotation.from_quat(jolted).inv().apply([0, 0, -GRAVITY]) + force_more + 6e-4 * noise[1]
    return Samples(t_ns, gyro, accel, 25 + 0.02 * rng.normal(size=len(t_ns))), list(turns)


def problem_of(samples):
    session = session_of(samples, raw=False, odr_hz=ODR_HZ)
    # An ideal table: nothing turns below it.
    site = replace(session.config.site, latitude_deg=None)
    return build_problem(replace(session, config=replace(session.config, site=site)))


def test_an_impact_is_found_where_it_is_and_a_turn_is_none():
    samples, turns = hit(1, 0.5)
    found = find_impacts(samples)
    assert len(found) == len(turns)
    problem = problem_of(samples)
    assert [each.segment for each in problem.widened] == turns
    assert {each.cause for each in problem.widened} == {"impact"}
    assert "impact of 3.0 g" in problem.widened[0].words
    (finding,) = (f for f in check_session(problem.session) if f.what == IMPACTS)
    assert (f"5 of {TURNS} turns hold one" in finding.description, finding.level) == (True, "note")
    assert all(each.jump_g == pytest.approx(3.0, abs=0.05) for each in found)
    assert find_impacts(Table().tumble(TURNS).samples()) == []


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_calibration_and_usual_misfit_are_estimated_with_the_impacts(scale):
    """By the dense covariance of all angles; the factor is that of the residuals over their freedom, and never below 1."""
    rng = np.random.default_rng(2)
    design, variance = rng.normal(size=(9, 2, 3)), rng.uniform(0.5, 2.0, (9, 2))
    angles = scale * np.sqrt(variance) * rng.normal(size=(9, 2)) + design @ [0.5, -1.0, 0.8]
    flat = design.reshape(18, 3)
    whole = np.diag(variance.ravel()) + flat @ flat.T
    square = angles.ravel() @ np.linalg.solve(whole, angles.ravel())
    seen = flat.T @ (flat / variance.reshape(18, 1))
    freedom = 18 - np.trace(seen @ np.linalg.inv(seen + np.eye(3)))
    likelihood, excess = restricted(angles, design, variance)
    assert excess == pytest.approx(max(1.0, square / freedom))
    assert (excess > 1) == (scale > 1)
    expected = -(freedom * np.log(excess) + square / excess + np.linalg.slogdet(whole)[1]) / 2
    assert likelihood == pytest.approx(expected)


def test_an_effect_in_every_turn_is_no_impact():
    """Half of the turns hold a jump of 3 g that did nothing; in the middle the zero steps by half a degree per second."""
    samples, _ = hit(1, 0.0, turns=tuple(range(0, TURNS, 2)))
    gyro = samples.gyro + np.multiply((0.5, -0.4, 0.3), DEG) * (np.arange(len(samples)) > len(samples) / 2)[:, None]
    assert problem_of(replace(samples, gyro=gyro)).widened == ()
