"""The swarm: a minimiser by itself, then the same answer as least squares; and the short cut that makes it fast."""

import numpy as np
import pytest
from conftest import Turns

from session.common.units import DEG
from session.log.folder import read_session
from tinygc import closure
from tinygc.attitude.earth import with_heading
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.preintegration import preintegrate
from tinygc.methods.pso import fit_pso, minimise
from tinygc.models.linear import LinearModel, bias_only
from tinygc.problem.build import build_problem

PERFECT = LinearModel(np.eye(3), np.zeros(3))


def sphere(x):
    return np.sum((x - 0.3) ** 2, axis=-1)


def rosenbrock(x):
    return np.sum(100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2, axis=-1)


def test_it_finds_the_bottom_of_a_bowl_also_outside_its_box():
    best = minimise(sphere, np.zeros(6), np.full(6, 0.1), np.random.default_rng(0))
    np.testing.assert_allclose(best, 0.3, atol=1e-3)


def test_it_follows_rosenbrocks_valley():
    best = minimise(rosenbrock, np.zeros(2), np.full(2, 2.0), np.random.default_rng(1))
    np.testing.assert_allclose(best, 1, atol=0.01)


def test_same_seed_same_swarm_and_another_seed_another():
    first, again, other = (minimise(rosenbrock, np.zeros(3), np.ones(3), np.random.default_rng(seed)) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)


def test_it_never_ends_above_where_it_started():
    """The centre is one of the particles."""
    centre = np.full(4, 0.3)
    assert sphere(minimise(sphere, centre, np.full(4, 10.0), np.random.default_rng(2))) == 0


def test_progress_is_told():
    seen = []
    minimise(sphere, np.zeros(2), np.ones(2), np.random.default_rng(0), progress=lambda step, steps: seen.append((step, steps)))
    assert seen[0][0] == 1
    assert seen[-1][0] <= seen[-1][1]


@pytest.mark.parametrize("yaw_known", [False, True])
def test_windows_give_the_exact_residual(yaw_known):
    """Any linear model within the swarm's box, on turns of 200 dps with an Earth: within 0.003 degrees of integrating every sample."""
    turns = Turns(8, seed=3, odr_hz=208.0)
    batch = turns.batch(PERFECT, yaw_known)
    earth = with_heading(31.03, 30).in_body(closure.attitudes(batch, batch.rate))
    batch = closure.Batch(batch.rate, batch.dt, earth, batch.start, batch.end, yaw_known)
    rng = np.random.default_rng(0)
    E = np.eye(3) + 0.05 * rng.uniform(-1, 1, (20, 3, 3))
    B = 2 * DEG * rng.uniform(-1, 1, (20, 3))
    quick = preintegrate(batch).residuals(E, B)
    for k in range(20):
        exact = closure.segment_residuals(batch, LinearModel(E[k], B[k])(batch.rate))
        assert np.linalg.norm(2 * (quick[k] - exact), axis=-1).max() / DEG < 0.003


def test_windows_of_padded_segments_are_the_same():
    turns = Turns(3, seed=3)
    batch = turns.batch(PERFECT)
    pad = ((0, 0), (0, 30))
    padded = closure.Batch(
        np.pad(batch.rate, (*pad, (0, 0)), mode="edge"),
        np.pad(batch.dt, pad),
        np.pad(batch.earth, (*pad, (0, 0))),
        batch.start,
        batch.end,
        False,
    )
    E, B = np.eye(3)[None] * 1.01, np.full((1, 3), 0.01)
    np.testing.assert_allclose(preintegrate(padded).residuals(E, B), preintegrate(batch).residuals(E, B), atol=1e-12)


@pytest.mark.slow
def test_the_swarm_ends_where_least_squares_does(simulated):
    """A simulated session of 10 turns: the same closure to a thousandth of a degree, and the same every time."""
    problem = build_problem(read_session(simulated()))
    start = bias_only(problem.still_rates.rate[0])
    sigma = problem.floor.sigma
    swarm = fit_pso(problem.batch, sigma, start, seed=0)
    linear = fit_least_squares(problem.batch, sigma, start).model

    def tilt(model):
        angles = closure.error_angles(closure.segment_residuals(problem.batch, model(problem.batch.rate)))
        return np.sqrt(np.mean(np.sum(angles**2, axis=1))) / DEG

    assert tilt(swarm) == pytest.approx(tilt(linear), abs=1e-3)
    np.testing.assert_array_equal(fit_pso(problem.batch, sigma, start, seed=0).vector, swarm.vector)


@pytest.mark.slow
def test_still_rates_count_in_the_swarms_cost(simulated):
    problem = build_problem(read_session(simulated()))
    start = bias_only(problem.still_rates.rate[0])
    linear = fit_least_squares(problem.batch, problem.floor.sigma, start, still_rates=problem.still_rates).model
    swarm = fit_pso(problem.batch, problem.floor.sigma, start, seed=0, still_rates=problem.still_rates)
    np.testing.assert_allclose(swarm.B, linear.B, atol=0.002 * DEG)
