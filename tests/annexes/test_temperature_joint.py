"""Sessions at several temperatures, and rest logs, in one model: E(T) and b(T), and how true their sigmas are."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from rest_logs import rest_log
from scipy import optimize, stats
from scipy.linalg import block_diag
from small_rests import small_rest

from session.io.config import Accelerometer
from session.io.errors import FitError
from tinygc.annexes.temperature.axis_fit import AxisFit, make_knots
from tinygc.annexes.temperature.model import ThermalModel, element_temperature
from tinygc.annexes.temperature.rest_fit import RestFit, fit_rests
from tinygc.annexes.temperature.sessions_fit import (
    SessionPoint,
    brought_to,
    join,
    joined,
    of_rests_alone,
    parameter_names,
    point_of,
    zero_form,
)
from tinygc.models.linear import BIAS, MATRIX, LinearModel

RNG = np.random.default_rng(4)
E0, E1 = np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), np.diag([60e-6, -30e-6, 100e-6])
SIGN = np.array([1.0, -1.0, 1.0])
#: of rest_log about 30 degC: 0.03 dps/degC and 2e-4 dps/degC^2 with the signs +, -, +
ZERO = np.array([[0.5, -0.3, 0.6], 0.03 * SIGN, 2e-4 * SIGN]) * DEG
TRUTH = ThermalModel(np.stack([E0, E1]), ZERO, np.zeros(3), 30.0, (-40.0, 105.0))
#: a root of a session's covariance: 50 ppm and 1 mdps, correlated
ROOT = np.diag([5e-5] * 9 + [1e-3 * DEG] * 3) @ (np.eye(12) + 0.2 * np.tril(RNG.normal(size=(12, 12)), -1))


def drawn_point(celsius, rng, truth=TRUTH, turn_on_dps=0.0):
    """A session as its fit would give it, without the fit."""
    there = truth.at(celsius)
    values = np.concatenate([there.E.ravel(), truth.zero(np.full((1, 3), celsius))[0]]) + ROOT @ rng.normal(size=12)
    values[9:] += turn_on_dps * DEG * rng.normal(size=3)
    return SessionPoint(f"T{celsius}", celsius, celsius - 1, celsius + 1, values, ROOT @ ROOT.T, 20)


@pytest.fixture(scope="module")
def rests():
    return fit_rests([(rest_log(11, cold_c=-10.0, warm_c=70.0), None)], with_accel=False)


def recorded(celsius, seed, turns=16, warm_c=3.0):
    """A session that warms up while it is turned; its readings by the truth's own formula."""
    samples = Table().tumble(turns, seed=seed).samples(seed=seed, bias_dps=(0, 0, 0), registers=False)
    temp = celsius + warm_c * (1 - np.exp(-samples.t_s / 40))
    gyro = np.einsum("nij,nj->ni", np.linalg.inv(TRUTH.E(temp)), samples.gyro) + TRUTH.zero(np.column_stack([temp] * 3))
    return replace(session_of(replace(samples, gyro=gyro, temp_c=temp)), folder=Path(f"at{celsius}"))


def test_the_zero_form_of_a_covariance_is_its_derivative():
    model, step = LinearModel(E0, np.array([0.01, -0.02, 0.03])), 1e-6
    _, covariance = zero_form(model, np.eye(12))
    slope = np.zeros((12, 12))
    for k in range(12):
        ends = [zero_form(LinearModel.from_vector(model.vector + sign * step * np.eye(12)[k]), np.eye(12))[0] for sign in (1, -1)]
        slope[:, k] = (ends[0] - ends[1]) / (2 * step)
    np.testing.assert_allclose(covariance, slope @ slope.T, atol=1e-7)
    values, _ = zero_form(model, np.eye(12))
    m = np.array([0.3, -0.1, 0.2])
    np.testing.assert_allclose(values[:9].reshape(3, 3) @ (m - values[9:]), model(m), atol=1e-15)


def test_a_session_is_brought_to_its_mean_temperature_and_fitted(monkeypatch):
    """Readings less the change of the zero since the mean temperature, each axis at its element; then the fit of such a session."""
    model, session = replace(TRUTH, lag_s=np.array([30.0, 0.0, -10.0])), recorded(20.0, 1, turns=2)
    (log,) = session.logs
    temp = log.samples.temp_c
    elements = np.column_stack([element_temperature(temp, tau, log.samples.period_s) for tau in (30.0, 0.0, -10.0)])
    expected = log.samples.gyro - (model.zero(elements) - model.zero(np.full((1, 3), 21.0)))
    assert brought_to(log, model, 21.0).samples.gyro == pytest.approx(expected, abs=1e-15)
    linear, covariance, seen = LinearModel(E0, np.array([0.01, -0.02, 0.03])), np.diag(np.arange(1.0, 13)), []
    own = Accelerometer(source="none")

    def fit_session(session, options, progress):
        seen.append(session)
        problem, triad = SimpleNamespace(used=range(15)), SimpleNamespace(calibration=own)
        return SimpleNamespace(linear=SimpleNamespace(model=linear), covariance=covariance, problem=problem, accelerometer=triad)

    monkeypatch.setattr("tinygc.annexes.temperature.sessions_fit.fit_session", fit_session)
    for shape, gyro in ((model, brought_to(log, model, float(temp.mean())).samples.gyro), (None, log.samples.gyro)):
        point = point_of(session, shape)
        assert seen[-1].logs[0].samples.gyro == pytest.approx(gyro, abs=1e-15)
    values, expected = zero_form(linear, covariance)
    assert point.values == pytest.approx(values)
    assert point.covariance == pytest.approx(expected)
    assert (point.segments, point.accelerometer) == (15, own)
    assert (point.temp_c, point.low_c, point.high_c) == pytest.approx((temp.mean(), *np.quantile(temp, [0.005, 0.995])))


def test_two_sessions_without_a_rest_log_do_not_know_the_turn_on():
    rng = np.random.default_rng(7)
    fit = joined("name", join([drawn_point(c, rng) for c in (0.0, 60.0)], None), None, {})
    assert np.isnan([fit.sessions.turn_on_rps, *fit.remaining_rps]).tolist() == [True] * 4
    assert fit.model.lag_s.tolist() == [0] * 3


def test_without_sessions_or_temperature_it_says_so(shape):
    with pytest.raises(FitError, match="no session with turns"):
        join([], shape)
    bare = recorded(20.0, 1, turns=2)
    log = replace(bare.logs[0], samples=replace(bare.logs[0].samples, temp_c=None))
    with pytest.raises(FitError, match=r"log0001.csv has no temperature"):
        point_of(replace(bare, logs=(log,)), None)


# A few sessions and one rest log, against generalised least squares with full matrices


def some_points(celsius, seed=0, spread=1.0):
    """Sessions with covariances of their own, about a truth that is linear in temperature; ``spread``: of their values, in sigmas."""
    rng, made = np.random.default_rng(seed), []
    for k, c in enumerate(celsius):
        root = ROOT * np.exp(0.3 * rng.normal(size=(12, 1)))
        there = np.concatenate([TRUTH.at(c).E.ravel(), TRUTH.zero(np.full((1, 3), c))[0]])
        made.append(SessionPoint(f"s{k}", c, c - 1, c + 2, there + spread * root @ rng.normal(size=12), root @ root.T, 20))
    return made


def dense(points, columns, design, prior=0.0):
    """Generalised least squares of some columns (k,) of all sessions on a design (n, p) for each: terms (p, k), covariance, chi-square."""
    y = np.concatenate([point.values[columns] for point in points])
    C = block_diag(*[point.covariance[columns][:, columns] for point in points]) + prior
    X = np.kron(design, np.eye(len(columns)))
    covariance = np.linalg.inv(X.T @ np.linalg.solve(C, X))
    found = covariance @ X.T @ np.linalg.solve(C, y)
    r = y - X @ found
    return found.reshape(design.shape[1], -1), covariance, r @ np.linalg.solve(C, r)


@pytest.mark.parametrize("celsius", [(0.0, 60.0), (0.0, 20.0, 61.0), (-10.0, 21.0, 40.0, 71.0)])
def test_E_is_generalised_least_squares_of_all_sessions(celsius):
    points = some_points(celsius)
    fit = join(points, None)
    order = len(fit.model.E_terms) - 1
    reference = np.round((celsius[0] + celsius[-1]) / 2)
    assert fit.model.reference_c == reference
    away = np.array(celsius) - reference
    chi = [dense(points, np.arange(9), away[:, None] ** np.arange(p + 1))[2] for p in range(min(len(celsius) - 1, 2) + 1)]
    p_values = [stats.chi2.sf(each - chi[-1], 9 * (len(chi) - 1 - p)) for p, each in enumerate(chi[:-1])]
    assert fit.p_constant == pytest.approx(p_values[0])
    assert order == next((p for p, each in enumerate(p_values) if each >= 0.01), len(chi) - 1)
    terms, covariance, left = dense(points, np.arange(9), away[:, None] ** np.arange(order + 1))
    assert fit.model.E_terms.reshape(-1, 9) == pytest.approx(terms, rel=1e-6)
    assert fit.freedom == 9 * (len(celsius) - order - 1)
    assert fit.chi_square == pytest.approx(left, abs=1e-6)
    widened = max(left / fit.freedom, 1) if fit.freedom else 1.0
    assert fit.widened == pytest.approx(widened)
    assert fit.p_value == pytest.approx(stats.chi2.sf(left, fit.freedom) if fit.freedom else np.nan, nan_ok=True)
    size = 9 * (order + 1)
    np.testing.assert_allclose(fit.covariance[:size, :size], widened * covariance, rtol=1e-6, atol=1e-16)
    assert fit.model.range_c == (celsius[0] - 1, celsius[-1] + 2)


def test_scatter_beyond_the_sigmas_widens_E():
    points = some_points((20.0, 20.5, 21.0), spread=3.0)
    fit = join(points, None)
    _, covariance, left = dense(points, np.arange(9), np.ones((3, 1)))
    assert fit.widened == pytest.approx(left / 18)
    assert fit.widened > 3
    np.testing.assert_allclose(fit.covariance[:9, :9], left / 18 * covariance, rtol=1e-6)


@pytest.mark.parametrize(("p", "order"), [(0.0099, 1), (0.0101, 0)])
def test_E_depends_on_temperature_below_one_percent(p, order):
    """Two sessions: the second is moved along one number until the chi-square of a constant has this p-value."""
    first, second = some_points((0.0, 60.0), spread=0.0)
    both = (first.covariance + second.covariance)[MATRIX, MATRIX]
    step = np.sqrt(stats.chi2.isf(p, 9) / np.linalg.inv(both)[4, 4])
    values = second.values.copy()
    values[MATRIX] = first.values[MATRIX] + step * (np.arange(9) == 4)
    fit = join([first, replace(second, values=values)], None)
    assert fit.p_constant == pytest.approx(p, rel=1e-6)
    assert len(fit.model.E_terms) == order + 1


@pytest.mark.parametrize(("p", "order"), [(0.0099, 1), (0.0101, 0)])
def test_the_zero_without_a_rest_log_depends_on_temperature_below_one_percent(p, order):
    """Three axes together, by each one's own sigma."""
    first, second = some_points((0.0, 60.0), spread=0.0)
    both = np.diag(first.covariance + second.covariance)[BIAS]
    values = second.values.copy()
    values[BIAS] = first.values[BIAS] + np.sqrt(stats.chi2.isf(p, 3) / 3 * both)
    fit = join([first, replace(second, values=values)], None)
    assert len(fit.model.zero_terms) == order + 1


def test_temperatures_two_degrees_apart_are_two_and_E_has_no_more_than_a_square():
    for celsius, orders in (((20.0, 22.0), 1), ((20.0, 22.1), 2), ((20.0, 22.1, 24.2), 3), ((0.0, 20, 40, 60), 3)):
        points = some_points(celsius, spread=1000.0)
        fit = join(points, None)
        assert len(fit.model.E_terms) == orders
        assert len(fit.model.zero_terms) == min(len(celsius), 4) if orders > 1 else 1
        assert len(join(points, None, most_order=1).model.zero_terms) <= 2
    five = join(some_points((0.0, 20, 40, 60, 80), spread=1e4), None)
    assert len(five.model.zero_terms) == 4  # a cube at most, without a rest log


def turn_on_of(points, values, design, known):
    """The scatter with which chi-square of three axes has its degrees of freedom."""
    freedom = 3 * (len(points) - design.shape[1])

    def chi_square(variance):
        total = 0.0
        for i in range(3):
            V = np.diag([point.covariance[9 + i, 9 + i] + variance for point in points]) + known[i]
            r = values[:, i] - design @ np.linalg.solve(design.T @ np.linalg.solve(V, design), design.T @ np.linalg.solve(V, values[:, i]))
            total += r @ np.linalg.solve(V, r)
        return total - freedom

    return np.sqrt(optimize.brentq(chi_square, 0, 1.0, xtol=1e-18)) if chi_square(0) > 0 else 0.0


@pytest.mark.parametrize("turn_on", [0.0, 0.01])
def test_the_zero_of_sessions_alone_is_least_squares_with_the_switch_ons_scatter(turn_on):
    points = some_points((0.0, 20.0, 41.0, 60.0), seed=1)
    shift = turn_on * DEG * np.random.default_rng(3).normal(size=(4, 3))
    points = [replace(point, values=point.values + np.append(np.zeros(9), each)) for point, each in zip(points, shift, strict=True)]
    fit = join(points, None, most_order=2)
    order = len(fit.model.zero_terms) - 1
    away = np.array([0.0, 20, 41, 60]) - 30
    design = away[:, None] ** np.arange(order + 1)
    zeros = np.array([point.values[BIAS] for point in points])
    spread = turn_on_of(points, zeros, design, [0.0] * 3)
    assert fit.turn_on_rps == pytest.approx(spread, rel=1e-6)
    assert (spread > 0) == (turn_on > 0)
    size = fit.model.E_terms.size
    for i in range(3):
        terms, covariance, _ = dense(points, np.array([9 + i]), design, spread**2 * np.eye(4))
        assert fit.model.zero_terms[:, i] == pytest.approx(terms[:, 0], rel=1e-6)
        rows = size + 3 * np.arange(order + 1) + i
        np.testing.assert_allclose(fit.covariance[np.ix_(rows, rows)], covariance, rtol=1e-6)
    if not turn_on:
        # The order is the lowest that the sigmas of single axes do not refuse.
        def chi(p):
            A = away[:, None] ** np.arange(p + 1)
            return sum(dense(points, np.array([9 + i]), A)[2] for i in range(3))

        p_values = [stats.chi2.sf(chi(p) - chi(2), 3 * (2 - p)) for p in range(2)]
        assert order == next((p for p, each in enumerate(p_values) if each >= 0.01), 2)


def an_axis(terms, tau_s, root):
    """The fit of one axis as a rest log gives it: terms, lag, and a root of their covariance."""
    covariance = root @ root.T
    if not tau_s:
        covariance[-1] = covariance[:, -1] = 0
    return AxisFit(np.asarray(terms, dtype=float), tau_s, covariance, None, 2e-3, 1e-3, 0.0, None, None, None, np.nan)


@pytest.fixture(scope="module")
def shape():
    """A rest log from -5 to 70 degC about 32: a quadratic with a lag, a line, a quadratic, each with a covariance of its own."""
    rng = np.random.default_rng(11)
    knots = make_knots([small_rest([-5.0, 30, 70])], [])
    size = np.array([1e-3, 3e-5, 1e-6, 2.0])
    axes = [
        an_axis(ZERO[:, 0], 30.0, (size * (np.eye(4) + 0.5 * rng.normal(size=(4, 4))).T).T * DEG),
        an_axis(ZERO[:2, 1], 0.0, (size[[0, 1, 3]] * (np.eye(3) + 0.5 * rng.normal(size=(3, 3))).T).T * DEG),
        an_axis(ZERO[:, 2], -20.0, (size * (np.eye(4) + 0.5 * rng.normal(size=(4, 4))).T).T * DEG),
    ]
    return RestFit((), knots, (), tuple(axes), (), None, None, ())


def test_terms_of_rest_logs_lie_order_by_order(shape):
    alone = of_rests_alone("name", shape, {"a": "b"})
    assert alone.names == parameter_names(0, 2)
    assert len(alone.names) == len(alone.values) == 9 + 9 + 3
    assert alone.names[9:12] == ("zero0_x", "zero0_y", "zero0_z")
    assert alone.names[-1] == "lag_z"
    assert alone.values[:9].tolist() == np.eye(3).ravel().tolist()
    for axis, fit in enumerate(shape.gyro):
        rows = [9 + 3 * n + axis for n in range(fit.order + 1)] + [18 + axis]
        assert alone.values[rows].tolist() == [*fit.terms, fit.tau_s]
        np.testing.assert_array_equal(alone.covariance[np.ix_(rows, rows)], fit.covariance)
    kept = sum(np.count_nonzero(fit.covariance) for fit in shape.gyro)
    assert np.count_nonzero(alone.covariance) == kept
    assert alone.values[9 + 6 + 1] == 0
    assert alone.remaining_rps.tolist() == [2e-3] * 3
    assert alone.model.range_c == (-5, 70)
    assert alone.model.reference_c == 32
    assert alone.sigma == pytest.approx(np.sqrt(np.diag(alone.covariance)))
    bare = replace(shape, knots=make_knots([small_rest([np.nan] * 3)], []))
    assert of_rests_alone("name", bare, {}).model.range_c == (25, 25)


@pytest.mark.parametrize("celsius", [(0.0,), (0.0, 60.0), (-20.0, 20.0, 50.0)])
def test_the_level_is_the_sessions_and_the_shape_the_rest_logs(shape, celsius):
    """With full matrices: the sessions' zeros less the shape, whose error is shared by all of them; then the covariance of level, shape
    and lag by how each depends on the sessions' zeros and on the rest log."""
    points = some_points(celsius, seed=2, spread=3.0)
    fit = joined("name", join(points, shape), shape, {})
    away = np.array(celsius) - 32
    zeros = np.array([point.values[BIAS] for point in points])
    parts = []
    for axis in shape.gyro:
        powers = np.array([away**n for n in range(1, axis.order + 1)])
        parts.append((axis.terms[1:] @ powers, powers, powers.T @ axis.covariance[1:-1, 1:-1] @ powers))
    ones = np.ones((len(points), 1))
    spread = (
        turn_on_of(points, zeros - np.array([part[0] for part in parts]).T, ones, [part[2] for part in parts]) if len(points) > 1 else 0
    )
    assert fit.sessions.turn_on_rps == pytest.approx(spread if len(points) > 1 else np.nan, nan_ok=True, rel=1e-6)
    n_E, order = fit.model.E_terms.size, len(fit.model.zero_terms) - 1
    for i, (axis, (curve, powers, known)) in enumerate(zip(shape.gyro, parts, strict=True)):
        own = np.diag([point.covariance[9 + i, 9 + i] for point in points]) + spread**2 * np.eye(len(points))
        weights = np.linalg.solve(own + known, ones) / (ones.T @ np.linalg.solve(own + known, ones))
        assert fit.model.zero_terms[0, i] == pytest.approx((zeros[:, i] - curve) @ weights[:, 0], rel=1e-9)
        assert fit.model.zero_terms[1 : axis.order + 1, i].tolist() == axis.terms[1:].tolist()
        # Level, higher terms and lag, as a matrix on the sessions' zeros and the rest log's higher terms and lag.
        size = axis.order + 1
        depends = np.zeros((size + 1, len(points) + size))
        depends[0] = np.concatenate([weights[:, 0], -weights[:, 0] @ powers.T, [0]])
        depends[1:, len(points) :] = np.eye(size)
        expected = depends @ block_diag(own, axis.covariance[1:, 1:]) @ depends.T
        rows = n_E + np.append(3 * np.arange(size) + i, 3 * (order + 1) + i)
        np.testing.assert_allclose(fit.covariance[np.ix_(rows, rows)], expected, rtol=1e-6, atol=1e-22)
        assert fit.model.lag_s[i] == axis.tau_s
    assert fit.model.range_c == (min(celsius[0] - 1, -5), max(celsius[-1] + 2, 70))
    assert fit.remaining_rps.tolist() == [2e-3] * 3
    assert len(fit.names) == len(fit.values) == len(fit.covariance)


def test_one_session_keeps_its_own_covariance_of_E_and_each_axis_zero():
    (point,) = some_points((20.0,))
    own = point.covariance.copy()
    own[BIAS, BIAS] = np.diag(np.diag(own)[BIAS])
    fit = join([point], None)
    np.testing.assert_allclose(fit.covariance[:12, :12], own, rtol=1e-9)
    two = join([point, point], None)
    np.testing.assert_allclose(two.covariance[:12, :12], own / 2, rtol=1e-6, atol=1e-18)
    assert np.isnan(fit.p_value)
    assert fit.p_constant == 1


@pytest.mark.parametrize(("times", "lowest"), [(8.0, -0.5), (1e6, -1.4e5)])
def test_a_covariance_that_cannot_be_becomes_the_nearest_that_can(times, lowest):
    """The second session, of far greater sigmas, counts for the correlation alone.  In sigmas, what is added is no less than
    nothing, and lies only where nothing is left: the nearest matrix (Moreau)."""
    (point,) = some_points((20.0,))
    fit = join([point, replace(point, covariance=times * point.covariance)], None)
    raw = np.zeros((15, 15))
    raw[:9, :9] = point.covariance[MATRIX, MATRIX]
    raw[BIAS, BIAS] = np.diag(np.diag(point.covariance[BIAS, BIAS]))
    raw /= 1 + 1 / times
    raw[MATRIX, BIAS] = point.covariance[MATRIX, BIAS] * (1 + times) / 4
    raw[BIAS, MATRIX] = raw[MATRIX, BIAS].T
    scale = np.append(np.sqrt(np.diag(raw))[:12], np.ones(3))
    before, now = (each / np.outer(scale, scale) for each in (raw, fit.covariance))
    size = np.abs(before).max()
    assert 2 * lowest < np.linalg.eigvalsh(before)[0] < lowest / 2
    assert min(np.linalg.eigvalsh(now)[0], np.linalg.eigvalsh(now - before)[0]) > -1e-6 * size
    assert np.abs(now @ (now - before)).max() < 1e-6 * size**2


def test_sigmas_at_a_temperature_are_those_of_the_polynomial_there(shape):
    """By numeric derivatives of the model in each of its coefficients; beyond the range, those of its end."""
    fit = joined("name", join(some_points((-20.0, 20.0, 50.0)), shape), shape, {})
    root = np.random.default_rng(0).normal(size=(len(fit.covariance),) * 2) * 1e-3
    fit = replace(fit, covariance=root @ root.T)
    n_E = fit.model.E_terms.size
    for celsius, at in ((41.0, 41.0), (-20.0, -20.0), (300.0, 70.0)):
        slopes = []
        for k in range(len(fit.values) - 3):
            moved = fit.values + (np.arange(len(fit.values)) == k)
            model = replace(fit.model, E_terms=moved[:n_E].reshape(-1, 3, 3), zero_terms=moved[n_E:-3].reshape(-1, 3))
            change = [
                part.ravel()
                for part in (
                    model.E(np.array([at])) - fit.model.E(np.array([at])),
                    model.zero(np.full((1, 3), at)) - fit.model.zero(np.full((1, 3), at)),
                )
            ]
            slopes.append(np.concatenate(change))
        S = np.array(slopes).T
        expected = np.sqrt(np.diag(S @ fit.covariance[:-3, :-3] @ S.T))
        E, zero = fit.sigma_at(celsius)
        assert E.ravel() == pytest.approx(expected[:9], rel=1e-6)
        assert zero == pytest.approx(expected[9:], rel=1e-6)
