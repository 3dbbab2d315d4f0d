"""The zero and the matrix over temperature: element, sweeps, noise, lag, orders, sigmas, sessions, each by hand or with full matrices."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from numpy.testing import assert_allclose, assert_array_equal
from scipy import optimize, stats
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from small_turns import numeric_jacobian

from session.base.errors import DataError, FitError
from session.log.config import Accelerometer
from session.log.rests import RestLog
from tinygc.features.temperature import axis_fit
from tinygc.features.temperature.axis_fit import (
    AxisFit,
    _best_lag,
    _Coloured,
    _hysteresis_of,
    _lag_grid,
    about,
    columns,
    estimate_noise,
    fit_axis,
    folds_of,
    held_out,
    make_knots,
    solve_axis,
    weigh,
    white_of,
)
from tinygc.features.temperature.model import ThermalModel, element_temperature
from tinygc.features.temperature.rest_fit import (
    RestFit,
    _noise_over_temperature,
    fit_rests,
    zero_of_blocks,
)
from tinygc.features.temperature.sessions_fit import (
    ThermalFit,
    _brought_to,
    _in_frame_of_first,
    _SessionPoint,
    _zero_form,
    join,
    of_rests_alone,
    point_of,
    zero_covariance,
)
from tinygc.features.temperature.sweeps import Sweep, _turning_points, between_steps, sweeps_of
from tinygc.inference.noise import TIMES_S
from tinygc.models.linear import BIAS, MATRIX, LinearModel


def small_rest(temp_c, gyro=None, block_s=10.0, number=None, name="rest.csv", sd=None):
    """Temperatures (B,), block means (B,) or (B, 3), scatter (B, 3); number (B,) where blocks are missing."""
    count = len(temp_c)
    gyro = np.zeros((count, 3)) if gyro is None else np.asarray(gyro, dtype=float).reshape(count, -1) * np.ones(3)
    number = np.arange(count) if number is None else np.asarray(number)
    sd = np.ones((count, 3)) if sd is None else np.asarray(sd, dtype=float)
    temp, force, ten = np.asarray(temp_c, dtype=float), np.tile([0.0, 0.0, -9.8], (count, 1)), np.full(count, 10)
    return RestLog(Path(name), number, block_s, temp, gyro, force, sd, 1e-3 * sd, ten, 10 * count, block_s / 10)


def triangle(count, half):
    """Temperatures (count,) that go up from 10 to 30 degC for ``half`` blocks, down for as many, and so on."""
    return 30 - 20 * np.abs((np.arange(count) % (2 * half)) / half - 1)


# The element's temperature


@pytest.mark.parametrize(("tau", "step_s"), [(25.0, 0.01), (-25.0, 7.0)])
def test_a_lag_is_exact_on_a_ramp_whatever_the_step(tau, step_s):
    """T = v t: the element is v tau behind once the start is forgotten."""
    temp = 20 + 0.05 * np.arange(0, 600, step_s)
    assert element_temperature(temp, tau, step_s)[-1] == pytest.approx(temp[-1] - 0.05 * tau, abs=1e-6)


# Sweeps and knots


@pytest.mark.parametrize(
    ("values", "points"),
    [
        ((0, 3, 5, 3, 1, 4), [0, 2, 4, 5]),
        ((0, 3, 1.01, 6, 4.01), [0, 3]),  # a smaller reversal ends nothing
        ((1, 0, 0, 5, 5, 0), [1, 3, 5]),
        ((1, 2, 1, 0.5), [0, 3]),
        ((1, 2, 0, 3), [1, 2, 3]),
    ],
)
def test_turning_points_are_the_first_extreme_each_reversal_and_the_last(values, points):
    assert _turning_points(np.array(values, dtype=float), 2.0) == points


@pytest.mark.parametrize(("share", "ways"), [(0.24, [1]), (0.26, [1, -1, 1])])
def test_a_reversal_of_a_quarter_of_the_range_ends_a_sweep(share, ways):
    """From 0 to 30, back by this share, up to 40: of 40 degrees.  The running median of nine flattens each peak by two blocks."""
    back = 40 * share + 1
    temp = np.concatenate([np.arange(0, 30, 0.25), np.arange(30, 30 - back, -0.25), np.arange(30 - back, 41, 0.25)])
    found = sweeps_of(temp, 3)
    assert [(each.direction, each.log) for each in found] == [(way, 3) for way in ways]
    assert [each.start for each in found] == pytest.approx([0, 120, 120 + back / 0.25][: len(ways)], abs=3)
    assert [each.stop for each in found] == [*(each.start for each in found[1:]), len(temp)]


def test_knots_are_means_over_their_blocks(monkeypatch):
    """Two logs, the first of two sweeps, of six and four blocks, the other of ten without: eight knots in all."""
    monkeypatch.setattr(axis_fit, "MOST_KNOTS", 8)
    temp = np.array([0.0, 1, 2, 3, 4, 5, 6, 4, 2, 0])
    first, other = small_rest(temp), small_rest(temp + 10, block_s=5.0, number=[0, 1, 2, 3, 4, 5, 6, 8, 9, 10])
    knots = make_knots([first, other], [Sweep(0, 0, 6, 1), Sweep(0, 6, 10, -1)])
    assert knots.starts.tolist() == [0, 3, 6, 8, 10, 12, 15, 17]
    assert knots.span_s.tolist() == [30, 30, 20, 20, 10, 15, 10, 15]
    assert np.column_stack([knots.of, knots.sweep, knots.direction]).tolist() == [[0, 0, 1]] * 2 + [[0, 1, -1]] * 2 + [[1, 2, 0]] * 4
    assert knots.mean(np.arange(40.0).reshape(20, 2))[1].tolist() == [8, 9]
    temps, middles_s = np.append(temp, temp + 10), np.append(10 * np.arange(10) + 5, 5 * other.number + 2.5)
    assert (knots.temp_c, knots.t_s) == (pytest.approx(knots.mean(temps)), pytest.approx(knots.mean(middles_s)))
    assert (knots.reference_c, knots.half_c) == (8, 8)
    # A power is averaged over the blocks, not that of the knot's mean.
    assert knots.powers(0.0, 4) == pytest.approx(knots.mean(((temps - 8) / 8)[:, None] ** [1, 2, 3, 4]))
    element = np.interp(np.arange(11), other.number, other.temp_c)
    lagged = np.concatenate([element_temperature(temp, 25.0, 10.0), element_temperature(element, 25.0, 5.0)[other.number]])
    assert knots.element_c(25.0) == pytest.approx(lagged)
    assert columns(knots, 25.0, 1) == pytest.approx(np.column_stack([knots.of == 0, knots.of, knots.mean((lagged - 8) / 8)]))


def test_covariances_of_means_over_a_knots_time():
    """White of density 1: one over its span. Flicker: Gauss-Markov in octaves, each averaged over the span, by direct summation. A random
    walk at the knot's middle. Logs are independent."""
    temp = triangle(8, 4)
    knots = make_knots([small_rest(temp), small_rest(temp, block_s=5.0)], [])
    white, flicker, walk = knots.covariances()
    assert white == pytest.approx(np.diag(1 / knots.span_s))
    assert walk[:8, :8] == pytest.approx(np.minimum.outer(knots.t_s[:8], knots.t_s[:8]))
    for each in (flicker, walk):
        assert not each[:8, 8:].any()
    fine = (np.arange(400) + 0.5) / 400 * 10
    for other, apart_s in ((1, 0), (4, 30)):
        octaves = [np.exp(-np.abs(fine[:, None] - fine - apart_s) / T).mean() for T in TIMES_S]
        assert flicker[1, other] == pytest.approx(np.log(2) / np.pi * sum(octaves), rel=1e-3)


# Noise and lag


def least_squares(y, A, C):
    """Generalised, with full matrices: terms, their covariance, chi-square."""
    covariance = np.linalg.inv(A.T @ np.linalg.solve(C, A))
    terms = covariance @ A.T @ np.linalg.solve(C, y)
    return terms, covariance, (y - A @ terms) @ np.linalg.solve(C, y - A @ terms)


def summed(sizes, V):
    return sum(s**2 * v for s, v in zip(sizes, V, strict=True))


def restricted(sizes, y, A, V):
    """-2 log of the restricted likelihood."""
    C = summed(sizes, V)
    _, covariance, square = least_squares(y, A, C)
    return np.linalg.slogdet(C)[1] - np.linalg.slogdet(covariance)[1] + square


@pytest.fixture(scope="module")
def rest():
    """Knots (40) of two sweeps up and two down, and noise of known sizes on them."""
    knots = make_knots([small_rest(triangle(40, 10))], sweeps_of(triangle(40, 10)))
    V = knots.covariances()
    return knots, V, np.linalg.cholesky(summed((1.0, 0.1, 0.01), V))


@pytest.mark.parametrize("unit", [1.0, 1e6])
def test_the_noise_is_that_of_the_largest_restricted_likelihood(rest, unit):
    knots, V, root = rest
    A = columns(knots, 0.0, 2)
    y = unit * (root @ np.random.default_rng(1).normal(size=40) + A @ [300.0, -200, 100])
    found = estimate_noise(y, 1e7 * unit * A, V, unit * 1.0)
    best = optimize.minimize(
        lambda logs: restricted(np.hypot(np.exp(logs), [0.5 * unit, 0, 0]), y, A, V),
        np.log(unit * np.array([0.9, 0.1, 0.01])),
        method="Nelder-Mead",
        options={"maxiter": 2000, "xatol": 1e-4, "fatol": 1e-6},
    )
    assert restricted(found.sizes, y, A, V) < best.fun + 0.02
    assert found.sizes[0] >= 0.5 * unit
    assert_allclose(found.C, summed(found.sizes, V))
    assert found.factor @ found.factor.T == pytest.approx(found.C)


def test_white_noise_is_no_less_than_half_of_what_the_blocks_say(rest):
    """Knots without any scatter of their own; and blocks that say nothing."""
    knots, V, root = rest
    A = columns(knots, 0.0, 1)
    quiet = estimate_noise(1e-3 * root @ np.random.default_rng(0).normal(size=40), 1e4 * A, V, 1.0)
    assert quiet.sizes == pytest.approx([0.5, 0, 0], abs=1e-3)
    smooth = 1e3 * np.linspace(-1, 1, 40) ** 3  # no white noise; then half of what all of the scatter would be
    left = least_squares(smooth, A, np.eye(40))[2] / 40
    assert estimate_noise(smooth, 1e7 * A, V, 0.0).sizes[0] == pytest.approx(0.5 * np.sqrt(10 * left), rel=1e-6)
    assert np.isfinite(estimate_noise(np.zeros(40), A, V, 0.0).sizes).all()


def left_at(knots, y, root, order):
    return lambda tau: least_squares(y, columns(knots, tau, order), root @ root.T)[2]


@pytest.mark.parametrize("tau", [30.0, -18.0, 55.0])
def test_the_lag_is_where_the_misfit_is_least(rest, tau):
    knots, _, root = rest
    y = columns(knots, tau, 2) @ [3.0, 20.0, 4.0] + 0.3 * root @ np.random.default_rng(1).normal(size=40)
    left = left_at(knots, y, root, 2)
    found = _best_lag(knots, y, root, np.array([-60.0, -40, -20, -10, 10, 20, 40, 60]), 2)
    exact = optimize.minimize_scalar(left, bounds=sorted([0.5 * tau, 2 * tau]), method="bounded").x
    assert found == pytest.approx(exact, abs=0.05)


def test_lags_are_tried_up_to_a_quarter_of_the_shortest_sweep():
    temp = np.concatenate([triangle(60, 30), triangle(40, 20)[1:]])
    knots = make_knots([small_rest(temp)], sweeps_of(temp))
    shortest, lags = min(knots.span_s[knots.sweep == k].sum() for k in range(4)), _lag_grid(knots)
    assert lags[20:] == pytest.approx(np.geomspace(10, shortest / 4, 20))
    assert lags == pytest.approx(-lags[::-1])
    # None in one direction, and none where a quarter is no more than four blocks.
    for sweeps, half, some in ((1, 40, False), (2, 16, False), (2, 18, True)):
        ways = [Sweep(0, 0, half, 1), Sweep(0, half, 2 * half, -1)][:sweeps]
        assert bool(len(_lag_grid(make_knots([small_rest(triangle(sweeps * half, half))], ways)))) == some


def test_hysteresis_is_the_difference_of_means_at_one_temperature():
    """Rising over 0 to 80, falling over 80 to 16: eight bins over 16 to 80, each knot by its span."""
    temp = np.concatenate([np.arange(0.0, 81, 4), np.arange(78.0, 15, -2)])
    knots = make_knots([small_rest(temp)], [Sweep(0, 0, 21, 1), Sweep(0, 21, 53, -1)])
    knots = replace(knots, span_s=np.resize([10.0, 30.0], 53))
    knots.direction[[6, 40]] = 0  # of a log without sweeps
    rng = np.random.default_rng(0)
    residual, root = rng.normal(size=53), rng.normal(size=(53, 53))
    found, weights = _hysteresis_of(knots, residual, root @ root.T), np.zeros((8, 53))
    for way in (1, -1):
        here = knots.span_s * (knots.direction == way) * ((temp - 16) // (62 / 8) == np.arange(8)[:, None])
        weights += way * here / here.sum(axis=1, keepdims=True)
    assert found.at_c == pytest.approx(16 + 62 / 8 * (np.arange(8) + 0.5))
    assert found.difference == pytest.approx(weights @ residual)
    assert found.sigma == pytest.approx(np.linalg.norm(weights @ root, axis=1))
    k = np.argmax(np.abs(found.difference))
    assert found.largest == (found.difference[k], found.sigma[k], found.at_c[k])
    assert found.rms == pytest.approx(np.sqrt(np.mean(found.difference**2)))
    assert _hysteresis_of(replace(knots, direction=np.abs(knots.direction)), residual, root @ root.T) is None
    apart = make_knots([small_rest([0.0, 10, 20, 40, 30, 25])], [Sweep(0, 0, 3, 1), Sweep(0, 3, 6, -1)])
    assert _hysteresis_of(apart, np.zeros(6), np.eye(6)) is None


# Orders and sigmas


def test_candidates_are_weighed_by_their_evidence_and_their_prior(rest):
    """Each about its own noise: C and the priors' variance of the columns make the covariance of the knots."""
    knots, V, root = rest
    y = columns(knots, 25.0, 2) @ [1.0, 9.0, 3.0] + root @ np.random.default_rng(4).normal(size=40)
    y, lags = y / np.std(y), np.array([-40.0, -20, -10, 10, 20, 40])
    found = weigh(knots, y, V, 0.05, (0, 1, 2), lags)
    tau = _best_lag(knots, y, about(knots, y, V, 0.05, 2).factor, lags, 2)
    assert [(each.order, each.tau_s) for each in found] == [(0, 0), (1, 0), (2, 0), (1, tau), (2, tau)]
    assert [sorted(each.ids) for each in found] == [[], ["effect"], ["effect"], ["effect", "lag"], ["effect", "lag"]]
    of_effect, of_lag = 2 * np.log(30 * 2), 2 * (np.log(10) + np.log(2) + np.log(30)) + 1
    for each in found:
        J = columns(knots, each.tau_s, each.order) * np.array([1e4 * np.abs(y).max(), 1.0, 1.0])[: 1 + each.order]
        whole = each.noise.C + J @ J.T
        of_data = np.linalg.slogdet(whole)[1] + y @ np.linalg.solve(whole, y)
        assert each.score == pytest.approx(of_data + of_effect * (each.order > 0) + of_lag * (each.tau_s != 0), abs=1e-3)
    assert min(found, key=lambda each: each.score) is found[4]


@pytest.mark.parametrize("tau", [0.0, 25.0])
def test_each_fold_is_predicted_from_the_others_with_equal_weights(rest, tau):
    """The lag too, in a step from that of all."""
    knots, _, root = rest
    y = columns(knots, 25.0, 2) @ [1.0, 9.0, 3.0] + root @ np.random.default_rng(4).normal(size=40)
    A, squares = columns(knots, tau, 2), []
    coefficients = np.linalg.lstsq(A, y, rcond=None)[0]
    if tau:
        A = np.column_stack([A, (columns(knots, 25.5, 2) - columns(knots, 24.5, 2)) @ coefficients])
    for sweep in np.unique(knots.sweep):
        train, test = knots.sweep != sweep, knots.sweep == sweep
        squares.append(np.mean((y[test] - A[test] @ np.linalg.lstsq(A[train], y[train], rcond=None)[0]) ** 2))
    assert held_out(knots, y, 2, tau) == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-5)
    folds, by = folds_of(make_knots([small_rest(np.arange(50.0))], [Sweep(0, 0, 50, 1)]))
    assert (by, folds.tolist()) == ("stretches", [k * 20 // 50 % 5 for k in range(50)])


def test_the_zero_of_a_log_that_is_left_out_is_not_predicted():
    temp = triangle(12, 6)
    knots = make_knots([small_rest(temp), small_rest(temp)], [Sweep(0, 0, 12, 1), Sweep(1, 0, 6, 1), Sweep(1, 6, 12, -1)])
    y, squares = np.random.default_rng(5).normal(size=24) + 50.0 * knots.of, []
    mean_square = lambda error: np.mean(error**2)  # noqa: E731
    for sweep, known, size in ((0, [1, 2], np.var), (1, [0, 1, 2], mean_square), (2, [0, 1, 2], mean_square)):
        test, A = knots.sweep == sweep, columns(knots, 0.0, 1)[:, known]
        squares.append(size(y[test] - A[test] @ np.linalg.lstsq(A[~test], y[~test], rcond=None)[0]))
    assert held_out(knots, y, 1, 0.0) == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-5)


@pytest.mark.parametrize("tau", [0.0, 25.0])
def test_a_covariance_is_the_numeric_derivative_of_the_estimate_times_that_of_the_knots(rest, tau):
    """The lag is where the weighted misfit is least; the coefficients have equal weights at that lag."""
    knots, _, root = rest
    truth, noise = np.array([3.0, 20.0, 4.0]), _Coloured(np.ones(3), root @ root.T)
    y = columns(knots, tau, 2) @ truth

    def estimate(values):
        if not tau:
            return np.linalg.lstsq(columns(knots, 0.0, 2), values, rcond=None)[0]
        left = left_at(knots, values, root, 2)
        # The least of a parabola through three points, once more about it.
        at = tau
        for step in (0.5, 0.1):
            low, middle, high = left(at - step), left(at), left(at + step)
            at += step / 2 * (low - high) / (low + high - 2 * middle)
        return np.append(np.linalg.lstsq(columns(knots, at, 2), values, rcond=None)[0], at)

    slope = numeric_jacobian(estimate, y, 1e-3)
    coefficients, covariance = solve_axis(knots, y, noise, tau, 2)
    assert coefficients == pytest.approx(truth)
    assert covariance == pytest.approx(slope @ noise.C @ slope.T, rel=5e-3)


def made(lag_s=0.0, coefficients=(0.5, 8e-3, 2e-4), logs=1, seed=0):
    """Rest logs whose zero is a polynomial of the element's temperature about 20 degC, with white noise."""
    rng, temp = np.random.default_rng(seed), triangle(80, 20)
    element = element_temperature(temp, lag_s, 10.0)
    zero = np.polynomial.polynomial.polyval(element - 20, coefficients)
    return [small_rest(temp, zero + 0.1 * k + 2e-3 * rng.normal(size=80), name=f"{k}.csv") for k in range(logs)]


def fitted(logs, **more):
    knots = make_knots(logs, [sweep for k, log in enumerate(logs) for sweep in sweeps_of(log.temp_c, k)])
    return knots, fit_axis(knots, np.concatenate([log.gyro[:, 0] for log in logs]), **more)


@pytest.mark.parametrize("lag_s", [0.0, 20.0])
def test_a_fit_is_put_together_from_these(lag_s):
    """In any unit: terms, covariance, what is left, what was held out, and the hysteresis with and without the lag."""
    logs = made(lag_s, logs=2)
    knots, fit = fitted(logs)
    assert (fit.order, fit.tau_s > 0) == (2, lag_s > 0)
    y = knots.mean(np.concatenate([log.gyro[:, 0] for log in logs]))
    lagged, A, plain = lag_s > 0, columns(knots, fit.tau_s, 2), columns(knots, 0.0, 2)
    coefficients, covariance = solve_axis(knots, y, fit.noise, fit.tau_s, 2)
    # Per degree, and the zero the mean of both logs.
    per_c, size = block_diag([[0.5, 0.5]], 1 / knots.half_c, 1 / knots.half_c**2, *[1] * lagged), 3 + lagged
    assert fit.terms == pytest.approx(per_c[:3, :4] @ coefficients)
    assert fit.covariance[:size, :size] == pytest.approx(per_c @ covariance @ per_c.T, rel=1e-6)
    assert (fit.covariance.shape, fit.covariance[size:].any()) == ((4, 4), False)
    assert fit.left == pytest.approx(np.sqrt(np.mean((y - A @ coefficients) ** 2)))
    assert fit.turn_on == pytest.approx(np.std(coefficients[:2], ddof=1))
    for found, B in ((fit.hysteresis_after, A), (fit.hysteresis_before, plain)):
        expected = _hysteresis_of(knots, y - B @ np.linalg.lstsq(B, y, rcond=None)[0], fit.noise.C)
        assert (*found.difference, *found.sigma) == pytest.approx((*expected.difference, *expected.sigma), rel=1e-6)
    assert (fit.held_out, fit.held_out_constant) == pytest.approx((held_out(knots, y, 2, fit.tau_s), held_out(knots, y, 0, 0.0)), rel=1e-5)
    assert fit.p_value < 1e-6
    if lag_s:
        assert fit.tau_s == pytest.approx(lag_s, abs=4 * fit.sigma[-1])
        _, large = fitted([replace(log, gyro=1000 * log.gyro) for log in logs])
        assert large.terms == pytest.approx(1000 * fit.terms, rel=1e-6)
        assert (large.held_out, large.left, large.turn_on) == pytest.approx((1000 * fit.held_out, 1000 * fit.left, 1000 * fit.turn_on))
        assert_allclose(large.noise.C, 1e6 * fit.noise.C, rtol=1e-3)


def test_what_is_not_there_is_not_claimed_and_what_may_not_be_tried_is_not():
    knots, none = fitted(made(coefficients=(0.5,), seed=1))
    y = knots.mean(knots.logs[0].gyro[:, 0])
    assert (none.order, none.tau_s, none.line.order) == (0, 0, 0)
    assert np.isnan(none.turn_on)
    assert (none.terms, none.sigma[0]) == (pytest.approx([np.mean(y)]), pytest.approx(np.sqrt(none.noise.C.sum()) / len(knots)))
    # Where nothing depends on temperature the noise is that about a constant.
    white = np.median(np.abs(np.diff(knots.logs[0].gyro[:, 0], n=2))) / 0.6745 / np.sqrt(6) * np.sqrt(10)
    about_it = about(knots, y / np.std(y), knots.covariances(), white / np.std(y), 0)
    assert none.noise.sizes == pytest.approx(about_it.sizes * np.std(y))
    assert fitted(made(), orders=(0, 1))[1].order == 1
    _, still = fitted([small_rest(np.full(30, 25.0), np.random.default_rng(0).normal(size=30))])
    assert (still.order, still.p_value, still.line) == (0, 1, None)
    # Two rests, each at a temperature of its own: their zeros take up any slope.
    noise = np.random.default_rng(0).normal(size=(2, 30))
    _, two = fitted([small_rest(np.full(30, t), n) for t, n in zip((10.0, 20.0), noise, strict=True)], orders=(0, 1))
    assert (two.order, two.p_value, two.line) == (0, 1, None)


# Between the steps of a thermometer


T = np.arange(400.0)


#: rms of a uniform error, of its width; of a parabola about its chord, as ``sweeps`` has it
UNIFORM, BENT = 0.5 / np.sqrt(3), 0.046


def stepped_to(temp_c, step=1.0):
    return np.round(np.asarray(temp_c) / step) * step


def test_passages_by_hand():
    """Steps at 10, 20, 40, 60 of readings 0 to 4: rates 1/10, 1/20, 1/20; the ends go on as beside, the first to the reading's own edge."""
    reading = np.repeat([0.0, 1, 2, 3, 4], [10, 10, 20, 20, 10])
    t = np.arange(70) + 0.5
    temp_c, sigma_c, interval = between_steps(t, 5 + 2 * reading, (2.0, 5.0))
    assert np.interp([10, 20, 40, 60], t, temp_c) == pytest.approx([6, 8, 10, 12], abs=0.02)
    assert interval.tolist() == np.repeat([0, 1, 2, 3, 4], [10, 10, 20, 20, 10]).tolist()
    sigma = [UNIFORM * 0.95, BENT * 0.5, BENT, 0.0, UNIFORM * 9.5 / 20]
    assert sigma_c == pytest.approx(2 * np.repeat(sigma, [10, 10, 20, 20, 10]))
    assert temp_c[-1] == pytest.approx(5 + 2 * (3.5 + 9.5 / 20))
    assert temp_c[0] == pytest.approx(5 + 2 * (0.5 - 0.95))


@pytest.mark.parametrize(("rests", "by"), [(8, 0.2), (18, 0.45), (100, 0.5)])
def test_where_it_turns_it_goes_half_of_a_parabolas_way(rests, by):
    """Up a step in ten, down as fast; what it passed twice ``rests`` apart."""
    reading = np.concatenate([np.repeat([0.0, 1, 2], 10), np.full(rests, 3.0), np.repeat([2.0, 1, 0], 10)])
    t = np.arange(len(reading)) + 0.5
    temp_c, sigma_c, _ = between_steps(t, reading, (1.0, 0.0))
    middle = 30 + rests // 2
    assert temp_c[middle] == pytest.approx(2.5 + by, abs=0.01)
    assert sigma_c[middle] == pytest.approx(UNIFORM * min(rests / 40, 1))


def test_what_is_left_as_it_is():
    """No grid; fine steps; noise that carries the means across the steps; and where it stays, a uniform error."""
    temp_c = np.linspace(20, 40, 400)
    wide = stepped_to(temp_c) + 0.18 * np.random.default_rng(0).standard_normal(400)
    for means, grid in ((temp_c, (0.0, 0.0)), (stepped_to(temp_c, 0.01), (0.01, 0.0)), (wide, (1.0, 0.0)), (temp_c[:1], (1.0, 0.0))):
        found, sigma_c, _ = between_steps(np.arange(len(means)), means, grid)
        assert found is means
        assert not sigma_c.any()
    _, stays, _ = between_steps(T, np.repeat([0.0, 1, 2, 3, 4, 5], [5, 5, 5, 375, 5, 5]), (1.0, 0.0))
    flat, sigma_c, _ = between_steps(T, np.full(400, 20.0), (2.0, 0.0))
    assert (set(flat), sigma_c[0], stays[200]) == ({20.0}, pytest.approx(2 * UNIFORM), pytest.approx(UNIFORM))


def stepped(noise=0.003, back=False):
    """A rest log of a thermometer of 1 degC."""
    temp_c = 20.3 + 9 * (1 - np.abs(T / 200 - 1) if back else T / 400)
    gyro = 0.02 * (temp_c - 20) + noise * np.random.default_rng(0).standard_normal(400)
    return replace(small_rest(stepped_to(temp_c), gyro, block_s=4.0), grid=(1.0, 20.0))


def test_the_knots_carry_the_errors_of_the_steps():
    """Of each interval one, alike in all its blocks; of a knot the mean."""
    logs = [stepped()] * 2
    knots = make_knots(logs, [])
    temp_c, sigma_c, interval = between_steps(logs[0].t_s, logs[0].temp_c, logs[0].grid)
    of_one = np.eye(interval.max() + 1)[interval] * sigma_c[:, None]
    expected = knots.mean(block_diag(of_one, of_one))
    assert knots.off_c @ knots.off_c.T == pytest.approx(expected @ expected.T)
    assert knots.temp_c == pytest.approx(knots.mean(np.tile(temp_c, 2)))


def test_the_errors_weigh_with_the_slope_there():
    """Of 0.5 + 0.02 T + 0.001 T^2 the slope is 0.02 + 0.002 T; a constant has none."""
    knots = make_knots([stepped()], [])
    y = 0.5 + columns(knots, 0.0, 2)[:, 1:] @ [0.02 * knots.half_c, 0.001 * knots.half_c**2]
    off, V = (0.02 + 0.002 * (knots.temp_c - knots.reference_c))[:, None] * knots.off_c, knots.covariances()
    assert knots.of_steps(y, 0.0, 2) == pytest.approx(off @ off.T, abs=1e-12)
    assert not knots.of_steps(y, 0.0, 0).any()
    with_them = about(knots, y, V, 0.01, 2)
    assert_allclose(with_them.C, summed(with_them.sizes, V) + off @ off.T, atol=1e-12)


@pytest.mark.parametrize(("noise", "near"), [(0.3, 0), (0.2, 1)])
def test_the_line_of_a_constant_by_full_matrices(noise, near):
    """Slope by equal weights, sigma in the noise of the constant; and the best polynomial where its evidence is near."""
    log = stepped(noise, back=True)
    knots, fit = fitted([log])
    y, V = knots.mean(log.gyro[:, 0]), knots.covariances()
    G = np.linalg.pinv(columns(knots, 0.0, 1))[1] / knots.half_c
    assert fit.order == 0
    assert (fit.line.slope, fit.line.sigma) == (pytest.approx(G @ y), pytest.approx(np.sqrt(G @ fit.noise.C @ G)))
    size = np.std(y)
    weighed = weigh(knots, y / size, V, white_of(knots, log.gyro[:, 0] / size), (0, 1, 2, 3, 4, 5), _lag_grid(knots))
    rival = min(weighed[1:], key=lambda each: each.score)
    assert (rival.score - weighed[0].score < 6) == bool(near)
    assert fit.line.order == near


# Rest logs beside the zero


def test_noise_over_temperature_is_a_regression_of_the_scatter():
    """Half the relative slope of the variance; neighbours that are alike widen its sigma; eight bins of the range."""
    temp, wave = np.linspace(10, 42, 200), 1 + 0.3 * np.sin(np.arange(200) / 9)
    one, two = np.sqrt((1 + 0.02 * (temp - 26)) * np.random.default_rng(1).chisquare(30, (2, 200)) / 30)
    sd = np.column_stack([one, two * wave, wave])  # of the last neighbours are more alike than counts
    found = _noise_over_temperature([small_rest(temp[:120], sd=sd[:120]), small_rest(temp[120:], sd=sd[120:])])
    half = sd**2 / np.mean(sd**2, axis=0) / 2
    slope, at_zero = np.polyfit(temp, half, 1)
    left = half - at_zero - np.outer(temp, slope)
    alike = 1 + 2 * np.clip(np.mean(left[1:] * left[:-1], axis=0) / np.mean(left**2, axis=0), 0, 0.95)
    sigma = np.sqrt(np.mean(left**2, axis=0) / (200 * np.var(temp)) * alike)
    assert (found.per_c, found.sigma) == (pytest.approx(slope), pytest.approx(sigma))
    in_bin = (np.minimum((temp - 10) // 4, 7) == np.arange(8)[:, None]) / 25
    assert (found.at_c, found.rms) == (pytest.approx(in_bin @ temp), pytest.approx(np.sqrt(in_bin @ sd**2)))
    for more, bins in ((9, 4), (10, 5)):  # a bin of fewer than ten blocks is left out
        assert len(_noise_over_temperature([small_rest(np.append(temp, np.full(more, 80.0)))]).at_c) == bins
    for bare in (small_rest(np.linspace(10, 10.9, 50)), small_rest(temp, sd=sd * [1, 0, 1]), small_rest(np.full(50, np.nan))):
        assert _noise_over_temperature([bare]) is None


def test_the_zero_of_blocks_is_that_of_the_polynomial():
    temp = triangle(24, 12)
    logs = [small_rest(temp, np.arange(24.0)), small_rest(temp + 5, np.arange(24.0) ** 2)]
    knots, flat = fitted(logs, orders=(0,))
    assert zero_of_blocks(make_knots([small_rest([np.nan] * 4)], []), flat).tolist() == [flat.terms[0]] * 4
    element, fit = knots.element_c(15.0) - knots.reference_c, replace(flat, terms=np.array([1.0, 2.0, 0.5]), tau_s=15.0)
    assert zero_of_blocks(knots, fit) == pytest.approx(1 + 2 * element + 0.5 * element**2)


def test_rest_logs_are_fitted_axis_by_axis_without_their_knocks():
    rng, temp = np.random.default_rng(2), triangle(48, 12)
    zero = np.outer(temp - 20, [0.03, 0, -0.02]) + 1e-3 * rng.normal(size=(48, 3))
    sd = 1e-3 * (1 + 0.1 * rng.random((48, 3)))
    zero[30], sd[30] = zero[30] + 0.2, 1.0
    log = small_rest(temp, zero, sd=sd)
    found = fit_rests([log], orders=(0, 1))
    (kept,) = found.knots.logs
    assert 30 not in kept.number
    assert [each.direction for each in found.sweeps] == [1, -1, 1, -1]
    assert [fit.order for fit in found.gyro] == [1, 0, 1]
    for fits, values in ((found.gyro, kept.gyro), (found.accel, kept.accel)):
        assert fits[2].terms.tolist() == fit_axis(found.knots, values[:, 2], (0, 1)).terms.tolist()
    assert found.range_c == (kept.temp_c.min(), kept.temp_c.max())
    alone = of_rests_alone("x", found, {})
    assert_array_equal(alone.covariance[MATRIX.stop :, MATRIX.stop :], zero_covariance(found.gyro, 1))
    assert_array_equal(alone.model.E_terms, np.eye(3)[None])
    assert (alone.sigma[MATRIX].max(), len(alone.names)) == (0, len(alone.sigma))
    bare = fit_rests([replace(log, temp_c=np.full(48, np.nan))])
    assert ([fit.order for fit in bare.gyro], bare.noise) == ([0, 0, 0], None)
    with pytest.raises(DataError, match=r"b.csv has no temperature, and other rest logs have"):
        fit_rests([log, small_rest([np.nan] * 48, name="b.csv")])


# Sessions at several temperatures


RNG = np.random.default_rng(4)


E0, E1 = np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), np.diag([60e-6, -30e-6, 100e-6])


SIGN = np.array([1.0, -1.0, 1.0])


#: of rest_log about 30 degC: 0.03 dps/degC and 2e-4 dps/degC^2 with the signs +, -, +
ZERO = np.array([[0.5, -0.3, 0.6], 0.03 * SIGN, 2e-4 * SIGN]) * DEG


TRUTH = ThermalModel(np.stack([E0, E1]), ZERO, np.zeros(3), 30.0, (-40.0, 105.0))


#: a root of a session's covariance: 50 ppm and 1 mdps, correlated
ROOT = np.diag([5e-5] * 9 + [1e-3 * DEG] * 3) @ (np.eye(12) + 0.2 * np.tril(RNG.normal(size=(12, 12)), -1))


def test_the_zero_form_of_a_covariance_is_its_derivative():
    model, m = LinearModel(E0, np.array([0.01, -0.02, 0.03])), np.array([0.3, -0.1, 0.2])
    values, covariance = _zero_form(model, np.eye(12))
    slope = numeric_jacobian(lambda vector: _zero_form(LinearModel.from_vector(vector), np.eye(12))[0], model.vector, 1e-6)
    assert_allclose(covariance, slope @ slope.T, atol=1e-7)
    assert_allclose(values[:9].reshape(3, 3) @ (m - values[9:]), model(m), atol=1e-15)


def test_a_session_is_brought_to_its_mean_temperature():
    """Readings less the change of the zero since the mean temperature, each axis at its element."""
    model = replace(TRUTH, lag_s=np.array([30.0, 0.0, -10.0]))
    samples = Table().tumble(2, seed=1).samples(seed=1, registers=False)
    temp = 20 + 3 * (1 - np.exp(-samples.t_s / 40))
    session = session_of(replace(samples, temp_c=temp))
    elements = np.column_stack([element_temperature(temp, tau, samples.period_s) for tau in (30.0, 0.0, -10.0)])
    expected = samples.gyro - (model.zero(elements) - model.zero(np.full((1, 3), 21.0)))
    assert _brought_to(session.logs[0], model, 21.0).samples.gyro == pytest.approx(expected, abs=1e-15)
    bare = replace(session.logs[0], samples=replace(samples, temp_c=None))
    with pytest.raises(FitError, match=r"log0001.csv has no temperature"):
        point_of(replace(session, logs=(bare,)), None)
    with pytest.raises(FitError, match="no session with turns"):
        join([], None)


def joined(sessions, rests):
    return ThermalFit("name", sessions.model, sessions.covariance, rests, sessions, {})


def some_points(celsius, seed=0, spread=1.0):
    """Sessions with covariances of their own, about a truth that is linear in temperature; ``spread``: of their values, in sigmas."""
    rng, made = np.random.default_rng(seed), []
    for c in celsius:
        root = ROOT * np.exp(0.3 * rng.normal(size=(12, 1)))
        there = np.append(TRUTH.at(c).E, TRUTH.zero(np.full((1, 3), c)))
        made.append(_SessionPoint("s", c, c - 1, c + 2, there + spread * root @ rng.normal(size=12), root @ root.T, 20))
    return made


def dense(points, columns, design):
    """Chi-square of some columns (k,) of all sessions about a design (n, p) for each, by generalised least squares."""
    y = np.concatenate([point.values[columns] for point in points])
    C = block_diag(*[point.covariance[columns][:, columns] for point in points])
    return least_squares(y, np.kron(design, np.eye(len(columns))), C)[2]


def assert_whole(points, fit, shape=()):
    """All numbers of a fit and their covariance are those of one least squares with full matrices: the sessions' values, with its widening
    of E and its scatter from switch-on, beside the terms above the level, and the lags, of rest logs."""
    n, q = len(fit.model.E_terms), len(fit.model.zero_terms)
    start, prior = np.zeros(9 * n + 3 * q + 3), np.zeros((9 * n + 3 * q + 3,) * 2)
    for i, axis in enumerate(shape):
        rows = 9 * n + np.append(3 * np.arange(1, axis.order + 1) + i, 3 * q + i)
        start[rows], prior[np.ix_(rows, rows)] = np.append(axis.terms[1:], axis.tau_s), axis.covariance[1:, 1:]
    sizes = [np.append(np.full(9, np.sqrt(fit.widened)), np.ones(3))] * len(points)
    switch = np.nan_to_num(fit.turn_on_rps) ** 2 * np.diag(np.repeat([0.0, 1.0], [9, 3]))
    C = block_diag(*[np.outer(size, size) * point.covariance + switch for size, point in zip(sizes, points, strict=True)])
    away = [point.temp_c - fit.model.reference_c for point in points]
    A = np.concatenate([block_diag(*(np.kron(x ** np.arange(k), np.eye(w)) for k, w in ((n, 9), (q, 3)))) for x in away])
    A = np.pad(A, ((0, 0), (0, 3)))
    free = np.arange(len(start)) < 9 * n + (3 if shape else 3 * q)
    known = prior.diagonal() > 0
    information = A.T @ np.linalg.solve(C, A)
    information[np.ix_(known, known)] += np.linalg.inv(prior[np.ix_(known, known)])
    some = np.ix_(free | known, free | known)
    covariance = np.zeros_like(prior)
    covariance[some] = np.linalg.inv(information[some])
    y = np.concatenate([point.values for point in points])
    vector = start + covariance @ A.T @ np.linalg.solve(C, y - A @ start)
    sigma = np.sqrt(covariance.diagonal()) + 1e-30
    found = np.concatenate([fit.model.E_terms.ravel(), fit.model.zero_terms.ravel(), fit.model.lag_s])
    assert_allclose((found - vector) / sigma, 0, atol=1e-6)
    assert_allclose((fit.covariance - covariance) / np.outer(sigma, sigma), 0, atol=1e-6)


@pytest.mark.parametrize(("celsius", "spread"), [((0.0, 60.0), 1.0), ((-10.0, 21.0, 40.0, 71.0), 1.0), ((20.0, 20.5, 21.0), 3.0)])
def test_E_is_generalised_least_squares_of_all_sessions(celsius, spread):
    """Its order the lowest that one percent does not refuse; sigmas wider where the sessions scatter by more."""
    points = some_points(celsius, spread=spread)
    fit = join(points, None)
    order, most = len(fit.model.E_terms) - 1, min(len(celsius) - 1, 2) if np.ptp(celsius) > 2 else 0
    reference = np.round((celsius[0] + celsius[-1]) / 2)
    assert fit.model.reference_c == reference
    fits = [dense(points, np.arange(9), np.vander(np.array(celsius) - reference, p + 1, increasing=True)) for p in range(most + 1)]
    p_values = [stats.chi2.sf(each - fits[-1], 9 * (most - p)) for p, each in enumerate(fits[:-1])]
    assert fit.p_constant == pytest.approx([*p_values, 1][0])
    assert order == next((p for p, each in enumerate(p_values) if each >= 0.01), most)
    left = fits[order]
    assert (fit.freedom, fit.chi_square) == (9 * (len(celsius) - order - 1), pytest.approx(left, abs=1e-6))
    widened = max(left / fit.freedom, 1) if fit.freedom else 1.0
    assert (fit.widened, widened > 3) == (pytest.approx(widened), spread > 1)
    assert fit.p_value == pytest.approx(stats.chi2.sf(left, fit.freedom) if fit.freedom else np.nan, nan_ok=True)
    assert_whole(points, fit)
    assert fit.model.range_c == (celsius[0] - 1, celsius[-1] + 2)


@pytest.mark.parametrize(("p", "order"), [(0.0099, 1), (0.0101, 0)])
def test_E_and_zero_depend_on_temperature_below_one_percent(p, order):
    """Two sessions: the second is moved along one number until the chi-square of a constant has this p-value."""
    first, second = some_points((0.0, 60.0), spread=0.0)
    both, values = first.covariance + second.covariance, second.values.copy()
    for which, number, of in ((MATRIX, 4, 9), (BIAS, 1, 3)):
        step = np.sqrt(stats.chi2.isf(p, of) / np.linalg.inv(both[which, which])[number, number])
        values[which] = first.values[which] + step * (np.arange(of) == number)
    fit = join([first, replace(second, values=values)], None)
    assert fit.p_constant == pytest.approx(p, rel=1e-6)
    assert len(fit.model.E_terms) == len(fit.model.zero_terms) == order + 1


def test_temperatures_two_degrees_apart_are_two_and_E_has_no_more_than_a_square():
    """The zero no more than a cube, without a rest log."""
    for celsius, orders in (((20.0, 22.0), 1), ((20.0, 22.1), 2), ((20.0, 22.1, 24.2), 3), ((0.0, 20, 40, 60, 80), 3)):
        points = some_points(celsius, spread=1e4)
        fit = join(points, None)
        assert len(fit.model.E_terms) == orders
        assert len(fit.model.zero_terms) == min(len(celsius), 4) if orders > 1 else 1
        assert len(join(points, None, most_order=1).model.zero_terms) <= 2


def turn_on_of(left, base, free):
    """The scatter at which the restricted likelihood of zeros (n,) beside columns (n, p) is flat: tr P = y' P P y."""

    def slope(variance):
        inverse = np.linalg.inv(base + variance * np.eye(len(base)))
        P = inverse - inverse @ free @ np.linalg.solve(free.T @ inverse @ free, free.T @ inverse)
        return np.trace(P) - left @ P @ P @ left

    return np.sqrt(optimize.brentq(slope, 0, 1.0, xtol=1e-18)) if slope(0) < 0 else 0.0


@pytest.mark.parametrize("turn_on", [0.0, 0.01])
def test_the_zero_of_sessions_alone_is_least_squares_with_the_switch_ons_scatter(turn_on):
    points = some_points((0.0, 20.0, 41.0, 60.0), seed=1)
    for point, shift in zip(points, turn_on * DEG * np.random.default_rng(3).normal(size=(4, 3)), strict=True):
        point.values[BIAS] += shift
    fit = join(points, None, most_order=2)
    order = len(fit.model.zero_terms) - 1
    designs = [np.vander([-30.0, -10, 11, 30], p + 1, increasing=True) for p in range(3)]
    own = block_diag(*[point.covariance[BIAS, BIAS] for point in points])
    spread = turn_on_of(np.concatenate([point.values[BIAS] for point in points]), own, np.kron(designs[order], np.eye(3)))
    assert (fit.turn_on_rps, spread > 0) == (pytest.approx(spread, rel=1e-6), turn_on > 0)
    assert_whole(points, fit)
    if not turn_on:  # the order is the lowest that the sigmas of the sessions do not refuse
        chi = [dense(points, np.arange(9, 12), A) for A in designs]
        p_values = [stats.chi2.sf(chi[p] - chi[2], 3 * (2 - p)) for p in range(2)]
        assert order == next((p for p, each in enumerate(p_values) if each >= 0.01), 2)


def an_axis(terms, tau_s, root):
    """The fit of one axis as a rest log gives it: terms, lag, and a root of their covariance."""
    covariance = root @ root.T
    if not tau_s:
        covariance[-1] = covariance[:, -1] = 0
    return AxisFit(np.asarray(terms, dtype=float), tau_s, covariance, "sweeps", 2e-3, np.nan, 1e-3, 0.0, None, None, None, np.nan)


@pytest.fixture(scope="module")
def shape():
    """A rest log from -5 to 70 degC about 32: a quadratic with a lag, a line, a quadratic, each with a covariance of its own."""
    rng = np.random.default_rng(11)
    knots = make_knots([small_rest([-5.0, 30, 70])], [])
    size = DEG * np.array([[1e-3], [3e-5], [1e-6], [2.0]])
    roots = [size * (np.eye(4) + 0.5 * rng.normal(size=(4, 4))) for _ in range(3)]
    line = an_axis(ZERO[:2, 1], 0.0, roots[1][[0, 1, 3]])
    return RestFit((), knots, (), (an_axis(ZERO[:, 0], 30.0, roots[0]), line, an_axis(ZERO[:, 2], -20.0, roots[2])), (), None, ())


@pytest.mark.parametrize("celsius", [(0.0,), (-20.0, 20.0, 50.0)])
def test_the_level_is_the_sessions_and_the_shape_the_rest_logs(shape, celsius):
    """The scatter from switch-on is that of the sessions' zeros less the shape, whose error all of them share."""
    points, count = some_points(celsius, seed=2, spread=3.0), len(celsius)
    fit = joined(join(points, shape), shape)
    left, base = np.concatenate([point.values[BIAS] for point in points]), block_diag(*[point.covariance[BIAS, BIAS] for point in points])
    for i, axis in enumerate(shape.gyro):
        powers = np.array([(np.array(celsius) - 32) ** n for n in range(1, axis.order + 1)])
        left[i::3] -= axis.terms[1:] @ powers
        base[i::3, i::3] += powers.T @ axis.covariance[1:-1, 1:-1] @ powers
    spread = turn_on_of(left, base, np.kron(np.ones((count, 1)), np.eye(3))) if count > 1 else np.nan
    assert fit.sessions.turn_on_rps == pytest.approx(spread, nan_ok=True, rel=1e-6)
    assert_whole(points, fit.sessions, shape.gyro)
    assert fit.model.range_c == (min(celsius[0] - 1, -5), max(celsius[-1] + 2, 70))
    assert fit.remaining_rps.tolist() == [2e-3] * 3


def test_sigmas_at_a_temperature_are_those_of_the_polynomial_there(shape):
    """By numeric derivatives of the model in each of its coefficients; beyond the range, those of its end."""
    fit = joined(join(some_points((-20.0, 20.0, 50.0)), shape), shape)
    root = np.random.default_rng(0).normal(size=(len(fit.covariance),) * 2) * 1e-3
    fit, n_E = replace(fit, covariance=root @ root.T), fit.model.E_terms.size

    def values(moved, at):
        model = replace(fit.model, E_terms=moved[:n_E].reshape(-1, 3, 3), zero_terms=moved[n_E:-3].reshape(-1, 3))
        return np.append(model.E(np.array([at])), model.zero(np.full((1, 3), at)))

    for celsius, at in ((41.0, 41.0), (300.0, 70.0)):
        S = numeric_jacobian(lambda moved, at=at: values(moved, at), fit.values, 1.0)
        assert np.append(*fit.sigma_at(celsius)) == pytest.approx(np.sqrt(np.diag(S @ fit.covariance @ S.T)), rel=1e-6)


def test_a_point_turned_is_the_point_of_the_turned_model():
    """By the model itself: Q (E m + B), with the covariance of Q E and Q B, has the zero that E m + B has."""
    turn, upper = Rotation.from_rotvec([0.010, -0.006, 0.008]).as_matrix(), np.array([[1.01, 0.004, -0.003], [0, 0.99, 0.002], [0, 0, 1]])
    model, both = LinearModel(E0, np.array([0.01, -0.02, 0.03])), block_diag(np.kron(turn, np.eye(3)), turn)
    bare = _SessionPoint("bare", 20.0, 19.0, 21.0, *_zero_form(model, ROOT @ ROOT.T), 20, Accelerometer(upper, source="stills"))
    turned = replace(bare, accelerometer=Accelerometer(turn @ upper))
    expected = _zero_form(LinearModel(turn @ model.E, turn @ model.B), both @ ROOT @ ROOT.T @ both.T)
    found = _in_frame_of_first([turned, bare])[1]
    assert_allclose(found.values, expected[0], atol=1e-12)
    assert_allclose(found.covariance, expected[1], atol=1e-18)
    assert_array_equal(_in_frame_of_first([bare, bare])[1].values, bare.values)
