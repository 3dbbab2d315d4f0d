"""The floor: its covariance is that of noise put into every step, every still and every dial, through numeric derivatives by scipy."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import GRAVITY, wxyz
from scipy.spatial.transform import Rotation
from small_turns import TRUE, angles_by_scipy, numeric_jacobian, small_turns, with_known_angles

from session.detect.stills import Noise, Still
from session.io.units import DEG
from tinygc import closure
from tinygc.closure.floor import Floor, closure_floor, gyro_variance, still_tilt_variance

STILL_S = (1.0, 0.5, 2.0, 1.5)
#: of each turn's log: one-sided densities of gyro, rad/s/sqrt(Hz), and accelerometer, m/s^2/sqrt(Hz)
NOISES = [Noise(np.array([4.0, 5.0, 8.0]) * scale * DEG, np.array([5.0, 6.0, 9.0]) * scale) for scale in (1e-3, 1e-3, 2e-3)]
DIAL_RAD, STOP_RAD = 3e-3, 1e-4


def still(q, duration_s):
    zero = np.zeros(3)
    force = Rotation.from_quat(q, scalar_first=True).inv().apply([0, 0, -GRAVITY])
    return Still(0, 312, 0.0, duration_s, zero, zero, force, zero, zero, 25.0)


def made(kind):
    """Two turns that share a still, and one of another log; ``known``: the net angles of the first and the last are stated."""
    batch = small_turns(3, TRUE, kind == "yaw", samples=7)
    batch = with_known_angles(batch) if kind == "known" else batch
    ends = list(pairwise(still(q, duration_s) for q, duration_s in zip([*batch.start, batch.end[-1]], STILL_S, strict=True)))
    ends[2] = (replace(ends[2][0], duration_s=0.25), ends[2][1])
    return batch, ends


def numeric(batch, ends):
    """(S d, S d) rad^2: each source's own variance through the derivatives of the error angles."""
    count, steps = batch.dt.shape
    rate, dt = batch.rate @ TRUE.E.T + TRUE.B - batch.earth, batch.dt[..., None]
    vectors = (rate[:, :-1] + rate[:, 1:]) / 2 * dt + dt**2 / 6 * np.cross(rate[:, :-1], rate[:, 1:])

    def angles(walked, start, end):
        """With rotations (S, T-1, 3) rad before each step, and references (S, 3) rad off about the table's axes."""
        turns = [Rotation.identity()] * count
        for k in range(steps):
            turns = [turn * Rotation.from_rotvec(walked[s, k]) * Rotation.from_rotvec(vectors[s, k]) for s, turn in enumerate(turns)]
        rates = np.repeat(Rotation.concatenate(turns).as_rotvec()[:, None], 2, axis=1)  # for one second: the same rotation
        off = (
            wxyz(Rotation.from_rotvec(by) * Rotation.from_quat(q, scalar_first=True)) for by, q in ((start, batch.start), (end, batch.end))
        )
        once = replace(batch, rate=rates, dt=np.ones((count, 1)), earth=0 * rates, **dict(zip(("start", "end"), off, strict=True)))
        return angles_by_scipy(once, np.r_[np.eye(3).ravel(), np.zeros(3)]).ravel()

    def through(columns, variance):
        """columns (n, 3): shares of three sources, each of a variance (3,), in all that ``angles`` takes."""
        sizes = [count * steps * 3, count * 3, count * 3]
        shapes = [(count, steps, 3), (count, 3), (count, 3)]

        def of(x):
            parts = np.split(columns @ x, np.cumsum(sizes)[:2])
            return angles(*(part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)))

        J = numeric_jacobian(of, np.zeros(3), 1e-4)
        return J @ np.diag(variance) @ J.T

    unit = np.eye(count * steps + 2 * count)
    total = np.zeros((count * batch.angles,) * 2)
    for s in range(count):  # what a step's white noise turns by
        for k in range(steps):
            total += through(np.kron(unit[:, s * steps + k][:, None], np.eye(3)), NOISES[s].gyro ** 2 / 2 * batch.dt[s, k])
    for one in {id(one): one for both in ends for one in both}.values():  # a still's force errs alike along all axes; a dial's yaw
        where = [[both[end] is one for both in ends] for end in (0, 1)]
        noise = NOISES[int(np.flatnonzero(np.any(where, axis=0))[0])]
        tilt = np.mean(noise.accel**2) / 2 / one.duration_s / GRAVITY**2
        column = np.r_[np.zeros(count * steps), np.ravel(where)]
        total += through(np.kron(column[:, None], np.eye(3)), [tilt, tilt, DIAL_RAD**2 if batch.yaw_known else 0.0])
    return total


@pytest.mark.parametrize("kind", ["tilt", "yaw", "known"])
def test_covariance_is_that_of_the_noise_of_steps_stills_dials_and_stops(kind):
    batch, ends = made(kind)
    floor = closure_floor(batch, closure.attitudes(batch, TRUE(batch.rate)), ends, NOISES, DIAL_RAD)
    expected = numeric(batch, ends)
    if kind == "known":  # how well a turn stops at its angle; nothing tells the second one's, whose row is zero and has any variance
        expected[[2, 8], [2, 8]] += STOP_RAD**2
        expected[5], expected[:, 5] = 0, 0
        expected[5, 5] = 1.0
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(floor.dense() / np.outer(scale, scale), expected / np.outer(scale, scale), atol=2e-6)
    assert np.abs(floor.shared[0, 0, 0] / floor.own[0, 0, 0]) > 0.1  # the shared still shows
    assert not floor.shared[1].any()


@pytest.mark.parametrize("count", [1, 2])
def test_the_first_turns_are_as_they_are_among_more(count):
    batch, ends = made("tilt")
    few = batch.pick(slice(0, count))
    floor = closure_floor(few, closure.attitudes(few, TRUE(few.rate)), ends[:count], NOISES[:count], 0.0)
    whole = closure_floor(batch, closure.attitudes(batch, TRUE(batch.rate)), ends, NOISES, 0.0)
    np.testing.assert_allclose(floor.dense(), whole.dense()[: 2 * count, : 2 * count], rtol=1e-12)


def test_walk_over_five_seconds_is_design_s_eight_thousandths():
    """docs/model.md: about 0.008 degrees over 5 s at 5 mdps per root hertz."""
    rate, level = np.zeros((1, 521, 3)), np.array([[1.0, 0, 0, 0]])
    batch = closure.Batch(rate, np.full((1, 520), 5 / 520), rate, level, level, True)
    variance = gyro_variance(batch, closure.attitudes(batch, rate), [Noise(np.full(3, 0.005 * DEG), np.zeros(3))])[0]
    np.testing.assert_allclose(variance, (0.005 * DEG) ** 2 / 2 * 5 * np.eye(3), rtol=1e-9, atol=1e-30)
    np.testing.assert_allclose(np.sqrt(variance[0, 0]) / DEG, 0.008, atol=1e-4)


def test_a_still_s_tilt_is_its_mean_force_s_error_over_gravity():
    """Gravity's direction is the mean's: shifted by an error e across it, by e / g."""
    variance = np.mean(np.array([5.0, 6, 9]) ** 2) * 1e-6 / 2 / 0.5 / GRAVITY**2
    assert still_tilt_variance(still(np.array([1.0, 0, 0, 0]), 0.5), NOISES[0]) == pytest.approx(variance, rel=1e-12)


@pytest.mark.parametrize(("count", "d"), [(1, 2), (2, 3), (4, 2), (4, 3)])
def test_products_with_a_floor_are_those_with_its_dense_matrix(count, d):
    rng = np.random.default_rng(count)
    root, shared = rng.normal(size=(count, d, d)), 0.1 * rng.normal(size=(count - 1, d, d))
    floor = Floor(root @ root.transpose(0, 2, 1), shared)
    expected = np.zeros((count * d, count * d))
    for s in range(count):
        expected[s * d : s * d + d, s * d : s * d + d] = floor.own[s]
        if s + 1 < count:
            expected[s * d : s * d + d, s * d + d : s * d + 2 * d] = shared[s]
            expected[s * d + d : s * d + 2 * d, s * d : s * d + d] = shared[s].T
    np.testing.assert_array_equal(floor.dense(), expected)
    columns = rng.normal(size=(count, d, 12))
    np.testing.assert_allclose(floor.times(columns).reshape(-1, 12), expected @ columns.reshape(-1, 12), atol=1e-13)


def test_sigma_is_alike_for_both_tilts_and_widens_with_their_excess():
    own = np.array([np.diag([1.0, 3.0, 16.0]), np.diag([7.0, 1.0, 25.0])])
    own[:, 0, 1] = own[:, 1, 0] = 0.5
    np.testing.assert_allclose(Floor(own, np.zeros((1, 3, 3)), 1.5).sigma, [[1.5 * np.sqrt(2)] * 2 + [4], [3.0, 3.0, 5]], rtol=1e-12)
    np.testing.assert_allclose(Floor(own[:, :2, :2], np.zeros((1, 2, 2))).sigma, [[np.sqrt(2)] * 2, [2.0] * 2], rtol=1e-12)


def test_what_is_uncertain_of_single_segments_widens_them_and_is_no_noise():
    own = np.array([np.diag([1.0, 3.0]), np.diag([7.0, 1.0])])
    more = np.arange(18.0).reshape(2, 3, 3)
    floor = Floor(own, np.zeros((1, 2, 2)))
    once = floor.widened(more)
    twice = once.widened(more)
    np.testing.assert_array_equal(once.own, own + more[:, :2, :2])
    np.testing.assert_array_equal(twice.own, own + 2 * more[:, :2, :2])
    np.testing.assert_array_equal(twice.wider, 2 * more[:, :2, :2])
    for each in (floor, once, twice):
        np.testing.assert_array_equal(each.white, own)
        assert each.tilt_rms == pytest.approx(np.sqrt((1 + 3 + 7 + 1) / 2))
