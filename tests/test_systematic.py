"""How far one effect that the model lacks moves the parameters: against injected effects, and against the joint normal distribution."""

import numpy as np
import pytest

import tinygc
from tinygc.effects import effect_of
from tinygc.estimation.stated_noise import stated_response
from tinygc.noise.candidates import candidates
from tinygc.noise.refit import calibration_columns, prior_sigmas

OPTIONS = {"segments": 13, "closure_s": 0.0, "odr_hz": 104.0, "seed": 4, "latitude_deg": 47.0}


def fitted(**effects):
    return tinygc.fit(
        tinygc.simulate(**OPTIONS, effects=effects).session, methods=("least_squares",), bias="ends", earth=False, accelerometer="given"
    ).result


@pytest.fixture(scope="module")
def clean():
    return fitted()


def parts(result):
    """What the figure is made of: twin, residuals (n,), columns of the calibration, of each effect, covariance, response of the fit."""
    noise, model = result.noise, result.linear.model
    twin, start = noise.twin, noise.twin.start()
    rates = twin.rates(start)
    sensitivity = twin.sensitivity(start, rates)
    columns = calibration_columns(twin, start, sensitivity) * prior_sigmas(twin, [])
    effects = [(each, twin.effect_columns(each, start, sensitivity, rates).stacked()) for each in candidates(twin)]
    response = stated_response(result.problem, model, noise, result.options.still_rates)
    return twin.residuals(start, rates).stacked(), columns, effects, result.widened * noise.covariance, response


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("gyro.scale_asymmetry", {"half_difference": [2e-3, -1e-3, 1.5e-3]}),
    ],
)
def test_the_parameters_move_as_the_response_says(clean, name, parameters):
    """The same session with and without the effect, both fitted, with neither heading nor accelerometer to follow the effect."""
    effect = effect_of(name)
    theta = np.ravel(next(iter(parameters.values()))) * effect.parameter.si
    moved = fitted(**{name: parameters}).linear.model.vector - clean.linear.model.vector
    _, _, effects, _, response = parts(clean)
    (columns,) = [columns for each, columns in effects if each.id == name and each.shape == effect.shape][:1]
    # The columns are those of the first linear fit, in which misalignment and scale errors of 2 % and the effect's own size are left out.
    np.testing.assert_allclose(-response @ columns @ theta, moved, rtol=0, atol=0.06 * np.abs(moved).max())


def test_where_something_is_missing_the_recording_allows_more(clean):
    """A scale asymmetry of 1 % that the fit leaves out: E is off by more than three of its sigmas, and not of both."""
    spoilt = fitted(**{"gyro.scale_asymmetry": {"half_difference": [5e-3, -5e-3, 5e-3]}})
    off = np.abs(spoilt.linear.model.vector - clean.linear.model.vector)
    sigma, moved = np.sqrt(np.diag(spoilt.covariance)), spoilt.systematic
    assert np.max(off / sigma) > 3
    assert np.max(off / np.hypot(sigma, moved)) < 2
    assert np.median(np.hypot(1, clean.systematic / np.sqrt(np.diag(clean.covariance)))) < 2.5
