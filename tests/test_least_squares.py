"""Least squares: what is injected is recovered, what is not observed is named, and the uncertainties are true."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import Turns

from session.detect.stills import Noise
from session.io.errors import FitError
from session.io.units import DEG, DEG_PER_HOUR
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.attitude.earth import no_earth, with_heading
from tinygc.closure.floor import BiasWander, closure_floor
from tinygc.closure.least_squares import StillRates, fit_least_squares
from tinygc.closure.uncertainty import goodness, parameter_covariance
from tinygc.models.linear import NAMES, PRIOR_SIGMA, LinearModel, bias_only

PERFECT = LinearModel(np.eye(3), np.zeros(3))
#: of a typical unit: 1 % of scale, 5 mrad of misalignment, 1 dps
TYPICAL = np.array([0.01, 0.005, -0.004, -0.006, -0.012, 0.003, 0.005, -0.002, 0.008, 1.0 * DEG, -0.7 * DEG, 0.4 * DEG])


@pytest.fixture(scope="module")
def turns():
    return Turns(16, seed=1)


def fit(batch, sigma=1e-4, start=None, **settings):
    return fit_least_squares(batch, np.full(len(batch), sigma), start or bias_only(), **settings)


@pytest.mark.parametrize("parameter", range(12), ids=NAMES)
@pytest.mark.parametrize("yaw_known", [False, True])
def test_each_parameter_alone_is_recovered(turns, parameter, yaw_known):
    vector = PERFECT.vector
    vector[parameter] += TYPICAL[parameter]
    found = fit(turns.batch(LinearModel.from_vector(vector), yaw_known), sigma=1e-6)
    np.testing.assert_allclose(found.model.vector, vector, atol=1e-6)
    assert found.unobserved == ()


@pytest.mark.parametrize("scale", [1.0, -1.0, 5.0])
def test_all_parameters_together_are_recovered(turns, scale):
    """Also when they are five times those of a typical unit: 6 % of scale, 5 dps."""
    vector = PERFECT.vector + scale * TYPICAL
    found = fit(turns.batch(LinearModel.from_vector(vector)), sigma=1e-6)
    np.testing.assert_allclose(found.model.vector, vector, atol=1e-6)
    assert found.steps < 15


def test_the_earth_is_taken_off_and_not_fitted(turns):
    """Rates that hold the Earth's rotation give the true bias with it, and a wrong one without."""
    vector = PERFECT.vector + TYPICAL
    model = LinearModel.from_vector(vector)
    body = with_heading(31.03, 40.0).in_body(closure.attitudes(turns.batch(PERFECT), turns.rate))
    felt = (turns.rate + body - model.B) @ np.linalg.inv(model.E).T
    with_earth = replace(turns.batch(model), rate=felt, earth=body)
    np.testing.assert_allclose(fit(with_earth, 1e-6).model.vector, vector, atol=1e-6)
    without = fit(replace(with_earth, earth=0 * body), 1e-6).model
    assert np.abs(without.vector - vector).max() > 1e-5


def test_still_rates_alone_fix_a_bias_that_no_turn_sees(turns):
    model = LinearModel.from_vector(PERFECT.vector + TYPICAL)
    earth = with_heading(31.03, 0).in_body(turns.q)
    measured = (earth - model.B) @ np.linalg.inv(model.E).T
    rates = StillRates(measured, earth, np.full((17, 3), 1e-6))
    few = turns.batch(model).pick(slice(0, 8))
    alone, both = fit(few, 1e-4), fit(few, 1e-4, still_rates=rates)
    np.testing.assert_allclose(both.model.vector, model.vector, atol=1e-5)
    assert np.all(np.sqrt(np.diag(both.covariance))[9:] < np.sqrt(np.diag(alone.covariance))[9:] / 10)


def test_first_order_integrator_poses_as_scale(turns):
    """The paper's integrator turns too little; its fit makes the gyro too large for it."""
    found = fit(turns.batch(PERFECT), 1e-6, integrator="first-order").model
    diagonal = np.diag(found.E) - 1
    assert np.all(diagonal > 5e-6)
    assert np.all(diagonal < 1e-3)


def test_turns_about_the_vertical_only_leave_the_rest_at_the_start():
    """A level table that only yaws: gravity never moves, so most of E is not seen, and does not wander."""
    turns = Turns(12, seed=2, axes=(0, 0, 1))
    rng = np.random.default_rng(0)
    model = LinearModel.from_vector(PERFECT.vector + TYPICAL)
    batch = turns.batch(model, gyro_noise=1e-3 * rng.standard_normal(turns.rate.shape))
    start = bias_only(batch.rate[0, 0])
    found = fit(batch, 1e-4, start)
    # No tilt in the world says how large a yaw was: the third row (what a rate about z reads) is not seen at all.
    third_row = {"E_zx", "E_zy", "E_zz", "B_z"}
    assert third_row <= set(found.unobserved)
    index = [NAMES.index(name) for name in found.unobserved]
    assert np.all(np.abs(found.model.vector - start.vector)[index] < PRIOR_SIGMA[index])
    only_third = [NAMES.index(name) for name in third_row]
    np.testing.assert_allclose(found.model.vector[only_third], start.vector[only_third], atol=1e-3)
    # What a rate about z leaks into x and y tilts the table: that is seen.
    assert {"E_xz", "E_yz"}.isdisjoint(found.unobserved)


def test_known_yaw_observes_what_gravity_does_not():
    """The same turns with dials: scale about z is seen."""
    turns = Turns(12, seed=2, axes=(0, 0, 1))
    found = fit(turns.batch(LinearModel.from_vector(PERFECT.vector + TYPICAL), True), 1e-4)
    assert "E_zz" not in found.unobserved
    assert "E_xx" in found.unobserved


def test_no_segments_and_no_finite_rates_are_refused(turns):
    with pytest.raises(FitError, match="no segments"):
        fit(turns.batch(PERFECT).pick(slice(0, 0)))
    broken = turns.batch(PERFECT)
    broken = replace(broken, rate=np.where(broken.rate == broken.rate.max(), np.nan, broken.rate))
    with pytest.raises(FitError, match="finite"):
        fit(broken)


class Bench:
    """One chain of turns, and as many recordings of it as one likes: fresh gyro noise in every sample, fresh accelerometer noise in
    every still, which two turns share."""

    NOISE = Noise(np.full(3, 0.005 * DEG), np.full(3, 60e-6 * 9.80665))
    STILL_S, ODR_HZ, GRAVITY = 1.0, 52.0, 9.7946

    def __init__(self, count=20):
        from test_floor import still

        self.turns = Turns(count, seed=5, odr_hz=self.ODR_HZ)
        self.model = LinearModel.from_vector(PERFECT.vector + TYPICAL)
        self.force = np.einsum("qji,j->qi", rotation.matrix(self.turns.q), [0, 0, -self.GRAVITY])
        stills = [replace(still(q), duration_s=self.STILL_S) for q in self.turns.q]
        batch = self.turns.batch(self.model)
        ends = list(pairwise(stills))
        self.floor = closure_floor(batch, closure.attitudes(batch, self.turns.rate), ends, [self.NOISE] * count)

    def record(self, seed):
        rng = np.random.default_rng(seed)
        tilt_noise = self.NOISE.accel / np.sqrt(2 * self.STILL_S)
        q = rotation.from_gravity(self.force + tilt_noise * rng.standard_normal(self.force.shape))
        gyro_noise = self.NOISE.gyro * np.sqrt(self.ODR_HZ / 2) * rng.standard_normal(self.turns.rate.shape)
        batch = self.turns.batch(self.model, gyro_noise=gyro_noise, q=q)
        # As build_problem does: the yaw of the reference is carried by the gyro, so that table axes are the same in all recordings.
        carried = [
            np.array([closure.nearest_yaw(t, s) for t, s in zip(true, seen, strict=True)])
            for true, seen in ((self.turns.q[:-1], batch.start), (self.turns.q[1:], batch.end))
        ]
        return replace(batch, start=carried[0], end=carried[1])


@pytest.fixture(scope="module")
def bench():
    return Bench()


@pytest.fixture(scope="module")
def many_fits(bench):
    """(fits, 12) errors in sigmas by ``parameter_covariance``, and the goodness of each fit."""
    errors, found = [], []
    for seed in range(160):
        batch = bench.record(seed)
        result = fit_least_squares(batch, bench.floor.sigma, bias_only(batch.rate[0, 0]))
        sigma = np.sqrt(np.diag(parameter_covariance(batch, bench.floor, result.model, no_earth())))
        errors.append((result.model.vector - bench.model.vector) / sigma)
        found.append(goodness(batch, bench.floor, result.model))
    return np.array(errors), found


def test_uncertainties_are_true(many_fits):
    """160 recordings: 68 ± 5 % of all errors within one sigma, and none of the parameters far off by itself."""
    errors, _ = many_fits
    assert np.mean(np.abs(errors) < 1) == pytest.approx(0.683, abs=0.05)
    np.testing.assert_allclose(np.mean(errors**2, axis=0), 1, atol=4 * np.sqrt(2 / len(errors)))
    np.testing.assert_allclose(np.mean(errors, axis=0), 0, atol=4 / np.sqrt(len(errors)))


@pytest.mark.slow
def test_goodness_is_uniform_where_nothing_is_wrong(many_fits):
    """The mean chi-square is the degrees of freedom; p below 5 % in 5 % of the fits."""
    _, found = many_fits
    chi = np.array([one.chi_square for one in found])
    freedom = found[0].freedom
    assert freedom == 2 * 20 - 12
    assert chi.mean() == pytest.approx(freedom, abs=4 * np.sqrt(2 * freedom / len(chi)))
    p = np.array([one.p_value for one in found])
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / len(p)))


@pytest.mark.slow
def test_covariance_with_still_rates_is_true(bench):
    """With the stills' rates as data the bias is several times better known, and its sigma says so rightly."""
    errors = []
    earth = with_heading(31.03, 10).in_body(bench.turns.q)
    true = (earth - bench.model.B) @ np.linalg.inv(bench.model.E).T
    sigma = np.full(true.shape, 0.005 * DEG / np.sqrt(2 * bench.STILL_S))
    for seed in range(100):
        rng = np.random.default_rng(1000 + seed)
        rates = StillRates(true + sigma * rng.standard_normal(true.shape), earth, sigma)
        batch = bench.record(seed)
        result = fit_least_squares(batch, bench.floor.sigma, bias_only(), still_rates=rates)
        covariance = parameter_covariance(batch, bench.floor, result.model, no_earth(), rates)
        errors.append((result.model.vector - bench.model.vector) / np.sqrt(np.diag(covariance)))
    assert np.mean(np.abs(errors) < 1) == pytest.approx(0.683, abs=0.05)


def test_an_estimated_heading_widens_the_sigmas(bench):
    batch = bench.record(0)
    earth = with_heading(31.03, 10)
    estimated = replace(earth, source="estimated", heading_sigma_rad=0.15)
    known, unsure = (np.diag(parameter_covariance(batch, bench.floor, bench.model, e)) for e in (earth, estimated))
    assert np.all(unsure >= known - 1e-20)
    assert (unsure / known).max() > 1.01


def test_goodness_widens_only_what_noise_does_not_explain(bench):
    batch = bench.record(0)
    quieter = replace(bench.floor, own=bench.floor.own / 9, shared=bench.floor.shared / 9)
    fine, bad = goodness(batch, bench.floor, bench.model), goodness(batch, quieter, bench.model)
    assert fine.excess == 1
    assert bad.p_value < 1e-6
    assert bad.excess == pytest.approx(9 * fine.chi_square / fine.freedom)


def test_goodness_allows_the_bias_its_wander(bench):
    batch = bench.record(0)
    wander = BiasWander(np.arange(len(batch)) * 5.5, 3 * DEG_PER_HOUR)
    still, wandering = (goodness(batch, bench.floor, bench.model, known) for known in (None, wander))
    assert 0.5 * still.chi_square < wandering.chi_square < still.chi_square
