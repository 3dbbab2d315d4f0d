"""What a person may set of a fit."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from tinygc.methods.checkpoint import NAME, Checkpoint
from tinygc.methods.denoise_options import DenoiseOptions
from tinygc.methods.registry import CHOSEN


@dataclass(frozen=True)
class FitOptions:
    """methods in the order of the report; folds of the held-out closure; seed of the swarm; still_rates as further data;
    integrator; optimizer, epochs and loss of the network ("distance": the paper's, not squared); earth: whether its rotation is taken
    off; exclude: numbers of segments to leave out; physics: ids of effects to fit as well, ("auto",) for what `explain` would name, None
    for none; denoise: of tinygc_denoised; variant of the calibration subnet; parts: segments that its training carries the attitude
    through; conditions that a further net is told; checkpoints: folder where AdamW leaves what it can go on from, and resume: whether
    it does; bias_per_log: each log has a bias of its own, and the median is kept."""

    methods: tuple[str, ...] = CHOSEN
    folds: int = 5
    seed: int = 0
    still_rates: bool = False
    integrator: str = "exact"
    optimizer: str = "second-order"
    epochs: int = 2000
    loss: str = "squared"
    earth: bool = True
    physics: tuple[str, ...] | None = None
    exclude: tuple[int, ...] = ()
    denoise: DenoiseOptions = field(default_factory=DenoiseOptions)
    variant: str = "paper"
    parts: int = 1
    conditions: tuple[str, ...] = ()
    checkpoints: Path | None = None
    resume: bool = False
    bias_per_log: bool = False

    def checkpoint(self, name: str) -> Checkpoint | None:
        """Of one training, or None."""
        if self.checkpoints is None or self.optimizer != "adamw":
            return None
        return Checkpoint(self.checkpoints / NAME.format(name), self.resume)
