"""``fit --physics``: the model goes on with what `explain` named, and with nothing that it refused."""

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
from tinygc.simulation.write import write_session

PER_G = np.array([[0.03, -0.01, 0.0], [0.0, 0.02, 0.015], [-0.02, 0.0, 0.01]])  # dps/g


def simulated(folder, distort, **options):
    return write_session(
        SimulationOptions(**{"segments": 24, "closure_s": 0.0, "seed": 5, "odr_hz": 104.0, **options}), folder, distort=distort
    )


def on_gravity(t_s, rate, force, temp_c):
    return rate + force / G @ (PER_G * DEG).T


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


@pytest.mark.parametrize("words", ["gyro.nonsense", "", "auto,gyro.g_sensitivity", "gyro.g_sensitivity,"])
def test_an_id_that_is_none_is_one_line_before_anything_is_read(tmp_path, capsys, words):
    assert calibrate.main(["fit", str(tmp_path / "nowhere"), f"--physics={words}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "is no effect; give auto, or of accelerometer.cross_coupling, " in line
