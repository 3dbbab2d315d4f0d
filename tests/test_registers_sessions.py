"""Mending whole sessions: rows and times go on from log to log."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table
from spoilt_registers import closed_up, rows_in_turns, session_of_logs, with_losses

from session.detect import bridging
from session.io.samples import Samples
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


def test_a_gap_is_crossed_as_well_as_this_movement_allows_and_the_floor_says_how_well(two):
    """The error that intact places promise is the error at the places that were taken away."""
    (first, table), _ = two
    rows, count = rows_in_turns(table, first, 1, 6), 9
    spoilt, at = with_losses(first, rows, count), closed_up(rows, count)
    order, promised = bridging.best_order(spoilt, at, count)
    back = faulty_readings.with_lost(spoilt, at, count, order)
    missed = [(back.gyro - first.gyro)[row + 1 : row + 1 + count].sum(axis=0) * first.period_s for row in rows]
    assert np.sqrt(np.mean(np.square(missed))) == pytest.approx(promised, rel=0.5)


@pytest.mark.parametrize(("shaking_hz", "noise_dps", "expected"), [(5.0, 0.02, 5), (0.3, 0.5, 1)])
def test_a_rough_hand_asks_for_a_high_order_and_a_noisy_sensor_for_a_low_one(shaking_hz, noise_dps, expected):
    t = np.arange(8000) / 208
    gyro = 100 * DEG * np.sin(2 * np.pi * shaking_hz * t[:, None] + [0, 1, 2])
    gyro += noise_dps * DEG * np.random.default_rng(2).standard_normal(gyro.shape)
    samples = Samples((t * 1e9).astype(np.int64), gyro, np.zeros_like(gyro), None)
    order, missed_rad = bridging.best_order(samples, np.array([4000]), 9)
    assert order == expected
    assert missed_rad > 0.9 * noise_dps * DEG * np.sqrt(9) / 208  # what was not read holds noise of its own
