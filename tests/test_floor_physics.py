"""The floor of a closure and the bias' wander: numeric derivatives by scipy, dense densities, quadrature, and their data by hand."""

from dataclasses import replace
from itertools import pairwise
from unittest.mock import patch

import numpy as np
import pytest
from conftest import GRAVITY, config, wxyz
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import block_diag
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from scipy.stats import norm, truncnorm
from small_turns import TRUE, angles_by_scipy, numeric_jacobian, small_turns, with_known_angles

from session.base.units import DEG, DEG_PER_HOUR
from session.detect.stills import Noise, Still
from session.log.samples import Samples
from tinygc.closure import residual
from tinygc.closure.earth import EarthRate
from tinygc.closure.floor import (
    ACCEL_NOISE,
    DIALS,
    GIVEN,
    GRID_RPS,
    GYRO_NOISE,
    SINGLE_SEGMENTS,
    STOPS,
    UNKNOWN,
    BiasInstability,
    BiasWander,
    Floor,
    _other_causes,
    _pieces_at_rest,
    _posterior_of_instability,
    _restricted_likelihood,
    _sideways_columns,
    _step_of_bias,
    bias_instability_of,
    closure_floor,
    estimated,
)
from tinygc.closure.stills import StillSet
from tinygc.inference.noise import wander_covariance

ESTIMATED = _posterior_of_instability(np.zeros(len(GRID_RPS))).source
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
    batch = small_turns(3, TRUE, kind == "yaw", samples=4)
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

    def of(x):
        walked, start, end = np.split(x.reshape(-1, 3), [count * steps, count * steps + count])
        return angles(walked.reshape(count, steps, 3), start, end)

    slopes, unit = numeric_jacobian(of, np.zeros(3 * count * (steps + 2)), 1e-4), np.eye(count * (steps + 2))

    def through(column, variance):
        """column (n,): the share of a source of variance (3,) in all that ``angles`` takes."""
        J = slopes @ np.kron(column[:, None], np.eye(3))
        return J @ np.diag(variance) @ J.T

    total = np.zeros((count * batch.angles,) * 2)
    for s in range(count):  # what a step's white noise turns by
        for k in range(steps):
            total += through(unit[s * steps + k], NOISES[s].gyro ** 2 / 2 * batch.dt[s, k])
    for one in {id(one): one for both in ends for one in both}.values():  # a still's force errs alike along all axes; a dial's yaw
        where = [[both[end] is one for both in ends] for end in (0, 1)]
        noise = NOISES[int(np.flatnonzero(np.any(where, axis=0))[0])]
        tilt = np.mean(noise.accel**2) / 2 / one.duration_s / GRAVITY**2
        column = np.r_[np.zeros(count * steps), np.ravel(where)]
        total += through(column, [tilt, tilt, DIAL_RAD**2 if batch.yaw_known else 0.0])
    return total


@pytest.mark.parametrize("kind", ["tilt", "yaw", "known"])
def test_covariance_is_that_of_the_noise_of_steps_stills_dials_and_stops(kind):
    batch, ends = made(kind)
    floor = closure_floor(batch, residual.attitudes(batch, TRUE(batch.rate)), ends, NOISES, DIAL_RAD)
    expected = numeric(batch, ends)
    if kind == "known":  # how well a turn stops at its angle; nothing tells the second one's, whose row is zero and has any variance
        expected[[2, 8], [2, 8]] += STOP_RAD**2
        expected[5], expected[:, 5] = 0, 0
        expected[5, 5] = 1.0
    scale = np.sqrt(np.diag(expected))
    assert_allclose(floor.dense() / np.outer(scale, scale), expected / np.outer(scale, scale), atol=2e-6)


@pytest.mark.parametrize(("count", "d"), [(1, 2), (4, 3)])
def test_products_with_a_floor_are_those_with_its_dense_matrix(count, d):
    rng = np.random.default_rng(count)
    root, shared = rng.normal(size=(count, d, d)), 0.1 * rng.normal(size=(count - 1, d, d))
    floor = Floor(root @ root.transpose(0, 2, 1), shared)
    expected = block_diag(*floor.own)
    for s, part in enumerate(shared):
        here, there = slice(s * d, s * d + d), slice(s * d + d, s * d + 2 * d)
        expected[here, there], expected[there, here] = part, part.T
    assert_array_equal(floor.dense(), expected)
    columns = rng.normal(size=(count, d, 12))
    assert_allclose(floor.times(columns).reshape(-1, 12), expected @ columns.reshape(-1, 12), atol=1e-13)


def test_what_is_uncertain_of_single_segments_widens_them_and_is_no_noise():
    own = np.array([np.diag([1.0, 3.0]), np.diag([7.0, 1.0])])
    more = np.arange(18.0).reshape(2, 3, 3)
    floor = Floor(own, np.zeros((1, 2, 2)))
    twice = floor.widened(more).widened(more)
    assert_array_equal(twice.own, own + 2 * more[:, :2, :2])
    assert_array_equal(twice.wider, 2 * more[:, :2, :2])
    for each in (floor, twice):
        assert_array_equal(each.white, own)
        assert each.tilt_rms == pytest.approx(np.sqrt((1 + 3 + 7 + 1) / 2))


@pytest.mark.parametrize("kind", ["tilt", "yaw", "known"])
def test_a_floor_is_the_sum_of_its_causes(kind):
    """The gyroscope's noise is its own of each segment; a part keeps its name where segments are widened."""
    batch, ends = made(kind)
    floor = closure_floor(batch, residual.attitudes(batch, TRUE(batch.rate)), ends, NOISES, DIAL_RAD)
    parts = floor.parts
    assert [*parts] == [GYRO_NOISE, ACCEL_NOISE, *{"tilt": [], "yaw": [DIALS], "known": [STOPS]}[kind]]
    assert_allclose(sum(part.dense() for part in parts.values()), floor.dense(), rtol=1e-12, atol=0)
    assert np.abs(parts[GYRO_NOISE].shared).max() < 1e-20
    if kind != "yaw":
        return
    more = np.array([0.0, 1e-6, 0.0])[:, None, None] * np.eye(3)
    wider = floor.widened(more)
    assert_allclose(wider.parts[SINGLE_SEGMENTS].own, more)
    assert_allclose(wider.parts[DIALS].own[:, 2, 2], 2 * DIAL_RAD**2)
    assert_allclose(wider.parts[DIALS].shared[0, 2, 2], -(DIAL_RAD**2))
    assert_allclose(sum(part.dense() for part in wider.parts.values()), wider.dense(), rtol=1e-12, atol=0)


#: a Gauss-Markov process for each octave of correlation times from half a second to 2048 s, each of variance B^2 ln 2 / pi
OCTAVES_S = np.array([0.5, 1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048])


def test_covariance_of_two_moments_is_the_sum_of_its_octaves():
    t_s, B = np.array([3.0, 3.7, 60.0, 7000.0]), 3 * DEG_PER_HOUR
    expected = B**2 * np.log(2) / np.pi * np.exp(-np.abs(np.subtract.outer(t_s, t_s))[..., None] / OCTAVES_S).sum(axis=-1)
    assert_allclose(BiasWander(t_s, B).covariance, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("apart_s", "spans_s"),
    [(5, (2, 8)), (4, (2, 8)), (1, (2, 8)), (0, (2, 2)), (1, (0, 8))],
)
def test_means_over_two_spans_have_the_covariance_of_those_means(apart_s, spans_s):
    """The covariance of moments by rectangles, 500 to a span: exact but for their size."""
    moments = [at + span_s * ((np.arange(500) + 0.5) / 500 - 0.5) for at, span_s in zip((0.0, apart_s), spans_s, strict=True)]
    apart = np.abs(np.subtract.outer(*moments))
    expected = np.log(2) / np.pi * sum(np.exp(-apart / time).mean() for time in OCTAVES_S)
    found = wander_covariance(np.array([0.0, apart_s]), np.array(spans_s), instability_rps=1.0)
    assert found[0, 1] == pytest.approx(expected, rel=2e-5)
    assert found[1, 0] == pytest.approx(found[0, 1], rel=1e-9)


def test_blocks_of_rows_are_the_whole_covariance():
    """Ten moments, each within the span of a neighbour, three rows at a time."""
    t_s, spans_s = np.arange(10.0) ** 1.5, np.linspace(4.0, 9.0, 10)
    whole = wander_covariance(t_s, spans_s, instability_rps=1.0)
    with patch("tinygc.inference.noise.ROWS_TOGETHER", 3):
        assert_allclose(wander_covariance(t_s, spans_s, instability_rps=1.0), whole, rtol=1e-12)


@pytest.mark.parametrize(
    ("dph", "sigma_dph", "most_dph", "words"),
    [
        (6.2, 1.9, 9.0, f"6.2 ± 1.9 °/h, {ESTIMATED}"),
        (26.7, 9.6, 50.0, f"27 ± 10 °/h, {ESTIMATED}"),  # two digits of a sigma that rounds to 10
        (0.5, 0.012, 50.0, f"0.500 ± 0.012 °/h, {ESTIMATED}"),
        (3.0, 1.5, 5.49, f"3.0 ± 1.5 °/h, {ESTIMATED}, whose stills do not show it: less than 5.5 °/h (95 %)"),  # two sigmas do not
        (3.001, 1.5, 5.49, f"3.0 ± 1.5 °/h, {ESTIMATED}"),
    ],
)
def test_an_estimated_instability_says_what_it_knows(dph, sigma_dph, most_dph, words):
    known = BiasInstability(dph * DEG_PER_HOUR, ESTIMATED, sigma_dph * DEG_PER_HOUR, most_dph * DEG_PER_HOUR)
    assert known.words == words
    assert list(known.to_json().values()) == [pytest.approx(dph), pytest.approx(sigma_dph), ESTIMATED]


def test_another_instability_says_where_it_is_from():
    given, unknown = BiasInstability(7.5 * DEG_PER_HOUR, "given"), BiasInstability(0.0, UNKNOWN)
    assert (given.words, unknown.words) == ("7.5 °/h, given", UNKNOWN)
    assert list(given.to_json().values()) == [pytest.approx(7.5), None, "given"]
    assert list(unknown.to_json().values()) == [None, None, UNKNOWN]


@pytest.mark.parametrize(("at", "width"), [(0, 3), (30, 8)])
def test_posterior_is_the_likelihood_integrated_under_a_flat_prior_from_zero_on(at, width):
    found = _posterior_of_instability(-(((GRID_RPS / DEG_PER_HOUR - at) / width) ** 2) / 2 - 1000)
    exact = truncnorm(-at / width, np.inf, at, width)
    assert found.rps / DEG_PER_HOUR == pytest.approx(exact.mean(), rel=1e-4)
    assert found.sigma_rps / DEG_PER_HOUR == pytest.approx(exact.std(), rel=1e-4)
    assert found.most_rps / DEG_PER_HOUR == pytest.approx(exact.ppf(0.95), rel=0.01)
    assert (found.source, found.of_unit) == (ESTIMATED, True)
    anything = _posterior_of_instability(np.zeros(len(GRID_RPS)))  # uniform up to 300
    found = np.array([anything.rps, anything.sigma_rps, anything.most_rps]) / DEG_PER_HOUR
    assert found == pytest.approx([150, 300 / np.sqrt(12), 285], rel=0.005)


def rates_of_stills(count):
    """Mean rates (N, 3), their white variances (N, 3) and the wander's covariance (N, N) for B = 1 rad/s, of ten degrees an hour."""
    rng = np.random.default_rng(0)
    t_s = np.cumsum(rng.uniform(5, 60, count))
    flicker = wander_covariance(t_s, np.full(count, 2.0), instability_rps=1.0)
    white = (rng.uniform(1, 6, (count, 3)) * DEG_PER_HOUR) ** 2
    root = [np.linalg.cholesky(np.diag(white[:, axis]) + (10 * DEG_PER_HOUR) ** 2 * flicker) for axis in range(3)]
    rate = np.stack([each @ rng.standard_normal(count) for each in root], axis=1) + 100 * DEG_PER_HOUR
    return t_s, rate, white, flicker


def test_innovations_of_an_outlier_are_twenty_times_as_wide_in_one_case_of_fifty():
    """Two columns; their coefficients maximise the mixture's likelihood, whose information the weights of the innovations are."""
    t_s, _, white, flicker = rates_of_stills(5)
    y = 100 * DEG_PER_HOUR + np.sqrt(white[:, 1]) * [0.5, -1.2, 0.3, 12.0, -0.6]
    columns = np.stack([np.ones(5), t_s / t_s[-1]], axis=1)
    found = _restricted_likelihood(y, columns, white[:, 1], flicker)
    for k in (0, 10, 40):
        factor = np.linalg.cholesky(np.diag(white[:, 1]) + GRID_RPS[k] ** 2 * flicker)
        whitened, A = np.linalg.solve(factor, y), np.linalg.solve(factor, columns)

        def mixture(b, whitened=whitened, A=A):
            left = whitened - A @ b * DEG_PER_HOUR
            return 0.98 * norm.pdf(left), 0.02 * norm.pdf(left, scale=20)

        best = minimize(lambda b, mixture=mixture: -np.sum(np.log(np.sum(mixture(b), axis=0))), [100.0, 0.0], tol=1e-9)
        usual, wild = mixture(best.x)
        weight = (usual + wild / 400) / (usual + wild)
        value = -best.fun + 2.5 * np.log(2 * np.pi) - np.log(np.diag(factor)).sum() - np.linalg.slogdet(A.T * weight @ A)[1] / 2
        assert found[k] == pytest.approx(value, abs=1e-3)


def test_a_step_is_the_moment_at_which_chi_square_falls_most_by_more_than_twenty_five():
    """Chi-square with and without the step's column, by dense generalised least squares, summed over the axes."""
    _, rate, white, flicker = rates_of_stills(7)
    wander = (3 * DEG_PER_HOUR) ** 2 * flicker
    columns = [np.ones((7, 1)), np.ones((7, 1)), np.stack([np.ones(7), np.arange(7.0) ** 2], axis=1)]
    after = (np.arange(7) >= 4).astype(float)
    rate = rate + 40 * DEG_PER_HOUR * after[:, None] * [1, -2, 0]

    def chi_square(size, step):
        total = 0.0
        for axis in range(3):
            factor = np.linalg.cholesky(np.diag(white[:, axis]) + wander)
            A = np.linalg.solve(factor, np.column_stack([columns[axis], *step]))
            total += np.linalg.lstsq(A, np.linalg.solve(factor, size * rate[:, axis]))[1].sum()
        return total

    gains = [chi_square(1.0, []) - chi_square(1.0, [(np.arange(7) >= k).astype(float)]) for k in range(1, 7)]
    assert np.argmax(gains) == 3
    just = np.sqrt(25 / max(gains))
    assert _step_of_bias(0.9999 * just * rate, columns, white, wander) is None
    assert_array_equal(_step_of_bias(1.0001 * just * rate, columns, white, wander), after)
    assert _step_of_bias(rate[:1], [np.zeros((1, 0))] * 3, white[:1], wander[:1, :1]) is None


def test_a_rate_fixed_in_the_table_shows_on_each_axis_as_its_attitude_has_it():
    turns = Rotation.random(4, random_state=1)
    group = np.array([3, 3, 5, 5])
    level = np.array([0.4, -0.7, 0.0]), np.array([-0.2, 0.1, 0.0])  # in the table, of each yaw group
    body = np.stack([turn.inv().apply(level[int(g == 5)]) for turn, g in zip(turns, group, strict=True)])
    for axis in range(3):
        columns = _sideways_columns(turns.as_quat(scalar_first=True), group, axis)
        assert_allclose(columns @ [0.4, -0.7, -0.2, 0.1], body[:, axis], atol=1e-14)


def span(*columns):
    u, s, _ = np.linalg.svd(np.column_stack(columns), full_matrices=False)
    return u[:, s > 1e-8 * s[0]]


@pytest.mark.parametrize(
    ("count", "taken"),
    [(34, "012345"), (33, "01234"), (23, "0123"), (18, "0134"), (8, "03"), (7, "0")],
)
def test_other_causes_are_taken_in_order_up_to_half_the_number_of_pieces(count, taken):
    """A bias of each log and the steps; gravity's direction; a table-fixed rate; drift; temperature; products of gravity's direction."""
    rng = np.random.default_rng(count)
    log, t_s, temp_c = np.arange(count) % 2, np.arange(count) * 7.0, rng.normal(size=count) * 5 + 20
    down, side, step = rng.normal(size=(count, 3)), rng.normal(size=(count, 4)), (np.arange(count) > 3)[:, None] * 1.0
    x, y, z = (down / np.linalg.norm(down, axis=1, keepdims=True)).T
    down = np.stack([x, y, z], axis=1)
    made = [[log == 0, log == 1, step], [down], [side], [t_s], [temp_c], [x * x, y * y, x * y, x * z, y * z]]
    found = _other_causes(log, t_s, down, side, temp_c, step)
    expected = span(*(column * 1.0 for block in taken for column in made[int(block)]))
    assert_allclose(found.T @ found, np.eye(found.shape[1]), atol=1e-12)
    assert_allclose(found @ found.T, expected @ expected.T, atol=1e-8)


def test_a_thermometer_that_hardly_moves_or_is_not_there_tells_nothing():
    t_s, none = np.arange(40.0), np.zeros((40, 0))
    down = np.tile([0.0, 0.0, 1.0], (40, 1))
    for range_c, told in ((0.4999, 0), (0.5001, 1), (np.nan, 0)):
        temp_c = 20 + range_c * (np.arange(40) % 2)
        assert _other_causes(np.zeros(40), t_s, down, none, temp_c, none).shape == (40, 2 + told)  # a bias, a drift


def rests():
    """Two logs of 100 Hz: a still of 1.2 s, one of 9 s, one that is no reference, one with a bump inside; the second has one of 3 s."""
    rng, logs = np.random.default_rng(4), []
    for number, spans in enumerate((((0, 120), (200, 1100), (1200, 1300), (1400, 1700)), ((50, 350),))):
        rows = spans[-1][1] + 100
        t_ns = (np.arange(rows) * 10_000_000 + 5_000_000_000).astype(np.int64)
        samples = Samples(t_ns, rng.normal(size=(rows, 3)), rng.normal(size=(rows, 3)), rng.normal(size=rows))
        stills = []
        for k, (a, b) in enumerate(spans):
            force, none = rng.normal(size=3) * 9, np.zeros(3)
            still = Still(a, b, a * 0.01, (b - a) * 0.01, rng.normal(size=3), none, force, none, none, 21.0 + k, bumps=int(k == 3))
            stills.append(replace(still, problem="creeps" if k == 2 else None))
        noise = Noise(np.array([1.0, 2, 3]) * (number + 1), np.ones(3))
        q_tb = Rotation.random(len(spans), random_state=number).as_quat(scalar_first=True)
        logs.append(StillSet(samples, stills, noise, q_tb, np.arange(len(spans))))
    return logs


def test_a_still_is_taken_without_its_ends_and_a_long_one_in_parts_of_four_seconds():
    logs = rests()
    pieces = list(_pieces_at_rest(0, logs))
    assert [round(piece[3], 9) for piece in pieces] == [0.8, 4.3, 4.3, 3.0]  # a fifth of a second less at both ends; two of 8.6 s
    part, still = slice(650, 1080), logs[0].stills[1]
    rate, down = logs[0].samples.gyro[part].mean(axis=0), still.accel_mean / np.linalg.norm(still.accel_mean)
    walk, temp_c = np.array([1, 2, 3]) / np.sqrt(2), logs[0].samples.temp_c[part].mean()
    expected = (rate, 0, (650 + 1079) / 2 * 0.01, 4.3, walk, down, logs[0].q_tb[1], 1, temp_c)
    for found, value in zip(pieces[2], expected, strict=True):
        assert_allclose(found, value)
    rate, _, middle_s, *_, group, temp_c = pieces[3]  # readings of a bump are none of its mean
    assert_array_equal(rate, logs[0].stills[3].gyro_mean)
    assert (middle_s, group, temp_c) == (pytest.approx(15.5), 3, 24.0)
    ((_, number, middle_s, *_),) = _pieces_at_rest(1, logs)  # a later log lies behind the former
    assert (number, middle_s) == (1, pytest.approx(17.99 + 0.01 * (70 + 329) / 2))
    long = replace(logs[1].stills[0], start=0, stop=4000, duration_s=4000.0)
    slow = Samples(np.arange(4000) * 10**9, np.zeros((4000, 3)), np.zeros((4000, 3)))
    assert len(list(_pieces_at_rest(0, [replace(logs[1], samples=slow, stills=[long])]))) == 300  # however long it rests
    short = replace(logs[1].stills[0], stop=50 + 42, duration_s=0.42)
    ((rate, *_),) = _pieces_at_rest(1, [logs[0], replace(logs[1], stills=[short])])
    assert_allclose(rate, logs[1].samples.gyro[60:82].mean(axis=0))  # a quarter at each end


@pytest.mark.parametrize(("source", "steps"), [("estimated", 0), ("unknown", 0), ("given", 3), ("given", 4)])
def test_the_estimate_is_the_posterior_over_all_axes_without_other_causes(source, steps):
    """Put together from its parts: rates less the Earth's, white variances of their spans, columns, likelihoods of three axes.

    A fourth step of the bias is taken for wander."""
    rng, count, none = np.random.default_rng(8), 28, np.zeros(3)
    q = Rotation.random(count, random_state=3)
    earth = EarthRate(np.array([3.0, 1.0, -4.0]) * 10 * DEG_PER_HOUR, 0.3, 0.1, source)
    own, down = q.inv().apply(earth.rate_t), q.inv().apply([0, 0, -1.0])
    after = (np.arange(count)[:, None] >= (5, 11, 17, 23)[:steps]) * 1.0
    wander_dph = 15 * rng.normal(size=(count, 3)) + [50, 0, 0] + 1000 * (after @ [1, -2, 3, -3][:steps])[:, None]
    gyro = rng.normal(size=(count, 200, 3)) * 60 * DEG_PER_HOUR
    gyro[:, :150] += (own + wander_dph * DEG_PER_HOUR)[:, None]
    rate, middles = gyro[:, 20:130].mean(axis=1) - own, 2.0 * np.arange(count) + 0.745
    stills = [Still(200 * k, 200 * k + 150, 2.0 * k, 1.5, none, none, 9.8 * down[k], none, none, 25.0) for k in range(count)]
    noise, gyro = Noise(np.array([1.0, 1.2, 0.9]) * 60 * DEG_PER_HOUR * np.sqrt(0.02), np.ones(3)), gyro.reshape(-1, 3)
    samples = Samples(np.arange(len(gyro)) * 10_000_000, gyro, gyro, np.full(len(gyro), 25.0))
    log = StillSet(samples, stills, noise, q.as_quat(scalar_first=True), np.zeros(count, dtype=int))
    white, flicker = noise.gyro**2 / 2 / 1.1, wander_covariance(middles, np.full(count, 1.1), instability_rps=1.0)
    total = 0
    for axis in range(3):
        side = _sideways_columns(log.q_tb, log.group, axis)[:, : 2 * (source == "unknown")]
        columns = _other_causes(np.zeros(count), middles, down, side, np.full(count, 25.0), after)
        total = total + _restricted_likelihood(rate[:, axis], columns, np.full(count, white[axis]), flicker)
    expected, found = _posterior_of_instability(total), estimated([log], {0: earth})
    if steps == 4:
        assert found.rps > 5 * expected.rps
        return
    assert found.rps / DEG_PER_HOUR == pytest.approx(expected.rps / DEG_PER_HOUR, rel=1e-6)
    assert found.sigma_rps == pytest.approx(expected.sigma_rps, rel=1e-6)
    # Less than nine degrees of freedom of all axes together are no estimate; a bias and a drift leave N - 2 of each.
    few = [estimated([replace(log, stills=stills[:n], q_tb=log.q_tb[:n], group=log.group[:n])], {0: earth}) for n in (0, 4, 5)]
    assert [(each.source, each.rps > 0) for each in few] == [(UNKNOWN, False), (UNKNOWN, False), (ESTIMATED, True)]


def test_given_comes_before_typical():
    sensor = config().sensor
    for dph, is_dph, source in ((None, 3.0, "typical of ASM330LHH"), (7.5, 7.5, GIVEN)):
        found = bias_instability_of(replace(sensor, gyro_bias_instability_dph=dph), [], {})
        assert (found.source, found.sigma_rps, found.of_unit) == (source, None, False)
        assert found.rps == pytest.approx(is_dph * DEG_PER_HOUR)
    assert bias_instability_of(replace(sensor, model="another"), [], {}).source == UNKNOWN
