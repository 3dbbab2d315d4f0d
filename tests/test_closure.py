"""The closure residual: what it is, what it does not depend on, and its derivatives."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import Turns, turned, wxyz
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from session.io.units import DEG
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.models import linear
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet

PERFECT = LinearModel(np.eye(3), np.zeros(3))
RNG = np.random.default_rng(0)


def unit(count, seed=0):
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def yaw(angle):
    return rotation.exp(np.array([0, 0, angle]))


def squared(r):
    return np.sum(r**2, axis=-1)


@pytest.fixture(scope="module")
def turns():
    return Turns(6, seed=4)


@pytest.mark.parametrize("yaw_known", [False, True])
def test_a_perfect_gyro_closes(turns, yaw_known):
    """At 104 Hz from rest to rest, against the attitudes of the smooth movement between the samples."""
    r = closure.segment_residuals(turns.batch(PERFECT, yaw_known), turns.rate)
    assert np.abs(r).max() < 1e-8


@pytest.mark.parametrize("yaw_known", [False, True])
def test_q_and_minus_q_are_one_attitude(yaw_known):
    p, q = unit(50, 1), unit(50, 2)
    r = closure.residual(p, q, yaw_known)
    np.testing.assert_allclose(closure.residual(-p, q, yaw_known), r, atol=1e-15)
    np.testing.assert_allclose(closure.residual(p, -q, yaw_known), r, atol=1e-15)


def test_with_known_yaw_it_is_the_papers_distance():
    p, q = unit(200, 1), unit(200, 2)
    nearer = np.minimum(squared(p - q), squared(p + q))
    np.testing.assert_allclose(squared(closure.residual(p, q, True)), nearer, rtol=1e-12)


@pytest.mark.slow
def test_with_gravity_alone_it_is_the_distance_to_the_nearest_yaw():
    """Brute force over yaw, sharpened by a search, for attitudes at any distance."""
    p, q = unit(30, 3), unit(30, 4)
    for predicted, seen, r in zip(p, q, closure.residual(p, q, False), strict=True):

        def distance(angle, predicted=predicted, seen=seen):
            there = rotation.multiply(yaw(angle), seen)
            return min(squared(predicted - there), squared(predicted + there))

        angles = np.linspace(-np.pi, np.pi, 721)
        best = angles[np.argmin([distance(angle) for angle in angles])]
        found = minimize_scalar(distance, bounds=(best - 0.01, best + 0.01), method="bounded", options={"xatol": 1e-10})
        assert squared(r) == pytest.approx(found.fun, abs=1e-12)


@given(st.floats(-10, 10))
def test_any_yaw_on_the_end_reference_leaves_gravitys_residual(angle):
    p, q = unit(5, 5), unit(5, 6)
    np.testing.assert_allclose(closure.residual(p, rotation.multiply(yaw(angle), q), False), closure.residual(p, q, False), atol=1e-14)


@given(st.floats(-10, 10))
def test_a_table_turned_about_the_vertical_changes_no_length(angle):
    """Start and prediction turn together; the residual turns with them."""
    p, q = unit(5, 5), unit(5, 6)
    for yaw_known in (False, True):
        turned_r = closure.residual(rotation.multiply(yaw(angle), p), rotation.multiply(yaw(angle), q), yaw_known)
        np.testing.assert_allclose(squared(turned_r), squared(closure.residual(p, q, yaw_known)), atol=1e-14)


def test_mounting_does_not_matter(turns):
    """The sensor bolted on in another way: rates and attitudes in other body axes, the same closure."""
    mount = Rotation.random(random_state=3)
    model = LinearModel(np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), np.array([1, -1, 2]) * DEG)
    batch = turns.batch(PERFECT)
    before = closure.segment_residuals(batch, model(batch.rate))
    q_mount = wxyz(mount)
    remounted = replace(batch, start=rotation.multiply(batch.start, q_mount), end=rotation.multiply(batch.end, q_mount))
    after = closure.segment_residuals(remounted, model(batch.rate) @ mount.as_matrix())
    np.testing.assert_allclose(after, before, atol=1e-12)


def test_error_angles_are_exact_however_large():
    vector = RNG.normal(size=(100, 3))
    vector *= (RNG.uniform(0, 179.9, 100) * DEG / np.linalg.norm(vector, axis=1))[:, None]
    reference = unit(100)
    r = closure.residual(rotation.multiply(rotation.exp(vector), reference), reference, True)
    np.testing.assert_allclose(closure.error_angles(r), vector, atol=1e-9)
    level = vector * [1, 1, 0]
    r = closure.residual(rotation.multiply(rotation.exp(level), reference), reference, False)
    np.testing.assert_allclose(closure.error_angles(r), level[:, :2], atol=1e-9)
    assert closure.error_angles(np.zeros((1, 2))).tolist() == [[0, 0]]


def test_small_errors_are_half_the_rotation_vector_to_the_last_digits():
    """No cancellation: an error of 1e-12 rad keeps its digits."""
    reference = unit(20)
    vector = 1e-12 * RNG.normal(size=(20, 3))
    exact = rotation.multiply(rotation.exp(vector), reference)
    r = closure.residual(exact, reference, True)
    np.testing.assert_allclose(r, vector / 2, atol=4e-16)


@pytest.mark.parametrize("yaw_known", [False, True])
@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 1.0])
def test_derivative_exists_at_zero_and_near(yaw_known, size):
    reference = unit(1, 8)[0]
    error = torch.as_tensor(size * np.array([0.6, -0.5, 0.3])).requires_grad_()

    def residual(vector):
        predicted = rotation.multiply(rotation.exp(vector), torch.as_tensor(reference))
        return closure.residual(predicted, torch.as_tensor(reference), yaw_known)

    assert torch.autograd.gradcheck(residual, error, eps=1e-6, atol=1e-8, rtol=1e-6)
    loss_gradient = torch.autograd.grad((residual(error) ** 2).sum(), error)[0]
    assert torch.isfinite(loss_gradient).all()
    if size == 0:
        assert loss_gradient.abs().max() < 1e-15  # the reference is a unit quaternion to rounding only


def test_half_a_turn_upside_down_has_finite_derivatives():
    """No yaw is nearest to a body on its head; the loss must still lead back."""
    error = torch.tensor([np.pi, 0, 0], dtype=torch.float64, requires_grad=True)
    upright = torch.tensor([1.0, 0, 0, 0], dtype=torch.float64)
    loss = (closure.residual(rotation.exp(error), upright, False) ** 2).sum()
    assert torch.isfinite(torch.autograd.grad(loss, error)[0]).all()


def test_sensitivity_is_the_derivative_of_the_end_attitude(turns):
    batch = turns.batch(PERFECT, True)
    model = LinearModel(np.diag([1.01, 0.98, 1.02]), np.array([0.5, -1, 0.3]) * DEG)
    rate = model(batch.rate)
    sensitivity = closure.sensitivity(batch, rate)
    last, h = rate.shape[1] - 1, 1e-4
    end = closure.end_attitude(batch, rate)
    largest = np.abs(sensitivity).max()
    for segment, sample, axis in [(0, 0, 0), (1, 1, 2), (2, 100, 1), (3, 207, 0), (4, 208, 2), (5, last - 1, 1), (0, last, 2), (3, 300, 1)]:
        nudged = rate.copy()
        nudged[segment, sample, axis] += h
        phi = rotation.log(rotation.multiply(closure.end_attitude(batch, nudged), rotation.conjugate(end)))[segment] / h
        # First order: of the step's own angle, rate x dt = a few hundredths.
        np.testing.assert_allclose(phi, sensitivity[segment, sample, :, axis], atol=0.03 * largest)


@pytest.mark.parametrize("yaw_known", [False, True])
def test_linear_columns_are_the_derivatives_of_the_residual(turns, yaw_known):
    """All 12 by finite differences; the trapezoidal sensitivity leaves out products of neighbours, 1e-3 of a column here."""
    batch = turns.batch(PERFECT, yaw_known)
    columns = linear.columns(closure.sensitivity(batch, batch.rate), batch.rate)[:, : batch.angles]
    for parameter in range(linear.PARAMETERS):
        h = np.zeros(12)
        h[parameter] = 1e-5
        plus, minus = (closure.segment_residuals(batch, LinearModel.from_vector(PERFECT.vector + sign * h)(batch.rate)) for sign in (1, -1))
        numeric = 2 * (plus - minus) / 2e-5
        np.testing.assert_allclose(columns[..., parameter], numeric, atol=2e-3 * np.abs(numeric).max())


@pytest.mark.parametrize("yaw_known", [False, True])
def test_network_columns_are_autograds(turns, yaw_known):
    rng = np.random.default_rng(6)
    batch = turns.batch(PERFECT, yaw_known)
    net = CalibrationNet.from_vector(CalibrationNet.identity().vector + 0.02 * rng.normal(size=27))
    # References that the net's own prediction meets: the columns are derivatives at a small residual.
    batch = replace(batch, end=closure.end_attitude(batch, net(batch.rate)))
    columns = net.columns(closure.sensitivity(batch, net(batch.rate))[:, :, : batch.angles], batch.rate)
    rate = torch.as_tensor(batch.rate)

    def residual(vector):
        return 2 * closure.segment_residuals(batch, CalibrationNet.from_vector(vector)(rate))

    exact = torch.autograd.functional.jacobian(residual, torch.as_tensor(net.vector)).numpy()
    scale = np.abs(exact).max(axis=(0, 1))
    assert np.all(np.abs(columns - exact).max(axis=(0, 1)) < 3e-3 * scale + 1e-12)


def test_padding_changes_nothing(turns):
    batch = turns.batch(PERFECT)
    model = LinearModel(np.diag([1.01, 1, 0.99]), np.array([1, 0, -1]) * DEG)
    pad = 37
    padded = replace(
        batch,
        rate=np.concatenate([batch.rate, np.full((len(batch), pad, 3), 5.0)], axis=1),
        dt=np.concatenate([batch.dt, np.zeros((len(batch), pad))], axis=1),
        earth=np.concatenate([batch.earth, np.zeros((len(batch), pad, 3))], axis=1),
    )
    r, padded_r = (closure.segment_residuals(b, model(b.rate)) for b in (batch, padded))
    np.testing.assert_allclose(padded_r, r, atol=1e-14)
    columns, padded_columns = (linear.columns(closure.sensitivity(b, model(b.rate)), b.rate) for b in (batch, padded))
    np.testing.assert_allclose(padded_columns, columns, atol=1e-12)
    np.testing.assert_allclose(padded.duration_s, batch.duration_s, rtol=1e-15)


def test_scale_error_alone_flips_with_the_turn():
    """A pure scale error on a turn there closes with the opposite sign on the turn back about the same horizontal axis."""

    def rate_at(t_s):
        return (1 - np.cos(2 * np.pi * t_s / 3))[:, None] * [0.5, 0, 0]

    t = np.linspace(0, 3, 313)
    there = rate_at(t)
    rate = np.stack([there, -there])
    dt = np.full((2, 312), t[1])
    turn = wxyz(turned(rate_at, 3))
    level = np.array([1.0, 0, 0, 0])
    batch = closure.Batch(rate, dt, 0 * rate, np.stack([level, turn]), np.stack([turn, level]), False)
    r = closure.segment_residuals(batch, 1.01 * rate)
    angle = 3 * 0.5 * 0.01
    np.testing.assert_allclose(closure.error_angles(r), [[angle, 0], [-angle, 0]], atol=1e-9)


def test_the_earths_rate_is_taken_off(turns):
    """A body at rest on the Earth reads its rotation, and closes only with it."""
    earth = np.array([5e-5, 3e-5, -4e-5])
    rate = np.tile(earth, (1, 200, 1))
    still = closure.Batch(rate, np.full((1, 199), 0.1), rate, turns.q[:1], turns.q[:1], True)
    assert np.abs(closure.segment_residuals(still, rate)).max() < 1e-15
    without = replace(still, earth=0 * rate)
    angle = np.linalg.norm(closure.error_angles(closure.segment_residuals(without, rate)))
    assert angle == pytest.approx(19.9 * np.linalg.norm(earth), rel=1e-9)


def test_picking_segments_keeps_their_rows(turns):
    batch = turns.batch(PERFECT)
    picked = batch.pick(np.array([False, True, False, True, False, False]))
    assert len(picked) == 2
    np.testing.assert_array_equal(picked.rate[1], batch.rate[3])
    np.testing.assert_array_equal(picked.end, batch.end[[1, 3]])
    assert batch.angles == 2
    assert replace(batch, yaw_known=True).angles == 3


def test_a_batch_without_its_longest_segment_ends_where_the_others_do(turns):
    """The same attitudes from fewer columns."""
    whole = turns.batch(PERFECT, True)
    pad = ((0, 0), (0, 500))
    padded = replace(
        whole, rate=np.pad(whole.rate, (*pad, (0, 0)), "edge"), dt=np.pad(whole.dt, pad), earth=np.pad(whole.earth, (*pad, (0, 0)))
    )
    cut = padded.trimmed()
    assert cut.rate.shape == whole.rate.shape
    np.testing.assert_array_equal(cut.dt, whole.dt)
    np.testing.assert_allclose(closure.end_attitude(cut, cut.rate), closure.end_attitude(padded, padded.rate), atol=1e-14)
