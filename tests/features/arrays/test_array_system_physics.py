"""The array's linear system: derivatives by finite differences, variances and priors by hand, its solution by dense matrices."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG, wxyz
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from small_array import FORCE_WALK, STILL_S, TURN_S, WALK, G, small_array
from small_turns import numeric_jacobian, turns_by_scipy

from session.base.units import EARTH_RATE_RPS, MG
from session.base.units import G as STANDARD_G
from session.detect.accelerometer import IDENTITY, SPREAD_MPS2, matrix_of
from tinygc.closure.earth import estimate_heading, with_heading
from tinygc.closure.joint import GIVEN_SIGMA_MG
from tinygc.features.arrays.system import (
    GYROSCOPE,
    HELD,
    Layout,
    System,
    accelerometer_after,
    array_system,
    common_earth,
    force_problem,
    unit_rows,
    with_earth,
)
from tinygc.models.linear import BIAS, LinearModel

# Rows.


#: a unit that turns from still to still, and one whose first turn spans two intervals
TURNS = [[(0, 1), (1, 2), (2, 3)], [(0, 2), (2, 3)]]


LAYOUT = Layout.of([3, 2], [4, 4], 4)


MISSED_RAD = np.array([0.01, 0.02, 0.03])


def prepared(small, state=None, bias="ends"):
    rows = [unit_rows(unit, i, small.same, bias) for i, unit in enumerate(small.units)]
    state = state or small.truth
    parts = zip(rows, state.models, state.mountings, strict=True)
    return [with_earth(unit, model, M, state, small.same.group, {0: small.earth}) for unit, model, M in parts]


@pytest.fixture(scope="module")
def small():
    return small_array(turns=TURNS)


@pytest.fixture(scope="module")
def rows(small):
    return prepared(small)


@pytest.fixture(scope="module")
def made(small, rows):
    return array_system(small.truth, small.start, rows, small.same, MISSED_RAD, 0.02)


def changed(small, size=1e-3, seed=1):
    """A state near the truth: all numbers moved."""
    return small.truth.moved(size * np.random.default_rng(seed).normal(size=LAYOUT.count), LAYOUT)


def test_values_are_the_error_of_each_end_and_the_force_against_gravity(small, rows):
    state = changed(small)
    system, where = array_system(state, small.start, rows, small.same, MISSED_RAD, 0.02)
    q = Rotation.from_quat(state.q_tb, scalar_first=True)
    for i, unit in enumerate(rows):
        M = Rotation.from_matrix(state.mountings[i])
        found = q[unit.first] * M * turns_by_scipy(unit.batch, state.models[i]) * (q[unit.last] * M).inv()
        assert_allclose(system.values[where.closure[i]], found.as_rotvec(), atol=1e-9)
        for k, still in enumerate(unit.stills):
            force = matrix_of(state.accelerometers[i]) @ (unit.force[k] - state.accelerometers[i, 6:])
            expected = q[still].apply(M.apply(force)) + np.array([0, 0, state.gravity_mps2])
            assert_allclose(system.values[where.force[i]][k], expected, atol=1e-9)
    assert not system.values[where.of_common].any()
    assert not system.values[where.of_level].any()


def test_each_column_is_the_derivative_of_the_values(small, rows, made):
    def values(change):
        whole = np.zeros(LAYOUT.count)
        whole[: LAYOUT.level[0, 0]] = change
        return array_system(small.truth.moved(whole, LAYOUT), small.start, rows, small.same, MISSED_RAD, 0.02)[0].values

    numeric = numeric_jacobian(values, np.zeros(LAYOUT.level[0, 0]), 1e-4)
    found = made[0].design[:, : LAYOUT.level[0, 0]].copy()
    for i in range(2):  # the gyroscope's are of first order in the angle from sample to sample, here up to 15°
        assert_allclose(found[:, LAYOUT.unit(i, GYROSCOPE)], numeric[:, LAYOUT.unit(i, GYROSCOPE)], atol=0.01)
        found[:, LAYOUT.unit(i, GYROSCOPE)] = numeric[:, LAYOUT.unit(i, GYROSCOPE)]
    assert_allclose(found, numeric, atol=1e-6, rtol=1e-6)


def test_rows_of_what_is_common_are_ones_in_their_places(made):
    system, where = made
    expected = np.zeros((len(system.values), LAYOUT.count - LAYOUT.level[0, 0]))
    level, common = np.arange(8).reshape(4, 2), 8 + np.arange(6).reshape(3, 2)
    for i, turns in enumerate(TURNS):
        for row, (a, b) in zip(where.closure[i], turns, strict=True):
            for k in range(a, b):
                expected[row[0], common[k, 0]] = expected[row[1], common[k, 1]] = 1.0
        for row, own in zip(where.force[i], level, strict=True):
            expected[row[0], own[0]] = expected[row[1], own[1]] = 1.0
    expected[where.of_common, common] = 1.0
    expected[where.of_level, level] = 1.0
    assert_array_equal(system.design[:, LAYOUT.level[0, 0] :], expected)
    assert not system.design[where.of_common][..., : LAYOUT.level[0, 0]].any()
    assert not system.design[where.of_level][..., : LAYOUT.level[0, 0]].any()


def test_every_row_has_its_component_and_the_variance_of_white_noise(small, made):
    """A turn's angles share its trace: mean of the squared walks times its duration; a force's is the walk over the still's duration."""
    system, where = made
    places = [*where.closure, *where.force, where.of_common, where.of_level]
    assert_array_equal(np.concatenate([each.ravel() for each in places]), np.arange(53))
    expected = np.zeros((7, 53))
    for k, rows in enumerate((*where.closure, *where.force, where.of_common, where.of_common, where.of_level)):
        expected[k, rows.ravel()] = 1.0
    expected[5, where.of_common] = [[1e-4] * 2, [4e-4] * 2, [9e-4] * 2]
    assert_allclose(system.V, expected)
    for i, turns in enumerate(TURNS):
        seconds = np.array([(b - a) * TURN_S + 0.02 for a, b in turns])
        turn = np.mean(((1 + i) * WALK) ** 2) * seconds
        assert_allclose(system.base[where.closure[i]], np.repeat(turn[:, None], 3, axis=1))
        force = np.mean(((1 + i) * FORCE_WALK) ** 2) / (STILL_S + 0.5 * np.arange(4))
        assert_allclose(system.base[where.force[i]], np.repeat(force[:, None], 3, axis=1))
    assert 0 < system.base[where.of_common].max() < 1e-6 * system.base[where.closure[0]].min()
    assert 0 < system.base[where.of_level].max() < 1e-4 * system.base[where.force[0]].min()


def test_priors_hold_the_frame_and_pull_towards_the_start(small, rows):
    state = changed(small)
    system, _ = array_system(state, small.start, rows, small.same, MISSED_RAD, 0.02)
    weak, accelerometer = np.array([0.2] * 9 + [20 * DEG] * 3), SPREAD_MPS2 * np.array([1 / G] * 6 + [1] * 3)
    for i, mounting in enumerate((HELD, 1.0)):
        assert_allclose(system.prior[LAYOUT.unit(i)], np.concatenate([weak, accelerometer, [mounting] * 3]))
        pull = np.concatenate([rows[i].centre - state.models[i].vector, IDENTITY - state.accelerometers[i], np.zeros(3)])
        assert_allclose(system.pull[LAYOUT.unit(i)], pull)
        assert_array_equal(rows[i].centre, small.units[i].problem.first.vector)
    assert system.prior[LAYOUT.gravity] == 0.02
    assert system.pull[LAYOUT.gravity] == pytest.approx(G - state.gravity_mps2)
    assert_array_equal(system.prior[LAYOUT.attitudes].ravel(), [1, 1, HELD, *[1] * 9])  # the first still's yaw is the frame's
    assert not system.pull[LAYOUT.attitudes[0, 0] :].any()
    assert HELD < 1e-6
    # what rows of their own bound is free
    assert system.prior[LAYOUT.level].min() >= STANDARD_G
    assert system.prior[LAYOUT.common].min() >= 1.0


# Solution: any few rows.


@pytest.fixture(scope="module")
def few():
    """Sixteen rows, one of which is rejected, three unknowns, two components."""
    rng = np.random.default_rng(5)
    V = np.stack([np.repeat([1.0, 0.0], 8), np.repeat([0.0, 2.0], 8)])
    return System(
        rng.normal(size=(16, 3)),
        1.5 * rng.normal(size=16),
        np.full(16, 0.1),
        V,
        np.array([0.5, 2, 10]),
        np.array([0.3, 0, -1]),
        np.arange(16) == 4,
    )


def dense(system, t, kept):
    """Mean and covariance of the rows' values: the unknowns are random about their priors."""
    design, variance = system.design[kept], (system.base + t @ system.V)[kept]
    return -design @ system.pull, np.diag(variance) + design @ np.diag(system.prior**2) @ design.T


def test_a_solution_is_the_conditional_normal_distribution_of_unknowns_with_priors(few):
    """Mean, covariance and -2 log likelihood by dense matrices; its slope; the sigma of each component by the expected information."""
    t, kept = np.array([0.4, 0.7]), ~few.out
    mean, C = dense(few, t, kept)
    residual, spread = few.values[kept] - mean, np.diag(few.prior**2)
    gain = spread @ few.design[kept].T @ np.linalg.inv(C)
    found = few.solved(t)
    assert_allclose(found.x, few.pull - gain @ residual, rtol=1e-9)
    assert_allclose(found.covariance, spread - gain @ few.design[kept] @ spread, rtol=1e-9, atol=1e-12)
    assert found.value == pytest.approx(np.linalg.slogdet(C)[1] + residual @ np.linalg.solve(C, residual), rel=1e-12)
    slope = [-(few.solved(t + h).value - few.solved(t - h).value) / 4e-5 for h in 1e-5 * np.eye(2)]
    assert_allclose(found.score()[0], slope, rtol=1e-6)
    pulled = [np.linalg.solve(C, np.diag(v[kept])) for v in few.V]
    information = [[np.trace(a @ b) / 2 for b in pulled] for a in pulled]
    assert_allclose(found.sigma(), np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-9)


@pytest.mark.parametrize("begin", [(1.0, 1.0), (1e-3, 1e3)])
def test_components_are_those_of_the_greatest_restricted_likelihood(few, begin):
    """By Nelder and Mead's search of their logarithms."""
    best = minimize(lambda x: few.solved(np.exp(x)).value, [-1.0, -1.0], method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-10})
    assert_allclose(few.estimated(np.array(begin)).t, np.exp(best.x), rtol=5e-3)


def test_rows_quieter_than_their_noise_have_no_component(few):
    """The likelihood falls from zero on."""
    quiet = replace(few, base=np.where(few.V[0] > 0, 30.0, 0.1))
    found = quiet.estimated(np.ones(2))
    assert found.t[0] == 0
    assert found.t[1] > 0.1
    assert quiet.solved(found.t + np.array([1e-3, 0])).value > found.value


@pytest.mark.parametrize("rows", [[0, 1], [9, 10], [4, 4]])
def test_a_block_is_judged_by_all_other_rows(few, rows):
    """The conditional normal distribution of the block, by dense matrices; the fifth row is rejected, and predicted all the same."""
    t, block = np.array([0.4, 0.7]), np.unique(rows)
    rest = ~few.out
    rest[block] = False
    both = np.concatenate([block, np.flatnonzero(rest)])
    mean, C = dense(few, t, both)
    d = len(block)
    gain = C[:d, d:] @ np.linalg.inv(C[d:, d:])
    error = (few.values[both] - mean)[:d] - gain @ (few.values[both] - mean)[d:]
    spread = C[:d, :d] - gain @ C[d:, :d]
    chi, found = few.solved(t).blocks(block[None])
    assert_allclose(found[0], error, rtol=1e-9)
    assert chi[0] == pytest.approx(error @ np.linalg.solve(spread, error), rel=1e-9)


# What a unit brings.


def shaken(unit, still=None, axis=None, by=0.0):
    """The unit with drifting still rates, one of them moved, and a first model that has E = 1."""
    rates = unit.problem.still_rates
    rate = rates.rate + np.array([[1e-4], [-2e-4], [3e-4], [1e-4]])
    if still is not None:
        rate = rate.copy()
        rate[still, axis] += by
    problem = SimpleNamespace(
        **{**vars(unit.problem), "still_rates": replace(rates, rate=rate), "first": LinearModel(np.eye(3), np.zeros(3))}
    )
    return replace(unit, prepared=SimpleNamespace(problem=problem, as_given=None))


def test_the_variance_that_still_rates_bring_is_that_of_moved_rates(small):
    """Each still's rate moved by a millionth: the ends turn, and squares of that by the rate's sigma add up."""
    unit = small.units[0]
    plain = unit_rows(shaken(unit), 0, small.same, "stills")
    ends = lambda rows: turns_by_scipy(rows.batch, LinearModel(np.eye(3), np.zeros(3)))  # noqa: E731
    total = np.zeros(3)
    for still in range(4):
        for axis in range(3):
            moved = unit_rows(shaken(unit, still, axis, 1e-6), 0, small.same, "stills")
            slope = (ends(moved) * ends(plain).inv()).as_rotvec() / 1e-6
            total += np.sum(slope**2, axis=1) * unit.problem.still_rates.sigma[still, axis] ** 2 / 3
    own = unit_rows(shaken(unit), 0, small.same, "ends").floor
    assert_allclose(plain.floor - own, np.repeat(total[:, None], 3, axis=1), rtol=2e-3)
    assert plain.rest is not None
    assert_array_equal(plain.centre[BIAS], 0)
    assert unit_rows(shaken(unit), 0, small.same, "ends").rest is None


def test_with_biases_of_the_stills_the_rates_are_without_them_and_B_is_held(small):
    """Still rates, less the Earth's, interpolated between the middles of the stills."""
    rows, problem = prepared(small, bias="stills"), small.units[0].problem
    rates = problem.still_rates
    bias = rates.rate - rates.earth @ np.linalg.inv(problem.first.E).T
    for s, segment in enumerate(problem.used):
        count = rows[0].batch.rate.shape[1]
        at_s = segment.start_s + np.concatenate([[0], np.cumsum(problem.batch.dt[s])])[:count]
        expected = np.column_stack([np.interp(at_s, rates.middle_s, bias[:, axis]) for axis in range(3)])
        assert_allclose(rows[0].batch.rate[s], problem.batch.rate[s, :count] - expected, atol=1e-12)
    system, _ = array_system(small.truth, small.start, rows, small.same, MISSED_RAD, 0.02)
    assert_allclose(system.prior[LAYOUT.unit(0)][BIAS], 20 * DEG * HELD)


@pytest.mark.parametrize(
    ("mode", "sigma_mg", "spread"),
    [
        ("fit", None, SPREAD_MPS2),
        ("prior", 3.0, np.full(9, 3 * MG)),
        ("prior", None, np.full(9, GIVEN_SIGMA_MG * MG)),
        (None, 3.0, np.full(9, HELD)),
    ],
)
def test_the_accelerometers_prior_is_that_of_its_source(small, mode, sigma_mg, spread):
    unit = small.units[0]
    given = replace(unit.problem.session.config.accelerometer, sigma_mg=sigma_mg)
    config = SimpleNamespace(**{**vars(unit.problem.session.config), "accelerometer": given})
    problem = SimpleNamespace(
        **{**vars(unit.problem), "session": SimpleNamespace(config=config), "joint": mode and SimpleNamespace(mode=mode)}
    )
    before = SimpleNamespace(**vars(problem))
    unit = replace(unit, prepared=SimpleNamespace(problem=problem, as_given=lambda: SimpleNamespace(problem=before)))
    assert force_problem(unit) is (before if mode == "prior" else problem)
    assert_allclose(unit_rows(unit, 0, small.same, "ends").prior, spread * np.array([1 / G] * 6 + [1] * 3))
    x = IDENTITY + 0.01 * np.arange(9)
    after = accelerometer_after(unit, x)
    assert after is given if mode is None else (after.source == ("stills" if mode == "fit" else "prior"))
    if mode:
        assert_allclose(after.matrix @ ([1.0, 2, 3] - after.bias_mps2), matrix_of(x) @ ([1.0, 2, 3] - x[6:]))


# The Earth.


@pytest.fixture(scope="module")
def level():
    """Three units over five stills under the Earth at 48° N, the table's x axis 30° from north; their rates err by less than it."""
    found = small_array(3, 5, seed=3, earth=with_heading(48.0, 30.0))
    rng = np.random.default_rng(6)
    for i, unit in enumerate(found.units):
        sigma = np.full((5, 3), (1 + i) * 4e-6)
        rates = replace(unit.problem.still_rates, sigma=sigma, rate=unit.problem.still_rates.rate + sigma * rng.normal(size=(5, 3)))
        unit.problem.still_rates = rates
        unit.problem.first = found.truth.models[i]
        unit.problem.earths = {0: replace(found.earth, source="estimated")}
    return found


def test_headings_of_all_units_are_weighed_by_their_variances(level):
    """The horizontal part is the mean over the heading's normal distribution, by integration; the vertical one is known."""
    found = common_earth(level.units, level.truth, level.same)[0]
    q = Rotation.from_quat(level.truth.q_tb, scalar_first=True)
    angle, sigma = [], []
    for i, unit in enumerate(level.units):
        at, rates = wxyz(q * Rotation.from_matrix(level.truth.mountings[i])), unit.problem.still_rates
        one = estimate_heading(48.0, at, level.truth.models[i](rates.rate), rates.sigma)
        angle.append(one.heading_rad)
        sigma.append(one.heading_sigma_rad)
    weight = 1 / np.square(sigma)
    mean, left = np.sum(weight * angle) / weight.sum(), weight.sum() ** -0.5
    assert 0.005 < left < 0.5
    assert found.heading_rad == pytest.approx(mean, abs=0.05 * left)  # of angles so near each other
    assert found.heading_sigma_rad == pytest.approx(left)
    assert found.source == "estimated"
    assert abs(found.heading_rad - 30 * DEG) < 5 * left
    z = np.linspace(-8, 8, 2001)
    density = np.exp(-(z**2) / 2) / np.exp(-(z**2) / 2).sum()
    h = found.heading_rad + left * z
    north = EARTH_RATE_RPS * np.cos(48 * DEG)
    expected = [north * density @ np.cos(h), -north * density @ np.sin(h), -EARTH_RATE_RPS * np.sin(48 * DEG)]
    assert_allclose(found.rate_t, expected, rtol=1e-6)


def test_the_earth_turns_with_the_body(level):
    rows = prepared(level)
    q = Rotation.from_quat(level.truth.q_tb, scalar_first=True)
    for i, unit in enumerate(rows):
        M = Rotation.from_matrix(level.truth.mountings[i])
        begins = (q[unit.first] * M).inv().apply(level.earth.rate_t)
        assert_allclose(unit.batch.earth[:, 0], begins, atol=1e-12)
        ends = (q[unit.last] * M).inv().apply(level.earth.rate_t)
        assert_allclose(unit.batch.earth[:, -1], ends, atol=1e-3 * EARTH_RATE_RPS)
