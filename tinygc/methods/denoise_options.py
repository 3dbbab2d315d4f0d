"""What a person may set of the denoiser."""

from __future__ import annotations

from dataclasses import dataclass

LOSSES = ("endpoint", "still", "neighbours")


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
