"""Spread, drift and repeatability of a lot: what is put in comes back, within its own uncertainty, and nothing else moves it."""

import dataclasses

import numpy as np
import pytest
from scipy import stats
from simulated_lots import COUNT, SPREAD, simulated_lot, truth

from tinygc import CalibrationError
from tinygc.annexes.lots.hierarchy import hierarchy
from tinygc.annexes.lots.lot import lot_sessions

MEAN, COVARIANCE = truth()


def found(*words, **more):
    return hierarchy(lot_sessions(simulated_lot(*words, **more)))


def sizes(matrix):
    return np.sqrt(np.diag(matrix)) / SPREAD


@pytest.fixture(scope="module")
def many():
    """Lots of 60 units, every second of them with three sessions, over seeds."""
    return [found(60, seed, [1, 3]) for seed in range(12)]


def test_means_are_within_their_sigmas(many):
    """21 correlated numbers of 12 lots: the mean square in sigmas is 1, by chi-square of one number's 12 draws at the least."""
    z = np.array([(each.mean - MEAN) / np.sqrt(np.diag(each.mean_covariance)) for each in many])
    lo, hi = stats.chi2.ppf([0.001, 0.999], z.size / 3) / (z.size / 3)
    assert lo < np.mean(z**2) < hi


def test_spreads_are_not_biased_and_within_their_sigmas(many):
    ratio = np.array([np.diag(each.spread) / SPREAD**2 for each in many])
    sigma = np.array([np.sqrt(2 / each.spread_freedom) for each in many])
    z = (ratio - 1) / sigma
    assert abs(np.mean(ratio) - 1) < 4 * np.mean(sigma) / np.sqrt(ratio.size / 3)
    assert 0.6 < np.mean(z**2) < 1.6


def test_repeatability_is_apart_from_noise_and_spread(many):
    """It is half of the stated noise: only the repeats tell it."""
    ratio = np.array([sizes(each.repeatability) for each in many])
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(0.1, abs=0.02)


def test_correlations_come_back():
    each = found(800, 1, 1)
    size = np.sqrt(np.diag(each.spread))
    true = COVARIANCE / np.outer(SPREAD, SPREAD)
    assert np.abs(each.spread / np.outer(size, size) - true).max() < 5 / np.sqrt(800)


@pytest.mark.parametrize("units", [6, 12])
def test_small_lots_are_not_biased(units):
    """Maximum likelihood would have a share of 1/units less (the mean), and 2/units with the drift; the restricted one has not."""
    ratio = np.array([np.diag(found(units, seed, 1, noise=0.05).spread) / SPREAD**2 for seed in range(40)])
    error = ratio.std(axis=0).mean() / np.sqrt(40 * 3)
    assert abs(ratio.mean() - 1) < 4 * error
    assert 4 * error < 2 / units


def test_one_unit_in_twenty_that_does_not_belong_moves_nothing():
    clean, wild = found(300, 4, [1, 2]), found(300, 4, [1, 2], wild=0.05)
    assert 0.02 < wild.off < 0.09
    assert np.all(np.abs(wild.mean - clean.mean) < 3 * np.sqrt(np.diag(clean.mean_covariance)))
    assert sizes(wild.spread) == pytest.approx(np.ones(COUNT), abs=0.17)  # four of its own sigmas
    assert np.mean(sizes(wild.spread)) == pytest.approx(1, abs=0.04)


def test_tails_are_found_and_not_imagined():
    heavy, normal = found(400, 2, 1, tails=5.0), found(400, 2, 1)
    assert 3.5 < heavy.tails < 8
    assert np.mean(sizes(heavy.spread)) == pytest.approx(1, abs=0.12)
    assert np.isinf(normal.tails)


def test_drift_over_production():
    each = found(200, 3, 1, drift=1.0)
    z = (each.drift - SPREAD) / np.sqrt(np.diag(each.drift_covariance))
    assert np.sqrt(np.mean(z**2)) < 1.6
    assert each.drifts
    # The next unit's mean is at the end of the drift.
    assert np.sqrt(np.mean(((each.next_mean - MEAN - 0.5 * SPREAD) / np.sqrt(np.diag(each.next_covariance))) ** 2)) < 1.6
    without = found(200, 3, 1)
    assert not without.drifts
    assert np.all(np.diag(without.next_covariance) < 0.6 * np.diag(each.next_covariance))


def test_accelerometers_that_are_not_told():
    none, some = found(60, 5, [1, 2], without_accelerometer=1.0), found(120, 5, [1, 2], without_accelerometer=0.5)
    assert np.isnan(none.mean[12:]).all()
    assert np.isnan(np.diag(none.spread)[12:]).all()
    assert np.isfinite(none.spread[:12, :12]).all()
    assert sizes(some.spread) == pytest.approx(np.ones(COUNT), abs=0.4)
    assert np.all(some.spread_freedom[12:] < some.spread_freedom[:12].min())


def test_without_a_repeated_session_repeatability_is_not_told():
    assert np.isnan(found(40, 0, 1).repeatability).all()


def test_noise_alone_is_no_spread():
    """Units that are all alike: the spread is a small part of the noise, and its freedom says that it is not told from none."""
    results = simulated_lot(80, 1, 1, noise=0.5, repeat=0.0)
    rng = np.random.default_rng(0)
    alike = [dataclasses.replace(r, values=MEAN + np.linalg.cholesky(r.covariance) @ rng.normal(size=COUNT)) for r in results]
    each = hierarchy(lot_sessions(alike))
    assert np.mean(sizes(each.spread)) < 0.25


def test_order_of_the_records_and_copies_do_not_matter():
    results = simulated_lot(30, 6, [1, 2])
    once = hierarchy(lot_sessions(results))
    again = hierarchy(lot_sessions([*results[::-1], *results[:5]]))
    assert again.mean == pytest.approx(once.mean, rel=1e-9)
    assert np.allclose(again.spread, once.spread, rtol=1e-9, atol=0)


def test_units_of_the_numbers_do_not_matter():
    """Everything a thousand times as large."""
    results = simulated_lot(30, 6, [1, 2])
    large = [dataclasses.replace(r, values=1e3 * r.values, covariance=1e6 * r.covariance) for r in results]
    once, again = (hierarchy(lot_sessions(each)) for each in (results, large))
    assert again.mean == pytest.approx(1e3 * once.mean, rel=1e-6)
    assert np.allclose(again.repeatability, 1e6 * once.repeatability, rtol=1e-6, atol=0)


def test_fewer_than_two_units_are_no_lot():
    with pytest.raises(CalibrationError, match="two units or more, got 1"):
        lot_sessions(simulated_lot(1, 0, 5))
    with pytest.raises(CalibrationError, match="got 0"):
        lot_sessions([])


def test_two_units_are_one():
    each = found(2, 0, 2)
    assert np.isfinite(each.spread).all()
    assert np.isfinite(each.next_mean).all()
