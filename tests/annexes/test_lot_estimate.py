"""Mean, drift, spread and repeatability of a lot: in closed form, against every entry written out, and true of many lots."""

import numpy as np
import pytest
from scipy import optimize
from simulated_lots import COUNT, simulated_lot

from tinygc.annexes.lots.estimate import FAMILY_P, estimate, family, line, spread_of
from tinygc.annexes.lots.lot import LotSessions, lot_sessions


def drawn(counts, seed=0, drift=0.0, repeats=0.0, sigma=0.2, vary=0.0):
    """Sessions of units with so many each; spread 1 about 3, sizes in spreads; the stated sigma may vary from session to session."""
    rng, counts = np.random.default_rng(seed), np.array(counts)
    unit, shape = np.repeat(np.arange(len(counts)), counts), (counts.sum(), COUNT)
    values = 3 + rng.normal(size=(len(counts), COUNT)) + drift * np.linspace(-0.5, 0.5, len(counts))[:, None]
    sigmas = sigma * np.exp(vary * rng.normal(size=shape))
    y = values[unit] + np.hypot(sigmas, repeats) * rng.normal(size=shape)
    names = [str(number) for number in range(len(counts))]
    return LotSessions(y, sigmas**2, np.ones(shape, dtype=bool), np.cumsum(counts) - counts, counts, names, [str(i) for i in unit])


def test_a_line_s_numbers_follow_the_unit_of_x_and_none_is_made_where_x_is_zero():
    rng = np.random.default_rng(5)
    y, x, w = rng.normal(size=(6, 21)), rng.normal(size=(6, 21)), rng.uniform(1, 2, size=(6, 21))
    beta, covariance, left = line(y, x, w)
    for unit in (1e-9, 1e9):
        scaled, spread, same = line(y, unit * x, w)
        np.testing.assert_allclose(scaled * [1, unit], beta, rtol=1e-9)
        np.testing.assert_allclose(spread * [[1, unit], [unit, unit**2]], covariance, rtol=1e-9)
        np.testing.assert_allclose(same, left, atol=1e-9)
    beta, covariance, _ = line(y, 0 * x, w)
    np.testing.assert_allclose(beta[:, 0], (w * y).sum(axis=0) / w.sum(axis=0))
    np.testing.assert_allclose(covariance[:, 0, 0], 1 / w.sum(axis=0))
    assert not beta[:, 1].any()
    assert not covariance[:, 1].any()


def test_of_equal_sigmas_all_are_the_ordinary_regression_s():
    """Spread: the residuals' variance less the stated one."""
    lot = drawn([1] * 30, drift=2.0)
    found = estimate(lot)
    X = np.column_stack([np.ones(30), lot.place - 0.5])
    beta, square = np.linalg.lstsq(X, lot.values)[:2]
    variance, share = square / 28, np.sqrt(np.diag(np.linalg.inv(X.T @ X)))
    np.testing.assert_allclose([found.mean, found.drift], beta, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose([found.mean_sigma, found.drift_sigma], share[:, None] * np.sqrt(variance), rtol=1e-7)
    np.testing.assert_allclose(found.spread**2, variance - 0.04, rtol=1e-7)
    assert np.isnan(found.repeatability).all()
    assert found.drifts
    end = 0.5 + 1 / 29
    np.testing.assert_allclose(found.next_mean, beta[0] + end * beta[1], rtol=1e-9)
    np.testing.assert_allclose(found.next_sigma**2, variance * (share[0] ** 2 + end**2 * share[1] ** 2), rtol=1e-7)
    still = drawn([1] * 30)
    found = estimate(still)
    assert not found.drifts
    np.testing.assert_allclose(found.next_mean, still.values.mean(axis=0), rtol=1e-9)
    np.testing.assert_allclose(found.next_sigma**2, (found.spread**2 + 0.04) / 30, rtol=1e-7)
    assert (estimate(drawn([1] * 30, sigma=5.0, seed=1)).spread == 0).any()  # of more noise than spread it is zero, not below


def test_of_any_sigmas_the_spread_has_the_largest_restricted_likelihood():
    lot = drawn([1] * 12, vary=1.5, sigma=1.0)
    x = lot.place - 0.5
    found = spread_of(lot.values, np.repeat(x[:, None], COUNT, axis=1), lot.variances)
    X = np.column_stack([np.ones(12), x])
    for n in range(COUNT):

        def cost(spread, y=lot.values[:, n], noise=lot.variances[:, n]):
            w = 1 / (noise + spread)
            A = (X.T * w) @ X
            r = y - X @ np.linalg.solve(A, X.T @ (w * y))
            return np.linalg.slogdet(A)[1] - np.log(w).sum() + w @ r**2

        best = optimize.minimize_scalar(cost, bounds=(0, 20), method="bounded", options={"xatol": 1e-9}).fun
        assert cost(found[n]) < min(best, cost(0.0)) + 1e-6


def test_repeatability_is_what_sessions_of_a_unit_differ_by_beyond_what_they_state():
    """Of units with several; a unit's noise is then that of its sessions' weighted mean."""
    lot = drawn([3, 1, 2, 4] * 6, repeats=0.5)
    found = estimate(lot)
    groups = np.split(lot.values, lot.first[1:])
    square = sum(((each - each.mean(axis=0)) ** 2).sum(axis=0) for each in groups)
    np.testing.assert_allclose(found.repeatability**2, np.maximum(square / (lot.sessions - lot.units) - 0.04, 0.0), rtol=1e-9)
    noise = (0.04 + found.repeatability**2) / lot.count[:, None]
    w = 1 / (found.spread**2 + noise)
    np.testing.assert_allclose(found.next_sigma, 1 / np.sqrt(w.sum(axis=0)), rtol=1e-9)
    means = np.array([each.mean(axis=0) for each in groups])
    np.testing.assert_allclose(found.next_mean, (w * means).sum(axis=0) / w.sum(axis=0), rtol=1e-9)


def test_means_drifts_and_spreads_are_true():
    """Of 40 lots with 21 numbers each: 68 % within one sigma, variances true on the average."""
    found = [estimate(drawn([1, 3] * 30, seed, drift=1.0, repeats=0.3)) for seed in range(40)]
    for far in ([(each.mean - 3) / each.mean_sigma for each in found], [(each.drift - 1) / each.drift_sigma for each in found]):
        assert np.mean(np.abs(far) < 1) == pytest.approx(0.683, abs=0.05)
    variances = np.array([each.spread**2 for each in found])
    assert variances.mean() == pytest.approx(1.0, abs=0.03)
    assert np.mean(np.abs(variances - 1) < np.sqrt(2 / 58) * 1.08) == pytest.approx(0.683, abs=0.05)
    assert np.mean([each.repeatability**2 for each in found]) == pytest.approx(0.09, rel=0.05)


def test_a_unit_far_off_is_left_out_and_no_other_is():
    """8 sigmas off in one number; the others' numbers are those without it."""
    lot = drawn([1] * 200)
    assert not estimate(lot).excluded.any()
    lot.values[7, 10] += 8
    found = estimate(lot)
    assert np.flatnonzero(found.excluded).tolist() == [7]
    assert np.flatnonzero(found.p_values[7] < FAMILY_P).tolist() == [10]
    assert found.off[7, 10] == pytest.approx(lot.values[7, 10] - found.mean[10] - (7 / 199 - 0.5) * found.drift[10])
    rest = np.delete(lot.values[:, 10], 7)
    assert found.spread[10] ** 2 == pytest.approx(rest.var(ddof=1) - 0.04, rel=0.02)
    assert found.off_sigma[7, 10] == pytest.approx(np.hypot(found.spread[10], 0.2), rel=0.02)
    # by hand: 200 units, of 21 numbers each, two sides
    far = np.zeros((200, COUNT))
    far[0, 0], far[1, 1:] = 5.0, np.nan
    p = family(far, np.full(COUNT, 1e9))
    assert p[0, 0] == pytest.approx(200 * 21 * 5.733e-7, rel=1e-3)
    assert (p[1:] == 1).all()


def test_what_is_not_told_is_unknown():
    """No accelerometer; and a number that one unit tells is no lot's."""
    results = simulated_lot(12, 5, 1, without_accelerometer=1.0)
    for each in results[1:]:
        each.values[3] = np.nan
    found = estimate(lot_sessions(results))
    lost = np.isin(np.arange(COUNT), [3, *range(12, COUNT)])
    for each in (found.mean, found.mean_sigma, found.drift, found.drift_sigma, found.next_mean, found.next_sigma, found.spread):
        np.testing.assert_array_equal(np.isnan(each), lost)
    assert not found.excluded.any()


def test_two_units_have_a_mean_and_no_drift():
    lot = drawn([1, 1])
    found = estimate(lot)
    np.testing.assert_allclose(found.mean, lot.values.mean(axis=0))
    np.testing.assert_allclose(found.spread**2, np.maximum(np.diff(lot.values, axis=0)[0] ** 2 / 2 - 0.04, 0), rtol=1e-7)
    assert (found.drift_p, found.drifts) == (1.0, False)
