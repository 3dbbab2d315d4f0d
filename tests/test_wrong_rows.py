"""One wrong row of dial readings, or one turn without its movement, is found, named and left out; the others stand."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from looks import serious

from session.detect.first_look import check_session
from tinygc.closure.build import build_problem

#: of the made sensor, which the fit must give back: rows x, y, z
E_TRUE = np.eye(3) + np.array([[0.03, 0.01, -0.004], [-0.006, -0.02, 0.008], [0.002, -0.01, 0.015]])
TURNS = 12
PLAN = Table().tumble(TURNS, seed=5)


def made_of(samples):
    return session_of(samples, odr_hz=104.0)


@pytest.fixture(scope="module")
def dialled():
    """A session of a gyroscope that is 1 to 3 % off, with dial readings to 0.05°."""
    samples = PLAN.samples(odr_hz=104)
    session = made_of(replace(samples, gyro=samples.gyro @ np.linalg.inv(E_TRUE).T))
    _, attitude = PLAN.truth(np.array([(start + stop) / 2 for start, stop in PLAN.rests]))
    angles = attitude.as_euler("ZYX")[:, ::-1] + np.random.default_rng(3).normal(size=(TURNS + 1, 3)) * 0.05 * DEG
    protocol = replace(session.config.protocol, reference="table")
    return replace(session, config=replace(session.config, protocol=protocol), attitudes=angles)


def typo(row, column, by):
    return lambda angles: angles + by * DEG * np.outer(np.arange(TURNS + 1) == row, np.eye(3)[column])


@pytest.mark.parametrize(
    ("spoil", "rows"),
    [
        (lambda angles: angles, []),
        (typo(4, 1, 10.0), [4]),
        (typo(0, 2, 90.0), [0]),
        (lambda angles: angles[[0, 1, 2, 3, 4, 5, 7, 6, *range(8, TURNS + 1)]], [6, 7]),
    ],
    ids=["none", "pitch", "yaw of the first", "exchanged"],
)
def test_a_wrong_row_is_named_and_left_out_in_check_and_fit(spoil, rows, dialled):
    session = replace(dialled, attitudes=spoil(dialled.attitudes))
    findings = [f for f in check_session(session) if f.what == "dial reading"]
    assert [(f.where, f.level, "left out" in f.description) for f in findings] == [("attitudes.csv", "warning", True)] * len(rows)
    problem = build_problem(session)
    assert {s.number for s in problem.segments if not s.accepted} == {s for row in rows for s in (row - 1, row) if 0 <= s < TURNS}
    np.testing.assert_allclose(problem.first.E, E_TRUE, atol=1.5e-3)


def test_many_wrong_rows_are_another_convention_and_an_accelerometer_may_be_upside_down(dialled):
    """Which another line says: no row of many is taken out by the others."""
    looked = check_session(replace(dialled, attitudes=np.roll(dialled.attitudes, 1, axis=0)))
    assert not [f for f in looked if f.what == "dial reading"]
    assert ("dials against gravity", "warning") in serious(looked)
    (log,) = dialled.logs
    negated = replace(log, samples=log.samples.with_accel(-log.samples.accel))
    (finding,) = (f for f in check_session(replace(dialled, logs=(negated,))) if f.what == "dials against gravity")
    assert (finding.level, "upside down" in finding.description) == ("error", True)
