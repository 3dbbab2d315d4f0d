"""What ``fit`` states with the noise that a recording shows: sigmas that hold, and where the bias comes from."""

import json
from dataclasses import replace

import numpy as np
import pytest
from commandline import refused

from session.io.units import DEG
from tinygc import CalibrationError, FitOptions, SimulationOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.estimation.bias import choose, less_by_chance
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
def problem(tmp_path_factory):
    options = SimulationOptions(segments=20, closure_s=0.0, seed=3, odr_hz=104.0)
    return build_problem(read_session(write_session(options, tmp_path_factory.mktemp("noise") / "s")))


@pytest.fixture(scope="module")
def drifting(tmp_path_factory):
    options = SimulationOptions(segments=20, closure_s=0.0, seed=11, odr_hz=104.0)
    return write_session(options, tmp_path_factory.mktemp("ramp") / "s", distort=ramp)


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


def test_a_quiet_bias_is_taken_where_it_closes_better(problem):
    choice, _, fit = choose(problem, LEAST_SQUARES)
    ends, stills = (np.sqrt(np.mean(np.sum(choice.held_out[name] ** 2, axis=1))) for name in ("ends", "stills"))
    assert choice.used == "ends" or stills < ends
    assert fit.held_out is choice.held_out[choice.used] or np.array_equal(fit.held_out, choice.held_out[choice.used])


def test_better_by_chance_is_not_better():
    """Pairs that differ by nothing but noise: uniform p-values, less than 5 % in one case of twenty (or less: the rms must agree)."""
    rng = np.random.default_rng(1)
    p = [less_by_chance(*rng.standard_normal((2, 40, 2))) for _ in range(400)]
    assert np.mean(np.array(p) < 0.05) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 400)
    usual = rng.standard_normal((40, 2))
    assert less_by_chance(usual, 0.5 * usual) < 1e-6
    assert less_by_chance(0.5 * usual, usual) == 1.0
    assert less_by_chance(usual, usual) == 1.0


@pytest.mark.parametrize("more", [{"still_rates": True}, {"bias_per_log": True}])
def test_stills_are_refused_where_they_cannot_be_meant(problem, more):
    with pytest.raises(CalibrationError, match="--bias stills"):
        choose(problem, replace(LEAST_SQUARES, bias="stills", **more))
    assert choose(problem, replace(LEAST_SQUARES, **more))[0].used == "ends"


def test_an_option_that_is_none_is_refused(run, tmp_path):
    refused(run("fit", tmp_path, "--bias", "middle"))
    refused(run("fit", tmp_path, "--model", "x.json", "--bias", "stills"))
    refused(run("report", tmp_path, "--bias", "start"))
    with pytest.raises(CalibrationError, match="bias is 'middle'"):
        FitOptions(bias="middle")


@pytest.mark.broad
def test_the_command_says_which_and_what_noise(drifting, run, tmp_path):
    code, out, _ = run("fit", drifting, "--methods", "least_squares", "--verbose", "--out", tmp_path / "fit", "--json", tmp_path / "x.json")
    said = " ".join(out.split())
    assert code == 0
    assert "Non-white noise included in the sigmas" in said
    assert "from the stills around it" in said
    assert "held out with the ends" in said
    table = json.loads((tmp_path / "x.json").read_text())
    assert table["bias_from"]["used"] == "stills"
    assert table["bias_from"]["stills_holdout_tilt_rms_deg"] < table["bias_from"]["ends_holdout_tilt_rms_deg"]
    assert {c["name"] for c in table["noise"]["components"]} >= {"noise.bias_wander", "noise.still_rate", "noise.reference", "noise.turn"}
    assert all({"name", "size", "sigma", "unit", "description"} == set(c) for c in table["noise"]["components"])
    model = json.loads((tmp_path / "fit" / "model_least_squares.json").read_text())
    covariance, accelerometer = (np.array(model[key]) for key in ("covariance", "accelerometer_covariance"))
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert np.all(np.diag(accelerometer) < np.diag(covariance))


@pytest.mark.slow
@pytest.mark.parametrize("bias", ["stills", "ends"])
def test_sigmas_hold_though_nobody_tells_how_far_the_bias_wanders(simulated, bias):
    """68 % of 108 errors within one sigma; those of a session hang together, so that the share is known to about 5 %."""
    z = []
    for seed in range(12):
        error, sigma, _ = errors(simulated(segments=20, closure_s=0.0, seed=seed, bias_instability_dph=20.0), seed, bias)
        z.append(error / sigma)
    assert 0.53 < np.mean(np.abs(z) < 1) < 0.85
    assert np.mean(np.abs(z) < 2) > 0.87
