"""How far one effect that the model lacks moves the parameters: against injected effects, and against the joint normal distribution."""

import numpy as np
import pytest

import tinygc
from session.io.units import DEG
from tinygc.effects import effect_of
from tinygc.estimation.stated_noise import stated_response
from tinygc.estimation.systematic import Systematic, systematic_of
from tinygc.estimation.verdict import too_wide
from tinygc.models.linear import field_quantities
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
        ("gyro.g_sensitivity", {"matrix_dps_per_g": [[0.2, 0, 0.08], [0, -0.16, 0], [0.12, 0, 0.2]]}),
        ("gyro.scale_nonlinearity", {"cubic_at_fs": [0.01, -0.01, 0.008]}),
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


def test_it_is_the_second_moment_of_the_joint_normal_distribution(clean):
    """Calibration and effect estimated together, theta's part taken out; variants weighed by the density of the residuals."""
    residuals, columns, effects, covariance, response = parts(clean)
    found = systematic_of(clean.problem, clean.linear.model, clean.noise, clean.widened, clean.options.still_rates)
    precision = np.linalg.inv(covariance)
    for name in ("gyro.scale_asymmetry", "gyro.bias_step"):
        log_p, squares = [], []
        for effect, own in effects:
            if effect.id != name:
                continue
            prior = effect.parameter.plausible
            both = np.column_stack([columns, own * prior])
            information = both.T @ precision @ both + np.eye(both.shape[1])
            joint = np.linalg.inv(information)
            theta = prior * (joint @ -(both.T @ precision @ residuals))[columns.shape[1] :]
            spread = prior**2 * joint[columns.shape[1] :, columns.shape[1] :]
            squares.append(response @ own @ (spread + np.outer(theta, theta)) @ own.T @ response.T)
            marginal = covariance + columns @ columns.T + prior**2 * own @ own.T
            scale = np.sqrt(np.diag(marginal))
            factor = np.linalg.cholesky(marginal / np.outer(scale, scale))
            white = np.linalg.solve(factor, residuals / scale)
            log_p.append(-white @ white / 2 - np.log(np.diag(factor)).sum() - np.log(scale).sum())
        weights = np.exp(np.array(log_p) - max(log_p))
        expected = np.average(squares, axis=0, weights=weights)
        size = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(found.by_effect[name] / np.outer(size, size), expected / np.outer(size, size), rtol=0, atol=2e-4)
    assert len(squares) == 11  # of the step: the middles of 13 turns but the first and the last


def test_the_largest_movement_by_one_effect_is_stated():
    a, b = np.zeros((12, 12)), np.zeros((12, 12))
    a[0, 0], a[9, 9] = 4e-8, (0.1 * DEG) ** 2
    b[0, 0] = b[4, 4] = 1e-8
    found = Systematic({"one": a, "two": b}, np.ones((3, 2, 12)))
    assert found.tilt_rms == pytest.approx(np.sqrt(2) * np.hypot(2e-4, 0.1 * DEG))
    assert found.sigma[[0, 4, 9]] == pytest.approx([2e-4, 1e-4, 0.1 * DEG])
    assert [found.to_json()["effects"][i] for i in (0, 4, 9)] == ["one", "two", "one"]
    quantities = field_quantities(np.r_[np.eye(3).ravel(), np.zeros(3)], 1e-10 * np.eye(12), moved=found.of)
    moved = {f"{q.word} {q.component}": q.moved for q in quantities}
    assert [moved[f"scale factor error {axis}"] for axis in "xyz"] == pytest.approx([200, 100, 0])
    assert moved["bias x"] == pytest.approx(0.1)


def test_where_something_is_missing_the_recording_allows_more(clean):
    """A scale asymmetry of 1 % that the fit leaves out: E is off by more than three of its sigmas, and not of both."""
    spoilt = fitted(**{"gyro.scale_asymmetry": {"half_difference": [5e-3, -5e-3, 5e-3]}})
    off = np.abs(spoilt.linear.model.vector - clean.linear.model.vector)
    sigma, moved = np.sqrt(np.diag(spoilt.covariance)), spoilt.systematic
    assert np.max(off / sigma) > 3
    assert np.max(off / np.hypot(sigma, moved)) < 2
    assert np.median(np.hypot(1, clean.systematic / np.sqrt(np.diag(clean.covariance)))) < 2.5


def test_a_calibration_that_an_effect_may_have_moved_too_far_is_in_doubt(clean):
    """By more than the limit; without one, by more than the raw rates leave."""
    size = clean.allowed.tilt_rms / DEG
    assert too_wide(clean.allowed.tilt_rms, 1.01 * size, clean.against_raw) == []
    assert too_wide(clean.allowed.tilt_rms, None, clean.against_raw) == []
    (doubt,) = too_wide(clean.allowed.tilt_rms, 0.99 * size, clean.against_raw)
    assert doubt.endswith("more than the limit")
    (doubt,) = too_wide(1.01 * clean.against_raw.tilt_rms_deg * DEG, None, clean.against_raw)
    assert doubt.endswith("more than what the raw rates leave")
    assert clean.verdict(0.99 * size).answer in ("doubtful pass", "fail")
