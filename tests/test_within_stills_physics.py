"""Slope and scatter within the stills, against white noise, a creep and a still that shakes."""

from dataclasses import replace

import numpy as np
import pytest

from session.base.numeric import rms_of
from session.base.units import DEG
from tinygc import SimulationOptions, simulate
from tinygc.closure.build import build_problem
from tinygc.noise.channels import within_stills
from tinygc.noise.twin import Twin


@pytest.fixture(scope="module")
def twin():
    options = SimulationOptions(segments=20, closure_s=0.0, seed=2, odr_hz=104.0, bias_instability_dph=0.0)
    return Twin(build_problem(simulate(options).session))


def changed(twin, number, rate):
    """The same twin with ``rate`` (N, 3) rad/s added within one still."""
    (log,), (_, still) = twin.problem.logs, twin.stills[number]
    gyro = log.samples.gyro.copy()
    gyro[still.start : still.stop] += rate(log.samples.t_s[still.start : still.stop])
    problem = replace(twin.problem, logs=[replace(log, samples=replace(log.samples, gyro=gyro))])
    other = object.__new__(Twin)
    other.__dict__ = twin.__dict__ | {"problem": problem}
    return other


def test_a_slope_shows_in_its_still_and_axis_by_its_size_and_shaking_as_scatter(twin):
    before, slope = within_stills(twin), 0.05 * DEG  # rad/s^2
    assert rms_of(before["slope"]) == pytest.approx(1, abs=0.25)
    assert rms_of(before["scatter"]) == pytest.approx(1, abs=0.3)
    after = within_stills(changed(twin, 7, lambda t_s: np.outer(t_s - t_s.mean(), [0, slope, 0])))
    (log,), (_, still) = twin.problem.logs, twin.stills[7]
    sigma = log.noise.angle_random_walk[1] * np.sqrt(12 / still.duration_s**3)
    np.testing.assert_allclose((after["slope"] - before["slope"])[7], [0, slope / sigma, 0], rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(np.delete(after["slope"], 7, axis=0), np.delete(before["slope"], 7, axis=0))
    shaken = within_stills(changed(twin, 3, lambda t_s: np.outer(np.cos(6 * np.pi * (t_s - t_s.mean())), [0.1 * DEG, 0, 0])))
    assert shaken["scatter"][3, 0] > 15
    assert np.abs(shaken["slope"][3, 0]) < 5
