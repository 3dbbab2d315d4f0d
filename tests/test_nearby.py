"""The closure near a model without its samples: exact to second order, for some segments, other references and any weights."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from small_turns import PERFECT, angles_by_scipy, small_turns, with_known_angles

from tinygc.attitude import rotation
from tinygc.closure import least_squares
from tinygc.closure.least_squares import LinearEnds, Nearby
from tinygc.models.linear import PARAMETERS, LinearModel

RNG = np.random.default_rng(0)
#: of each parameter: a sensor ten times as bad as usual
WIDE = np.array([0.05] * 9 + [5 * DEG] * 3)
DRAWS = WIDE * RNG.uniform(-1, 1, (5, PARAMETERS))


@pytest.fixture(scope="module", params=["tilt", "tilt and yaw", "a known angle"])
def batch(request):
    """Turns sampled so finely that what the columns leave out lies below the third order; residuals of a milliradian."""
    made = small_turns(5, PERFECT, request.param == "tilt and yaw", noise_rad=1e-3, samples=300)
    return with_known_angles(made, PERFECT) if request.param == "a known angle" else made


def missed(of, exact):
    """Root mean square of what is missed at the drawn models, and at models a tenth as far away."""
    return [np.sqrt(np.mean((of(PERFECT.vector + share * DRAWS) - exact(PERFECT.vector + share * DRAWS)) ** 2)) for share in (1, 0.1)]


def exact_angles(batch):
    return lambda vectors: np.array([angles_by_scipy(batch, vector) for vector in vectors])


def test_the_residual_is_exact_to_second_order(batch):
    """A tenth of the difference leaves a thousandth of the error."""
    nearby = Nearby.about(PERFECT, batch)
    large, small = missed(lambda vectors: 2 * nearby.residuals(vectors), exact_angles(batch))
    assert large < 2e-3
    assert large / small == pytest.approx(1000, rel=0.2)


def test_the_sum_of_squares_is_exact_to_second_order(batch):
    """Where the residual is large beside the change, the root of the sum misses by the third order as well."""
    weight = RNG.uniform(0.5, 2, (len(batch), batch.angles))
    cost = Nearby.about(PERFECT, batch).gathered(weight)
    exact = exact_angles(batch)
    large, small = missed(
        lambda vectors: np.sqrt(cost(vectors)), lambda vectors: np.sqrt(np.sum(exact(vectors) ** 2 / 4 * weight, axis=(1, 2)))
    )
    assert large / small == pytest.approx(1000, rel=0.2)


def test_some_of_the_segments_are_those_of_all_and_as_many_at_once_as_there_is_room_for(batch, monkeypatch):
    which = np.arange(len(batch)) % 3 > 0
    nearby = Nearby.about(PERFECT, batch)
    vectors = PERFECT.vector + 0.1 * DRAWS
    residuals = nearby.residuals(vectors)
    np.testing.assert_allclose(nearby.pick(which).residuals(vectors), residuals[:, which], atol=1e-15)
    monkeypatch.setattr(least_squares, "AT_ONCE", 2)
    np.testing.assert_allclose(nearby.residuals(vectors), residuals, atol=1e-15)


def test_other_references_need_no_sample(batch):
    """What rates turn the body by does not depend on where it began: the ends and the columns of another accelerometer's attitudes."""
    away = [rotation.exp(RNG.normal(0, DEG, (len(batch), 3))) for _ in range(2)]
    bent = replace(batch, start=rotation.multiply(away[0], batch.start), end=rotation.multiply(away[1], batch.end))
    vectors = PERFECT.vector + 0.1 * DRAWS
    turned = Nearby.about(PERFECT, batch).with_references(bent).residuals(vectors)
    np.testing.assert_allclose(turned, Nearby.about(PERFECT, bent).residuals(vectors), atol=1e-13)
    if batch.turns is not None:
        return  # the columns of a known angle are about its own axis
    which = np.arange(len(batch)) % 3 > 0
    rows, anew = LinearEnds.of(PERFECT, batch).rows(bent.pick(which), which), LinearEnds.of(PERFECT, bent)
    np.testing.assert_allclose(rows.columns, anew.columns[which][:, : batch.angles], atol=1e-13)
    np.testing.assert_allclose(rows.angles, angles_by_scipy(bent, PERFECT.vector)[which], atol=1e-12)
    model = LinearModel.from_vector(PERFECT.vector + 0.1 * DRAWS[0])
    np.testing.assert_array_equal(LinearEnds.of(model, batch).rows(batch, np.ones(len(batch), dtype=bool)).vector, model.vector)
