"""One axis' zero over temperature: sweeps, knots, noise, lag, hysteresis, orders and sigmas, each by hand or with full matrices."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats
from small_rests import small_rest, triangle

from tinygc.annexes.temperature import axis_fit
from tinygc.annexes.temperature.axis_fit import (
    AS_NOISE,
    Candidate,
    Coloured,
    best_lag,
    by_chance,
    columns,
    estimate_noise,
    examine,
    fit_axis,
    folds_of,
    hysteresis_of,
    in_degrees,
    lag_grid,
    lag_shows,
    make_knots,
    misfit,
    most_order,
    none_by_chance,
    predicted,
    simplest,
    solve,
    whiten,
)
from tinygc.annexes.temperature.model import element_temperature
from tinygc.annexes.temperature.sweeps import Sweep, sweeps_of, turning_points
from tinygc.closure.floor import TIMES_S

# Sweeps


def test_turning_points_are_extremes_before_a_reversal():
    """The first extreme, each reversal by at least so much, the last; a smaller one ends nothing."""
    of = lambda *values: turning_points(np.array(values, dtype=float), 2.0)  # noqa: E731
    assert of(0, 3, 5, 3, 1, 4) == [0, 2, 4, 5]
    assert of(5, 3, 0, 1, 3, 0) == [0, 2, 4, 5]
    assert of(0, 3, 1.01, 6, 4.01) == [0, 3]
    assert of(0, 3, 1, 6, 4) == [0, 1, 2, 3, 4]
    assert of(0, 3, 3, 5, 5, 2) == [0, 3, 5]
    assert of(1, 0, 0, 5, 5, 0) == [1, 3, 5]
    assert of(1, 2, 1, 0.5) == [0, 3]
    assert of(1, 2, 0, 3) == of(1, 0, 2, -1) == [1, 2, 3]


@pytest.mark.parametrize(("share", "ways"), [(0.24, [1]), (0.26, [1, -1, 1])])
def test_a_reversal_of_a_quarter_of_the_range_ends_a_sweep(share, ways):
    """From 0 to 30, back by this share, up to 40: of 40 degrees.  The running median of nine flattens each peak by two blocks."""
    up, back = np.arange(0, 30.25, 0.25), 40 * share + 1
    temp = np.concatenate([up, np.arange(29.75, 30 - back, -0.25), np.arange(30 - back, 41, 0.25)])
    found = sweeps_of(temp, 3)
    assert [each.direction for each in found] == ways
    assert all(each.log == 3 for each in found)
    assert (found[0].start, found[-1].stop) == (0, len(temp))
    assert [each.stop for each in found[:-1]] == [each.start for each in found[1:]]
    if len(ways) > 1:
        assert found[0].stop == pytest.approx(120, abs=2)
        assert found[1].stop == pytest.approx(120 + back / 0.25, abs=3)


def test_what_has_no_sweep():
    assert sweeps_of(np.linspace(0, 1.99, 30)) == []
    assert [each.direction for each in sweeps_of(np.linspace(0, 2.0, 30))] == [1]
    assert [each.direction for each in sweeps_of(np.array([0.0, 30]))] == [1]
    assert sweeps_of(np.array([3.0])) == []
    assert sweeps_of(np.array([3.0, np.nan, 30])) == []
    spike = np.where(np.isin(np.arange(40), [20, 21, 22, 23]), 60.0, np.linspace(0, 30, 40))
    assert [each.direction for each in sweeps_of(spike)] == [1]


# Knots


def test_knots_are_means_over_their_blocks(monkeypatch):
    """Two logs, the first of two sweeps, of six and four blocks, the other of ten without: eight knots in all."""
    monkeypatch.setattr(axis_fit, "MOST_KNOTS", 8)
    temp = np.array([0.0, 1, 2, 3, 4, 5, 6, 4, 2, 0])
    first, other = small_rest(temp), small_rest(temp[:10] + 10, block_s=5.0, number=[0, 1, 2, 3, 4, 5, 6, 8, 9, 10])
    knots = make_knots([first, other], [Sweep(0, 0, 6, 1), Sweep(0, 6, 10, -1)])
    assert len(knots) == 8
    assert knots.starts.tolist() == [0, 3, 6, 8, 10, 12, 15, 17]
    assert knots.of.tolist() == [0] * 4 + [1] * 4
    assert knots.sweep.tolist() == [0, 0, 1, 1, 2, 2, 2, 2]
    assert knots.direction.tolist() == [1, 1, -1, -1, 0, 0, 0, 0]
    assert knots.span_s.tolist() == [30, 30, 20, 20, 10, 15, 10, 15]
    assert knots.t_s[:5].tolist() == [15, 45, 70, 90, 5]
    assert knots.t_s[7] == pytest.approx((8.5 + 9.5 + 10.5) / 3 * 5)
    assert knots.temp_c[:4].tolist() == [1, 4, 5, 1]
    assert (knots.reference_c, knots.half_c) == (8, 8)
    assert knots.mean(np.arange(20.0)).tolist() == [1, 4, 6.5, 8.5, 10.5, 13, 15.5, 18]
    assert knots.mean(np.arange(40.0).reshape(20, 2))[1].tolist() == [8, 9]
    assert knots.offsets().tolist() == [[1, 0]] * 4 + [[0, 1]] * 4
    # A power is averaged over the blocks, not that of the knot's mean.
    x = (np.concatenate([temp, temp + 10]) - 8) / 8
    assert knots.powers(0.0, 3) == pytest.approx(np.column_stack([knots.mean(x**k) for k in (1, 2, 3)]))
    assert knots.powers(0.0, 1) == pytest.approx(knots.mean(x)[:, None])
    assert knots.powers(0.0, 4)[:, 3] == pytest.approx(knots.mean(x**4))
    assert knots.powers(0.0, 0).shape == (8, 0)
    element = np.interp(np.arange(11), other.number, other.temp_c)
    lagged = np.concatenate([element_temperature(temp, 25.0, 10.0), element_temperature(element, 25.0, 5.0)[other.number]])
    assert knots.element_c(25.0) == pytest.approx(lagged)
    assert knots.powers(25.0, 1)[:, 0] == pytest.approx(knots.mean((lagged - 8) / 8))
    assert columns(knots, 25.0, 2) == pytest.approx(np.hstack([knots.offsets(), knots.powers(25.0, 2)]))


def test_a_log_that_begins_late_or_never_warms():
    late = small_rest([20.0, 25, 20], number=[7, 8, 10])
    knots = make_knots([late], [])
    assert knots.element_c(30.0) == pytest.approx(element_temperature(np.array([20.0, 25, 22.5, 20]), 30.0, 10.0)[[0, 1, 3]])
    bare = make_knots([small_rest([np.nan] * 4)], [])
    assert (bare.reference_c, bare.half_c) == (25, 1)
    assert bare.temp_c.tolist() == [0] * 4
    assert make_knots([small_rest([20.0, 20.5])], []).half_c == 1
    assert make_knots([small_rest([20.0, 22.5])], []).half_c == 1.25


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
    fine = (np.arange(400) + 0.5) / 400 * 10 - 5
    own = sum(np.exp(-np.abs(fine[:, None] - fine) / T).mean() for T in TIMES_S)
    assert np.diag(flicker)[:8] == pytest.approx(np.log(2) / np.pi * own, rel=1e-3)
    apart = sum(np.exp(-np.abs(fine[:, None] - fine - 30) / T).mean() for T in TIMES_S)
    assert flicker[1, 4] == pytest.approx(np.log(2) / np.pi * apart, rel=1e-3)


# Noise


def restricted(sizes, y, A, V):
    """-2 log of the restricted likelihood, with full matrices."""
    C = sum(s**2 * v for s, v in zip(sizes, V, strict=True))
    information = A.T @ np.linalg.solve(C, A)
    r = y - A @ np.linalg.solve(information, A.T @ np.linalg.solve(C, y))
    return np.linalg.slogdet(C)[1] + np.linalg.slogdet(information)[1] + r @ np.linalg.solve(C, r)


@pytest.fixture(scope="module")
def rest():
    """Knots (40) of two sweeps up and two down, and noise of known sizes on them."""
    knots = make_knots([small_rest(triangle(40, 10))], sweeps_of(triangle(40, 10)))
    V = knots.covariances()
    C = sum(s**2 * v for s, v in zip((1.0, 0.1, 0.01), V, strict=True))
    return knots, V, np.linalg.cholesky(C)


def test_the_noise_is_that_of_the_largest_restricted_likelihood(rest):
    knots, V, root = rest
    A = columns(knots, 0.0, 2)
    for seed, unit in ((1, 1.0), (2, 1.0), (3, 1e6)):
        y = unit * (root @ np.random.default_rng(seed).normal(size=40) + A @ [300.0, -200, 100])
        found = estimate_noise(y, A, V, unit * 1.0)
        best = optimize.minimize(
            lambda logs: restricted(np.hypot(np.exp(logs), [0.5 * unit, 0, 0]), y, A, V),  # noqa: B023
            np.log(unit * np.array([0.9, 0.1, 0.01])),
            method="Nelder-Mead",
            options={"maxiter": 2000, "xatol": 1e-4, "fatol": 1e-6},
        )
        assert restricted(found.sizes, y, A, V) < best.fun + 0.02
        assert found.sizes[0] >= 0.5 * unit
        np.testing.assert_allclose(found.C, sum(s**2 * v for s, v in zip(found.sizes, V, strict=True)))
    some = np.arange(40) > 30
    assert found.factor(some) @ found.factor(some).T == pytest.approx(found.C[np.ix_(some, some)])
    assert found.factor() @ found.factor().T == pytest.approx(found.C)


def test_white_noise_is_no_less_than_half_of_what_the_blocks_say(rest):
    """Knots without any scatter of their own; and blocks that say nothing."""
    knots, V, root = rest
    A = columns(knots, 0.0, 1)
    quiet = estimate_noise(1e-3 * root @ np.random.default_rng(0).normal(size=40), A, V, 1.0)
    assert quiet.sizes == pytest.approx([0.5, 0, 0], abs=1e-3)
    smooth = 1e3 * np.linspace(-1, 1, 40) ** 3  # no white noise; then half of what all of the scatter would be
    left = smooth - A @ np.linalg.lstsq(A, smooth, rcond=None)[0]
    assert estimate_noise(smooth, A, V, 0.0).sizes[0] == pytest.approx(0.5 * np.std(left) * np.sqrt(10), rel=1e-6)
    assert np.isfinite(estimate_noise(np.zeros(40), A, V, 0.0).sizes).all()


# Lag


def test_the_misfit_is_that_of_generalised_least_squares(rest):
    knots, _, root = rest
    C, A, y = root @ root.T, columns(knots, 0.0, 2), np.random.default_rng(0).normal(size=40)
    r = y - A @ np.linalg.solve(A.T @ np.linalg.solve(C, A), A.T @ np.linalg.solve(C, y))
    assert misfit(whiten(root, y), whiten(root, A)) == pytest.approx(r @ np.linalg.solve(C, r))


def left_at(knots, y, root, order, rows=slice(None)):
    part = root @ root.T
    part = np.linalg.cholesky(part[rows][:, rows])
    return lambda tau: misfit(whiten(part, y[rows]), whiten(part, columns(knots, tau, order)[rows]))


@pytest.mark.parametrize("tau", [30.0, -18.0, 55.0, -55.0])
def test_the_lag_is_where_the_misfit_is_least(rest, tau):
    knots, _, root = rest
    y = columns(knots, tau, 2) @ [3.0, 20.0, 4.0] + 0.3 * root @ np.random.default_rng(1).normal(size=40)
    for rows in (slice(None), np.arange(40) % 7 != 0):
        left = left_at(knots, y, root, 2, rows)
        part = np.linalg.cholesky((root @ root.T)[rows][:, rows])
        found = best_lag(knots, y, part, rows, np.array([-60.0, -40, -20, -10, 10, 20, 40, 60]), 2)
        exact = optimize.minimize_scalar(left, bounds=(0.5 * tau, 2 * tau) if tau > 0 else (2 * tau, 0.5 * tau), method="bounded").x
        assert found == pytest.approx(exact, abs=0.05)


@pytest.mark.parametrize(("p", "shows"), [(0.00099, True), (0.00101, False)])
def test_a_lag_shows_below_one_in_a_thousand_of_two_degrees_of_freedom(rest, p, shows):
    knots, _, root = rest
    noise = 0.1 * root @ np.random.default_rng(2).normal(size=40)

    def gain(size):
        y = columns(knots, 20.0, 1) @ [0.0, size] + noise
        left = left_at(knots, y, root, 1)
        return left(0.0) - left(20.0) - stats.chi2.isf(p, 2)

    size = optimize.brentq(gain, 0.0, 1000.0, xtol=1e-12)
    y = columns(knots, 20.0, 1) @ [0.0, size] + noise
    assert lag_shows(knots, y, root, 20.0, 1) == shows


def test_lags_are_tried_up_to_a_quarter_of_the_shortest_sweep():
    temp = np.concatenate([triangle(60, 30), triangle(40, 20)[1:]])
    knots = make_knots([small_rest(temp)], sweeps_of(temp))
    shortest = min(knots.span_s[knots.sweep == k].sum() for k in range(4))
    lags = lag_grid(knots)
    assert len(lags) == 40
    assert (lags[20], lags[-1]) == pytest.approx((10, shortest / 4))
    assert lags == pytest.approx(-lags[::-1])
    assert np.diff(np.log(lags[20:])) == pytest.approx(np.full(19, np.log(shortest / 40) / 19))
    # None in one direction, and none where a quarter is no more than four blocks.
    for count, half, some in ((40, 40, False), (32, 16, False), (36, 18, True)):
        way = np.where(np.arange(count) < half, 1, -1)
        of = make_knots([small_rest(triangle(count, half))], [Sweep(0, 0, half, 1), *([Sweep(0, half, count, -1)] if half < count else [])])
        assert set(of.direction) == set(way)
        assert bool(len(lag_grid(of))) == some


# Hysteresis


def test_hysteresis_is_the_difference_of_means_at_one_temperature():
    """Rising over 0 to 80, falling over 80 to 16: eight bins over 16 to 80, each knot by its span."""
    temp = np.concatenate([np.arange(0.0, 81, 4), np.arange(78.0, 15, -2)])
    knots = make_knots([small_rest(temp)], [Sweep(0, 0, 21, 1), Sweep(0, 21, len(temp), -1)])
    knots = replace(knots, span_s=np.where(np.arange(len(temp)) % 2, 30.0, 10.0))
    knots.direction[[6, 40]] = 0  # of a log without sweeps
    rng = np.random.default_rng(0)
    residual, root = rng.normal(size=len(temp)), rng.normal(size=(len(temp),) * 2)
    found = hysteresis_of(knots, residual, root @ root.T)
    assert found.at_c == pytest.approx(16 + 62 / 8 * (np.arange(8) + 0.5))
    for k, lower in enumerate(16 + 62 / 8 * np.arange(8)):
        weights = np.zeros(len(temp))
        for way in (1, -1):
            here = (temp >= lower) & (temp < lower + 62 / 8) & (knots.direction == way)
            weights += way * np.where(here, knots.span_s, 0) / knots.span_s[here].sum()
        assert found.difference[k] == pytest.approx(weights @ residual)
        assert found.sigma[k] == pytest.approx(np.linalg.norm(root.T @ weights))
    k = np.argmax(np.abs(found.difference))
    assert found.largest == (found.difference[k], found.sigma[k], found.at_c[k])
    assert found.rms == pytest.approx(np.sqrt(np.mean(found.difference**2)))
    assert hysteresis_of(replace(knots, direction=np.abs(knots.direction)), residual, root @ root.T) is None
    apart = make_knots([small_rest([0.0, 10, 20, 40, 30, 25])], [Sweep(0, 0, 3, 1), Sweep(0, 3, 6, -1)])
    assert hysteresis_of(apart, np.zeros(6), np.eye(6)) is None


# Orders


def test_folds_are_sweeps_or_stretches_of_time(rest):
    knots = rest[0]
    assert folds_of(knots)[1] == "sweeps"
    assert folds_of(knots)[0].tolist() == knots.sweep.tolist()
    one = make_knots([small_rest(np.arange(50.0))], [Sweep(0, 0, 50, 1)])
    folds, by = folds_of(one)
    assert by == "stretches"
    assert folds.tolist() == [k * 20 // 50 % 5 for k in range(50)]


def test_each_fold_is_predicted_from_the_others_with_equal_weights(rest):
    knots, _, root = rest
    y = columns(knots, 25.0, 2) @ [1.0, 9.0, 3.0] + root @ np.random.default_rng(4).normal(size=40)
    noise = Coloured(np.array([1.0, 0.1, 0.01]), root @ root.T)
    lags = np.array([-40.0, -20, -10, 10, 20, 40])
    found = examine(knots, y, noise, (0, 1, 2), lags)
    assert found.candidates == (*(Candidate(p, False) for p in (0, 1, 2)), Candidate(1, True), Candidate(2, True))
    assert [each.complexity for each in found.candidates] == [0, 1, 2, 2, 3]
    assert found.held_out.shape == (len(np.unique(knots.sweep)), 5)
    for k, sweep in enumerate(np.unique(knots.sweep)):
        train, test = knots.sweep != sweep, knots.sweep == sweep
        tau = best_lag(knots, y, np.linalg.cholesky(noise.C[train][:, train]), train, lags, 2)
        for c, each in enumerate(found.candidates):
            A = columns(knots, tau if each.lagged else 0.0, each.order)
            error = y[test] - A[test] @ np.linalg.lstsq(A[train], y[train], rcond=None)[0]
            assert found.held_out[k, c] == pytest.approx(np.mean(error**2))
    assert found.chosen == simplest(found.candidates, found.held_out)
    assert examine(knots, y, noise, (0, 1), np.zeros(0)).candidates == (Candidate(0, False), Candidate(1, False))


def test_the_zero_of_a_log_that_is_left_out_is_not_predicted():
    temp = triangle(12, 6)
    knots = make_knots([small_rest(temp), small_rest(temp)], [Sweep(0, 0, 12, 1), Sweep(1, 0, 6, 1), Sweep(1, 6, 12, -1)])
    y = np.random.default_rng(5).normal(size=24) + np.where(knots.of == 1, 50.0, 0.0)
    whole, half = knots.sweep == 0, knots.sweep == 1
    for test, centred in ((whole, True), (half, False)):
        A = columns(knots, 0.0, 1)
        use = [1, 2] if centred else [0, 1, 2]
        error = y[test] - A[test][:, use] @ np.linalg.lstsq(A[~test][:, use], y[~test], rcond=None)[0]
        expected = np.var(error) if centred else np.mean(error**2)
        assert predicted(knots, y, ~test, test, 1, 0.0) == pytest.approx(expected)


def test_the_simplest_within_one_standard_error_of_the_best():
    plain, lagged = [Candidate(p, False) for p in (0, 1, 2)], Candidate(1, True)
    best, gain = np.array([1.0, 1.2, 0.9]), np.array([0.3, 0.1, 0.2])
    error = np.std(gain, ddof=1) / np.sqrt(3)
    for shift, chosen in ((error - 1e-9, 1), (error + 1e-9, 2)):
        held_out = np.column_stack([best + 5, best + gain - gain.mean() + shift, best])
        assert simplest(tuple(plain), held_out) == chosen
    two = np.column_stack([best[:2] + 5, best[:2] - [0.05, -0.2], best[:2]])
    assert simplest(tuple(plain), two) == 1
    # Of two as simple, the one without a lag; of one fold, the best itself.
    assert simplest((Candidate(2, False), lagged), np.column_stack([best, best])) == 0
    assert simplest((lagged, Candidate(2, False)), np.column_stack([best, best])) == 1
    assert simplest(tuple(plain), np.array([[1.0, 0.5, 0.5 - 1e-9]])) == 2


def test_the_highest_order_is_a_quarter_of_the_knots():
    for count, order in ((3, 0), (4, 1), (20, 5), (23, 5)):
        assert most_order(make_knots([small_rest(np.linspace(10, 30, count))], [])) == order
    assert most_order(make_knots([small_rest(np.linspace(10, 10.99, 20))], [])) == 0
    assert most_order(make_knots([small_rest(np.linspace(10, 11.0, 20))], [])) == 5


# Sigmas


@pytest.mark.parametrize("tau", [0.0, 25.0])
def test_a_covariance_is_the_numeric_derivative_of_the_estimate_times_that_of_the_knots(rest, tau):
    """The lag is where the weighted misfit is least; the coefficients have equal weights at that lag."""
    knots, _, root = rest
    truth, chosen, noise = np.array([3.0, 20.0, 4.0]), Candidate(2, tau > 0), Coloured(np.ones(3), root @ root.T)
    y = columns(knots, tau, 2) @ truth

    def estimate(values):
        if not chosen.lagged:
            return np.linalg.lstsq(columns(knots, 0.0, 2), values, rcond=None)[0]
        left = left_at(knots, values, root, 2)
        # The least of a parabola through three points, once more about it.
        at = tau
        for step in (0.5, 0.1):
            low, middle, high = left(at - step), left(at), left(at + step)
            at += step / 2 * (low - high) / (low + high - 2 * middle)
        return np.append(np.linalg.lstsq(columns(knots, at, 2), values, rcond=None)[0], at)

    step = 1e-3
    slope = np.column_stack([(estimate(y + step * e) - estimate(y - step * e)) / (2 * step) for e in np.eye(40)])
    coefficients, covariance = solve(knots, y, noise, tau, chosen)
    assert coefficients == pytest.approx(truth)
    assert covariance == pytest.approx(slope @ noise.C @ slope.T, rel=5e-3)


@pytest.mark.parametrize(("times", "by_ratio"), [(0.0, True), (1.0, False)])
def test_no_dependence_by_chance_is_a_ratio_of_likelihoods_each_with_its_own_noise(rest, times, by_ratio):
    """Or a fifth of the p-value in the noise of the constant, whichever is larger."""
    knots, V, root = rest
    y = columns(knots, 20.0, 1) @ [3.0, 4.0 * times] + root @ np.random.default_rng(7).normal(size=40)
    larger = []
    for chosen, tau, freedom in ((Candidate(1, False), 0.0, 1), (Candidate(1, True), 20.0, 3), (Candidate(2, True), 20.0, 4)):
        values, squares = [], []
        for order, lag in ((0, 0.0), (chosen.order, tau)):
            A = columns(knots, lag, order)
            C = estimate_noise(y, A, V, 1.0).C
            of_constant = estimate_noise(y, columns(knots, 0.0, 0), V, 1.0).C
            r, other = (y - A @ np.linalg.solve(A.T @ np.linalg.solve(of, A), A.T @ np.linalg.solve(of, y)) for of in (C, of_constant))
            values.append(np.linalg.slogdet(C)[1] + r @ np.linalg.solve(C, r))
            squares.append(other @ np.linalg.solve(of_constant, other))
        of_ratio, of_noise = (stats.chi2.sf(gain, freedom) for gain in (values[0] - values[1], squares[0] - squares[1]))
        larger.append(of_ratio > AS_NOISE * of_noise)
        assert none_by_chance(knots, y, V, 1.0, chosen, tau) == pytest.approx(max(of_ratio, AS_NOISE * of_noise), rel=1e-6)
    assert any(larger) == by_ratio
    assert none_by_chance(knots, y, V, 1.0, Candidate(0, False), 0.0) == 1


def test_the_highest_powers_are_tested_together():
    rng = np.random.default_rng(8)
    coefficients, root = rng.normal(size=6), rng.normal(size=(6, 6))
    C = root @ root.T
    # Two logs, a cubic, a lag: the powers are the third to the fifth.
    for above, part in ((0, [2, 3, 4]), (1, [3, 4]), (2, [4])):
        square = coefficients[part] @ np.linalg.solve(C[np.ix_(part, part)], coefficients[part])
        assert by_chance(coefficients[:5], C, 2, above, 3) == pytest.approx(stats.chi2.sf(square, len(part)))
    assert by_chance(coefficients, C, 2, 3, 3) == 1


def test_terms_are_per_degree_and_the_zero_the_mean_of_the_logs():
    temp = triangle(12, 6, 10.0, 40.0)
    knots = make_knots([small_rest(temp), small_rest(temp)], [])
    rng = np.random.default_rng(9)
    coefficients, root = rng.normal(size=4), rng.normal(size=(5, 5))
    by_hand = np.array([[0.5, 0.5, 0, 0, 0], [0, 0, 1 / 15, 0, 0], [0, 0, 0, 1 / 225, 0], [0, 0, 0, 0, 1]])
    terms, covariance = in_degrees(knots, coefficients, root @ root.T, Candidate(2, True))
    assert terms == pytest.approx(by_hand[:3, :4] @ coefficients)
    assert covariance == pytest.approx(by_hand @ root @ root.T @ by_hand.T)
    _, without = in_degrees(knots, coefficients, (root @ root.T)[:4, :4], Candidate(2, False))
    assert without[:3, :3] == pytest.approx(covariance[:3, :3])
    assert not without[3].any()


# All together


def made(lag_s=0.0, coefficients=(0.5, 8e-3, 2e-4), logs=1, seed=0, noise=2e-3, count=80, half=20):
    """Rest logs whose zero is a polynomial of the element's temperature about 20 degC, with white noise."""
    rng, temp = np.random.default_rng(seed), triangle(count, half)
    element = element_temperature(temp, lag_s, 10.0)
    zero = np.polynomial.polynomial.polyval(element - 20, coefficients)
    return [small_rest(temp, zero + 0.1 * k + noise * rng.normal(size=count), name=f"{k}.csv") for k in range(logs)]


def fitted(logs, **more):
    knots = make_knots(logs, [sweep for k, log in enumerate(logs) for sweep in sweeps_of(log.temp_c, k)])
    return knots, fit_axis(knots, np.concatenate([log.gyro[:, 0] for log in logs]), **more)


@pytest.mark.parametrize("lag_s", [0.0, 20.0])
def test_a_fit_is_put_together_from_these(lag_s):
    """In any unit: terms, covariance, what is left, what was held out, and the hysteresis with and without the lag."""
    logs = made(lag_s, logs=2)
    knots, fit = fitted(logs)
    _, large = fitted([replace(log, gyro=1000 * log.gyro) for log in logs])
    assert fit.order == 2
    assert (fit.tau_s > 0) == (lag_s > 0)
    y = knots.mean(np.concatenate([log.gyro[:, 0] for log in logs]))
    chosen = Candidate(fit.order, bool(fit.tau_s))
    A = columns(knots, fit.tau_s, 2)
    coefficients = np.linalg.lstsq(A, y, rcond=None)[0]
    terms, _ = in_degrees(knots, coefficients, np.eye(4 + chosen.lagged), chosen)
    assert fit.terms == pytest.approx(terms)
    assert fit.left == pytest.approx(np.sqrt(np.mean((y - A @ coefficients) ** 2)))
    assert fit.turn_on == pytest.approx(np.std(coefficients[:2], ddof=1))
    assert fit.turn_on == pytest.approx(0.1 / np.sqrt(2), rel=0.05)
    _, covariance = solve(knots, y, fit.noise, fit.tau_s, chosen)
    assert fit.covariance == pytest.approx(in_degrees(knots, coefficients, covariance, chosen)[1], rel=1e-6)
    assert fit.sigma == pytest.approx(np.sqrt(np.diag(fit.covariance)))
    after = hysteresis_of(knots, y - A @ coefficients, fit.noise.C)
    plain = columns(knots, 0.0, 2)
    before = hysteresis_of(knots, y - plain @ np.linalg.lstsq(plain, y, rcond=None)[0], fit.noise.C)
    for found, expected in ((fit.hysteresis_after, after), (fit.hysteresis_before, before)):
        assert (*found.difference, *found.sigma) == pytest.approx((*expected.difference, *expected.sigma), rel=1e-6)
    assert fit.examined.candidates[fit.examined.chosen] == chosen
    assert fit.held_out == pytest.approx(np.sqrt(fit.examined.held_out[:, fit.examined.chosen].mean()))
    assert fit.held_out_of(2, chosen.lagged) == fit.held_out
    straight = columns(knots, 0.0, 1)
    own = []
    for sweep in np.unique(knots.sweep):
        test = knots.sweep == sweep
        own.append(np.mean((y[test] - straight[test] @ np.linalg.lstsq(straight[~test], y[~test], rcond=None)[0]) ** 2))
    assert fit.held_out_of(1, False) == pytest.approx(np.sqrt(np.mean(own)))
    assert np.isnan(fit.held_out_of(9, False))
    assert {each.order for each in fit.examined.candidates if not each.lagged} == {0, 1, 2, 3, 4, 5}
    assert fit.p_value < 1e-6
    assert large.terms == pytest.approx(1000 * fit.terms, rel=1e-6)
    assert (large.held_out, large.left, large.turn_on) == pytest.approx((1000 * fit.held_out, 1000 * fit.left, 1000 * fit.turn_on))
    np.testing.assert_allclose(large.noise.C, 1e6 * fit.noise.C, rtol=1e-3)
    if lag_s:
        assert fit.tau_s == pytest.approx(lag_s, abs=4 * fit.sigma[-1])


def test_what_is_not_there_is_not_claimed_and_what_may_not_be_tried_is_not():
    knots, none = fitted(made(coefficients=(0.5,), seed=1))
    assert (none.order, none.tau_s) == (0, 0)
    assert np.isnan(none.turn_on)
    assert none.terms == pytest.approx([np.mean(knots.mean(knots.logs[0].gyro[:, 0]))])
    assert none.sigma[0] == pytest.approx(np.sqrt(none.noise.C.sum()) / len(knots))
    # Where nothing depends on temperature the noise is that about a constant.
    y = knots.mean(knots.logs[0].gyro[:, 0])
    about = estimate_noise(y / np.std(y), columns(knots, 0.0, 0), knots.covariances(), none_white(knots) / np.std(y))
    assert none.noise.sizes == pytest.approx(about.sizes * np.std(y))
    assert none.p_value == 1 or none.p_value > 1e-3
    _, held = fitted(made(), orders=(0, 1))
    assert held.order == 1
    _, prompt = fitted(made(20.0), with_lag=False)
    assert prompt.tau_s == 0
    assert not any(each.lagged for each in prompt.examined.candidates)
    _, still = fitted([small_rest(np.full(30, 25.0), np.random.default_rng(0).normal(size=30))])
    assert (still.order, still.p_value) == (0, 1)
    # Two rests, each at a temperature of its own: their zeros take up any slope.
    noise = np.random.default_rng(0).normal(size=(2, 30))
    _, two = fitted([small_rest(np.full(30, t), n) for t, n in zip((10.0, 20.0), noise, strict=True)], orders=(0, 1))
    assert two.order == 0
    assert [each.order for each in two.examined.candidates] == [0]


@pytest.mark.parametrize(
    ("test", "told", "order", "lagged"),
    [
        ("lag_shows", lambda *_: False, 2, False),
        ("none_by_chance", lambda *_: 1.0, 0, False),
        ("by_chance", lambda *given: float(given[3] == 1), 1, True),
        ("by_chance", lambda *_: 0.0, 2, True),
    ],
)
def test_a_lag_or_a_power_that_does_not_show_is_dropped(monkeypatch, test, told, order, lagged):
    monkeypatch.setattr(axis_fit, test, told)
    _, fit = fitted(made(20.0), orders=(0, 1, 2))
    assert (fit.order, fit.tau_s > 0) == (order, lagged)
    assert fit.examined.candidates[fit.examined.chosen] == Candidate(order, lagged)


def none_white(knots):
    steps = np.diff(knots.logs[0].gyro[:, 0])
    return np.median(np.abs(steps)) / 0.6745 / np.sqrt(2) * np.sqrt(10)


@pytest.mark.parametrize("times", [0.9, 1.1])
def test_a_coefficient_is_kept_where_it_is_significant(times):
    """The square of a quadratic whose held-out error is best: below one in a thousand, by its own sigma."""
    size = 1e-5
    for _ in range(3):
        _, fit = fitted(made(coefficients=(0.5, 8e-3, size), seed=3), orders=(0, 1, 2), with_lag=False)
        knots, _ = fitted(made(seed=3), orders=(0,))
        noise = fit.noise
        y = knots.mean(made(coefficients=(0.5, 8e-3, size), seed=3)[0].gyro[:, 0])
        coefficients, covariance = solve(knots, y, noise, 0.0, Candidate(2, False))
        z = coefficients[2] / np.sqrt(covariance[2, 2])
        size += (stats.norm.isf(0.0005) * times - z) * np.sqrt(covariance[2, 2]) / knots.half_c**2
    _, fit = fitted(made(coefficients=(0.5, 8e-3, size), seed=3), orders=(1, 2), with_lag=False)
    chosen = fit.order
    assert chosen == (2 if times > 1 else 1)
