"""Registers whose steps are larger than the noise at rest: the sigma of the bias knows what rounding leaves in the mean of a still."""

import numpy as np

import tinygc
from session.detect.rounding import rounding_of_mean
from session.io.units import DEG
from tinygc.estimation.stated_noise import rounding_covariance


def recorded(lsb_dps, seed):
    """A simulated session whose rates are rounded to steps, and its true bias, rad/s."""
    simulated = tinygc.simulate(segments=16, odr_hz=104.0, closure_s=0.0, seed=seed)
    session = simulated.session
    samples = session.logs[0].samples
    # Spread over their own step, registers are what was measured, and are not rounded twice.
    rates = np.asarray(samples.gyro) + 17.5e-3 * DEG * np.random.default_rng(seed).uniform(-0.5, 0.5, samples.gyro.shape)
    if lsb_dps:
        rates = np.rint(rates / (lsb_dps * DEG)) * lsb_dps * DEG
    config = session.config
    made = tinygc.Session.from_arrays(
        samples.t_ns * 1e-9, rates, samples.accel, gyro_fs_dps=500, accel_fs_g=4, accelerometer=config.accelerometer, site=config.site
    )
    return made, np.multiply(simulated.truth["B_dps"], DEG)


def test_the_bias_has_what_rounding_leaves_in_the_stills():
    """E diag(v) E', v the mean over the stills, and nothing elsewhere."""
    session, _ = recorded(0.08, 1)
    found = tinygc.fit(session, methods=("raw", "least_squares")).result
    problem, model = found.problem, found.linear.model
    readings = [np.asarray(log.samples.gyro[still.start : still.stop]) for log in problem.logs for still in log.stills if not still.problem]
    each = np.mean([rounding_of_mean(one, 0.08 * DEG) for one in readings], axis=0)
    expected = np.zeros((12, 12))
    expected[9:, 9:] = model.E @ np.diag(each) @ model.E.T
    assert each.min() > (0.001 * DEG) ** 2
    np.testing.assert_allclose(rounding_covariance(problem, model), expected, rtol=1e-9, atol=0)
    sigmas = np.sqrt(np.diag(found.covariance))
    assert (sigmas[9:] > np.sqrt(np.diag(expected))[9:]).all()


def test_fine_registers_and_unrounded_readings_add_nothing():
    for lsb_dps in (0.0, 0.0175):
        session, _ = recorded(lsb_dps, 1)
        found = tinygc.fit(session, methods=("raw", "least_squares")).result
        assert np.sqrt(rounding_covariance(found.problem, found.linear.model).max()) < 1e-6 * DEG
