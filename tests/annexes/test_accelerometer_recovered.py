"""Effects of the accelerometer in simulated sessions: parameters lie within their stated sigmas, beside a given calibration and beside one
from the session's own stills."""

import re

import numpy as np
import pytest
from known_effects import measured_force

from session.io.folder import read_session
from session.io.units import DEG, G
from tinygc import SimulationOptions
from tinygc.closure.build import build_problem
from tinygc.closure.prepared import prepare
from tinygc.effects import Movement, catalogue
from tinygc.noise.channels import in_gauge
from tinygc.noise.components import known_whitener
from tinygc.noise.refit import refit
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import PRECALIBRATION_MPS2
from tinygc.simulation.simulator import plan_of, simulate_session, temperature
from tinygc.simulation.write import config_text, write_files

OWN = sorted(name for name in catalogue() if name.startswith("accelerometer."))
SHARE = 0.05  #: of the plausible size


def inject(effect, folder, size: float, seed: int) -> np.ndarray:
    """A session whose accelerometer has the effect, and errors of the size that a fit allows a pre-calibration; returns theta (P,)."""
    warm_up_c = 10.0 if "temperature" in effect.inputs else 1.5
    options = SimulationOptions(segments=16, closure_s=0.0, odr_hz=208.0, seed=seed, warm_up_c=warm_up_c)
    plan, rng = plan_of(options), np.random.default_rng(seed)
    theta = size * rng.uniform(0.5, 1.5, effect.parameter.size) * rng.choice((-1.0, 1.0), effect.parameter.size)
    rng = np.random.default_rng(seed)
    bias, matrix = (PRECALIBRATION_MPS2 * rng.standard_normal(shape) for shape in (3, (3, 3)))

    def bent(t, force):
        temp_c, none = temperature(t, options.temperature_start_c, warm_up_c), np.zeros(len(t))
        known = plan.log_s, options.gyro_fs_dps * DEG, options.temperature_start_c
        moved = Movement(t, t[1] - t[0], np.zeros_like(force), force / G, temp_c, none, *known)
        return measured_force(effect, moved, theta) * G + bias + force @ matrix.T / G

    simulation = simulate_session(options, plan=plan, disturb=bent)
    write_files(simulation, folder, config_text(simulation, concealed=False))
    return theta


def beside_a_given_calibration(folder, effect):
    """The fit of a session that states a calibration of its accelerometer."""
    return fit_of(build_problem(read_session(folder)), effect)


def beside_its_own_stills(folder, effect):
    """The fit of a session that states none."""
    path = folder / "session.toml"
    path.write_text(re.sub(r"\[accelerometer\][^[]*(\[\[.*\]\])?[^[]*\[-?\d.*\]\n", "", path.read_text(encoding="utf-8")), encoding="utf-8")
    problem = prepare(folder).as_given().problem
    assert problem.session.config.accelerometer.source == "stills"
    return fit_of(problem, effect)


def fit_of(problem, effect):
    twin = Twin(problem)
    whiten = known_whitener(twin)
    return in_gauge(twin, whiten, refit(twin, whiten, [effect], twin.start()))


def errors_of(fit, truth) -> np.ndarray:
    """(P,) errors of the parameters in their sigmas, inflated as ``fit`` does."""
    widen = max(1.0, fit.chi_square / max(len(fit.r) - fit.J.shape[1], 1))
    return (fit.state.claims[0].theta - truth) / np.sqrt(widen * np.diag(fit.theta_covariance(0)))


@pytest.mark.parametrize("name", ["accelerometer.zero_drift", "accelerometer.nonlinearity"])
def test_an_effect_is_recovered_beside_nine_numbers_of_the_same_stills(tmp_path, name):
    """They took up a part of it, from turns as well as from lengths; unless that is taken back, errors are many sigmas."""
    effect = catalogue()[name]
    truth = inject(effect, tmp_path, 2 * SHARE * effect.parameter.plausible, 2)
    fit = beside_its_own_stills(tmp_path, effect)
    assert np.abs(errors_of(fit, truth)).max() < 3.5
    assert np.abs(fit.state.claims[0].theta).max() > 8 * np.sqrt(np.diag(fit.theta_covariance(0))).min()


@pytest.mark.slow
@pytest.mark.parametrize("fit", [beside_a_given_calibration, beside_its_own_stills])
def test_two_thirds_lie_within_one_sigma(tmp_path, fit):
    errors = []
    for name in OWN:
        effect = catalogue()[name]
        for seed in range(1, 9):
            folder = tmp_path / f"{name}{seed}"
            truth = inject(effect, folder, SHARE * effect.parameter.plausible, seed)
            errors.append(errors_of(fit(folder, effect), truth))
    within = np.concatenate(errors)
    assert 0.58 < np.mean(np.abs(within) < 1) < 0.80, np.mean(np.abs(within) < 1)
    assert np.abs(within).max() < 5
