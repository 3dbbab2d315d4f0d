"""What a fit states of its numbers: derivatives of the estimate by each error, times the errors' covariance; the sum of its sources."""

from dataclasses import replace
from functools import cache, cached_property
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, t
from small_sessions import attitudes_by_scipy, small_session
from small_turns import TRUE, angles_by_scipy, numeric_jacobian

from session.base.units import DEG, EARTH_RATE_RPS, MG
from session.detect.stills import BLOCK_S, NOISE_BLOCKS
from tinygc.closure.build import with_still_bias
from tinygc.closure.floor import (
    DIALS,
    GYRO_NOISE,
    SINGLE_SEGMENTS,
    BiasInstability,
    allan_freedom,
)
from tinygc.closure.joint import fit_joint
from tinygc.closure.least_squares import GaussianPrior
from tinygc.closure.uncertainty import BIAS_DRIFT, EARTH
from tinygc.estimation import stated_noise as stating
from tinygc.estimation.stated_noise import (
    CALIBRATION,
    CLOCK,
    COMPONENTS,
    MISFIT,
    ROUNDING,
    StatedNoise,
    _accelerometer_factor,
    channel_sources,
    kind_of,
    prior_share,
    rounding_covariance,
    shared_part,
    stated_covariance,
    stated_goodness,
    stated_joint_covariance,
    stated_noise,
    stated_response,
    stated_sources,
    stated_uncertainty,
)
from tinygc.inference.solve import coverage_factor, effective_freedom, freedom_of, total
from tinygc.models.linear import BIAS, MATRIX, PRIOR_SIGMA, LinearModel
from tinygc.noise.components import REFERENCE, STILL_RATE, TURN, WANDER, first_noise
from tinygc.noise.refit import calibration_columns, prior_sigmas
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import ACCEL_INSTABILITY_MPS2, PRECALIBRATION_MPS2, Whitener

#: rad/s: the mean of the Earth's horizontal rate over the headings that the stills leave possible
MEAN_RPS = (2e-5, 3e-5)
PLAIN = {"kind": "tilt", "stills": False, "prior": False}
CASES = {
    "known angles": PLAIN | {"kind": "known", "prior": True},
    "bias of the stills": PLAIN | {"stills": True},
}


class Estimate:
    """The twelve numbers as a function of every error: one Gauss-Newton step with numeric derivatives from the true ones.

    The fit minimises the weighted closure, with the stills' rates as the turns' bias (``stills``), and what is known
    beforehand.
    """

    def __init__(self, kind, stills, prior, **more):
        self.plain, self.stills = small_session(kind=kind, **more), stills
        covariance = np.diag(PRIOR_SIGMA**2)
        if prior:
            root = np.diag(0.01 * PRIOR_SIGMA) @ (np.eye(12) + 0.2 * np.random.default_rng(1).normal(size=(12, 12)))
            self.plain = self.plain.changed(prior=GaussianPrior(TRUE.vector, root @ root.T, np.ones(12, dtype=bool), 2.5))
            covariance = root @ root.T / 2.5
        self.problem = with_still_bias(self.plain) if stills else self.plain
        self.problem.__dict__["instability"] = self.plain.instability
        self.number, own = len(self.plain.still_rates.rate), self.plain.floor.own
        variance = [1.3**2 * (own[:, 0, 0] + own[:, 1, 1]) / 2] * 2 + [own[:, i, i] for i in range(2, own.shape[1])]
        self.weight = 1 / np.sqrt(np.stack(variance, axis=1)).ravel()
        self.closure, self.count = len(self.weight), len(self.weight) + 4 * self.number
        self.at = TRUE.vector[:9] if stills else TRUE.vector
        size = len(self.at)
        self.information = np.linalg.inv(covariance[:size, :size])
        self.jacobian = numeric_jacobian(self.residuals, self.at, 1e-4)
        self.hessian = self.jacobian.T @ self.jacobian + self.information
        self.first = self.residuals(self.at)
        self.model = LinearModel(TRUE.E, -TRUE.E @ self.problem.rest_rps) if stills else TRUE

    def whole(self, at, problem):
        """All twelve of the numbers that are fitted."""
        return np.append(at, -at.reshape(3, 3) @ problem.rest_rps) if self.stills else at

    def residuals(self, at, y=None, earth=None):
        """In sigmas: of the numbers, errors y (n,) of the channels, and a further rate (3,) of the Earth in the table's axes."""
        problem = self.moved(y, earth)
        angles = angles_by_scipy(problem.batch, self.whole(at, problem)).ravel() + (0 if y is None else y[: self.closure])
        return angles * self.weight

    def moved(self, y, earth):
        """The problem with wrong rates of its stills and a wrong Earth."""
        problem = self.plain
        rates, batch = problem.still_rates, problem.batch
        if y is not None:
            off = y[self.closure : -self.number].reshape(-1, 3)
            rates = replace(rates, rate=rates.rate + off @ np.linalg.inv(TRUE.E).T)
        if earth is not None:
            q = Rotation.from_quat(rates.q_tb, scalar_first=True)
            rates = replace(rates, earth=rates.earth + q.inv().apply(earth))
            batch = replace(batch, earth=batch.earth + self.turned_back @ earth)
        problem = problem.changed(still_rates=rates, batch=batch)
        return with_still_bias(problem) if self.stills else problem

    @cached_property
    def turned_back(self):
        """(S, T, 3, 3) from the table to the body, by scipy."""
        batch = self.plain.batch
        start, body = Rotation.from_quat(batch.start, scalar_first=True), batch.rate @ TRUE.E.T + TRUE.B - batch.earth
        return np.array([attitudes_by_scipy(*each).inv().as_matrix() for each in zip(start, body, batch.dt, strict=True)])

    def closures(self, y=None, earth=None):
        """In rad, of the true numbers with these errors."""
        return self.residuals(self.at, y, earth)[: self.closure] / self.weight

    @cached_property
    def closures_by_error(self):
        """(…, n) by the error of each channel."""
        return numeric_jacobian(self.closures, np.zeros(self.count), 1e-4)

    def solved(self, y=None, earth=None):
        """The twelve numbers with these errors."""
        at = self.at - np.linalg.solve(self.hessian, self.jacobian.T @ (self.residuals(self.at, y, earth) - self.first))
        return self.whole(at, self.moved(y, earth))

    @cached_property
    def response(self):
        """(12, n) by the error of each channel; of the lengths none."""
        n = self.count - self.number
        by_error = numeric_jacobian(lambda y: self.solved(np.append(y, np.zeros(self.number))), np.zeros(n), 1e-4)
        return np.pad(by_error, ((0, 0), (0, self.number)))

    @cached_property
    def by_earth(self):
        """(12, 3) by the Earth's rate in the table's axes."""
        return numeric_jacobian(lambda earth: self.solved(earth=earth), np.zeros(3), 1e-5)


@cache
def made(case, **more):
    return Estimate(**(CASES[case] | more))


def under(problem, source, mean_rps=MEAN_RPS):
    """A problem whose Earth's rate is of another source, with a mean (2,) over the possible headings that is taken off."""
    found = problem.changed(earths={0: replace(problem.earths[0], source=source, rate_t=np.array([*mean_rps, -3.7e-5]))})
    found.__dict__["instability"] = problem.instability
    return found


def loud(problem):
    """Noise with components of all kinds, of sizes that all count."""
    twin = Twin(problem)
    whiten = Whitener(twin)
    noise = first_noise(twin, whiten)
    sizes = {TURN: 3e-4, STILL_RATE: 1e-4, REFERENCE: 2 * MG}
    noise = replace(noise, s=np.array([sizes.get(c.name, c.usual) for c in noise.components]))
    columns = np.random.default_rng(3).normal(size=(len(whiten.white), 12)) * 1e-4
    return StatedNoise(twin, noise, whiten.white, columns)


def alike(found, expected, share=0.01):
    """To a share of what the errors of both amount to."""
    sigma = np.sqrt(np.diag(expected))
    assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=share)


@pytest.mark.parametrize("case", CASES)
def test_the_covariance_is_that_of_all_errors(case):
    """Of the channels, as far as they are estimated; of the accelerometer, which sessions share; and of the Earth's horizontal rate, as far
    as its mean over the possible headings leaves it out."""
    by_hand = made(case)
    noise = loud(by_hand.problem)
    L, by_earth = by_hand.response, by_hand.by_earth
    response = stated_response(by_hand.problem, by_hand.model)
    for rows in (MATRIX, BIAS):
        assert_allclose(response[rows], L[rows], atol=5e-3 * np.abs(L[rows]).max())
    channels = noise.white + noise.noise.covariance
    accelerometer = L @ noise.accelerometer @ noise.accelerometer.T @ L.T
    expected = L @ channels @ L.T + accelerometer
    given, shared = stated_covariance(under(by_hand.problem, "given"), by_hand.model, noise)
    alike(given, expected)
    alike(shared, accelerometer)
    assert_allclose(noise.covariance, channels + noise.accelerometer @ noise.accelerometer.T)
    # 15.04 deg/h x cos(latitude) long, less the mean: across the mean, or in any horizontal direction.
    for source, mean in (("estimated", MEAN_RPS), ("unknown", MEAN_RPS), ("none", (0.0, 0.0))):
        left = (EARTH_RATE_RPS * np.cos(31.03 * DEG)) ** 2 - np.dot(mean, mean)
        across = by_earth[:, :2] @ np.array([-mean[1], mean[0]]) / np.hypot(*MEAN_RPS)
        part = np.outer(across, across) if source == "estimated" else by_earth[:, :2] @ by_earth[:, :2].T / 2
        found, _ = stated_covariance(under(by_hand.problem, source, mean), by_hand.model, noise)
        alike(found - given + np.eye(12) * 1e-20, part * left * (source != "none") + np.eye(12) * 1e-20, 0.06)


@pytest.mark.parametrize("case", CASES)
def test_a_wrong_centre_of_the_prior_moves_the_numbers_by_its_share(case):
    """H^-1 P^-1; a bias of the stills follows the matrix, whatever was thought of the bias."""
    by_hand = made(case)
    own = np.linalg.solve(by_hand.hessian, by_hand.information)
    expected = np.zeros((12, 12))
    expected[: len(own), : len(own)] = own
    if by_hand.stills:
        expected[BIAS, MATRIX] = -np.kron(np.eye(3), by_hand.problem.rest_rps) @ own
    found = prior_share(by_hand.problem, by_hand.model)
    assert_allclose(found, expected, atol=0.01 * np.abs(expected).max())
    assert_allclose(found * PRIOR_SIGMA / PRIOR_SIGMA[:, None], expected * PRIOR_SIGMA / PRIOR_SIGMA[:, None], atol=0.01)


@pytest.mark.parametrize("times", [1.0, 1000.0])
@pytest.mark.parametrize("case", CASES)
def test_the_goodness_of_fit_is_chi_square_of_what_free_numbers_leave(case, times):
    """Generalised least squares with the covariance of all noise that has a cause: one degree of freedom for each angle that is known, less
    one for each number.  The variance inflation has the error of each turn as well."""
    by_hand = made(case)
    problem, noise, s = by_hand.problem, loud(by_hand.problem), by_hand.closure
    quieter = replace(noise.noise, s=noise.noise.s / np.sqrt(times))
    noise = replace(noise, white=noise.white / times, noise=quieter, accelerometer=noise.accelerometer / np.sqrt(times))
    problem = under(problem, "unknown")
    known = np.ones(s, dtype=bool)
    if problem.batch.turns is not None:
        known[5] = False  # the second turn's angle

    by_earth = numeric_jacobian(lambda earth: by_hand.closures(earth=earth), np.zeros(3), 1e-5)[:, :2]
    left_out = (EARTH_RATE_RPS * np.cos(31.03 * DEG)) ** 2 - np.dot(MEAN_RPS, MEAN_RPS)
    by_error, J, r = by_hand.closures_by_error, by_hand.jacobian[:s] / by_hand.weight[:, None], by_hand.closures()

    def left(covariance):
        C = by_error @ covariance @ by_error.T + by_earth @ by_earth.T * left_out / 2
        inverse, A = np.linalg.inv(C[np.ix_(known, known)]), J[known]
        project = inverse - inverse @ A @ np.linalg.solve(A.T @ inverse @ A, A.T @ inverse)
        return r[known] @ project @ r[known]

    quiet = noise.noise.s * [c.name != TURN for c in noise.noise.components]
    named = noise.white + replace(noise.noise, s=quiet).covariance + noise.accelerometer @ noise.accelerometer.T
    assert_allclose(noise.named, named)
    freedom = max(known.sum() - (9 if by_hand.stills else 12), 1)
    found, inflation = stated_goodness(problem, by_hand.model, noise)
    assert found.freedom == freedom
    assert found.chi_square == pytest.approx(left(named), rel=0.02)
    assert found.p_value == pytest.approx(chi2.sf(found.chi_square, freedom))
    whole = left(noise.covariance)
    assert inflation == pytest.approx(max(1.0, whole / freedom) if chi2.sf(whole, freedom) < 0.01 else 1.0, rel=0.02)
    assert (inflation > 1.0) is (times > 1)


def twice_minus_log(s, y, J, base, components):
    """-2 log of the density of rows y (n,) with the columns' coefficients normal, and of the sizes' priors."""
    C = base + J @ J.T
    value = 0.0
    for size, c in zip(s, components, strict=True):
        C = C + size**2 * (c.V if isinstance(c.V, np.ndarray) else c.V.dense())
        value += 0.0 if c.prior is None else c.prior.apart(size)[0] ** 2
    return value + np.linalg.slogdet(C)[1] + y @ np.linalg.solve(C, y)


def by_force(twin):
    """(n, 12) what each error of the accelerometer's bias (3) and matrix (9, row by row, at 1 g) adds to the residuals, m/s^2: attitudes
    by scipy, rotated the shortest way to where gravity is vertical."""
    down = twin.force / np.linalg.norm(twin.force, axis=1, keepdims=True)
    there = Rotation.from_quat(twin.q_tb, scalar_first=True)

    def look(by):
        force = twin.force - by[:3] - down @ by[3:].reshape(3, 3).T
        vertical = there.apply(-force / np.linalg.norm(force, axis=1, keepdims=True))
        across = np.cross(vertical, [0, 0, 1.0])
        size = np.linalg.norm(across, axis=1, keepdims=True)
        q = (Rotation.from_rotvec(across / size * np.arctan2(size, vertical[:, 2:])) * there).as_quat(scalar_first=True)
        batch = replace(twin.batch, start=q[twin.first], end=q[twin.last])
        return np.concatenate([angles_by_scipy(batch, TRUE.vector).ravel(), np.zeros(3 * len(q)), np.linalg.norm(force, axis=1)])

    return numeric_jacobian(look, np.zeros(12), 1e-3)


KINDS = {"of its own stills": {"triangle": True}, "prior": {}}


@pytest.mark.parametrize("kind", KINDS)
def test_the_noise_is_what_makes_the_residuals_most_probable(kind):
    """Restricted likelihood by its definition: the residuals before any fit, columns of all that is fitted with their priors.

    White noise includes an allowance for a given calibration, for the estimate only.  An accelerometer calibrated in the same stills has
    taken up part of their scatter; one that is estimated with the gyroscope has no instability of its class besides.
    """
    problem = small_session(noise=2.0, seed=2, **KINDS[kind])
    joint = fit_joint(problem, kind, 0.3) if kind == "prior" else None
    if joint is not None:
        problem = problem.changed(joint=joint)
    found = stated_noise(problem)
    twin = Twin(problem)
    start = twin.start()
    y = twin.residuals(start).stacked()
    J = calibration_columns(twin, start, twin.sensitivity(start, twin.rates(start))) * prior_sigmas(twin, [])
    columns = by_force(twin)
    allowed = Whitener(twin).white
    white = allowed - PRECALIBRATION_MPS2**2 * columns @ columns.T
    n = len(white) - 9
    base = allowed
    if kind == "of its own stills":
        J = np.concatenate([J, 100 * PRECALIBRATION_MPS2 * columns], axis=1)
    if joint is not None:
        J = np.concatenate([J, joint_columns_of(joint, n) * joint.system.prior[:9]], axis=1)
        white = white - np.diag([*np.zeros(n), *np.full(9, ACCEL_INSTABILITY_MPS2**2)])
        base = white
    sigma = np.sqrt(np.diag(allowed))
    assert_allclose(found.white / np.outer(sigma, sigma), white / np.outer(sigma, sigma), atol=2e-4)
    parts = found.noise.components
    assert [c.name for c in parts] == [c.name for c in first_noise(twin, Whitener(twin)).components]
    least = twice_minus_log(found.noise.s, y, J, base, parts)
    assert found.noise.value == pytest.approx(least, abs=0.1)
    for step in np.diag(0.3 * found.noise.sigma):  # a third of a sigma more or less is no better
        assert least < min(twice_minus_log(np.abs(found.noise.s + by), y, J, base, parts) for by in (step, -step)) + 0.02
    # What the accelerometer may be off by.
    if joint is None:
        own = _accelerometer_factor(columns[-9:], found.noise, kind == "of its own stills")
        expected = columns @ own @ own.T @ columns.T
    else:
        D = joint_columns_of(joint, n)
        response = np.zeros((9, n + 9))
        whole = by_values(joint)
        response[:, : n - 27], response[:, n:] = whole[:, : n - 27], whole[:, n - 27 :]
        known = response @ (found.white + found.noise.covariance) @ response.T + joint.beforehand @ joint.beforehand.T
        expected = D @ known @ D.T
    assert_allclose(found.accelerometer @ found.accelerometer.T, expected, atol=2e-3 * np.abs(expected).max())


def joint_columns_of(joint, n):
    """(n + Q, 9) of the stacked channels; a still's rate does not depend on the accelerometer."""
    count = n - 3 * len(joint.force)
    design = joint.system.design[:, :9]
    return np.concatenate([design[:count], np.zeros((3 * len(joint.force), 9)), design[count:]])


def by_values(joint):
    """(9, S d + Q) by each row's error: the joint system solved anew."""
    system = replace(joint.system, vague=False)
    size = 1e-4

    def solved(e):
        return replace(system, values=system.values + e).solve()[:9]

    return numeric_jacobian(solved, np.zeros(len(system.values)), size)


@pytest.mark.parametrize("case", CASES)
def test_an_error_moves_the_accelerometer_and_through_it_the_gyroscope(case):
    """Of both together, in order: an error of a length or an end moves the nine numbers; their references then move the twelve.  What was
    wrong before the session moves both likewise, and is shared by sessions with the same given calibration."""
    by_hand = made(case)
    joint = fit_joint(by_hand.plain, "prior", 3.0)
    problem = under(by_hand.problem, "given").changed(joint=joint)
    noise = loud(problem)
    noise = replace(noise, noise=replace(noise.noise, s=noise.noise.s / 5))
    s, n = by_hand.closure, by_hand.count
    by_row, L, D = by_values(joint), by_hand.response, joint_columns_of(joint, n - 9)
    nine = np.concatenate([by_row[:, :s], np.zeros((9, n - s - 9)), by_row[:, s:]], axis=1)
    twelve = L + L @ D @ nine
    assert_allclose(stated_response(problem, by_hand.model), twelve, atol=0.01 * np.abs(twelve).max())
    both = np.concatenate([nine, twelve])
    before = np.concatenate([joint.beforehand, L @ D @ joint.beforehand])
    C = noise.white + noise.noise.covariance
    whole, shared = both @ C @ both.T + before @ before.T, before @ before.T
    found = stated_joint_covariance(problem, by_hand.model, noise)
    alike(found, whole, 0.02)
    sources = stated_sources(problem, by_hand.model, noise)
    alike(shared_part(problem, sources) + whole, shared + whole, 0.02)
    gyroscope, of_accelerometer = stated_covariance(problem, by_hand.model, noise)
    assert_array_equal(gyroscope, found[9:, 9:])
    alike(of_accelerometer + whole[9:, 9:], shared[9:, 9:] + whole[9:, 9:], 0.02)
    assert np.max(np.diag(shared) / np.diag(whole)) > 0.1


def test_an_accelerometer_of_its_own_stills_errs_as_their_lengths_leave_it():
    """Least squares of nine numbers with the stills' error, 2 mg, and the instability of its class; a direction that no length shows is
    known to 10 mg.  The matrix is upper triangular: what is below the diagonal is its frame."""
    rng = np.random.default_rng(0)
    down = rng.normal(size=(9, 3))
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    lengths = -np.concatenate([down, np.einsum("qi,qj->qij", down, down).reshape(9, 9)], axis=1)
    noise = loud(small_session()).noise
    each = np.hypot(2 * MG, ACCEL_INSTABILITY_MPS2)
    found = _accelerometer_factor(lengths[:, :] * 100, noise, own=True)
    free = [0, 1, 2, 3, 4, 5, 7, 8, 11]
    expected = np.zeros((12, 12))
    expected[np.ix_(free, free)] = each**2 * np.linalg.inv(lengths[:, free].T @ lengths[:, free]) / 100**2
    assert_allclose(found @ found.T, expected, rtol=1e-6)
    few = _accelerometer_factor(lengths[:8] * 100, noise, own=True)  # their lengths, as well as they are measured
    assert_allclose(lengths[:8] @ few @ few.T @ lengths[:8].T * 100**2, each**2 * np.eye(8), atol=1e-9 * each**2)
    lengths[:, 0] = 0.0
    none = _accelerometer_factor(lengths * 100, noise, own=True)
    assert none[0] @ none[0] == pytest.approx((10 * MG) ** 2)


def test_the_sources_of_the_channels_are_its_noise():
    """White noise by its cause, each component with its size, the Earth's rate, the accelerometer's calibration: the whole covariance."""
    problem = under(small_session(kind="yaw"), "estimated")
    noise = loud(problem)
    sources = {source.name: source for source in channel_sources(problem, noise)}
    names = [GYRO_NOISE, *(COMPONENTS[name] for name in (WANDER, STILL_RATE, REFERENCE, TURN)), SINGLE_SEGMENTS, EARTH, CALIBRATION]
    assert sorted(sources) == sorted(names)
    earth = sources.pop(EARTH).covariance
    assert_allclose(total(sources.values()), noise.covariance, rtol=1e-9, atol=1e-22)
    assert np.linalg.matrix_rank(earth / earth.max(), tol=1e-9) == 1  # across an estimated heading


def test_a_calibration_from_its_own_stills_has_the_freedom_that_they_leave():
    """Nine numbers of gravity's length in so many stills: what is left, and at least one; one that was given is taken as known."""
    problem = under(small_session(kind="tilt"), "given")
    noise = loud(problem)

    def calibration(matrix):
        config = problem.session.config
        config = replace(config, accelerometer=replace(config.accelerometer, matrix=matrix))
        changed = problem.changed(session=SimpleNamespace(**{**vars(problem.session), "config": config}))
        return next(source for source in channel_sources(changed, noise) if source.name == CALIBRATION)

    upper = np.eye(3) + np.triu(np.full((3, 3), 1e-3), 1)
    own, given = calibration(upper), calibration(np.eye(3))
    assert (own.kind, own.freedom) == ("A", max(1.0, len(noise.twin.stills) - 9.0))
    assert (given.kind, given.freedom) == ("B", np.inf)


def test_degrees_of_freedom_of_a_size_with_a_sigma():
    """GUM G.4.2: a relative standard uncertainty of 25 % has eight; a tenth of a degree of freedom is none."""
    assert freedom_of(4.0, 1.0) == pytest.approx(8.0)
    assert freedom_of(1.0, 0.0) == np.inf
    assert freedom_of(1.0, 10.0) == 1.0


STILLS = [SimpleNamespace(duration_s=30 * BLOCK_S)] * 5 + [SimpleNamespace(duration_s=0.3)]


@pytest.mark.parametrize(
    ("source", "known", "kind", "freedom"),
    [
        (BIAS_DRIFT, BiasInstability(1.0, "typical of X"), "B", 1.0),  # a spread of 0.8: 1 / 0.8^2 / 2, and one at least
        (BIAS_DRIFT, BiasInstability(1.0, "given"), "B", 50.0),
        (BIAS_DRIFT, BiasInstability(1.0, "estimated from this recording", 0.2, 2.0, of_unit=True), "A", 12.5),
        (GYRO_NOISE, None, "A", 5 * allan_freedom(31, NOISE_BLOCKS)),  # of the differences of blocks in the stills
        (DIALS, None, "B", np.inf),
    ],
)
def test_a_source_has_the_freedom_of_what_tells_it(source, known, kind, freedom):
    assert kind_of(source, SimpleNamespace(instability=known, stills=STILLS)) == (kind, pytest.approx(freedom))


def test_readings_of_equal_steps_leave_a_twelfth_of_a_square_step_in_the_bias():
    problem, lsb = small_session(noise=0.0), 0.01
    logs = [replace(log, samples=replace(log.samples, gyro=lsb * np.rint(log.samples.gyro / lsb))) for log in problem.logs]
    found = rounding_covariance(problem.changed(logs=logs), TRUE)
    assert_allclose(found[BIAS, BIAS], lsb**2 / 12 * TRUE.E @ TRUE.E.T, rtol=1e-6)
    assert not found[MATRIX].any()


def plain_session(**more):
    """A problem of one session, without registers or a lot."""
    problem = small_session(kind="tilt", **more)
    return problem.changed(session=SimpleNamespace(folder="made", config=problem.session.config, clock=None, reference=None))


def stated_with(monkeypatch, problem, noise, widened=1.0, lot=None):
    found = SimpleNamespace(freedom=20, excess=widened)
    monkeypatch.setattr(stating, "require_plausible", lambda *given: None)
    monkeypatch.setattr(stating, "stated_goodness", lambda *given: (found, widened))
    monkeypatch.setattr(stating, "goodness", lambda *given: found)
    return stated_uncertainty(problem, problem, problem.first, noise, lot)


@pytest.mark.parametrize("estimated", [True, False])
def test_a_misfit_is_a_source_of_its_own(monkeypatch, estimated):
    """(f - 1) times the rest; its variance is known by that of f = chi-square / nu: sigma f sqrt(2 / nu), so nu ((f - 1) / f)^2."""
    problem = plain_session()
    noise = loud(problem) if estimated else None
    plain, wide = (stated_with(monkeypatch, problem, noise, widened) for widened in (1.0, 2.5))
    of_plain, of_wide = ({source.name: source for source in found["sources"]} for found in (plain, wide))
    assert of_wide.keys() - of_plain.keys() == {MISFIT}
    rest = total([source for name, source in of_plain.items() if name != ROUNDING])
    assert_allclose(of_wide[MISFIT].covariance, 1.5 * rest, rtol=1e-12)
    assert (of_wide[MISFIT].kind, of_wide[MISFIT].freedom) == ("A", pytest.approx(20 * (1.5 / 2.5) ** 2))
    assert_array_equal(wide["covariance"], total(wide["sources"]))
    if estimated:
        assert_allclose(wide["accelerometer_covariance"], 2.5 * plain["accelerometer_covariance"], rtol=1e-12)
        assert_array_equal(plain["accelerometer_covariance"], of_plain[CALIBRATION].covariance)


def test_clock_prior_and_rounding_are_added_as_they_are(monkeypatch):
    """Not inflated: no misfit of the closure shows them."""
    problem = plain_session()
    covariance, vector = np.diag(np.arange(1.0, 13.0)) * 1e-8, problem.first.vector
    problem.session.clock = SimpleNamespace(covariance=lambda vector: 4e-6 * np.outer(vector, vector))
    monkeypatch.setattr(stating, "rounding_covariance", lambda problem, model: 3 * covariance)
    found = stated_with(monkeypatch, problem, loud(problem), 2.0, SimpleNamespace(more=covariance, source="a prior"))
    expected = {ROUNDING: 3 * covariance, "a prior": covariance, CLOCK: 4e-6 * np.outer(vector, vector)}
    assert [(source.name, source.freedom) for source in found["sources"][-3:]] == [(name, np.inf) for name in expected]
    assert_array_equal([source.covariance for source in found["sources"][-3:]], [*expected.values()])


def test_welch_satterthwaite_of_the_gum():
    """GUM G.4.2 note: relative 0.25, 0.57, 0.82 % with 9, 4, 14 degrees of freedom give 1.03 % with 19."""
    assert effective_freedom(np.array([0.25, 0.57, 0.82]) ** 2, [9, 4, 14]) == pytest.approx(19.0, abs=0.05)
    assert coverage_factor(19.0) == pytest.approx(2.09, abs=0.005)


@pytest.mark.parametrize(
    ("freedom", "level", "k"), [(5.9, (), t.ppf(0.975, 5)), (0.3, (), t.ppf(0.975, 1)), (9.0, (0.99,), t.ppf(0.995, 9))]
)
def test_degrees_of_freedom_are_cut_to_a_whole_number(freedom, level, k):
    assert coverage_factor(freedom, *level) == pytest.approx(k)


def test_the_tilt_that_noise_makes_is_the_rms_of_both_angles():
    """Without the uncertainty of single turns and that of the accelerometer's calibration, which E takes up."""
    problem = small_session(kind="yaw")
    noise = loud(problem)
    variance = np.diag(noise.white + noise.noise.covariance)[:21].reshape(7, 3)[:, :2].sum(axis=1)
    variance -= np.trace(problem.floor.wider[:, :2, :2], axis1=1, axis2=2)
    assert noise.tilt_rms == pytest.approx(np.sqrt(variance.mean()))
