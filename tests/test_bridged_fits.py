"""Calibrations from logs with gaps and clipped peaks: within their sigmas, which know of what was bridged."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, GRAVITY, Table, session_of

from session.detect.check_samples import with_bridges
from session.io.samples import Samples
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.problem import Problem
from tinygc.closure.uncertainty import parameter_covariance

ODR_HZ, TURNS, SEEDS = 26.0, 24, 20
ERROR = np.eye(3) + 0.01 * np.random.default_rng(7).normal(size=(3, 3))
BIAS = np.multiply((0.5, -0.3, 0.6), DEG)
TRUTH = np.concatenate([np.linalg.inv(ERROR).ravel(), -np.linalg.solve(ERROR, BIAS)])


def recorded(seed: int) -> Samples:
    """Quick turns at a low data rate: what is between two readings matters beside the noise."""
    table, rng = Table().tumble(TURNS, turn_s=2.0, seed=seed), np.random.default_rng(seed)
    t_ns = np.rint(np.arange(0, table.duration_s, 1 / ODR_HZ) * 1e6).astype(np.int64) * 1000
    rate, attitude = table.truth(t_ns * 1e-9)
    noise = rng.normal(size=(2, *rate.shape)) * np.sqrt(ODR_HZ / 2)
    gyro = rate @ ERROR.T + BIAS + 5e-3 * DEG * noise[0]
    accel = attitude.inv().apply([0, 0, -GRAVITY]) + 6e-4 * noise[1]
    return Samples(t_ns, gyro, accel, 25 + 0.02 * rng.normal(size=len(t_ns)))


def problem_of(samples: Samples, **sensor) -> Problem:
    session = session_of(samples, raw=False, odr_hz=ODR_HZ)
    config = replace(session.config, site=replace(session.config.site, latitude_deg=None), sensor=replace(session.config.sensor, **sensor))
    return build_problem(with_bridges(replace(session, config=config)))


def pulls_of(problem: Problem, floor=None) -> np.ndarray:
    """(12,) errors of the parameters in their sigmas, by a floor (the problem's)."""
    floor = floor or problem.floor
    fit = fit_least_squares(problem.batch, floor.sigma, problem.first)
    return (fit.model.vector - TRUTH) / np.sqrt(np.diag(parameter_covariance(problem.batch, floor, fit.model, problem.earth)))


def gapped(seed: int) -> Problem:
    """Three samples are missing in the middle of every third turn."""
    samples = recorded(seed)
    keep = np.ones(len(samples), dtype=bool)
    for turn in range(0, TURNS, 3):
        row = int((2.0 + turn * 4.0 + 0.8) * ODR_HZ)
        keep[row : row + 3] = False
    return problem_of(Samples(samples.t_ns[keep], samples.gyro[keep], samples.accel[keep], samples.temp_c[keep]))


def clipped(seed: int) -> Problem:
    """The register ends where the two fastest readings of the log are beyond it."""
    samples = recorded(seed)
    end = np.sort(np.abs(samples.gyro).ravel())[-3]
    return problem_of(replace(samples, gyro=np.clip(samples.gyro, -end, end)), model="other", gyro_fs_dps=end / DEG)


@pytest.mark.slow
def test_parameters_from_logs_with_gaps_are_within_their_sigmas():
    pulls, careless = [], []
    for seed in range(SEEDS):
        problem = gapped(seed)
        assert len(problem.used) == TURNS
        assert len(problem.widened) == TURNS // 3
        pulls.append(pulls_of(problem))
        careless.append(pulls_of(problem, replace(problem.floor, own=problem.floor.white, wider=None)))
    assert np.mean(np.abs(pulls) < 1) == pytest.approx(0.68, abs=0.08)
    assert np.sqrt(np.mean(np.square(pulls))) < 1.2
    assert np.sqrt(np.mean(np.square(careless))) > np.sqrt(np.mean(np.square(pulls)))


@pytest.mark.slow
def test_parameters_from_logs_with_clipped_peaks_are_within_their_sigmas():
    pulls, found = [], 0
    for seed in range(SEEDS):
        problem = clipped(seed)
        found += bool(problem.widened)
        pulls.append(pulls_of(problem))
    assert found > SEEDS / 2
    assert np.mean(np.abs(pulls) < 1) == pytest.approx(0.68, abs=0.08)
    assert np.sqrt(np.mean(np.square(pulls))) < 1.2
