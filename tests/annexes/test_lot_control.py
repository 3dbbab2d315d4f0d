"""Control charts: what rings by chance, and what must ring."""

import numpy as np
import pytest
from scipy import stats

from tinygc.annexes.lots.capability import FAMILY_P, RULES, chart

CHARTS = 21


def normal(seed, n=300, noise=0.3):
    rng = np.random.default_rng(seed)
    sigma = noise * np.exp(0.5 * rng.normal(size=n))
    return rng.normal(size=n) + sigma * rng.normal(size=n), sigma


def test_a_process_in_control_rings_no_more_than_is_said():
    """300 lots of one chart: points and moving average at 1 % each half, rules at 1 %; at most 11 of 300 by chance, p = 0.001."""
    rung = {"point": 0, "ewma": 0, "rule": 0}
    for seed in range(300):
        found = chart(*normal(seed))
        rung["point"] += len(found.alarms) > 0
        rung["ewma"] += len(found.ewma_alarms) > 0
        rung["rule"] += len(found.broken) > 0
    assert max(rung.values()) <= stats.binom.isf(0.001, 300, FAMILY_P), rung


def test_rules_ring_by_chance_as_often_as_is_said():
    """100 000 independent points; the error of a count of runs is below 8 % of it."""
    rng = np.random.default_rng(0)
    found = chart(rng.normal(size=100_000), np.full(100_000, 1e-6))
    for rule, rate in RULES.items():
        assert found.counts[rule] == pytest.approx(1e5 * rate, rel=0.2), rule
        assert found.chance[rule] == pytest.approx(1e5 * rate)


def test_the_short_term_sigma_is_without_noise_and_without_drift():
    rng = np.random.default_rng(1)
    y = rng.normal(size=4000) + 0.5 * rng.normal(size=4000)
    found = chart(y + np.linspace(-3, 3, 4000), np.full(4000, 0.5))
    assert found.short_term == pytest.approx(1.0, abs=0.06)


def test_a_step_of_one_sigma_is_found_by_the_average_and_a_wild_point_is_not_taken_for_one():
    y, sigma = normal(5, noise=0.1)
    assert len(chart(np.where(np.arange(300) < 150, y, y + 1.5), sigma, charts=CHARTS).ewma_alarms) > 0
    y[100] += 30
    found = chart(y, sigma, charts=CHARTS)
    assert list(found.alarms) == [100]
    assert len(found.ewma_alarms) == 0


def test_a_point_that_is_not_known_well_has_wider_limits():
    y, sigma = normal(6, noise=0.1)
    y[50] = y[60] = 7.0
    sigma[60] = 3.0
    assert list(chart(y, sigma, charts=CHARTS).alarms) == [50]


def test_tails_of_the_lot_ring_no_alarms():
    rng, tails = np.random.default_rng(2), 5.0
    y = rng.standard_t(tails, size=2000) * np.sqrt((tails - 2) / tails)
    by_normal, by_tails = (chart(y, np.full(2000, 0.01), each) for each in (np.inf, tails))
    assert len(by_normal.alarms) > 5
    assert len(by_tails.alarms) <= 1


def test_the_sign_and_the_unit_of_a_number_do_not_matter():
    y, sigma = normal(7)
    one, other = chart(y, sigma), chart(-1000 * y + 5, 1000 * sigma)
    assert other.score == pytest.approx(-one.score, abs=1e-9)
    assert other.counts == one.counts


def test_two_points_are_no_chart():
    with pytest.raises(ValueError, match="needs 3 points"):
        chart(np.zeros(2), np.ones(2))
