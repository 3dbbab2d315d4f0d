"""Train the denoising subnet, calibration frozen: second order in NumPy where it is linear, the paper's AdamW in PyTorch.

Three losses.  ``endpoint`` is the paper's: the closure of the segments.  It hardly rewards smoothing, since what it integrates hides noise.
``still`` adds the variance in the stills: it smooths as far as it can, and loses the movement.  ``neighbours`` adds that and the expected
error in motion (risk.py), weighed so that noise at rest falls by a stated factor at a stated delay: the default.

Linear (slope 1), the closure is linear in the taps to first order, and the other losses are quadratic in them.  What all samples have
to say is therefore a matrix of 49 x 49 an axis, and training is Levenberg-Marquardt on 168 weights: a fraction of a second.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from session.errors import FitError
from tinygc import closure
from tinygc.denoising import risk as denoise_risk
from tinygc.denoising.denoiser import DILATIONS, KERNEL, PARAMETERS, DenoisedNet, Denoiser
from tinygc.denoising.material import REACH, Material

LOSSES = ("endpoint", "still", "neighbours")
#: sigma of the prior around the weights at the start.  It settles what no loss sees, such as one layer's scale against another's;
#: the endpoint alone sees so little that it needs a close one, or it buys closure with noise (by as much as thirty times more of it)
PRIOR_SIGMA = {"endpoint": 0.1, "still": 3.0, "neighbours": 3.0}
MAX_STEPS = 80
#: of the loss, relative: a step that gains less ends the search
ENOUGH = 1e-5
#: in sigmas for a moment of 1: how hard ``neighbours`` holds the moments of the taps at zero
PIN = 1e4
#: times that the closure is linearised anew
ROUNDS = 2


@dataclass(frozen=True)
class DenoiseOptions:
    """loss; delay in samples at which ``neighbours`` aims; reduction: factor by which it takes the noise at rest down; slope of the leaky
    ReLUs (AdamW only, if not 1); optimizer, epochs, seed of the start."""

    loss: str = "neighbours"
    delay: int = 12
    reduction: float = 3.2
    slope: float = 1.0
    optimizer: str = "second-order"
    epochs: int = 400
    seed: int = 0


@dataclass(frozen=True, eq=False)
class DenoiserTraining:
    """model whole; loss after each step or epoch."""

    model: DenoisedNet
    loss: tuple[float, ...]


def train_denoiser(
    material: Material,
    calibration,
    options: DenoiseOptions,
    progress: Callable[[int, int], None] = lambda step, steps: None,
    checkpoint=None,
) -> DenoiserTraining:
    """The whole net with this calibration, frozen; checkpoint (``adamw.Checkpoint``) where AdamW trains it.

    Raises FitError where the loss is not finite, or there is nothing to smooth.
    """
    if options.loss not in LOSSES:
        raise ValueError(f"loss is {options.loss!r}, expected one of {', '.join(LOSSES)}")
    if not 0 <= options.delay <= REACH:
        raise FitError(f"a delay of {options.delay} samples is not within the denoiser's reach of {REACH}")
    if options.optimizer == "adamw" or options.slope != 1:
        from tinygc.denoising.adamw import train_adamw

        return train_adamw(material, calibration, options, progress, checkpoint)
    return _second_order(material, calibration, options, progress)


def start(seed: int, slope: float = 1.0) -> Denoiser:
    """The identity, with a second channel that is ready to learn: nothing reads it yet."""
    noise = Denoiser.from_vector(0.1 * np.random.default_rng(seed).standard_normal((3, PARAMETERS // 3)))
    net = Denoiser.identity(slope)
    net.conv1[:, 1], net.conv2[:, 1] = noise.conv1[:, 1], noise.conv2[:, 1]
    return net


def taps_and_jacobian(vector: np.ndarray, dilations=DILATIONS) -> tuple[np.ndarray, np.ndarray]:
    """Taps (3, K) of the linear subnet with unit gain, newest first, and their derivatives (3, K, 56) by its weights.

    In the frequency domain, where convolutions are products: linear in each of the three layers.
    """
    net = Denoiser.from_vector(vector, dilations=dilations)
    taps = 1 + (KERNEL - 1) * sum(dilations)
    length = 2 * taps
    lag = np.arange(KERNEL)[::-1, None] * np.arange(length // 2 + 1)
    unit = [np.exp(-2j * np.pi * dilation * lag / length) for dilation in dilations]  # (KERNEL, F) each
    c1, c2, c3 = (np.einsum("aoci,if->aocf", weight, u) for weight, u in zip((net.conv1, net.conv2, net.conv3), unit, strict=True))
    first, third = c1[:, :, 0], c3[:, 0]
    through = np.einsum("aof,aocf->acf", third, c2)
    inner = np.einsum("aocf,acf->aof", c2, first)
    by = [
        np.einsum("acf,if->acif", through, unit[0]).reshape(3, -1, lag.shape[1]),
        np.einsum("aof,acf,if->aocif", third, first, unit[1]).reshape(3, -1, lag.shape[1]),
        np.einsum("aof,if->aoif", inner, unit[2]).reshape(3, -1, lag.shape[1]),
    ]
    h = np.fft.irfft(np.einsum("aof,aof->af", third, inner), length)[:, :taps]
    jacobian = np.fft.irfft(np.concatenate(by, axis=1), length)[..., :taps].transpose(0, 2, 1)
    gain = h.sum(axis=1)[:, None]
    if np.any(gain < 1e-6):
        raise FitError("the denoiser lost its gain at constant rates")
    h = h / gain
    return h, (jacobian - h[..., None] * jacobian.sum(axis=1)[:, None]) / gain[..., None]


def _second_order(material: Material, calibration, options: DenoiseOptions, progress) -> DenoiserTraining:
    terms = [] if options.loss == "endpoint" else [_smoothing(material, calibration, options)]
    delay = options.delay if options.loss == "neighbours" else 0
    vector, losses = start(options.seed).vector, []
    for number in range(ROUNDS):
        closing = _closing(material, calibration, taps_and_jacobian(vector)[0], delay)
        vector, trace = _settle(vector, [closing, *terms], PRIOR_SIGMA[options.loss])
        losses += trace
        progress(number + 1, ROUNDS)
    denoiser = Denoiser.from_vector(vector).normalised()
    return DenoiserTraining(DenoisedNet(calibration, denoiser, material.rate_hz), tuple(losses))


def _smoothing(material: Material, calibration, options: DenoiseOptions):
    """Rows and their design (rows, 3, K): the square root of the quadratic loss, less its minimum, in units of that minimum."""
    rates = [calibration(x) for x in material.stretches]
    stills = [calibration(x) for x in material.stills]
    risk = denoise_risk.measure(rates, stills, REACH + 1, options.delay)
    if not (np.isfinite(risk.motion).all() and (risk.noise[:, 0] > 0).all()):
        raise FitError("no noise in the stills to learn from, or rates that are not finite; is the log made of smoothed values?")
    if options.loss == "still":
        best = np.linalg.solve(risk.covariance, np.ones((3, REACH + 1, 1)))[..., 0]
        best, form = best / best.sum(axis=1, keepdims=True), risk.covariance
    else:
        best, weight = risk.ideal(options.reduction)
        form = risk.motion + weight[:, None, None] * risk.covariance
    least = np.einsum("ai,aij,aj->a", best, form, best)
    root = np.linalg.cholesky(form).transpose(0, 2, 1) * np.sqrt(risk.samples / least)[:, None, None]
    if options.loss == "neighbours":
        pins = denoise_risk.moments(REACH + 1, options.delay)[1:] * PIN
        root = np.concatenate([root, np.broadcast_to(pins, (3, *pins.shape))], axis=1)
    design = np.zeros((3, root.shape[1], 3, REACH + 1))
    design[np.arange(3), :, np.arange(3)] = root
    design = design.reshape(-1, 3, REACH + 1)
    return np.zeros(len(design)), design, best


def _closing(material: Material, calibration, taps: np.ndarray, delay: int):
    """Rows (S d,) of the closure in sigmas at these taps, and their design (S d, 3, K): linear in the taps, to first order."""
    batch = material.batch
    x = calibration(material.context)
    windows = np.lib.stride_tricks.sliding_window_view(x[:, delay : delay + REACH + batch.rate.shape[1]], REACH + 1, axis=1)[..., ::-1]
    rate = np.einsum("staj,aj->sta", windows, taps)
    turn = closure.sensitivity(batch, rate)[:, :, : batch.angles]
    weight = 1 / material.sigma.reshape(len(batch), -1)
    rows = (2 * closure.segment_residuals(batch, rate) * weight).ravel()
    design = np.empty((len(batch), batch.angles, 3, REACH + 1))
    for axis in range(3):
        design[:, :, axis] = turn[..., axis].transpose(0, 2, 1) @ windows[:, :, axis]
    return rows, (design * weight[..., None, None]).reshape(len(rows), 3, REACH + 1), taps


def _settle(vector: np.ndarray, terms, prior: float) -> tuple[np.ndarray, list[float]]:
    """Levenberg-Marquardt on the sum of squares of all terms (rows, design, taps at which the rows hold) and a weak prior."""
    began, damping, losses = vector, 1e-3, []

    def residuals(v):
        h, jacobian = taps_and_jacobian(v)
        return np.concatenate([rows + np.einsum("raj,aj->r", design, h - at) for rows, design, at in terms]), jacobian

    r, jacobian = residuals(vector)
    cost = r @ r
    whole = np.concatenate([design for _, design, _ in terms])
    for _ in range(MAX_STEPS):
        J = np.concatenate([whole[:, axis] @ jacobian[axis] for axis in range(3)], axis=1)
        normal = J.T @ J + np.eye(PARAMETERS) / prior**2
        gradient = J.T @ r + (vector - began).ravel() / prior**2
        while True:
            trial = vector - np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient).reshape(3, -1)
            trial_r, trial_jacobian = _or_none(residuals, trial)
            trial_cost = np.inf if trial_r is None else trial_r @ trial_r
            if trial_cost <= cost or damping > 1e6:
                break
            damping *= 8
        gain = cost - trial_cost
        if gain > 0:
            vector, r, jacobian, cost, damping = trial, trial_r, trial_jacobian, trial_cost, max(damping / 8, 1e-9)
        if not np.isfinite(cost):
            raise FitError("training the denoiser left the finite numbers; are the rates in the log in the unit that its header says?")
        losses.append(float(cost / len(r)))
        if gain < ENOUGH * cost:
            break
    return vector, losses


def _or_none(residuals, vector):
    try:
        return residuals(vector)
    except FitError:
        return None, None
