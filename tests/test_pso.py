"""The swarm: a minimiser by itself, then the same answer as least squares; and the short cut that makes it fast."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import Turns, broad

from session.io.units import DEG
from tinygc import closure, read_session
from tinygc.attitude import rotation
from tinygc.attitude.earth import with_heading
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import LinearEnds, Nearby, fit_least_squares
from tinygc.estimation.particle_swarm import START_BOX, fit_pso, minimise
from tinygc.models.linear import PARAMETERS, LinearModel, bias_only

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


@pytest.fixture(scope="module", params=[False, True], ids=["tilt", "tilt and yaw"])
def batch(request):
    """Turns of 200 dps with an Earth."""
    batch = Turns(8, seed=3, odr_hz=208.0).batch(PERFECT, request.param)
    return replace(batch, earth=with_heading(31.03, 30).in_body(closure.attitudes(batch, batch.rate)))


def errors_nearby(batch, share: float) -> np.ndarray:
    """(20, S) rad: by how much the second order misses the residual of models that differ by so much of the swarm's box."""
    rng = np.random.default_rng(0)
    vectors = PERFECT.vector + share * START_BOX * rng.uniform(-1, 1, (20, PARAMETERS))
    exact = [closure.segment_residuals(batch, LinearModel.from_vector(vector)(batch.rate)) for vector in vectors]
    return 2 * np.linalg.norm(Nearby.about(PERFECT, batch).residuals(vectors) - exact, axis=-1)


def test_nearby_models_close_as_they_do_sample_by_sample(batch):
    """Within a thousandth of a degree over a twentieth of the box, in which a fold's swarm begins."""
    assert errors_nearby(batch, 0.05).max() < 1e-3 * DEG


def test_what_the_second_order_leaves_out_is_of_third_order(batch):
    """A tenth of the difference, a thousandth of the error."""
    large, small = (np.sqrt(np.mean(errors_nearby(batch, share) ** 2)) for share in (1.0, 0.1))
    assert 500 < large / small < 2000


def test_nearby_models_of_some_segments_are_those_of_all(batch):
    which = np.arange(len(batch)) % 3 > 0
    vectors = PERFECT.vector + np.linspace(-1e-3, 1e-3, 24).reshape(2, PARAMETERS)
    nearby = Nearby.about(PERFECT, batch)
    np.testing.assert_allclose(nearby.pick(which).residuals(vectors), nearby.residuals(vectors)[:, which], atol=1e-15)


def test_nearby_models_of_padded_segments_are_the_same(batch):
    pad = ((0, 0), (0, 30))
    padded = replace(
        batch,
        rate=np.pad(batch.rate, (*pad, (0, 0)), mode="edge"),
        dt=np.pad(batch.dt, pad),
        earth=np.pad(batch.earth, (*pad, (0, 0))),
    )
    vectors = np.full((1, PARAMETERS), 1e-3) + PERFECT.vector
    short, long = (Nearby.about(PERFECT, each).residuals(vectors) for each in (batch, padded))
    np.testing.assert_allclose(long, short, atol=1e-12)


def other_references(batch):
    """The same turns between attitudes that another accelerometer would have seen: a degree or so away."""
    rng = np.random.default_rng(5)
    away = [rotation.exp(rng.normal(0, DEG, (len(batch), 3))) for _ in range(2)]
    return replace(batch, start=rotation.multiply(away[0], batch.start), end=rotation.multiply(away[1], batch.end))


def test_nearby_models_between_other_references_need_no_sample(batch):
    """What rates turn the body by does not depend on where it began."""
    bent = other_references(batch)
    vectors = PERFECT.vector + np.linspace(-1e-3, 1e-3, 24).reshape(2, PARAMETERS)
    turned = Nearby.about(PERFECT, batch).with_references(bent).residuals(vectors)
    np.testing.assert_allclose(turned, Nearby.about(PERFECT, bent).residuals(vectors), atol=1e-14)


def test_columns_between_other_references_need_no_sample(batch):
    bent, which = other_references(batch), np.arange(len(batch)) % 3 > 0
    turned, anew = LinearEnds.of(PERFECT, batch).rows(bent.pick(which), which), LinearEnds.of(PERFECT, bent)
    np.testing.assert_allclose(turned.columns, anew.columns[which][:, : batch.angles], atol=1e-13)
    exact = 2 * closure.segment_residuals(bent, bent.rate)[which]
    np.testing.assert_allclose(turned.angles, exact, atol=1e-13)


def test_segments_gathered_in_one_form_cost_what_each_does(batch):
    """To third order as well: a tenth of the difference, a thousandth of what the sum of squares misses by."""
    rng, nearby, weight = np.random.default_rng(0), Nearby.about(PERFECT, batch), np.full((len(batch), batch.angles), 1e6)
    draws, gathered, missed = rng.uniform(-1, 1, (20, PARAMETERS)), nearby.gathered(weight), []
    for share in (0.05, 0.005):
        vectors = PERFECT.vector + share * START_BOX * draws
        each = np.sum(nearby.residuals(vectors) ** 2 * weight[0, 0], axis=(1, 2))
        missed.append(np.abs(np.sqrt(gathered(vectors)) - np.sqrt(each)) / np.sqrt(each))
    assert missed[0].max() < 1e-3
    assert missed[1].max() < 1e-5


@pytest.mark.parametrize("scale", [broad(1.0), 1.1, broad(0.8)])
def test_the_swarm_goes_on_where_its_first_look_was_too_coarse(scale):
    """Sensors that are wrong by ten and twenty percent, which is outside of the box: the true model comes back all the same."""
    true = LinearModel(scale * np.eye(3) + 0.01 * np.arange(9).reshape(3, 3), np.array([0.01, -0.02, 0.005]))
    batch = Turns(20, seed=3, odr_hz=104.0).batch(true)
    found = fit_pso(batch, np.full(len(batch), 1e-4), PERFECT, seed=0)
    np.testing.assert_allclose(found.vector, true.vector, atol=1e-5)


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
