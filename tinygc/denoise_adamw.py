"""The denoiser by the paper's AdamW in PyTorch: the same losses for any slope of its leaky ReLUs, bent ones too; the best epoch counts."""

from __future__ import annotations

import numpy as np

from session.errors import FitError
from tinygc import closure, denoise_risk
from tinygc.denoise_material import REACH, Material
from tinygc.denoiser import DenoisedNet, Denoiser

#: a third of the calibration's: the subnet's taps are products of three weights
LEARNING_RATE = 0.003
#: size of the second dose of noise that shows how far an answer follows the noise of its target
DOSE = 0.1


def train_adamw(material: Material, calibration, options, progress):
    """As ``denoise_training.train_denoiser``.  For a bent net the shared noise is measured by a second dose of it (Ramani 2008)."""
    import torch

    from tinygc.denoise_training import DenoiserTraining, start

    batch, smoothing = material.batch, options.loss != "endpoint"
    delay = options.delay if options.loss == "neighbours" else 0
    x = torch.as_tensor(np.ascontiguousarray(calibration(material.context)))
    weight = torch.as_tensor(2 / material.sigma.reshape(len(batch), -1))
    if smoothing:
        quiet = _noise(material, calibration)
        noise, dose, scale, rest = (
            torch.as_tensor(quiet),
            torch.as_tensor(_tiled(quiet, x.shape, options.seed)),
            *_scales(material, calibration, options),
        )
    vector = torch.as_tensor(start(options.seed, options.slope).vector).requires_grad_()
    optimizer = torch.optim.AdamW([vector], lr=LEARNING_RATE, weight_decay=0.0)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, options.epochs)
    losses, best = [], vector.detach().numpy().copy()
    for epoch in range(options.epochs):
        optimizer.zero_grad()
        net = Denoiser.from_vector(vector, options.slope).normalised()
        y = net.windowed(x)
        r = closure.segment_residuals(batch, y[:, delay : delay + batch.rate.shape[1]]) * weight
        loss = (r**2).mean()
        if smoothing:
            loss = loss + (scale * rest * (net.windowed(noise) ** 2).mean(0)).sum()
        if options.loss == "neighbours":
            target = x[:, REACH - delay : x.shape[1] - delay]
            shared = dose[:, REACH - delay : x.shape[1] - delay] * (net.windowed(x + DOSE * dose) - y) / DOSE
            loss = loss + (scale * ((y - target) ** 2 + 2 * shared).mean((0, 1))).sum()
        if not torch.isfinite(loss):
            raise FitError("training the denoiser left the finite numbers; are the rates in the log in the unit that its header says?")
        losses.append(float(loss.detach()))
        if losses[-1] <= min(losses):  # it begins at the identity, where the endpoint loss is near its least already
            best = vector.detach().numpy().copy()
        loss.backward()
        optimizer.step()
        schedule.step()
        progress(epoch + 1, options.epochs)
    denoiser = Denoiser.from_vector(best, options.slope).normalised()
    return DenoiserTraining(DenoisedNet(calibration, denoiser, material.rate_hz), tuple(losses))


def _noise(material: Material, calibration) -> np.ndarray:
    """(M, 3) rad/s: the stills one after the other, each about its mean."""
    return np.concatenate([calibration(still) - calibration(still).mean(axis=0) for still in material.stills])


def _tiled(noise: np.ndarray, shape, seed: int) -> np.ndarray:
    """Real noise in another order, (S, T, 3)."""
    starts = np.random.default_rng(seed).integers(len(noise), size=(shape[0], 1))
    return noise[(starts + np.arange(shape[1])) % len(noise)]


def _scales(material: Material, calibration, options):
    """What a squared error of each axis counts (3,), one over the noise's variance, and rest's weight against motion (3,)."""
    import torch

    rates = [calibration(x) for x in material.stretches]
    risk = denoise_risk.measure(rates, [calibration(x) for x in material.stills], REACH + 1, options.delay)
    weight = risk.ideal(options.reduction)[1] if options.loss == "neighbours" else np.ones(3)
    return torch.as_tensor(1 / (risk.noise[:, 0] * np.maximum(weight, 1))), torch.as_tensor(weight)
