"""Short gaps and short peaks beyond the register: what is put in is as near the truth as its sigma says, and no turn is lost."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table, config, session_of

from session.detect.bridging import CLIPPED, GAP, across, best_crossings, bridged, short_gaps
from session.detect.check_samples import BRIDGED
from session.detect.first_look import check_session
from session.log.samples import Samples
from tinygc.closure.build import build_problem
from tinygc.closure.prepared import prepare

SENSOR = config().sensor


def without(samples, rows, count):
    keep = np.ones(len(samples), dtype=bool)
    for row in rows:
        keep[row : row + count] = False
    return Samples(samples.t_ns[keep], samples.gyro[keep], samples.accel[keep], None if samples.temp_c is None else samples.temp_c[keep])


def fast_rows(samples, number, seed, slowest_dps=20.0):
    """Rows within turns, well apart."""
    speed = np.linalg.norm(samples.gyro - np.median(samples.gyro, axis=0), axis=1)
    rows = np.flatnonzero(speed > slowest_dps * DEG)
    rows = np.sort(np.random.default_rng(seed).choice(rows[(rows > 100) & (rows < len(samples) - 100)], number, replace=False))
    return rows[np.concatenate([[True], np.diff(rows) > 25])]


def pulls_of_gaps(samples, count, seeds, number=40):
    """(K, 3): error of the rotation over gaps that are cut into a log, in the sigmas that are stated for it."""
    pulls = []
    for seed in seeds:
        rows = fast_rows(samples, number, seed)
        filled, bridges = bridged(without(samples, rows, count), SENSOR)
        assert len(filled) == len(samples)
        np.testing.assert_allclose(filled.t_s, samples.t_s, atol=0.2 * samples.period_s)
        for bridge in bridges:
            assert (bridge.what, bridge.count) == (GAP, count)
            part = slice(bridge.row, bridge.row + count)
            pulls.append((filled.gyro[part] - samples.gyro[part]).sum(axis=0) * samples.period_s / bridge.sigma_rad)
    return np.array(pulls)


@pytest.mark.parametrize(("count", "odr_hz"), [(1, 52.0), (3, 104.0)])
def test_what_is_put_into_a_gap_is_off_by_as_much_as_is_said(count, odr_hz):
    samples = Table().tumble(24, seed=count).samples(odr_hz=odr_hz)
    pulls = pulls_of_gaps(samples, count, range(6), 40 if odr_hz > 100 else 20)
    assert len(pulls) > 60
    assert np.mean(np.abs(pulls) < 1) == pytest.approx(0.68, abs=0.08)
    assert np.sqrt(np.mean(pulls**2)) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize(("length", "lost"), [(1, False), (3, False), (2, True), (6, True)])
def test_what_an_event_may_hide_is_as_much_as_is_said_whatever_the_others_are(length, lost):
    """False readings 60 deg/s off, or readings that are missing without a trace in the stamps."""
    samples, pulls = Table().tumble(24, seed=length).samples(odr_hz=104.0), []
    for seed in range(6):
        rows = fast_rows(samples, 40, seed)
        gyro, keep = np.array(samples.gyro), np.ones(len(samples), dtype=bool)
        inside = rows[:, None] + np.arange(length)
        gyro[inside] += np.where(np.arange(len(rows)) % 2, 60.0, -60.0)[:, None, None] * DEG
        keep[inside] = not lost
        at = rows - 1 - length * np.arange(len(rows)) if lost else rows
        read = replace(samples, t_ns=samples.t_ns[: keep.sum()], gyro=gyro[keep], accel=samples.accel[keep], temp_c=None)
        for row, true, (order, sigma) in zip(
            at, inside, best_crossings(read, at, np.full(len(at), 0 if lost else length), length), strict=True
        ):
            before, behind = (row, row + 1) if lost else (row - 1, row + length)
            error = across(read.gyro, before, behind, length, order) - samples.gyro[true]
            pulls.append(error.sum(axis=0) * samples.period_s / sigma)
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.25)
    assert np.mean(np.abs(pulls) < 1) == pytest.approx(0.68, abs=0.13)


def test_a_gap_that_is_longer_is_none_of_them_and_a_late_stamp_is_no_gap():
    samples = Table().tumble(6).samples()
    rows = fast_rows(samples, 6, 0)
    assert len(short_gaps(without(samples, rows, 4))[0]) == 0
    late = samples.t_ns.copy()
    late[rows] += round(1.2e9 * samples.period_s)  # as much as a missing sample; the next step is shorter by it
    late[rows + 1] += round(0.3e9 * samples.period_s)
    assert len(short_gaps(replace(samples, t_ns=late))[0]) == 0
    filled, bridges = bridged(samples, SENSOR)
    assert filled is samples
    assert bridges == ()


def peaked(seed, count):
    """A log whose single fastest readings lie beyond a register of ±level, the same clipped there, and the level, dps."""
    true = Table().tumble(20, seed=seed).samples(seed=seed, registers=False, odr_hz=52.0)
    top = np.sort(np.abs(true.gyro).max(axis=1))[-1 - count]
    return true, replace(true, gyro=np.clip(true.gyro, -top, top)), top / DEG


def test_what_stood_beyond_the_register_is_estimated_within_its_sigma():
    """A hand's smooth peak: the neighbours tell it; cut at the register's end, never below it."""
    pulls, gains = [], []
    for seed in range(24):
        true, clipped, level = peaked(seed, 1 + seed % 3)
        sensor = replace(SENSOR, model="other", gyro_fs_dps=level)
        filled, bridges = bridged(clipped, sensor)
        for bridge in bridges:
            assert bridge.what == CLIPPED
            part = slice(bridge.row, bridge.row + bridge.count)
            (axis,) = np.flatnonzero(bridge.sigma_rad)
            off = (filled.gyro[part, axis] - true.gyro[part, axis]).sum() * true.period_s
            was = (clipped.gyro[part, axis] - true.gyro[part, axis]).sum() * true.period_s
            pulls.append(off / bridge.sigma_rad[axis])
            gains.append(abs(off) < abs(was))
            assert (np.abs(filled.gyro[part, axis]) > 0.997 * level * DEG).all()
    assert len(pulls) >= 12
    assert 0.55 < np.mean(np.abs(pulls) < 1) < 0.95
    assert np.mean(np.abs(pulls) < 3) > 0.95
    assert np.mean(gains) > 0.6


@pytest.mark.parametrize("true_dps", [100.0, 700.0])
def test_a_jolt_that_the_neighbours_know_nothing_of_may_be_false_or_real(true_dps):
    """The sigma covers both: the reading may be false, and the neighbours right, or the body jerked beyond the register."""
    samples = Table().tumble(8).samples()
    row = int(fast_rows(samples, 5, 1)[2])
    gyro = samples.gyro.copy()
    neighbours = gyro[row, 0]
    gyro[row, 0] = 32767 * 17.5e-3 * DEG
    filled, (bridge,) = bridged(replace(samples, gyro=gyro), SENSOR)
    assert bridge.row == row
    true = neighbours if true_dps == 100 else true_dps * DEG
    assert abs(filled.gyro[row, 0] - true) * samples.period_s < 1.6 * bridge.sigma_rad[0]


def test_no_turn_is_lost_to_a_short_gap_and_each_is_said():
    whole = Table().tumble(9, seed=3).samples(odr_hz=104)
    session = session_of(without(whole, fast_rows(whole, 8, 5, 60.0), 3), odr_hz=104.0)
    problem, before = prepare(session).problem, build_problem(session_of(whole, odr_hz=104.0))
    assert len(problem.used) == 9
    assert {each.cause for each in problem.widened} == {GAP}
    assert all(0 < each.sigma_rad < 0.1 * DEG for each in problem.widened)
    # The floor that noise alone makes is what it was, the weights know of the gaps.
    assert problem.floor.tilt_rms == pytest.approx(before.floor.tilt_rms, rel=0.02)
    touched = [segment.number in {each.segment for each in problem.widened} for segment in problem.used]
    extra = np.trace(problem.floor.own - problem.floor.white, axis1=1, axis2=2)
    assert ((extra > 0) == touched).all()
    findings = {f.what: f for f in check_session(session)}
    assert "missing in" in findings[BRIDGED].description
    assert "none longer than 3 samples" in findings["gaps"].description
