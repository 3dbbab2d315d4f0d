"""Which law the points of a rate table follow, and the terms of it: exact cases, injected terms and their sigmas, chance."""

import dataclasses
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import broad
from scipy.stats import f as f_distribution

from session.io.errors import DataError, FormatError
from tinygc.annexes.rates.choice import LINE, Choice, chance, choose, held_out
from tinygc.annexes.rates.fitting import fit, floor, over_rate
from tinygc.annexes.rates.laws import EXTRAS, LAWS, Hypothesis
from tinygc.annexes.rates.points import points_of
from tinygc.annexes.rates.terms import input_limit, linear_range, terms

UP = np.linspace(-300.0, 300.0, 21)
BOTH_WAYS = np.concatenate([UP, UP[-2::-1]])
SCALE, REST, NOISE = 0.02, 0.15, 1e-3


def measured(of, rate=BOTH_WAYS, noise=NOISE, seed=1, **more):
    rng = np.random.default_rng(seed)
    return points_of("sensor", "V", rate, REST + of(rate) + noise * rng.normal(size=len(rate)), ["one"] * len(rate), **more)


def rows_of(choice):
    return {each.key: each for each in terms(choice)}


def row(choice, key):
    return rows_of(choice)[key]


# Exact cases, without noise.


def test_a_line_without_noise_is_a_line():
    found = fit(measured(lambda w: SCALE * w, noise=0.0), LINE)
    assert found.coefficients[0] == pytest.approx(SCALE, rel=1e-12)
    assert found.offset == pytest.approx(REST, rel=1e-12)
    assert found.rms < 1e-12


def test_a_clip_is_where_the_line_meets_the_limit():
    found = fit(measured(lambda w: np.clip(SCALE * w, -4.1, 4.3), noise=0.0), Hypothesis("line", True, True))
    assert found.limits == (pytest.approx(REST - 4.1), pytest.approx(REST + 4.3))
    assert input_limit(found, 300.0) == pytest.approx(4.3 / SCALE, rel=1e-9)
    assert input_limit(found, -300.0) == pytest.approx(-4.1 / SCALE, rel=1e-9)
    assert found.is_limited.sum() == np.sum(np.abs(BOTH_WAYS) > 4.3 / SCALE) + np.sum(
        (BOTH_WAYS < -4.1 / SCALE) & (BOTH_WAYS > -4.3 / SCALE)
    )


def test_a_point_on_the_slope_is_not_taken_for_the_limit():
    rate = np.array([-60.0, -50, -40, -30, -20, -10, 0, 10, 20, 30, 40, 50, 60])
    found = fit(measured(lambda w: np.minimum(SCALE * w, 0.801), rate, noise=0.0), Hypothesis("line", upper=True))
    assert found.limits[1] == pytest.approx(REST + 0.801)  # 40 °/s gives 0.800, just below
    assert found.is_limited.sum() == 2


@pytest.mark.parametrize(
    ("law", "of", "shape"),
    [
        ("sine", lambda w: 5 * np.sin(w / 250), (250,)),
        ("tanh", lambda w: 8 * np.tanh(w / 400), (400,)),
        ("dead_band", lambda w: SCALE * np.sign(w) * np.maximum(np.abs(w) - 40, 0), (40,)),
        ("pieces", lambda w: SCALE * (w - 0.1 * np.maximum(w - 130, 0)), (130,)),
        ("normalised_sine", lambda w: 5 * np.sin(w / 200) / (1 + 0.3 * np.cos(w / 200)), (200, 0.3)),
        ("overloaded_sine", lambda w: 5 * np.sin(w / 190) / (1 + np.abs(np.sin(w / 190) / 1.05) ** 8), (190, 1.05, 8)),
    ],
)
def test_shape_parameters_are_recovered_without_noise(law, of, shape):
    assert fit(measured(of, noise=0.0), Hypothesis(law)).shape == pytest.approx(shape, rel=2e-3)


def test_the_first_harmonic_of_a_demodulator_is_the_bessel_function():
    from scipy.special import j1

    rate, depth = np.array([0.0, 10.0, 100.0, 200.0]), 1.8
    columns = LAWS["demodulator"].columns(rate, (150.0, depth, 1e9))[:, 0]
    x = rate / 150.0
    t = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    signal = np.cos(x[:, None] + depth * np.cos(t))
    rms = (signal - signal.mean(axis=1, keepdims=True)).std(axis=1)
    assert columns == pytest.approx(2 * j1(depth) * np.sin(x) / rms, abs=1e-9)


def test_scale_and_unit_do_not_change_the_choice():
    one = chosen("sine")
    points = one.points
    other = choose(points_of("sensor", "mV", -points.rate_dps, 1e3 * points.output, ["one"] * len(points)))
    assert one.fit.hypothesis == other.fit.hypothesis == Hypothesis("sine")
    assert other.probability == pytest.approx(one.probability, rel=1e-3)
    assert other.fit.coefficients[0] == pytest.approx(-1e3 * one.fit.coefficients[0], rel=1e-6)


# Which law.

ONE_OF = {
    "line": (lambda w: SCALE * w, "line"),
    "clip": (lambda w: np.clip(SCALE * w, -4.1, 4.3), "line, clipped below and above"),
    "one-sided clip": (lambda w: np.minimum(SCALE * w, 4.2), "line, clipped above"),
    "sine": (lambda w: 5 * np.sin(w / 250), "sine"),
    "cubic": (lambda w: SCALE * (w - 1e-6 * w**3), "cubic"),
    "two slopes": (lambda w: SCALE * np.where(w > 0, 1.005, 0.995) * w, "asymmetry"),
}
MORE = {
    "tanh": (lambda w: 8 * np.tanh(w / 400), "tanh"),
    "arctan": (lambda w: 6 * np.arctan(w / 300), "arctan"),
    "parabola": (lambda w: SCALE * (w + 5e-5 * w**2), "quadratic"),
    "dead band": (lambda w: SCALE * np.sign(w) * np.maximum(np.abs(w) - 4, 0), "dead_band"),
    "clipped sine": (lambda w: np.clip(5 * np.sin(w / 250), -4.1, 4.3), "sine, clipped below and above"),
    "two pieces": (lambda w: SCALE * (w - 0.02 * np.maximum(w - 120, 0)), "pieces"),
}


@cache
def chosen(name):
    return choose(measured((ONE_OF | MORE)[name][0]))


@pytest.mark.parametrize("name", [*ONE_OF, *map(broad, MORE)])
def test_the_law_is_found(name):
    assert chosen(name).fit.hypothesis.name == (ONE_OF | MORE)[name][1]


def test_hysteresis_is_found_where_the_rates_go_both_ways():
    points = measured(lambda w: SCALE * w)
    late = dataclasses.replace(points, output=points.output + 5e-3 * points.direction / 2)
    choice = choose(late)
    assert choice.fit.hypothesis.name == "line, hysteresis"
    found = row(choice, "hysteresis")
    assert found.value == pytest.approx(5e-3 / SCALE, abs=4 * found.sigma)
    one_way = choose(measured(lambda w: SCALE * w, UP))
    assert row(one_way, "hysteresis").value is row(one_way, "hysteresis").at_most is None
    assert "one way" in row(one_way, "hysteresis").condition


def test_a_straight_line_has_limits_instead_of_terms():
    choice = chosen("line")
    assert choice.is_line
    for key in ("nonlinearity", "asymmetry", "hysteresis", "dead_band"):
        assert row(choice, key).value is None
        assert row(choice, key).at_most > 0
    assert row(choice, "scale").value == pytest.approx(SCALE, abs=4 * row(choice, "scale").sigma)
    assert row(choice, "linear_high").value == 300.0
    assert "tested" in row(choice, "linear_high").condition


def test_terms_of_two_slopes_and_of_a_clip():
    found = row(chosen("two slopes"), "asymmetry")
    assert found.value == pytest.approx(1e4, abs=4 * found.sigma)  # 0.5 % up, 0.5 % down: ppm
    clip = chosen("clip")
    high = row(clip, "linear_high")
    assert high.value == pytest.approx(4.3 / SCALE, abs=4 * high.sigma)
    assert high.condition == "limit of the output"
    assert row(clip, "saturation_high").condition == "the output's limit, reached at 215 °/s"
    # what a line over everything says is no nonlinearity of the sensor
    assert row(clip, "straight_line").value > 10
    assert row(clip, "nonlinearity").at_most < 1000


def test_the_linear_range_of_a_sine_ends_where_it_departs_by_one_per_cent():
    found = fit(measured(lambda w: 5 * np.sin(w / 250), noise=0.0), Hypothesis("sine"))
    within = linear_range(found)
    u = within.high / 250
    assert np.sin(u) / u == pytest.approx(0.99, abs=1e-5)
    assert within.low == pytest.approx(-within.high, rel=1e-6)


def test_nonlinearity_of_a_cubic_against_its_best_line():
    c = 1e-7
    choice = choose(measured(lambda w: SCALE * (w - c * w**3)))
    assert choice.fit.hypothesis.law == "cubic"
    grid = np.linspace(-300, 300, 2001)
    departure = np.abs(np.polyval(np.polyfit(grid, grid**3, 1), grid) - grid**3).max() * c
    found = row(choice, "nonlinearity")
    assert found.value == pytest.approx(1e6 * departure / 300, rel=0.05)


# Chance, and stated sigmas.


def test_stated_sigmas_are_weights_and_freedom():
    rate = np.linspace(-100, 100, 7)
    output = 0.02 * rate + 1e-3 * np.array([1, -1, 0, 1, 0, -1, 1])
    known = points_of("s", "V", rate, output, ["one"] * 7, np.full(7, 1e-4))
    guessed = points_of("s", "V", rate, output, ["one"] * 7)
    assert chance(known) < chance(guessed)
    assert fit(known, LINE).freedom == fit(guessed, LINE).freedom + 20


def test_a_wild_point_of_large_sigma_does_not_count():
    rate = np.linspace(-100, 100, 11)
    output, sigma = 0.02 * rate, np.full(11, 1e-4)
    output[3] += 1.0
    sigma[3] = 1.0
    assert fit(points_of("s", "V", rate, output, ["one"] * 11, sigma), LINE).coefficients[0] == pytest.approx(0.02, rel=1e-5)


def test_sigmas_of_the_terms_hold():
    errors = []
    for seed in range(40):
        points = measured(ONE_OF["clip"][0], seed=seed)
        clip = fit(points, Hypothesis("line", True, True))
        found = rows_of(Choice(points, clip, fit(points, LINE), 0.0, (), 1.0, ()))
        for key, truth in (("scale", SCALE), ("linear_high", 4.3 / SCALE), ("saturation_low", REST - 4.1)):
            errors.append((found[key].value - truth) / found[key].sigma)
    assert 0.58 < np.mean(np.abs(errors) < 1) < 0.78
    assert np.mean(np.abs(errors) < 2) > 0.90


def test_the_limit_of_a_term_that_does_not_show_holds():
    """Sixty tables whose slopes differ by too little to be seen."""
    below = []
    for seed in range(60):
        points = measured(lambda w: SCALE * np.where(w > 0, 1 + 1e-4, 1 - 1e-4) * w, seed=seed)
        line = fit(points, LINE)
        below.append(rows_of(Choice(points, line, line, 1.0, (), 1.0, ()))["asymmetry"].at_most > 200)
    assert np.mean(below) > 0.92


# Several curves.


def test_a_curve_is_predicted_from_the_others_with_its_own_offset():
    rng = np.random.default_rng(2)
    rate = np.concatenate([np.linspace(-r, r, 11) for r in (50, 100, 200)])
    curve = np.repeat(["a", "b", "c"], 11)
    offset = np.repeat([0.0, 0.02, -0.03], 11)
    points = points_of("s", "V", rate, offset + 5 * np.sin(rate / 250) + 1e-4 * rng.normal(size=33), curve.tolist())
    one = held_out(points, Hypothesis("sine"), 1)
    assert one.rms < 3e-4
    assert one.beyond == 0
    far = held_out(points, Hypothesis("cubic"), 2)
    assert far.beyond == 6  # 120, 160 and 200 in both senses
    assert far.rms > 10 * far.within_rms
    assert choose(points).fit.offsets - choose(points).fit.offsets[0] == pytest.approx([0, 0.02, -0.03], abs=3e-4)


def test_too_few_points_are_refused_in_one_line():
    with pytest.raises(FormatError, match="3 rates, expected at least four"):
        points_of("s", "V", [0, 1, 2], [0, 1, 2], ["one"] * 3)
    with pytest.raises(DataError, match="do not determine a line"):
        choose(points_of("s", "V", [0, 1, 2, 3], [0, 1, 2, 3], ["a", "b", "c", "d"]))


# The fit's noise, its sigmas, and the points that it needs.


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
    found = fit(measured(lambda w: SCALE * w), Hypothesis("cubic")).moved(np.zeros(3))
    assert found.jacobian == pytest.approx(np.column_stack([np.ones(41), BOTH_WAYS, BOTH_WAYS**3]), rel=1e-6, abs=1e-6)


def test_the_least_that_residuals_count():
    """Rounding to the last digit, of rms step / sqrt(12), or a ten-millionth of the span; over the sigmas that are stated."""
    rate = np.arange(5.0)
    for output, least in ((0.01 * rate, 0.01 / np.sqrt(12)), (rate / 3, 4 / 3 * 1e-7)):
        assert floor(points_of("s", "V", rate, output, ["one"] * 5)) == pytest.approx(5 * least**2)
        assert floor(points_of("s", "V", rate, output, ["one"] * 5, np.full(5, 0.1))) == pytest.approx(5 * (least / 0.1) ** 2)


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


# Columns of the laws and of what may be beside them, at 50 °/s in both senses.

HALF = 1.25 / 2  # half the phase of 50 °/s over 40 °/s


@pytest.mark.parametrize(
    ("law", "shape", "expected"),
    [
        ("line", (), [[-50], [50]]),
        ("asymmetry", (), [[-50, 50], [50, 50]]),
        ("quadratic", (), [[-50, 2500], [50, 2500]]),
        ("cubic", (), [[-50, -125e3], [50, 125e3]]),
        ("polynomial", (), [[-50, 2500, -125e3], [50, 2500, 125e3]]),
        ("tanh", (40,), [[2 / (1 + np.exp(2.5)) - 1], [1 - 2 / (1 + np.exp(2.5))]]),
        ("arctan", (40,), [[-np.arctan2(5, 4)], [np.arctan2(5, 4)]]),
        ("root", (40,), [[-2000 / np.hypot(40, 50)], [2000 / np.hypot(40, 50)]]),
        ("sine", (40,), [[-np.cos(np.pi / 2 - 1.25)], [np.cos(np.pi / 2 - 1.25)]]),
        ("sine_of_any_phase", (40,), [[-np.sin(1.25), -2 * np.sin(HALF) ** 2], [np.sin(1.25), -2 * np.sin(HALF) ** 2]]),
        ("normalised_sine", (40, 0.5), [[-np.sin(1.25) / (1 + np.cos(1.25) / 2)], [np.sin(1.25) / (1 + np.cos(1.25) / 2)]]),
        ("overloaded_sine", (40, 0.5, 2), [[-np.sin(1.25) / (1 + 4 * np.sin(1.25) ** 2)], [np.sin(1.25) / (1 + 4 * np.sin(1.25) ** 2)]]),
        ("dead_band", (40,), [[-10], [10]]),
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
    powers = np.array([power for _, power in of.coefficients])
    assert of.columns(2 * rate, twice) == pytest.approx(2.0**powers * of.columns(rate, shape), rel=1e-9, abs=1e-12)


def test_columns_of_extras_and_their_units():
    rate = np.array([-20.0, 0, 20, 10, -10])
    points = points_of("s", "mV", rate, rate, ["one"] * 5)
    of = Hypothesis("line", False, True, ("asymmetry", "hysteresis", "drift", "turning", "bend", "sense"), apart=3)
    expected = [rate, np.abs(rate), points.direction / 2, points.order, rate != 0, rate**3, np.sign(rate), np.arange(5) == 3]
    assert pytest.approx(np.array(expected, dtype=float)) == of.columns(rate, (), points).T
    assert not of.columns(rate, ())[:, [2, 3, 7]].any()  # of rates that are no points neither sense nor order is known
    assert of.added == 7
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
    ("hypothesis", "said"),
    [
        (LINE, "V = V0 + K w"),
        (Hypothesis("normalised_sine", lower=True), "V = clip(V0 + A sin x / (1 + j cos x), V−, ∞); x = w / w0"),
        (Hypothesis("line", False, True, ("hysteresis",), 2), "V = clip(V0 + K w + h direction / 2 + r [one reading], −∞, V+)"),
    ],
)
def test_the_equation_of_a_hypothesis(hypothesis, said):
    assert hypothesis.equation == said
