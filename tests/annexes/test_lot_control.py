"""Control charts: limits and scores by hand, how often they ring by chance, and what must ring."""

import numpy as np
import pytest
from scipy import stats

from tinygc.annexes.lots.capability import RULES, chart, rule_violations


def normal(seed, n=300, noise=0.3):
    rng = np.random.default_rng(seed)
    sigma = noise * np.exp(0.5 * rng.normal(size=n))
    return rng.normal(size=n) + sigma * rng.normal(size=n), sigma


def test_limits_of_a_short_chart_by_hand():
    """Mean, and mean moving range over 1.128; 0.63 degrees of freedom for each step of a point."""
    y, noise = np.array([1.0, 4.0, 2.0, 7.0, 3.0]), np.array([0.5, 1.0, 0.5, 0.2, 2.0])
    found = chart(y, noise, charts=21)
    whole = 3.5 / (2 / np.sqrt(np.pi))
    short = np.sqrt(whole**2 - np.mean(noise**2))
    assert (found.centre, found.short_term) == pytest.approx((3.4, short))
    assert found.sigma == pytest.approx(np.sqrt(short**2 + noise**2))
    assert np.isnan(found.moving_range[0])
    assert found.moving_range[1:].tolist() == [3, 2, 5, 4]
    assert found.range_limit == pytest.approx(3.267 * 3.5)
    t = stats.t.sf(np.abs(y - 3.4) / found.sigma, 0.63 * 4)
    assert found.score == pytest.approx(np.sign(y - 3.4) * stats.norm.isf(t))
    assert found.limit == pytest.approx(stats.norm.isf(0.01 / 2 / 5 / 21 / 2))
    # The moving average of bounded scores, in sigmas of its own; four independent points for each of its own twenty.
    average, variance = 0.0, 0.0
    for k in range(5):
        average, variance = 0.95 * average + 0.05 * np.clip(found.score[k], -3, 3), 0.95**2 * variance + 0.05**2
        assert found.ewma[k] == pytest.approx(average / np.sqrt(variance))
    assert found.ewma_limit == pytest.approx(stats.norm.isf(0.01 / 2 / 21 / 2))
    assert found.place.tolist() == [0, 1, 2, 3, 4]
    assert found.chance == pytest.approx({name: 5 * rate for name, rate in RULES.items()})
    assert chart(y, noise, place=np.array([3, 4, 6, 8, 9])).place.tolist() == [3, 4, 6, 8, 9]
    assert chart(y, 10 * noise).short_term == 0


@pytest.mark.parametrize("n", [20, 21])
def test_a_long_chart_takes_medians(n):
    """Of more than twenty points the median, and the median moving range over 0.954; 0.31 degrees of freedom for each step."""
    y, noise = np.random.default_rng(0).normal(size=n) + np.where(np.arange(n) == 5, 40.0, 0.0), np.full(n, 0.1)
    found = chart(y, noise)
    ranges = np.abs(np.diff(y))
    whole = np.median(ranges) / (np.sqrt(2) * stats.norm.isf(0.25)) if n > 20 else np.mean(ranges) / 1.1283792
    centre = np.median(y) if n > 20 else np.mean(y)
    assert (found.centre, found.short_term) == pytest.approx((centre, np.sqrt(whole**2 - 0.01)))
    freedom = (0.31 if n > 20 else 0.63) * (n - 1)
    assert found.score == pytest.approx(np.sign(y - centre) * stats.norm.isf(stats.t.sf(np.abs(y - centre) / found.sigma, freedom)))
    assert found.ewma_limit == pytest.approx(stats.norm.isf(0.01 / 2 / max(n * 0.05 * 4, 1) / 2))
    # With a lot's tails: its variance has scaled the numbers, and both freedoms together are fewer than either.
    tails = chart(y, noise, tails=6.0).score
    scaled = np.abs(y - centre) / found.sigma * np.sqrt(6 / 4)
    assert tails == pytest.approx(np.sign(y - centre) * stats.norm.isf(stats.t.sf(scaled, 1 / (1 / 6 + 1 / freedom))))


@pytest.mark.parametrize(
    ("rule", "scores", "rings"),
    [
        ("beyond 3 sigma", [3.01, 2.99, -3.01], [0, 2]),
        ("2 of 3 beyond 2 sigma", [2.01, 0, 2.01, 0, 1.99, 2.01, 0, 0, -2.01, -2.01, 2.01], [2, 9, 10]),
        ("4 of 5 beyond 1 sigma", [1.01, 1.01, 0, 1.01, 1.01, 0, 0.99, 1.01, 1.01, 1.01, -1.01, 1.01], [4, 11]),
        ("9 on one side", [1] * 8 + [-1] * 9 + [1], [16]),
        ("9 on one side", [0.01] * 9 + [-1], [8]),
    ],
)
def test_where_each_rule_rings(rule, scores, rings):
    (found,) = [hits for name, hits in rule_violations(np.array(scores, dtype=float)).items() if name == rule]
    assert np.flatnonzero(found).tolist() == rings


def test_the_chance_of_each_rule():
    above = lambda z: stats.norm.sf(z)  # noqa: E731
    assert RULES["beyond 3 sigma"] == pytest.approx(2 * above(3))
    assert RULES["2 of 3 beyond 2 sigma"] == pytest.approx(2 * (3 * above(2) ** 2 * (1 - above(2)) + above(2) ** 3))
    assert RULES["4 of 5 beyond 1 sigma"] == pytest.approx(2 * (5 * above(1) ** 4 * (1 - above(1)) + above(1) ** 5))
    assert RULES["9 on one side"] == pytest.approx(2 / 512)


def runs_of(rule, count):
    """360 quiet points that ring a rule so often: wild ones in groups, or one long run that shorter ones of the other sign make up for."""
    if rule == "9 on one side":
        signs, left = [1.0] * (8 + count), 8 + count
        while left > 0:
            more = min(left, 7)
            signs += [-1.0] * (more + 1) + [1.0]
            left -= more
        return np.resize([*signs, *([-1.0, 1.0] * 180)], 360)
    y = np.tile([1.0, -1.0, 2.0, -2.0, 1.0, -1.5], 60)
    wild = {"beyond 3 sigma": [0], "2 of 3 beyond 2 sigma": [0, 2], "4 of 5 beyond 1 sigma": [0, 1, 3, 4]}[rule]
    for k in range(count):
        y[12 * k + np.array(wild)] = 1000.0
    return y


@pytest.mark.parametrize(
    ("rule", "run"), [("beyond 3 sigma", 1), ("2 of 3 beyond 2 sigma", 2), ("4 of 5 beyond 1 sigma", 5), ("9 on one side", 5)]
)
def test_a_count_of_a_rule_rings_where_chance_has_one_in_a_hundred(rule, run):
    """Over four rules and all charts, by Poisson's distribution of runs, each of up to so many points."""
    for charts in (1, 21):
        least = next(k for k in range(40) if stats.poisson.sf((k - 1) // run, 360 * RULES[rule] / run) < 0.01 / (4 * charts))
        for count in (least - 1, least):
            found = chart(runs_of(rule, count), np.full(360, 1e-3), charts=charts)
            assert found.counts[rule] == count
            assert (rule in found.broken) == (count >= least)


@pytest.mark.parametrize(("times", "rings"), [(0.999, False), (1.001, True)])
def test_a_point_rings_at_its_limit(times, rings):
    y, noise = np.random.default_rng(3).normal(size=60), np.full(60, 0.1)
    found = chart(y, noise, charts=21)
    freedom = 0.31 * 59
    far = stats.t.isf(stats.norm.sf(found.limit), freedom) * times
    # Only the median range and the median are used: a point already beyond both moves neither.
    k = int(np.argmax(y))
    y[k] = found.centre + far * found.sigma[k]
    again = chart(y, noise, charts=21)
    assert again.short_term == pytest.approx(found.short_term, rel=0.1)
    y[k] = again.centre + far * again.sigma[k]
    assert (k in chart(y, noise, charts=21).alarms) == rings


@pytest.mark.broad
def test_a_process_in_control_rings_no_more_than_is_said():
    """300 lots of one chart: points and moving average at 1 % each half, rules at 1 %; at most 11 of 300 by chance, p = 0.001."""
    times = {"point": 0, "ewma": 0, "rule": 0}
    for seed in range(300):
        found = chart(*normal(seed))
        times["point"] += len(found.alarms) > 0
        times["ewma"] += len(found.ewma_alarms) > 0
        times["rule"] += len(found.broken) > 0
    assert max(times.values()) <= stats.binom.isf(0.001, 300, 0.01), times


def test_a_step_of_one_sigma_is_found_by_the_average_and_a_wild_point_is_not_taken_for_one():
    y, sigma = normal(5, noise=0.1)
    assert len(chart(np.where(np.arange(300) < 150, y, y + 1.5), sigma, charts=21).ewma_alarms) > 0
    y[100] += 30
    found = chart(y, sigma, charts=21)
    assert list(found.alarms) == [100]
    assert len(found.ewma_alarms) == 0


def test_the_sign_and_the_unit_of_a_number_do_not_matter():
    y, sigma = normal(7)
    one, other = chart(y, sigma), chart(-1000 * y + 5, 1000 * sigma)
    assert other.score == pytest.approx(-one.score, abs=1e-9)
    assert other.counts == one.counts


def test_two_points_are_no_chart_and_three_are():
    with pytest.raises(ValueError, match="needs 3 points"):
        chart(np.zeros(2), np.ones(2))
    assert chart(np.array([1.0, 2.0, 4.0]), np.zeros(3)).short_term > 0


def test_points_that_are_all_alike_or_beyond_all_numbers_have_scores():
    assert not chart(np.ones(5), np.zeros(5)).score.any()
    assert chart(np.append(np.tile([1.0, -1.0], 15), 1e100), np.full(31, 0.1)).score[-1] == pytest.approx(stats.norm.isf(1e-300))
