"""A lot's prior and whether a unit belongs, against direct integration over the unit's true numbers, and refits with another prior."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import broad
from lots import MEAN, SIGMA, lot, session_of_unit
from processes import calibrate
from scipy import stats

import tinygc
from tinygc import CalibrationError
from tinygc.annexes.lots import fit as lots_fit
from tinygc.annexes.lots.fit import (
    OFF_LOT,
    OFF_SCALES,
    Belonging,
    LotFile,
    LotUse,
    belonging,
    farthest,
    fit_with_lot,
    prior_of,
    require_usable,
)
from tinygc.annexes.lots.lot import NAMES as LOT_NAMES
from tinygc.annexes.lots.report import write_lot
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.prepared import prepare
from tinygc.closure.prior import GaussianPrior, vague
from tinygc.closure.uncertainty import goodness, parameter_covariance
from tinygc.estimation.options import FitOptions
from tinygc.estimation.stated_noise import stated_covariance, stated_goodness, stated_noise
from tinygc.models.linear import PARAMETERS, PRIOR_SIGMA, bias_only

RNG = np.random.default_rng(7)


def some_covariance(size):
    root = RNG.normal(size=(len(size), len(size))) + 2 * np.eye(len(size))
    return root @ root.T * np.outer(size, size) / len(size)


# The prior of the next session of a unit.


@pytest.mark.parametrize(("tails", "factor"), [(np.inf, 1.0), (5.0, 0.6), (2.5, 0.2), (2.0, 1.0)])
def test_the_covariance_is_that_of_the_mean_the_spread_and_the_change_between_sessions(tails, factor):
    """A scale matrix instead of the spread's covariance where Student's tails have one: (nu - 2) / nu of it."""
    parts = [some_covariance(np.full(len(LOT_NAMES), size)) for size in (1e-4, 2e-4, 3e-4)]
    known = replace(lot(), mean_covariance=parts[0], spread=parts[1], repeatability=parts[2])
    found = prior_of(known, MEAN + 1.0, tails)
    own = slice(0, PARAMETERS)
    expected = parts[0][own, own] + factor * parts[1][own, own] + parts[2][own, own]
    np.testing.assert_allclose(found.covariance, expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.covariance, found.covariance.T)
    np.testing.assert_array_equal(found.centre, MEAN)
    assert found.known.all()


def test_a_lot_without_any_spread_keeps_a_millionth_of_the_wide_prior():
    """Its covariance stays invertible; what the lot does not know of mean and repeatability adds nothing."""
    same = lot(sigma=np.zeros(PARAMETERS))
    unknown = np.full((len(LOT_NAMES), len(LOT_NAMES)), np.nan)
    found = prior_of(replace(same, repeatability=unknown, mean_covariance=unknown), MEAN)
    np.testing.assert_allclose(found.covariance, np.diag((1e-6 * PRIOR_SIGMA) ** 2), rtol=1e-12)


def test_a_number_that_the_lot_does_not_tell_is_as_open_as_without():
    """NaN in mean or spread: its centre is the start's, its sigma the generous one, and nothing correlates with it."""
    known = replace(lot(), spread=some_covariance(np.full(len(LOT_NAMES), 1e-4)))
    mean, spread = known.mean.copy(), known.spread.copy()
    mean[4] = spread[9, 9] = np.nan
    found = prior_of(replace(known, mean=mean, spread=spread), MEAN + 1.0)
    told = np.isin(np.arange(PARAMETERS), (4, 9), invert=True)
    np.testing.assert_array_equal(found.known, told)
    np.testing.assert_array_equal(found.centre, np.where(told, MEAN, MEAN + 1.0))
    np.testing.assert_array_equal(found.covariance[~told], np.diag(PRIOR_SIGMA**2)[~told])
    whole = prior_of(known, MEAN).covariance
    np.testing.assert_array_equal(found.covariance[np.ix_(told, told)], whole[np.ix_(told, told)])


def test_a_prior_is_weighed_and_scaled():
    covariance = some_covariance(np.full(PARAMETERS, 1e-3))
    prior = GaussianPrior(MEAN, covariance, np.ones(PARAMETERS, dtype=bool))
    weighed = prior.scaled(3.0).weighed(6.0)
    np.testing.assert_allclose(weighed.root @ weighed.root.T, covariance / 2, rtol=0, atol=1e-16)
    np.testing.assert_allclose(weighed.information @ covariance, 2 * np.eye(PARAMETERS), atol=1e-8)
    assert not np.triu(weighed.root, 1).any()
    open_ = vague(MEAN + 1.0)
    np.testing.assert_allclose(open_.covariance, np.diag([0.04] * 9 + [np.radians(20) ** 2] * 3), rtol=1e-12)
    assert (open_.weight, open_.known.any(), open_.centre[0]) == (1.0, False, 2.0)


# Whether a unit belongs: integrals over its true distance u from the lot's mean, of two numbers.

P2 = np.array([[1.0, 0.6], [0.6, 2.0]])
PRIOR2 = GaussianPrior(np.zeros(2), P2, np.ones(2, dtype=bool))
KEPT2, NOISE2 = np.array([[0.9, 0.1], [-0.2, 0.5]]), np.array([[0.3, -0.1], [-0.1, 0.2]])


def evidence(moved, covariance, kept=KEPT2, noise=NOISE2):
    """Density of what the fit moved by, for u normal with this covariance: the sum over a grid of K u about what was seen."""
    axis = np.linspace(-8, 8, 161)
    root = np.linalg.cholesky(noise)
    x = np.stack(np.meshgrid(axis, axis, indexing="ij"), -1) @ root.T + moved
    u = x @ np.linalg.inv(kept).T
    density = stats.multivariate_normal(np.zeros(2), covariance).pdf(u) * stats.multivariate_normal(moved, noise).pdf(x)
    return density.sum() * (axis[1] - axis[0]) ** 2 * np.linalg.det(root) / np.linalg.det(kept)


def foreign(of, known=(0, 1)):
    """Density of a unit that does not belong: all its numbers, or one of those known, are 3, 10, 30 or 100 times as wide."""
    total = 0.0
    for scale in (3.0, 10.0, 30.0, 100.0):
        total += 0.5 * of(scale**2 * P2)
        for k in known:
            alone = P2.copy()
            alone[k, k] *= scale**2
            total += 0.5 / len(known) * of(alone)
    return total / 4


@pytest.mark.parametrize("moved", [(0.1, -0.2), (2.5, 0.5), (-1.0, 4.0)])
@pytest.mark.parametrize("known", [(0, 1), (1,)])
def test_the_probability_is_the_integral_over_the_units_true_numbers(moved, known):
    prior, moved = replace(PRIOR2, known=np.isin(np.arange(2), known)), np.array(moved)
    found = belonging(prior, moved, NOISE2, KEPT2)
    inside, outside = 0.97 * evidence(moved, P2), 0.03 * foreign(lambda covariance: evidence(moved, covariance), known)
    assert found.probability == pytest.approx(inside / (inside + outside), rel=1e-6)
    whole = KEPT2 @ P2 @ KEPT2.T + NOISE2
    assert found.distance**2 == pytest.approx(moved @ np.linalg.solve(whole, moved), rel=1e-9)
    assert (found.freedom, found.weight) == (2, 1.0)
    assert found.p_value == pytest.approx(stats.chi2.sf(found.distance**2, 2), rel=1e-9)


@pytest.mark.parametrize("moved", [(0.1, -0.2), (2.5, 0.5), (-1.0, 4.0)])
def test_students_tails_are_an_integral_over_how_wide_a_unit_is(moved):
    """Normal with its covariance divided by g, and g gamma of mean 1: density, p-value, and the mean of g of this unit are sums over g."""
    tails, moved = 5.0, np.array(moved)
    found = belonging(PRIOR2, moved, NOISE2, KEPT2, tails)
    g = np.linspace(0, 12, 60_001)[1:]
    share = stats.gamma(tails / 2, scale=2 / tails).pdf(g) * (g[1] - g[0])
    whole = KEPT2 @ P2 @ KEPT2.T + NOISE2
    square = moved @ np.linalg.solve(whole, moved)
    density = share * g / (2 * np.pi * np.sqrt(np.linalg.det(whole))) * np.exp(-g * square / 2)
    inside, outside = 0.97 * density.sum(), 0.03 * foreign(lambda covariance: evidence(moved, covariance))
    assert found.probability == pytest.approx(inside / (inside + outside), rel=1e-5)
    assert found.p_value == pytest.approx(share @ stats.chi2.sf(g * square, 2), rel=1e-5)
    assert found.weight == pytest.approx(density @ g / density.sum(), rel=1e-5)


def test_a_direction_that_the_session_does_not_see_says_nothing():
    """The second number neither moves nor follows: what is left is an integral over one."""
    kept, noise, moved = np.array([[0.8, 0.3], [0.0, 0.0]]), np.diag([0.25, 0.0]), np.array([2.0, 0.0])
    found = belonging(PRIOR2, moved, noise, kept)

    def of(covariance):
        return stats.norm(0, np.sqrt(kept[0] @ covariance @ kept[0] + 0.25)).pdf(2.0)

    inside, outside = 0.97 * of(P2), 0.03 * foreign(of)
    assert found.freedom == 1
    assert found.probability == pytest.approx(inside / (inside + outside), rel=1e-6)
    assert found.p_value == pytest.approx(stats.chi2.sf(4.0 / (kept[0] @ P2 @ kept[0] + 0.25), 1), rel=1e-6)


@pytest.mark.parametrize(("share", "freedom"), [(1.01e-9, 2), (0.99e-9, 1)])
def test_a_direction_is_seen_from_a_billionth_of_the_priors_variance_on(share, freedom):
    one = GaussianPrior(np.zeros(2), np.eye(2), np.ones(2, dtype=bool))
    assert belonging(one, np.zeros(2), np.diag([1.0, share]), np.zeros((2, 2))).freedom == freedom


def test_a_session_that_sees_nothing_leaves_what_was_probable_before():
    found = belonging(PRIOR2, np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2)))
    assert (found.probability, found.distance, found.freedom, found.p_value) == (0.97, 0.0, 0, 1.0)
    assert (OFF_LOT, OFF_SCALES) == (0.03, (3.0, 10.0, 30.0, 100.0))


# Which number is farthest off, and which lots are of use.


def test_the_farthest_number_is_the_one_least_explained_by_lot_and_fit_and_is_told_in_sigmas_of_the_lot():
    own = lot(SIGMA)
    off = np.zeros(PARAMETERS)
    off[[2, 5, 7]] = -6 * SIGMA[0], 8 * SIGMA[0], 20 * SIGMA[0]
    covariance = np.diag(np.where(np.arange(PARAMETERS) == 5, 3 * SIGMA, 0.0) ** 2)  # 8 / sqrt(1 + 9) = 2.5 of both
    seen = np.arange(PARAMETERS) != 7
    name, sigmas = farthest(own, MEAN + off, covariance, seen)
    assert (name, round(sigmas, 6)) == ("E_xz", -6.0)
    assert farthest(own, MEAN + off, covariance, ~seen)[0] == "E_zy"
    assert farthest(own, MEAN + off, covariance, np.zeros(PARAMETERS, dtype=bool)) is None
    unknown = own.mean.copy()
    unknown[2] = np.nan
    assert farthest(replace(own, mean=unknown), MEAN + off, covariance, seen)[0] == "E_yz"


def test_a_lot_without_any_spread_tells_finite_sigmas():
    name, sigmas = farthest(lot(np.zeros(PARAMETERS)), MEAN + 1e-3 * np.eye(PARAMETERS)[4], 1e-6 * np.eye(PARAMETERS), np.full(12, True))
    assert (name, round(sigmas, 3)) == ("E_yy", 5000.0)  # 1e-3 of a millionth of 0.2


def spread_with(least):
    """A spread (21, 21) of trace 1 whose smallest eigenvalue is this."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(PARAMETERS, PARAMETERS)))[0]
    sizes = np.append(np.full(PARAMETERS - 1, (1 - least) / (PARAMETERS - 1)), least)
    whole = np.full((len(LOT_NAMES), len(LOT_NAMES)), np.nan)
    whole[:PARAMETERS, :PARAMETERS] = turn @ np.diag(sizes) @ turn.T
    return whole


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"sensor": "LSM6DSO"}, "a lot of LSM6DSO, and the session's sensor is ASM330LHH"),
        ({"units": 9}, "a lot of 9 units, expected at least 10"),
        ({"mean": np.full(21, np.nan)}, "tells none of the gyroscope's 12 numbers"),
        ({"spread": spread_with(-1.1e-9)}, "its spread is no covariance"),
        ({"spread": np.where(np.eye(21) > 0, 1.0, np.nan)}, "its spread is no covariance"),
    ],
)
def test_a_lot_that_tells_nothing_of_this_sensor_is_refused(changes, says):
    with pytest.raises(CalibrationError, match=says):
        require_usable(lot(**changes), "ASM330LHH", "lot.json")


def test_a_lot_at_the_limit_is_of_use():
    mean = lot().mean.copy()
    mean[1:] = np.nan
    for changes in ({"units": 10}, {"spread": spread_with(-0.9e-9)}, {"mean": mean}):
        require_usable(lot(**changes), "ASM330LHH", "lot.json")


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
    """``fit_with_lot`` with a belonging of this probability and weight; what was given to the judgement."""

    def __init__(self, problem, monkeypatch, probability, weight=1.0, few=False, options=OPTIONS, noise=None, of=None):
        really, self.given = belonging, []

        def judge(*given):
            self.given.append(given)
            return replace(really(*given), probability=probability, weight=weight)

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
    ((judged, moved, noise, kept, tails),) = found.given
    assert (judged.weight, tails) == (prior.weight, np.inf)
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


@pytest.mark.parametrize(("weight", "factor"), [(0.5, 2.0), (1.25, 0.8)])
def test_with_tails_the_prior_is_as_wide_as_the_unit_is_far_out(problem, monkeypatch, weight, factor):
    found = Judged(problem, monkeypatch, 1.0, weight=weight, of=lot(tails=5.0))
    start = bias_only(problem.still_rates.rate[0]).vector
    prior = prior_of(lot(), start, 5.0).weighed(found.level.prior.weight).scaled(factor)
    assert prior.covariance[0, 0] == pytest.approx(factor * 0.6 * SIGMA[0] ** 2, rel=1e-3)
    np.testing.assert_allclose(found.level.prior.covariance, prior.covariance, rtol=1e-12)
    refits = Refits(problem, prior)
    np.testing.assert_allclose(found.vector, refits.fit, rtol=0, atol=1e-9)
    close(found.use.more, refits.share @ prior.covariance @ refits.share.T, np.sqrt(np.diag(prior.covariance)))


def test_beside_a_fit_the_prior_is_given_only_where_the_unit_belongs(recorded, monkeypatch):
    asked = []
    monkeypatch.setattr(lots_fit, "stated_noise", lambda problem: "its noise")
    for used in ("yes", "partly", "no"):
        use = LotUse("lot.json", "00", 50, Belonging(0.5, 1.0, 12, 0.5), used, np.zeros(12), np.zeros((12, 12)))
        monkeypatch.setattr(lots_fit, "fit_with_lot", lambda *given, use=use: asked.append(given) or (None, None, None, use))
        prior, told = LotFile(lot(), "lot.json", "00").prior_beside(recorded)
        assert told is use
        assert (prior is None) == (used != "yes")
        assert asked[-1][0] is recorded
        assert asked[-1][3] == "its noise"


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


@pytest.mark.broad
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
