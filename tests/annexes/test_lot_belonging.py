"""A lot's prior and whether a unit belongs to it, against direct integration over the unit's true numbers."""

from dataclasses import replace

import numpy as np
import pytest
from lots import MEAN, SIGMA, lot
from scipy import stats

from tinygc import CalibrationError
from tinygc.annexes.lots.fit import OFF_LOT, OFF_SCALES, belonging, farthest, prior_of, require_usable
from tinygc.annexes.lots.lot import NAMES as LOT_NAMES
from tinygc.closure.prior import GaussianPrior, vague
from tinygc.models.linear import PARAMETERS, PRIOR_SIGMA

RNG = np.random.default_rng(7)


def some_covariance(size):
    root = RNG.normal(size=(len(size), len(size))) + 2 * np.eye(len(size))
    return root @ root.T * np.outer(size, size) / len(size)


# The prior of the next session of a unit.


def test_the_variance_is_that_of_the_mean_the_spread_and_the_change_between_sessions():
    """Each number by itself; an unknown repeatability is none."""
    parts = [np.linspace(1e-4, size, len(LOT_NAMES)) for size in (2e-4, 3e-4, 4e-4)]
    known = replace(lot(), mean_sigma=parts[0], spread=parts[1], repeatability=parts[2])
    found = prior_of(known, MEAN + 1.0)
    np.testing.assert_allclose(found.covariance, np.diag(sum(each[:PARAMETERS] ** 2 for each in parts)), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.centre, MEAN)
    assert found.known.all()
    single = prior_of(replace(known, repeatability=np.full(len(LOT_NAMES), np.nan)), MEAN)
    np.testing.assert_allclose(single.covariance, np.diag((parts[0] ** 2 + parts[1] ** 2)[:PARAMETERS]), rtol=0, atol=1e-12)


def test_a_number_that_the_lot_does_not_tell_is_as_open_as_without():
    """NaN in mean or spread: its centre is the start's, its sigma the generous one."""
    known = lot(np.full(PARAMETERS, 1e-4))
    mean, spread = known.mean.copy(), known.spread.copy()
    mean[4] = spread[9] = np.nan
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
    assert found.freedom == 2
    assert found.p_value == pytest.approx(stats.chi2.sf(found.distance**2, 2), rel=1e-9)


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


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"sensor": "LSM6DSO"}, "a lot of LSM6DSO, and the session's sensor is ASM330LHH"),
        ({"units": 9}, "a lot of 9 units, expected at least 10"),
        ({"mean": np.full(21, np.nan)}, "tells none of the gyroscope's 12 numbers"),
        ({"spread": np.full(21, np.nan)}, "tells none of the gyroscope's 12 numbers"),
    ],
)
def test_a_lot_that_tells_nothing_of_this_sensor_is_refused(changes, says):
    with pytest.raises(CalibrationError, match=says):
        require_usable(lot(**changes), "ASM330LHH", "lot.json")
