"""What is no law of the sensor: a reading that is off, a drift, rounding, a clip of few rates; what repeats say of a law."""

import numpy as np
import pytest

from session.io.errors import FormatError
from tinygc.annexes.rates import choice as choosing
from tinygc.annexes.rates.choice import FALSE_ALARM, LINE, RIVAL, Choice, chance, choose, score
from tinygc.annexes.rates.fitting import fit
from tinygc.annexes.rates.laws import LAWS, LIMITS, Hypothesis
from tinygc.annexes.rates.points import points_of
from tinygc.annexes.rates.terms import averaged, input_limit, terms
from tinygc.annexes.rates.text import headline, lines

UP = np.linspace(-300.0, 300.0, 21)
BOTH_WAYS = np.concatenate([UP, UP[-2::-1]])
SCALE, REST, NOISE = 0.02, 0.15, 1e-3


def measured(of, rate=BOTH_WAYS, noise=NOISE, seed=1, drift=0.0, sigma=None, std=None):
    rng = np.random.default_rng(seed)
    output = REST + of(rate) + noise * rng.normal(size=len(rate)) + drift * np.linspace(0, 1, len(rate))
    return points_of("sensor", "V", rate, output, ["one"] * len(rate), sigma, std)


def line(w):
    return SCALE * w


def given(points, hypothesis, rivals=()):
    """The choice of a law that is known."""
    return Choice(points, fit(points, hypothesis), fit(points, LINE), 0.0, rivals, 1.0 - sum(share for _, share in rivals), ())


def rows_of(choice):
    return {each.key: each for each in terms(choice)}


# One reading.


def test_one_reading_that_is_low_is_no_limit_of_the_output():
    points = measured(line, UP)
    points.output[-1] -= 0.02
    choice = choose(points)
    assert choice.fit.hypothesis.name == "line, one reading off"
    assert points.rate_dps[choice.fit.hypothesis.apart] == 300
    found = rows_of(choice)
    assert found["scale"].value == pytest.approx(SCALE, abs=4 * found["scale"].sigma)
    assert found["linear_high"].condition == "not determined, beyond 270 °/s: the reading at 300 °/s is off"
    assert "the reading at 300 °/s is off, or the output has a limit there" in " ".join(lines(choice))
    assert choice.fit.hypothesis.equation == "V = V0 + K w + r [one reading]"


def test_a_limit_at_two_readings_is_one():
    assert choose(measured(lambda w: np.minimum(line(w), 5.0), UP)).fit.hypothesis.name == "line, clipped above"


@pytest.mark.parametrize(("std_v", "name"), [(1e-5, "line, clipped above"), (5e-3, "line, one reading off")])
def test_a_single_reading_is_at_a_limit_where_its_noise_is_cut_off(std_v, name):
    """The std of a rail is far below that of the sensor's own noise."""
    std = np.full(21, 5e-3)
    std[-1] = std_v
    choice = choose(measured(lambda w: np.minimum(line(w), 5.9), UP, std=std))
    assert choice.fit.hypothesis.name == name
    if "clipped" in name:
        assert "by one reading" in rows_of(choice)["saturation_high"].condition


def test_a_clip_needs_rates_within_its_limits():
    """Of which nothing but rest is left here: neither a scale nor its sigma can be stated."""
    up = np.arange(-400.0, 401.0, 100.0)  # °/s
    points = measured(lambda w: np.clip(line(w), -1.5, 1.5), np.concatenate([up, up[-2::-1]]))
    assert fit(points, Hypothesis("line", True, True)) is None
    assert fit(measured(lambda w: np.clip(line(w), -4.1, 4.3), points.rate_dps), Hypothesis("line", True, True)) is not None


# Drift, rounding, an output that does not follow.


def test_a_drift_is_not_called_hysteresis():
    choice = choose(measured(line, drift=5e-3))
    assert choice.fit.hypothesis.name == "line, drift"
    number = choice.fit.names.index("u")
    assert choice.fit.vector[number] == pytest.approx(5e-3, abs=4 * np.sqrt(choice.fit.covariance[number, number]))
    assert rows_of(choice)["hysteresis"].value is None
    assert "with a drift in the order of the rows" in headline(choice)


def test_what_is_not_told_from_hysteresis_is_named():
    points = measured(line)
    hysteresis, drift = (Hypothesis("line", extras=(name,)) for name in ("hysteresis", "drift"))
    words = rows_of(given(points, hysteresis, ((fit(points, drift), 0.4),)))["hysteresis"].condition
    assert "a drift is not told from it" in words
    assert "a drift" not in rows_of(given(points, hysteresis))["hysteresis"].condition


@pytest.mark.parametrize("extra", ["hysteresis", "drift"])
def test_rates_that_go_one_way_show_neither_hysteresis_nor_drift(extra):
    fits = choose(measured(line, UP)).fits
    assert not any(extra in found.hypothesis.extras for found, _ in fits)


@pytest.mark.parametrize(
    "output",
    [
        0.0213 * BOTH_WAYS + 0.15,
        np.round(0.0213 * BOTH_WAYS + 0.003, 2),
        np.round(0.02371 * BOTH_WAYS, 3),
        np.round(14.3 * BOTH_WAYS + 0.4),
        line(BOTH_WAYS) + 3e-8 * 12 * (BOTH_WAYS / 300) ** 3,  # in a digit that no instrument has
    ],
)
def test_an_exact_or_rounded_line_is_a_line(output):
    points = points_of("sensor", "V", BOTH_WAYS, output, ["one"] * 41)
    assert chance(points) > 0.2
    assert choose(points).is_line


def test_a_bend_is_seen_through_the_rounding():
    output = np.round(SCALE * (BOTH_WAYS - 1e-6 * BOTH_WAYS**3), 2)
    assert not choose(points_of("sensor", "V", BOTH_WAYS, output, ["one"] * 41)).is_line


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_an_output_that_does_not_change_is_refused(level):
    with pytest.raises(FormatError, match=f"the output is {level:g} V at every rate, expected one that follows it"):
        points_of("sensor", "V", UP, np.full(21, level), ["one"] * 21)


def test_of_an_output_that_does_not_follow_the_rate_nothing_is_stated_as_a_rate():
    found = rows_of(choose(measured(lambda w: 0 * w)))
    for key in ("offset_rate", "nonlinearity", "asymmetry", "hysteresis", "dead_band", "straight_line"):
        assert found[key].value is found[key].at_most is None
        assert "does not follow the rate" in found[key].condition
    assert found["offset"].value == pytest.approx(REST, abs=4 * found["offset"].sigma)


# Dead band.


@pytest.mark.parametrize("width", [0.5, 5.0, 40.0])
def test_the_scale_is_that_outside_a_dead_band(width):
    points = measured(lambda w: SCALE * np.sign(w) * np.maximum(np.abs(w) - width, 0))
    found = rows_of(given(points, Hypothesis("dead_band")))["scale"]
    assert found.value == pytest.approx(SCALE, abs=4 * found.sigma)
    assert "outside the dead band" in found.condition


def test_the_limit_of_a_dead_band_is_that_of_a_step_between_the_senses():
    points = measured(line)
    step = fit(points, Hypothesis("line", extras=("sense",)))
    size, sigma = abs(step.vector[2]), np.sqrt(step.covariance[2, 2])
    assert rows_of(given(points, LINE))["dead_band"].at_most == pytest.approx((size + 1.96 * sigma) / SCALE, rel=1e-3)


def test_rates_of_one_sense_have_no_limit_of_the_dead_band():
    found = rows_of(choose(measured(line, np.linspace(10, 300, 20))))["dead_band"]
    assert found.value is found.at_most is None
    assert "do not determine it" in found.condition


# Repeats, rivals, several curves.


def test_repeats_refute_a_law_and_widen_its_sigmas():
    rate = np.repeat(np.linspace(-300, 300, 11), 3)
    bent = measured(lambda w: 5 * np.sin(w / 250) + 0.01 * np.sin(w / 20), rate)
    found = fit(bent, Hypothesis("sine"))
    lack = found.lack_of_fit
    assert lack.freedom == 22
    assert lack.noise == pytest.approx(NOISE, rel=0.4)
    assert lack.p_value < 1e-6
    means = np.array([found.residuals[3 * n : 3 * n + 3].mean() for n in range(11)])
    scatter = 3 * np.sum(means**2) / (11 - 3)  # of the means about the law, as variance of one reading
    assert lack.variance_inflation == pytest.approx(scatter / found.noise**2, rel=1e-3)
    size = np.linalg.norm(found.jacobian, axis=0)
    inverse = np.linalg.inv((found.jacobian / size).T @ (found.jacobian / size)) / np.outer(size, size)
    assert found.covariance[1, 1] == pytest.approx(inverse[1, 1] * scatter, rel=1e-3)
    assert "repeats scatter by" in " ".join(lines(given(bent, Hypothesis("sine"))))


def test_rival_laws_widen_a_sigma():
    points = measured(lambda w: np.clip(line(w), -4.1, 4.3))
    clip, rival = Hypothesis("line", True, True), fit(points, Hypothesis("asymmetry", True, True))
    alone, both = given(points, clip), given(points, clip, ((rival, 0.3),))
    differ = input_limit(rival, 300.0) - input_limit(alone.fit, 300.0)
    sigma = rows_of(alone)["linear_high"].sigma
    assert rows_of(both)["linear_high"].sigma == pytest.approx(np.sqrt(sigma**2 + 0.3 * differ**2), rel=1e-6)
    value, wider = averaged(both, lambda have: have.coefficients[0])
    assert value == alone.fit.coefficients[0]
    assert wider**2 - averaged(alone, lambda have: have.coefficients[0])[1] ** 2 == pytest.approx(
        0.3 * (rival.coefficients[0] - value) ** 2, rel=1e-6
    )


def test_sigmas_of_hysteresis_and_of_the_spread_of_offsets_hold():
    late, spread = [], []
    offsets = np.repeat([0.0, 0.02, -0.03, 0.01], 5)
    for seed in range(40):
        points = measured(line, seed=seed)
        points.output[:] += 5e-3 * points.direction / 2
        found = rows_of(given(points, Hypothesis("line", extras=("hysteresis",))))["hysteresis"]
        late.append((found.value - 5e-3 / SCALE) / found.sigma)
        rng = np.random.default_rng(seed)
        rate = np.tile(np.linspace(-100, 100, 5), 4)
        curves = points_of("s", "V", rate, line(rate) + offsets + NOISE * rng.normal(size=20), np.repeat(list("abcd"), 5).tolist())
        found = rows_of(given(curves, LINE))["drift"]
        spread.append((found.value - offsets[::5].std(ddof=1)) / found.sigma)
    for errors in (late, spread):
        assert 0.8 < np.std(errors) < 1.25
        assert abs(np.mean(errors)) < 0.4


# What evidence and chance cost.


def test_evidence_is_what_its_formula_says():
    from scipy.special import gammaln

    sigma = np.full(41, 2e-3)
    for points, stated in ((measured(line), 0.0), (measured(line, sigma=sigma), 20.0)):
        cases = [
            (LINE, 0.0),
            (Hypothesis("cubic"), 2 * np.log(len(LAWS))),
            (Hypothesis("line", extras=("hysteresis",)), 2 * np.log(len(LAWS))),
            (Hypothesis("line", apart=3), 2 * np.log(41)),
        ]
        for of, price in cases:
            found, unit = fit(points, of), 3.0
            nu, k = 41 - found.parameters + stated, found.parameters
            expected = nu * np.log((found.chi_square + stated) / 2) - 2 * gammaln(nu / 2) + k * np.log(41 * unit**2) + price
            assert score(found, unit) == pytest.approx(expected, rel=1e-9)
    clip = fit(measured(lambda w: np.clip(line(w), -4.1, 4.3)), Hypothesis("line", True, True))
    expected = 37 * np.log(clip.chi_square / 2) - 2 * gammaln(37 / 2) + 4 * np.log(41) + 2 * np.log(len(LIMITS))
    assert score(clip, 1.0) == pytest.approx(expected, rel=1e-9)


def test_a_line_stays_where_chance_has_more_than_five_of_a_hundred():
    points = measured(line, seed=12)
    assert 0.05 < chance(points) < 0.10
    assert choose(points).is_line


@pytest.mark.parametrize("stated", [False, True])
def test_chance_is_even_over_tables_of_noise(monkeypatch, stated):
    """Where sigmas are stated, noise is of another size than these by as much as twenty readings leave it unknown."""
    monkeypatch.setattr(choosing, "TABLES", 400)
    rng = np.random.default_rng(5)
    rate = np.linspace(-100, 100, 7)
    found = []
    for _ in range(300):
        noise = rng.normal(size=7) * (np.sqrt(20 / rng.chisquare(20)) if stated else 1.0)
        found.append(chance(points_of("s", "V", rate, rate + noise, ["one"] * 7, np.ones(7) if stated else None)))
    assert np.mean(found) == pytest.approx(0.5, abs=0.06)
    assert np.mean(np.array(found) < FALSE_ALARM) == pytest.approx(0.05, abs=0.035)


def test_an_extra_must_gain_what_a_search_among_them_costs(monkeypatch):
    points = measured(lambda w: np.minimum(line(w), 4.2))
    points.output[:] += 1.4e-3 * points.direction / 2
    monkeypatch.setattr(choosing, "LAWS", {"line": LAWS["line"]})
    assert choose(points).fit.hypothesis.name == "line, clipped above"
    monkeypatch.setattr(choosing, "EXTRA_GAIN", 0.0)
    assert choose(points).fit.hypothesis.name == "line, clipped above, hysteresis"


def test_laws_of_a_twentieth_of_the_best_are_named():
    choice = choose(measured(lambda w: SCALE * (w - 3e-8 * w**3), seed=0))
    shares = {found.hypothesis.name: share for found, share in choice.rivals}
    assert min(shares.values()) < 0.1 * choice.probability
    assert min(shares.values()) > RIVAL * choice.probability
