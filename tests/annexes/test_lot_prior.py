"""A lot as prior of one unit: it weighs what it should, a few turns are enough, a unit that does not belong is left alone."""

import json
from dataclasses import replace

import numpy as np
import pytest
from lots import MEAN, SIGMA, lot, session_of_unit
from processes import calibrate

import tinygc
from tinygc import CalibrationError
from tinygc.annexes.lots.fit import belonging, farthest, prior_of, require_usable
from tinygc.annexes.lots.report import write_lot
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.prepared import prepare
from tinygc.closure.prior import GaussianPrior
from tinygc.models.linear import PARAMETERS, LinearModel


@pytest.fixture(scope="module")
def drawn():
    return MEAN + SIGMA * np.random.default_rng(5).standard_normal(PARAMETERS)


@pytest.fixture(scope="module")
def eight(tmp_path_factory, drawn):
    return session_of_unit(tmp_path_factory.mktemp("lot") / "eight", drawn, 8)


@pytest.fixture(scope="module")
def four(tmp_path_factory, drawn):
    return session_of_unit(tmp_path_factory.mktemp("lot") / "four", drawn, 4)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("lot") / "lot.json"
    write_lot(path, lot())
    return path


def test_prior_and_turns_are_weighed_by_their_information(eight):
    """Exactly so where the closure is linear: x = (A + P^-1)^-1 (A x_turns + P^-1 centre), whatever the noise that both are weighed by."""
    problem = prepare(eight).problem
    start, sigma = LinearModel.from_vector(MEAN), problem.floor.sigma
    wide = GaussianPrior(MEAN, np.diag(np.full(PARAMETERS, 1e4)), np.ones(PARAMETERS, dtype=bool))
    free = fit_least_squares(problem.batch, sigma, start, prior=wide)
    spread = np.diag(SIGMA**2)
    spread[0, 4] = spread[4, 0] = 0.7 * SIGMA[0] * SIGMA[4]
    prior = GaussianPrior(MEAN, spread, np.ones(PARAMETERS, dtype=bool))
    for weight in (1.0, 9.0):
        fit = fit_least_squares(problem.batch, sigma, start, prior=prior.weighed(weight))
        turns, lot_s = np.linalg.inv(free.covariance), weight * np.linalg.inv(spread)
        expected = np.linalg.solve(turns + lot_s, turns @ free.model.vector + lot_s @ MEAN)
        np.testing.assert_allclose(fit.model.vector, expected, atol=0.02 * np.sqrt(np.diag(fit.covariance)).min())
        np.testing.assert_allclose(fit.covariance, np.linalg.inv(turns + lot_s), rtol=2e-2, atol=1e-14)


def test_a_number_that_the_lot_does_not_tell_is_as_open_as_without(eight):
    """NaN in mean or spread: its centre is the start's, its sigma the generous one, and nothing correlates with it."""
    known = lot()
    mean, spread = known.mean.copy(), known.spread.copy()
    mean[4] = np.nan
    prior = prior_of(replace(known, mean=mean), MEAN + 1.0)
    assert prior.centre[4] == MEAN[4] + 1.0
    assert prior.covariance[4, 4] == pytest.approx(0.2**2)
    assert not prior.covariance[4, np.arange(PARAMETERS) != 4].any()
    assert list(np.flatnonzero(~prior.known)) == [4]
    spread[9] = spread[:, 9] = np.nan
    assert list(np.flatnonzero(~prior_of(replace(known, spread=spread), MEAN).known)) == [9]


def test_eight_turns_with_the_lot_reach_the_sigmas_of_twenty_without(eight, file, drawn, tmp_path):
    """A lot of 50 ppm; the errors are within what is stated (chi-square of twelve below its 0.1 %)."""
    with_lot = tinygc.fit(eight, methods=("least_squares",), lot=file).result
    without = tinygc.fit(session_of_unit(tmp_path / "twenty", drawn, 20, seed=8), methods=("least_squares",)).result
    alone = tinygc.fit(eight, methods=("least_squares",)).result
    rms = [float(np.sqrt(np.mean(np.diag(result.covariance)[:9]))) for result in (alone, without, with_lot)]
    assert rms[0] > 1.5 * rms[1]
    assert rms[2] < 1.05 * rms[1]
    assert with_lot.lot.used == "yes"
    error = with_lot.linear.model.vector - drawn
    assert error @ np.linalg.solve(with_lot.covariance, error) < 32.9


def test_four_turns_fit_with_a_lot_and_say_what_it_gave(four, file, tmp_path):
    refused = calibrate("fit", four, "--out", tmp_path / "none", "--methods", "least_squares")
    assert refused.returncode == 2
    assert "4 usable segments, expected at least 7" in refused.stderr
    assert "--lot" in refused.stderr
    done = calibrate("fit", four, "--out", tmp_path / "fit", "--lot", file, "--json", tmp_path / "fit.json")
    assert done.returncode in (0, 1), done.stderr  # so few turns may not show that they close better than nothing
    table = json.loads((tmp_path / "fit.json").read_text())
    told = table["lot"]
    assert told["used"] == "yes"
    assert told["file"] == "lot.json"
    assert len(told["hash"]) == 64
    assert told["belongs_probability"] > 0.95
    assert len(told["share"]) == PARAMETERS
    assert max(told["share"]) > 0.5
    assert set(table["methods"]) == {"raw", "raw_bias_removed", "least_squares"}
    assert "The unit belongs to the lot of lot.json, 500 units" in " ".join(done.stdout.split())
    model = json.loads((tmp_path / "fit" / "model_least_squares.json").read_text())
    assert model["lot"] == {key: told[key] for key in ("file", "hash", "used", "belongs_probability")}


@pytest.mark.parametrize("turns", [4, 8])
def test_a_unit_that_does_not_belong_is_left_alone_and_named(file, drawn, tmp_path, turns):
    """30 sigmas of one number: the fit is the one without the lot, where there is one; the truth is within its sigmas in either case."""
    odd = drawn.copy()
    odd[4] = 1 + 30 * SIGMA[4]
    folder = session_of_unit(tmp_path / "odd", odd, turns)
    result = tinygc.fit(folder, methods=("least_squares",), lot=file).result
    assert result.lot.used == "no"
    assert result.lot.belonging.probability < 0.05
    if turns == 8:
        assert result.lot.off[0] == "E_yy"
        assert result.lot.off[1] == pytest.approx(30, rel=0.2)
        alone = tinygc.fit(folder, methods=("least_squares",)).result
        np.testing.assert_array_equal(result.linear.model.vector, alone.linear.model.vector)
        np.testing.assert_allclose(result.covariance, alone.covariance)
    error = result.linear.model.vector - odd
    assert np.abs(error / np.sqrt(np.diag(result.covariance))).max() < 4


def test_where_it_is_open_the_sigmas_cover_both(eight, drawn, file, monkeypatch):
    """The mixture's mean and covariance: p of one, 1 - p of the other, and how far they are apart."""
    from tinygc.annexes.lots import fit as lot_prior

    really = lot_prior.belonging

    def fitted(probability):
        monkeypatch.setattr(lot_prior, "belonging", lambda *given: replace(really(*given), probability=probability))
        return tinygc.fit(eight, methods=("least_squares",), bias="ends", lot=file).result

    with_lot, between, alone = fitted(1.0), fitted(0.5), tinygc.fit(eight, methods=("least_squares",), bias="ends").result
    assert between.lot.used == "partly"
    one, other = with_lot.linear.model.vector, alone.linear.model.vector
    np.testing.assert_allclose(between.linear.model.vector, (one + other) / 2, rtol=0, atol=1e-9)
    expected = (with_lot.covariance + alone.covariance) / 2 + np.outer(one - other, one - other) / 4
    np.testing.assert_allclose(np.diag(between.covariance), np.diag(expected), rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("tails", "law"), [(np.inf, "normal"), (5.0, "heavy")])
def test_the_distance_has_the_distribution_that_it_is_said_to_have(tails, law):
    """Units of the lot, seen through noise in some directions only: p-values are uniform, and few are called foreign."""
    from scipy import stats

    rng = np.random.default_rng(2)
    A = rng.standard_normal((8, PARAMETERS)) / SIGMA  # eight angles, with errors of one
    prior = prior_of(lot(), MEAN)
    own = prior.information
    inverse = np.linalg.inv(A.T @ A + own)
    kept, noise = inverse @ A.T @ A, inverse @ A.T @ A @ inverse
    found = []
    for _ in range(400):
        scale = 1.0 if tails == np.inf else np.sqrt(rng.chisquare(tails) / tails)
        off = np.linalg.cholesky(prior.covariance) @ rng.standard_normal(PARAMETERS) / scale
        y = A @ off + rng.standard_normal(8) / scale
        found.append(belonging(prior, inverse @ A.T @ y, noise, kept, tails))
    assert {each.freedom for each in found} == {8}
    assert stats.kstest([each.p_value for each in found], "uniform").pvalue > 0.01
    assert np.mean([each.probability < 0.95 for each in found]) < 0.05
    far = belonging(prior, inverse @ A.T @ (A @ (20 * SIGMA * np.eye(PARAMETERS)[4])), noise, kept, np.inf)
    assert far.probability < 1e-3


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"sensor": "LSM6DSO"}, "a lot of LSM6DSO, and the session's sensor is ASM330LHH"),
        ({"units": 9}, "a lot of 9 units, expected at least 10"),
        ({"mean": np.full(21, np.nan)}, "tells none of the gyroscope's 12 numbers"),
    ],
)
def test_a_lot_that_tells_nothing_of_this_sensor_is_refused(changes, says):
    with pytest.raises(CalibrationError, match=says):
        require_usable(lot(**changes), "ASM330LHH", "lot.json")


def test_a_lot_without_any_spread_is_left_in_finite_sigmas():
    same = lot(sigma=np.zeros(PARAMETERS))
    name, sigmas = farthest(same, MEAN + 1e-3 * np.eye(PARAMETERS)[4], 1e-6 * np.eye(PARAMETERS), np.ones(PARAMETERS, dtype=bool))
    assert name == "E_yy"
    assert np.isfinite(sigmas)


@pytest.mark.slow
def test_a_broken_file_and_options_without_a_prior_are_refused_in_one_line(eight, file, tmp_path):
    (tmp_path / "broken.json").write_text('{"schema": "tinygc-lot/2"')
    for words, says in (
        (("--lot", tmp_path / "broken.json"), "broken JSON"),
        (("--lot", tmp_path / "none.json"), "none.json"),
        (("--lot", file, "--physics", "auto"), "--physics fits without a lot's prior"),
        (("--lot", file, "--bias-per-log"), "--bias-per-log fits without a lot's prior"),
    ):
        done = calibrate("fit", eight, "--out", tmp_path / "fit", "--methods", "least_squares", *words)
        assert done.returncode == 2, done.stderr
        (error,) = (line for line in done.stderr.splitlines() if not line.startswith("reading log"))
        assert says in error
