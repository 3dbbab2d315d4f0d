"""Where the training of the denoiser begins, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.models.denoiser import PARAMETERS, DenoisedNet, Denoiser


@dataclass(frozen=True, eq=False)
class DenoiserTraining:
    """model whole; loss after each step or epoch."""

    model: DenoisedNet
    loss: tuple[float, ...]


def start(seed: int, slope: float = 1.0) -> Denoiser:
    """The identity, with a second channel that is ready to learn: nothing reads it yet."""
    noise = Denoiser.from_vector(0.1 * np.random.default_rng(seed).standard_normal((3, PARAMETERS // 3)))
    net = Denoiser.identity(slope)
    net.conv1[:, 1], net.conv2[:, 1] = noise.conv1[:, 1], noise.conv2[:, 1]
    return net
