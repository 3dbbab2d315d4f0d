"""The bias of a fit, of the day and of another session: searches by scipy, Student's t, quadrature, and rules by hand."""

import json
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import GRAVITY, config, wxyz
from noise_records import axis, figures, sensor
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.optimize import least_squares, minimize_scalar
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm, t
from small_sessions import EARTH_T, small_session
from small_turns import TRUE

from session.base.errors import CalibrationError, FitError, FormatError
from session.base.records import plain
from session.base.units import DEG
from session.log.folder import Session, hash_of_log
from session.log.logfile import Log
from session.log.samples import Samples
from tinygc import models
from tinygc.estimation import bias
from tinygc.estimation.between_sessions import (
    CHANCE,
    FEWEST_WITH_DRIFT,
    LEAST_SCATTER,
    LOOKED_AT,
    ONE_SIGMA,
    Between,
    _variance_where,
    contrasts,
    course,
    jump,
)
from tinygc.estimation.bias import BiasChoice, choose, closes_better, less_by_chance
from tinygc.estimation.options import FitOptions
from tinygc.estimation.spread import ACCELEROMETER, END_S, USUAL, ZERO, Spread, drift_between, wander_variance
from tinygc.fitting.bias_of_day import (
    _bias_from_gravity,
    _BiasOfDay,
    _prior,
    from_gravity,
)
from tinygc.fitting.unit_state import spread_of, spread_over
from tinygc.inference.noise import wander_covariance
from tinygc.models.linear import LinearModel


def test_better_by_chance_is_the_exact_signed_rank_of_tilts_that_are_smaller_altogether():
    usual = np.array([[3.0, 4.0, 9.0], [0.0, 2.0, 9.0], [1.0, 0.0, 9.0]])  # tilts of 5, 2 and 1; the third angle does not count
    assert less_by_chance(usual, usual * [0.5, 0.5, 99]) == 1 / 8  # all three of eight signs
    assert less_by_chance(usual, usual[:, :2] * [[0.5], [0.5], [1.1]]) == 2 / 8  # the smallest difference the other way
    assert less_by_chance(usual, usual[:, :2] * [[1.1], [0.1], [0.1]]) == 1.0  # the root mean square is not smaller


@pytest.mark.parametrize(("turns", "factor", "better"), [(13, 0.9899, True), (13, 0.9901, False), (12, 0.9999, True), (4, 0.5, False)])
def test_turns_close_better_by_one_percent_or_where_they_are_few_by_more_than_chance(turns, factor, better):
    usual = np.linspace(1, 2, turns)[:, None] * [3.0, 4.0]
    assert closes_better(usual, factor * usual) is better


@pytest.mark.parametrize(
    ("asked", "ends", "stills", "prior", "unobserved", "turns", "used"),
    [
        ("auto", 1.0, 0.5, None, (), 7, "stills"),
        ("auto", 0.5, 1.0, None, (), 7, "ends"),
        ("ends", 1.0, 0.5, None, (), 7, "ends"),
        ("stills", 0.5, 1.0, None, (), 7, "stills"),
        ("auto", 1.0, 1.0, "lot", (), 7, "stills"),  # no worse by more than chance
        ("auto", 0.5, 1.0, "lot", (), 7, "ends"),
        ("auto", 0.5, 1.0, None, (), 6, "stills"),  # too few turns for their ends to show it
        ("auto", 0.5, 1.0, None, bias.NAMES[bias.BIAS][:1], "known", "stills"),  # with stated angles, where they do not show it
        ("auto", 0.5, 1.0, None, bias.NAMES[:1], "known", "ends"),
    ],
)
def test_the_source_is_the_one_asked_for_or_shown_to_be_better(monkeypatch, asked, ends, stills, prior, unobserved, turns, used):
    problem = replace(small_session((4, 2 if turns == 6 else 3), kind="known" if turns == "known" else "tilt"), prior=prior)
    asked_for = []

    def run_method(name, problem, options, before=None):
        size = (ends if problem.rest_rps is None else stills) * np.ones((8, 2))
        asked_for.append((name, before))
        return SimpleNamespace(held_out=size * DEG, notes={"unobserved": unobserved})

    monkeypatch.setattr(bias, "run_method", run_method)
    choice, chosen, fit = choose(problem, FitOptions(bias=asked))
    assert (choice.used, chosen.rest_rps is not None) == (used, used == "stills")
    assert fit.held_out is choice.held_out[used]
    assert choice.p_value == (1 / 256 if stills < ends else 1.0)
    assert asked_for[0] == ("least_squares", None)
    assert set(asked_for[1][1]) == {"least_squares"}
    assert choice.of_prior == (prior is not None)
    assert choice.unseen == (turns == 6 or unobserved == bias.NAMES[bias.BIAS][:1])
    table = choice.to_json()
    assert table["stills_holdout_tilt_rms_deg"] == pytest.approx(stills * np.sqrt(2))


@pytest.mark.parametrize(
    ("stills", "why"), [(1.009, "both close held-out turns within 1 %"), (0.991, "both"), (1.011, "which closes"), (0.989, "so few turns")]
)
def test_ends_and_stills_are_alike_within_a_percent(stills, why):
    held = {"ends": np.array([[1.0, 0.0]]), "stills": np.array([[stills, 0.0]])}
    assert f"({why}" in BiasChoice("auto", "ends", held, 0.5, False, False).words


def test_stills_that_cannot_be_used_are_refused_or_passed_over(monkeypatch):
    monkeypatch.setattr(bias, "run_method", lambda *_, **__: "fit")
    problem = small_session(truths=True)
    with pytest.raises(CalibrationError, match=r"--bias stills: .*do not lie between stills"):
        choose(problem, FitOptions(bias="stills"))
    choice, same, fit = choose(problem, FitOptions())
    assert (choice.used, choice.held_out, same, fit) == ("ends", {}, problem, "fit")
    assert choice.words == "Bias from the ends of the turns."


PERIOD_S, BLOCK = 0.05, 2


def swaying(gap_s=0.0, without=()):
    """Samples at 20 Hz of a body that turns and sways for 16 s, with noise and a bias; calibrated rates, and its first attitude.

    gap_s: longer than usual from block 80 to the next; without: slices of blocks without a force.
    """
    rng = np.random.default_rng(0)
    t = np.arange(321) * PERIOD_S
    t[80 * BLOCK :] += gap_s
    waves = np.sin(2 * np.pi * (rng.uniform(0.05, 0.3, (3, 4)) * t[:, None, None] + rng.uniform(0, 1, (3, 4)))).sum(axis=2)
    rate = 0.25 * waves
    q = Rotation.from_rotvec([0.3, -0.2, 1.0])
    truth = attitudes(q.as_matrix(), rate, t, None)
    sway = 0.15 * np.sin(2 * np.pi * rng.uniform(0.1, 0.4, 3) * t[:, None] + [0, 1, 2])
    force = np.einsum("tji,tj->ti", truth, sway - [0, 0, GRAVITY]) + [0.03, -0.05, 0.04] + 0.02 * rng.normal(size=rate.shape)
    gyro = rate + np.array([0.08, -0.05, 0.06]) * DEG + 1e-4 * rng.normal(size=rate.shape)
    for some in without:
        force[some.start * BLOCK : some.stop * BLOCK] = 0.0
    return Samples(np.rint(t * 1e9).astype(np.int64), gyro, force), gyro, wxyz(q)


def attitudes(first, rate, t, earth_n):
    """Matrices (N, 3, 3) from body to navigation axes: sensed rates turn it against inertial space, which the Earth's rate turns below."""
    dt = np.diff(t)[:, None]
    vectors = (rate[1:] + rate[:-1]) / 2 * dt + dt**2 / 6 * np.cross(rate[:-1], rate[1:])
    found = np.array(list(accumulate(Rotation.from_rotvec(vectors).as_matrix(), np.matmul, initial=first)))
    return found if earth_n is None else Rotation.from_rotvec(-t[:, None] * earth_n).as_matrix() @ found


def searched(samples, rate, q_first, pieces, prior, rest=None, rest_sigma=0.05 * DEG, earth_n=None):
    """Mean bias, its covariance (3, 3), knots and walk: the model's words put down once more, numeric derivatives, all else scipy's.

    pieces: (first, last) block of each uninterrupted one.
    """
    t = samples.t_s - samples.t_s[0]
    blocks = len(t) // BLOCK
    knots = np.linspace(0, t[-1], max(2, round(t[-1] / 10) + 1))
    count, first = len(knots), Rotation.from_quat(q_first, scalar_first=True).as_matrix()
    shares = np.array([np.interp(t[: blocks * BLOCK], knots, hat).mean() for hat in np.eye(count)])

    def mean(values):
        return values[: blocks * BLOCK].reshape(blocks, BLOCK, 3).mean(axis=1)

    def residuals(x):
        walk, accel, tilt, starts = np.split(x, 3 * count + np.array([0, 3, 5]))
        walk = walk.reshape(count, 3)
        bias = np.stack([np.interp(t, knots, axis) for axis in walk.T], axis=1)
        turn = Rotation.from_rotvec([*tilt, 0]).as_matrix() @ attitudes(first, rate + bias, t, earth_n)
        pulled = mean(np.einsum("tij,tj->ti", turn, samples.accel - accel)) + np.array([0, 0, GRAVITY])
        parts = [(shares @ walk) / prior, np.diff(walk, axis=0) / (3e-5 * np.sqrt(np.diff(knots)))[:, None]]
        parts += [accel / 0.1, tilt / (0.5 * DEG), starts / 1.0]
        if rest is not None:
            parts.append((shares @ walk - rest) / rest_sigma)
        for (a, b), start in zip(pieces, starts.reshape(-1, 3), strict=True):
            velocity = start + np.cumsum(pulled[a:b] * BLOCK * PERIOD_S, axis=0)
            keep = np.exp(-BLOCK * PERIOD_S / 2.0)
            parts += [velocity[:1] / 0.5, (velocity[1:] - keep * velocity[:-1]) / (0.5 * np.sqrt(1 - keep**2))]
        return np.concatenate([np.ravel(part) for part in parts])

    scale = np.array([1e-3] * 3 * count + [0.1] * 3 + [0.01] * 2 + [1.0] * 3 * len(pieces))
    found = least_squares(residuals, np.zeros(len(scale)), x_scale=scale, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    scaled, to_mean = found.jac * scale, 1e-3 * np.kron(shares, np.eye(3))
    covariance = to_mean @ np.linalg.inv(scaled.T @ scaled)[: 3 * count, : 3 * count] @ to_mean.T
    walk = found.x[: 3 * count].reshape(count, 3)
    return shares @ walk, covariance, knots, walk


def agrees(found, expected):
    change, covariance, knots, walk = expected
    assert_allclose(found.knots_s, knots)
    assert_allclose(found.sigma, np.sqrt(np.diag(covariance)), rtol=0.005)
    assert_allclose((found.change - change) / found.sigma, 0, atol=0.01)
    assert_allclose((found.walk - walk) / found.sigma, 0, atol=0.01)


def test_gravity_s_bias_and_its_covariance_are_those_of_a_search_by_scipy():
    """With a prior and a rest of each axis, and an Earth."""
    given = {"prior": np.array([0.1, 0.5, 0.05]), "rest": np.array([-0.1, 0.08, -0.03]), "rest_sigma": np.array([0.02, 0.04, 0.01])}
    more = {name: value * DEG for name, value in (given | {"earth_n": np.array([0.03, 0.0, -0.02])}).items()}
    samples, rate, q_first = swaying()
    expected = searched(samples, rate, q_first, [(0, 160)], **more)
    agrees(_bias_from_gravity(samples, rate, q_first, gravity_mps2=GRAVITY, **more), expected)


def test_the_prior_is_of_the_mean_bias_its_walk_and_of_accelerometer_tilt_and_velocities():
    """As the sum of squares of each in its sigma: 3e-5 rad/s/sqrt(s) of the walk, 0.1 m/s^2, 0.5 deg and 1 m/s of each piece."""
    knots, share, sigma = np.array([0.0, 4.0, 13.0]), np.array([0.2, 0.5, 0.3]), np.array([1e-3, 2e-3, 3e-3])
    scale = np.concatenate([np.full(9, 1e-4), np.full(3, 0.1), np.full(2, 0.01), np.ones(6)])
    precision, mean = _prior(knots, sigma, 20, SimpleNamespace(share=share, pieces=[None] * 2))
    for x in scale * np.random.default_rng(1).normal(size=(3, 20)):
        walk = x[:9].reshape(3, 3)
        steps = np.diff(walk, axis=0) / (3e-5 * np.array([[2.0], [3.0]]))
        parts = [share @ walk / sigma, steps.ravel(), x[9:12] / 0.1, x[12:14] / (0.5 * DEG), x[14:]]
        assert x @ precision @ x == pytest.approx(np.sum(np.concatenate(parts) ** 2), rel=1e-9)
        assert_allclose(mean @ x, share @ walk)


@pytest.mark.parametrize(
    ("gap_s", "without", "pieces"),
    [
        (0.06, [], [(0, 80), (80, 160)]),
        (0.04, [slice(40, 45), slice(64, 70)], [(0, 40), (70, 160)]),  # 1.9 s between them, and a gap of less than a block, tell nothing
        (0.0, [slice(40, 45), slice(66, 70)], [(0, 40), (45, 66), (70, 160)]),
        (0.06, [slice(0, 79)], [(80, 160)]),  # one block before the gap, or behind it
    ],
)
def test_what_interrupts_a_run_leaves_a_velocity_of_its_own_to_each_piece_of_two_seconds(gap_s, without, pieces):
    samples, rate, q_first = swaying(gap_s, without)
    agrees(_bias_from_gravity(samples, rate, q_first, gravity_mps2=GRAVITY), searched(samples, rate, q_first, pieces, 0.1 * DEG))


def test_a_run_without_forces_or_of_no_numbers_is_refused():
    samples, rate, q_first = swaying()
    with pytest.raises(FitError, match="no 2 s of the run"):
        _bias_from_gravity(samples.with_accel(0 * samples.accel), rate, q_first)
    with pytest.raises(FitError, match="left the finite numbers"), np.errstate(all="ignore"):
        _bias_from_gravity(samples.with_accel(1e200 * samples.accel), rate, q_first)


def test_a_walk_is_in_excess_by_its_steps_root_mean_square_in_their_own_sigmas():
    """3e-5 rad/s/sqrt(s)."""
    none, sigma = np.zeros(3), 3e-5 * np.sqrt([4.0, 9.0])
    walk = np.cumsum([none, sigma[0] * np.array([1, 2, 3]), sigma[1] * np.array([-2, 0, 4])], axis=0)
    found = _BiasOfDay(none, none, np.array([0.0, 4.0, 13.0]), walk)
    assert found.excess == pytest.approx(np.sqrt((1 + 4 + 9 + 4 + 16) / 6))
    for quiet in (replace(found, walk=walk / 10), replace(found, walk=walk[:1], knots_s=np.zeros(1))):
        assert quiet.excess == 1.0


def test_gravity_s_bias_of_one_log_is_the_prior_of_the_next():
    """From the middle of each log's first reference still on; the median of its stills is its rest."""
    problem, change, sigma = small_session(), np.zeros(3), 0.01
    for log in problem.logs:
        still = log.stills[0]
        samples = log.samples.between(still.middle, len(log.samples))
        at_rest = np.median([TRUE(each.gyro_mean) for each in log.stills if each.problem is None], axis=0)
        more = {"prior": sigma, "rest": -at_rest - change, "earth_n": EARTH_T, "gravity_mps2": GRAVITY}
        one = _bias_from_gravity(samples, TRUE(samples.gyro) + change, log.q_tb[0], **more)
        change, sigma = change + one.change, one.sigma
    found = from_gravity(problem, TRUE, 0.01)
    assert_allclose([found.change, found.sigma], [change, sigma], rtol=1e-9)


def test_a_stored_bias_is_as_certain_as_its_file_s_days_are_alike():
    """0.1 dps where the file tells of no days."""
    assert spread_of(None, {}).at(ZERO).sigma.tolist() == [0.1 * DEG] * 3
    assert spread_of(None, {"bias_sigma_rps": [1e-3, 0.0, 2e-6]}).at(ZERO).sigma.tolist() == [1e-3, 0.0, 2e-6]


RNG = np.random.default_rng(37)
DRIFT = np.array([0.0, 1.0])


def drifting(n):
    return np.column_stack([np.ones(n), np.arange(n) - n + 1.0])


def equal_weights(values, design):
    """By numpy: what is left, the second coefficient and its standard error."""
    beta, (rest,), *_ = np.linalg.lstsq(design, values, rcond=None)
    freedom = len(values) - design.shape[1]
    return values - design @ beta, beta[1], np.sqrt(rest / freedom * np.linalg.inv(design.T @ design)[1, 1])


def test_without_own_errors_a_drift_is_that_of_students_t():
    n = 8
    values, design = RNG.normal(size=n) + 0.2 * np.arange(n), drifting(n)
    found = Between(values, np.zeros(n), design)
    _, drift, error = equal_weights(values, design)
    assert_allclose(found.interval(DRIFT), drift + error * t.ppf([0.025, 0.975], n - 2), rtol=1e-6)
    assert found.sigma(DRIFT) == pytest.approx(error * t.ppf((1 + ONE_SIGMA) / 2, n - 2), rel=1e-6)
    assert found.p_value(DRIFT) == pytest.approx(2 * t.sf(abs(drift / error), n - 2), rel=1e-6, abs=0)


def test_with_own_errors_it_is_the_normal_over_the_distribution_of_the_scatter():
    """The same by quadrature over the pivot itself."""
    own, design = np.array([0.3, 1.0, 0.5, 0.2, 0.8]), drifting(5)
    values = np.array([0.0, 0.4, 2.6, 2.1, 5.0])
    found = Between(values, own, design)
    variance, z = contrasts(values, own, design)

    def below(u):
        square = _variance_where(variance, z, np.array([u]))
        to_coefficients, covariance = found.weighted(square)
        beta = (to_coefficients @ values)[0, 1]
        return chi2.pdf(u, 3) * norm.cdf(-beta / np.sqrt(covariance[0, 1, 1]))

    assert LOOKED_AT == 12 + 9
    at_zero = np.sum(z**2 / variance)
    expected = quad(below, 0, at_zero, limit=200)[0] + quad(below, at_zero, np.inf)[0]
    assert found.p_value(DRIFT) == pytest.approx(2 * min(expected, 1 - expected), rel=1e-3)
    assert found.freedom == 3


def test_the_scatter_that_counts_is_no_less_than_a_share_of_the_sample():
    values, own = np.array([1.0, -1.0, 1.0, -1.0]), np.full(4, 100.0)
    assert Between(values, own, np.ones((4, 1))).counted == pytest.approx(np.sqrt(LEAST_SCATTER * 4 / 3))
    values, own = np.array([-0.4, 0.0, -2.1, -2.6, 0.9]), np.array([0.2, 0.2, 1, 4, 4])  # of contrasts by their variances
    found, (variance, z) = Between(values, own, np.ones((5, 1))), contrasts(values, own, np.ones((5, 1)))
    weight = (variance + found.scatter**2) ** -2
    assert 0.1 < found.scatter < found.counted == pytest.approx(np.sqrt(LEAST_SCATTER * (weight @ z**2) / weight.sum()))


def test_the_scatter_has_the_largest_restricted_likelihood():
    own, design = np.array([0.3, 1.0, 0.05, 0.2, 0.8, 0.1]), drifting(6)
    values = np.array([0.0, 1.4, 2.6, 1.1, 5.0, 3.0])

    def cost(square):
        inverse = np.diag(1 / (own + square))
        A = design.T @ inverse @ design
        left = values - design @ np.linalg.solve(A, design.T @ inverse @ values)
        return np.linalg.slogdet(A)[1] + np.log(own + square).sum() + left @ inverse @ left

    best = minimize_scalar(cost, bounds=(0, 20), method="bounded", options={"xatol": 1e-9}).x
    assert Between(values, own, design).scatter ** 2 == pytest.approx(best, rel=1e-5)


def test_the_interval_of_the_scatter_is_that_of_chi_square():
    """Without own errors by the squares' sum; with large ones from zero up to where the pivot is at its 5 %, not below what is usual."""
    values, one = np.array([1.0, -2.0, 0.5, 1.5, -1.0]), np.ones((5, 1))
    total = np.sum((values - values.mean()) ** 2)
    found = Between(values, np.zeros(5), one)
    assert found.scatter_interval == pytest.approx(np.sqrt(total / chi2.ppf([0.975, 0.025], 4)), rel=1e-6)
    assert found.counted == found.scatter == pytest.approx(values.std(ddof=1))
    for some, own in ((values, total / 6), (values, 1e3), (np.zeros(5), 1.0)):
        low, high = Between(some, np.full(5, own), one).scatter_interval
        assert (low, high) == (0.0, pytest.approx(np.sqrt(max(total * some.any(), 4 * own) / chi2.ppf(0.05, 4) - own), rel=1e-6))


def test_a_step_is_found_from_the_chance_that_is_stated():
    """Just more and just less significant than 5 %, by Student's t over all intervals and numbers."""
    n, at = 12, np.arange(12.0) + 0.3 * np.sin(np.arange(12))
    design = np.column_stack([np.ones(n), jump(n, 5), at - at[-1]])
    noise, _, error = equal_weights(np.random.default_rng(2).normal(size=n), design)
    bar = t.isf((1 - (1 - CHANCE) ** (1 / (11 * LOOKED_AT))) / 2, n - 3)
    assert course(noise + 0.98 * bar * error * jump(n, 5), np.zeros(n), at).steps == {}
    found = course(noise + 1.02 * bar * error * jump(n, 5), np.zeros(n), at)
    ((before, p_value),) = found.steps.items()
    assert before == 5
    assert p_value == pytest.approx(1 - (1 - 2 * t.sf(1.02 * bar, n - 3)) ** (11 * LOOKED_AT), rel=1e-4)
    assert found.model.coefficients @ found.step_column(0) == pytest.approx(1.02 * bar * error)


def test_an_effect_of_temperature_is_taken_off_where_it_shows():
    rng = np.random.default_rng(4)
    at, own, warmth = np.arange(10.0), np.full(10, 1e-6), 25 + rng.uniform(-8, 8, 10)
    noise = 0.01 * rng.normal(size=10)
    found = course(0.2 * warmth + noise, own, at, warmth)
    assert found.warms
    assert found.warming.coefficients[2] == pytest.approx(0.2, abs=0.005)
    assert found.model.scatter < 0.03
    assert not course(noise, own, at, warmth).warms
    assert course(0.2 * warmth, own, at, 25 + 0.1 * rng.normal(size=10)).warming is None  # it did not vary
    assert course(noise[:4], own[:4], at[:4], warmth[:4]).warming is None


def test_another_session_s_bias_differs_by_two_draws_from_the_spread():
    rps = np.array([1.0, 2, 3])
    found = Spread.of(ZERO, rps * DEG, "said").at(ZERO)
    assert_allclose(found.two_draws, DEG**2 * np.diag([2.0, 8, 18]), rtol=1e-12, atol=0)
    assert_allclose(found.any_session(np.array([1.0, 0, 4])), np.sqrt([1 + 2 * DEG**2, 8 * DEG**2, 4 + 18 * DEG**2]), rtol=1e-12)
    table = plain(found.to_json(np.zeros(3)))
    assert table["sigma_dps"] == pytest.approx(np.sqrt(2) * rps)
    assert (table["spread_dps"], table["degrees_of_freedom"]) == (pytest.approx(rps), [None] * 3)
    assert USUAL.at(ZERO).to_json(np.zeros(3)) is None


def test_the_first_that_tells_a_spread_is_taken_for_each_number():
    one, other = Spread.of(slice(18, 20), [1.0, np.nan], "one", 3.0), Spread.of(ZERO, 2.0, "other")
    found = one.or_else(other).or_else(USUAL).at(ZERO)
    assert (found.scatter.tolist(), found.freedom.tolist()) == ([1.0, 2.0, 2.0], [3.0, np.inf, np.inf])
    assert (found.sources.tolist(), found.is_usual) == (["one", "other", "other"], False)
    assert found.sigma[:2] == pytest.approx([t.ppf((1 + ONE_SIGMA) / 2, 3), 2.0])
    assert USUAL.at(ZERO).is_usual


SETTINGS = 'schema = "tinygc-session/1"\n[sensor]\nodr_hz = 100.0\ngyro_fs_dps = 500\naccel_fs_g = 4\n'


@pytest.fixture
def unit(tmp_path):
    """``session(number)``, of one unit, and ``fitted(name, …)``, the folder of a fit of it: only what the spread is read from."""

    def session(number=0, serial="test"):
        samples = Samples(np.arange(9) * 10_000_000, np.full((9, 3), float(number)), np.ones((9, 3)))
        made = config()
        made = replace(made, sensor=replace(made.sensor, serial=serial, gyro_bias_repeatability_dps=0.5 if number < 0 else None))
        return Session(tmp_path / "today", made, (Log(Path("log.csv"), samples, in_memory=True),), ())

    def fitted(name, bias=(0.0, 0.0, 0.0), covariance=None, **more):
        (tmp_path / name / "fit").mkdir(parents=True)
        model = LinearModel(np.eye(3), np.array(bias))
        told = {"sha256": {"log.csv": name, "session.toml": "same"}, "sensor": {"model": "ASM330LHH", "serial": "test"}}
        told |= ({} if covariance is False else {"covariance": (1e-20 * np.eye(12) if covariance is None else covariance).tolist()}) | more
        (tmp_path / name / "session.toml").write_text(SETTINGS)
        (tmp_path / name / "fit" / "model_least_squares.json").write_text(json.dumps(models.to_dict(model, **told)))
        return tmp_path / name

    return session, fitted


def test_the_spread_is_of_the_biases_of_fitted_sessions_less_their_own_variances(unit):
    session, fitted = unit
    covariance = np.diag(np.arange(12.0) + 1e-9) * 1e-3
    folders = [fitted("a", (1.0, 2.0, 0.0), covariance), fitted("b", (-1.0, 2.0, 1.0), covariance), fitted("c", (0, 2.1, -1), covariance)]
    found = spread_over(folders, session()).at(ZERO)
    widened = t.ppf((1 + ONE_SIGMA) / 2, 2)
    expected = [np.sqrt(1 - 0.009), np.sqrt(0.1 * 0.01 / 3), np.sqrt(1 - 0.011)]
    assert_allclose(found.sigma, widened * np.array(expected), rtol=1e-6)
    assert found.source == "3 other sessions of this unit"
    given = spread_of(session(-1).config).at(ZERO)
    assert (given.sigma.tolist(), given.source) == ([0.5 * DEG] * 3, "given in session.toml")
    assert spread_of(session().config).at(ZERO).is_usual


def test_the_accelerometers_spread_is_of_its_numbers_in_fitted_sessions(unit):
    """Of three sessions two degrees of freedom: the scatter beyond their own sigmas, widened; two without one show none."""
    session, fitted = unit
    values = np.array([0.3, -0.1, 0.7])

    def triad(number, sigma):
        given = {"equation": "f", "matrix": np.eye(3).tolist(), "bias_mps2": [values[number], 0.0, 0.0], "source": "stills"}
        return {"accelerometer": given, "joint_covariance": {"matrix": (np.eye(21) * sigma**2).tolist()}}

    folders = [fitted(f"t{number}", **triad(number, 1e-6)) for number in range(3)]
    for n in (2, 3):
        found = spread_over(folders[:n], session()).at(ACCELEROMETER)
        assert found.source == f"{n} other sessions of this unit"
        assert not found.is_usual
        assert found.sigma[6] == pytest.approx(t.ppf((1 + ONE_SIGMA) / 2, n - 1) * values[:n].std(ddof=1), rel=1e-4)
        assert found.sigma[7] < 1e-5
    assert np.isnan(spread_over([folders[0], fitted("bare")], session()).at(ACCELEROMETER).scatter).all()


def test_a_history_shows_no_spread_where_it_is_of_one_session_twice_or_of_another_unit(unit):
    session, fitted = unit
    one, two = fitted("a"), fitted("b")
    digest = hash_of_log(session().logs[0])
    bad = {
        "one session does not show a spread": [one],
        "a folder is given twice": [one, two, one],
        "holds the same log as .*today": [one, fitted("mine", sha256={"log.csv": digest})],
        "holds the same log as .*a;": [one, fitted("copy", sha256={"other.csv": "a"})],
        "'other', expected ASM330LHH 'test'": [one, fitted("other", sensor={"model": "ASM330LHH", "serial": "other"})],
        "of BMI088 'test', expected": [one, fitted("model", sensor={"model": "BMI088", "serial": "test"})],
        "no linear model with a covariance": [one, fitted("none", covariance=False)],
        "no such|not found|session.toml": [one, one.parent],
    }
    for said, folders in bad.items():
        with pytest.raises(FormatError, match=said):
            spread_over(folders, session())
    with pytest.raises(FormatError, match="names no serial number"):
        spread_over([one, two], session(serial=""))
    assert spread_over([one, two], session()).at(ZERO).scatter == pytest.approx(np.zeros(3), abs=1e-9)  # session.toml alike is no same log


def test_a_random_walk_grows_with_the_time_and_a_gauss_markov_saturates():
    noise = figures(sensor(axis(K=1e-6, G=2e-5, tau_s=100.0)))
    assert wander_variance(150.0, noise, None) == pytest.approx(np.full(3, 1e-12 * 150 + 2 * 4e-10 * -np.expm1(-1.5)), rel=1e-12)
    assert wander_variance(1e9, noise, None) == pytest.approx(wander_variance(END_S, noise, None), rel=1e-12)
    assert wander_variance(-1.0, noise, None) == pytest.approx(np.zeros(3))


def test_the_drift_between_two_means_is_that_of_the_wander_over_their_spans():
    at, spans, rps = np.array([45.0, 5.0, 20.0]), np.array([10.0, 10.0, 8.0]), 2e-5
    w = wander_covariance(at, spans, instability_rps=rps)
    session, use, both = w[1:, 1:].mean(), w[0, 0], w[0, 1:].mean()
    found = drift_between(at[1:], spans[1:], 45.0, 10.0, rps)
    expected = (session, use, both, session + use - 2 * both, both / np.sqrt(session * use))
    assert (found.session, found.use, found.both, found.change, found.correlation) == pytest.approx(expected, rel=1e-9)


def test_two_steps_are_found_one_after_the_other():
    at = np.arange(15.0)
    values = np.repeat([0.0, 1, -1], 5) + np.random.default_rng(8).normal(size=15) * 0.01
    found = course(values, np.full(15, 1e-4), at)
    sizes = {before: found.model.coefficients @ found.step_column(k) for k, before in enumerate(found.steps)}
    assert sizes == pytest.approx({4: 1.0, 9: -2.0}, abs=0.05)
    assert found.model.coefficients[0] == pytest.approx(-1.0, abs=0.05)  # the level is the last session's


@pytest.mark.parametrize("count", [2, 3])
def test_too_few_sessions_show_neither_drift_nor_step(count):
    found = course(np.arange(count) * 100.0, np.full(count, 1e-6), np.arange(count) * 1.0)
    assert (found.steps, found.has_drift, found.drifts, found.drift_p) == ({}, False, False, 1.0)
    assert not found.drift_column.any()
    assert found.model.freedom == count - 1 < FEWEST_WITH_DRIFT - 1


def test_a_drift_is_significant_from_the_chance_that_is_stated():
    n, at = 8, np.arange(8.0)
    noise, _, error = equal_weights(np.random.default_rng(3).normal(size=n), drifting(n))
    bar = error * t.isf(CHANCE / LOOKED_AT / 2, n - 2)
    found = [course(noise + factor * bar * at, np.zeros(n), at) for factor in (0.99, 1.01)]
    assert [(each.drifts, each.steps) for each in found] == [(False, {}), (True, {})]
