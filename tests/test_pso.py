"""The swarm: a minimiser by itself, then the same answer as least squares; and the short cut that makes it fast."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import Turns, broad, wxyz
from scipy.spatial.transform import Rotation
from small_turns import TYPICAL, angles_by_scipy, small_turns, turned_ends, turns_by_scipy

from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.prior import vague
from tinygc.estimation.particle_swarm import fit_pso, minimise
from tinygc.models.linear import LinearModel

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


@pytest.mark.parametrize("scale", [broad(1.0), 1.1, broad(0.8)])
def test_the_swarm_goes_on_where_its_first_look_was_too_coarse(scale):
    """Sensors that are wrong by ten and twenty percent, which is outside of the box: the true model comes back all the same."""
    true = LinearModel(scale * np.eye(3) + 0.01 * np.arange(9).reshape(3, 3), np.array([0.01, -0.02, 0.005]))
    batch = Turns(20, seed=3, odr_hz=104.0).batch(true)
    found = fit_pso(batch, np.full(len(batch), 1e-4), PERFECT, seed=0)
    np.testing.assert_allclose(found.vector, true.vector, atol=1e-5)


def test_on_a_pendulum_the_swarm_leaves_the_start_where_least_squares_holds_hardly_observed_directions():
    """Rates about one axis but for 2 %: least squares keeps at the start what it hardly observes, and so closes worse.  It is no local
    minimum: with the prior alone in place of that, least squares ends where the swarm does."""
    true = LinearModel.from_vector(PERFECT.vector + 8 * TYPICAL * ([1] * 9 + [1 / 8] * 3))
    batch = small_turns(12, yaw_known=True)
    batch = replace(batch, rate=batch.rate * [0.02, 1.0, 0.02], earth=0 * batch.earth)
    begun = Rotation.from_quat(batch.start, scalar_first=True)
    sigma = np.full(len(batch), 3e-3)
    batch = turned_ends(
        replace(batch, end=wxyz(begun * turns_by_scipy(batch, true))), sigma[0] * np.random.default_rng(1).normal(size=(12, 3))
    )
    swarm = fit_pso(batch, sigma, PERFECT, seed=0, prior=PERFECT)
    held = fit_least_squares(batch, sigma, PERFECT)
    free = fit_least_squares(batch, sigma, PERFECT, prior=vague(PERFECT.vector)).model
    rms = {
        name: np.sqrt(np.mean(angles_by_scipy(batch, m.vector) ** 2))
        for name, m in (("swarm", swarm), ("held", held.model), ("free", free))
    }
    assert {"E_xx", "E_zz"} <= set(held.unobserved)
    assert rms["swarm"] < 0.9 * rms["held"]
    assert rms["free"] == pytest.approx(rms["swarm"], rel=1e-3)
