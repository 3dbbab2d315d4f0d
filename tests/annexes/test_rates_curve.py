"""What readings do not determine, and what is of the range in which it was tested: kinks, rates that err, curves that no law names."""

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import broad
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from tinygc.annexes.rates import curve as curves
from tinygc.annexes.rates.choice import LINE, Choice, choose, score
from tinygc.annexes.rates.curve import Curve, Shape, fit_curve
from tinygc.annexes.rates.fitting import fit
from tinygc.annexes.rates.laws import CURVE, LAWS, Hypothesis
from tinygc.annexes.rates.points import points_of, settings_of
from tinygc.annexes.rates.terms import Range, _asymmetry, _end, _inside, _probe, derived, left_open, linear_range, terms
from tinygc.annexes.rates.text import lines

UP = np.arange(-240.0, 241.0, 20.0)
BOTH_WAYS = np.concatenate([UP, UP[::-1]])
SCALE, NOISE = 0.02, 1.5e-3


def measured(of, rate=BOTH_WAYS, noise=NOISE, seed=1, sigma=None):
    output = of(rate) + noise * np.random.default_rng(seed).normal(size=len(rate))
    return points_of("sensor", "V", rate, output, ["one"] * len(rate), sigma)


def given(points, hypothesis):
    """The choice of a law that is known."""
    found = fit_curve(points, hypothesis) if hypothesis.law == CURVE else fit(points, hypothesis)
    return Choice(points, found, fit(points, LINE), 0.0, (), 1.0, ())


def rows_of(choice):
    return {each.key: each for each in terms(choice)}


# A kink that one reading alone shows, and rates that err.


def kink(K=0.015, low=-1.71, high=1.92, at=120.0, off=0.031):
    """A line in three curves, clipped; the one reading between the last sound rate, 100 °/s, and the clip is off."""
    rng = np.random.default_rng(5)
    rate = np.concatenate([np.linspace(-m, m, 11) for m in (75, 150, 250)])
    output = np.clip(K * rate, low, high) + 1e-4 * rng.normal(size=33) + off * (rate == at)
    return points_of("s", "V", rate, output, np.repeat(["75", "150", "250"], 11).tolist())


def test_one_reading_makes_no_kink_and_no_nonlinearity():
    choice = choose(kink())
    assert choice.fit.hypothesis.name == "line, clipped below and above, one reading off"
    assert "the reading at 120 °/s is off, or there is a kink from 100 °/s on, which no reading determines" in " ".join(lines(choice))
    found = rows_of(choice)
    assert found["nonlinearity"].value is None
    assert found["nonlinearity"].at_most < 300
    assert "within −114 to 100 °/s" in found["nonlinearity"].condition
    assert found["linear_low"].value == pytest.approx(-114.0, abs=0.05)


def test_no_range_ends_beyond_the_last_reading_that_is_sound():
    """A kink at 105 °/s that the reading at 120 °/s alone shows: the output meets its limit at 125.18 °/s, and not at 128."""
    rate = np.concatenate([np.linspace(-m, m, 11) for m in (75, 150, 250)])
    output = np.clip(0.015 * rate + 0.0021 * np.maximum(rate - 105, 0), -1.71, 1.92) + 1e-4 * np.random.default_rng(3).normal(size=33)
    kinked = points_of("s", "V", rate, output, np.repeat(["75", "150", "250"], 11).tolist())
    for points in (kinked, kink()):
        found = rows_of(choose(points))
        assert found["linear_high"].value is found["linear_high"].sigma is found["linear_high"].at_most is None
        assert found["linear_high"].condition == "not determined, 100 to 150 °/s: the reading at 120 °/s is off"
        assert "reached at" not in found["saturation_high"].condition
        assert "reached at −114 °/s" in found["saturation_low"].condition


def test_what_one_reading_that_is_off_leaves_open():
    """The last sound rate before it and the first limited one beyond; nothing with a sound one beside or beyond."""
    rate = np.array([-80.0, -60, -40, -20, 0, 20, 40, 60, 80, 100, 60])

    def open_at(row, upper, count=11, sense=1.0):
        output = np.minimum(SCALE * rate, 1.5) if upper else SCALE * rate
        points = points_of("s", "V", sense * rate[:count], output[:count] + 0.3 * (np.arange(count) == row), ["one"] * count)
        return left_open(fit(points, Hypothesis("line", upper=upper, apart=row)))

    assert open_at(7, True, 10) == (60.0, 40.0, 80.0)
    assert open_at(7, True, 10, -1.0) == (-60.0, -40.0, -80.0)
    assert open_at(7, True) is None  # read again
    assert open_at(7, False, 10) is None  # 80 and 100 °/s are sound
    assert open_at(9, False, 10) == (100.0, 80.0, None)
    assert open_at(4, False, 10) is None  # at rest
    one_sense = measured(lambda w: SCALE * w + 0.5 * (w == 240), UP[UP >= 0])
    within = linear_range(fit(one_sense, Hypothesis("line", apart=12)))
    assert (within.low, within.high, within.ends) == (0.0, 220.0, (False, False))


def test_no_departure_over_all_rates_where_a_reading_leaves_an_end_open():
    points = measured(lambda w: SCALE * w * (1 - np.abs(w) / 9000), UP)
    assert "nonlinearity_tested" in rows_of(given(points, Hypothesis("quadratic")))
    points.output[-1] += 0.5
    assert "nonlinearity_tested" not in rows_of(given(points, Hypothesis("quadratic", apart=24)))


def test_a_limit_at_a_reading_is_named_where_none_beyond_reads_more():
    rate = np.arange(-100.0, 101.0, 20.0)
    points = points_of("s", "V", rate, SCALE * rate - 0.5 * (rate == 100), ["one"] * 11)
    said = " ".join(lines(given(points, Hypothesis("line", apart=10))))
    assert "the reading at 100 °/s is off, or the output has a limit there or a kink from 80.0 °/s on, which no reading" in said
    found = rows_of(given(points, Hypothesis("line", apart=10)))["linear_high"]
    assert found.condition == "not determined, beyond 80.0 °/s: the reading at 100 °/s is off"


def test_a_range_is_reached_where_most_draws_reach_it():
    """Near the last rate tested: an end has a number and a sigma, or is that of the rates; no case between."""
    for bend in (0.70, 0.72, 0.74):
        points = measured(lambda w, bend=bend: SCALE * 700 / bend * np.arcsinh(w * bend / 700), noise=1e-3, seed=int(100 * bend))
        curve = fit_curve(points, Hypothesis(CURVE))
        within = linear_range(curve)
        for end, at, reached in zip((-240.0, 240.0), (within.low, within.high), within.ends, strict=True):
            found = [_end(each, end) for each in curve.draws]
            assert reached == (sum(is_reached for _, is_reached in found) > len(found) / 2)
            assert at == (pytest.approx(np.median([each for each, _ in found])) if reached else end)
        rows = rows_of(given(points, Hypothesis(CURVE)))
        for key, end in (("linear_low", -240.0), ("linear_high", 240.0)):
            assert rows[key].value == end if rows[key].sigma is None else abs(rows[key].value) < 240


@pytest.mark.parametrize(("bent", "high"), [(2, 240.0), (3, 100.0)])
def test_an_end_is_the_median_of_the_draws_where_more_than_half_reach_it(bent, high):
    """A cubic departs by 1 % at 0.1 over the root of its share: of five draws at 100 °/s, or beyond the rates."""
    points = measured(lambda w: SCALE * w, UP)
    law, curve = fit(points, Hypothesis("cubic")), fit_curve(points, Hypothesis(CURVE))
    shares = np.where(np.arange(5) < bent, 1e-6, 1e-8)
    vars(curve)["draws"] = [law.moved(np.array([0.0, SCALE, -SCALE * share])) for share in shares]
    within = linear_range(curve)
    assert (within.low, within.high) == (pytest.approx(-high, rel=1e-4), pytest.approx(high, rel=1e-4))
    assert within.ends == (bent == 3, bent == 3)


def test_a_number_that_leaves_as_little_elsewhere_is_said_so():
    said = " ".join(lines(given(kink(), Hypothesis("pieces", True, True))))
    assert re.search(r"w1 not determined; (99|100|10[0-3])\S* to 1[12]\d\S* °/s fit as well", said)


def test_a_line_has_one_sigma():
    """Rivals of a line that nothing refutes are in neither of its two places."""
    choice = choose(measured(lambda w: SCALE * w, seed=4))
    rival = fit(choice.points, Hypothesis("quadratic"))
    found = rows_of(replace(choice, rivals=((rival, 0.4),)))["scale"]
    K = next(each for each in choice.fit.numbers if each.name == "K")
    assert (found.value, found.sigma) == (pytest.approx(K.value), pytest.approx(K.sigma, rel=1e-6))


def test_a_kink_that_one_reading_shows_has_no_place():
    found = fit(kink(), Hypothesis("pieces", True, True))
    by_name = {each.name: each for each in found.numbers}
    for name in ("w1", "h"):
        assert by_name[name].value is by_name[name].sigma is None
    assert by_name["w1"].between == (pytest.approx(100, abs=3), pytest.approx(120, abs=3))
    assert by_name["K"].sigma == pytest.approx(4.5e-7, rel=0.4)
    rows = rows_of(given(kink(), Hypothesis("pieces", True, True)))
    assert rows["linear_high"].value is rows["nonlinearity"].value is None
    assert "not determined" in rows["linear_high"].condition
    assert rows["saturation_high"].sigma > 0


def scattered(rate_error, follows, seed=1):
    """A line of 1.006 on a table whose rates are written with an error, or scatter in truth."""
    rng = np.random.default_rng(seed)
    set_to = np.array([-40] * 8 + [40] * 8 + [-25] * 2 + [25] * 2 + [-15] * 2 + [15] * 2 + [-5] * 2 + [5] * 2 + [0] * 6, dtype=float)
    written = set_to + rate_error * rng.normal(size=34) * (set_to != 0)
    output = 1.006 * (written if follows else set_to) + 0.41 + 3e-3 * rng.normal(size=34)
    return points_of("s", "°/s", written, output, ["one"] * 34)


def test_rates_that_the_output_does_not_follow_are_one_setting():
    points = scattered(0.1, follows=False)
    settled, said = settings_of(points)
    assert len(settled) == 9
    assert "9 settings" in said[0]
    own = np.concatenate([points.output[:8] - points.output[:8].mean()])
    assert np.std(own) < 0.01
    # sigma of a mean of eight: that of the output, and of the rate times the scale
    groups = [slice(0, 8), slice(8, 16), *(slice(16 + 2 * k, 18 + 2 * k) for k in range(6)), slice(28, 34)]
    within = [points.rate_dps[g] - points.rate_dps[g].mean() for g in groups]
    error = np.sqrt(sum(np.sum(w**2) for w in within) / 20)
    noise = np.sqrt(sum(np.sum((points.output[g] - points.output[g].mean()) ** 2) for g in groups) / 25)
    assert settled.sigma[0] == pytest.approx(np.sqrt((noise**2 + (1.006 * error) ** 2) / 8), rel=2e-3)
    assert settled.sigma[-1] == pytest.approx(noise / np.sqrt(6))
    line = fit(settled, LINE)
    assert line.coefficients[0] == pytest.approx(1.006, abs=3 * np.sqrt(line.covariance[1, 1]))


@pytest.mark.parametrize("seed", range(3))
def test_a_setting_that_was_read_once_errs_as_much(seed):
    rng = np.random.default_rng(seed)
    set_to = np.array([-40] * 8 + [40] * 8 + [-25] * 2 + [25] * 2 + [0] * 6 + [-100, 100, -80, 80], dtype=float)
    written = set_to + 0.3 * rng.normal(size=30) * (set_to != 0)
    points = points_of("s", "°/s", written, 1.006 * set_to + 0.41 + 3e-3 * rng.normal(size=30), ["one"] * 30)
    settled, _ = settings_of(points)
    assert len(settled) == 9
    groups = [slice(0, 8), slice(8, 16), slice(16, 18), slice(18, 20), slice(20, 26)]
    within = np.concatenate([written[g] - written[g].mean() for g in groups])
    own = np.concatenate([points.output[g] - points.output[g].mean() for g in groups])
    scale = np.polyfit(settled.rate_dps, settled.output, 1)[0]
    once = np.sqrt(np.sum(own**2) / 21 + scale**2 * np.sum(within**2) / 16)  # of 26 readings in 5 settings, 20 in 4 that turn
    assert settled.sigma[5:] == pytest.approx(np.full(4, once))
    assert settled.sigma[4] == pytest.approx(np.sqrt(np.sum(own**2) / 21 / 6))  # at rest the rate is exact
    assert choose(settled).is_line


def test_one_reading_at_rest_has_no_error_of_the_rate():
    points = scattered(0.1, follows=False)
    settled, _ = settings_of(points.part(np.arange(34) < 29))
    groups = [slice(0, 8), slice(8, 16), *(slice(16 + 2 * k, 18 + 2 * k) for k in range(6))]
    own = np.concatenate([points.output[g] - points.output[g].mean() for g in groups])
    assert settled.sigma[-1] == pytest.approx(np.sqrt(np.sum(own**2) / 20))


def test_rates_that_the_output_follows_stay_as_they_are():
    points = scattered(0.1, follows=True)
    assert settings_of(points) == (points, [])
    plain = measured(lambda w: SCALE * w)
    assert settings_of(plain) == (plain, [])


# The smooth curve.


def test_the_covariance_of_the_curve_is_that_of_white_noise_integrated():
    """f(u) is the integral of (u - s)^2 / 2 dW(s): of variance 1 / 20 at 1."""
    for u, v in ((0.3, 0.3), (0.2, 0.9), (1.0, 0.5)):
        exact = quad(lambda s, u=u, v=v: (u - s) ** 2 * (v - s) ** 2 / 4, 0, min(u, v))[0] * 20
        assert curves._covariance(np.array([u]), np.array([v]))[0, 0] == pytest.approx(exact)


def test_the_evidence_of_a_shape_is_the_restricted_likelihood(monkeypatch):
    """Of y with covariance s^2 (I + ratio F F'), the fixed columns taken out, and s integrated out."""
    points = measured(lambda w: SCALE * w * (1 - np.abs(w) / 9000))
    shape = Shape(1.0, True, 240.0)
    none = np.zeros(50, dtype=bool)
    found = list(curves._of_shape(points, Hypothesis(CURVE), shape, none, none, curves.RATIOS))
    columns = shape.columns(points.rate_dps)
    fixed = np.column_stack([np.ones(50), points.rate_dps, columns[:, 0]])
    free = np.linalg.svd(fixed, full_matrices=True)[0][:, 3:]

    def exact(ratio, sigma):
        C = np.eye(50) + ratio * columns[:, 1:] @ columns[:, 1:].T
        return -2 * multivariate_normal(cov=sigma**2 * free.T @ C @ free).logpdf(free.T @ points.output)

    for k in (3, 6):  # ratios of 10 and 10^4
        ratio, curve = found[k][1].ratio, found[k][1]
        # at the best s, n - 3 degrees of freedom: -2 log L = (n - 3) (ln(2 pi s^2) + 1) + log determinant
        s2 = curve.chi_square / 47
        assert exact(ratio, np.sqrt(s2)) == pytest.approx(47 * (np.log(2 * np.pi * s2) + 1) + curve.penalty, rel=1e-9)
        assert found[k][0] == pytest.approx(47 * np.log(curve.chi_square / 2) + curve.penalty)


def test_the_curve_is_the_mean_of_its_posterior_and_has_its_covariance():
    points = measured(lambda w: SCALE * 700 * np.arcsinh(w / 700))
    curve = next(
        each
        for _, each in curves._of_shape(points, Hypothesis(CURVE), Shape(1.4, False, 240.0), *np.zeros((2, 50), bool), curves.RATIOS)
        if each.ratio == 1e4
    )
    columns = np.column_stack([np.ones(50), points.rate_dps, curve.of.columns(points.rate_dps)])
    prior = np.concatenate([np.zeros(4), np.full(columns.shape[1] - 4, 1e-4)])
    information = columns.T @ columns + np.diag(prior)
    assert curve.predicted == pytest.approx(columns @ np.linalg.solve(information, columns.T @ points.output), abs=1e-6)
    slope = np.zeros(len(curve.vector))
    slope[1] = 1.0
    assert curve.solution.variance(slope) == pytest.approx(np.linalg.inv(information)[1, 1], rel=1e-5)


def test_draws_have_the_spread_of_the_curve():
    points = measured(lambda w: SCALE * w * (1 - np.abs(w) / 9000))
    best = fit_curve(points, Hypothesis(CURVE))
    alone = replace(best, shapes=((1.0, best),))
    K = np.array([each.coefficients[0] for each in alone.draws])
    assert len(K) == curves.DRAWS
    assert K.mean() == pytest.approx(best.coefficients[0], abs=4 * K.std() / np.sqrt(len(K)))
    assert K.std() == pytest.approx(np.sqrt(best.covariance[1, 1]), rel=0.15)
    value, sigma = derived(alone, lambda have: have.coefficients[0])
    low, high = np.percentile(K, [16, 84])
    assert (value, sigma) == (pytest.approx(np.median(K)), pytest.approx((high - low) / 2))


BENT = {
    "odd square": (lambda w: SCALE * w * (1 - np.abs(w) / 9000), 90.0),
    "asinh": (lambda w: SCALE * 700 * np.arcsinh(w / 700), 173.0),
    "square root": (lambda w: SCALE * w * (1 - 0.03 * np.sqrt(np.abs(w) / 240)), 26.7),
}


@pytest.mark.parametrize("name", ["square root", *map(broad, ("odd square", "asinh"))])
def test_a_range_is_of_the_curve_whatever_the_law_is_called(name):
    of, end = BENT[name]
    points = measured(of, seed=3, sigma=np.full(50, NOISE))
    rows = rows_of(given(points, Hypothesis("sine")))
    for row in (rows["linear_high"], rows["linear_low"]):
        assert abs(row.value) == pytest.approx(end, abs=2.5 * row.sigma)
        assert row.sigma < 0.5 * abs(row.value)
    low, high = rows["linear_low"].value, rows["linear_high"].value
    grid = np.linspace(low, high, 2001)
    bent = np.abs(of(grid) - np.polyval(np.polyfit(grid, of(grid), 1), grid)).max() / (SCALE * max(-low, high))
    assert rows["nonlinearity"].value == pytest.approx(1e6 * bent, abs=2.5 * rows["nonlinearity"].sigma)


def test_a_range_that_ends_before_the_smallest_rate_is_not_determined():
    points = measured(lambda w: SCALE * w * (1 - 0.05 * np.log1p(np.abs(w) / 20)), sigma=np.full(50, NOISE))
    rows = rows_of(given(points, Hypothesis(CURVE)))
    for key in ("linear_low", "linear_high", "nonlinearity"):
        assert rows[key].value is rows[key].at_most is None
        assert "not determined" in rows[key].condition
    assert "before 20.0 °/s, the smallest rate" in rows["linear_high"].condition
    assert "within −20.0 to 20.0 °/s" in rows["scale"].condition


def test_what_no_law_describes_is_called_a_curve_of_none():
    choice = choose(measured(BENT["odd square"][0], sigma=np.full(50, NOISE)))
    assert isinstance(choice.fit, Curve)
    assert f"of {len(LAWS)} laws and a curve of none no other" in " ".join(lines(choice))
    unit = np.sqrt(choice.line.chi_square / 50)
    best = min((each for each, _ in choice.fits if not isinstance(each, Curve)), key=lambda each: score(each, unit))
    assert score(choice.fit, unit) < score(best, unit) - 6


# What is quoted of a range is of the readings within it.


def test_the_asymmetry_of_a_range_is_that_of_its_readings():
    """Two slopes that differ by 10 % beyond 60 °/s, and by 0.4 % within."""
    rate = np.concatenate([np.arange(-200.0, 201.0, 10.0)] * 2)
    of = lambda w: SCALE * (w + 2e-3 * np.abs(w) + 0.05 * np.maximum(np.abs(w) - 60, 0))  # noqa: E731
    points = measured(of, rate, noise=2e-4)
    choice = given(points, Hypothesis("line", extras=("asymmetry",)))
    within = Range(-60.0, 60.0, (True, True))
    inside = _inside(choice, within)
    row = _asymmetry(choice, within, inside, "")
    own = np.abs(rate) <= 60
    columns = np.column_stack([np.ones(own.sum()), rate[own], np.abs(rate[own])])
    by_hand, (left,) = np.linalg.lstsq(columns, points.output[own], rcond=None)[:2]
    assert row.value == pytest.approx(2e6 * by_hand[2] / choice.fit.coefficients[0], rel=1e-6)
    assert row.value == pytest.approx(4e3, abs=3 * row.sigma)
    sigma = np.sqrt(np.linalg.inv(columns.T @ columns)[2, 2] * left / (own.sum() - 3))
    assert row.sigma == pytest.approx(2e6 * sigma / choice.fit.coefficients[0], rel=1e-3)
    whole = choice.fit.vector[choice.fit.names.index("a")]
    assert 2e6 * whole / choice.fit.coefficients[0] > 3e4  # of all rates


def test_an_even_shape_is_an_asymmetry_and_no_noise():
    """Of a parabola K w + q w^2 the line beside |w| over +-E has the coefficient q E: the regression of w^2 on w, from rest to E."""
    points = measured(lambda w: SCALE * w + 2e-6 * w**2, noise=1e-3, seed=5)
    choice = choose(points)
    assert choice.fit.hypothesis.name == "quadratic"
    found = rows_of(choice)
    row, end = found["asymmetry"], min(-found["linear_low"].value, found["linear_high"].value)
    assert row.value == pytest.approx(2e6 * 2e-6 * end / SCALE, abs=2.5 * row.sigma)
    assert row.sigma < 0.1 * row.value
    line = rows_of(choose(measured(lambda w: SCALE * w, noise=1e-3, seed=5)))["hysteresis"]
    assert found["hysteresis"].at_most < 2 * line.at_most


@pytest.mark.parametrize(("law", "columns"), [("asymmetry", lambda w: [w, np.abs(w)]), ("tanh", lambda w: [w, w**2, w**3])])
def test_a_probe_stands_beside_the_shape_of_the_law(law, columns):
    points = measured(lambda w: SCALE * (400 * np.tanh(w / 400) if law == "tanh" else w + 0.01 * np.abs(w)))
    choice = given(points, Hypothesis(law))
    within = Range(-160.0, 160.0, (True, True))
    inside = _inside(choice, within)
    A = np.column_stack([np.ones(len(inside)), *columns(inside.rate_dps), inside.direction / 2])
    by_hand, (left,) = np.linalg.lstsq(A, inside.output, rcond=None)[:2]
    value, sigma = _probe(choice, inside, "hysteresis")
    assert value == pytest.approx(by_hand[-1], rel=1e-6)
    assert sigma >= 0.999 * np.sqrt(np.linalg.inv(A.T @ A)[-1, -1] * left / (len(A) - A.shape[1]))
    assert sigma < 2 * NOISE / np.sqrt(len(A)) * 2


def test_the_asymmetry_of_two_pieces_is_that_of_the_law():
    """Of its even part, h max(|w| - 90, 0) / 2, the slope over 0 to E is 12 / E^3 of the integral of (w - E / 2) times it."""
    found = rows_of(given(measured(lambda w: SCALE * w + 2e-3 * np.maximum(w - 90, 0), noise=1e-4), Hypothesis("pieces")))
    row, end = found["asymmetry"], found["linear_high"].value
    assert end == pytest.approx(100.0, abs=0.5)
    slope = 6 / end**3 * 2e-3 * quad(lambda w: (w - end / 2) * (w - 90), 90, end)[0]
    assert row.value == pytest.approx(2e6 * slope / SCALE, abs=max(3 * row.sigma, 30.0))
    assert row.sigma < 0.2 * row.value


def test_the_asymmetry_of_a_bend_is_of_the_rates_of_both_senses():
    """A bend of one sense, whose range goes to −240 and 80 °/s: of the readings within ±80 °/s alone, by hand."""
    points = measured(lambda w: SCALE * w * (1 - (w > 0) * w / 9000))
    choice, within = given(points, Hypothesis("polynomial")), Range(-240.0, 80.0, (False, True))
    w = BOTH_WAYS[np.abs(BOTH_WAYS) <= 80]
    A = np.column_stack([np.ones(len(w)), w, w**2, w**3, np.abs(w)])
    by_hand = np.linalg.lstsq(A, points.output[np.abs(BOTH_WAYS) <= 80], rcond=None)[0]
    # over 0 to E the line beside w^2 has the slope E
    assert _probe(choice, _inside(choice, within), "asymmetry", within)[0] == pytest.approx(by_hand[4] + 80 * by_hand[2], rel=2e-3)


def test_a_line_that_nothing_refutes_has_a_limit_of_asymmetry():
    row = rows_of(choose(measured(lambda w: SCALE * w, seed=4)))["asymmetry"]
    assert row.value is None
    assert row.at_most > 0


def test_the_noise_is_that_of_the_readings_at_no_limit():
    points = measured(lambda w: np.clip(SCALE * w, -2.9, 2.95))
    points.output[np.abs(BOTH_WAYS) > 160] += 0.05 * np.random.default_rng(7).normal(size=int(np.sum(np.abs(BOTH_WAYS) > 160)))
    found = fit(points, Hypothesis("line", True, True))
    free, limited = ~found.is_limited, found.is_limited
    assert found.noise == pytest.approx(np.sqrt(np.sum(found.residuals[free] ** 2) / (free.sum() - 2)))
    assert found.noise < 2 * NOISE
    spread = np.sqrt(np.sum(found.residuals[limited] ** 2) / (limited.sum() - 2))
    upper = found.at_limits[1].sum()
    lack = found.lack_of_fit
    assert np.sqrt(found.covariance[-1, -1]) == pytest.approx(spread / np.sqrt(upper) * np.sqrt(lack.variance_inflation), rel=1e-3)
    # What does not show of a bend is that of these readings alone.
    clipped, alone = given(points, found.hypothesis), given(points.part(free), LINE)
    everywhere = Range(-240.0, 240.0, (False, False))
    probed, expected = (_probe(choice, _inside(choice, everywhere), "bend") for choice in (clipped, alone))
    assert probed == pytest.approx(expected)


def test_repeats_have_a_row_of_their_own():
    found = rows_of(given(measured(lambda w: SCALE * w), LINE))["repeats"]
    output = measured(lambda w: SCALE * w).output
    pairs = (output[:25] - output[25:][::-1]) / np.sqrt(2)
    assert found.value == pytest.approx(np.sqrt(np.mean(pairs**2)), rel=1e-6)
    assert found.sigma == pytest.approx(found.value / np.sqrt(50))
