"""Noise terms: covariances against IEEE 952, evidence by integration, sums of a rest by hand, and rests of known spectra given back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.signal import butter, lfilter
from scipy.special import ndtri
from scipy.stats import chi2, lognorm
from scipy.stats import f as f_distribution

from session.base.errors import DataError
from session.base.units import DEG, G
from session.log.samples import Samples
from tinygc.features.noise import choice, scales, summary
from tinygc.features.noise import choice as likelihood
from tinygc.features.noise.choice import (
    DECADES,
    Chosen,
    Fitted,
    Search,
    autocovariance,
    cost,
    stacked,
    stacks_of,
    unit_covariance,
)
from tinygc.features.noise.curve import fit_curve
from tinygc.features.noise.estimate import _allan_points, _axis, _relative, described, estimate_noise, known_after_s
from tinygc.features.noise.scales import Group, _apart, groups_of, knots_of, rest_of, temperature_part
from tinygc.features.noise.summary import RestSums, contrasts, ratios_of
from tinygc.inference.choose import ONE_SIDED
from tinygc.noise.figures import TERMS, AxisNoise, Line, Term, unit_allan_variance

DT, T = 0.01, 0.7
ABSENT = Term(0.0, None, 0.0)


def noisy(count, dt, rng, *, N=0.0, B=0.0, K=0.0, R=0.0, G=0.0, T=1.0):
    """Readings (count,), each a mean over its period, by formulas that the estimator does not share; flicker by fractional differences
    (Kasdin 1995)."""
    x = N / np.sqrt(dt) * rng.standard_normal(count) + R * dt * np.arange(count)
    if K:
        steps = np.sqrt(dt) * rng.standard_normal(count)
        x += K * (np.cumsum(steps) - steps / 2 + np.sqrt(dt / 12) * rng.standard_normal(count))
    if G:
        keep = np.exp(-dt / T)
        steps = G * np.sqrt(1 - keep**2) * rng.standard_normal(count)
        steps[0] = G * rng.standard_normal()
        x += lfilter([1.0], [1.0, -keep], steps)
    if B:
        many = 4 * count
        k = np.arange(1, many)
        response = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
        spectrum = np.fft.rfft(rng.standard_normal(many), 2 * many) * np.fft.rfft(response, 2 * many)
        x += B * np.fft.irfft(spectrum)[many - 2 * count : many].reshape(count, 2).mean(axis=1)
    return x


def six(count, seed, dt=DT, **sizes):
    rng = np.random.default_rng(seed)
    return np.column_stack([noisy(count, dt, rng, **sizes) for _ in range(6)])


def samples_of(values, dt=DT, temp_c=None, start_s=0.0):
    t_ns = np.round((np.arange(len(values)) * dt + start_s) * 1e9).astype(np.int64)
    return Samples(t_ns, values[:, :3], values[:, 3:], temp_c)


def sums_of(values, dt=DT, temp_c=None):
    sums = RestSums(1 / dt)
    sums.add(samples_of(values, dt, temp_c))
    return sums


def gyro_alone(values):
    """Without an accelerometer, which would take as long again."""
    return np.hstack([values[:, :3], np.full((len(values), 3), np.nan)])


def groups(*sums, channel=0):
    rests = [rest_of(each) for each in sums]
    return groups_of(rests, channel, [rest.blocks.mean[:, channel] for rest in rests], [np.zeros((len(rest.blocks), 0)) for rest in rests])


def chosen_terms(axis):
    return [name for name in TERMS if axis.terms[name].chosen]


# Covariances and the likelihood


def window(count, size=1):
    return Group(size, np.arange(count), contrasts(count), np.eye(count - 1), 1.0)


@pytest.mark.parametrize("name", TERMS)
def test_two_means_have_the_allan_variance_of_ieee_952(name):
    for size in (1, 700):
        (variance,) = unit_covariance(name, [window(2, size)], DT, T)
        assert variance[0, 0] == pytest.approx(unit_allan_variance(name, np.array([size * DT]), T)[0], rel=1e-9)


DENSITY = {
    "N": lambda f: 1.0,
    "B": lambda f: 1 / (2 * np.pi * f),
    "K": lambda f: 1 / (2 * np.pi * f) ** 2,
    "G": lambda f: 2 * T / (1 + (2 * np.pi * f * T) ** 2),
}


@pytest.mark.parametrize("name", DENSITY)
def test_a_contrast_of_four_means_has_the_variance_of_its_density(name):
    (C,) = unit_covariance(name, [window(4, 10)], DT, T)
    mean_s, (nodes, weights) = 10 * DT, np.polynomial.legendre.leggauss(40)
    f = (np.arange(400)[:, None] + (nodes + 1) / 2) / (4 * mean_s)
    gain = np.abs(np.exp(2j * np.pi * f[..., None] * mean_s * np.arange(4)) @ contrasts(4)[:, 1]) ** 2 * np.sinc(f * mean_s) ** 2
    expected = np.sum(2 * DENSITY[name](f) * gain @ weights) / (8 * mean_s)
    assert C[1, 1] == pytest.approx(expected, rel=3e-3 if name == "N" else 1e-4)


def test_a_line_has_its_power_is_averaged_and_counts_in_the_allan_variance():
    """Of rms 1 and any phase: the product of two means is the real part of that of rotating vectors."""
    means = np.exp(2j * np.pi * 1.3 * 0.4 * np.arange(80_000) / 10_000).reshape(8, -1).mean(axis=1)
    y = means @ contrasts(8)
    (C,) = unit_covariance("line", [window(8, 40)], DT, hz=1.3)
    assert np.allclose(C, np.outer(y, y.conj()).real, atol=1e-3)
    axis = AxisNoise(dict.fromkeys(TERMS, ABSENT), (Line(1.3, 0.5),))
    assert axis.allan_variance(np.array([0.4]))[0] == pytest.approx(0.5**2 * abs(means[1] - means[0]) ** 2 / 2, rel=1e-3)


def test_the_trace_of_a_filter_is_that_of_any_filter():
    """Means of filtered white noise, longer than the filter's memory: their covariance is that of N and of F = N^2 times the moment."""
    taps = np.array([0.5, 0.3, 0.2])
    size = 50
    spread = np.convolve(taps, taps[::-1])  # autocovariance of the filtered noise, in N^2 / dt
    moment = np.sum(np.abs(np.arange(-2, 3)) * spread) * DT
    lag = np.arange(3)
    within = sum(spread[2 + d] * (size - abs(d)) for d in range(-2, 3)) / size**2 / DT
    across = sum(spread[2 - d] * d for d in (1, 2)) / size**2 / DT
    model = autocovariance("N", lag, size * DT) + moment / 2 * autocovariance("F", lag, size * DT)
    assert model == pytest.approx([within, across, 0], rel=1e-9)


@pytest.fixture(scope="module")
def real():
    return groups(sums_of(six(20_000, 1, N=1.0, B=0.5, K=0.2)))


def test_slope_and_curvature_are_those_of_the_value_of_expected_data(real):
    x, names = np.array([1.0, 0.3, 0.02]), "NBK"
    V = [unit_covariance(name, real, DT) for name in names]
    expected = [replace(g, S=g.count * sum(s * v[k] for s, v in zip(x, V, strict=True))) for k, g in enumerate(real)]
    stacks = stacks_of(expected)
    V = [stacked(own, stacks) for own in V]

    def change(at, step, which):
        up, down = (cost(at + sign * step, V, stacks)[which] for sign in (1, -1))
        return (up - down) / (2 * step.max())

    beside = 1.1 * x
    for slope, step in zip(cost(beside, V, stacks)[1], 1e-5 * np.diag(x), strict=True):
        assert change(beside, step, 0) == pytest.approx(slope, rel=1e-5)
    _, slope, curvature = cost(x, V, stacks)
    assert np.allclose(slope * x, 0, atol=1e-6)
    for own, step in zip(curvature, 1e-4 * np.diag(x), strict=True):
        assert np.allclose(change(x, step, 1), own, rtol=1e-4, atol=1e-4 * np.abs(own).max())


def test_white_noise_alone_is_its_mean_square(real):
    found = Search(real, DT).of(frozenset()).fitted
    freedom = sum(g.count * len(g.S) for g in real)
    by_hand = sum(float(np.trace(g.S)) * g.size * DT for g in real) / freedom
    assert found.x[0] == pytest.approx(by_hand, rel=1e-5)
    # The prior of ln s^2 is flat over three decades of s
    assert 1 / found.covariance[0, 0] == pytest.approx(freedom / 2 + 12 / (6 * np.log(10)) ** 2, rel=1e-9)


def test_the_allan_deviation_is_that_of_allantools():
    allantools = pytest.importorskip("allantools", reason="AllanTools is not installed: pip install -e '.[test]'")
    sizes = {"N": 1.0, "B": 0.5, "K": 0.1}
    values = six(2**16, 3, **sizes)
    terms = {name: Term(size, 0.1, 1.0) for name, size in sizes.items()}
    points = _allan_points(groups(sums_of(values)), DT, AxisNoise(dict.fromkeys(TERMS, ABSENT) | terms))
    tau_s, deviation, _, _ = allantools.oadev(values[:, 0], rate=1 / DT, data_type="freq", taus=[p[0] for p in points])
    theirs = dict(zip(np.round(tau_s, 6), deviation, strict=True))
    apart = [np.log(own / theirs[at]) / np.log(high / own) for tau, own, _, high in points if (at := np.round(tau, 6)) in theirs]
    assert len(apart) >= len(points) - 1 >= 13
    # windows hold fewer pairs than all that overlap: they differ, by less than the error of either
    assert np.sqrt(np.mean(np.square(apart))) < 1
    assert max(map(abs, apart)) < 2.5


def test_one_pair_in_each_window_has_a_chi_square_of_as_many_freedoms():
    """White noise in 9 windows of 4 means: at two means each window holds one difference."""
    group = replace(window(4), S=9 * np.diag([1.0, 2.0, 0.5]), count=9.0)
    axis = AxisNoise(dict.fromkeys(TERMS, ABSENT) | {"N": Term(1.0, 0.1, 1.0)})
    (_, one, _, _), (_, two, low, high) = _allan_points([group], DT, axis)
    values = contrasts(4) @ np.diag([1.0, 2.0, 0.5]) @ contrasts(4).T  # covariance of the means
    difference = np.array([-0.5, -0.5, 0.5, 0.5])
    assert two**2 == pytest.approx(difference @ values @ difference / 2)
    assert one**2 == pytest.approx(np.mean([d @ values @ d for d in np.diff(np.eye(4), axis=0)]) / 2)
    assert low == pytest.approx(two * np.sqrt(9 / chi2.ppf(0.84, 9)))
    assert high == pytest.approx(two * np.sqrt(9 / chi2.ppf(0.16, 9)))


# Which terms: the evidence of sets


def search_of(seed, count=2**13, candidates=("B", "K", "R"), lines_hz=(), **sizes):
    return Search(groups(sums_of(six(count, seed, **sizes))), DT, lines_hz, candidates)


def value_at(search, names, z):
    return cost(np.exp(np.asarray(z)), [search.V[name] for name in names], search.stacks)[0]


def test_the_evidence_is_the_integral_over_sizes_times_the_odds_of_a_further_term():
    search = search_of(2, 2**12, N=1.0, K=2.0)
    chosen = search.of(frozenset("K"))
    n, k = (np.log(chosen.fitted.x[j]) + np.linspace(-w, w, 21) for j, w in ((0, 0.35), (1, 2.0)))
    values = np.array([[value_at(search, ("N", "K"), [a, b]) for b in k] for a in n])
    inner = np.trapezoid(np.exp(-(values - values.min()) / 2), k, axis=1)
    by_hand = np.log(np.trapezoid(inner, n)) - values.min() / 2 - 2 * np.log(2 * DECADES * np.log(10)) + np.log(choice.ODDS)
    assert chosen.log_evidence == pytest.approx(by_hand, abs=0.1)  # Laplace's: the peak in K is not quite Gaussian


def test_a_filter_is_likely_behind_a_scale_that_was_left_out_and_no_term_of_the_finest():
    values = lfilter(*butter(1, 0.2), np.random.default_rng(0).standard_normal((2**14, 6)) / np.sqrt(DT), axis=0)
    every = groups(sums_of(values))
    assert "F" not in Search(every, DT).candidates
    search = Search([group for group in every if group.size > 1], DT, (), ("F", "Q"), is_behind_filter=True)
    assert search.of(frozenset("FQ")) is None  # one is the other's negative
    filtered = search.of(frozenset("F"), search.of(frozenset()))
    by_hand = -filtered.fitted.value / 2 + np.log(2 * np.pi) + np.linalg.slogdet(filtered.fitted.covariance)[1] / 2
    assert filtered.log_evidence == pytest.approx(by_hand - 2 * np.log(2 * DECADES * np.log(10)) + np.log(100), abs=1e-6)


def chosen_by_hand(log_evidence, **log_s_and_sigma):
    """A set with sizes of these logarithms and sigmas of them."""
    log_s, sigma = np.transpose(list(log_s_and_sigma.values()))
    information = np.diag(1 / (2 * sigma) ** 2 - 1 / likelihood.PRIOR_VARIANCE)
    return Chosen(tuple(log_s_and_sigma), Fitted(np.exp(2 * log_s), 0.0, information), log_evidence)


def sets_by_hand():
    """Sets with the probabilities 1/8, 1/2, 1/8, 1/4 where B and K are as probable as not; one lacks K that has the finest N."""
    search = Search(search_of(10, 2**11, N=1.0).groups, DT, (), ("Q", "B", "K"))
    odds = choice.ODDS
    search.tried = {
        frozenset(): chosen_by_hand(np.log(1.0), N=(0.1, 0.01)),
        frozenset("K"): chosen_by_hand(np.log(4.0 * odds), N=(0.05, 0.02), K=(1.0, 0.3)),
        frozenset("B"): chosen_by_hand(np.log(1.0 * odds), N=(0.03, 0.02), B=(0.5, 0.2)),
        frozenset("BK"): chosen_by_hand(np.log(2.0 * odds**2), N=(0.02, 0.02), B=(-0.5, 0.6), K=(0.4, 0.5)),
        frozenset("Q"): None,
    }
    return search


def test_a_size_is_the_mean_over_all_sets_with_zero_where_one_lacks_it():
    wider, parts = (
        1.3,
        {
            "N": [(1, 0.1, 0.01), (4, 0.05, 0.02), (1, 0.03, 0.02), (2, 0.02, 0.02)],
            "K": [(4, 1.0, 0.3), (2, 0.4, 0.5)],
            "B": [(1, 0.5, 0.2), (2, -0.5, 0.6)],
        },
    )
    for name, sets in parts.items():
        weight, log_s, sigma = np.transpose(sets)
        own = [(w / 8, lognorm(wider * g, scale=np.exp(m))) for w, m, g in zip(weight, log_s, sigma, strict=True)]
        mean, square = (sum(w * each.moment(power) for w, each in own) for power in (1, 2))
        assert sets_by_hand().average(name, wider) == pytest.approx((mean, np.sqrt(square - mean**2)), rel=1e-9)


def test_names_are_held_to_their_odds_and_what_no_set_has_is_nothing():
    search, odds = sets_by_hand(), choice.ODDS
    with_k = 4 * odds + 2 * odds**2
    assert search.probability("K") == pytest.approx(with_k / (1 + with_k + odds), rel=1e-12)
    assert search.average("Q") == (0, 0)


@pytest.mark.parametrize(("name", "drop"), [("B", ONE_SIDED**2), ("Q", 2.0**2)])
def test_a_limit_is_where_the_likelihood_has_dropped_by_its_sigmas(name, drop):
    search = search_of(4, candidates=("Q", "B", "K", "R"), N=1.0)
    chosen = search.of(frozenset())
    limit = search.limit(chosen, name)

    def profile(size):
        about = np.log(chosen.fitted.x[0]) + np.array([-0.1, 0.1])
        of_n = lambda z: value_at(search, ("N", name), [z, 2 * np.log(size)])  # noqa: E731
        return minimize(lambda z: of_n(z[0]), about[:1] + 0.1, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-4}).fun

    lowest = min(chosen.fitted.value, *(profile(size) for size in np.geomspace(limit / 30, limit, 6)))
    assert profile(0.93 * limit) - lowest < drop < profile(1.07 * limit) - lowest


def test_a_correlation_time_is_of_ten_finest_means_or_more_and_a_thirtieth_of_the_rest_or_less():
    for count, longest_s in ((2**9, 0.4), (2**13, 81.92 / 30)):  # but four times the shortest in any case
        assert search_of(7, count, N=1.0).bounds_s == pytest.approx((0.1, longest_s))


def test_a_line_that_means_do_not_show_is_left_out():
    assert search_of(7, 2**11, lines_hz=(2.0, 100.0), N=1.0).always == ("N", "line0")


# Sums of a rest


@pytest.mark.parametrize("count", [2, 3, 16])
def test_contrasts_are_orthonormal_and_have_no_mean(count):
    H = contrasts(count)
    assert np.allclose(H.T @ H, np.eye(count - 1), atol=1e-14)
    assert np.allclose(H.sum(axis=0), 0, atol=1e-14)


def test_a_block_is_the_power_of_two_of_about_half_a_second_in_windows_of_at_most_sixteen():
    assert [RestSums(hz).size for hz in (1.0, 10.0, 127.0, 129.0)] == [16, 16, 32, 64]
    assert (RestSums(100.0).period_s, RestSums(100.0).lost, RestSums(100.0).duration_s) == (0.01, 0.0, 0.0)
    assert [ratios_of(size) for size in (16, 32, 256, 2048)] == [(16,), (8, 4), (16, 16), (16, 16, 8)]


def test_the_finest_sums_are_those_of_all_windows_and_pieces_do_not_matter():
    values = six(40_000, 2, N=1.0, K=0.3)
    at_once, by_pieces = sums_of(values), RestSums(1 / DT)
    for start in range(0, len(values), 13):
        by_pieces.add(samples_of(values[start : start + 13], start_s=start * DT))
    for one, other in zip(groups(at_once), groups(by_pieces), strict=True):
        assert (one.size, one.count) == (other.size, other.count)
        assert np.allclose(one.S, other.S, rtol=1e-10)
    finest, ratio = groups(at_once, channel=2)[0], at_once.ratios[0]
    z = (values[:, 2] - values[0, 2]).reshape(-1, ratio) @ contrasts(ratio)
    assert finest.count == len(z)
    assert np.allclose(finest.S, z.T @ z, rtol=1e-12)
    assert len(at_once.ended()[2]) <= summary.MOST_CHUNKS + 1  # neighbours are joined beyond
    assert by_pieces.period_s == pytest.approx(DT, rel=1e-9)
    assert by_pieces.duration_s == pytest.approx((len(values) - 1) * DT)


def test_sections_are_spread_over_the_rest(monkeypatch):
    monkeypatch.setattr(summary, "MOST_SECTIONS", 4)
    number = np.repeat(np.arange(13.0), summary.SECTION)
    sections = sums_of(np.repeat(number[:, None], 6, axis=1)).sections
    assert (sections == sections[:, :1, :1]).all()
    assert sections[:, 0, 5].tolist() == [0, 4, 8, 12]


def test_no_window_spans_a_gap_and_the_coarsest_vector_keeps_its_time():
    values = six(12_832, 4, N=1.0)  # 12 and 20 beyond whole blocks: one and two windows of eight, and four that are in none
    values[6412:] += 100.0  # what a window across the gap would hold
    sums = RestSums(1 / DT)
    sums.add(samples_of(values[:6412]))
    sums.add(samples_of(values[6412:], start_s=64.0 + 32.0))
    found = groups(sums)
    assert found[0].count == 12_824 / sums.ratios[0]
    assert max(np.diag(found[0].S)) / found[0].count < 2 / DT
    blocks = rest_of(sums).blocks
    assert blocks.number[-1] - blocks.number[0] == 399 + 100
    assert sums.duration_s == pytest.approx(128.3)


def test_a_ramp_is_exact_where_the_last_mean_lacks_a_part():
    count = 32 * 1023  # the last of the coarsest means has 15 of its 16 blocks
    values = np.repeat((np.arange(count) * 0.01)[:, None], 6, axis=1) + 1e-6 * six(count, 1, N=1.0)
    top = groups(sums_of(values))[-1]
    assert top.top
    assert scales.TOP / 9 < len(top.at) <= scales.TOP
    t = top.t() * top.size * 0.01
    assert top.middle[-1] == pytest.approx(top.at[-1] - 1 / 64, abs=1e-9)
    assert np.sqrt(np.trace(top.S)) == pytest.approx(np.linalg.norm(t), rel=1e-6)


def test_logs_whose_blocks_differ_are_both_used():
    """Clocks of 127 and 129 Hz: their blocks are of 32 and 64 samples."""
    slow, fast = (sums_of(six(2**13, seed, 1 / hz, N=1.0), 1 / hz) for seed, hz in ((3, 127), (4, 129)))
    assert slow.size != fast.size
    both, *alone = (sum(group.count * len(group.S) for group in groups(*sums)) for sums in ((slow, fast), (slow,), (fast,)))
    assert both == sum(alone)


def test_the_limit_of_a_peak_is_that_of_gaussian_noise():
    rng = np.random.default_rng(11)
    peaks = np.abs(rng.standard_normal((40_000, 32))).max(axis=1)
    none = np.zeros(len(peaks), bool)
    assert not scales.above_chance(peaks, none, 32).any()
    far = -ndtri(1e-3 / (2 * 32 * len(peaks)))
    peaks[:2] = 1.2 * far, 1.3 * far
    assert scales.above_chance(peaks, none, 32)[:2].tolist() == [False, True]


def test_a_knock_a_stuck_register_and_a_noisy_spell_are_left_out():
    values = six(60_000, 7, N=1.0)
    values[10_000:10_008] += 200.0
    values[30_000:30_400] = values[30_000]
    values[45_000:47_000, 4] *= 2
    sums = sums_of(values)
    rest = rest_of(sums)
    number = rest.blocks.number[rest.bad] * 32

    def left_out(start, stop):
        return np.count_nonzero((number >= start) & (number < stop))

    assert left_out(9984, 10_016) == 1
    assert left_out(30_016, 30_368) == 11
    assert left_out(45_000, 46_960) >= 60
    assert len(number) < 140
    said = scales.left_out([rest])
    assert [line.split(":")[0] for line in said] == ["Readings stand still", "Knocks", "Spells noisier than the rest"]
    assert "(from 99.52 s on)" in said[1]
    assert sum(rest.seconds.values()) == pytest.approx(len(number) * rest.block_s)
    clean = groups(sums, channel=4)[0]
    assert np.trace(clean.S) / clean.count / len(clean.S) * DT == pytest.approx(1, abs=0.03)


def test_temperature_is_taken_out_of_fine_scales_and_costs_the_coarsest_its_columns():
    count = 2**15
    temp_c = 30 + 20 * np.sin(2 * np.pi * np.arange(count) / count)
    rest = rest_of(sums_of(six(count, 17, N=1.0) + 40.0 * (temp_c - 30)[:, None], temp_c=temp_c))
    residuals, columns, _ = temperature_part([rest], 0, knots_of([rest]))
    order = columns[0].shape[1]
    assert order >= 1
    raw = groups_of([rest], 0, [rest.blocks.mean[:, 0]], [np.zeros((len(rest.blocks), 0))])
    less = groups_of([rest], 0, residuals, columns)
    assert less[-1].basis.shape[1] == raw[-1].basis.shape[1] - order
    size = sorted(group.size for group in less)[1]
    (level,), (before,) = ([group for group in each if group.size == size] for each in (less, raw))
    white = level.count * len(level.S) / (size * DT)
    assert np.trace(before.S) > 1.1 * white
    assert np.trace(level.S) == pytest.approx(white, rel=0.04)
    for warmer, changes in ((0.9, False), (1.2, True)):
        assert (knots_of([rest_of(sums_of(six(2**13, 1, N=1.0), temp_c=np.linspace(25, 25 + warmer, 2**13)))]) is not None) == changes


# One estimate


@pytest.fixture(scope="module")
def mixed():
    """A rest whose channels differ: white noise, and beside it K, B, R, G, and a line."""
    rng, count = np.random.default_rng(5), 2**15
    sizes = ({}, {"K": 1.0}, {"B": 1.2}, {"R": 0.1}, {"G": 2.0, "T": 2.0}, {})
    values = np.column_stack([noisy(count, DT, rng, N=1.0, **each) for each in sizes])
    values[:, 5] += 2.0 * np.sin(2 * np.pi * 1.7 * DT * np.arange(count))
    return estimate_noise([sums_of(values)]), values


def test_one_rest_gives_back_what_went_in(mixed):
    (figures, said, _), _ = mixed
    axes = [axis for sensor in figures.sensors().values() for axis in sensor.axes]
    assert [chosen_terms(axis) for axis in axes] == [["N"], ["N", "K"], ["N", "B"], ["N", "R"], ["N", "G"], ["N"]]
    for axis, (name, size) in zip(axes, (("N", 1.0), ("K", 1.0), ("B", 1.2), ("R", 0.1), ("G", 2.0), ("N", 1.0)), strict=True):
        for each, true in (("N", 1.0), (name, size)):
            assert abs(axis.value(each) - true) < 3.5 * axis.terms[each].sigma < 0.9 * true
        assert axis.is_described
    assert axes[0].terms["N"].sigma < 0.01
    assert axes[1].terms["B"].at_most is not None
    assert abs(axes[4].terms["G"].tau_s - 2.0) < 3.5 * axes[4].terms["G"].tau_sigma_s
    (line,) = axes[5].lines  # and no flicker
    assert (line.hz, line.rms) == (pytest.approx(1.7, abs=0.01), pytest.approx(2.0 / np.sqrt(2), rel=0.1))
    assert (figures.rate_hz, figures.samples, said) == (pytest.approx(100), 2**15, [])


def test_a_ramp_is_a_slope_with_the_sigma_of_least_squares(mixed):
    (figures, _, _), values = mixed
    t = DT * np.arange(len(values))
    by_hand = 1 / np.sqrt(DT * np.sum((t - t.mean()) ** 2))
    term = figures.accel.axes[0].terms["R"]
    assert term.value == pytest.approx(np.polyfit(t, values[:, 3], 1)[0], abs=0.1 * by_hand)
    assert term.sigma == pytest.approx(by_hand, rel=0.05)


def test_how_long_to_record_is_what_that_length_gives(mixed):
    figures = mixed[0][0]
    axis, length, period_s = figures.gyro.axes[1], figures.duration_s, 1 / figures.rate_hz
    terms = tuple((name, axis.value(name), None) for name in "NK")
    stated = axis.terms["K"].sigma / axis.value("K")
    needed_s = known_after_s(figures, "gyro", 1, "K", 0.1)
    more = stated / _relative(terms, "K", length, period_s, 0.0)
    assert more * _relative(terms, "K", needed_s, period_s, 0.0) == pytest.approx(0.1, rel=0.03)
    # what is stated now is known after just the present length
    assert known_after_s(figures, "gyro", 1, "K", stated) == pytest.approx(length, rel=0.03)
    assert _relative((("N", 1.0, None),), "N", 1000.0, DT, 0.0) == pytest.approx(1 / np.sqrt(2 * 1000 / DT), rel=0.02)


@pytest.mark.parametrize(
    ("rests", "says"),
    [
        (lambda: [sums_of(six(2000, 1, dt, N=1.0), dt) for dt in (DT, 1 / 104)], "100 and 104 Hz"),
        (lambda: [RestSums(100.0)], "no readings at rest"),
        (lambda: [sums_of(np.ones((5000, 6)))], "do not change"),
        (lambda: [sums_of(six(600, 1, N=1.0) * [1, 0, 0, 0, 0, 0])], "axis y z"),
        (lambda: [sums_of(np.full((100, 6), np.nan))], "no numbers"),
        (lambda: [RestSums(0.0)], "data rate"),
    ],
)
def test_rests_that_give_no_estimate_are_refused(rests, says):
    with pytest.raises(DataError, match=says):
        estimate_noise(rests())


def test_a_swing_without_its_temperature_is_not_called_white():
    """No set describes it, and N is what the fine scales say."""
    values = six(2**13, 4, N=1.0) + 50 * np.cos(2 * np.pi * np.arange(2**13) / 2**12)[:, None]
    axis = _axis(groups(sums_of(values)), DT, ())
    assert not axis.is_described
    assert axis.value("N") == pytest.approx(1, abs=0.05)


def test_two_variances_differ_by_fishers_f_of_their_own_freedom():
    """3 of 10 degrees of freedom against 1 of 40, either way about; 1.5 is not worth a sentence."""
    p_value = 2 * f_distribution(10, 40).sf(3.0)
    for order, high in (([0, 1], 0), ([1, 0], 1)):
        found = _apart(np.array([30.0, 40.0])[order], np.array([10.0, 40.0])[order])
        assert found == (pytest.approx(p_value), high, pytest.approx(np.sqrt(3)))
    assert _apart(np.array([15.0, 40.0]), np.array([10.0, 40.0]))[0] == 1


def test_of_stills_that_are_too_short_for_halves_nothing_is_said():
    stills = [sums_of(six(2**8, seed, N=1.0)) for seed in range(12)]
    assert not any("half" in line for line in estimate_noise(stills).remarks)


def test_what_is_wrong_with_a_rest_is_said():
    values, other = (six(2**13, seed, N=1.0) for seed in (13, 14))
    values[5000:, 0] *= 1.5
    other[:, 2] *= 1.3
    for each in (values, other):
        each[:, 1] = np.round(each[:, 1] / 30) * 30
        each[:, 4] = 9.81
    figures, said, _ = estimate_noise([sums_of(values), sums_of(other)])
    assert figures.accel is None
    said = " ".join(said)
    for words in (
        "gyro x: over 0.04 s, the noise of its second half is 1.4 times that of the other",
        "moves over 3 steps",
        "accel y: its readings do not change",
        "gyro z: log 2 is 1.3 times as noisy as log 1",
    ):
        assert words in said, (words, said)


def test_readings_that_are_missing_do_not_make_n_larger():
    whole = samples_of(gyro_alone(six(2**13, 12, N=1.0)))
    sums = RestSums(90.0)
    sums.add(whole.pick(np.random.default_rng(0).random(2**13) > 0.1))
    figures, said, _ = estimate_noise([sums])
    assert (sums.lost, sums.period_s) == (pytest.approx(0.11, abs=0.01), pytest.approx(DT, rel=1e-9))
    assert said[0].startswith("10 % of the readings are missing")
    assert (figures.accel, set(figures.allan)) == (None, {"gyro"})
    for axis in figures.gyro.axes:
        assert abs(axis.value("N") - 1) < 3.5 * axis.terms["N"].sigma
    jittered = RestSums(100.0)  # stamps that are no multiples of one period tell nothing of losses
    jitter = np.random.default_rng(1).integers(-4_000_000, 4_000_000, 2**13)
    jittered.add(Samples(whole.t_ns + jitter, whole.gyro, whole.accel, None))
    assert jittered.lost == 0


def test_a_sensors_filter_leaves_n_right_within_its_sigma():
    white = np.random.default_rng(3).standard_normal((34_000, 6)) / np.sqrt(DT)
    axis = _axis(groups(sums_of(lfilter(*butter(1, 0.2), white, axis=0)[4000:])), DT, ())
    assert axis.from_s > 0
    assert abs(axis.value("N") - 1) < 3 * axis.terms["N"].sigma < 0.15


def test_b_is_not_taken_from_a_log_whose_temperature_moves_the_zero_by_more():
    count = 2**14
    temp_c = 30 - 10 * np.cos(4 * np.pi * np.arange(count) / count)
    values = gyro_alone(six(count, 5, N=1.0, B=2.0)) + 5.0 * (temp_c - 30)[:, None] * [1, 0, 0, 0, 0, 0]
    figures, said, _ = estimate_noise([sums_of(values, temp_c=temp_c)])
    assert any("temperature moves it by" in line and "B is a limit" in line for line in said)
    moved, *still = (axis.terms["B"] for axis in figures.gyro.axes)
    assert all(term.is_determined for term in still)
    assert (moved.chosen, moved.is_determined) == (True, False)
    assert moved.at_most == pytest.approx(moved.value + ONE_SIDED * moved.sigma)
    assert known_after_s(figures, "gyro", 0, "B") == np.inf


def test_a_misfit_widens_sigmas_and_a_change_of_n_is_in_its_sigma():
    search = Search(groups(sums_of(six(2**13, 15, N=1.0, G=3.0, T=2.0))), DT)
    chosen = search.of(frozenset("G"))
    of_time = np.sqrt(chosen.fitted.covariance[-1, -1])
    for p, times, change in ((0.5, 1.0, 0.0), (1e-4, 1.2, 0.0), (0.5, 1.0, 0.3)):
        terms = described(search, chosen, p, 1.44, 0.0, change).terms
        for name, moved in (("N", change), ("G", 0.0)):
            value, sigma = search.average(name, times)
            assert (terms[name].value, terms[name].sigma) == pytest.approx((value, np.hypot(sigma, moved * value)), rel=1e-9)
        assert terms["G"].tau_sigma_s == pytest.approx(times * terms["G"].tau_s * of_time, rel=1e-9)


# A curve that somebody else made, and real rests


def test_an_exact_curve_gives_back_its_terms():
    tau_s, sizes = np.logspace(-1, 3.5, 60), {"N": 1.0, "B": 0.4, "K": 0.02}
    variance = sum(size**2 * unit_allan_variance(name, tau_s) for name, size in sizes.items())
    (axis,) = fit_curve(tau_s, np.sqrt(variance)[:, None], 70_000.0)
    assert chosen_terms(axis) == ["N", "B", "K"]
    assert [axis.value(name) for name in sizes] == pytest.approx(list(sizes.values()), rel=0.02)
    with pytest.raises(DataError, match="octaves"):
        fit_curve(np.array([1.0, 2.0, 4.0]), np.ones((3, 1)), 1000.0)


def test_a_published_curve_gives_the_published_densities(shared):
    table = np.loadtxt(shared / "wild" / "d455_allan.csv")
    (axis,) = fit_curve(table[:, 0], np.sqrt(np.mean(table[:, 4:] ** 2, axis=1))[:, None] * DEG, 20.5 * 3600)
    assert axis.value("N") == pytest.approx(1.0272e-4, rel=0.15)
    assert max(axis.value("K"), axis.value("G") * np.sqrt(2 / (axis.terms["G"].tau_s or 1))) == pytest.approx(1.1106e-6, rel=0.4)


#: axis y of two units: degrees per root hour, and degrees per hour per root hour, of a separate analysis (../shared/wild/README.md)
STATED = {1: {"N": 2.54, "K": 119}, 3: {"K": 9}}


@pytest.mark.broad
@pytest.mark.parametrize("unit", STATED)
def test_units_at_rest_agree_with_a_separate_analysis(unit, shared):
    log = np.load(shared / "wild" / f"adis16405_imu{unit}.npz")
    dt = 1 / float(log["rate_hz"])
    axis = _axis(groups(sums_of(np.column_stack([log["gyro_dps"] * DEG, log["accel_g"] * G]), dt), channel=1), dt, ())
    for name, value in STATED[unit].items():
        term, size = axis.terms[name], value * (DEG / 60 if name == "N" else DEG / 3600 / 60)
        if term.chosen:  # the separate analysis states no sigma: two percent of N, for where its fit began
            assert abs(term.value - size) < 2 * np.hypot(term.sigma, 0.02 * size if name == "N" else 0.0)
        else:
            assert size < term.at_most
