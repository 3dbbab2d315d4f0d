"""The covariance of the parameters is that of refits to perturbed data; chi-square has its degrees of freedom.

Every source of error is moved by a small step, everything is fitted again, and what the parameters answer is multiplied by the
source's covariance.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import block_diag
from small_turns import PERFECT, TRUE, angles_by_scipy, small_turns, turned_ends, with_known_angles

from session.io.units import DEG, DEG_PER_HOUR
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.attitude.earth import EarthRate, with_heading
from tinygc.closure.floor import BiasWander, Floor
from tinygc.closure.least_squares import StillRates, fit_least_squares
from tinygc.closure.prior import GaussianPrior
from tinygc.closure.uncertainty import MISMATCH_P, GoodnessOfFit, covariance_from_columns, goodness, parameter_covariance
from tinygc.models.linear import BIAS, PRIOR_SIGMA

TURNS, STILLS = 8, 3
#: (3,) rad/s: twenty times ours, so that its heading counts
EARTH_T = 20 * with_heading(31.03, 10.0).rate_t
SECOND_S = np.arange(TURNS) * 9.0
WANDER = BiasWander(SECOND_S, 40 * DEG_PER_HOUR)
STILL_S = np.array([-3.0, 30.0, 70.0])


def some_floor(angles, excess=1.0):
    """Each turn has noise of its own, and part of its neighbour's with the opposite sign."""
    rng = np.random.default_rng(2)
    own, others = (1e-4 * (np.eye(angles) + 0.3 * rng.normal(size=(TURNS, angles, angles))) for _ in range(2))
    others[0] = 0.0
    shared = -own[:-1] @ others[1:].transpose(0, 2, 1)
    return Floor(own @ own.transpose(0, 2, 1) + others @ others.transpose(0, 2, 1), shared, excess)


class Data:
    """Turns that close, and stills, under an Earth; whatever is moved is fitted again."""

    def __init__(self, kind, with_stills, prior=None):
        batch = small_turns(TURNS, yaw_known=kind == "dials")
        for _ in range(4):  # the Earth in body axes and the attitudes depend on one another
            body = EarthRate(EARTH_T, 0.0, 0.1, "estimated").in_body(closure.attitudes(batch, TRUE(batch.rate)))
            batch = replace(batch, earth=body)
        batch = replace(batch, end=closure.end_attitude(batch, TRUE(batch.rate)))
        self.batch = with_known_angles(batch) if kind == "known angles" else batch
        self.body = closure.attitudes(batch, TRUE(batch.rate))
        self.floor, self.prior, self.stills = some_floor(self.batch.angles, 1.3), prior, None
        if with_stills:
            rng = np.random.default_rng(4)
            q_tb = rotation.exp(rng.normal(size=(STILLS, 3)))
            earth = EarthRate(EARTH_T, 0.0, 0.1, "estimated").in_body(q_tb)
            measured = (earth - TRUE.B) @ np.linalg.inv(TRUE.E).T
            self.stills = StillRates(measured, earth, rng.uniform(1e-4, 3e-4, (STILLS, 3)), q_tb, STILL_S)

    def fitted(self, ends=0.0, stills=0.0, heading=0.0, horizontal=(0.0, 0.0), bias=0.0, still_bias=0.0):
        """(12,): ends (S, 3) rad that the references are turned by, stills (Q, 3) rad/s added to the calibrated rates of stills, the
        heading's error, a horizontal rate (2,), and biases (S, 3), (Q, 3) rad/s beyond the constant one."""
        turned = rotation.matrix(rotation.exp(np.array([0, 0, heading]))) @ EARTH_T + [*horizontal, 0.0]
        moved = EarthRate(turned, 0.0, 0.1, "estimated")
        earth = moved.in_body(self.body) - np.broadcast_to(bias, (TURNS, 3))[:, None]
        batch = turned_ends(replace(self.batch, earth=earth), ends + np.zeros((TURNS, 3)))
        rates = None
        if self.stills is not None:
            rates = replace(self.stills, earth=moved.in_body(self.stills.q_tb) - stills - still_bias)
        found = fit_least_squares(batch, self.floor.sigma, PERFECT, still_rates=rates, begin=TRUE, prior=self.prior)
        return found.model.vector

    def answer(self, name, rows, step=1e-5):
        """(12, N): what the parameters answer to the elements of one of the arguments of ``fitted``."""
        units = np.eye(int(np.prod(rows))) * step
        return np.stack([self.fitted(**{name: u.reshape(rows)}) - self.unmoved for u in units], -1) / step

    def covariance(self, **more):
        earth = EarthRate(EARTH_T, 0.0, 0.6, more.pop("source", "given"))
        return parameter_covariance(self.batch, self.floor, TRUE, earth, self.stills, prior=self.prior, **more)

    @cached_property
    def unmoved(self):
        return self.fitted()


def some_prior():
    root = np.random.default_rng(3).normal(size=(12, 12)) + 2 * np.eye(12)
    return GaussianPrior(TRUE.vector + 1e-4, 1e-8 * root @ root.T, np.ones(12, dtype=bool), weight=2.5)


@pytest.fixture(scope="module", params=[("tilt", False, False), ("dials", True, False), ("known angles", True, True)], ids=str)
def data(request):
    kind, with_stills, with_prior = request.param
    return Data(kind, with_stills, some_prior() if with_prior else None)


@pytest.fixture(scope="module")
def noise_alone(data):
    """By refits with every end and every still moved; a prior pulls, but its own error is not in it."""
    angles = data.batch.angles
    ends = data.answer("ends", (TURNS, 3)).reshape(12, TURNS, 3)[..., :angles].reshape(12, -1)
    covariance = ends @ data.floor.dense() @ ends.T
    if data.stills is not None:
        stills = data.answer("stills", (STILLS, 3)) * data.stills.sigma.ravel()
        covariance = covariance + stills @ stills.T
    return covariance


def same(found, expected, within=0.01):
    """Both in the sigmas of the expected one; the columns are exact to a thousandth."""
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), rtol=0, atol=within)


def test_shared_stills_and_the_noise_of_rates_are_those_of_refits(data, noise_alone):
    same(data.covariance(), noise_alone)


def test_an_estimated_heading_adds_what_a_refit_with_another_heading_answers(data, noise_alone):
    """Of headings that scatter by 0.6 rad, the mean rate has exp(-0.18) of the length; the rest of its square lies across it."""
    answer = data.answer("heading", ())[:, 0] * np.sqrt(np.exp(0.36) - 1)
    same(data.covariance(source="estimated"), noise_alone + np.outer(answer, answer))
    assert np.abs(answer / np.sqrt(np.diag(noise_alone))).max() > 1  # it is seen


@pytest.mark.parametrize("mean_rps", [(0.0, 0.0), (3e-5, 2e-5)])
def test_an_unknown_heading_adds_what_refits_with_other_horizontal_rates_answer(data, mean_rps):
    """15.04 deg/h cos(latitude) long, less the mean that is taken off, in any direction: half of its square on either axis."""
    rate_t = np.array([*mean_rps, -15.041 * DEG_PER_HOUR * np.sin(31.03 * DEG)])
    known, unknown = (
        parameter_covariance(data.batch, data.floor, TRUE, EarthRate(rate_t, None, np.inf, source), data.stills, prior=data.prior)
        for source in ("given", "unknown")
    )
    square = (15.041 * DEG_PER_HOUR * np.cos(31.03 * DEG)) ** 2 - mean_rps[0] ** 2 - mean_rps[1] ** 2
    answer = data.answer("horizontal", (2,)) * np.sqrt(square / 2)
    same(unknown - known, answer @ answer.T)


def test_a_wandering_bias_adds_what_refits_with_other_biases_answer(data, noise_alone):
    """In turns and stills together: one that lasts from a turn to a still is common to both."""
    answers = data.answer("bias", (TURNS, 3))
    covariance = np.kron(WANDER.covariance(), np.eye(3))
    if data.stills is not None:
        answers = np.concatenate([answers, data.answer("still_bias", (STILLS, 3))], axis=1)
        covariance = np.kron(WANDER.covariance(STILL_S), np.eye(3))
    added = answers @ covariance @ answers.T
    same(data.covariance(wander=WANDER), noise_alone + added)
    assert (np.diag(added) / np.diag(noise_alone)).max() > 0.5


def test_stills_without_a_moment_or_an_attitude_add_their_noise_alone():
    """What the turns answer is weighed anew: H M H is their own, and (H + A) is the information with the stills'."""
    data, turns = Data("tilt", True), Data("tilt", False)
    told = {"source": "estimated", "wander": WANDER}
    before = data.covariance(**told)
    data.stills = replace(data.stills, middle_s=None, q_tb=None)
    of_turns = np.linalg.inv(fit_least_squares(data.batch, data.floor.sigma, TRUE, begin=TRUE).covariance)
    rows = data.stills.columns()
    of_stills, inverse = rows.T @ rows, np.linalg.inv(of_turns + rows.T @ rows)
    expected = inverse @ (of_turns @ turns.covariance(**told) @ of_turns + of_stills) @ inverse
    same(data.covariance(**told), expected)
    assert np.abs(np.diag(before) / np.diag(expected) - 1).max() > 0.03


# From columns alone.


@pytest.mark.parametrize("more", [False, True])
def test_the_covariance_from_columns_is_that_of_the_stacked_system(more):
    """Every row divided by its sigma, the priors' and the other data's among them: the pseudo-inverse takes the rows' covariance along."""
    rng = np.random.default_rng(5)
    count = 14 if more else 12
    design, floor = rng.normal(size=(TURNS, 2, count)), some_floor(2, 1.3)
    given, prior_rows, other = {}, np.diag(1 / PRIOR_SIGMA), np.zeros((0, count))
    if more:
        prior_rows = block_diag(prior_rows, np.diag([1 / 3e-5, 1 / 7e-5]))
        other = 1e4 * rng.normal(size=(5, count))
        given = {"more_prior": np.array([3e-5, 7e-5]), "information": other.T @ other}
    weight = 1 / floor.sigma.ravel()
    bias = design[..., BIAS].reshape(2 * TURNS, 3)
    noise = floor.dense() + (bias @ bias.T) * np.kron(WANDER.covariance(), np.ones((2, 2)))
    answer = np.linalg.pinv(np.concatenate([design.reshape(2 * TURNS, count) * weight[:, None], prior_rows, other]))
    expected = answer @ block_diag(noise * np.outer(weight, weight), np.eye(len(prior_rows) + len(other))) @ answer.T
    same(covariance_from_columns(design, floor, WANDER, **given), expected, within=1e-6)


# Goodness of fit.


@pytest.fixture(scope="module", params=["tilt", "a bias that wanders", "a known angle"])
def form(request):
    """Chi-square as the quadratic form Q of all angles, by the squares of their sums, and the angles' covariance C."""
    batch = Data("known angles" if request.param == "a known angle" else "tilt", False).batch
    known, floor = batch.known.ravel(), some_floor(batch.angles)
    wander = WANDER if request.param == "a bias that wanders" else None
    covariance = floor.dense()
    if wander is not None:
        each = np.stack([angles_by_scipy(replace(batch, earth=batch.earth - step), TRUE.vector) for step in 1e-5 * np.eye(3)], -1) / 1e-5
        bias = each.reshape(-1, 3)
        covariance = covariance + (bias @ bias.T) * np.kron(wander.covariance(), np.ones((2, 2)))

    def found(angles):
        moved = np.zeros((TURNS, 3))
        moved[:, : batch.angles] = angles.reshape(TURNS, -1)
        return goodness(turned_ends(batch, -moved), floor, TRUE, wander)

    units = 1e-5 * np.eye(len(known))[known]
    single = np.array([found(u).chi_square for u in units])
    Q = np.diag(single)
    for i, j in zip(*np.triu_indices(len(units), 1), strict=True):
        Q[i, j] = Q[j, i] = (found(units[i] + units[j]).chi_square - single[i] - single[j]) / 2
    return Q * 1e10, covariance[np.ix_(known, known)], found(units[0])


def test_chi_square_of_the_noise_has_the_distribution_that_it_is_said_to_have(form):
    """Kolmogorov and Smirnov over 10^4 draws; the form is a projection on as many directions as there are degrees of freedom."""
    Q, C, found = form
    assert found.freedom == len(Q) - 12
    assert np.trace(Q @ C) == pytest.approx(found.freedom, rel=2e-3)
    y = np.linalg.cholesky(C) @ np.random.default_rng(0).normal(size=(len(C), 10_000))
    chi_square = np.einsum("in,ij,jn->n", y, Q, y)
    assert stats.kstest(chi_square, stats.chi2(found.freedom).cdf).pvalue > 0.05
    assert found.p_value == pytest.approx(stats.chi2.sf(found.chi_square, found.freedom), rel=1e-9)


def test_turns_that_the_parameters_fit_exactly_show_no_mismatch():
    batch = turned_ends(small_turns(5), 1e-2 * np.random.default_rng(0).normal(size=(5, 3)))
    floor = Floor(np.tile(1e-8 * np.eye(2), (5, 1, 1)), np.zeros((4, 2, 2)))
    found = goodness(batch, floor, TRUE)
    assert (found.freedom, round(found.chi_square, 6), round(found.p_value, 3)) == (1, 0.0, 1.0)


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
