"""Effects of a lot by pooling: weak in each unit; nothing where there is nothing; each statistic by direct integration or by hand."""

from itertools import product

import numpy as np
import pytest
from scipy import integrate, optimize, stats

from tinygc.annexes.lots.effects import (
    FAMILY_WISE,
    Estimates,
    along,
    beside_leaders,
    corrected_p,
    correlation_of,
    estimates_of,
    log_p,
    mean_of,
    mixture,
    pooled,
    scores_of,
    spread_about,
    spread_log_p,
    stated_p,
)
from tinygc.annexes.lots.lot import UnitResult, Weighed

#: effect -> how many numbers; as a session tells them
NUMBERS = {"a.nine": 9, "b.three": 3, "c.three": 3, "d.one": 1, "e.nine": 9, "f.three": 3}
SIZE = sum(NUMBERS.values())


def design(rng) -> np.ndarray:
    """(SIZE, SIZE): a root of the covariance of a session's estimates, which are correlated across effects."""
    return np.linalg.cholesky(np.eye(SIZE) + 0.3 * (raw := rng.standard_normal((SIZE, SIZE)) / np.sqrt(SIZE)) @ raw.T)


def units(rng, count, add=None, root=None) -> list[UnitResult]:
    """Units whose estimates have errors of about one sigma; add(unit) -> (SIZE,) what is truly there."""
    root = design(rng) if root is None else root
    found = []
    for number in range(count):
        sigma = np.exp(0.3 * rng.standard_normal(SIZE))
        noise = np.sqrt(np.sum(root**2, axis=1))
        x = root @ rng.standard_normal(SIZE) / noise * sigma + (0 if add is None else add(number))
        effects, at = {}, 0
        for name, size in NUMBERS.items():
            own = slice(at, at := at + size)
            keys = [str(i) for i in range(size)]
            told = (dict(zip(keys, map(float, values[own]), strict=True)) for values in (x, sigma))
            effects[name] = Weighed(*told, chi_square=float(np.sum((x[own] / sigma[own]) ** 2)), named=False)
        empty = np.full((21, 21), np.nan)
        found.append(UnitResult(f"u{number}", f"u{number}", f"s{number}", empty[0], empty, effects=effects))
    return found


def at(name: str, values) -> np.ndarray:
    """(SIZE,) with an effect's numbers, nothing of the others."""
    start = sum(size for other, size in NUMBERS.items() if other < name)
    made = np.zeros(SIZE)
    made[start : start + NUMBERS[name]] = values
    return made


@pytest.mark.slow
def test_a_lot_with_nothing_in_it_names_nothing(monkeypatch):
    """Family-wise 5 %: of 120 lots of 30 units at most 5 % + 3 sigmas of that (binomial) name anything."""
    monkeypatch.setattr("tinygc.annexes.lots.effects.DRAWS", 400)
    rng = np.random.default_rng(11)
    root = design(rng)
    named = sum(bool(pooled(units(rng, 30, root=root), seed=k)) for k in range(120))
    assert named <= 120 * (FAMILY_WISE + 3 * np.sqrt(FAMILY_WISE * (1 - FAMILY_WISE) / 120))


@pytest.mark.parametrize(("name", "values"), [("b.three", [1.5, 0, 0]), ("a.nine", [1.5, *[0] * 8]), ("d.one", [1.5])])
def test_what_is_weak_in_each_of_fifty_units_is_found(name, values):
    """z = 1.5 in each: named in none of them by itself, and its mean recovered within three of its sigmas."""
    rng = np.random.default_rng(3)
    found = pooled(units(rng, 50, lambda number: at(name, values)))
    assert list(found) == [name]
    assert found[name].p_value < 1e-3
    assert found[name].units == 50
    assert found[name].share == 1.0
    mean = np.array(list(found[name].mean.values()))
    assert np.abs(mean).argmax() == 0
    assert mean[0] == pytest.approx(1.5, abs=3 / np.sqrt(50))


def test_units_with_either_sign_have_no_mean_and_are_found_by_their_spread():
    rng = np.random.default_rng(4)
    found = pooled(units(rng, 80, lambda number: at("c.three", 2.5 * rng.standard_normal(3))))
    assert list(found) == ["c.three"]
    assert min(found["c.three"].spread.values()) > 1


def test_one_odd_unit_does_not_speak_for_the_lot():
    """300 sigmas in one of thirty, as a board that fell."""
    rng = np.random.default_rng(5)
    assert pooled(units(rng, 30, lambda number: at("a.nine", 300.0) if number == 7 else 0)) == {}


def test_a_part_of_the_units_has_it():
    """Half of two hundred units, 4 sigmas: the share within 15 %, the mean that of those that have it."""
    rng = np.random.default_rng(6)
    found = pooled(units(rng, 200, lambda number: at("b.three", [4.0, 0, 0]) if number % 2 else 0))
    assert list(found) == ["b.three"]
    assert found["b.three"].share == pytest.approx(0.5, abs=0.15)
    assert found["b.three"].mean["0"] == pytest.approx(4.0, rel=0.3)


def test_what_an_effect_leaves_in_the_columns_of_another_is_not_named_for_itself():
    """Estimates of f follow those of b with 0.9: one is named, the other may as well be it, or goes unsaid."""
    rng = np.random.default_rng(7)
    root = np.eye(SIZE)
    b, f = (np.flatnonzero(at(name, 1.0)) for name in ("b.three", "f.three"))
    root[f, b], root[f, f] = 0.9, np.sqrt(1 - 0.81)
    found = pooled(units(rng, 60, lambda number: at("b.three", [2.0, 0, 0]) + at("f.three", [1.8, 0, 0]), root))
    assert len(found) == 1
    ((name, effect),) = found.items()
    assert {name, *effect.equivalent} == {"b.three", "f.three"}
    apart = pooled(units(rng, 60, lambda number: at("b.three", [2.0, 0, 0]) + at("e.nine", [0, 2.0, *[0] * 7])))
    assert set(apart) == {"b.three", "e.nine"}


# Each statistic, by hand, by direct integration, or over all signs of a few units


def estimates(x, sigma, name="a"):
    """Estimates (N,) or (N, P) of one effect."""
    x, sigma = (np.asarray(each, dtype=float).reshape(len(x), -1) for each in (x, sigma))
    return Estimates(name, tuple(map(str, range(x.shape[1]))), x, sigma)


def some(rng, count, size, mean=0.0):
    sigma = np.exp(0.3 * rng.normal(size=(count, size)))
    return estimates(sigma * rng.normal(size=(count, size)) + mean, sigma)


def test_the_spread_is_the_median_square_less_the_noise():
    """Half of the squares of a normal lie below 0.4549 of its variance."""
    x, sigma = np.array([[1.0, 0.1], [2.0, 0.2], [-4.0, 0.1]]), np.array([[1.0, 1], [0.5, 1], [2.0, 1]])
    assert spread_about(x, sigma, 0.5) == pytest.approx([1.5**2 / 0.454936 - 0.25, 0], rel=1e-5)


def test_a_units_score_is_its_estimate_in_sigmas_bounded_and_weighed():
    x, sigma = np.array([0.2, -1.0, 3.0, 50.0, np.nan, 0.5, 1.0]), np.array([1.0, 2.0, 4.0, 1.0, 1.0, 0.5, 0.5])
    told = np.isfinite(x)
    wide = np.sqrt(sigma**2 + max(np.median((x**2 / 0.454936 - sigma**2)[told]), 0))[told]
    found = scores_of(estimates(x, sigma))
    assert found[told, 0] == pytest.approx(np.clip(x[told] / wide, -3, 3) * np.median(wide) / wide, rel=1e-5)
    assert found[4, 0] == 0


def test_the_probability_of_a_mean_is_hotellings_square():
    rng = np.random.default_rng(0)
    score, signs = rng.normal(size=(12, 3)), rng.choice([-1.0, 1.0], (5, 12))
    square = [m @ np.linalg.solve(score.T @ score, m) for m in signs @ score]
    assert log_p(score, signs) == pytest.approx(stats.chi2.logsf(square, 3))
    # A number that says what another says is no further one; without any there is nothing.
    assert log_p(np.column_stack([score[:, :1], 2 * score[:, :1]]), signs) == pytest.approx(log_p(score[:, :1], signs))
    assert log_p(np.zeros((12, 2)), signs).tolist() == [0] * 5
    for share, numbers in ((1.01e-6, 2), (0.99e-6, 1)):  # of the largest square, from which on a number is a further one
        score = 100 * np.column_stack([np.ones(12), np.sqrt(share) * np.tile([1.0, -1.0], 6)])
        assert log_p(score, np.ones((1, 12)))[0] == pytest.approx(stats.chi2.logsf(12, numbers))


def test_the_stated_p_value_is_that_of_the_weighted_mean():
    x, sigma = np.array([[1.0, 0.1], [2.0, -0.1], [np.nan, 0]]), np.array([[1.0, 1], [0.5, 2], [1, 1]])
    z = (1 + 8) / np.sqrt(5)
    assert stated_p(estimates(x, sigma)) == pytest.approx(2 * 2 * stats.norm.sf(z))
    assert stated_p(estimates(0.01 * x, sigma)) == 1


def test_the_spread_of_an_effect_is_tested_against_the_catalogues():
    """By Student's t of the bounded squares, one-sided, about the median effect, or about a bounded unit normal where that is more."""
    rng = np.random.default_rng(1)
    effects = [some(rng, 15, size, 0) for size in (1, 2, 3)]
    effects[1] = estimates(2 * effects[1].x, effects[1].sigma)
    effects[2] = estimates(4 * effects[2].x, effects[2].sigma)
    squares = [np.mean(np.clip(each.x / each.sigma, -3, 3) ** 2, axis=1) for each in effects]
    bounded = integrate.quad(lambda z: min(z * z, 9) * stats.norm.pdf(z), -12, 12, points=[-3, 3])[0]
    for chosen, usual in ((effects, np.mean(squares[1])), ([estimates(0.5 * effects[0].x, effects[0].sigma)], bounded)):
        own = squares if len(chosen) == 3 else [0.25 * effects[0].x[:, 0] ** 2 / effects[0].sigma[:, 0] ** 2]
        expected = [np.log(stats.ttest_1samp(each, usual, alternative="greater").pvalue) for each in own]
        assert spread_log_p(chosen) == pytest.approx(expected)


def test_an_effects_p_value_is_over_all_signs_and_the_whole_catalogue():
    """The largest of three effects against the largest under each of the 2^10 signs; doubled, for mean and spread."""
    rng = np.random.default_rng(5)
    effects = [some(rng, 10, size, mean) for size, mean in ((1, 1.4), (2, 0.0), (1, 0.3))]
    scores = [scores_of(each) for each in effects]
    every = np.array(list(product([-1.0, 1.0], repeat=10)))
    lowest = np.min([log_p(score, every) for score in scores], axis=0)
    spread = np.exp(spread_log_p(effects))
    for k, (p, own) in enumerate(corrected_p(effects, scores, 3)):
        mean = log_p(scores[k], np.ones((1, 10)))[0]
        chance = np.mean(lowest <= mean + 1e-9)
        error = 5 * np.sqrt(chance * (1 - chance) / 4000) + 1 / 4000
        low, high = (min(1, 2 * min(max(c, min(1, 3 * stated_p(effects[k]))), 3 * spread[k])) for c in (chance - error, chance + error))
        assert low <= p <= high
        if k == 0:  # one of the draws and their signs as they are
            assert p / 2 * 4001 == pytest.approx(round(p / 2 * 4001), abs=1e-6)
        assert own == pytest.approx(min(mean, np.log(spread[k])))
    assert min(p for p, _ in corrected_p(effects, scores, 3)) < 0.2


@pytest.mark.parametrize("count", [1, 3])
def test_beyond_the_draws_a_p_value_is_that_of_as_many_independent_tests(count):
    """As many as make the catalogue's tenth percentile."""
    rng = np.random.default_rng(2)
    effects = [some(rng, 40, 2, 1.3 * (k == 0)) for k in range(count)]
    scores = [scores_of(each) for each in effects]
    lowest = np.min([log_p(score, rng.choice([-1.0, 1.0], (40_000, 40))) for score in scores], axis=0)
    own = np.exp(log_p(scores[0], np.ones((1, 40)))[0])
    tests = np.log(0.9) / np.log1p(-np.exp(np.quantile(lowest, 0.1)))
    ((p, _), *_) = corrected_p(effects, scores, 0)
    stated = count * stated_p(effects[0])
    assert p == pytest.approx(2 * max(tests * own, stated), rel=0.1)
    assert tests == pytest.approx(count, rel=0.15)


def test_the_mean_weighs_by_noise_and_spread_and_bounds_what_is_far():
    """The point where weighted deviations, bounded at three sigmas, add up to nothing."""
    rng = np.random.default_rng(3)
    for far in (0.0, 40.0):
        x, sigma = 2 + 1.5 * rng.normal(size=15), np.exp(rng.normal(size=15))
        x[4] += far

        def pull(m, x=x, sigma=sigma):
            wide = np.sqrt(sigma**2 + max(np.median((x - m) ** 2 / 0.4549364 - sigma**2), 0))
            return np.sum(np.clip((x - m) / wide, -3, 3) / wide)

        assert mean_of(x[:, None], sigma[:, None])[0] == pytest.approx(optimize.brentq(pull, 0, 4), abs=2e-3)


def test_correlations_shrink_for_few_units():
    z = np.random.default_rng(4).normal(size=(12, 2)) @ [[1.0, 0.8], [0, 0.6]]
    keep = 12 / (12 + 8)
    assert correlation_of(z) == pytest.approx(keep * np.corrcoef(z.T) + (1 - keep) * np.eye(2))
    assert correlation_of(z[:, :1]).tolist() == [[1]]


def test_a_units_share_is_generalised_least_squares_along_the_mean():
    rng = np.random.default_rng(5)
    effect = some(rng, 12, 2, np.array([2.0, -1.0]))
    effect.x[3] = np.nan
    share, sigma, mean = along(effect)
    told = effect.told
    assert mean == pytest.approx(mean_of(effect.x[told], effect.sigma[told]))
    C = correlation_of(np.clip((effect.x[told] - mean) / effect.sigma[told], -3, 3))
    for n in np.flatnonzero(told):
        inverse = np.linalg.inv(np.outer(effect.sigma[n], effect.sigma[n]) * C)
        weight = mean @ inverse @ mean
        assert share[n] == pytest.approx(mean @ inverse @ effect.x[n] / weight)
        assert sigma[n] == pytest.approx(weight**-0.5)
    assert np.isnan([share[3], sigma[3]]).all()


@pytest.mark.parametrize("size", [1, 2])
def test_what_remains_without_the_leaders_is_a_regressions_intercept(size):
    """Wilks' ratio of the residuals without and with the intercept, which for one number is the t-test of linear regression."""
    rng = np.random.default_rng(6)
    leader, effect = some(rng, 14, 1, 2.0), some(rng, 14, size, 0.8)
    effect.x[2] = np.nan
    effect.x[12], leader.x[13] = -200, 300  # what is far is bounded at nine sigmas, and at nine times the mean
    told = effect.told
    share = np.clip(along(leader)[0][told], -9, 9)
    z = np.clip(effect.x[told] / np.median(effect.sigma[told], axis=0), -9, 9)

    def left(design):
        residual = z - design @ np.linalg.lstsq(design, z, rcond=None)[0]
        return np.linalg.det(residual.T @ residual)

    X = np.column_stack([np.ones(13), share])
    ratio = left(X) / left(X[:, 1:])
    freedom = 13 - 2 - size + 1
    expected = stats.f.sf((1 - ratio) / ratio * freedom / size, size, freedom)
    assert beside_leaders(effect, [leader]) == pytest.approx(expected)
    if size == 1:
        line = stats.linregress(share, z[:, 0])
        assert expected == pytest.approx(2 * stats.t.sf(abs(line.intercept / line.intercept_stderr), 11))
    # With fewer than two units to spare nothing is said.
    for count, says in ((3 + size, False), (4 + size, True)):
        first = slice(3, 3 + count)
        few, led = (Estimates("a", each.names, each.x[first], each.sigma[first]) for each in (effect, leader))
        assert (beside_leaders(few, [led]) < 1) == says


def likelihood(y, s, part, wide):
    normal = lambda mean, sigma: np.exp(-0.5 * ((y - mean) / sigma) ** 2) / np.sqrt(2 * np.pi) / sigma  # noqa: E731
    return np.log(part * normal(1 / part, np.hypot(s, wide / part)) + (1 - part) * normal(0, s)).sum()


@pytest.mark.parametrize(("share", "wide"), [(0.3, 0.0), (0.6, 0.5), (1.0, 1.0), (1.0, 0.0), (0.5, 1.0)])
def test_the_share_of_units_is_the_likeliest_of_a_mixture(share, wide):
    rng = np.random.default_rng(int(10 * share + 100 * wide))
    s = np.exp(0.2 * rng.normal(size=60)) * 0.3
    y = np.where(rng.random(60) < share, (1 + wide * rng.normal(size=60)) / share, 0) + s * rng.normal(size=60)
    grid = {(part, w): likelihood(y, s, part, w) for part in np.arange(1, 42) / 41 for w in (0.0, 0.2, 0.5, 1.0)}
    best = max(grid, key=grid.get)
    whole = max((key for key in grid if key[0] == 1), key=grid.get)
    if grid[whole] > grid[best] - 1.92:
        best = whole
    assert mixture(y, s) == pytest.approx((best[0], 1 / best[0], best[1]))


@pytest.mark.parametrize(("gain", "all_units"), [(1.91, True), (1.93, False)])
def test_all_units_have_it_unless_a_share_is_likelier_by_chi_squares_five_percent(gain, all_units):
    """Thirty units at their mean, and a few without it whose noise is set so that the share gains just so much."""
    y, low, high = np.concatenate([np.ones(30), np.zeros(3)]), 0.2, 3.0

    def gained(sigma):
        s = np.concatenate([np.full(30, 0.1), np.full(3, sigma)])
        rows = {part: max(likelihood(y, s, part, wide) for wide in (0.0, 0.2, 0.5, 1.0)) for part in np.arange(1, 42) / 41}
        return max(rows.values()) - rows[1.0], s

    for _ in range(18):
        middle = (low + high) / 2
        low, high = (middle, high) if gained(middle)[0] > gain else (low, middle)
    assert gained(high)[0] == pytest.approx(gain, abs=1e-3)
    assert (mixture(y, gained(high)[1])[0] == 1.0) == all_units


def session(serial, **effects):
    """A session's estimates: of each effect, a pair of value and sigma for each of its numbers."""
    told = {
        name: Weighed({str(k): x for k, (x, _) in enumerate(pairs)}, {str(k): s for k, (_, s) in enumerate(pairs)}, 1.0, False)
        for name, pairs in effects.items()
    }
    empty = np.full((21, 21), np.nan)
    return UnitResult(f"{serial}{len(effects)}", serial, serial, empty[0], empty, effects=told)


def test_a_units_sessions_count_by_their_sigmas_and_a_blind_unit_not_at_all():
    lot = [session("A", a=[(1.0, 1.0), (5, 1)]), session("A", a=[(4.0, 0.5), (5, np.nan)]), session("B", a=[(2.0, 0.8), (3, 1)])]
    lot += [session("C", a=[(9.0, 24.0), (3, 1)]), session("D", a=[(9.0, 24.2), (3, 1)]), session("E", b=[(1.0, 1.0)])]
    (a,) = estimates_of(lot)  # of b, most units have none
    assert (a.id, a.names) == ("a", ("0", "1"))
    first = (1 + 4 * 4) / 5
    assert a.x[:2] == pytest.approx(np.array([[first, 5], [2, 3]]))
    assert a.sigma[:2] == pytest.approx(np.array([[5**-0.5, 1], [0.8, 1]]))
    assert a.told.tolist() == [True, True, True, True, False]
    usual = np.median([5**-0.5, 0.8, 0.8, 0.8])
    for sigma, seen in ((29.9 * usual, True), (30.1 * usual, False)):
        others = [session(f"u{k}", a=[(2.0, 0.8)]) for k in range(4)]
        (found,) = estimates_of([*others, session("F", a=[(9.0, sigma)])])
        assert found.told[4] == seen
    # A number that half of the units do not determine is left out, and an effect without any.
    half = [session(f"u{k}", a=[(1.0, 1.0), (2.0, 1.0 if k < 2 else np.nan)]) for k in range(4)]
    assert estimates_of(half)[0].names == ("0",)
    more = [session(f"u{k}", a=[(1.0, 1.0), (2.0, 1.0 if k < 3 else np.nan)]) for k in range(4)]
    assert estimates_of(more)[0].names == ("0", "1")
    assert estimates_of([session("A", a=[(1.0, np.nan)])]) == []


def test_of_very_many_units_all_are_drawn_as_probably(monkeypatch):
    """Three of five, over 1000 seeds; a unit's sessions come together or not at all."""
    monkeypatch.setattr("tinygc.annexes.lots.effects.MOST_UNITS", 3)
    sessions = [("A", 1.0), ("B", 2.0), ("A", 2.0), ("C", 3.0), ("D", 4.0), ("E", 5.0), ("E", 7.0)]
    lot = [session(serial, a=[(value, 1.0)]) for serial, value in sessions]
    drawn = [tuple(estimates_of(lot, seed)[0].x[:, 0]) for seed in range(1000)]
    assert drawn[0] == tuple(estimates_of(lot)[0].x[:, 0]) != drawn[1]
    assert {len(each) for each in drawn} == {3}
    # A is the mean of 1 and 2, E of 5 and 7.
    for value in (1.5, 2.0, 3.0, 4.0, 6.0):
        assert np.mean([value in each for each in drawn]) == pytest.approx(0.6, abs=5 * np.sqrt(0.24 / 1000))
    assert {len(set(each) & {1.5, 2.0, 3.0, 4.0, 6.0}) for each in drawn} == {3}
    monkeypatch.setattr("tinygc.annexes.lots.effects.MOST_UNITS", 8)
    many = [session(f"u{k}", a=[(9.0 + k, 1.0)]) for k in range(12)]
    plain, same, other = (pooled(many, *seed)["a"].mean for seed in ((), (0,), (1,)))
    assert plain == same != other


def test_what_is_reported_are_these_statistics():
    """A mean that all have: it and its spread. A part of the units: their mean, and no more spread than theirs."""
    rng = np.random.default_rng(3)
    all_have, part = (units(rng, 60, lambda n, s=step: at("b.three", [4.0 * (n % s == 0), 0, 0])) for step in (1, 2))
    for lot in (all_have, part):
        found = pooled(lot)["b.three"]
        (own,) = [each for each in estimates_of(lot) if each.id == "b.three"]
        share, sigma, mean = along(own)
        size, about, wide = mixture(share, sigma)
        among = np.sqrt(spread_about(own.x, own.sigma, mean))
        if size < 1:
            among = np.minimum(among, np.hypot(np.abs(mean * about) * wide, among * size))
        assert (found.share, found.units) == (size, 60)
        assert list(found.mean.values()) == pytest.approx(mean * about)
        assert list(found.spread.values()) == pytest.approx(among)
    assert size < 1


def test_seven_units_tell_nothing_and_eight_do():
    rng = np.random.default_rng(8)
    lot = units(rng, 8, lambda number: at("d.one", 9.0))
    assert list(pooled(lot)) == ["d.one"]
    assert pooled(lot[:7]) == {}
    assert pooled([]) == {}
