"""A session's noise: restricted likelihood against its definition, each component by numeric derivatives or sums over every reading."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from conftest import DEG
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import block_diag
from scipy.optimize import minimize, minimize_scalar
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from small_sessions import DPH, attitudes_by_scipy, closure_of, small_session, tilted_stills
from small_turns import TRUE, angles_by_scipy, numeric_jacobian

from session.base.units import MG, G
from session.detect.check_time import capped, thinning_exponent
from tinygc.closure.floor import BiasInstability
from tinygc.inference.noise import Cost, Prior, Sparse, estimate, lowest, wander_covariance
from tinygc.noise import whitening
from tinygc.noise.components import (
    _GUESS_STEPS,
    REFERENCE,
    STILL_RATE,
    TURN,
    UNDERSAMPLED,
    WANDER,
    Component,
    SessionNoise,
    first_noise,
    noise_with,
    undersampling,
)
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener

GROUPS, REPEATS = 12, 5
#: prior of a column, wide enough to be none
FLAT = 1e6
#: of a component of usual size 1: the least variance that is anything
NO_VARIANCE = 1e-4


def sizes_of(y, V, J=0.0, usual=1.0, prior=None):
    """Sizes of a component and of single rows, whose usual size is one, with one column; the base is negligible."""
    n = len(y)
    J, usual = J * np.ones((n, 1)), np.array([usual, 1.0])
    return estimate(y, J, 1e-9 * np.eye(n), [V, np.eye(n)], usual, [prior, None], [np.arange(n)], with_sigma=True, steps=60)


class Blocks:
    """Rows in blocks that know nothing of each other, two fitted columns with priors of one, and three components: one that spans a block,
    one of single rows, one that pairs rows."""

    usual = np.array([0.5, 2.0, 1.0])

    def __init__(self, blocks=1, rows=8, seed=0, priors=(None, None, None)):
        rng = np.random.default_rng(seed)
        n, self.priors = blocks * rows, list(priors)
        half = [rng.normal(size=(rows, rows)) for _ in range(blocks)]
        of_blocks = block_diag(*(h @ h.T / rows for h in half))
        self.V = [of_blocks, np.diag(rng.uniform(0.2, 2, n)), np.kron(np.eye(n // 2), np.ones((2, 2)))]
        self.base, self.J = np.diag(rng.uniform(0.05, 0.2, n)), rng.normal(size=(n, 2))
        self.blocks = list(np.arange(n).reshape(blocks, rows))
        self.r = np.linalg.cholesky(self.covariance([0.8, 1.5, 1.0]) + self.J @ self.J.T) @ rng.normal(size=n)

    def covariance(self, s):
        return self.base + np.tensordot(np.square(s), self.V, 1)

    def estimate(self, **more):
        V = [self.V[0], Sparse.of_diagonal(np.diag(self.V[1])), Sparse.of(self.V[2])]
        return estimate(self.r, self.J, self.base, V, self.usual, self.priors, self.blocks, steps=200, **more)

    def definition(self, s, rows=slice(None)):
        """-2 log of the density of r, the columns' coefficients being normal, less n log 2 pi; and the squares of the priors' deviates."""
        total = (self.covariance(s) + self.J @ self.J.T)[rows][:, rows]
        deviates = [np.log(size / p.median) / p.spread for size, p in zip(s, self.priors, strict=True) if p is not None]
        return np.linalg.slogdet(total)[1] + self.r[rows] @ np.linalg.solve(total, self.r[rows]) + np.sum(np.square(deviates))

    def best(self, rows=slice(None)):
        options = {"xatol": 1e-6, "fatol": 1e-9, "maxiter": 4000}
        return np.abs(minimize(lambda s: self.definition(np.abs(s), rows), self.usual, method="Nelder-Mead", options=options).x)


CASES = {
    "three blocks": {"blocks": 3, "seed": 2},
    "with priors": {"seed": 3, "rows": 16, "priors": (Prior(0.3, 0.4), None, Prior(3.0, 0.2))},
}


@pytest.mark.parametrize("case", CASES)
def test_the_estimate_is_the_maximum_of_the_definition_and_its_sigma_the_curvature(case):
    problem = Blocks(**CASES[case])
    found = problem.estimate(with_sigma=True)
    assert found.value == pytest.approx(problem.definition(found.s), rel=1e-9)
    best = problem.best()
    assert found.value < problem.definition(best) + 1e-4
    # At the maximum -2 log L is flat to second order: sigmas of 0.05 of their own.
    inside = best > 0.02 * problem.usual
    assert np.abs((found.s - best) / found.sigma)[inside].max() < 0.02
    # The covariance of the variances is twice the inverse of the second derivatives of -2 log L; that of the sizes follows by 1 / 2s.
    step = 1e-3 * found.s[inside] ** 2
    size = found.s[inside] ** 2

    def moved(by):
        s = found.s.copy()
        s[inside] = np.sqrt(size + by)
        return problem.definition(s)

    e = np.diag(step)
    second = [[(moved(a + b) - moved(a - b) - moved(b - a) + moved(-a - b)) / 4 / a.max() / b.max() for a in e] for b in e]
    expected = np.sqrt(2 * np.diag(np.linalg.inv(second))) / 2 / found.s[inside]
    assert found.sigma[inside] == pytest.approx(expected, rel=2e-3)


def test_a_long_session_is_searched_in_three_of_its_blocks_and_weighed_by_all():
    """The first, the middle and the last of five; and with two, both."""
    problem = Blocks(blocks=5, rows=6, seed=5)
    found = problem.estimate()
    searched = np.concatenate([problem.blocks[i] for i in (0, 2, 4)])
    assert problem.definition(found.s, searched) < problem.definition(problem.best(searched), searched) + 1e-3
    assert found.value == pytest.approx(problem.definition(found.s), rel=1e-9)
    assert problem.definition(found.s) > problem.definition(problem.best()) + 0.05
    two = Blocks(blocks=2, seed=2)
    assert two.estimate().value == pytest.approx(two.definition(two.best()), abs=1e-4)


def test_groups_alike_have_no_variance_between():
    y = 0.5 * np.random.default_rng(1).normal(size=(GROUPS, REPEATS))
    y -= y.mean(axis=1, keepdims=True)  # between would be negative
    found = sizes_of(y.ravel(), np.kron(np.eye(GROUPS), np.ones((REPEATS, REPEATS))), FLAT)
    assert found.s[0] == 0.0
    # -2 log L = (g - 1) log(within + m between) + what does not depend on between: up by one at this size.
    assert found.sigma[0] == pytest.approx(found.s[1] * np.sqrt((np.exp(1 / (GROUPS - 1)) - 1) / REPEATS), rel=0.003)
    # and the other's is that of its mean square alone
    assert found.sigma[1] == pytest.approx(found.s[1] / np.sqrt(2 * GROUPS * (REPEATS - 1) + 2 * (GROUPS - 1)), rel=3e-3)


def test_of_two_components_alike_the_sum_alone_is_determined():
    y = np.random.default_rng(2).normal(size=8)
    found = sizes_of(y, np.eye(8))
    assert found.s @ found.s == pytest.approx(y @ y / 8, rel=1e-3)
    assert np.isinf(found.sigma).all()


def test_a_component_that_the_columns_take_up_may_have_any_size():
    """Its sigma is as good as infinite; of a column known to c, the mean has the variance v = s^2 + c^2 + within / n, -2 log L = log v."""
    y = np.random.default_rng(8).normal(size=6)
    y -= y.mean()
    known = np.array([2.0, 10.0, 20.0])
    of_flat, *found = (sizes_of(y, np.ones((6, 6)), column).sigma[0] for column in (FLAT, *known))
    assert of_flat > 1e5
    assert found == pytest.approx(np.sqrt((np.e - 1) * (known**2 + y @ y / 5 / 6)), rel=0.01)


@pytest.mark.parametrize(("prior", "above"), [(Prior(2.0, 0.5), 0.5), (Prior(2.0, 0.5, 0.25), 0.25)])
def test_a_prior_counts_in_its_own_spreads(prior, above):
    assert prior.apart(2.0 * np.e) == pytest.approx((1 / above, above))
    assert prior.apart(2.0 / np.e) == pytest.approx((-2.0, 0.5))  # as far below the median, by the spread downwards


@pytest.mark.parametrize(("variance", "there"), [(0.99 * NO_VARIANCE, False), (1.01 * NO_VARIANCE, True)])
def test_a_component_below_a_hundredth_of_its_usual_size_is_absent(variance, there):
    size = 3.0 * np.sqrt(variance)
    found = sizes_of(np.random.default_rng(3).normal(size=6), 9.0 * np.eye(6), usual=3.0, prior=Prior(size, 1e-4))
    assert found.s[0] == pytest.approx(size * there, rel=1e-3)


#: nothing missed by any turn
NOTHING = replace(undersampling(Twin(small_session())), predicted_rad=np.zeros(7), exponent=2.0, rate_hz=100.0)


def found_in(problem, missed=NOTHING):
    twin = Twin(problem)
    return {c.name: c for c in first_noise(twin, Whitener(twin), missed).components}


def test_undersampling_that_is_better_known_counts_for_that_call_alone():
    twin = Twin(small_session())
    found = [first_noise(twin, Whitener(twin), missed).missed for missed in (NOTHING, None, NOTHING, None)]
    assert [each is NOTHING for each in found] == [True, False, True, False]


def test_many_rows_have_the_factor_of_few():
    half = np.random.default_rng(0).normal(size=(9, 9))
    covariance = half @ half.T + np.eye(9)
    with patch.object(whitening, "MANY_ROWS", 9):
        assert_allclose(whitening._factored(covariance.copy()), np.linalg.cholesky(covariance), atol=1e-13)


def dense(component):
    return component.V if isinstance(component.V, np.ndarray) else component.V.dense()


def alike(found, expected, share=3e-3):
    assert_allclose(found, expected, atol=share * np.abs(expected).max())


def test_the_wander_is_the_flicker_of_the_bias_in_each_quarter_of_a_second():
    """The closure's derivative by the bias of each reading; of a still's mean rate it is one."""
    problem = small_session(kind="known", turns=(2, 1))
    batch, d = problem.batch, problem.batch.angles
    began = [0.0, problem.logs[0].samples.duration_s]
    moments, spans, responses = [], [], []
    for i, segment in enumerate(problem.used):
        count = batch.rate[i].size  # each number of the turn moved in a turn of its own, rad/s of the calibrated rate
        by = 1e-5 * np.eye(count).reshape(count, -1, 3) @ np.linalg.inv(TRUE.E).T
        turns = batch.pick(np.full(count, i))
        there, back = (angles_by_scipy(replace(turns, rate=batch.rate[i] + off), TRUE.vector) for off in (by, -by))
        each = ((there - back) / 2e-5).T.reshape(d, -1, 3)
        weight = (np.append(batch.dt[i], 0) + np.append(0, batch.dt[i])) / 2
        pieces = int(np.ceil(segment.duration_s / 0.25))
        at = np.minimum((np.cumsum(weight) - weight / 2) / weight.sum() * pieces, pieces - 1).astype(int)
        for k in range(pieces):
            moments.append(began[segment.log] + segment.start_s + (k + 0.5) * segment.duration_s / pieces)
            spans.append(segment.duration_s / pieces)
            response = np.zeros((3 * d + 20, 3))
            response[d * i : d * i + d] = each[:, at == k].sum(axis=1)
            responses.append(response)
    for q, still in enumerate(still for still in problem.stills if still.problem is None):
        moments.append(problem.still_rates.middle_s[q])
        spans.append(still.duration_s)
        responses.append(np.eye(3 * d + 20)[:, 3 * d + 3 * q : 3 * d + 3 * q + 3])
    flicker = wander_covariance(np.array(moments), np.array(spans), instability_rps=1.0)
    expected = np.einsum("aik,ab,bjk->ij", responses, flicker, responses)
    alike(dense(found_in(problem, replace(NOTHING, predicted_rad=np.zeros(3)))[WANDER]), expected, 2e-3)


@pytest.mark.parametrize(
    ("known", "truths", "prior"),
    [
        (BiasInstability(20 * DPH, "given"), False, (20, 0.1)),
        (BiasInstability(20 * DPH, "typical of some"), False, (20, 0.8)),
        (BiasInstability(20 * DPH, "measured at rest (noise.json)", 4 * DPH, 28 * DPH), False, (20, np.hypot(0.1, 0.2))),
        (BiasInstability(20 * DPH, "estimated", 4 * DPH, 28 * DPH, of_unit=True), False, (10, 1.5)),
        (BiasInstability(0.0, "nothing"), False, (10, 1.5)),
        (BiasInstability(20 * DPH, "estimated", of_unit=True), True, (20, 0.8)),
        (BiasInstability(0.0, "nothing"), True, (10, 1.5)),
    ],
)
def test_what_is_known_of_the_wander_beforehand(known, truths, prior):
    """Given to 10 %, typical to a factor of 2.2; of the unit's own stills nothing more than they say again: an order of magnitude, which
    any such gyroscope has.  A search begins at the size that is known."""
    problem = small_session(instability=known, truths=truths)
    component = found_in(problem)[WANDER]
    assert component.prior == pytest.approx((prior[0] * DPH, prior[1], None))
    white = 20 * DPH if truths else np.median(problem.still_rates.sigma)
    assert component.usual == pytest.approx(known.rps or white / 2)
    assert first_noise(Twin(problem), Whitener(Twin(problem)), NOTHING).s[0] == component.prior.median


def test_an_error_of_a_still_tilts_the_ends_of_two_turns_and_lengthens_gravity():
    """1 m/s^2 is 1/g of tilt about either horizontal axis, and one unit of length."""
    problem = small_session(kind="known")

    def moved(by):
        tilt = np.pad(by.reshape(9, 2), ((0, 0), (0, 1))) / G
        return closure_of(tilted_stills(problem, tilt))(TRUE.vector)

    by_tilt = numeric_jacobian(moved, np.zeros(18), 1e-3)
    component = found_in(problem)[REFERENCE]
    alike(dense(component), block_diag(by_tilt @ by_tilt.T, np.zeros((27, 27)), np.eye(9)), 2e-3)
    assert component.usual == 0.1 * MG


@pytest.mark.parametrize("kind", ["yaw", "known"])
def test_independent_errors_of_stills_and_turns(kind):
    """Of each still's mean rate; of each turn's closure, but for a stated angle, which has its stop's sigma."""
    problem = small_session(kind=kind)
    found, d = found_in(problem), problem.batch.angles
    assert_array_equal(np.diag(dense(found[STILL_RATE])), np.repeat([0.0, 1.0, 0.0], [7 * d, 27, 9]))
    assert found[STILL_RATE].usual == np.median(problem.still_rates.sigma)
    of_angles = [1, 1, int(kind == "yaw")]
    assert_array_equal(dense(found[TURN]), np.diag([*np.tile(of_angles, 7), *np.zeros(36)]))
    white = problem.floor.own - problem.floor.wider
    variance = np.stack([np.trace(white[:, :2, :2], axis1=1, axis2=2) / 2] * 2 + [white[:, i, i] for i in range(2, d)], axis=1)
    usual = np.sqrt(np.mean(variance[problem.batch.known]))
    assert found[TURN].usual == pytest.approx(usual)
    # What missed turns leave is a component from a tenth of this on; each turn has its own share.
    for times, there in ((0.0999, False), (0.1001, True)):
        missed = replace(NOTHING, predicted_rad=times * usual * np.sqrt(np.arange(1.0, 8.0) / 4))
        found = found_in(problem, missed)
        assert (UNDERSAMPLED in found) is there
    assert_allclose(dense(found[UNDERSAMPLED]), np.diag([*np.repeat(missed.predicted_rad**2, d), *np.zeros(36)]))
    assert (found[UNDERSAMPLED].prior, found[UNDERSAMPLED].usual) == (Prior(1.0, 1.0, 0.4), 1.0)


def thinned_by_hand(problem):
    """(3, S) rad^2: what every 2nd, 3rd and 4th reading differs by from all, about the table's horizontal axes, over all offsets."""
    batch, square = problem.batch, np.zeros((3, len(problem.batch)))
    for i, segment in enumerate(problem.used):
        dt, pad = batch.dt[i], batch.rate.shape[1]
        body = batch.rate[i] @ TRUE.E.T + TRUE.B - batch.earth[i]
        level = attitudes_by_scipy(Rotation.from_quat(batch.start[i], scalar_first=True), body, dt).apply(body)[:, :2]
        level[segment.stop - segment.start :] = 0.0
        t = np.append(0.0, np.cumsum(dt))
        walk = np.mean(problem.logs[segment.log].noise.gyro ** 2) / 2 * t[-1]
        for k, step in enumerate((2, 3, 4)):
            kept = [sorted({0, *range(offset, pad, step), pad - 1}) for offset in range(step)]
            apart = [np.trapezoid(level[rows], t[rows], axis=0) - np.trapezoid(level, t, axis=0) for rows in kept]
            square[k, i] = max(np.mean(np.square(apart)) - (step - 1) * walk, 0.0)
    return square


def test_what_is_missed_is_what_fewer_readings_miss_more():
    """Every k-th reading differs from all by k^2p - 1 of what all miss, beyond white noise."""
    problem = small_session()
    loud = [replace(log, noise=replace(log.noise, gyro=20 * log.noise.gyro)) for log in problem.logs]
    problem = replace(problem, logs=loud)  # so that white noise counts
    square = thinned_by_hand(problem)
    p = thinning_exponent(square)
    found = undersampling(Twin(problem))
    assert found.exponent == p
    weight = np.array([2.0, 3.0, 4.0]) ** (2 * p) - 1
    predicted = np.sqrt(np.mean(square / weight[:, None], axis=0)) * (p >= 1)
    assert_allclose(found.predicted_rad, capped(predicted), rtol=2e-3, atol=1e-12)
    assert_allclose(found.missed_rad, np.sqrt(square.mean(axis=1)), rtol=2e-3)
    assert found.rate_hz == pytest.approx(1 / np.median([log.samples.period_s for log in problem.logs]))
    assert found.rms_rad == pytest.approx(np.sqrt(2 * np.mean(found.predicted_rad**2)))


def test_the_data_rate_that_is_needed_follows_the_law():
    """An error four times too large that falls as the square of the rate asks for twice the rate."""
    assert NOTHING.rate_needed_hz(0.4, 0.1) == pytest.approx(200)


def noise_of(sizes, *, priors=(None, None, None), names=(TURN, STILL_RATE, WANDER), usual=(1.0, 1.0, 1.0)):
    """Diagonal components of the first three rows, the next two, and a dense one of all."""
    V = [Sparse.of(np.diag([1.0, 1, 1, 0, 0, 0])), Sparse.of_diagonal(np.array([0.0, 0, 0, 1, 1, 0])), 0.5 + np.eye(6)]
    made = zip(names, V, usual, priors, strict=False)
    parts = tuple(Component(name, each, size, "deg", DEG, f"it is {name}", prior) for name, each, size, prior in made)
    return SessionNoise(parts, [np.arange(6)], NOTHING, np.array(sizes), np.array([0.1 * DEG, np.inf, 0.0]))


def test_the_covariance_is_the_sum_of_squares_times_components():
    noise = noise_of([2.0, 3.0, 0.5])
    assert_allclose(noise.covariance, np.diag([4.0, 4, 4, 9, 9, 0]) + 0.25 * (0.5 + np.eye(6)))
    assert [noise.size(name) for name in (TURN, STILL_RATE, WANDER, REFERENCE)] == [2.0, 3.0, 0.5, 0.0]
    left = noise.without(STILL_RATE)
    assert ([c.name for c in left.components], left.s.tolist(), left.sigma.tolist()) == ([TURN, WANDER], [2.0, 0.5], [0.1 * DEG, 0.0])


@pytest.mark.parametrize(
    ("name", "prior", "limit"),
    [
        (TURN, None, 2.0),
        (STILL_RATE, None, 2.0),
        (UNDERSAMPLED, Prior(3.0, 0.4), np.exp(0.8)),
        (WANDER, Prior(3.0, 0.4), 3.0 * np.exp(3 * 0.4)),
        (REFERENCE, None, np.inf),
    ],
)
def test_noise_is_unusual_above_its_limit(name, prior, limit):
    """A turn's or a still's above white noise, the undersampling above two of its spreads, the wander above three."""
    exact = limit == round(limit) if np.isfinite(limit) else False  # then the limit itself is usual
    for times, unusual in ((1.0 if exact else 0.999, False), (1.001, limit < np.inf)):
        sizes = [times * min(limit, 1e3), 0.0, 0.0]
        assert bool(noise_of(sizes, names=(name, "a", "b"), usual=(2.0, 1.0, 1.0), priors=(prior, None, None)).unusual) == unusual


def absent(rows):
    """A component that these rows do not show."""
    return Component(REFERENCE, Sparse.of_diagonal(rows), 1.0, "mg", MG, "", None)


def test_the_p_value_of_unusual_noise_is_the_likelihood_ratios():
    """Of all large ones together, each on the edge half the time.  By hand: variances of single rows."""
    r = np.array([3.0, -2.0, 2.5, 2.2, -3.3, 1.0])
    noise = noise_of([1.0, 1.0], names=(TURN, STILL_RATE), priors=(None, None))
    noise = replace(noise, components=(*noise.components, absent(np.eye(6)[5])), s=np.ones(3), sigma=np.zeros(3))
    noise = noise.estimated(np.eye(6), r, np.zeros((6, 1)), steps=60)
    assert np.isnan(noise.sigma).all()  # unless asked for

    def gain(rows):  # -2 log L of white noise and as much of the component, a variance of 2, less the least of it
        def value(v):
            return len(r[rows]) * np.log(v) + r[rows] @ r[rows] / v

        return value(2.0) - minimize_scalar(value, bounds=(1, 50)).fun

    gains = [gain(slice(0, 3)), gain(slice(3, 5))]
    assert noise.unusual
    expected = chi2.sf(sum(gains), 1) / 2 + chi2.sf(sum(gains), 2) / 4
    for s, p in (noise.s, expected), ([noise.s[0], 0.5, 0.0], expected), ([0.9, 0.9, 0.0], 1.0):  # what grows beside it is held, too
        assert replace(noise, s=np.array(s)).unusual_p(np.eye(6), r, np.zeros((6, 1))) == pytest.approx(p, rel=1e-3)


def test_a_drift_is_held_against_the_largest_that_such_a_sensor_has():
    """By hand: the likelihood with it at its limit, the prior's cost with it; also where it grows beyond it once a turn's is held."""
    prior, limit = Prior(1.0, 0.5), np.exp(1.5)
    white = limit**2 * np.eye(6)
    V, r = np.full((6, 6), 0.5) + np.eye(6), 4 * limit * np.array([3.0, -2.0, 2.5, 2.2, -3.3, 1.0])

    def value(s, of_turns=0.0):
        C = white + (s**2 + of_turns**2) * V
        return np.linalg.slogdet(C)[1] + r @ np.linalg.solve(C, r) + (np.log(s) / 0.5) ** 2

    best = minimize_scalar(value, bounds=(limit, 1e3 * limit), method="bounded", options={"xatol": 1e-6 * limit})
    drift = Component(WANDER, V, limit, "deg", DEG, "", prior)
    alone = SessionNoise((absent(np.zeros(6)), drift), [np.arange(6)], NOTHING, np.array([0.0, best.x]), np.zeros(2), best.fun)
    gain = value(limit) - best.fun
    assert alone.unusual_p(white, r, np.zeros((6, 1))) == pytest.approx(chi2.sf(gain, 1) / 2, rel=0.01, abs=0)
    turns = replace(drift, name=TURN, V=Sparse.of(V), prior=None)
    both = replace(alone, components=(*alone.components, turns), s=np.array([0.0, 0.9 * limit, 9 * limit]), sigma=np.zeros(3))
    gain = value(limit, limit) - best.fun
    assert both.unusual_p(white, r, np.zeros((6, 1))) == pytest.approx(chi2.sf(gain, 1) / 2 + chi2.sf(gain, 2) / 4, rel=0.01, abs=0)


def test_beside_an_effect_the_noise_is_of_what_both_leave_with_the_effects_own_size_for_its_prior():
    """Each column has a prior of one, the effect's after it is scaled by what it was found to be."""
    rng, noise, sigma = np.random.default_rng(4), noise_of([1.0, 1.0, 1.0]), 0.45
    r, J, effect = 3 * rng.normal(size=6), rng.normal(size=(6, 1)), rng.normal(size=(6, 1))

    def fitted(both):
        return np.linalg.lstsq(np.concatenate([both / sigma, np.eye(2)]), np.append(-r / sigma, [0, 0]), rcond=None)[0]

    both = np.hstack([J, effect * np.abs(fitted(np.hstack([J, effect]))[1])])
    expected = noise.estimated(sigma**2 * np.eye(6), r + both @ fitted(both), both, noise.s, steps=_GUESS_STEPS)
    found = noise_with(noise, lambda rows: rows / sigma, sigma**2 * np.eye(6), r, J, effect, noise.s)
    assert found.s == pytest.approx(expected.s, rel=1e-6)
    assert found.value == pytest.approx(expected.value, rel=1e-9)


def test_a_long_session_is_cut_into_blocks_of_turns_with_the_stills_before_them():
    twin = Twin(small_session((40, 21)))
    first, second = first_noise(twin, Whitener(twin), NOTHING).blocks
    turns, stills = 122, 63
    own = [*range(60), *range(turns, turns + 90), *range(turns + 3 * stills, turns + 3 * stills + 30)]
    assert first.tolist() == own
    assert_array_equal(np.sort(np.concatenate([first, second])), np.arange(turns + 4 * stills))


def test_a_search_steps_back_from_where_the_likelihood_is_no_number():
    """(x - 1)^2 with a hundredth of its curvature, and nothing beyond 3: the first step would go to 50 and further."""

    def cost(x):
        value = float((x[0] - 1) ** 2) if x[0] < 3 else np.nan
        return Cost(value, 2 * (x - 1), np.array([[0.02]]))

    x, found = lowest(cost, np.array([0.5]))
    assert found.value < 0.25
    assert x[0] < 3
