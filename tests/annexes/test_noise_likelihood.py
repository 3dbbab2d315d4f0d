"""The likelihood of noise terms: covariances against IEEE 952, slopes, curvature; the Allan deviation against AllanTools."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from resting import six, sums_of
from scipy.integrate import quad
from scipy.stats import chi2

from tinygc.annexes.noise.estimate import allan_points
from tinygc.annexes.noise.likelihood import cost, fit, line_autocovariance, stacked, stacks_of, unit_covariance
from tinygc.annexes.noise.scales import Group, groups_of, rest_of
from tinygc.annexes.noise.summary import contrasts
from tinygc.noise.figures import TERMS, AxisNoise, Line, Term, unit_allan_variance

DT, T = 0.01, 0.7


def window(count, size=1):
    return Group(size, np.arange(count), contrasts(count), np.eye(count - 1), 1.0)


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("size", [1, 5, 700])
def test_two_means_have_the_allan_variance_of_ieee_952(name, size):
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
    mean_s, h = 10 * DT, contrasts(4)[:, 1]

    def density(f):
        gain = np.abs(h @ np.exp(2j * np.pi * f * mean_s * np.arange(4))) ** 2 * np.sinc(f * mean_s) ** 2
        return 2 * DENSITY[name](f) * gain

    edges = [1e-9, *np.arange(1, 400) / (4 * mean_s)]
    expected = sum(quad(density, a, b, limit=200)[0] for a, b in pairwise(edges))
    assert C[1, 1] == pytest.approx(expected, rel=3e-3 if name == "N" else 1e-4)


def test_a_line_has_its_power_and_is_averaged():
    assert line_autocovariance(3.0, np.array([0]), 1e-9)[0] == pytest.approx(1)
    assert line_autocovariance(3.0, np.array([0]), 1 / 3)[0] == pytest.approx(0, abs=1e-12)
    t = np.arange(200_000) * DT
    y = np.sqrt(2) * np.sin(2 * np.pi * 1.3 * t).reshape(-1, 8, 5).mean(axis=2) @ contrasts(8)
    (C,) = unit_covariance("line", [window(8, 5)], DT, hz=1.3)
    assert np.allclose(y.T @ y / len(y), C, atol=0.01)


def real_groups():
    rest = rest_of(sums_of(six(20_000, DT, 1, N=1.0, B=0.5, K=0.2), DT))
    return groups_of([rest], 0, [rest.blocks.mean[:, 0]], [np.zeros((len(rest.blocks), 0))])


def test_slopes_are_those_of_the_value():
    groups = real_groups()
    stacks = stacks_of(groups)
    V = [stacked(unit_covariance(name, groups, DT), stacks) for name in "NBK"]
    x = np.array([1.1, 0.3, 0.02])
    value, slope, _ = cost(x, V, stacks)
    for k in range(3):
        step = 1e-5 * x[k] * (np.arange(3) == k)
        up, down = cost(x + step, V, stacks)[0], cost(x - step, V, stacks)[0]
        assert (up - down) / (2 * step.max()) == pytest.approx(slope[k], rel=1e-5)
    assert np.isfinite(value)


def test_curvature_is_that_of_expected_data():
    x, names = np.array([1.0, 0.3, 0.02]), "NBK"
    groups = real_groups()
    V = [unit_covariance(name, groups, DT) for name in names]
    expected = [
        Group(g.size, g.at, g.basis, g.count * sum(s * v[k] for s, v in zip(x, V, strict=True)), g.count) for k, g in enumerate(groups)
    ]
    stacks = stacks_of(expected)
    V = [stacked(own, stacks) for own in V]
    _, slope, curvature = cost(x, V, stacks)
    assert np.allclose(slope * x, 0, atol=1e-6)
    for k in range(3):
        step = 1e-4 * x[k] * (np.arange(3) == k)
        change = (cost(x + step, V, stacks)[1] - cost(x - step, V, stacks)[1]) / (2 * step.max())
        assert np.allclose(change, curvature[k], rtol=1e-4, atol=1e-4 * np.abs(curvature[k]).max())


def test_white_noise_alone_is_its_mean_square():
    groups = real_groups()
    stacks = stacks_of(groups)
    found = fit(("N",), {"N": stacked(unit_covariance("N", groups, DT), stacks)}, stacks, np.array([5.0]))
    freedom = sum(g.count * len(g.S) for g in groups)
    by_hand = sum(float(np.trace(g.S)) * g.size * DT for g in groups) / freedom
    assert found.x[0] == pytest.approx(by_hand, rel=1e-5)
    assert found.information[0, 0] == pytest.approx(freedom / 2, rel=1e-9)


def test_the_allan_deviation_is_that_of_allantools():
    allantools = pytest.importorskip("allantools", reason="AllanTools is not installed: pip install -e '.[test]'")
    values = six(2**17, DT, 3, N=1.0, B=0.5, K=0.1)
    rest = rest_of(sums_of(values, DT))
    groups = groups_of([rest], 0, [rest.blocks.mean[:, 0]], [np.zeros((len(rest.blocks), 0))])
    zero = Term(0.0, None, 0.0)
    axis = AxisNoise(dict.fromkeys(TERMS, zero) | {"N": Term(1.0, 0.1, 1.0), "B": Term(0.5, 0.1, 1.0), "K": Term(0.1, 0.1, 1.0)})
    points = allan_points(groups, DT, axis)
    tau_s, deviation, _, _ = allantools.oadev(values[:, 0], rate=1 / DT, data_type="freq", taus=[p[0] for p in points])
    theirs = dict(zip(np.round(tau_s, 6), deviation, strict=True))
    both = [point for point in points if np.round(point[0], 6) in theirs]
    apart = [np.log(own / theirs[np.round(tau, 6)]) / np.log(high / own) for tau, own, low, high in both]
    assert len(both) >= len(points) - 1 >= 14
    # windows hold fewer pairs than all that overlap: they differ, by less than the error of either
    assert np.sqrt(np.mean(np.square(apart))) < 1
    assert max(map(abs, apart)) < 2.5


def test_one_pair_in_each_window_has_a_chi_square_of_as_many_freedoms():
    """White noise in 9 windows of 4 means: at two means each window holds one difference."""
    group = replace(window(4), S=9 * np.diag([1.0, 2.0, 0.5]), count=9.0)
    axis = AxisNoise(dict.fromkeys(TERMS, Term(0.0, None, 0.0)) | {"N": Term(1.0, 0.1, 1.0)})
    (_, one, _, _), (_, two, low, high) = allan_points([group], DT, axis)
    values = contrasts(4) @ np.diag([1.0, 2.0, 0.5]) @ contrasts(4).T  # covariance of the means
    difference = np.array([-0.5, -0.5, 0.5, 0.5])
    assert two**2 == pytest.approx(difference @ values @ difference / 2)
    assert one**2 == pytest.approx(np.mean([d @ values @ d for d in np.diff(np.eye(4), axis=0)]) / 2)
    assert low == pytest.approx(two * np.sqrt(9 / chi2.ppf(0.84, 9)))
    assert high == pytest.approx(two * np.sqrt(9 / chi2.ppf(0.16, 9)))


def test_a_line_counts_in_the_allan_variance_of_the_model():
    axis = AxisNoise(dict.fromkeys(TERMS, Term(0.0, None, 0.0)), (Line(2.0, 0.5),))
    t = np.arange(450_000) * 1e-3
    y = 0.5 * np.sqrt(2) * np.sin(2 * np.pi * 2.0 * t).reshape(-1, 150).mean(axis=1)
    found = np.mean(np.diff(y) ** 2) / 2
    assert axis.allan_variance(np.array([0.15]))[0] == pytest.approx(found, rel=0.01)
