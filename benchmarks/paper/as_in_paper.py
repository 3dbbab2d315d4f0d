"""The paper's training: AdamW in PyTorch with a cosine decay, the distance at the ends, the first-order integrator."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from tinygc.closure.residual import Batch
from tinygc.methods.denoiser import Material, start
from tinygc.models.denoiser import DILATIONS, SHAPES, DenoisedNet, Denoiser
from tinygc.models.nets import CalibrationNet

EPOCHS = 2000
#: of the calibration; of the denoiser, whose taps are products of three weights
RATE, RATE_DENOISER = 0.01, 0.003
#: in sigmas: distances are smoothed below it, so that the gradient exists at zero
SHORTEST = 1e-3

Progress = Callable[[int, int], None]


def trained_net(batch: Batch, sigma: np.ndarray, progress: Progress = lambda done, of: None) -> CalibrationNet:
    """The calibration subnet from the identity; its loss is a mean of distances in sigmas, each over its sigma, not of squares."""
    spread = np.broadcast_to(sigma.reshape(len(batch), -1), (len(batch), batch.angles))
    trust = 1 / np.sqrt((spread**2).mean(axis=1))
    rate, weight, trust = (torch.as_tensor(array) for array in (batch.rate, 2 / spread, trust / trust.mean()))

    def loss(weights: torch.Tensor) -> torch.Tensor:
        r = _residuals(batch, calibrated(weights, rate), _first_order) * weight
        return ((r**2).sum(-1) + SHORTEST**2).sqrt() @ trust * batch.angles / r.numel()

    last, _ = _minimised(loss, CalibrationNet.identity().vector, RATE, progress)
    return CalibrationNet.from_vector(last)


def trained_denoiser(
    material: Material, calibration: CalibrationNet, seed: int = 0, progress: Progress = lambda done, of: None
) -> DenoisedNet:
    """The denoiser after a frozen calibration; of the best epoch, as the endpoint loss is near its minimum at the identity already."""
    batch = material.batch
    x, weight = (torch.as_tensor(array) for array in (calibration(material.context), 2 / material.sigma.reshape(len(batch), -1)))

    def loss(weights: torch.Tensor) -> torch.Tensor:
        return ((_residuals(batch, denoised(weights, x)[:, : batch.rate.shape[1]], _exact) * weight) ** 2).mean()

    _, best = _minimised(loss, start(seed).vector, RATE_DENOISER, progress)
    return DenoisedNet(calibration, Denoiser.from_vector(best).normalised(), material.rate_hz)


def kept(path: Path, train: Callable[[], object]) -> np.ndarray:
    """The weights of a training that takes minutes: those in a file of an earlier run, or new ones."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, train())
    return np.load(path)


def _minimised(loss_of: Callable, begin: np.ndarray, learning_rate: float, progress: Progress) -> tuple[np.ndarray, np.ndarray]:
    """The last weights, and those of the least loss."""
    weights = torch.as_tensor(begin).clone().requires_grad_()
    optimizer = torch.optim.AdamW([weights], lr=learning_rate, weight_decay=0.0)
    best, least = begin, math.inf
    for epoch in range(EPOCHS):
        optimizer.param_groups[0]["lr"] = learning_rate * (1 + math.cos(math.pi * epoch / EPOCHS)) / 2
        optimizer.zero_grad()
        loss = loss_of(weights)
        if float(loss.detach()) < least:
            best, least = weights.detach().numpy().copy(), float(loss.detach())
        loss.backward()
        optimizer.step()
        progress(epoch + 1, EPOCHS)
    return weights.detach().numpy().copy(), best


# The subnets, and rotations as unit quaternions (..., 4), scalar first.


def calibrated(weights: torch.Tensor, rate: torch.Tensor) -> torch.Tensor:
    """Rates (..., 3) by the calibration subnet of 27 weights."""
    W1, b1, slope, W2, b2 = weights.split([9, 3, 3, 9, 3])
    h = rate @ W1.reshape(3, 3).T + b1
    return rate + torch.where(h >= 0, h, slope * h) @ W2.reshape(3, 3).T + b2


def denoised(weights: torch.Tensor, rate: torch.Tensor) -> torch.Tensor:
    """Rates (S, N - 48, 3) by the denoising subnet of 3 x 56 weights, of unit gain, which needs 48 samples of history."""
    x, gain = rate.transpose(-1, -2), torch.ones(1, 3, 1, dtype=rate.dtype)
    shapes = SHAPES.values()
    for weight, shape, dilation in zip(weights.split([math.prod(shape[1:]) for shape in shapes], -1), shapes, DILATIONS, strict=True):
        taps = weight.reshape(-1, *shape[2:])
        x = torch.nn.functional.conv1d(x, taps, dilation=dilation, groups=3)
        gain = torch.nn.functional.conv1d(gain, taps.sum(-1, keepdim=True), groups=3)
    return (x / gain).transpose(-1, -2)


def _residuals(batch: Batch, rate: torch.Tensor, steps: Callable) -> torch.Tensor:
    """``tinygc.closure.residual.residual`` (S, d) of calibrated rates (S, T, 3)."""
    earth, dt, begin, end = (torch.as_tensor(array) for array in (batch.earth, batch.dt, batch.start, batch.end))
    turns = steps(rate - earth, dt[..., None])
    while turns.shape[1] > 1:
        if turns.shape[1] % 2:
            turns = torch.cat([turns, torch.tensor([1.0, 0, 0, 0]).to(turns).expand(len(turns), 1, 4)], 1)
        turns = _multiply(turns[:, ::2], turns[:, 1::2])
    w, x, y, z = _multiply(_multiply(begin, turns[:, 0]), end * torch.tensor([1.0, -1, -1, -1]).to(end)).unbind(-1)
    if batch.yaw_known:
        vector, c = torch.stack([x, y, z], -1) * torch.where(w < 0, -1.0, 1.0)[:, None], w.abs()
    else:
        c = (w**2 + z**2 + 1e-300).sqrt()
        vector = torch.stack([w * x - z * y, w * y + z * x], -1) / c[:, None]
    return vector * (2 / (1 + c)).sqrt()[:, None]


def _first_order(rate: torch.Tensor, dt: torch.Tensor) -> torch.Tensor:
    """The paper's steps: the quaternion [1, mean rate dt / 2], renormalised."""
    half = (rate[:, :-1] + rate[:, 1:]) * dt / 4
    q = torch.cat([torch.ones_like(half[..., :1]), half], -1)
    return q / q.norm(dim=-1, keepdim=True)


def _exact(rate: torch.Tensor, dt: torch.Tensor) -> torch.Tensor:
    """The exponential of the mean rate, with the coning term."""
    before, after = rate[:, :-1], rate[:, 1:]
    vector = (before + after) * dt / 2 + torch.linalg.cross(before, after) * dt**2 / 6
    half = (vector / 2).norm(dim=-1, keepdim=True)
    return torch.cat([half.cos(), torch.sinc(half / math.pi) * vector / 2], -1)


def _multiply(p: torch.Tensor, q: torch.Tensor) -> torch.Tensor:
    """Hamilton product (..., 4): first q, then p."""
    (pw, px, py, pz), (qw, qx, qy, qz) = p.unbind(-1), q.unbind(-1)
    w, x = pw * qw - px * qx - py * qy - pz * qz, pw * qx + px * qw + py * qz - pz * qy
    y, z = pw * qy - px * qz + py * qw + pz * qx, pw * qz + px * qy - py * qx + pz * qw
    return torch.stack([w, x, y, z], -1)
