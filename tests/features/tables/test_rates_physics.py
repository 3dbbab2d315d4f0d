"""Laws of a rate table by themselves: columns, fits, evidence, the curve of no law, and the terms of IEEE 1431, exactly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import gammaln, j1
from scipy.stats import f as f_distribution
from scipy.stats import multivariate_normal

from tinygc.features.tables.rates import curve as curves
from tinygc.features.tables.rates.choice import _EXTRA_GAIN, LINE, Choice, chance, choose, score
from tinygc.features.tables.rates.curve import Curve, Shape, fit_curve
from tinygc.features.tables.rates.fitting import fit, linear, over_rate
from tinygc.features.tables.rates.laws import CURVE, EXTRAS, LAWS, LIMITS, Hypothesis
from tinygc.features.tables.rates.library import lines
from tinygc.features.tables.rates.points import points_of
from tinygc.features.tables.rates.terms import (
    Range,
    _asymmetry,
    _crossing,
    _input_limit,
    _inside,
    _linear_range,
    _probe,
    derived,
    left_open,
    terms,
)

UP = np.linspace(-300.0, 300.0, 21)


BOTH_WAYS = np.concatenate([UP, UP[-2::-1]])


SCALE, REST, NOISE = 0.02, 0.15, 1e-3


def measured(of, rate=BOTH_WAYS, noise=NOISE, seed=1, **more):
    rng = np.random.default_rng(seed)
    return points_of("sensor", "V", rate, REST + of(rate) + noise * rng.normal(size=len(rate)), ["one"] * len(rate), **more)


def straight(w):
    return SCALE * w


def clipped(w):
    return np.clip(straight(w), -4.1, 4.3)


def given(points, hypothesis, rivals=()):
    """The choice of a law that is known."""
    found = fit_curve(points, hypothesis) if hypothesis.law == CURVE else fit(points, hypothesis)
    return Choice(points, found, fit(points, LINE), 0.0, rivals, 1.0 - sum(share for _, share in rivals), ())


def rows_of(choice):
    return {each.key: each for each in terms(choice)}


def row(choice, key):
    return rows_of(choice)[key]


# Columns and fits.


SINE, COSINE = np.sin(1.25), np.cos(1.25)  # 50 °/s over 40 °/s


@pytest.mark.parametrize(
    ("law", "shape", "at_50"),
    [
        ("line", (), 50),
        ("tanh", (40,), 1 - 2 / (1 + np.exp(2.5))),
        ("arctan", (40,), np.arctan2(5, 4)),
        ("root", (40,), 2000 / np.hypot(40, 50)),
        ("sine", (40,), SINE),
        ("normalised_sine", (40, 0.5), SINE / (1 + COSINE / 2)),
        ("overloaded_sine", (40, 0.5, 2), SINE / (1 + 4 * SINE**2)),
        ("dead_band", (40,), 10),
    ],
)
def test_the_column_of_a_law_of_both_senses_alike(law, shape, at_50):
    assert LAWS[law].columns(np.array([-50.0, 50.0]), shape).ravel() == pytest.approx([-at_50, at_50], rel=1e-12)


@pytest.mark.parametrize(
    ("law", "shape", "expected"),
    [
        ("asymmetry", (), [[-50, 50], [50, 50]]),
        ("quadratic", (), [[-50, 2500], [50, 2500]]),
        ("cubic", (), [[-50, -125e3], [50, 125e3]]),
        ("polynomial", (), [[-50, 2500, -125e3], [50, 2500, 125e3]]),
        ("sine_of_any_phase", (40,), [[-SINE, COSINE - 1], [SINE, COSINE - 1]]),
        ("pieces", (-20,), [[-50, 0], [50, 70]]),
    ],
)
def test_columns_of_a_law(law, shape, expected):
    assert LAWS[law].columns(np.array([-50.0, 50.0]), shape) == pytest.approx(np.array(expected, dtype=float), rel=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_a_coefficients_unit_has_the_power_of_its_column(law):
    """Rates, and shapes that are rates, twice as large: a column of the power n is 2^n times as large."""
    of, rate = LAWS[law], np.array([-70.0, -20, 10, 50])
    shape, twice = (
        tuple(each * (factor if p.is_rate else 1) for each, p in zip((40.0, 0.6, 4.0), of.shapes, strict=False)) for factor in (1, 2)
    )
    powers = np.array([each.power for each in of.coefficients])
    assert of.columns(2 * rate, twice) == pytest.approx(2.0**powers * of.columns(rate, shape), rel=1e-9, abs=1e-12)


def test_columns_of_extras_and_their_units():
    rate = np.array([-20.0, 0, 20, 10, -10])
    points = points_of("s", "mV", rate, rate, ["one"] * 5)
    of = Hypothesis("line", False, True, ("asymmetry", "hysteresis", "drift", "turning", "bend", "sense"), apart=3)
    expected = [rate, np.abs(rate), points.direction / 2, points.order, rate != 0, rate**3, np.sign(rate), np.arange(5) == 3]
    assert pytest.approx(np.array(expected, dtype=float)) == of.columns(rate, (), points).T
    assert not of.columns(rate, ())[:, [2, 3, 7]].any()  # of rates that are no points neither sense nor order is known
    assert (len(of.coefficients), len(Hypothesis("line", apart=0).coefficients)) == (8, 2)
    assert fit(points.part(np.arange(5) < 5), Hypothesis("line", apart=0)).units == ("mV", "mV/(°/s)", "mV")
    assert of.name == "line, clipped above, asymmetry, hysteresis, drift, turning, bend, sense, one reading off"
    every = Hypothesis("line", extras=tuple(EXTRAS))
    powers = np.array([1, *(extra.power for extra in EXTRAS.values())])
    twice = replace(points, rate_dps=2 * rate)
    assert every.columns(2 * rate, (), twice) == pytest.approx(2.0**powers * every.columns(rate, (), points))
    found = fit(measured(lambda w: np.minimum(SCALE * w + 1e-4 * np.abs(w), 4), noise=0.0), Hypothesis("polynomial", upper=True))
    assert found.names == ("V0", "K", "q", "c", "V+")
    assert found.units == ("V", "V/(°/s)", "V/(°/s)²", "V/(°/s)³", "V")
    assert [over_rate("°/s", power) for power in range(4)] == ["°/s", "1", "1/(°/s)", "1/(°/s)²"]


@pytest.mark.parametrize(
    ("hypothesis", "reported"),
    [
        (LINE, "V = V0 + K w"),
        (Hypothesis("normalised_sine", lower=True), "V = clip(V0 + A sin x / (1 + j cos x), V−, ∞); x = w / w0"),
        (Hypothesis("line", False, True, ("hysteresis",), 2), "V = clip(V0 + K w + h direction / 2 + r [one reading], −∞, V+)"),
    ],
)
def test_the_equation_of_a_hypothesis(hypothesis, reported):
    assert hypothesis.equation == reported


def test_the_first_harmonic_of_a_demodulator_is_the_bessel_function():
    rate, depth = np.array([0.0, 10.0, 100.0, 200.0]), 1.8
    columns = LAWS["demodulator"].columns(rate, (150.0, depth, 1e9))[:, 0]
    x = rate / 150.0
    t = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    signal = np.cos(x[:, None] + depth * np.cos(t))
    rms = (signal - signal.mean(axis=1, keepdims=True)).std(axis=1)
    assert columns == pytest.approx(2 * j1(depth) * np.sin(x) / rms, abs=1e-9)


def test_a_clip_is_where_the_line_meets_the_limit():
    found = fit(measured(clipped, noise=0.0), Hypothesis("line", True, True))
    assert found.limits == (pytest.approx(REST - 4.1), pytest.approx(REST + 4.3))
    assert _input_limit(found, 300.0) == pytest.approx(4.3 / SCALE, rel=1e-9)
    assert _input_limit(found, -300.0) == pytest.approx(-4.1 / SCALE, rel=1e-9)
    np.testing.assert_array_equal(found.is_limited, clipped(BOTH_WAYS) != straight(BOTH_WAYS))


@pytest.mark.parametrize(
    ("law", "shape", "coefficients"),
    [
        ("tanh", (400,), [8]),
        ("dead_band", (40,), [SCALE]),
        ("pieces", (130,), [SCALE, -0.1 * SCALE]),
        ("normalised_sine", (200, 0.3), [5]),
        ("overloaded_sine", (190, 1.05, 8), [5]),
    ],
)
def test_shape_parameters_are_recovered_without_noise(law, shape, coefficients):
    points = measured(lambda w: LAWS[law].columns(w, shape) @ coefficients, noise=0.0)
    assert fit(points, Hypothesis(law)).shape == pytest.approx(shape, rel=2e-3)


@pytest.mark.parametrize("scatter", [0.02, 1e-5])
def test_noise_is_that_of_points_at_no_limit_and_a_limits_sigma_that_of_those_at_it(scatter):
    rate, at = np.arange(-100.0, 101.0, 10.0), np.arange(21) >= 15
    rng = np.random.default_rng(3)
    output = np.where(at, 0.9 + scatter * rng.normal(size=21), 0.02 * rate + 1e-3 * rng.normal(size=21))
    for sigma, stated in ((None, 0.0), (np.full(21, 2e-3), 20.0)):
        found = fit(points_of("s", "V", rate, output, ["one"] * 21, sigma), Hypothesis("line", upper=True))
        assert found.is_limited.tolist() == at.tolist()
        unit = 1.0 if sigma is None else 2e-3
        left = output - np.where(at, output[at].mean(), np.polyval(np.polyfit(rate[~at], output[~at], 1), rate))
        noise = np.sqrt((np.sum((left[~at] / unit) ** 2) + stated) / (15 - 2 + stated))
        assert found.noise == pytest.approx(noise, rel=1e-6)
        assert found.freedom == 21 - 3 + stated
        design = np.column_stack([np.ones(15), rate[~at]])
        line = np.diag(np.linalg.inv(design.T @ design)) * (noise * unit) ** 2
        limit = max(np.var(output[at], ddof=1), (noise * unit) ** 2) / 6  # no less than the noise
        assert np.diag(found.covariance) == pytest.approx([*line, limit], rel=1e-5)


@pytest.mark.parametrize(("repeats", "tests"), [(2, False), (3, True)])
def test_a_law_is_held_against_three_repeats_or_more(repeats, tests):
    """F of what the means of a rate leave beside the line, over what repeats scatter."""
    rate = np.r_[-50.0, -30, -10, 10, 30, 50, [-50.0, 10, 50][:repeats]]
    points = measured(lambda w: SCALE * w + 1e-6 * w**2, rate)
    lack = fit(points, LINE).lack_of_fit
    assert (lack is not None) == tests
    if lack is not None:
        pairs = points.output[[0, 3, 5]] - points.output[6:]
        pure = np.sum(pairs**2 / 2)
        left = np.polyfit(rate, points.output, 1, full=True)[1][0]
        f = (left - pure) / 4 / (pure / 3)
        assert (lack.noise, lack.freedom) == (pytest.approx(np.sqrt(pure / 3)), 3)
        assert lack.p_value == pytest.approx(f_distribution.sf(f, 4, 3))


def test_the_slopes_of_numbers_that_are_zero():
    found = fit(measured(straight), Hypothesis("cubic")).moved(np.zeros(3))
    assert found.jacobian == pytest.approx(np.column_stack([np.ones(41), BOTH_WAYS, BOTH_WAYS**3]), rel=1e-6, abs=1e-6)


def test_the_least_that_residuals_count():
    """Rounding to the last digit, of rms step / sqrt(12), or a ten-millionth of the span; over the sigmas that are stated."""
    rate = np.arange(5.0)
    for output, least in ((0.01 * rate, 0.01 / np.sqrt(12)), (rate / 3, 4 / 3 * 1e-7)):
        assert points_of("s", "V", rate, output, ["one"] * 5).floor == pytest.approx(5 * least**2)
        assert points_of("s", "V", rate, output, ["one"] * 5, np.full(5, 0.1)).floor == pytest.approx(5 * (least / 0.1) ** 2)


@pytest.mark.parametrize(
    ("law", "count", "distinct"),
    [("line", 4, 3), ("cubic", 5, 4), ("polynomial", 6, 5), ("dead_band", 5, 4)],
)
def test_points_and_rates_that_a_law_needs(law, count, distinct):
    """Two more than it has numbers; and as many rates, without the offset of its curve."""

    def is_fitted(rates):
        more = np.append(rates, [-1, -2, -3, -4])  # which no table has less than
        points = points_of("s", "V", more, more + 0.01 * np.sin(np.arange(len(more))), ["one"] * len(more))
        return fit(points.part(np.arange(len(more)) < len(rates)), Hypothesis(law)) is not None

    rates = np.linspace(-50, 50, count)
    assert is_fitted(rates)
    assert not is_fitted(rates[:-1])
    assert is_fitted(np.append(rates[:distinct], [rates[0]] * (count - distinct)))
    assert not is_fitted(np.append(rates[: distinct - 1], [rates[0]] * (count - distinct + 1)))


def test_a_clip_needs_rates_within_its_limits():
    """Three at least: of fewer neither a scale nor its sigma can be stated."""
    up = np.arange(-400.0, 401.0, 100.0)  # °/s
    for low, is_fitted in ((-1.5, False), (-2.9, True)):
        points = measured(lambda w, low=low: np.clip(straight(w), low, 2.9), np.concatenate([up, up[-2::-1]]))
        assert (fit(points, Hypothesis("line", True, True)) is not None) == is_fitted


def test_repeats_refute_a_law_and_widen_its_sigmas():
    rate = np.repeat(np.linspace(-300, 300, 11), 3)
    bent = measured(lambda w: 5 * np.sin(w / 250) + 0.01 * np.sin(w / 20), rate)
    found = fit(bent, Hypothesis("sine"))
    lack = found.lack_of_fit
    assert lack.p_value < 1e-6
    means = np.array([found.residuals[3 * n : 3 * n + 3].mean() for n in range(11)])
    scatter = 3 * np.sum(means**2) / (11 - 3)  # of the means about the law, as variance of one reading
    assert lack.variance_inflation == pytest.approx(scatter / found.noise**2, rel=1e-3)
    size = np.linalg.norm(found.jacobian, axis=0)
    inverse = np.linalg.inv((found.jacobian / size).T @ (found.jacobian / size)) / np.outer(size, size)
    assert found.covariance[1, 1] == pytest.approx(inverse[1, 1] * scatter, rel=1e-3)
    assert "repeats scatter by" in " ".join(lines(given(bent, Hypothesis("sine"))))


# Which law.


def test_hysteresis_is_found_where_the_rates_go_both_ways():
    points = measured(straight)
    choice = choose(replace(points, output=points.output + 5e-3 * points.direction / 2))
    assert choice.fit.hypothesis.name == "line, hysteresis"
    found = row(choice, "hysteresis")
    assert found.value == pytest.approx(5e-3 / SCALE, abs=4 * found.sigma)


def test_terms_of_two_slopes_and_of_a_clip():
    points = measured(lambda w: SCALE * np.where(w > 0, 1.005, 0.995) * w)
    found = row(given(points, Hypothesis("asymmetry")), "asymmetry")
    assert found.value == pytest.approx(1e4, abs=4 * found.sigma)  # 0.5 % up, 0.5 % down: ppm
    clip = given(measured(clipped), Hypothesis("line", True, True))
    high = row(clip, "linear_high")
    assert high.value == pytest.approx(4.3 / SCALE, abs=4 * high.sigma)
    assert high.condition == "limit of the output"
    assert row(clip, "saturation_high").condition == "the output's limit, reached at 215 °/s"
    # what a line over everything says is no nonlinearity of the sensor
    output = clip.points.output
    slope, constant = np.polyfit(BOTH_WAYS, output, 1)
    departure = np.abs(output - slope * BOTH_WAYS - constant).max()
    assert row(clip, "straight_line").value == pytest.approx(100 * departure / (slope * 300))
    assert row(clip, "nonlinearity").at_most < 1000
    for key, number, of_line in (("saturation_low", -2, points.output.min()), ("saturation_high", -1, points.output.max())):
        sigma = np.sqrt(clip.fit.covariance[number, number])
        assert (row(clip, key).value, row(clip, key).sigma) == (clip.fit.vector[number], sigma)
        assert (row(given(points, LINE), key).value, row(given(points, LINE), key).sigma) == (of_line, None)


def test_evidence_is_what_its_formula_says():
    sigma = np.full(41, 2e-3)
    for points, stated in ((measured(straight), 0.0), (measured(straight, sigma=sigma), 20.0)):
        cases = [
            (LINE, 0.0),
            (Hypothesis("cubic"), 2 * np.log(len(LAWS))),
            (Hypothesis("line", extras=("hysteresis",)), 2 * np.log(len(LAWS))),
            (Hypothesis("line", apart=3), 2 * np.log(41)),
        ]
        for of, price in cases:
            found, width = fit(points, of), 9.0
            nu, k = 41 - found.parameters + stated, found.parameters
            expected = nu * np.log((found.chi_square + stated) / 2) - 2 * gammaln(nu / 2) + k * np.log(width) + price
            assert score(found, width) == pytest.approx(expected, rel=1e-9)
    clip = fit(measured(clipped), Hypothesis("line", True, True))
    expected = 37 * np.log(clip.chi_square / 2) - 2 * gammaln(37 / 2) + 4 * np.log(41) + 2 * np.log(len(LIMITS))
    assert score(clip, 41.0) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    "output",
    [
        np.round(0.0213 * BOTH_WAYS + 0.003, 2),
        straight(BOTH_WAYS) + 3e-8 * 12 * (BOTH_WAYS / 300) ** 3,  # in a digit that no instrument has
    ],
)
def test_an_exact_or_rounded_line_is_a_line(output):
    assert chance(points_of("sensor", "V", BOTH_WAYS, output, ["one"] * 41)) > 0.2


def test_rival_laws_widen_a_sigma():
    points = measured(clipped)
    clip, rival = Hypothesis("line", True, True), fit(points, Hypothesis("asymmetry", True, True))
    alone, both = given(points, clip), given(points, clip, ((rival, 0.3),))
    differ = _input_limit(rival, 300.0) - _input_limit(alone.fit, 300.0)
    value, sigma = derived(alone.fit, lambda law: _input_limit(law, 330.0))
    for choice, spread in ((alone, 0.0), (both, 0.3 * differ**2)):
        found = row(choice, "linear_high")
        assert (found.value, found.sigma) == pytest.approx((value, np.sqrt(sigma**2 + spread)), rel=1e-5)
    # The slope of a function is that about the number, a tenth of its sigma wide.
    K, of_K = alone.fit.vector[1], np.sqrt(alone.fit.covariance[1, 1])
    assert derived(alone.fit, lambda law: np.exp((law.vector[1] - K) / of_K)) == pytest.approx((1.0, 1.0), rel=5e-3)


# Terms.


def test_what_exceeds_zero_first_lies_between_two_places():
    grid = np.arange(4.0)
    assert (_crossing(grid, np.array([-3.0, -1, 1, -1])), _crossing(grid, np.array([-3.0, 1, 2, 3]))) == (1.5, 0.75)
    assert _crossing(grid, np.array([0.5, 1, 2, 3])) is _crossing(grid, -grid - 1) is None


def test_a_range_that_ends_before_the_smallest_rate_is_not_determined():
    points = fine(lambda w: SCALE * w * (1 - 0.05 * np.log1p(np.abs(w) / 20)), sigma=np.full(50, FINE_NOISE))
    rows = rows_of(given(points, Hypothesis(CURVE)))
    for key in ("linear_low", "linear_high", "nonlinearity"):
        assert rows[key].value is rows[key].at_most is None
    assert "before 20.0 °/s, the smallest rate" in rows["linear_high"].condition
    assert "within -20.0 to 20.0 °/s" in rows["scale"].condition
    assert rows["scale"].unit == "V/(°/s)"


def test_the_linear_range_of_a_sine_ends_where_it_departs_by_one_per_cent():
    found = fit(measured(lambda w: 5 * np.sin(w / 250), noise=0.0), Hypothesis("sine"))
    within = _linear_range(found)
    u = within.high / 250
    assert np.sin(u) / u == pytest.approx(0.99, abs=1e-5)
    assert within.low == pytest.approx(-within.high, rel=1e-6)


def test_nonlinearity_of_a_cubic_against_its_best_line():
    c = 1e-7
    choice = given(measured(lambda w: SCALE * (w - c * w**3)), Hypothesis("cubic"))
    grid = np.linspace(-300, 300, 2001)
    departure = np.abs(np.polyval(np.polyfit(grid, grid**3, 1), grid) - grid**3).max() * c
    assert row(choice, "nonlinearity").value == pytest.approx(1e6 * departure / 300, rel=0.05)


FINE = np.arange(-240.0, 241.0, 20.0)


FINE_TWICE = np.concatenate([FINE, FINE[::-1]])


FINE_NOISE = 1.5e-3


def fine(of, rate=FINE_TWICE, noise=FINE_NOISE, seed=1, sigma=None):
    output = of(rate) + noise * np.random.default_rng(seed).normal(size=len(rate))
    return points_of("sensor", "V", rate, output, ["one"] * len(rate), sigma)


def kink(K=0.015, low=-1.71, high=1.92, at=120.0, off=0.031):
    """A line in three curves, clipped; the one reading between the last sound rate, 100 °/s, and the clip is off."""
    rng = np.random.default_rng(5)
    rate = np.concatenate([np.linspace(-m, m, 11) for m in (75, 150, 250)])
    output = np.clip(K * rate, low, high) + 1e-4 * rng.normal(size=33) + off * (rate == at)
    return points_of("s", "V", rate, output, np.repeat(["75", "150", "250"], 11).tolist())


def test_one_reading_makes_no_kink_and_no_nonlinearity():
    """The evidence is for one reading that is off, also at the price of an extra."""
    points = kink()
    choice = given(points, Hypothesis("line", True, True, apart=int(np.flatnonzero(points.rate_dps == 120)[0])))
    width = fit(points, LINE).chi_square
    assert score(choice.fit, width) + _EXTRA_GAIN < score(fit(points, Hypothesis("pieces", True, True)), width)
    assert "the reading at 120 °/s is off, or there is a kink from 100 °/s on, which no reading determines" in " ".join(lines(choice))
    found = rows_of(choice)
    assert found["nonlinearity"].value is None
    assert found["nonlinearity"].at_most < 300
    assert "within -114 to 100 °/s" in found["nonlinearity"].condition
    assert found["linear_low"].value == pytest.approx(-114.0, abs=0.05)
    assert (found["linear_high"].value, found["linear_high"].sigma, found["linear_high"].at_most) == (None, None, None)
    assert found["linear_high"].condition == "not determined, 100 to 150 °/s: the reading at 120 °/s is off"


def test_a_kink_that_one_reading_shows_has_no_place():
    choice = given(kink(), Hypothesis("pieces", True, True))
    by_name = {each.name: each for each in choice.fit.numbers}
    for name in ("w1", "h"):
        assert by_name[name].value is by_name[name].sigma is None
    assert by_name["w1"].between == (pytest.approx(100, abs=3), pytest.approx(120, abs=3))
    assert by_name["K"].sigma == pytest.approx(4.5e-7, rel=0.4)
    rows = rows_of(choice)
    assert rows["linear_high"].value is rows["nonlinearity"].value is None
    assert rows["linear_high"].condition.endswith("not determined")
    low, high = (float(word) for word in rows["linear_high"].condition.split() if word.startswith("1") and len(word) > 1)
    assert 100 < low < high - 5 < 115


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
    for rates in (FINE[FINE >= 0], 1e-3 * FINE):  # of one sense, and slow ones of both
        off = fine(lambda w: SCALE * w + 0.5 * (w == w.max()), rates, noise=0.0)
        choice = given(off, Hypothesis("line", apart=len(rates) - 1))
        within = _linear_range(choice.fit)
        assert (within.low, within.high, within.ends) == (rates[0], rates[-2], (False, False))
        assert row(choice, "asymmetry").condition.startswith("not measured: one sense only") == (rates[0] == 0)
    # No reading of a sense is sound: the first is off, and the others are at a limit.
    limited = fine(lambda w: np.minimum(SCALE * w, 0.3) + 0.1 * (w == 20), FINE, noise=1e-4)
    found = row(given(limited, Hypothesis("line", upper=True, apart=13)), "linear_high")
    assert (found.value, found.condition) == (None, "not determined, 0 to 40.0 °/s: the reading at 20.0 °/s is off")


@pytest.mark.parametrize(("bent", "high"), [(2, 240.0), (3, 100.0)])
def test_an_end_is_the_median_of_the_draws_where_more_than_half_reach_it(bent, high):
    """A cubic departs by 1 % at 0.1 over the root of its share: of five draws at 100 °/s, or beyond the rates."""
    points = fine(straight, FINE)
    law, curve = fit(points, Hypothesis("cubic")), fit_curve(points, Hypothesis(CURVE))
    shares = np.where(np.arange(5) < bent, 1e-6, 1e-8)
    vars(curve)["draws"] = [law.moved(np.array([0.0, SCALE, -SCALE * share])) for share in shares]
    within = _linear_range(curve)
    assert (within.low, within.high) == (pytest.approx(-high, rel=1e-4), pytest.approx(high, rel=1e-4))
    assert within.ends == (bent == 3, bent == 3)


def test_the_asymmetry_of_a_range_is_that_of_its_readings():
    """Two slopes that differ by 10 % beyond 60 °/s, and by 0.4 % within."""
    rate = np.concatenate([np.arange(-200.0, 201.0, 10.0)] * 2)
    of = lambda w: SCALE * (w + 2e-3 * np.abs(w) + 0.05 * np.maximum(np.abs(w) - 60, 0))  # noqa: E731
    points = fine(of, rate, noise=2e-4)
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


def test_repeats_have_a_row_of_their_own():
    points = fine(straight)
    found, output = row(given(points, LINE), "repeats"), points.output
    pairs = (output[:25] - output[25:][::-1]) / np.sqrt(2)
    assert found.value == pytest.approx(np.sqrt(np.mean(pairs**2)), rel=1e-6)
    assert found.sigma == pytest.approx(found.value / np.sqrt(50))
    rows = rows_of(given(fine(lambda w: SCALE * w + 0.4, sigma=np.full(50, 2e-3)), LINE))
    assert (found.unit, rows["repeats"].unit) == ("V", "stated sigmas")
    assert rows["offset_rate"].value == pytest.approx(0.4 / SCALE, rel=1e-2)


def test_the_scale_is_that_outside_a_dead_band():
    points = measured(lambda w: SCALE * np.sign(w) * np.maximum(np.abs(w) - 5, 0))
    found = row(given(points, Hypothesis("dead_band")), "scale")
    assert found.value == pytest.approx(SCALE, abs=4 * found.sigma)
    assert "outside the dead band" in found.condition


@pytest.mark.parametrize(
    ("extra", "key", "factor"),
    [("sense", "dead_band", 1.0), ("hysteresis", "hysteresis", 1.0), ("bend", "nonlinearity", 0.4e6 * 300**2)],
)
def test_the_limit_of_what_does_not_show_is_that_of_its_column_beside_the_line(extra, key, factor):
    """A dead band is a step between the senses; a cubic departs from its best line by two fifths of what it has at the end."""
    points = measured(straight)
    found = fit(points, Hypothesis("line", extras=(extra,)))
    size, sigma = abs(found.vector[2]), np.sqrt(found.covariance[2, 2])
    assert row(given(points, LINE), key).at_most == pytest.approx(factor * (size + 1.96 * sigma) / SCALE, rel=2e-3)


def test_the_drift_of_several_curves_is_the_scatter_of_their_outputs_at_rest():
    rate = np.tile(UP, 3)
    for off in ([0.0, 0.1, 0.3], [0.0, 0.0, 0.0]):
        output = straight(rate) + np.repeat(off, 21) + NOISE * np.random.default_rng(1).normal(size=63)
        points = points_of("s", "V", rate, output, np.repeat(["a", "b", "c"], 21).tolist())
        found, offsets = row(given(points, LINE), "drift"), output.reshape(3, 21).mean(axis=1)  # the rates' mean is zero
        of_one = fit(points, LINE).noise / np.sqrt(21)
        if any(off):
            assert (found.value, found.at_most) == (pytest.approx(np.std(offsets, ddof=1)), None)
            assert found.sigma == pytest.approx(of_one / np.sqrt(2), rel=1e-3)
        else:
            assert (found.value, found.at_most) == (None, pytest.approx(np.std(offsets, ddof=1) + 1.96 * of_one))


# Rates that the output does not follow, and the smooth curve.


def test_the_covariance_of_the_curve_is_that_of_white_noise_integrated():
    """f(u) is the integral of (u - s)^2 / 2 dW(s): of variance 1 / 20 at 1."""
    for u, v in ((0.3, 0.3), (0.2, 0.9), (1.0, 0.5)):
        exact = quad(lambda s, u=u, v=v: (u - s) ** 2 * (v - s) ** 2 / 4, 0, min(u, v))[0] * 20
        assert curves._covariance(np.array([u]), np.array([v]))[0, 0] == pytest.approx(exact)


def test_the_evidence_of_a_shape_is_the_restricted_likelihood():
    """Of y with covariance s^2 (I + ratio F F'), the fixed columns taken out, and s integrated out."""
    points = fine(lambda w: SCALE * w * (1 - np.abs(w) / 9000))
    shape = Shape(1.0, True, 240.0)
    none = np.zeros(50, dtype=bool)
    found = list(linear(Curve(points, Hypothesis(CURVE), of=shape), none, none, curves.RATIOS, 7.0))
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
        expected = 47 * np.log(curve.chi_square / 2) - 2 * gammaln(47 / 2) + 3 * np.log(7) + curve.penalty
        assert found[k][0] == pytest.approx(expected) == pytest.approx(score(curve, 7.0) - 2 * np.log(len(LAWS)))


def test_a_curve_may_be_clipped_on_either_side():
    curve = fit_curve(fine(lambda w: np.minimum(SCALE * w * (1 - np.abs(w) / 9000), 3.0)), Hypothesis(CURVE, upper=True))
    assert curve.limits == (-np.inf, pytest.approx(3.0, abs=2e-3))


def test_the_asymmetry_of_a_bend_is_of_the_rates_of_both_senses():
    """A bend of one sense, whose range goes to −240 and 80 °/s: of the readings within ±80 °/s alone, by hand."""
    points = fine(lambda w: SCALE * w * (1 - (w > 0) * w / 9000))
    choice, within = given(points, Hypothesis("polynomial")), Range(-240.0, 80.0, (False, True))
    w = FINE_TWICE[np.abs(FINE_TWICE) <= 80]
    A = np.column_stack([np.ones(len(w)), w, w**2, w**3, np.abs(w)])
    by_hand = np.linalg.lstsq(A, points.output[np.abs(FINE_TWICE) <= 80], rcond=None)[0]
    # over 0 to E the line beside w^2 has the slope E
    assert _probe(choice, _inside(choice, within), "asymmetry", within)[0] == pytest.approx(by_hand[4] + 80 * by_hand[2], rel=2e-3)


def test_two_rates_of_both_ways_measure_hysteresis():
    for back, is_measured in (([0.0], False), ([20.0, 0.0], True)):
        rate = np.array([-60.0, -40, -20, 0, 20, 40, *back])
        found = row(given(measured(straight, rate), LINE), "hysteresis")
        assert (found.at_most is not None) == is_measured
        assert ("one way" in found.condition) != is_measured
