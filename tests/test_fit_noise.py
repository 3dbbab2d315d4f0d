"""What ``fit`` states with the noise that a recording shows: sigmas that hold, and where the bias comes from."""

from dataclasses import replace

import numpy as np
import pytest
from commandline import refused

from session.io.units import DEG
from tinygc import CalibrationError, FitOptions, SimulationOptions
from tinygc.estimation.fit import fit_session
from tinygc.models.linear import MATRIX
from tinygc.simulation.simulator import simulate_session
from tinygc.simulation.write import write_session

LEAST_SQUARES = FitOptions(methods=("least_squares",))
#: dps over the whole session: what a gyro does that warms up
RAMP_DPS = 0.4


def ramp(t_s, rate, force, temp_c):
    """A bias that runs straight while the session lasts, the same about all axes."""
    return rate + (RAMP_DPS * DEG * t_s / t_s[-1])[:, None]


def errors(folder, seed, bias):
    """E's errors (9,), their sigmas without what the accelerometer may err by (the simulated one is exact), and the result."""
    result = fit_session(folder, replace(LEAST_SQUARES, bias=bias))
    true = simulate_session(SimulationOptions(seed=seed, segments=1, closure_s=0.0)).unit.E
    covariance = result.covariance - result.accelerometer_covariance
    return (result.linear.model.E - true).ravel(), np.sqrt(np.diag(covariance)[MATRIX]), result


@pytest.fixture(scope="module")
def drifting(tmp_path_factory):
    options = SimulationOptions(segments=20, closure_s=0.0, seed=11, odr_hz=104.0)
    return write_session(options, tmp_path_factory.mktemp("ramp") / "s", distort=ramp)


@pytest.mark.broad
def test_the_stills_follow_a_bias_that_runs_and_auto_takes_them(drifting):
    ends, stills = (errors(drifting, 11, bias) for bias in ("ends", "auto"))
    assert stills[2].bias_from.used == "stills"
    assert stills[2].bias_from.p_value < 0.01
    assert np.linalg.norm(stills[0]) < 0.3 * np.linalg.norm(ends[0])
    assert np.mean(np.abs(stills[0]) < 2.5 * stills[1]) > 0.8
    # B is that of the middle of the session: half of the ramp more than at its beginning.
    true = simulate_session(SimulationOptions(seed=11, segments=1, closure_s=0.0)).unit
    moved = (true.B - stills[2].linear.model.B) / DEG
    np.testing.assert_allclose(moved, RAMP_DPS / 2 * true.E.sum(axis=1), atol=0.02)


def test_an_option_that_is_none_is_refused(run, tmp_path):
    refused(run("fit", tmp_path, "--bias", "middle"))
    refused(run("fit", tmp_path, "--model", "x.json", "--bias", "stills"))
    refused(run("report", tmp_path, "--bias", "start"))
    with pytest.raises(CalibrationError, match="bias is 'middle'"):
        FitOptions(bias="middle")
