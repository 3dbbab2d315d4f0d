"""What ``fit`` states with the noise that a recording shows: sigmas that hold, and where the bias comes from."""

import json
from dataclasses import replace

import numpy as np
import pytest
from commandline import refused

from session.io.units import DEG, MG
from tinygc import CalibrationError, FitOptions, SimulationOptions, read_session
from tinygc.closure.build import build_problem, with_still_bias
from tinygc.closure.uncertainty import parameter_covariance
from tinygc.estimation.bias import choose, less_by_chance
from tinygc.estimation.fit import fit_session
from tinygc.estimation.stated_noise import FROM_LENGTHS, accelerometer_factor, from_own_stills, stated_covariance, stated_noise
from tinygc.models.linear import BIAS, MATRIX
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


@pytest.mark.parametrize("still_rates", [False, True])
def test_with_white_noise_alone_it_is_the_sandwich_of_the_floor(problem, still_rates):
    """Two ways to one covariance: dense channels, and the floor's blocks.  A turn holds part of its stills, and so their noise: what
    that adds to the bias, where the stills are data as well, is in the dense one alone."""
    noise = stated_noise(problem)
    quiet = replace(noise, noise=replace(noise.noise, s=np.zeros_like(noise.noise.s)), accelerometer=0 * noise.accelerometer)
    dense, _ = stated_covariance(problem, problem.first, quiet, still_rates)
    rates = problem.still_rates if still_rates else None
    blocks = parameter_covariance(problem.batch, problem.floor, problem.first, problem.earth, rates)
    scale = np.sqrt(np.outer(np.diag(blocks), np.diag(blocks)))
    np.testing.assert_allclose(dense / scale, blocks / scale, atol=0.3 if still_rates else 0.01)


def test_a_bias_that_wanders_more_is_known_less(problem):
    noise = stated_noise(problem)
    names = [component.name for component in noise.noise.components]
    s = np.where([name == "noise.bias_wander" for name in names], 30 * DEG / 3600, 0.0)
    little, much = (
        stated_covariance(problem, problem.first, replace(noise, noise=replace(noise.noise, s=factor * s)), False)[0] for factor in (1, 3)
    )
    assert np.all(np.diag(much)[BIAS] > 3 * np.diag(little)[BIAS])


def test_a_bias_from_the_stills_cancels_what_wanders_slowly(problem):
    """Of flicker noise, which has the same power in each octave of time: what is slower than a turn is gone from E."""
    noise = stated_noise(problem)
    names = [component.name for component in noise.noise.components]
    s = np.where([name == "noise.bias_wander" for name in names], 100 * DEG / 3600, 0.0)
    loud = replace(noise, noise=replace(noise.noise, s=s), accelerometer=0 * noise.accelerometer)
    ends, _ = stated_covariance(problem, problem.first, loud, False)
    stills, _ = stated_covariance(with_still_bias(problem), problem.first, loud, False)
    ratio = np.sqrt(np.diag(stills)[MATRIX] / np.diag(ends)[MATRIX])
    assert np.all(ratio < 1)
    assert np.median(ratio) < 0.9


def test_the_accelerometer_errs_as_much_as_its_own_stills_made_it(problem):
    """From 40 random attitudes: by about the stills' error over the root of their number, a bias; nothing where lengths fix no frame."""
    down = np.random.default_rng(0).standard_normal((40, 3))
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    lengths = -np.concatenate([down, np.einsum("qi,qj->qij", down, down).reshape(40, 9)], axis=1)
    noise = stated_noise(problem).noise
    loud = replace(noise, s=np.array([MG if component.name == "noise.reference" else 0.0 for component in noise.components]))
    given, own = (accelerometer_factor(lengths, loud, made) for made in (False, True))
    np.testing.assert_allclose(given, np.eye(12) * MG / np.sqrt(40), rtol=1e-12)
    sigma = np.linalg.norm(own, axis=1) / MG
    assert np.all(sigma[:3] > 1.0 / np.sqrt(40))
    assert np.all(sigma[:3] < 4 / np.sqrt(40))
    assert not np.delete(sigma, FROM_LENGTHS).any()
    assert not from_own_stills(problem)  # the simulated one is no triangle


def test_it_is_not_estimated_where_nothing_rests_between_turns(problem):
    assert stated_noise(replace(problem, session=replace(problem.session, truths=()))) is None


def test_the_stills_follow_a_bias_that_runs_and_auto_takes_them(drifting):
    ends, stills, auto = (errors(drifting, 11, bias) for bias in ("ends", "stills", "auto"))
    assert auto[2].bias_from.used == "stills"
    assert auto[2].bias_from.p_value < 0.01
    np.testing.assert_array_equal(auto[0], stills[0])
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
@pytest.mark.parametrize(
    ("bias", "instability_dph"),
    [("stills", 20.0), *(pytest.param(*each, marks=pytest.mark.slow) for each in (("stills", 0.0), ("ends", 0.0), ("ends", 20.0)))],
)
def test_sigmas_hold_though_nobody_tells_how_far_the_bias_wanders(simulated, instability_dph, bias):
    """68 % of 108 errors within one sigma; those of a session hang together, so that the share is known to about 5 %."""
    z = []
    for seed in range(12):
        folder = simulated(segments=20, closure_s=0.0, seed=seed, bias_instability_dph=instability_dph)
        error, sigma, _ = errors(folder, seed, bias)
        z.append(error / sigma)
    assert 0.53 < np.mean(np.abs(z) < 1) < 0.85
    assert np.mean(np.abs(z) < 2) > 0.87
