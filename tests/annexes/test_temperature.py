"""The zero over temperature from rest logs: lag, orders, hysteresis, and a real recording."""

import numpy as np
import pytest
from conftest import DEG
from rest_logs import rest_log

from tinygc.annexes.temperature.axis_fit import fit_axis, make_knots
from tinygc.annexes.temperature.model import LEAD, ElementTemperature, element_temperature
from tinygc.annexes.temperature.rest_fit import fit_rests
from tinygc.annexes.temperature.sweeps import sweeps_of

SIGN = np.array([1.0, -1.0, 1.0])


def fit_one(log, axis=0):
    knots = make_knots([log], sweeps_of(log.temp_c))
    return fit_axis(knots, log.gyro[:, axis]), knots.reference_c


# The element's temperature


@pytest.mark.parametrize("tau", [25.0, -25.0])
def test_a_lag_is_exact_on_a_ramp_whatever_the_step(tau):
    """T = v t: the element is v tau behind once the start is forgotten."""
    for step_s in (0.01, 1.0, 7.0):
        t_s = np.arange(0, 600, step_s)
        element = element_temperature(20 + 0.05 * t_s, tau, step_s)
        assert element[-1] == pytest.approx(20 + 0.05 * t_s[-1] - 0.05 * tau, abs=1e-6)


def test_a_lag_is_the_exponential_after_a_jump():
    t_s = np.arange(0, 100, 0.1)
    reading = np.where(t_s > 0, 30.0, 20.0)
    element = element_temperature(reading, 10.0, 0.1)
    np.testing.assert_allclose(element[5:], 30 - 10 * np.exp(-(t_s[5:] - 0.05) / 10), atol=3e-3)


def test_a_lead_undoes_a_lag_up_to_its_own_time():
    """What is left of a lag of tau behind a lead of tau is one of tau / (LEAD - 1)."""
    t_s = np.arange(0, 4000.0)
    heat = 30 - 20 * np.cos(2 * np.pi * t_s / 2000)
    back = element_temperature(element_temperature(heat, 40.0, 1.0), -40.0, 1.0)
    late = element_temperature(heat, 40.0, 1.0)
    # H(s) = (1 + r a s) / ((1 + a s)(1 + tau s)), tau = a (r - 1): 1 up to tau a s^2.
    left = 20 * 40.0 * 40.0 / (LEAD - 1) * (2 * np.pi / 2000) ** 2
    assert np.abs(back - heat)[500:].max() < 1.1 * left < 0.02 * np.abs(late - heat)[500:].max() + 0.04


@pytest.mark.parametrize("tau", [0.0, 33.0, -33.0])
def test_pieces_of_a_log_go_on_where_the_last_ended(tau):
    reading = np.cumsum(np.random.default_rng(0).normal(size=1000)) * 0.1 + 25
    follow = ElementTemperature(tau, 0.5)
    parts = np.concatenate([follow(part) for part in np.split(reading, [1, 2, 17, 400])])
    np.testing.assert_allclose(parts, element_temperature(reading, tau, 0.5), atol=1e-10)


def test_no_lag_is_the_reading_itself():
    reading = np.linspace(0, 50, 20)
    np.testing.assert_array_equal(element_temperature(reading, 0.0, 1.0), reading)


# Inject and recover


def test_a_hysteresis_that_no_lag_removes_remains_as_the_uncertainty():
    """The measured case: 0.65 dps between the branches of an axis that hardly follows temperature otherwise."""
    fit, _ = fit_one(rest_log(2, hysteresis_dps=0.65, slope_dps_per_c=0.002, bend_dps_per_c2=0.0))
    assert abs(fit.hysteresis_before.largest[0]) / DEG == pytest.approx(0.65, abs=0.1)
    assert 0.1 < fit.held_out / DEG < 0.5


# A real recording


def test_the_public_sweep(shared):
    """70 minutes from 52 to -18, 74 and 36 degC: y goes 0.034 dps/degC and is predicted to 0.09 dps; x does not come back by 0.6 dps."""
    from session.io.config import read_config
    from session.io.rests import read_rest

    folder = shared / "tofupilot"
    if not (folder / "rest0001.csv.gz").exists():
        pytest.skip(f"no recording: {folder} is not there (python -m benchmarks.public tofupilot)")
    log = read_rest(folder / "rest0001.csv.gz", read_config(folder / "session.toml").sensor)
    found = fit_rests([(log, None)], with_accel=False)
    assert [sweep.direction for sweep in found.sweeps] == [-1, 1, -1]
    x, y, _ = found.gyro
    assert np.ptp(found.range_c) == pytest.approx(91, abs=1)
    at = np.array(found.range_c) - found.knots.reference_c
    assert np.diff(np.polynomial.polynomial.polyval(at, y.terms))[0] / DEG / 91 == pytest.approx(0.034, abs=0.003)
    assert y.left / DEG < 0.06
    assert y.held_out / DEG < 0.12 < 0.1 * y.held_out_of(0, False) / DEG
    assert abs(x.hysteresis_after.largest[0]) / DEG == pytest.approx(0.65, abs=0.1)
    assert x.held_out / DEG > 0.3
