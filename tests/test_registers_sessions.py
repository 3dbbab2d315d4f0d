"""Mending whole sessions: rows and times go on from log to log."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table
from spoilt_registers import closed_up, rows_in_turns, session_of_logs, with_glitches, with_losses

from session.detect import bridging
from tinygc.closure.build import build_problem
from tinygc.explanation import faulty_readings
from tinygc.explanation.data_repair import repair


@pytest.fixture(scope="module")
def two():
    """Two clean logs of eight turns each, and where in them the turns are."""
    tables = [Table().tumble(8, seed=seed) for seed in (11, 12)]
    return [(table.samples(seed=seed), table) for seed, table in enumerate(tables)]


def test_a_clean_session_has_nothing_to_mend(two):
    problem = build_problem(session_of_logs(*(samples for samples, _ in two)))
    mended = repair(problem)
    assert mended.found == {}
    assert mended.problem is problem


@pytest.mark.broad
def test_false_readings_of_the_second_log_are_counted_after_the_first(two):
    (first, _), (second, table) = two
    rows = rows_in_turns(table, second, 1, 5)
    spoilt = with_glitches(second, rows, np.full(len(rows), 3), 5)
    mended = repair(build_problem(session_of_logs(first, spoilt)))
    assert list(mended.found) == ["data.glitches"]
    parameters, _ = mended.found["data.glitches"]
    assert parameters == {"at": (rows + len(first)).tolist(), "samples": 3}
    log = mended.problem.session.logs
    np.testing.assert_array_equal(log[0].samples.gyro, first.gyro)
    assert np.abs(log[1].samples.gyro - second.gyro).max() < 0.5 * DEG


def test_losses_of_the_second_log_are_timed_after_the_first(two):
    (first, _), (second, table) = two
    rows = rows_in_turns(table, second, 1, 6)[::2]  # twelve turns without a loss: enough for a linear model of their own
    mended = repair(build_problem(session_of_logs(first, with_losses(second, rows, 9))))
    assert list(mended.found) == ["timing.dropped_samples"]
    parameters, _ = mended.found["timing.dropped_samples"]
    assert parameters["length"] == 9
    np.testing.assert_allclose(parameters["at_s"], first.duration_s + second.t_s[rows], atol=0.02)
    assert [len(log.samples) for log in mended.problem.session.logs] == [len(first), len(second)]


def test_a_ceiling_in_one_log_leaves_the_other_logs_segments_alone(two):
    (first, _), (second, _) = two
    clipped = replace(second, gyro=np.clip(second.gyro, -70 * DEG, 70 * DEG))
    problem = build_problem(session_of_logs(first, clipped))
    mended = repair(problem)
    assert list(mended.found) == ["gyro.saturation"]
    assert mended.found["gyro.saturation"][0]["dps"] == pytest.approx(70, rel=2e-3)
    assert [s.number for s in mended.problem.used if s.log == 0] == [s.number for s in problem.used if s.log == 0]
    left = [s for s in mended.problem.used if s.log == 1]
    samples = problem.logs[1].samples
    assert len(left) < 8
    assert all(np.abs(samples.gyro[s.start : s.stop]).max() < 70 * DEG for s in left)


@pytest.mark.slow
def test_losses_in_every_turn_are_counted_without_a_whole_segment(two):
    """No segment is left from which to learn a linear model: each count is judged with its own."""
    (first, table), _ = two
    rows = rows_in_turns(table, first, 1, 6)
    mended = repair(build_problem(session_of_logs(with_losses(first, rows, 9))))
    assert mended.found["timing.dropped_samples"][0]["length"] == 9


def test_a_gap_is_crossed_as_well_as_this_movement_allows_and_the_floor_says_how_well(two):
    """The error that intact places promise is the error at the places that were taken away."""
    (first, table), _ = two
    rows, count = rows_in_turns(table, first, 1, 6), 9
    spoilt, at = with_losses(first, rows, count), closed_up(rows, count)
    order, promised = bridging.best_order(spoilt, at, count)
    back = faulty_readings.with_lost(spoilt, at, count, order)
    missed = [(back.gyro - first.gyro)[row + 1 : row + 1 + count].sum(axis=0) * first.period_s for row in rows]
    assert np.sqrt(np.mean(np.square(missed))) == pytest.approx(promised, rel=0.5)
