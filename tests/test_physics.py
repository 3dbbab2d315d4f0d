"""``fit --physics``: the model goes on with what `explain` named, and with nothing that it refused."""

import json

import numpy as np
import pytest

import calibrate
from session.io.units import DEG, G
from tinygc import SimulationOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.residual import closure_angles
from tinygc.estimation.fit import fit_session
from tinygc.estimation.options import FitOptions
from tinygc.explanation.engine import explain_session
from tinygc.explanation.physics import fit_physics, physics_methods
from tinygc.models.files import load
from tinygc.models.linear import NAMES
from tinygc.simulation.write import write_session

PER_G = np.array([[0.03, -0.01, 0.0], [0.0, 0.02, 0.015], [-0.02, 0.0, 0.01]])  # dps/g
PER_C = np.array([0.012, -0.02, 0.015])  # dps/K


def simulated(folder, distort, **options):
    return write_session(
        SimulationOptions(**{"segments": 24, "closure_s": 0.0, "seed": 5, "odr_hz": 104.0, **options}), folder, distort=distort
    )


def on_gravity(t_s, rate, force, temp_c):
    return rate + force / G @ (PER_G * DEG).T


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """A zero that follows temperature, fitted with what naming finds; its fit.json and folder."""

    def distort(t_s, rate, force, temp_c):
        return rate + np.outer(temp_c - temp_c[0], PER_C * DEG)

    folder = simulated(tmp_path_factory.mktemp("physics") / "warm", distort, warm_up_c=8.0)
    words = ["fit", str(folder), "--physics", "auto", "--methods", "least_squares,tinygc", "--quiet", "--bias", "ends"]
    assert calibrate.main([*words, "--json", str(folder / "out.json")]) == 0
    return folder, json.loads((folder / "out.json").read_text())


def test_parameters_asked_for_by_id_are_recovered(tmp_path):
    problem = build_problem(read_session(simulated(tmp_path / "s", on_gravity, segments=40)))
    found = fit_physics(problem, ("gyro.g_sensitivity",))
    (claim,) = found.model.claims
    sigma = np.sqrt(np.diag(found.fit.theta_covariance(0)))
    pulls = (claim.theta - PER_G.ravel() * DEG) / sigma
    assert np.abs(pulls).max() < 4
    assert np.mean(np.abs(pulls) < 1) > 0.3
    assert sigma.max() < 0.004 * DEG


def test_fit_and_explain_have_one_closure_of_one_model_and_one_verdict(tmp_path):
    """Also where a fit with physics is explained: what is to be explained is what the linear model misses."""
    session = read_session(simulated(tmp_path / "s", on_gravity, segments=20, odr_hz=62.5))
    fit = fit_session(session, FitOptions(methods=("least_squares",), physics=("auto",)), physics=physics_methods)
    alone = fit_session(session, FitOptions(methods=("least_squares",)))
    physics, why, again = fit.methods["physics"], explain_session(session), explain_session(session, fit=fit)
    assert fit.use.method == "physics"
    np.testing.assert_allclose(physics.held_out, why.proof.after, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(why.proof.before, alone.linear.held_out, rtol=1e-9, atol=1e-12)
    assert physics.model.linear is fit.physics.fit.state.model
    np.testing.assert_allclose(closure_angles(fit.physics.left.batch, physics.model.linear), physics.angles, atol=1e-12)
    assert [test.name for test in fit.verdict().tests] == ["gravity"]  # those of the linear model do not hold for the one with physics
    assert again.decision.tests == why.decision.tests == alone.verdict().tests
    assert again.decision.headline == alone.verdict().headline
    assert (again.verdict, again.p_value) == (why.verdict, why.p_value)


@pytest.mark.slow
def test_what_was_named_closes_better_and_the_net_carries_it(warm):
    _, told = warm
    held = {name: method["holdout"]["tilt_rms_deg"] for name, method in told["methods"].items()}
    assert held["physics"] < 0.2 * held["least_squares"]
    assert held["tinygc_physics"] < 1.05 * held["physics"]


@pytest.mark.slow
def test_the_saved_model_undoes_the_effect(warm):
    folder, _ = warm
    session = read_session(folder)
    (log,) = session.logs
    model = load(folder / "fit" / "model_physics.json")
    assert tuple(claim.effect.id for claim in model.undone) == ("gyro.thermal_bias",)
    samples = session.calibrated(log)
    linear = load(folder / "fit" / "model_least_squares.json")
    stills = [still for still in build_problem(session).stills if still.problem is None]
    drift = {}
    for name, rate in (("physics", model.calibrate(samples)), ("linear", linear(samples.gyro))):
        means = np.array([rate[still.start : still.stop].mean(axis=0) for still in stills])
        drift[name] = np.linalg.norm(np.polyfit(np.arange(len(means)), means, 1)[0]) * len(means) / DEG
    assert drift["linear"] > 0.1
    assert drift["physics"] < 0.01


@pytest.mark.slow
def test_the_saved_model_says_how_well_it_is_known(warm):
    folder, _ = warm
    table = json.loads((folder / "fit" / "model_physics.json").read_text())
    covariance = np.array(table["covariance"])
    assert table["covariance_of"][:12] == list(NAMES)
    assert table["covariance_of"][12:] == [f"gyro.thermal_bias[{i}]" for i in range(3)]
    assert covariance.shape == (15, 15)
    (effect,) = table["effects"]
    assert np.abs((np.array(effect["theta_si"]) - PER_C * DEG) / np.sqrt(np.diag(covariance)[12:])).max() < 4
    assert "covariance" not in json.loads((folder / "fit" / "model_tinygc_physics.json").read_text())
    assert calibrate.main(["export", str(folder), "--to", "json", "--model", "physics", "--quiet"]) == 0
    (path,) = (folder / "export").glob("*.json")
    assert json.loads(path.read_text())["covariance_of"] == table["covariance_of"]
    assert isinstance(load(path), type(load(folder / "fit" / "model_physics.json")))


@pytest.mark.slow
def test_what_explain_refuses_is_not_fitted(tmp_path, capsys):
    """In no catalogue: taken for one thing by naming alone, it would be saved as that."""

    def oscillating(t_s, rate, force, temp_c):
        return rate + np.outer(np.sin(2 * np.pi * t_s / 30), [0.08, 0.05, -0.065]) * DEG

    folder = simulated(tmp_path / "s", oscillating)
    found = fit_physics(build_problem(read_session(folder)), None)
    assert found.refused
    assert tuple(claim.effect.id for claim in found.model.undone) == ()
    assert calibrate.main(["fit", str(folder), "--physics", "auto", "--methods", "least_squares", "--verbose"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "Physics: a mismatch that no effect in the catalogue fits" in out
    assert "no mismatch was found" not in out


@pytest.mark.parametrize("words", ["gyro.nonsense", "", "auto,gyro.g_sensitivity", "gyro.g_sensitivity,"])
def test_an_id_that_is_none_is_one_line_before_anything_is_read(tmp_path, capsys, words):
    assert calibrate.main(["fit", str(tmp_path / "nowhere"), f"--physics={words}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "is no effect; give auto, or of accelerometer.cross_coupling, " in line
