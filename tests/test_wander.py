"""The wandering bias: a covariance with the Allan deviation of its data sheet, and uncertainties that stay true under it."""

import json

import numpy as np
import pytest

from session.io.units import DEG, DEG_PER_HOUR
from tinygc import FitOptions, read_session
from tinygc.closure import floor
from tinygc.closure.build import build_problem
from tinygc.closure.floor import TIMES_S
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.uncertainty import parameter_covariance
from tinygc.estimation.fit import fit_session
from tinygc.models.linear import LinearModel, bias_only
from tinygc.simulation.simulator import bias_instability

BIAS_INSTABILITY_RPS = 3 * DEG_PER_HOUR
FLOOR = np.sqrt(2 * np.log(2) / np.pi)  # 0.664: IEEE 952, C.1


def wander_covariance(t_s, span_s=0.0):
    return floor.wander_covariance(t_s, span_s, instability_rps=BIAS_INSTABILITY_RPS)


@pytest.mark.parametrize("t_s", [np.arange(50.0), np.sort(np.random.default_rng(0).uniform(0, 3600, 80)), np.array([7.0])])
def test_covariance_is_symmetric_positive_and_stationary(t_s):
    covariance = wander_covariance(t_s)
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0
    np.testing.assert_allclose(np.diag(covariance), covariance[0, 0], rtol=1e-15)
    np.testing.assert_allclose(wander_covariance(t_s + 1e4), covariance, rtol=1e-9)
    np.testing.assert_allclose(wander_covariance(t_s[::-1]), covariance[::-1, ::-1], rtol=1e-15)


def test_it_scatters_by_the_variance_of_its_octaves():
    """B^2 ln 2 / pi each: 1.7 B altogether, 5 degrees an hour of the 3 in the data sheet."""
    sigma = np.sqrt(wander_covariance(np.zeros(1))[0, 0])
    assert sigma == pytest.approx(BIAS_INSTABILITY_RPS * np.sqrt(len(TIMES_S) * np.log(2) / np.pi), rel=1e-12)
    assert sigma / DEG_PER_HOUR == pytest.approx(5.1, abs=0.1)


def test_it_forgets_slowly():
    """What is drawn an hour apart is all but another bias; what is drawn within a second is nearly the same."""
    correlation = wander_covariance(np.array([0, 1, 30, 3 * 3600.0]))[0] / wander_covariance(np.zeros(1))[0, 0]
    assert np.all(np.diff(correlation) < 0)
    assert correlation[1] > 0.8
    assert correlation[3] < 0.001


@pytest.mark.parametrize("span_s", [0.01, 0.5, 8.0, 60.0])
def test_a_mean_over_a_span_has_the_variance_of_that_mean(span_s):
    """The mean of the point-wise covariance over span x span; 2 (x - 1 + e^-x) / x^2 of each octave is its closed form."""
    t_s = (np.arange(1000) + 0.5) * span_s / 1000
    assert wander_covariance(np.zeros(1), np.array([span_s]))[0, 0] == pytest.approx(wander_covariance(t_s).mean(), rel=1e-3)


@pytest.mark.parametrize("tau_s", [8, 64, 512])
def test_allan_deviation_by_the_covariance_is_the_floor(tau_s):
    """The difference of two neighbouring means over tau, its variance by the covariance itself: no draws.

    The octaves end at half a second and 2048 s, so the floor sags by 12 % at 2 s and by 14 % at 2048 s.
    """
    count = 512
    t_s = (np.arange(2 * count) + 0.5) * tau_s / count
    difference = np.repeat([-1, 1], count) / count
    allan = np.sqrt(difference @ wander_covariance(t_s) @ difference / 2)
    assert allan == pytest.approx(FLOOR * BIAS_INSTABILITY_RPS, rel=0.05)


@pytest.mark.parametrize("tau_s", [5, 20, 50])
def test_allan_deviation_of_draws_is_the_floor(tau_s):
    """400 draws over 200 s, overlapping; a few per cent of statistics."""
    step_s, draws = 0.5, 400
    root = np.linalg.cholesky(wander_covariance(np.arange(0, 200, step_s)))
    bias = root @ np.random.default_rng(1).standard_normal((len(root), draws))
    size = round(tau_s / step_s)
    total = np.cumsum(np.vstack([np.zeros(draws), bias]), axis=0)
    mean = (total[size:] - total[:-size]) / size
    allan = np.sqrt(np.mean((mean[size:] - mean[:-size]) ** 2) / 2)
    assert allan == pytest.approx(FLOOR * BIAS_INSTABILITY_RPS, rel=0.05)


def test_it_is_the_wandering_that_the_simulator_draws():
    """Mean squared differences over 1 to 100 s in 600 simulated series; the simulator has its own code and its own octaves."""
    rate_hz, lags_s = 4.0, np.array([1, 5, 20, 100])
    rng = np.random.default_rng(2)
    series = np.concatenate([bias_instability(BIAS_INSTABILITY_RPS, rate_hz, 600, rng) for _ in range(200)], axis=1)
    drawn = [np.mean((series[4 * lag :] - series[: -4 * lag]) ** 2) for lag in lags_s]
    covariance = wander_covariance(np.concatenate([[0], lags_s]))
    np.testing.assert_allclose(drawn, 2 * (covariance[0, 0] - covariance[0, 1:]), rtol=0.1)


def test_a_fit_says_uncertainties_with_the_wander(simulated):
    """As far as it shows in this recording, whose bias wanders by 3 °/h; what is stated of B is near what the data sheet's figure gives."""
    result = fit_session(simulated(), FitOptions(methods=("least_squares",), folds=2, bias="ends"))
    problem, model = result.problem, result.linear.model
    given, still = (
        parameter_covariance(problem.batch, problem.floor, model, problem.earth, None, moments) for moments in (problem.wander, None)
    )
    stated = result.covariance
    assert np.all(np.diag(stated)[9:] > 1.1 * np.diag(still)[9:])
    np.testing.assert_allclose(np.sqrt(np.diag(stated - result.accelerometer_covariance)[9:] / np.diag(given)[9:]), 1, atol=0.4)
    assert np.linalg.eigvalsh(stated / np.sqrt(np.outer(np.diag(stated), np.diag(stated)))).min() > 0


@pytest.fixture(scope="module")
def sessions(simulated):
    """(30, 12) errors of least squares in sigmas, on simulated sessions of 20 turns with the data sheet's instability: by the
    covariance with the wander, and by the one without."""
    errors = []
    for seed in range(30):
        folder = simulated(segments=20, closure_s=0.0, seed=seed)
        truth = json.loads((folder / "truth.json").read_text())
        true = LinearModel(np.array(truth["E"]), np.array(truth["B_dps"]) * DEG).vector
        problem = build_problem(read_session(folder))
        model = fit_least_squares(problem.batch, problem.floor.sigma, bias_only(problem.still_rates.rate[0])).model
        covariances = [
            parameter_covariance(problem.batch, problem.floor, model, problem.earth, None, moments) for moments in (problem.wander, None)
        ]
        errors.append([(model.vector - true) / np.sqrt(np.diag(covariance)) for covariance in covariances])
    return np.array(errors).transpose(1, 0, 2)


@pytest.mark.slow
def test_uncertainties_are_true_in_the_simulator(sessions):
    """End to end, from registers: 68 % of 360 errors within one sigma.  Those of one session hang together: 0.15 / sqrt(30) = 0.03."""
    with_wander, _ = sessions
    assert np.mean(np.abs(with_wander) < 1) == pytest.approx(0.683, abs=0.08)
    assert np.mean(np.abs(with_wander) < 2) == pytest.approx(0.954, abs=0.04)
    # Each parameter by itself: 30 squares of a standard normal.
    np.testing.assert_allclose(np.mean(with_wander**2, axis=0), 1, atol=4 * np.sqrt(2 / 30))


@pytest.mark.slow
def test_without_the_wander_the_bias_would_seem_too_well_known(sessions):
    """What the wander is for: the bias' squared errors are some twice those that noise alone predicts, and then they are right."""
    with_wander, without = (np.mean(errors[:, 9:] ** 2) for errors in sessions)
    assert without > 1.6
    assert with_wander == pytest.approx(1, abs=0.45)  # 90 squares, three a session alike
