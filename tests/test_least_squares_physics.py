"""Least squares by scipy's rotations: its minimum and curvature, what no turn sees, its covariance by refits, chi-square's distribution."""

from dataclasses import replace
from functools import cached_property

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg, optimize, stats
from scipy.linalg import block_diag
from small_turns import PERFECT, TRUE, angles_by_scipy, numeric_jacobian, small_turns, turned_ends, with_known_angles

from session.base import rotation
from session.base.units import DEG, DEG_PER_HOUR, EARTH_RATE_RPS
from tinygc.closure import residual
from tinygc.closure.earth import EarthRate, with_heading
from tinygc.closure.floor import BiasWander, Floor
from tinygc.closure.least_squares import HELD, GaussianPrior, LinearEnds, Nearby, StillRates, _NotSettled, combination, fit_least_squares
from tinygc.closure.uncertainty import GoodnessOfFit, covariance_from_columns, covariance_parts, goodness
from tinygc.inference.choose import MISMATCH_P, chi_square_above, normal_above
from tinygc.inference.prove import signed_ranks_above
from tinygc.inference.solve import inverse_lower, solve_lower
from tinygc.models.linear import BIAS, MATRIX, NAMES, PARAMETERS, PRIOR_SIGMA, LinearModel, bias_only

RNG = np.random.default_rng(11)
START = bias_only(np.array([0.01, -0.02, 0.03]))
REST = np.array([0.02, -0.015, 0.01])
AT_REST = replace(TRUE, B=-TRUE.E @ REST)


STILL_RATES, STILL_SIGMA = 0.02 * RNG.normal(size=(3, 3)), RNG.uniform(1e-4, 3e-4, (3, 3))
MEASURED = StillRates(STILL_RATES, TRUE(STILL_RATES) + STILL_SIGMA * RNG.normal(size=(3, 3)), STILL_SIGMA)
ROOT = 1e-4 * (np.random.default_rng(3).normal(size=(12, 12)) + 2 * np.eye(12))
LOT = GaussianPrior(TRUE.vector + 1e-4, ROOT @ ROOT.T, np.ones(12, dtype=bool), weight=2.5)
UNEVEN = RNG.uniform(0.5e-4, 2e-4, (8, 3))
#: turns, sigma, and what else is given
CASES = {
    "tilt": (small_turns(noise_rad=1e-4), UNEVEN[:, 0], {}),
    "dials": (small_turns(yaw_known=True, noise_rad=1e-4), UNEVEN, {}),
    "known angles": (with_known_angles(small_turns(noise_rad=1e-4)), UNEVEN, {}),
    "still rates and a prior": (small_turns(noise_rad=1e-4), UNEVEN[:, :2], {"still_rates": MEASURED, "prior": LOT}),
    "bias at rest": (small_turns(8, AT_REST, noise_rad=1e-4), UNEVEN[:, :2], {"rest_rps": REST}),
    "bias at rest and a prior": (small_turns(8, AT_REST, noise_rad=1e-4), UNEVEN[:, :2], {"rest_rps": REST, "prior": LOT}),
}


def whitened(parameters, batch, sigma, still_rates=None, rest_rps=None, prior=None):
    """All residuals in sigmas: ends, stills and prior, of 12 parameters, or of the 9 of E where B = -E rest."""
    own = slice(0, len(parameters))
    vector = parameters if rest_rps is None else np.append(parameters, -parameters.reshape(3, 3) @ rest_rps)
    rows = [(angles_by_scipy(batch, vector) / sigma.reshape(len(batch), -1)).ravel()]
    if still_rates is not None:
        model = LinearModel.from_vector(vector)
        rows.append(((still_rates.rate @ model.E.T + model.B - still_rates.earth) / still_rates.sigma).ravel())
    if prior is None:
        rows.append((parameters - START.vector[own]) / PRIOR_SIGMA[own])
    else:
        root = np.linalg.cholesky(prior.covariance[own, own] / prior.weight)
        rows.append(np.linalg.solve(root, parameters - prior.centre[own]))
    return np.concatenate(rows)


@pytest.mark.parametrize("name", CASES)
def test_the_answer_is_the_minimum_and_the_covariance_the_curvature(name):
    """By derivatives of residuals that scipy's rotations give.  The columns are exact to the square of a sample's angle, a thousandth."""
    batch, sigma, given = CASES[name]
    found = fit_least_squares(batch, sigma, START, **given)
    own = MATRIX if "rest_rps" in given else slice(0, 12)

    def residuals(parameters):
        return whitened(parameters, batch, sigma, **given)

    jacobian = numeric_jacobian(residuals, found.model.vector[own])
    expected = np.linalg.inv(jacobian.T @ jacobian)
    error = np.sqrt(np.diag(expected))
    shift = np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ residuals(found.model.vector[own]))
    assert np.abs(shift / error).max() < 5e-3
    assert_allclose(found.covariance[own, own] / np.outer(error, error), expected / np.outer(error, error), atol=5e-3)
    assert found.unobserved == ()
    if "rest_rps" in given:
        assert_allclose(found.model.B, -found.model.E @ REST, rtol=1e-12)
        assert_allclose(np.diag(found.covariance)[BIAS], (HELD * PRIOR_SIGMA[BIAS]) ** 2, rtol=1e-3)


@pytest.mark.parametrize("count", [1, 49, 200])
def test_lower_systems_of_rows_of_any_unit(count):
    """Each element as exactly as substitution gives it: rows differ by ten powers of ten."""
    rng = np.random.default_rng(count)
    factor = np.tril(rng.normal(size=(count, count))) / np.sqrt(count) + np.eye(count)
    factor *= 10.0 ** rng.uniform(-5, 5, (count, 1))
    right = rng.normal(size=(count, 3))
    expected = linalg.solve_triangular(factor, right, lower=True)
    assert_allclose(solve_lower(factor, right), expected, rtol=1e-8)
    assert_allclose(solve_lower(factor, right[:, 0]), expected[:, 0], rtol=1e-8)
    assert_allclose(solve_lower(np.stack([factor, 2 * factor]), np.stack([right, right])), [expected, expected / 2], rtol=1e-8)
    inverse = inverse_lower(factor)
    assert not np.triu(inverse, 1).any()
    assert_allclose(inverse @ factor, np.eye(count), atol=1e-8)


def weakest(batch, about):
    """(3,): strength of the direction that the ends of sigma 1 rad observe least, in units of the prior; the direction (12,)."""
    columns = fit_least_squares(batch, np.full(len(batch), 1e-6), about, begin=about).rows.columns
    _, strength, right = np.linalg.svd(columns.reshape(-1, 12) * PRIOR_SIGMA)
    return strength[-1], right[-1]


@pytest.mark.parametrize(("square", "share"), [(99 * 1.004, 0.99), (99 * 0.996, 0.0)])
def test_a_direction_moves_if_its_sigma_is_below_a_tenth_of_the_priors(square, share):
    """That is from a square of its strength of 99 on: it then goes 99 % of the way from the prior, and else not at all."""
    batch = small_turns()
    strength, direction = weakest(batch, TRUE)
    off = 1e-3 * direction
    start = LinearModel.from_vector(TRUE.vector + off * PRIOR_SIGMA)
    sigma = np.full(len(batch), strength / np.sqrt(square))
    found = fit_least_squares(batch, sigma, start, begin=TRUE)
    moved = direction @ ((found.model.vector - start.vector) / PRIOR_SIGMA)
    assert moved == pytest.approx(-share * 1e-3, abs=1e-6)


@pytest.mark.parametrize(("factor", "hidden"), [(0.998, ()), (1.002, ("E_xy",))])
def test_a_parameter_is_observed_if_its_sigma_is_below_a_tenth_of_the_priors(factor, hidden):
    batch = small_turns()
    columns = fit_least_squares(batch, np.full(len(batch), 1e-6), TRUE, begin=TRUE).rows.columns.reshape(-1, 12)

    def worst(sigma):
        covariance = np.linalg.inv(columns.T @ columns / sigma**2 + np.diag(PRIOR_SIGMA**-2.0))
        return np.sqrt(np.diag(covariance)) / PRIOR_SIGMA

    at = optimize.brentq(lambda sigma: worst(sigma).max() - 0.1, 1e-6, 1.0)
    assert NAMES[np.argmax(worst(at))] == "E_xy"
    assert fit_least_squares(batch, np.full(len(batch), factor * at), TRUE, begin=TRUE).unobserved == hidden


def torn(batch, count, sigma_rad, **given):
    """The refusal of a fitted_to to turns whose first ``count`` end anywhere."""
    by = np.zeros((len(batch), 3))
    by[:count] = 1.5 * np.random.default_rng(0).normal(size=(count, 3))
    with pytest.raises(_NotSettled) as refused:
        fit_least_squares(turned_ends(batch, by), np.full(len(batch), sigma_rad), START, **given)
    return refused.value


def test_a_search_that_does_not_end_tells_what_each_turn_is_off_by():
    """By the model that it begins with; beyond a tenth of what the turn turned, or of two circles, it is beyond any gyroscope."""
    batch = small_turns(8)
    batch = replace(batch, rate=np.where(np.arange(8)[:, None, None] > 5, 12.0, 1.0) * batch.rate)
    steps = np.linalg.norm(START(batch.rate)[:, 1:], axis=2) * batch.dt
    limit = 0.1 * np.minimum(steps.sum(axis=1), 4 * np.pi)
    assert (steps.sum(axis=1) > 4 * np.pi).tolist() == [False] * 6 + [True] * 2
    here = replace(batch, end=residual.end_attitude(batch, START(batch.rate)))
    off = np.zeros((8, 3))
    off[4:, 1] = 4 * np.arcsin(limit[4:] / 4 * [0.999, 1.001, 0.999, 1.001])
    refused = torn(turned_ends(here, off), 4, 1e-5)
    assert_allclose(refused.off_rad[4:], limit[4:] * [0.999, 1.001, 0.999, 1.001], rtol=1e-9)
    assert refused.too_far[4:].tolist() == [False, True, False, True]
    assert refused.loose == ""
    assert "did not settle in 50 steps" in str(refused)


def test_turns_that_bind_a_direction_loosely_are_not_blamed_one_by_one():
    refused = torn(small_turns(seed=1), 3, 0.02)
    assert f"the turns hardly bind {refused.loose}; turn about more axes" in str(refused)
    assert refused.loose.startswith("E_")


def test_a_direction_is_named_by_the_parameters_with_half_its_size():
    direction = np.zeros(12)
    direction[[0, 4, 8, 9, 10]] = -0.4, 0.2, 0.21, -0.4, -0.19
    assert combination(direction) == "E_xx - E_zz + B_x"
    assert combination(-direction) == "E_xx - E_zz + B_x"


@pytest.mark.parametrize(
    ("off_deg", "too_far", "says"),
    [
        ([20, 30, 40, 2], [0, 1, 2], "3 of 4 turns miss gravity by more than 10% of their angle, the median turn by 25.0 deg"),
        ([3, 1, 4, 2], [], "gravity is missed in turn 2 of those used by 4.0 deg, in the median turn by 2.5 deg"),
        ([9, 8, 7, 6, 30, 0, 0, 0], [0, 1, 2, 3], "turn 0 of those used by 9.0 deg, turn 1 of those used by 8.0 deg, turn 2 of those used"),
    ],
)
def test_what_does_not_fit_is_named_the_worst_first_and_three_at_most(off_deg, too_far, says):
    words = str(_NotSettled(np.multiply(off_deg, DEG), np.isin(np.arange(len(off_deg)), too_far), ""))
    assert says in words
    assert "turn 3" not in words.partition("gravity")[2]


DRAWN = np.random.default_rng(0)
#: of each parameter: a sensor ten times as bad as usual
WIDE = np.array([0.05] * 9 + [5 * DEG] * 3)
DRAWS = WIDE * DRAWN.uniform(-1, 1, (5, PARAMETERS))


@pytest.fixture(scope="module", params=["tilt", "tilt and yaw", "a known angle"])
def fine(request):
    """Turns sampled so finely that what the columns leave out lies below the third order; residuals of a milliradian."""
    made = small_turns(5, PERFECT, request.param == "tilt and yaw", noise_rad=1e-3, samples=300)
    return with_known_angles(made, PERFECT) if request.param == "a known angle" else made


def missed(of, exact):
    """Root mean square of what is missed at the drawn models, and at models a tenth as far away."""
    return [np.sqrt(np.mean((of(PERFECT.vector + share * DRAWS) - exact(PERFECT.vector + share * DRAWS)) ** 2)) for share in (1, 0.1)]


def exact_angles(fine):
    return lambda vectors: np.array([angles_by_scipy(fine, vector) for vector in vectors])


def test_the_residual_is_exact_to_second_order(fine):
    """A tenth of the difference leaves a thousandth of the error."""
    nearby = Nearby.about(PERFECT, fine)
    large, small = missed(lambda vectors: 2 * nearby.residuals(vectors), exact_angles(fine))
    assert large < 2e-3
    assert large / small == pytest.approx(1000, rel=0.2)
    # Where the residual is large beside the change, the root of the sum misses by the third order as well.
    weight = DRAWN.uniform(0.5, 2, (len(fine), fine.angles))
    cost = nearby.gathered(weight)
    exact = exact_angles(fine)
    large, small = missed(
        lambda vectors: np.sqrt(cost(vectors)), lambda vectors: np.sqrt(np.sum(exact(vectors) ** 2 / 4 * weight, axis=(1, 2)))
    )
    assert large / small == pytest.approx(1000, rel=0.2)


def test_other_references_need_no_sample(fine):
    """What rates turn the body by does not depend on where it began: the ends and the columns of another accelerometer's attitudes."""
    away = [rotation.exp(DRAWN.normal(0, DEG, (len(fine), 3))) for _ in range(2)]
    bent = replace(fine, start=rotation.multiply(away[0], fine.start), end=rotation.multiply(away[1], fine.end))
    vectors = PERFECT.vector + 0.1 * DRAWS
    turned = Nearby.about(PERFECT, fine).with_references(bent).residuals(vectors)
    assert_allclose(turned, Nearby.about(PERFECT, bent).residuals(vectors), atol=1e-13)
    some = np.arange(len(fine)) % 3 > 0
    assert_allclose(Nearby.about(PERFECT, bent).pick(some).residuals(vectors), turned[:, some], atol=1e-13)
    if fine.turns is not None:
        return  # the columns of a known angle are about its own axis
    rows, anew = LinearEnds.of(PERFECT, fine).rows(bent.pick(some), some), LinearEnds.of(PERFECT, bent)
    assert_allclose(rows.columns, anew.columns[some][:, : fine.angles], atol=1e-13)
    assert_allclose(rows.angles, angles_by_scipy(bent, PERFECT.vector)[some], atol=1e-12)


TURNS = 8
#: (3,) rad/s: twenty times ours, so that its heading counts
EARTH_T = 20 * with_heading(31.03, 10.0).rate_t
SECOND_S = np.arange(TURNS) * 9.0
WANDER = BiasWander(SECOND_S, 40 * DEG_PER_HOUR)


def some_floor(angles, excess=1.0):
    """Each turn has noise of its own, and part of its neighbour's with the opposite sign."""
    rng = np.random.default_rng(2)
    own, others = (1e-4 * (np.eye(angles) + 0.3 * rng.normal(size=(TURNS, angles, angles))) for _ in range(2))
    others[0] = 0.0
    shared = -own[:-1] @ others[1:].transpose(0, 2, 1)
    return Floor(own @ own.transpose(0, 2, 1) + others @ others.transpose(0, 2, 1), shared, excess)


class Data:
    """Turns that close under an Earth; whatever is moved is fitted again."""

    def __init__(self, kind, prior=None):
        batch = small_turns(TURNS, yaw_known=kind == "dials")
        for _ in range(4):  # the Earth in body axes and the attitudes depend on one another
            body = EarthRate(EARTH_T, 0.0, 0.1, "estimated").in_body(residual.attitudes(batch, TRUE(batch.rate)))
            batch = replace(batch, earth=body)
        batch = replace(batch, end=residual.end_attitude(batch, TRUE(batch.rate)))
        self.batch = with_known_angles(batch) if kind == "known angles" else batch
        self.body = residual.attitudes(batch, TRUE(batch.rate))
        self.floor, self.prior = some_floor(self.batch.angles, 1.3), prior

    def fitted(self, ends=0.0, heading=0.0, horizontal=(0.0, 0.0), bias=0.0):
        """(12,): ends (S, 3) rad that the references are turned by, the heading's error, a horizontal rate (2,), and biases (S, 3) rad/s
        beyond the constant one."""
        turned = rotation.matrix(rotation.exp(np.array([0, 0, heading]))) @ EARTH_T + [*horizontal, 0.0]
        moved = EarthRate(turned, 0.0, 0.1, "estimated")
        earth = moved.in_body(self.body) - np.broadcast_to(bias, (TURNS, 3))[:, None]
        batch = turned_ends(replace(self.batch, earth=earth), ends + np.zeros((TURNS, 3)))
        found = fit_least_squares(batch, self.floor.sigma, PERFECT, begin=TRUE, prior=self.prior)
        return found.model.vector

    def answer(self, name, rows, step=1e-5):
        """(12, N): what the parameters answer to the elements of one of the arguments of ``fitted``."""
        units = np.eye(int(np.prod(rows))) * step
        return np.stack([self.fitted(**{name: u.reshape(rows)}) - self.unmoved for u in units], -1) / step

    def covariance(self, rate_t=EARTH_T, **more):
        earth = EarthRate(rate_t, 0.0, 0.6, more.pop("source", "given"))
        return sum(covariance_parts(self.batch, self.floor, TRUE, earth, prior=self.prior, **more).values())

    @cached_property
    def unmoved(self):
        return self.fitted()


@pytest.fixture(scope="module", params=["tilt", "known angles"])
def data(request):
    return Data(request.param, LOT if request.param == "known angles" else None)


@pytest.fixture(scope="module")
def noise_alone(data):
    """By refits with every end moved; a prior pulls, but its own error is not in it."""
    angles = data.batch.angles
    ends = data.answer("ends", (TURNS, 3)).reshape(12, TURNS, 3)[..., :angles].reshape(12, -1)
    return ends @ data.floor.dense() @ ends.T


def same(found, expected, within=0.01):
    """Both in the sigmas of the expected one; the columns are exact to a thousandth."""
    sigma = np.sqrt(np.diag(expected))
    assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), rtol=0, atol=within)


def test_the_noise_of_shared_stills_is_that_of_refits(data, noise_alone):
    same(data.covariance(), noise_alone)


def test_an_estimated_heading_adds_what_a_refit_with_another_heading_answers(data, noise_alone):
    """Of headings that scatter by 0.6 rad, the mean rate has exp(-0.18) of the length; the rest of its square lies across it."""
    answer = data.answer("heading", ())[:, 0] * np.sqrt(np.exp(0.36) - 1)
    same(data.covariance(source="estimated"), noise_alone + np.outer(answer, answer))
    assert np.abs(answer / np.sqrt(np.diag(noise_alone))).max() > 1  # it is seen


def test_an_unknown_heading_adds_what_refits_with_any_horizontal_rate_answer(data, noise_alone):
    """Of the Earth's rate, what is not in the vertical part lies along either axis with half of its square."""
    vertical = np.array([0.0, 0.0, 4e-5])
    answers = data.answer("horizontal", (2,)) * np.sqrt((EARTH_RATE_RPS**2 - vertical[2] ** 2) / 2)
    same(data.covariance(vertical, source="unknown"), noise_alone + answers @ answers.T)
    assert np.abs(answers / np.sqrt(np.diag(noise_alone))[:, None]).max() > 0.2  # it is seen


def test_a_wandering_bias_adds_what_refits_with_other_biases_answer(data, noise_alone):
    answers = data.answer("bias", (TURNS, 3))
    added = answers @ np.kron(WANDER.covariance, np.eye(3)) @ answers.T
    same(data.covariance(wander=WANDER), noise_alone + added)
    assert (np.diag(added) / np.diag(noise_alone)).max() > 0.5


def test_turns_that_say_little_are_weighed_against_the_prior():
    """Sigmas so large that the prior, which has no error of its own here, binds half of the numbers."""
    data = Data("tilt")
    data.floor = floor = replace(data.floor, own=data.floor.own * 9e4, shared=data.floor.shared * 9e4)
    J = numeric_jacobian(lambda x: angles_by_scipy(data.batch, x).ravel(), TRUE.vector)
    weight = 1 / floor.sigma.ravel() ** 2
    answer = np.linalg.solve((J.T * weight) @ J + np.diag(1 / PRIOR_SIGMA**2), J.T * weight)
    same(data.covariance(), answer @ floor.dense() @ answer.T)


def test_the_covariance_from_columns_is_that_of_the_stacked_system():
    """Every row divided by its sigma, the priors' and the other data's among them: the pseudo-inverse takes the rows' covariance along."""
    rng = np.random.default_rng(5)
    count = 14
    design, floor = rng.normal(size=(TURNS, 2, count)), some_floor(2, 1.3)
    prior_rows, other = np.diag([*1 / PRIOR_SIGMA, 1 / 3e-5, 1 / 7e-5]), 1e4 * rng.normal(size=(5, count))
    given = {"more_prior": np.array([3e-5, 7e-5]), "information": other.T @ other}
    weight = 1 / floor.sigma.ravel()
    bias = design[..., BIAS].reshape(2 * TURNS, 3)
    noise = floor.dense() + (bias @ bias.T) * np.kron(WANDER.covariance, np.ones((2, 2)))
    answer = np.linalg.pinv(np.concatenate([design.reshape(2 * TURNS, count) * weight[:, None], prior_rows, other]))
    expected = answer @ block_diag(noise * np.outer(weight, weight), np.eye(len(prior_rows) + len(other))) @ answer.T
    same(covariance_from_columns(design, floor, WANDER, **given), expected, within=1e-6)


@pytest.mark.parametrize("kind", ["tilt", "a bias that wanders", "a known angle"])
def test_chi_square_is_what_twelve_free_numbers_leave_of_the_angles(kind):
    """Generalised least squares with numeric derivatives, floor and wander; a degree of freedom for each known angle, less twelve."""
    batch = Data("known angles" if kind == "a known angle" else "tilt", False).batch
    batch = turned_ends(batch, 3e-4 * np.random.default_rng(0).normal(size=(TURNS, 3)))
    floor, wander = some_floor(batch.angles), WANDER if kind == "a bias that wanders" else None
    J = numeric_jacobian(lambda at: angles_by_scipy(batch, at).ravel(), TRUE.vector)
    C = floor.dense() + (0 if wander is None else (J[:, BIAS] @ J[:, BIAS].T) * np.kron(wander.covariance, np.ones((2, 2))))
    known = batch.known.ravel()
    r, root = angles_by_scipy(batch, TRUE.vector).ravel()[known], np.linalg.cholesky(C[np.ix_(known, known)])
    _, (left,), *_ = np.linalg.lstsq(np.linalg.solve(root, J[known] * PRIOR_SIGMA), np.linalg.solve(root, r), rcond=None)
    found = goodness(batch, floor, TRUE, wander)
    assert found.freedom == known.sum() - 12
    assert found.chi_square == pytest.approx(left, rel=0.01)
    assert found.p_value == pytest.approx(stats.chi2.sf(found.chi_square, found.freedom), rel=1e-9, abs=0)


def test_numbers_that_no_turn_shows_take_no_degree_of_freedom():
    batch = small_turns(20)
    batch.rate[..., 0] = 0.0  # the first column of E, three numbers, multiplies nothing
    floor = Floor(np.tile(1e-8 * np.eye(2), (20, 1, 1)), np.zeros((19, 2, 2)))
    assert goodness(batch, floor, TRUE).freedom == batch.known.sum() - 9


@pytest.mark.parametrize(
    ("chi_square", "p_value", "excess"), [(20.0, MISMATCH_P, 1.0), (20.0, 0.99 * MISMATCH_P, 2.0), (5.0, 0.001, 1.0), (30.0, 0.0, 3.0)]
)
def test_the_variance_is_widened_below_one_percent_and_never_narrowed(chi_square, p_value, excess):
    assert MISMATCH_P == 0.01
    assert GoodnessOfFit(chi_square, 10, p_value).excess == excess


@pytest.mark.parametrize("freedom", [1, 2, 10, 63, 64, 2001])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, 50.0])
def test_chi_square(freedom, share):
    assert chi_square_above(share * freedom, freedom) == pytest.approx(stats.chi2.sf(share * freedom, freedom), rel=1e-10, abs=1e-300)


@pytest.mark.parametrize("sigmas", [-3.0, 0.0, 0.5, 3.0, 20.0])
def test_normal(sigmas):
    assert normal_above(sigmas) == pytest.approx(stats.norm.sf(sigmas), rel=1e-12, abs=0)


@pytest.mark.parametrize(("count", "digits"), [(1, 9), (12, 9), (50, 9), (51, 9), (6, 1), (200, 1)])
def test_signed_ranks(count, digits):
    """Also with ties and zeros, where scipy is exact, up to 13, and where both are normal."""
    differences = np.round(np.random.default_rng(count).normal(0.3, 1, count), digits)
    differences[0] *= digits > 1
    assert signed_ranks_above(differences) == pytest.approx(stats.wilcoxon(differences, alternative="greater").pvalue, rel=1e-9)
