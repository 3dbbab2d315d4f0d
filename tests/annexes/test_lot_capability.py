"""Capability against limits: exact where there is a formula, intervals that hold, limits that are refused."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from session.io.errors import FormatError
from tinygc.annexes.lots.capability import capability, indices, outside_ppm, read_limits, risks


def test_indices_and_their_intervals():
    """Cp has the distribution of a sigma, by chi-square; Cpk that of Bissell's formula."""
    found = indices(-6, 6, 1.5, 0.9, 30, 40)
    assert (found.index, found.centred) == pytest.approx((12 / 5.4, 4.5 / 2.7))
    assert found.index_interval == pytest.approx(12 / 5.4 * np.sqrt(stats.chi2.ppf([0.025, 0.975], 30) / 30))
    half = stats.norm.isf(0.025) * np.sqrt(1 / (9 * 40) + found.centred**2 / (2 * 30))
    assert found.centred_interval == pytest.approx((found.centred - half, found.centred + half))
    assert indices(-6, 6, -1.5, 0.9, 30, 40).centred == pytest.approx(4.5 / 2.7)
    assert indices(-6, 6, 0, 1, 0.3, 40).index_interval == pytest.approx(2 * np.sqrt(stats.chi2.ppf([0.025, 0.975], 1)))
    for lower, upper, mean in ((-math.inf, 6, 1.5), (-6, math.inf, -1.5)):
        one = indices(lower, upper, mean, 1.0, 99, 100)
        assert np.isnan([one.index, *one.index_interval]).all()
        assert one.centred == pytest.approx(1.5)
    nothing = indices(-6, 6, 0, 0.0, 99, 100)
    assert np.isnan([nothing.index, nothing.centred, *nothing.index_interval, *nothing.centred_interval]).all()


def test_intervals_hold_the_truth():
    """Of 400 lots of 50, both intervals hold the true index in 95 %; fewer than 365 in one of ten thousand."""
    inside = np.zeros(2)
    for seed in range(400):
        y = np.random.default_rng(seed).normal(0.5, 1, 50)
        found = indices(-4, 4, y.mean(), y.std(ddof=1), 49, 50)
        inside += [lo <= true <= hi for (lo, hi), true in ((found.index_interval, 4 / 3), (found.centred_interval, 3.5 / 3))]
    assert inside.min() >= stats.binom.ppf(1e-4, 400, 0.95)


@pytest.mark.parametrize("tails", [np.inf, 5.0])
def test_parts_per_million_outside_are_those_of_the_distribution(tails):
    """Of the normal one, or of Student's t with that sigma."""
    of = stats.t(tails, 0.5, 1.2 * (np.sqrt(3 / 5) if tails == 5 else 1))
    assert outside_ppm(-3, 3.5, 0.5, 1.2, tails) == pytest.approx(1e6 * (of.cdf(-3) + of.sf(3.5)), rel=1e-9)
    assert outside_ppm(-math.inf, 3.5, 0.5, 1.2, tails) == pytest.approx(1e6 * of.sf(3.5), rel=1e-9)
    assert outside_ppm(-3, 3, 2, 0.0) == 0
    assert outside_ppm(-3, 3, 3.1, 0.0) == 1e6


@pytest.mark.parametrize(("lower", "upper", "guard"), [(-2, 2, 0.0), (-2, 2.5, 0.2), (-math.inf, 1.5, 0.1), (-1, math.inf, 0.3)])
def test_risks_by_direct_integration(lower, upper, guard):
    """Units outside that a reading within the guarded limits accepts, and units inside that it rejects."""
    mean, sigma, noise = 0.2, 0.8, 0.3

    def accepted(x):
        return stats.norm.cdf((upper - guard - x) / noise) - stats.norm.cdf((lower + guard - x) / noise)

    def over(what, ends):
        total = 0.0
        for low, high in ends:
            points = [x for x in (mean, lower, upper) if low < x < high]
            total += integrate.quad(lambda x: what(x) * stats.norm.pdf(x, mean, sigma), low, high, points=points or None, limit=200)[0]
        return 1e6 * total

    low, high = max(lower, mean - 9 * sigma), min(upper, mean + 9 * sigma)
    outside = [(low - 8 * noise, low)] * math.isfinite(lower) + [(high, high + 8 * noise)] * math.isfinite(upper)
    accept, reject = risks(lower, upper, mean, sigma, noise, *([guard] if guard else []))
    assert accept == pytest.approx(over(accepted, outside), rel=1e-3)
    assert reject == pytest.approx(over(lambda x: 1 - accepted(x), [(low, high)]), rel=1e-3)
    assert risks(lower, upper, mean, sigma, 0.0) == (0, 0)
    assert risks(lower, upper, mean, 0.0, noise) == (0, 0)


@pytest.mark.parametrize("times", [0.3, 100.0])
def test_risks_at_a_limit_in_the_middle_are_the_probability_of_a_quadrant(times):
    """Half of the units on either side, and noise so many times their sigma: arctan(times) / 2 pi are on one and read on the other."""
    expected = 1e6 * np.arctan(times) / (2 * np.pi)
    assert risks(0.2, math.inf, 0.2, 0.01, 0.01 * times) == pytest.approx((expected, expected), rel=1e-3)


def test_limits_narrower_than_their_guard_accept_nothing():
    accept, reject = risks(-0.1, 0.1, 0, 1, 0.3, 0.2)
    assert accept == 0
    assert reject == pytest.approx(1e6 * (2 * stats.norm.cdf(0.1) - 1), rel=1e-3)


def test_a_capability_is_put_together_from_these():
    """Overall with the lot's freedom, observed with its noise, within by the moving ranges' six tenths; a guard of 1.64 sigmas."""
    readings = np.array([0.0, 7.0, np.nan, -6.5, 1, 2, 3, 5.0])
    found = capability((-6, 6), 0.5, 1.0, 0.75, 0.9, 12.0, 5.0, readings)
    assert (found.found_outside, found.units) == (2, 7)
    for part, expected in (
        (found.within, indices(-6, 6, 0.5, 0.9, 0.6 * 6, 7)),
        (found.overall, indices(-6, 6, 0.5, 1.0, 12.0, 7)),
        (found.observed, indices(-6, 6, 0.5, 1.25, 6, 7)),
    ):
        assert part == expected
    assert found.guard_band == pytest.approx(0.75 * stats.norm.isf(0.05))
    assert (found.mean, found.sigma, found.observed_sigma) == pytest.approx((0.5, 1.0, 1.25))
    assert (found.ppm_normal, found.ppm_tails) == (outside_ppm(-6, 6, 0.5, 1), outside_ppm(-6, 6, 0.5, 1, 5))
    assert (found.false_accept_ppm, found.false_reject_ppm) == risks(-6, 6, 0.5, 1, 0.75)
    assert (found.guarded_accept_ppm, found.guarded_reject_ppm) == risks(-6, 6, 0.5, 1, 0.75, found.guard_band)
    few = capability((-6, 6), 0.5, 1.0, 0.75, 0.9, 12.0, 5.0, np.array([1.0]))
    assert (few.within, few.observed) == (indices(-6, 6, 0.5, 0.9, 1, 1), indices(-6, 6, 0.5, 1.25, 1, 1))


def limits(tmp_path, text, head='schema = "tinygc-limits/1"\n'):
    path = tmp_path / "limits.toml"
    path.write_text(head + text, encoding="utf-8")
    return path


def test_one_component_wins_over_all_of_its_kind(tmp_path):
    found = read_limits(limits(tmp_path, "[gyro_bias_y_mdps]\nupper = 7\n[gyro_bias_mdps]\nlower = -1\nupper = 2\n"))
    assert found["gyro_bias_x_mdps"] == (-1, 2)
    assert found["gyro_bias_y_mdps"] == (-math.inf, 7)
    assert len(found) == 3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no limits, expected a section"),
        ("[gyro_bias_mdsp]\nupper = 2\n", "did you mean gyro_bias_mdps"),
        ("[gyro_bias_mdps]\n", "has no limit"),
        ("[gyro_bias_mdps]\nuper = 2\n", "uper is no key"),
        ("[gyro_bias_mdps]\nlower = 3\nupper = 2\n", "lower is 3, expected less than upper, 2"),
        ("[gyro_bias_mdps]\nlower = 2\nupper = 2\n", "lower is 2, expected less than upper, 2"),
        ('[gyro_bias_mdps]\nlower = "3"\n', "lower is 3, expected a number"),
        ("[gyro_bias_mdps]\nlower = nan\n", "lower is nan, expected a number"),
        ("gyro_bias_mdps = 3\n", "expected a section"),
        ("[gyro_bias_mdps\n", "broken TOML"),
    ],
)
def test_limits_that_are_none_are_refused_in_one_line(tmp_path, text, says):
    with pytest.raises(FormatError, match=says) as refused:
        read_limits(limits(tmp_path, text))
    assert "\n" not in str(refused.value)
    assert "limits.toml" in str(refused.value)


def test_a_file_of_another_kind_is_refused(tmp_path):
    with pytest.raises(FormatError, match="expected one of tinygc-limits/1"):
        read_limits(limits(tmp_path, "", "[gyro_bias_mdps]\nupper = 1\n"))
