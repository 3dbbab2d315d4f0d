"""Evidence of sets of noise terms, limits, and what dependence between scales adds to sigmas."""

import numpy as np
import pytest
from resting import six, sums_of
from scipy.optimize import minimize
from scipy.stats import lognorm

from tinygc.annexes.noise import choice
from tinygc.annexes.noise.choice import ODDS, Chosen, Search
from tinygc.annexes.noise.dependence import sandwich
from tinygc.annexes.noise.likelihood import DECADES, PRIOR_VARIANCE, Fitted, autocovariance, cost
from tinygc.annexes.noise.scales import groups_of, rest_of

DT = 0.01


def search_of(seed, count=2**13, candidates=("B", "K", "R"), lines_hz=(), **sizes):
    rest = rest_of(sums_of(six(count, DT, seed, **sizes), DT))
    groups = groups_of([rest], 0, [rest.blocks.mean[:, 0]], [np.zeros((len(rest.blocks), 0))])
    return Search(groups, DT, lines_hz, candidates)


def value_at(search, names, z):
    return cost(np.exp(np.asarray(z)), [search.V[name] for name in names], search.stacks)[0]


def test_the_evidence_of_white_noise_is_its_integral():
    search = search_of(1, N=1.0)
    chosen = search.of(frozenset())
    z = np.log(chosen.fitted.x[0]) + np.linspace(-0.3, 0.3, 2001)
    values = np.array([value_at(search, ("N",), [each]) for each in z])
    integral = np.trapezoid(np.exp(-(values - values.min()) / 2), z)
    by_hand = np.log(integral) - values.min() / 2 - np.log(2 * DECADES * np.log(10))
    assert chosen.log_evidence == pytest.approx(by_hand, abs=0.01)


def test_the_evidence_of_a_further_term_is_its_integral_times_its_odds():
    search = search_of(2, N=1.0, K=2.0)
    chosen = search.of(frozenset("K"))
    n, k = (np.log(chosen.fitted.x[j]) + np.linspace(-w, w, 61) for j, w in ((0, 0.25), (1, 1.5)))
    values = np.array([[value_at(search, ("N", "K"), [a, b]) for b in k] for a in n])
    inner = np.trapezoid(np.exp(-(values - values.min()) / 2), k, axis=1)
    by_hand = np.log(np.trapezoid(inner, n)) - values.min() / 2 - 2 * np.log(2 * DECADES * np.log(10)) + np.log(ODDS)
    assert chosen.log_evidence == pytest.approx(by_hand, abs=0.1)  # Laplace's: the peak in K is not quite Gaussian


def test_a_filter_is_likely_behind_a_scale_that_was_left_out_and_no_term_of_the_finest():
    assert (choice.ODDS, choice.ODDS_OF_FILTER) == (0.2, 100.0)
    plain = search_of(9, N=1.0)
    assert "F" not in Search(plain.groups, DT).candidates
    behind = Search(plain.groups, DT, (), ("F", "Q"), is_behind_filter=True)
    assert behind.of(frozenset("FQ")) is None  # one is the other's negative
    filtered = behind.of(frozenset("F"))
    if filtered is not None:
        by_hand = -filtered.fitted.value / 2 + np.log(2 * np.pi) + np.linalg.slogdet(filtered.fitted.covariance)[1] / 2
        assert filtered.log_evidence == pytest.approx(by_hand - 2 * np.log(2 * DECADES * np.log(10)) + np.log(100), abs=1e-6)


def chosen_by_hand(log_evidence, **log_s_and_sigma):
    """A set with sizes of these logarithms and sigmas of them."""
    log_s, sigma = np.transpose(list(log_s_and_sigma.values()))
    information = np.diag(1 / (2 * sigma) ** 2 - 1 / PRIOR_VARIANCE)
    return Chosen(tuple(log_s_and_sigma), Fitted(np.exp(2 * log_s), 0.0, information), log_evidence)


def sets_by_hand():
    """Sets with the probabilities 1/8, 1/2, 1/8, 1/4 where B and K are as probable as not; one lacks K that has the finest N."""
    search = Search(search_of(10, N=1.0).groups, DT, (), ("Q", "B", "K"))
    search.tried = {
        frozenset(): chosen_by_hand(np.log(1.0), N=(0.1, 0.01)),
        frozenset("K"): chosen_by_hand(np.log(4.0 * ODDS), N=(0.05, 0.02), K=(1.0, 0.3)),
        frozenset("B"): chosen_by_hand(np.log(1.0 * ODDS), N=(0.03, 0.02), B=(0.5, 0.2)),
        frozenset("BK"): chosen_by_hand(np.log(2.0 * ODDS**2), N=(0.02, 0.02), B=(-0.5, 0.6), K=(0.4, 0.5)),
        frozenset("Q"): None,
    }
    return search


@pytest.mark.parametrize("wider", [1.0, 1.3])
def test_a_size_is_the_mean_over_all_sets_with_zero_where_one_lacks_it(wider):
    parts = {
        "N": [(1, 0.1, 0.01), (4, 0.05, 0.02), (1, 0.03, 0.02), (2, 0.02, 0.02)],
        "K": [(4, 1.0, 0.3), (2, 0.4, 0.5)],
        "B": [(1, 0.5, 0.2), (2, -0.5, 0.6)],
    }
    for name, sets in parts.items():
        weight, log_s, sigma = np.transpose(sets)
        own = [(w / 8, lognorm(wider * g, scale=np.exp(m))) for w, m, g in zip(weight, log_s, sigma, strict=True)]
        mean, square = (sum(w * each.moment(power) for w, each in own) for power in (1, 2))
        found = sets_by_hand().average(name, wider)
        assert found[:2] == pytest.approx((mean, np.sqrt(square - mean**2)), rel=1e-9)
        assert sum(w * each.sf(found[2]) for w, each in own) == pytest.approx(0.05, rel=1e-4)


def test_a_term_that_nearly_no_set_has_is_limited_to_none_by_them():
    search = sets_by_hand()
    search.tried[frozenset()] = chosen_by_hand(np.log(200.0), N=(0.1, 0.01))
    assert search.average("K")[2] == 0
    assert search.average("Q") == (0, 0, 0)


def test_names_are_held_to_their_odds_and_sizes_of_slow_terms_to_even_ones():
    assert choice.EVEN == {"B": 1, "K": 1}
    with_k = 4 * ODDS + 2 * ODDS**2
    assert sets_by_hand().probability("K") == pytest.approx(with_k / (1 + with_k + ODDS), rel=1e-12)


def test_the_trace_of_a_filter_is_that_of_any_filter():
    """Means of filtered white noise, longer than the filter's memory: their covariance is that of N and of F = N^2 times the moment."""
    taps = np.array([0.5, 0.3, 0.2])
    size = 50
    spread = np.convolve(taps, taps[::-1])  # autocovariance of the filtered noise, in N^2 / dt
    moment = np.sum(np.abs(np.arange(-2, 3)) * spread) * DT
    lag = np.arange(3)
    within = sum(spread[2 + d] * (size - abs(d)) for d in range(-2, 3)) / size**2 / DT
    across = sum(spread[2 - d] * d for d in (1, 2)) / size**2 / DT
    mean_s = size * DT
    model = autocovariance("N", lag, mean_s) + moment / 2 * autocovariance("F", lag, mean_s)
    assert model[0] == pytest.approx(within, rel=1e-9)
    assert model[1] == pytest.approx(across, rel=1e-9)
    assert model[2] == 0


@pytest.mark.parametrize(("name", "drop"), [("B", 1.645**2), ("Q", 2.0**2)])
def test_a_limit_is_where_the_likelihood_has_dropped_by_its_sigmas(name, drop):
    search = search_of(4, candidates=("Q", "B", "K", "R"), N=1.0)
    chosen = search.best()
    limit = search.limit(chosen, name)

    def profile(size):
        names = (*chosen.names, name)
        found = minimize(lambda z: value_at(search, names, [*z, 2 * np.log(size)]), np.log(chosen.fitted.x), method="Nelder-Mead")
        return found.fun

    lowest = min(chosen.fitted.value, *(profile(size) for size in np.geomspace(limit / 100, limit, 12)))
    assert profile(0.93 * limit) - lowest < drop < profile(1.07 * limit) - lowest


def test_a_correlation_time_at_the_finest_scale_is_the_filters():
    search = search_of(6, candidates=("G",), N=1.0)
    shortest, longest = search.bounds()
    assert shortest == pytest.approx(choice.SHORTEST_MEANS * DT)
    assert longest >= 4 * shortest
    values = six(2**13, DT, 6, N=1.0) + 3 * six(2**13, DT, 7, N=1.0, G=8.0, T=0.01)
    rest = rest_of(sums_of(values, DT))
    groups = groups_of([rest], 0, [rest.blocks.mean[:, 0]], [np.zeros((len(rest.blocks), 0))])
    assert Search(groups, DT, (), ("G",)).of(frozenset("G")) is None


def test_a_line_that_means_do_not_show_is_left_out():
    search = search_of(7, lines_hz=(2.0, 100.0), N=1.0)
    assert search.lines_hz == (2.0,)
    assert search.always == ("N", "line0")


def test_white_noise_has_no_dependence_between_scales():
    search = search_of(8, N=1.0)
    chosen = search.of(frozenset())
    assert np.allclose(sandwich(search, chosen), chosen.fitted.covariance, rtol=1e-9)


def test_dependence_between_scales_is_that_of_the_slope():
    """The sandwich, against the scatter of the likelihood's slope over many rests at the true sizes."""
    sizes, slopes = {"N": 1.0, "K": 10.0}, []
    for seed in range(150):
        rest = rest_of(sums_of(six(2**10, DT, seed, **sizes), DT))
        for channel in range(6):
            groups = groups_of([rest], channel, [rest.blocks.mean[:, channel]], [np.zeros((len(rest.blocks), 0))])
            search = Search(groups, DT, (), ("K",))
            x = np.array([1.0, 100.0])
            _, slope, curvature = cost(x, [search.V["N"], search.V["K"]], search.stacks)
            slopes.append(slope * x)
    bread = np.linalg.inv(curvature * np.outer(x, x) / 2 + np.eye(2) / PRIOR_VARIANCE)
    true = bread @ np.cov(np.array(slopes).T) @ bread / 4
    search.tried.clear()
    chosen = search.of(frozenset("K"))
    fixed = choice.replace(chosen, fitted=choice.replace(chosen.fitted, x=x, information=curvature * np.outer(x, x) / 2))
    stated = sandwich(search, fixed)
    assert stated[1, 1] / bread[1, 1] > 1.2
    assert np.sqrt(stated[1, 1] / true[1, 1]) == pytest.approx(1, abs=0.06)  # 900 rests: 2.4 % of a sigma, and its neglected ends
