"""The denoiser by the paper's AdamW in PyTorch: the same losses for any slope of its leaky ReLUs, bent ones too; the best epoch counts."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tinygc import closure
from tinygc.methods.checkpoint import Checkpoint
from tinygc.methods.denoise_options import DenoiseOptions
from tinygc.methods.denoising import risk as denoise_risk
from tinygc.methods.denoising.material import REACH, Material
from tinygc.methods.denoising.second_order import train_second_order
from tinygc.methods.denoising.start import DenoiserTraining, start
from tinygc.methods.network.adamw_checkpoint import device, minimise
from tinygc.methods.registry import Progress
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.model import Model

if TYPE_CHECKING:
    from torch import Tensor

#: a third of the calibration's: the subnet's taps are products of three weights
LEARNING_RATE = 0.003
#: size of the second dose of noise that shows how far an answer follows the noise of its target
DOSE = 0.1


def train_adamw(
    material: Material, calibration: Model, options: DenoiseOptions, progress: Progress, checkpoint: Checkpoint | None = None
) -> DenoiserTraining:
    """As ``training.train_denoiser``.  For a bent net the shared noise is measured by a second dose of it (Ramani 2008)."""
    import torch

    batch, smoothing, where = material.batch, options.loss != "endpoint", device()
    delay = options.delay if options.loss == "neighbours" else 0
    context = np.ascontiguousarray(calibration(material.context))
    x, weight = (torch.as_tensor(array, device=where) for array in (context, 2 / material.sigma.reshape(len(batch), -1)))
    if smoothing:
        quiet = _noise(material, calibration)
        parts = (quiet, _tiled(quiet, context.shape, options.seed), *_scales(material, calibration, options))
        noise, dose, scale, rest = (torch.as_tensor(array, device=where) for array in parts)

    def loss_of(vector: Tensor) -> Tensor:
        net = Denoiser.from_vector(vector, options.slope).normalised()
        y = net.windowed(x)
        r = closure.segment_residuals(batch, y[:, delay : delay + batch.rate.shape[1]]) * weight
        loss = (r**2).mean()
        if smoothing:
            loss = loss + (scale * rest * (net.windowed(noise) ** 2).mean(0)).sum()
        if options.loss == "neighbours":
            target, doses = (array[:, REACH - delay : x.shape[1] - delay] for array in (x, dose))
            shared = doses * (net.windowed(x + DOSE * dose) - y) / DOSE
            loss = loss + (scale * ((y - target) ** 2 + 2 * shared).mean((0, 1))).sum()
        return loss

    begin = start(options.seed, options.slope).vector
    if options.loss == "neighbours":
        # From the identity, a delay of 0, hundreds of epochs do not come near: it begins at the linear solution of the second order.
        begin = train_second_order(material, calibration, replace(options, slope=1.0)).model.denoiser.vector
    # The best epoch counts: at the identity the endpoint loss is near its least already.
    _, best, losses = minimise(
        loss_of,
        begin,
        epochs=options.epochs,
        learning_rate=LEARNING_RATE,
        identity=[context, batch.dt, batch.earth, batch.start, batch.end, material.sigma, np.array(list(repr(options).encode()))],
        checkpoint=checkpoint,
        progress=progress,
    )
    denoiser = Denoiser.from_vector(best, options.slope).normalised()
    return DenoiserTraining(DenoisedNet(calibration, denoiser, material.rate_hz), tuple(losses))


def _noise(material: Material, calibration: Model) -> np.ndarray:
    """(M, 3) rad/s: the stills one after the other, each about its mean."""
    return np.concatenate([calibration(still) - calibration(still).mean(axis=0) for still in material.stills])


def _tiled(noise: np.ndarray, shape: tuple[int, ...], seed: int) -> np.ndarray:
    """Real noise in another order, (S, T, 3)."""
    starts = np.random.default_rng(seed).integers(len(noise), size=(shape[0], 1))
    return noise[(starts + np.arange(shape[1])) % len(noise)]


def _scales(material: Material, calibration: Model, options: DenoiseOptions) -> tuple[np.ndarray, np.ndarray]:
    """What a squared error of each axis counts (3,), one over the noise's variance, and rest's weight against motion (3,)."""
    rates = [calibration(x) for x in material.stretches]
    risk = denoise_risk.measure(rates, [calibration(x) for x in material.stills], REACH + 1, options.delay)
    weight = risk.ideal(options.reduction)[1] if options.loss == "neighbours" else np.ones(3)
    return 1 / (risk.noise[:, 0] * np.maximum(weight, 1)), weight
