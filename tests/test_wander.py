"""The wandering bias: its covariance by integration, the Allan deviation of its data sheet, and uncertainties that hold under it."""

import numpy as np
import pytest
from scipy.integrate import dblquad

from session.io.units import DEG_PER_HOUR
from tinygc.closure.floor import ESTIMATED, UNKNOWN, BiasInstability, BiasWander, wander_covariance
from tinygc.simulation.simulator import bias_instability

#: a Gauss-Markov process for each octave of correlation times from half a second to 2048 s, each of variance B^2 ln 2 / pi
OCTAVES_S = np.array([0.5, 1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048])


def at_moments(t_s, s_s, instability_rps=1.0):
    """(rad/s)^2, of the bias at two moments, as the model says it."""
    return instability_rps**2 * np.log(2) / np.pi * np.exp(-np.abs(t_s - s_s) / OCTAVES_S).sum()


def test_covariance_of_two_moments_is_the_sum_of_its_octaves():
    t_s, B = np.array([3.0, 3.7, 60.0, 7000.0]), 3 * DEG_PER_HOUR
    expected = [[at_moments(t, s, B) for s in t_s] for t in t_s]
    np.testing.assert_allclose(wander_covariance(t_s, instability_rps=B), expected, rtol=1e-12)
    np.testing.assert_allclose(BiasWander(t_s[:1], B).covariance(t_s[1:2], t_s[2:]), expected, rtol=1e-12)
    np.testing.assert_allclose(BiasWander(t_s, B).covariance(), expected, rtol=1e-12)


@pytest.mark.parametrize("span_s", [0.01, 0.5, 8.0, 600.0])
def test_a_mean_over_a_span_has_the_variance_of_that_mean(span_s):
    """The covariance of moments integrated over span x span: its lower triangle, where nothing bends, twice.

    What a span of less than a thousandth of a correlation time takes away is left out: 3e-4 of that octave."""
    triangle, _ = dblquad(at_moments, 0, span_s, 0, lambda t: t, epsrel=1e-6)
    found = wander_covariance(np.array([5.0]), np.array([span_s]), instability_rps=1.0)
    assert found[0, 0] == pytest.approx(2 * triangle / span_s**2, rel=1e-4)


def test_a_mean_over_hardly_any_time_is_the_moment():
    """A thousandth of a correlation time takes a 3000th of that octave's variance away; no digits are lost to the difference."""
    for span_s in (1e-4, 5e-4, 5e-3):
        lost = np.sum([span_s / time - (span_s / time) ** 2 / 4 for time in OCTAVES_S]) / 3
        found = wander_covariance(np.zeros(1), np.array([span_s]), instability_rps=1.0)[0, 0]
        assert found == pytest.approx(np.log(2) / np.pi * (len(OCTAVES_S) - lost), rel=1e-8)


@pytest.mark.parametrize(
    ("apart_s", "spans_s"),
    [(30, (2, 8)), (7, (2, 8)), (5, (2, 8)), (3, (2, 8)), (1, (2, 8)), (-1, (2, 2)), (0.25, (0.25, 0.25)), (1, (0, 8))],
    ids=[
        "far apart",
        "apart",
        "touching",
        "half over one another",
        "one within the other",
        "shifted",
        "neighbouring pieces",
        "a moment within",
    ],
)
def test_means_over_two_spans_have_the_covariance_of_those_means(apart_s, spans_s):
    """The covariance of moments by rectangles, 1000 to a span: exact but for their size."""
    moments = [at + span_s * ((np.arange(1000) + 0.5) / 1000 - 0.5) for at, span_s in zip((0.0, apart_s), spans_s, strict=True)]
    apart = np.abs(np.subtract.outer(*moments))
    expected = np.log(2) / np.pi * sum(np.exp(-apart / time).mean() for time in OCTAVES_S)
    found = wander_covariance(np.array([0.0, apart_s]), np.array(spans_s), instability_rps=1.0)
    assert found[0, 1] == pytest.approx(expected, rel=2e-5)
    assert found[1, 0] == pytest.approx(found[0, 1], rel=1e-9)


@pytest.mark.parametrize("tau_s", [8, 64, 512])
def test_allan_deviation_by_the_covariance_is_the_floor(tau_s):
    """The difference of two neighbouring means over tau, its variance by the covariance itself: 0.664 B (IEEE 952, C.1).

    The octaves end at half a second and 2048 s, so the floor sags by 12 % at 2 s and by 14 % at 2048 s.
    """
    t_s, difference = (np.arange(512) + 0.5) * tau_s / 256, np.repeat([-1, 1], 256) / 256
    allan = np.sqrt(difference @ wander_covariance(t_s, instability_rps=2.0) @ difference / 2)
    assert allan == pytest.approx(np.sqrt(2 * np.log(2) / np.pi) * 2.0, rel=0.05)


@pytest.mark.broad
def test_it_is_the_wandering_that_the_simulator_draws():
    """Mean squared differences over 1 to 100 s in simulated series; the simulator has its own code and its own octaves."""
    lags_s, rng = np.array([1, 5, 20, 100]), np.random.default_rng(2)
    series = np.concatenate([bias_instability(1.0, 4.0, 600, rng) for _ in range(100)], axis=1)
    drawn = [np.mean((series[4 * lag :] - series[: -4 * lag]) ** 2) for lag in lags_s]
    covariance = wander_covariance(np.concatenate([[0], lags_s]), instability_rps=1.0)
    np.testing.assert_allclose(drawn, 2 * (covariance[0, 0] - covariance[0, 1:]), rtol=0.1)


@pytest.mark.parametrize(
    ("dph", "sigma_dph", "most_dph", "words"),
    [
        (6.2, 1.9, 9.0, f"6.2 ± 1.9 °/h, {ESTIMATED}"),
        (26.7, 12.0, 50.0, f"27 ± 12 °/h, {ESTIMATED}"),
        (26.7, 9.6, 50.0, f"27 ± 10 °/h, {ESTIMATED}"),  # two digits of a sigma that rounds to 10
        (26.7, 9.4, 50.0, f"26.7 ± 9.4 °/h, {ESTIMATED}"),
        (0.5, 0.012, 50.0, f"0.500 ± 0.012 °/h, {ESTIMATED}"),
        (0.5, 0.0, 50.0, f"0.5000000 ± 0.0000000 °/h, {ESTIMATED}"),
        (3.0, 1.5, 5.49, f"3.0 ± 1.5 °/h, {ESTIMATED}, which does not show it: less than 5.5 °/h (95 %)"),  # two sigmas do not
        (3.001, 1.5, 5.49, f"3.0 ± 1.5 °/h, {ESTIMATED}"),
    ],
)
def test_an_instability_says_what_it_knows(dph, sigma_dph, most_dph, words):
    known = BiasInstability(dph * DEG_PER_HOUR, ESTIMATED, sigma_dph * DEG_PER_HOUR, most_dph * DEG_PER_HOUR)
    assert known.words == words
    keys = [f"gyro_bias_instability_{name}" for name in ("dph", "sigma_dph", "source")]
    assert known.to_json() == dict(zip(keys, (pytest.approx(dph), pytest.approx(sigma_dph), ESTIMATED), strict=True))


def test_an_instability_without_a_sigma_or_a_source_says_so():
    given, unknown = BiasInstability(7.5 * DEG_PER_HOUR, "given"), BiasInstability(0.0, UNKNOWN)
    assert (given.words, unknown.words) == ("7.5 °/h, given", UNKNOWN)
    assert list(given.to_json().values()) == [pytest.approx(7.5), None, "given"]
    assert list(unknown.to_json().values()) == [None, None, UNKNOWN]
