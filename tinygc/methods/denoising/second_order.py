"""Levenberg-Marquardt on the taps of the linear denoiser: a fraction of a second."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from session.common.errors import FitError
from tinygc import closure
from tinygc.methods.denoise_options import DenoiseOptions
from tinygc.methods.denoising import risk as denoise_risk
from tinygc.methods.denoising.material import REACH, Material
from tinygc.methods.denoising.start import DenoiserTraining, start
from tinygc.methods.registry import Progress
from tinygc.models.denoiser import DILATIONS, KERNEL, PARAMETERS, DenoisedNet, Denoiser
from tinygc.models.model import Model

#: rows (R,), their design (R, 3, K), and the taps (3, K) at which the rows hold
Term = tuple[np.ndarray, np.ndarray, np.ndarray]

#: sigma of the prior around the weights at the start.  It settles what no loss sees, such as one layer's scale against another's;
#: the endpoint alone sees so little that it needs a close one, or it buys closure with noise (by as much as thirty times more of it)
PRIOR_SIGMA = {"endpoint": 0.1, "still": 3.0, "neighbours": 3.0}


MAX_STEPS = 80
#: the same from weights that smooth already: what is left is to close, which asks for little
NEAR_STEPS = 12


#: of the loss, relative: a step that gains less ends the search
ENOUGH = 1e-5


#: in sigmas for a moment of 1: how hard ``neighbours`` holds the moments of the taps at zero
PIN = 1e4


#: times that the closure is linearised anew
ROUNDS = 2


def taps_and_jacobian(vector: np.ndarray, dilations: tuple[int, int, int] = DILATIONS) -> tuple[np.ndarray, np.ndarray]:
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


def train_second_order(
    material: Material,
    calibration: Model,
    options: DenoiseOptions,
    progress: Progress = lambda step, steps: None,
    near: Denoiser | None = None,
    closing: bool = True,
) -> DenoiserTraining:
    """The taps of the linear subnet that are best for the loss, behind this calibration; as ``training.train_denoiser``.

    closing: whether the closure is part of the loss.
    """
    terms = [] if options.loss == "endpoint" else [_smoothing(material, calibration, options)]
    delay = options.delay if options.loss == "neighbours" else 0
    vector, losses = (start(options.seed) if near is None else near).vector, []
    steps = MAX_STEPS if near is None else NEAR_STEPS
    for number in range(ROUNDS):
        rows = [_closing(material, calibration, taps_and_jacobian(vector)[0], delay)] if closing else []
        vector, trace = _settle(vector, [*rows, *terms], PRIOR_SIGMA[options.loss], steps)
        losses += trace
        progress(number + 1, ROUNDS)
    denoiser = Denoiser.from_vector(vector).normalised()
    return DenoiserTraining(DenoisedNet(calibration, denoiser, material.rate_hz), tuple(losses))


def _smoothing(material: Material, calibration: Model, options: DenoiseOptions) -> Term:
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


def _closing(material: Material, calibration: Model, taps: np.ndarray, delay: int) -> Term:
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


def _settle(vector: np.ndarray, terms: list[Term], prior: float, steps: int) -> tuple[np.ndarray, list[float]]:
    """Levenberg-Marquardt on the sum of squares of all terms (rows, design, taps at which the rows hold) and a weak prior."""
    began, damping, losses = vector, 1e-3, []

    def residuals(v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        h, jacobian = taps_and_jacobian(v)
        return np.concatenate([rows + np.einsum("raj,aj->r", design, h - at) for rows, design, at in terms]), jacobian

    r, jacobian = residuals(vector)
    cost = r @ r
    whole = np.concatenate([design for _, design, _ in terms])
    for _ in range(steps):
        J = np.concatenate([whole[:, axis] @ jacobian[axis] for axis in range(3)], axis=1)
        normal = J.T @ J + np.eye(PARAMETERS) / prior**2
        gradient = J.T @ r + (vector - began).ravel() / prior**2
        while True:
            trial = vector - np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient).reshape(3, -1)
            trial_r, trial_jacobian = _or_none(residuals, trial) or (None, None)
            trial_cost = np.inf if trial_r is None else trial_r @ trial_r
            if trial_cost <= cost or damping > 1e6:
                break
            damping *= 8
        gain = cost - trial_cost
        if gain > 0 and trial_r is not None and trial_jacobian is not None:
            vector, r, jacobian, cost, damping = trial, trial_r, trial_jacobian, trial_cost, max(damping / 8, 1e-9)
        if not np.isfinite(cost):
            raise FitError("training the denoiser left the finite numbers; are the rates in the log in the unit that its header says?")
        losses.append(float(cost / len(r)))
        if gain < ENOUGH * cost:
            break
    return vector, losses


def _or_none(residuals: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], vector: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    try:
        return residuals(vector)
    except FitError:
        return None
