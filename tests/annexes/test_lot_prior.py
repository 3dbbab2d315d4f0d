"""A fit with a lot as prior: it weighs what refits say, a few turns are enough, a unit that does not belong is left alone."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import broad
from formats_page import strangers
from lots import MEAN, SIGMA, lot, session_of_unit, write_lot
from processes import calibrate

import tinygc
from tinygc.annexes.lots import fit as lots_fit
from tinygc.annexes.lots.fit import Belonging, LotFile, LotUse, belonging, fit_with_lot, prior_of
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.prepared import prepare
from tinygc.closure.prior import vague
from tinygc.closure.uncertainty import goodness, parameter_covariance
from tinygc.estimation.options import FitOptions
from tinygc.estimation.stated_noise import stated_covariance, stated_goodness, stated_noise
from tinygc.models.linear import BIAS, PARAMETERS, bias_only

# The fit with a lot: what is judged, the thresholds, and the mixture of both.

OPTIONS = FitOptions(methods=("least_squares",), folds=2, bias="ends")


@pytest.fixture(scope="module")
def recorded(eight):
    """Eight turns of a unit that could be of the lot."""
    return prepare(eight).problem


@pytest.fixture(scope="module")
def problem(recorded):
    """With a floor of half the noise, so that it is widened."""
    return recorded.changed(floor=replace(recorded.floor, own=recorded.floor.own / 4, shared=recorded.floor.shared / 4))


class Refits:
    """Fits of a problem with a prior, or none, and their answer K (12, 12) to the prior's centre; covariance by the session's noise."""

    def __init__(self, problem, prior, still_rates=None, step=1e-7):
        start = bias_only(problem.still_rates.rate[0])

        def fitted(prior):
            return fit_least_squares(problem.batch, problem.floor.sigma, start, prior=prior, still_rates=still_rates).model

        model = fitted(prior)
        self.fit = model.vector
        excess = goodness(problem.batch, problem.floor, model, problem.wander).excess
        stated = parameter_covariance(problem.batch, problem.floor, model, problem.earth, still_rates, problem.wander, prior)
        self.noise = excess * stated
        if prior is not None:
            moved = [fitted(replace(prior, centre=prior.centre + step * unit)).vector for unit in np.eye(PARAMETERS)]
            self.share = (np.stack(moved, axis=-1) - self.fit[:, None]) / step


@pytest.fixture(scope="module")
def parts(problem):
    """Name -> prior and refits with the lot; and without it, of few turns (with the vague prior) and many: prior, K P K', refits."""
    start = bias_only(problem.still_rates.rate[0]).vector
    weight = goodness(problem.batch, problem.floor, problem.first, problem.wander).excess
    prior, open_ = prior_of(lot(), start).weighed(weight), vague(start).weighed(weight)
    few = Refits(problem, open_, step=1e-5)
    none = np.zeros((PARAMETERS, PARAMETERS))
    return {
        "lot": (prior, Refits(problem, prior)),
        "few": (open_, few.share @ open_.covariance @ few.share.T, few),
        "many": (None, none, Refits(problem, None)),
    }


class Judged:
    """``fit_with_lot`` with a belonging of this probability; what was given to the judgement."""

    def __init__(self, problem, monkeypatch, probability, few=False, options=OPTIONS, noise=None, of=None):
        really, self.given = belonging, []

        def judge(*given):
            self.given.append(given)
            return replace(really(*given), probability=probability)

        monkeypatch.setattr(lots_fit, "belonging", judge)
        monkeypatch.setattr(lots_fit, "FEWEST_SEGMENTS", len(problem.batch) + few)
        file = LotFile(of or lot(), "lot.json", "0" * 64)
        self.bias_from, self.level, self.fit, self.use = fit_with_lot(problem, options, file, noise)
        self.vector = self.fit.model.vector


def close(found, expected, sigma):
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), rtol=0, atol=2e-3)


@pytest.mark.parametrize("still_rates", [False, True])
def test_a_unit_that_belongs_is_judged_and_fitted_with_the_prior_of_its_noise(problem, parts, monkeypatch, still_rates):
    """The prior is weighed as much as the floor is too small; what it leaves of its own uncertainty is K P K'."""
    found = Judged(problem, monkeypatch, 0.9999, options=replace(OPTIONS, still_rates=still_rates))
    prior = found.level.prior
    refits = Refits(problem, prior, problem.still_rates) if still_rates else parts["lot"][1]
    assert prior.weight == goodness(problem.batch, problem.floor, problem.first, problem.wander).excess > 2
    np.testing.assert_allclose(found.vector, refits.fit, rtol=0, atol=1e-9)
    K, sigma = refits.share, np.sqrt(np.diag(prior.covariance))
    close(found.use.more, K @ prior.covariance @ K.T, sigma)
    np.testing.assert_allclose(found.use.share, np.diag(K), atol=2e-3)
    ((judged, moved, noise, kept),) = found.given
    assert judged.weight == prior.weight
    np.testing.assert_allclose(moved, found.vector - MEAN, rtol=0, atol=1e-12)
    close(noise, refits.noise, sigma)
    np.testing.assert_allclose(kept * np.outer(1 / sigma, sigma), (np.eye(PARAMETERS) - K) * np.outer(1 / sigma, sigma), atol=2e-3)
    assert (found.use.used, found.use.units, found.use.off) == ("yes", 500, None)


def test_the_noise_of_a_recording_takes_the_place_of_the_floor(recorded, problem, monkeypatch):
    noise = stated_noise(recorded)
    found = Judged(problem, monkeypatch, 1.0, noise=noise)
    _, wide = stated_goodness(problem, problem.first, noise)
    assert found.level.prior.weight == pytest.approx(max(1.0, wide * (noise.tilt_rms / problem.floor.tilt_rms) ** 2), rel=1e-9)
    model = found.fit.model
    expected = stated_goodness(found.level, model, noise)[1] * stated_covariance(found.level, model, noise, False)[0]
    np.testing.assert_allclose(found.given[0][2], expected, rtol=1e-9)
    loud = problem.changed(floor=replace(problem.floor, own=1e4 * problem.floor.own, shared=1e4 * problem.floor.shared))
    assert Judged(loud, monkeypatch, 1.0, noise=noise).level.prior.weight == 1.0


@pytest.mark.parametrize(
    ("probability", "few", "used", "mixed"),
    [
        (0.05, False, "no", False),
        (0.0501, False, "partly", True),
        (0.9499, False, "partly", True),
        (0.95, False, "yes", True),
        (0.9998, False, "yes", True),
        (0.9999, False, "yes", False),
        (0.05, True, "no", False),
        (0.0501, True, "partly", True),
        (0.9499, True, "partly", True),
        (0.95, True, "yes", False),
    ],
)
def test_the_lot_is_used_in_part_between_its_thresholds(problem, parts, monkeypatch, probability, few, used, mixed):
    """The mean of both fits, the covariance of the mixture; with few turns the unit's own fit has the vague prior, and its uncertainty."""
    found, (with_lot, of_lot), (_, more, alone) = (
        Judged(problem, monkeypatch, probability, few=few),
        parts["lot"],
        parts["few" if few else "many"],
    )
    p = probability if mixed else (1.0 if used == "yes" else 0.0)
    np.testing.assert_allclose(found.vector, p * of_lot.fit + (1 - p) * alone.fit, rtol=0, atol=1e-9)
    assert found.use.used == used
    assert (found.use.off is None) == (used == "yes")
    sigma = np.sqrt(np.diag(alone.noise + more))
    if used == "no":
        close(found.use.more, more, sigma)
        assert not found.use.share.any()
        assert found.level.prior is None if not few else found.level.prior.weight == with_lot.weight
        return
    apart = of_lot.fit - alone.fit
    both = p * (of_lot.noise + of_lot.share @ with_lot.covariance @ of_lot.share.T) + (1 - p) * (alone.noise + more)
    close(found.use.more, both + p * (1 - p) * np.outer(apart, apart) - of_lot.noise, sigma)
    np.testing.assert_allclose(found.use.share, p * np.diag(of_lot.share), atol=2e-3)


def test_a_bias_that_the_lot_does_not_tell_is_sought_about_the_first_still(problem, monkeypatch):
    """Or about the first look's, where no still is."""
    mean = lot().mean.copy()
    mean[BIAS] = np.nan
    stills = problem.still_rates
    found = Judged(problem, monkeypatch, 1.0, of=lot(mean=mean))
    np.testing.assert_array_equal(found.level.prior.centre[BIAS], -stills.rate[0])
    none = problem.changed(still_rates=replace(stills, rate=stills.rate[:0], earth=stills.earth[:0], sigma=stills.sigma[:0]))
    found = Judged(none, monkeypatch, 1.0, of=lot(mean=mean))
    np.testing.assert_array_equal(found.level.prior.centre[BIAS], problem.first.B)


def test_a_use_is_told_in_words_and_in_json():
    found = Belonging(0.5, 3.25, 12, 0.02)
    share = np.zeros(PARAMETERS)
    share[:8] = 0.051, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.049
    use = LotUse("lot.json", "00", 50, found, "yes", share, np.zeros((12, 12)), ("E_xx", -6.04))
    far = "(3.2 sigmas from its mean in 12 directions, p = 0.02)"
    gave = "of the parameters the lot gave: E_zx 70%, E_yz 60%, E_yy 50%, E_yx 40%, E_xz 30%, E_xy 20%."
    assert use.words == f"The unit belongs to the lot of lot.json, 50 units {far}; {gave}"
    assert replace(use, share=np.full(12, 0.049)).words.endswith("no parameter has 5% of its value from the lot.")
    assert "E_xx 5%" in replace(use, share=np.where(np.arange(12) == 0, 0.05, 0.0)).words
    assert replace(use, used="no").words.endswith(f"{far}: E_xx is -6.0 sigmas of the lot from its mean; the lot's prior was not used.")
    assert "lot.json (probability 0.50; 3.2 sigmas" in replace(use, used="partly").words
    told = use.to_json()
    assert told["off"] == {"parameter": "E_xx", "sigmas": -6.04}
    assert (told["belongs_probability"], told["distance"], told["freedom"], told["p_value"]) == (0.5, 3.25, 12, 0.02)
    assert (told["used"], told["units"], told["share"][1]) == ("yes", 50, 0.2)
    assert replace(use, off=None).to_json()["off"] is None


# Whole sessions.


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


@pytest.mark.broad
def test_four_turns_fit_with_a_lot_and_say_what_it_gave(four, file, tmp_path):
    refused = calibrate("fit", four, "--out", tmp_path / "none", "--methods", "least_squares")
    assert refused.returncode == 2
    assert "4 usable segments, expected at least 7" in refused.stderr
    assert "--lot" in refused.stderr
    done = calibrate("fit", four, "--out", tmp_path / "fit", "--lot", file, "--json", tmp_path / "fit.json")
    assert done.returncode in (0, 1), done.stderr  # so few turns may not show that they close better than nothing
    table = json.loads((tmp_path / "fit.json").read_text())
    assert strangers(table) == []
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
    assert strangers(model) == []
    assert model["lot"] == {key: told[key] for key in ("file", "hash", "used", "belongs_probability")}


@pytest.mark.parametrize("turns", [broad(4), 8])
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


@pytest.mark.slow
def test_a_broken_file_and_options_without_a_prior_are_refused_in_one_line(eight, file, tmp_path):
    (tmp_path / "broken.json").write_text('{"schema": "tinygc-lot/3"')
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
