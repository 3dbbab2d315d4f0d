"""Training the denoiser: what its losses measure, what each of them makes of the noise, and that the closure does not pay for it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import Turns

from session.io.errors import FitError
from session.io.units import DEG
from tinygc import closure
from tinygc.estimation import denoiser
from tinygc.estimation.denoiser import REACH, Material, start, taps_and_jacobian, train_denoiser
from tinygc.models.denoiser import Denoiser
from tinygc.models.linear import bias_only

pytestmark = pytest.mark.broad

ODR_HZ, NOISE_RPS = 208.0, 0.05 * DEG


def material(seed=0, count=24, turns_seed=11):
    """A chain of turns, still for a second at either end of each, and white noise of 0.05 dps; stills of two seconds."""
    turns = Turns(count, seed=turns_seed, odr_hz=ODR_HZ)
    rng = np.random.default_rng(seed)
    rest = round(ODR_HZ)
    clean = np.pad(turns.rate, ((0, 0), (rest, rest), (0, 0)))
    dt = np.full((count, clean.shape[1] - 1), 1 / ODR_HZ)
    around = np.pad(clean, ((0, 0), (REACH, REACH), (0, 0)))
    around += NOISE_RPS * rng.standard_normal(around.shape)
    batch = closure.Batch(around[:, REACH:-REACH], dt, np.zeros_like(clean), turns.q[:-1], turns.q[1:], False)
    stills = [NOISE_RPS * rng.standard_normal((2 * rest, 3)) for _ in range(count + 1)]
    sigma = np.full(count, NOISE_RPS / np.sqrt(ODR_HZ) * np.sqrt(5.0))
    return Material(batch, sigma, around, np.full(count, clean.shape[1]), stills, ODR_HZ), clean


@pytest.fixture(scope="module")
def trained():
    seen, _ = material()
    return train_denoiser(seen, bias_only()).model


def at_rest(model, seed=9):
    noise = np.random.default_rng(seed).standard_normal((40000, 3))
    return noise.std(axis=0) / model.denoiser(noise).std(axis=0)


def rms_deg(material, rate):
    return np.sqrt(np.mean(closure.error_angles(closure.segment_residuals(material.batch, rate)) ** 2)) / DEG


def test_taps_and_their_derivatives():
    """Against the subnet itself, and autograd."""
    vector = start(3).vector + 0.2 * np.random.default_rng(4).normal(size=(3, 56))
    taps, jacobian = taps_and_jacobian(vector)
    np.testing.assert_allclose(taps, Denoiser.from_vector(vector).normalised().taps(), atol=1e-12)

    def of(weights):
        impulse = torch.zeros((2 * REACH + 1, 3), dtype=torch.float64)
        impulse[REACH] = 1.0
        return Denoiser.from_vector(weights).normalised().windowed(impulse).T

    exact = torch.autograd.functional.jacobian(of, torch.as_tensor(vector)).numpy()
    for axis in range(3):
        np.testing.assert_allclose(jacobian[axis], exact[axis, :, axis], atol=1e-10)


def test_it_starts_at_the_identity_and_can_learn():
    rate = np.random.default_rng(0).normal(size=(80, 3))
    np.testing.assert_allclose(start(0)(rate), rate, atol=1e-14)
    assert np.linalg.matrix_rank(taps_and_jacobian(start(0).vector)[1][0]) >= 15


def test_the_error_in_motion_is_measured_without_the_truth():
    """The risk of three filters against noisy neighbours, and their squared error against the truth that it never saw."""
    seen, clean = material(seed=2)
    delay = 8
    risk = denoiser.measure(list(seen.batch.rate), seen.stills, REACH + 1, delay)
    np.testing.assert_allclose(np.sqrt(risk.noise[:, 0]), NOISE_RPS, rtol=0.02)
    for taps in (np.eye(REACH + 1)[delay], np.full(REACH + 1, 1 / 17) * (np.arange(REACH + 1) < 17), risk.ideal(2.0)[0][0]):
        taps = np.tile(taps, (3, 1))
        windows = np.lib.stride_tricks.sliding_window_view(seen.batch.rate, REACH + 1, axis=1)[..., ::-1]
        answer = np.einsum("staj,aj->sta", windows, taps)
        true = np.mean((answer - clean[:, REACH - delay : clean.shape[1] - delay]) ** 2, axis=(0, 1))
        said = np.einsum("ai,aij,aj->a", taps, risk.motion, taps) + 2 * np.sum(risk.shared * taps, axis=1) - risk.noise[:, 0]
        np.testing.assert_allclose(said, true, rtol=0.05, atol=0.05 * NOISE_RPS**2)


def test_ideal_taps_keep_their_promises():
    risk = denoiser.measure(material()[0].stretches, material()[0].stills, REACH + 1, 12)
    taps, _ = risk.ideal(3.0)
    np.testing.assert_allclose(denoiser.moments(REACH + 1, 12) @ taps.T, np.eye(4)[:, [0, 0, 0]], atol=1e-8)
    assert (np.sqrt(risk.noise[:, 0] / risk.at_rest(taps)) > 2.999).all()


def test_noise_that_rings_longer_than_its_lags_is_still_noise():
    """A line in the stills: its autocovariance, cut off behind twelve lags, has negative power.  White noise stays as it was estimated."""
    rng, t = np.random.default_rng(0), np.arange(2000.0)
    rings = [np.cos(0.9 * t + phase)[:, None] * [1, 2, 3] + 0.01 * rng.standard_normal((2000, 3)) for phase in (0, 1, 2)]
    r = denoiser.autocovariance(rings, REACH + 1)
    lags = np.abs(np.arange(REACH + 1)[:, None] - np.arange(REACH + 1))
    cut = np.where(lags > denoiser.LAGS, 0, np.cos(0.9 * lags))
    assert np.linalg.eigvalsh(cut)[0] < -0.1
    assert (np.linalg.eigvalsh(r[:, lags])[:, 0] > 0).all()
    np.testing.assert_allclose(r[:, 0], [0.5, 2, 4.5], rtol=0.01)
    np.testing.assert_allclose(r[:, 1:6] / r[:, :1], np.tile(np.cos(0.9 * np.arange(1, 6)), (3, 1)), atol=0.35)
    white = [rng.standard_normal((2000, 3)) for _ in range(4)]
    x = [each - each.mean(axis=0) for each in white]
    lag3 = sum((each[3:] * each[:-3]).sum(axis=0) for each in x) / (4 * 1996)
    np.testing.assert_allclose(denoiser.autocovariance(white, REACH + 1)[:, 3], lag3)


def test_noise_at_rest_falls_threefold_twelve_samples_late(trained):
    """On noise that it has not seen."""
    assert (at_rest(trained) > 3.0).all()
    np.testing.assert_allclose(trained.denoiser.delay_samples, 12, atol=0.01)
    assert trained.delay_samples == 12
    np.testing.assert_allclose(trained.denoiser.gain, 1, atol=1e-12)


def test_the_closure_of_turns_it_never_saw_does_not_suffer(trained):
    for seed in (5, 6):
        fresh, _ = material(seed=seed, turns_seed=12 + seed)
        calibrated = rms_deg(fresh, fresh.batch.rate)
        assert rms_deg(fresh, fresh.rate(trained)) < 1.05 * calibrated


def test_it_passes_cubics_late_but_whole(trained):
    t = np.arange(200.0)[:, None] / 50
    cubic = 1 + 2 * t - t**2 + 0.5 * t**3 * np.array([1.0, -1.0, 0.5])
    np.testing.assert_allclose(trained.denoiser(cubic)[60:], cubic[48:-12], atol=5e-4)


def test_the_endpoint_alone_hardly_smooths():
    seen, _ = material()
    assert at_rest(train_denoiser(seen, bias_only(), "endpoint").model).max() < 2


def test_seeded_and_frozen(trained):
    seen, _ = material()
    calibration = bias_only(np.array([0.01, 0.0, -0.02]))
    again = train_denoiser(seen, bias_only()).model
    np.testing.assert_array_equal(again.denoiser.vector, trained.denoiser.vector)
    assert train_denoiser(seen, calibration).model.calibration is calibration


def test_bad_input_is_refused():
    seen, _ = material(count=8)
    with pytest.raises(FitError, match="noise"):
        train_denoiser(replace(seen, stills=[np.zeros((100, 3))]), bias_only())
    seen.context[1, 50, 0] = np.nan
    with pytest.raises(FitError, match="finite"), np.errstate(invalid="ignore"):
        train_denoiser(seen, bias_only())
