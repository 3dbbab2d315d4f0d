"""The floor against a simulation of what it predicts: noise drawn, integrated, and its covariance counted."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import Turns

from session.detect.stills import Noise, Still
from session.io.units import DEG
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.floor import Floor, closure_floor, gyro_variance, still_tilt_variance
from tinygc.models.linear import LinearModel

PERFECT = LinearModel(np.eye(3), np.zeros(3))
GRAVITY = 9.7946
NOISE = Noise(np.array([4.0, 5.0, 8.0]) * 1e-3 * DEG, np.full(3, 60e-6 * 9.80665))
STILL_S = 1.0
TRIALS = 3000


def still(q):
    """A still of 1 s, by what the floor looks at."""
    zero = np.zeros(3)
    force = rotation.matrix(q).T @ [0, 0, -GRAVITY]
    return Still(0, 312, 0.0, STILL_S, zero, zero, zero, force, zero, zero, 25.0)


@pytest.fixture(scope="module")
def turns():
    return Turns(3, seed=9, odr_hz=52.0)


def made_floor(turns, yaw_known=False, dial=0.0):
    batch = turns.batch(PERFECT, yaw_known)
    stills = [still(q) for q in turns.q]
    ends = list(pairwise(stills))
    return closure_floor(batch, closure.attitudes(batch, batch.rate), ends, [NOISE] * len(batch), dial)


@pytest.fixture(scope="module")
def drawn(turns):
    """Error angles (trials, S, 2) with fresh gyro noise on every sample and accelerometer noise on every still, shared by neighbours."""
    rng = np.random.default_rng(1)
    per_sample = NOISE.gyro * np.sqrt(52 / 2)
    per_still = np.mean(NOISE.accel) / np.sqrt(2) / np.sqrt(STILL_S)
    force = np.einsum("qji,j->qi", rotation.matrix(turns.q), [0, 0, -GRAVITY])
    angles = []
    for _ in range(TRIALS):
        q = rotation.from_gravity(force + per_still * rng.standard_normal(force.shape))
        # Gravity gives no yaw: the true one is put on, so that all trials are about the same table axes.
        q = np.array([closure.nearest_yaw(true, seen) for true, seen in zip(turns.q, q, strict=True)])
        batch = turns.batch(PERFECT, gyro_noise=per_sample * rng.standard_normal(turns.rate.shape), q=q)
        angles.append(closure.error_angles(closure.segment_residuals(batch, batch.rate)))
    return np.array(angles)


def test_covariance_of_the_angles_is_the_floor(turns, drawn):
    """Each entry within 5 standard errors of 3000 trials: variances, correlation of roll and pitch, and of neighbours."""
    floor = made_floor(turns)
    predicted = floor.dense()
    flat = drawn.reshape(TRIALS, -1)
    counted = np.cov(flat.T)
    variance = np.diag(predicted)
    error = np.sqrt((np.outer(variance, variance) + predicted**2) / TRIALS)
    assert np.all(np.abs(counted - predicted) < 5 * error)
    # The test can see what it tests: the shared still shows beyond its error, with the opposite sign.
    assert np.all(np.diagonal(floor.shared, axis1=1, axis2=2) < 0)
    assert np.abs(floor.shared[:, 0, 0]).max() > 3 * error[0, 2]
    assert np.all(np.abs(flat.mean(axis=0)) < 5 * np.sqrt(variance / TRIALS))


@pytest.mark.slow
def test_root_mean_square_tilt_is_what_the_report_says(turns, drawn):
    expected = made_floor(turns).tilt_rms
    assert np.sqrt(np.mean(np.sum(drawn**2, axis=-1))) == pytest.approx(expected, rel=0.03)


@pytest.mark.slow
def test_chi_square_of_the_drawn_angles_has_the_right_mean(turns, drawn):
    inverse = np.linalg.inv(made_floor(turns).dense())
    flat = drawn.reshape(TRIALS, -1)
    chi = np.einsum("ti,ij,tj->t", flat, inverse, flat)
    assert chi.mean() == pytest.approx(6, abs=5 * np.sqrt(12 / TRIALS))


def test_walk_over_five_seconds_is_design_s_eight_thousandths():
    """docs/model.md: about 0.008 degrees over 5 s at 5 mdps per root hertz."""
    rate = np.zeros((1, 521, 3))
    dt = np.full((1, 520), 5 / 520)
    level = np.array([[1.0, 0, 0, 0]])
    batch = closure.Batch(rate, dt, rate, level, level, True)
    white = Noise(np.full(3, 0.005 * DEG), np.zeros(3))
    variance = gyro_variance(batch, closure.attitudes(batch, rate), [white])[0]
    np.testing.assert_allclose(np.sqrt(np.diag(variance)) / DEG, 0.005 / np.sqrt(2) * np.sqrt(5), rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(variance[0, 0]) / DEG, 0.008, atol=1e-4)


def test_still_tilt_shrinks_with_its_length():
    one = still(np.array([1.0, 0, 0, 0]))
    sigma = np.sqrt(still_tilt_variance(one, NOISE))
    assert sigma == pytest.approx(60e-6 * 9.80665 / np.sqrt(2) / np.sqrt(STILL_S) / GRAVITY, rel=1e-9)


def test_dials_replace_gravity_where_the_table_is_the_reference(turns):
    """For the yaw alone: a dial at either end, one of them the neighbour's too.  The tilt stays gravity's."""
    without, with_dial = made_floor(turns, True, 0.0), made_floor(turns, True, 1e-3)
    yaw = np.diag([0.0, 0.0, 1.0])
    np.testing.assert_allclose(with_dial.own - without.own, np.tile(2e-6 * yaw, (3, 1, 1)), atol=1e-18)
    np.testing.assert_allclose(with_dial.shared - without.shared, np.tile(-1e-6 * yaw, (2, 1, 1)), atol=1e-18)
    gravity = made_floor(turns, False, 0.0)
    np.testing.assert_allclose(without.own[:, :2, :2], gravity.own, atol=1e-18)
    np.testing.assert_allclose(with_dial.sigma[:, 2] ** 2, with_dial.own[:, 2, 2])


def test_segments_that_are_no_neighbours_share_nothing(turns):
    batch = turns.batch(PERFECT)
    stills = [(still(a), still(b)) for a, b in zip(turns.q[:-1], turns.q[1:], strict=True)]  # no still twice
    floor = closure_floor(batch, closure.attitudes(batch, batch.rate), stills, [NOISE] * 3)
    assert not floor.shared.any()


@pytest.mark.parametrize("count", [1, 2, 7])
def test_product_without_the_dense_matrix_is_the_product_with_it(count):
    rng = np.random.default_rng(count)
    root = rng.normal(size=(count, 2, 2))
    floor = Floor(root @ root.transpose(0, 2, 1), 0.1 * rng.normal(size=(count - 1, 2, 2)))
    columns = rng.normal(size=(count, 2, 12))
    np.testing.assert_allclose(floor.times(columns).reshape(2 * count, 12), floor.dense() @ columns.reshape(2 * count, 12), atol=1e-13)
    np.testing.assert_array_equal(floor.dense(), floor.dense().T)
    np.testing.assert_allclose(floor.sigma**2, np.repeat(np.trace(floor.own, axis1=1, axis2=2)[:, None] / 2, 2, axis=1))
