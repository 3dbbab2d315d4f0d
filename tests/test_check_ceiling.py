"""A ceiling far below the full scale, and axes that die within a log."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from looks import G, look, of

from session.detect.first_look import first_look


@pytest.mark.parametrize("level_dps", [26.0, 50.0])
def test_a_ceiling_far_below_the_turns_is_said_and_neither_scale_nor_stills_are_blamed(good, level_dps):
    gyro = good.logs[0].samples.gyro
    findings = look(good, gyro=np.clip(gyro, -level_dps * DEG, level_dps * DEG))
    (error,) = [finding for finding in findings if finding.level == "error"]
    assert error.what == "gyro ceiling"
    assert f"±{level_dps:g} dps" in error.says
    assert error.says.startswith("x, y")
    assert {"gyro scale", "axes", "gyro against gravity"}.isdisjoint(finding.what for finding in findings)


def test_a_ceiling_without_stills_is_the_ceilings_fault(good):
    samples = good.logs[0].samples
    clipped = np.clip(samples.gyro, -26 * DEG, 26 * DEG)
    log = replace(good.logs[0], samples=replace(samples, gyro=clipped))
    findings = first_look(replace(good, logs=(log,)), log, [], None)
    assert [finding.what for finding in findings if finding.level == "error"] == ["gyro ceiling"]


def test_a_ceiling_that_few_turns_reach_leaves_the_others_to_be_looked_at(good):
    gyro = good.logs[0].samples.gyro
    level = 0.9 * np.abs(gyro).max()
    findings = look(good, gyro=np.clip(gyro, -level, level))
    assert of(findings, "gyro scale").level == "ok"
    assert "error" not in {finding.level for finding in findings}


@pytest.mark.parametrize(("axis", "column"), [(0, "gx"), (2, "gz")])
def test_an_axis_that_dies_is_named_with_its_row_and_time(good, axis, column):
    samples = good.logs[0].samples
    gyro = samples.gyro.copy()
    row = 2 * len(gyro) // 3
    gyro[row:, axis] = 0.0
    dead = of(look(good, gyro=gyro), "gyro dead")
    assert dead.level == "error"
    assert f"{column} reads 0 dps from row {row} to row {len(gyro) - 1}" in dead.says
    assert f"{samples.t_s[row]:.1f} to {samples.t_s[-1]:.1f} s" in dead.says


def test_an_accelerometers_axis_that_dies_for_two_seconds_is_named(good):
    samples = good.logs[0].samples
    accel = samples.accel.copy()
    row, count = len(accel) // 2, round(2 / samples.period_s)
    accel[row : row + count, 1] = accel[row - 1, 1] + 1e-3 * G
    dead = of(look(good, accel=accel), "accelerometer dead")
    assert f"ay reads {accel[row, 1] / G:.4g} g from row {row} to row {row + count - 1}" in dead.says


def test_a_log_that_is_coarser_than_its_noise_is_not_dead(good):
    """Rates in whole degrees per second: every still is one value, on all axes."""
    gyro = np.round(good.logs[0].samples.gyro / DEG) * DEG
    assert "gyro dead" not in {finding.what for finding in look(good, gyro=gyro)}


def test_half_a_second_of_one_value_is_no_death(good):
    samples = good.logs[0].samples
    gyro = samples.gyro.copy()
    row = len(gyro) // 2
    gyro[row : row + round(0.5 / samples.period_s), 0] = gyro[row, 0]
    assert "gyro dead" not in {finding.what for finding in look(good, gyro=gyro)}
