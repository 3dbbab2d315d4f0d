"""A lot's numbers, estimates and outliers in closed form; its prior and whether a unit belongs, against integrals and refits."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fleets import COUNT, SPREAD, simulated_lot
from formats_page import strangers
from numpy.testing import assert_allclose, assert_array_equal
from scipy import optimize, stats

import tinygc
from session.base.records import table_of, write_whole
from session.base.units import DEG, G
from tinygc import CalibrationError
from tinygc.closure.least_squares import GaussianPrior, fit_least_squares, vague
from tinygc.closure.prepared import prepare
from tinygc.closure.uncertainty import covariance_parts, goodness
from tinygc.estimation.options import FitOptions
from tinygc.estimation.stated_noise import stated_covariance, stated_goodness, stated_noise
from tinygc.features.fleet import fit as lots_fit
from tinygc.features.fleet.fit import LEAST, LotFile, _belonging, farthest, prior_of
from tinygc.features.fleet.lot import (
    FAMILY_P,
    NAMES,
    OWN,
    SENSOR_ERRORS,
    UNITS,
    Lot,
    LotSessions,
    UnitResult,
    error_sigmas,
    estimate,
    family,
    jacobian,
    key_of,
    lot_sessions,
    outliers,
    repeated,
    sensor_errors,
)
from tinygc.models.linear import PARAMETERS, PRIOR_SIGMA, bias_only, field_vector
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session, unit_of
from tinygc.simulation.write import write_simulation

# Numbers as sensor errors.


NONE = np.where(np.isin(NAMES, ("E_xx", "E_yy", "E_zz")), 1.0, 0.0)


def test_sensor_errors_are_those_that_a_sensor_is_made_of():
    """Large errors, so that every second-order term shows: rows of given lengths that lean by given angles, and a bias in the reading."""
    scale, bias = np.array([0.2, -0.1, 0.3]), np.array([0.02, -0.03, 0.05])
    lean = {(0, 1): 0.1, (0, 2): -0.2, (1, 0): 0.3, (1, 2): -0.15, (2, 0): 0.25, (2, 1): -0.05}
    rows = np.array([[1.0 if i == j else np.tan(lean[i, j]) for j in range(3)] for i in range(3)])
    M = rows / np.linalg.norm(rows, axis=1)[:, None] * (1 + scale)[:, None]
    E = np.linalg.inv(M)
    # The triad's rows: along z, in the plane of y and z, and free, with given cosines between them.
    xy, xz, yz = 0.1, -0.2, 0.3
    second = np.array([0, np.cos(yz), np.sin(yz)])
    first = np.array([0, (np.sin(xy) - np.sin(xz) * np.sin(yz)) / np.cos(yz), np.sin(xz)])
    first[0] = np.sqrt(1 - first @ first)
    own, force_bias = np.array([0.1, 0.05, -0.2]), np.array([0.3, -0.4, 0.5])
    T = np.linalg.inv(np.array([first, second, [0, 0, 1]]) * (1 + own)[:, None]) - np.eye(3)
    values = np.concatenate([E.ravel(), -E @ bias, T[np.triu_indices(3)], force_bias])
    expected = [*scale / 1e-6, *(lean[key] / 1e-3 for key in sorted(lean)), *bias / (1e-3 * DEG), *own / 1e-6]
    expected += [xy / 1e-3, xz / 1e-3, yz / 1e-3, *force_bias / (1e-3 * G)]
    assert sensor_errors(values) == pytest.approx(expected, rel=1e-9)
    assert sensor_errors(NONE) == pytest.approx(np.zeros(COUNT), abs=1e-9)
    assert (sensor_errors(values) * UNITS)[:9] == pytest.approx(field_vector(values[:12])[:9], rel=1e-9)
    names = [key_of(name, unit) for name, unit, _ in SENSOR_ERRORS]
    assert (names[0], names[3]) == ("gyro_scale_factor_error_x_ppm", "gyro_misalignment_x_to_y_mrad")
    assert (names[11], names[20]) == ("gyro_bias_z_mdps", "accel_bias_z_mg")


def test_sigmas_go_over_by_the_derivative():
    rng = np.random.default_rng(1)
    at, sigmas = NONE + 0.05 * rng.normal(size=COUNT), 1e-4 * rng.uniform(1, 2, size=COUNT)
    J = jacobian(at)
    for n in range(COUNT):
        step = 1e-4 * (np.arange(COUNT) == n)
        assert J[:, n] == pytest.approx(
            (sensor_errors(at + step) - sensor_errors(at - step)) / 2e-4, rel=1e-5, abs=1e-4 / UNITS.min() * 1e-4
        )
    expected = np.sqrt(np.diag(J @ np.diag(sigmas**2) @ J.T))
    assert_allclose(error_sigmas(sigmas, J), expected, rtol=1e-9)
    sigmas[4] = np.nan
    found = error_sigmas(np.stack([sigmas, sigmas]), J)[1]
    lost = int(np.flatnonzero(OWN == 4)[0])
    assert np.isnan(found[lost])
    assert_allclose(np.delete(found, lost), np.delete(expected, lost), rtol=0.1)


def result(key, serial, order, sigma=0.1, values=(1.0,), known=(10,)):
    x, covariance = np.full(COUNT, np.nan), np.full((COUNT, COUNT), np.nan)
    x[list(known)] = values
    covariance[np.ix_(known, known)] = np.diag(np.full(len(known), sigma**2))
    return UnitResult(key, serial, f"session {key}", x, covariance, order=order)


def test_sessions_lie_by_unit_and_units_by_their_first_session():
    """A unit's sessions in the order of time; one without a serial number is a unit of its own; a key counts once, and a result without
    any number not at all."""
    lot = lot_sessions(
        [
            result("c", "B", 3.0),
            result("a", "A", 2.0, values=(2.0,)),
            result("b", "B", 1.0, values=(4.0,)),
            result("b", "B", 1.0, values=(9.0,)),
            result("d", "", 0.5, values=(8.0,)),
            result("e", "", 5.0, values=(16.0,)),
            result("f", "F", 0.0, values=(np.nan,)),
            result("g", "G", 0.0, sigma=0.0),
        ]
    )
    assert lot.serials == ["", "B", "A", ""]
    assert lot.names == ["session d", "session b", "session c", "session a", "session e"]
    assert lot.values[:, 10].tolist() == [8, 4, 1, 2, 16]
    assert lot.count.tolist() == [1, 2, 1, 1]
    assert lot.first.tolist() == [0, 1, 3, 4]
    assert lot.unit.tolist() == [0, 1, 1, 2, 3]
    assert (lot.units, lot.sessions) == (4, 5)
    assert lot.place == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert lot.variances[:, 10] == pytest.approx([0.01] * 5)
    assert np.flatnonzero(lot.known.any(axis=0)).tolist() == [10]
    with pytest.raises(CalibrationError, match="two units or more, got 0"):
        lot_sessions([])


# Mean, drift, spread and repeatability.


def drawn(counts, seed=0, drift=0.0, repeats=0.0, sigma=0.2, vary=0.0):
    """Sessions of units with so many each; spread 1 about 3, sizes in spreads; the stated sigma may vary from session to session."""
    rng, counts = np.random.default_rng(seed), np.array(counts)
    unit, shape = np.repeat(np.arange(len(counts)), counts), (counts.sum(), COUNT)
    values = 3 + rng.normal(size=(len(counts), COUNT)) + drift * np.linspace(-0.5, 0.5, len(counts))[:, None]
    sigmas = sigma * np.exp(vary * rng.normal(size=shape))
    y = values[unit] + np.hypot(sigmas, repeats) * rng.normal(size=shape)
    names = [str(number) for number in range(len(counts))]
    return LotSessions(y, sigmas**2, np.ones(shape, dtype=bool), np.cumsum(counts) - counts, counts, names, [str(i) for i in unit])


def test_of_equal_sigmas_all_are_the_ordinary_regression_s():
    """Spread: the residuals' variance less the stated one."""
    lot = drawn([1] * 30, drift=2.0)
    found = estimate(lot)
    X = np.column_stack([np.ones(30), lot.place - 0.5])
    beta, square = np.linalg.lstsq(X, lot.values)[:2]
    variance, share = square / 28, np.sqrt(np.diag(np.linalg.inv(X.T @ X)))
    assert_allclose([found.mean, found.drift], beta, rtol=1e-9, atol=1e-9)
    assert_allclose([found.mean_sigma, found.drift_sigma], share[:, None] * np.sqrt(variance), rtol=1e-7)
    assert_allclose(found.spread**2, variance - 0.04, rtol=1e-7)
    assert np.isnan(found.repeatability).all()
    assert found.drifts
    end = 0.5 + 1 / 29
    assert_allclose(found.next_mean, beta[0] + end * beta[1], rtol=1e-9)
    assert_allclose(found.next_sigma**2, variance * (share[0] ** 2 + end**2 * share[1] ** 2), rtol=1e-7)
    weak = drawn([1] * 30, drift=0.7)
    for each in (found, estimate(weak)):  # two-sided, over all numbers
        p = 2 * COUNT * stats.t.sf(np.abs(each.drift) / each.drift_sigma, 28)
        assert each.drift_p == pytest.approx(min(1.0, *p), rel=1e-6, abs=0)
    still = drawn([1] * 30)
    found = estimate(still)
    assert not found.drifts
    assert_allclose(found.next_mean, still.values.mean(axis=0), rtol=1e-9)
    assert_allclose(found.next_sigma**2, (found.spread**2 + 0.04) / 30, rtol=1e-7)
    assert (estimate(drawn([1] * 30, sigma=5.0, seed=1)).spread == 0).any()  # of more noise than spread it is zero, not below


def test_of_any_sigmas_the_spread_has_the_largest_restricted_likelihood():
    lot = drawn([1] * 12, vary=1.5, sigma=1.0)
    found = estimate(lot).spread ** 2
    X = np.column_stack([np.ones(12), lot.place - 0.5])
    for n in range(COUNT):

        def cost(spread, y=lot.values[:, n], noise=lot.variances[:, n]):
            w = 1 / (noise + spread)
            A = (X.T * w) @ X
            r = y - X @ np.linalg.solve(A, X.T @ (w * y))
            return np.linalg.slogdet(A)[1] - np.log(w).sum() + w @ r**2

        best = optimize.minimize_scalar(cost, bounds=(0, 20), method="bounded", options={"xatol": 1e-9}).fun
        assert cost(found[n]) < min(best, cost(0.0)) + 1e-6


def test_repeatability_is_what_sessions_of_a_unit_differ_by_beyond_what_they_state():
    """Of units with several; a unit's noise is then that of its sessions' weighted mean."""
    lot = drawn([3, 1, 2, 4] * 6, repeats=0.5)
    found = estimate(lot)
    groups = np.split(lot.values, lot.first[1:])
    square = sum(((each - each.mean(axis=0)) ** 2).sum(axis=0) for each in groups)
    assert_allclose(found.repeatability**2, np.maximum(square / (lot.sessions - lot.units) - 0.04, 0.0), rtol=1e-9)
    square -= ((groups[3] - groups[3].mean(axis=0)) ** 2).sum(axis=0)  # of the others alone: a unit of four sessions is left out
    expected = np.maximum(square / (lot.sessions - lot.units - 3) - 0.04, 0.0)
    assert_allclose(repeated(lot, np.arange(lot.units) != 3), expected, rtol=1e-9)
    noise = (0.04 + found.repeatability**2) / lot.count[:, None]
    w = 1 / (found.spread**2 + noise)
    assert_allclose(found.next_sigma, 1 / np.sqrt(w.sum(axis=0)), rtol=1e-9)
    means = np.array([each.mean(axis=0) for each in groups])
    assert_allclose(found.next_mean, (w * means).sum(axis=0) / w.sum(axis=0), rtol=1e-9)


def test_a_unit_far_off_is_left_out_and_no_other_is():
    """8 sigmas off in one number; the others' numbers are those without it."""
    lot = drawn([1] * 200)
    assert not estimate(lot).excluded.any()
    lot.values[7, 10] += 8
    found = estimate(lot)
    assert np.flatnonzero(found.excluded).tolist() == [7]
    assert np.flatnonzero(found.p_values[7] < FAMILY_P).tolist() == [10]
    assert found.off[7, 10] == pytest.approx(lot.values[7, 10] - found.mean[10] - (7 / 199 - 0.5) * found.drift[10])
    rest = np.delete(lot.values[:, 10], 7)
    assert found.spread[10] ** 2 == pytest.approx(rest.var(ddof=1) - 0.04, rel=0.02)
    assert found.off_sigma[7, 10] == pytest.approx(np.hypot(found.spread[10], 0.2), rel=0.02)
    # by hand: 200 units, of 21 numbers each, two sides
    far = np.zeros((200, COUNT))
    far[0, 0], far[1, 1:] = 5.0, np.nan
    p = family(far, np.full(COUNT, 1e9))
    assert p[0, 0] == pytest.approx(200 * 21 * 5.733e-7, rel=1e-3)
    assert (p[1:] == 1).all()


def test_what_is_not_told_is_unknown_and_two_units_have_a_mean_and_no_drift():
    """No accelerometer; and a number that one unit tells is no lot's."""
    lot = drawn([1] * 12)
    lost = np.isin(np.arange(COUNT), [3, *range(12, COUNT)])
    lot.values[1:, 3], lot.values[:, 12:] = np.nan, np.nan
    found = estimate(replace(lot, known=np.isfinite(lot.values)))
    for each in (found.mean, found.mean_sigma, found.drift, found.drift_sigma, found.next_mean, found.next_sigma, found.spread):
        assert_array_equal(np.isnan(each), lost)
    assert not found.excluded.any()
    lot = drawn([1, 1])
    found = estimate(lot)
    assert_allclose(found.mean, lot.values.mean(axis=0))
    assert_allclose(found.spread**2, np.maximum(np.diff(lot.values, axis=0)[0] ** 2 / 2 - 0.04, 0), rtol=1e-7)
    assert (found.drift_p, found.drifts) == (1.0, False)


def moved(results, serial, by):
    return [replace(r, values=r.values + by * SPREAD) if r.serial == serial else r for r in results]


def test_odd_units_are_said_the_least_probable_first_with_the_numbers_to_blame():
    bias = 12.0 * (np.arange(COUNT) == 10)
    results = moved(simulated_lot(60, 1, [1, 3]), "serial 00011", bias)
    results = moved(results, "serial 00020", 16 * np.isin(np.arange(COUNT), [0, 2, 4, 6, 8, 10, 20]))
    lot = lot_sessions(results)
    first, second = outliers(lot, estimate(lot))
    assert (second.serial, second.session, [each.what for each in second.reasons]) == ("serial 00011", "", ["gyro_bias_y_mdps"])
    assert second.reasons[0].value == pytest.approx(-12 * 600, rel=0.4)  # the sensor's bias is minus the correction's
    assert second.reasons[0].sigmas == pytest.approx(second.reasons[0].value / 600, rel=0.4)
    assert (first.serial, first.session, len(first.reasons)) == ("serial 00020", "00020-0", 5)
    sizes = [abs(each.sigmas) for each in first.reasons]
    assert sizes == pytest.approx(sorted(sizes, reverse=True), rel=0.02)
    assert first.p_value < second.p_value < 0.01
    assert second.description.startswith(f"unit serial 00011: gyro bias y {second.reasons[0].value:+.0f}")
    assert first.description.startswith("unit serial 00020 (one session, 00020-0): ")


# The prior of the next session of a unit.


MODEL = "ASM330LHH"


MEAN = np.concatenate([np.eye(3).ravel(), np.zeros(3)])


#: of units that were trimmed: 50 ppm, 50 µrad, 20 mdps between them
SIGMA = np.array([5e-5] * 9 + [0.02 * DEG] * 3)


def lot(sigma=SIGMA, **changes):
    """Normal about no correction, one sigma (12,) between units; the accelerometer's numbers are not told."""

    whole = [np.pad(part, (0, len(NAMES) - 12), constant_values=np.nan) for part in (MEAN, np.zeros(12), sigma, np.zeros(12))]
    numbers = dict(zip(("mean", "mean_sigma", "spread", "repeatability"), whole, strict=True))
    return replace(Lot(sensor=MODEL, units=500, sessions=500, names=NAMES, **numbers), **changes)


RNG = np.random.default_rng(7)


def test_the_variance_is_that_of_the_mean_the_spread_and_the_change_between_sessions():
    """Each number by itself; an unknown repeatability is none; what the lot does not tell is as open as without."""
    parts = [np.linspace(1e-4, size, COUNT) for size in (2e-4, 3e-4, 4e-4)]
    known = replace(lot(), mean_sigma=parts[0], spread=parts[1], repeatability=parts[2])
    found = prior_of(known, MEAN + 1.0)
    whole = np.diag(sum(each[:PARAMETERS] ** 2 for each in parts))
    assert_allclose(found.covariance, whole, rtol=0, atol=1e-12)
    assert_array_equal(found.centre, MEAN)
    assert found.known.all()
    single = prior_of(replace(known, repeatability=np.full(COUNT, np.nan)), MEAN)
    assert_allclose(single.covariance, np.diag((parts[0] ** 2 + parts[1] ** 2)[:PARAMETERS]), rtol=0, atol=1e-12)
    exact = prior_of(replace(known, mean_sigma=0 * parts[0], spread=0 * parts[0], repeatability=0 * parts[0]), MEAN)
    assert_allclose(exact.covariance, np.diag((LEAST * PRIOR_SIGMA) ** 2), rtol=1e-9)
    known.mean[4] = known.spread[9] = np.nan
    found, told = prior_of(known, MEAN + 1.0), np.isin(np.arange(PARAMETERS), (4, 9), invert=True)
    assert_array_equal(found.known, told)
    assert_array_equal(found.centre, np.where(told, MEAN, MEAN + 1.0))
    assert_array_equal(found.covariance[~told], np.diag(PRIOR_SIGMA**2)[~told])
    assert_allclose(found.covariance[np.ix_(told, told)], whole[np.ix_(told, told)], rtol=0, atol=1e-12)


def test_the_farthest_number_is_of_the_most_sigmas_of_lot_and_fit_and_told_in_those_of_the_lot():
    of_lot, seen = lot(), np.ones(PARAMETERS, dtype=bool)
    of_lot.mean[2], of_lot.spread[5] = np.nan, 0.0
    own = np.where(np.isin(np.arange(PARAMETERS), (0, 5)), 10.0, 0.5) * SIGMA
    vector = MEAN + SIGMA * [40, 0.1, 0, 0, -5, 30, 4, 0, 0, 0, 0, 0]  # 40 / 10.05, 5 / 1.12 and 30 / 10 sigmas
    for name, sigmas in (("E_yy", -5.0), ("E_xx", 40.0), ("E_zx", 4.0), ("E_yz", 30 * SIGMA[5] / (LEAST * PRIOR_SIGMA[5]))):
        assert farthest(of_lot, vector, np.diag(own**2), seen) == (name, pytest.approx(sigmas))
        seen[NAMES.index(name)] = False
    assert farthest(of_lot, vector, np.diag(own**2), seen & False) is None


def test_a_prior_is_weighed_and_scaled():
    root = RNG.normal(size=(PARAMETERS, PARAMETERS)) + 2 * np.eye(PARAMETERS)
    covariance = 1e-6 * root @ root.T / PARAMETERS
    prior = GaussianPrior(MEAN, covariance, np.ones(PARAMETERS, dtype=bool))
    weighed = prior.scaled(3.0).weighed(6.0)
    assert_allclose(weighed.root @ weighed.root.T, covariance / 2, rtol=0, atol=1e-16)
    assert_allclose(weighed.information @ covariance, 2 * np.eye(PARAMETERS), atol=1e-8)
    assert not np.triu(weighed.root, 1).any()
    open_ = vague(MEAN + 1.0)
    assert_allclose(open_.covariance, np.diag([0.04] * 9 + [np.radians(20) ** 2] * 3), rtol=1e-12)
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
    probability, distance, freedom, p_value = _belonging(prior, moved, NOISE2, KEPT2)
    inside, outside = 0.97 * evidence(moved, P2), 0.03 * foreign(lambda covariance: evidence(moved, covariance), known)
    assert probability == pytest.approx(inside / (inside + outside), rel=1e-6)
    whole = KEPT2 @ P2 @ KEPT2.T + NOISE2
    assert distance**2 == pytest.approx(moved @ np.linalg.solve(whole, moved), rel=1e-9)
    assert freedom == 2
    assert p_value == pytest.approx(stats.chi2.sf(distance**2, 2), rel=1e-9, abs=0)


def test_a_session_that_sees_nothing_leaves_what_was_probable_before():
    assert _belonging(PRIOR2, np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2))) == (0.97, 0.0, 0, 1.0)


# The fit with a lot: what is judged, the thresholds, and the mixture of both.


OPTIONS = FitOptions(methods=("least_squares",), folds=2, bias="ends")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Eight turns of a unit that could be of the lot."""
    return prepare(session_of_unit(tmp_path_factory.mktemp("lot") / "eight", DRAWN)).problem


DRAWN = MEAN + SIGMA * np.random.default_rng(5).standard_normal(PARAMETERS)


def session_of_unit(folder, vector, segments=8, seed=3):
    """A unit with these 12 numbers, turned by hand."""
    options = SimulationOptions(segments=segments, closure_s=0.0, seed=seed, odr_hz=104.0)
    unit = replace(unit_of(options), E=vector[:9].reshape(3, 3), B=vector[9:])
    return write_simulation(simulate_session(options, unit=unit), folder)


@pytest.fixture(scope="module")
def problem(recorded):
    """With a floor of half the noise, so that it is widened."""
    return recorded.changed(floor=replace(recorded.floor, own=recorded.floor.own / 4, shared=recorded.floor.shared / 4))


class Refits:
    """Fits of a problem with a prior, or none, and their answer K (12, 12) to the prior's centre; covariance by the session's noise."""

    def __init__(self, problem, prior, step=1e-7):
        start = bias_only(problem.still_rates.rate[0])

        def fitted(prior):
            return fit_least_squares(problem.batch, problem.floor.sigma, start, prior=prior).model

        model = fitted(prior)
        self.fit = model.vector
        excess = goodness(problem.batch, problem.floor, model, problem.wander).excess
        stated = sum(covariance_parts(problem.batch, problem.floor, model, problem.earth, problem.wander, prior).values())
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
    """``LotFile.fit`` with a belonging of this probability; what was given to the judgement."""

    def __init__(self, problem, monkeypatch, probability, few=False, options=OPTIONS, noise=None, of=None):
        really, self.given = _belonging, []

        def judge(*given):
            self.given.append(given)
            return (probability, *really(*given)[1:])

        monkeypatch.setattr(lots_fit, "_belonging", judge)
        monkeypatch.setattr(lots_fit, "FEWEST_SEGMENTS", len(problem.batch) + few)
        file = LotFile(of or lot(), "lot.json", "0" * 64)
        self.bias_from, self.level, self.fit, self.use = file.fit(problem, options, noise)
        self.vector = self.fit.model.vector


def close(found, expected, sigma):
    assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), rtol=0, atol=2e-3)


def test_a_unit_that_belongs_is_judged_and_fitted_with_the_prior_of_its_noise(problem, parts, monkeypatch):
    """The prior is weighed as much as the floor is too small; what it leaves of its own uncertainty is K P K'."""
    found = Judged(problem, monkeypatch, 0.9999)
    prior, refits = found.level.prior, parts["lot"][1]
    assert prior.weight == goodness(problem.batch, problem.floor, problem.first, problem.wander).excess > 2
    assert_allclose(found.vector, refits.fit, rtol=0, atol=1e-9)
    K, sigma = refits.share, np.sqrt(np.diag(prior.covariance))
    close(found.use.more, K @ prior.covariance @ K.T, sigma)
    assert_allclose(found.use.share, np.diag(K), atol=2e-3)
    ((judged, moved, noise, kept),) = found.given
    assert judged.weight == prior.weight
    assert_allclose(moved, found.vector - MEAN, rtol=0, atol=1e-12)
    close(noise, refits.noise, sigma)
    assert_allclose(kept * np.outer(1 / sigma, sigma), (np.eye(PARAMETERS) - K) * np.outer(1 / sigma, sigma), atol=2e-3)
    assert (found.use.used, found.use.units, found.use.off) == ("yes", 500, None)


def test_the_noise_of_a_recording_takes_the_place_of_the_floor(recorded, problem, monkeypatch):
    noise = stated_noise(recorded)
    found = Judged(problem, monkeypatch, 1.0, noise=noise)
    _, wide = stated_goodness(problem, problem.first, noise)
    assert found.level.prior.weight == pytest.approx(max(1.0, wide * (noise.tilt_rms / problem.floor.tilt_rms) ** 2), rel=1e-9)
    model = found.fit.model
    expected = stated_goodness(found.level, model, noise)[1] * stated_covariance(found.level, model, noise)[0]
    assert_allclose(found.given[0][2], expected, rtol=1e-9)
    loud = problem.changed(floor=replace(problem.floor, own=1e4 * problem.floor.own, shared=1e4 * problem.floor.shared))
    assert Judged(loud, monkeypatch, 1.0, noise=noise).level.prior.weight == 1.0


@pytest.mark.parametrize(
    ("probability", "few", "used", "mixed"),
    [
        (0.05, False, "no", False),
        (0.0501, False, "partly", True),
        (0.9998, False, "yes", True),
        (0.05, True, "no", False),
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
    assert_allclose(found.vector, p * of_lot.fit + (1 - p) * alone.fit, rtol=0, atol=1e-9)
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
    assert_allclose(found.use.share, p * np.diag(of_lot.share), atol=2e-3)


# Whole sessions.


@pytest.mark.parametrize(("turns", "off"), [(4, 0.0), (8, 30.0)])
def test_four_turns_fit_with_a_lot_and_a_unit_that_does_not_belong_is_left_alone_and_named(tmp_path, turns, off):
    """30 sigmas of one number: the truth is within the fit's sigmas in either case."""
    unit = DRAWN + np.where(np.arange(PARAMETERS) == 4, off * SIGMA, 0.0)
    folder = session_of_unit(tmp_path / "session", unit, turns)
    write_whole(tmp_path / "lot.json", table_of(lot()))
    fit = tinygc.fit(folder, methods=("least_squares",), lot=tmp_path / "lot.json")
    result, table = fit.result, json.loads(json.dumps(fit.to_json()))
    assert result.prior.used == ("no" if off else "yes")
    assert (result.prior.probability < 0.05) == (off > 0)
    assert np.abs((result.linear.model.vector - unit) / np.sqrt(np.diag(result.covariance))).max() < 4
    if off:
        assert result.prior.off == ("E_yy", pytest.approx(off, rel=0.2))
        return
    assert strangers(table) == []
    assert (table["lot"]["file"], len(table["lot"]["hash"])) == ("lot.json", 64)
    assert max(table["lot"]["share"]) > 0.5
