"""First order: the paper's AdamW at 0.01 on the whole batch, differentiating through the tree product.

The loss is the mean square of the residuals in sigmas, or, as the paper states it, a mean of distances: of segment i, its residual in
sigmas over sigma_i, which is what the reweighting of ``distance_loss.fit_distance`` settles at.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from tinygc.closure.residual import Batch
from tinygc.closure.still_rates import StillRates
from tinygc.methods.checkpoint import Checkpoint
from tinygc.methods.network.adamw_checkpoint import device, minimise
from tinygc.methods.network.training import TrainableNet, Training
from tinygc.models.calibration_net import CalibrationNet
from tinygc.problem import sequences

if TYPE_CHECKING:
    from torch import Tensor

#: in sigmas: below it a distance is as good as zero, and its gradient exists there
SHORTEST = 1e-3


def train_adamw(
    batch: Batch,
    sigma: np.ndarray,
    *,
    epochs: int = 2000,
    learning_rate: float = 0.01,
    loss: str = "squared",
    integrator: str = "exact",
    still_rates: StillRates | None = None,
    start: TrainableNet | None = None,
    before: np.ndarray | None = None,
    checkpoint: Checkpoint | None = None,
    progress: Callable[[int, int], None] = lambda step, steps: None,
) -> Training:
    """From ``start``, the identity of the kind of net that is wanted (the paper's), with a cosine decay so that it ends somewhere.

    before (S,): the part that each goes on from, as in ``train_second_order``; loss: "squared" or "distance".
    Raises FitError where the loss is not finite, or where a checkpoint that is to be resumed belongs to other data or settings.
    """
    import torch

    start = start or CalibrationNet.identity()
    where = device()
    before = np.full(len(batch), -1) if before is None else before
    spread_of_rows = sequences.carried_sigma(sigma.reshape(len(batch), -1), before, batch.turns is not None)
    weights_of_rows = 2 / spread_of_rows
    trust = 1 / np.sqrt((np.broadcast_to(spread_of_rows, (len(batch), batch.angles)) ** 2).mean(axis=1, where=batch.known))
    rate, weight, trust = (torch.as_tensor(array, device=where) for array in (batch.rate, weights_of_rows, trust / trust.mean()))
    settings = np.array(list((integrator + loss).encode()))
    identity = [before, batch.rate, batch.dt, batch.earth, batch.start, batch.end, sigma, settings]
    if still_rates is not None:
        still, earth, spread = (torch.as_tensor(array, device=where) for array in (still_rates.rate, still_rates.earth, still_rates.sigma))
        identity += [still_rates.rate, still_rates.earth, still_rates.sigma]

    def loss_of(weights: Tensor) -> Tensor:
        net = start.with_vector(weights)
        r = sequences.residuals(batch, net(rate), before, integrator) * weight
        total = (r**2).sum() if loss == "squared" else ((r**2).sum(-1) + SHORTEST**2).sqrt() @ trust * batch.angles
        if still_rates is None:
            return total / r.numel()
        rows = (net(still) - earth) / spread
        return (total + (rows**2).sum()) / (r.numel() + rows.numel())

    vector, _, losses = minimise(
        loss_of, start.vector, epochs=epochs, learning_rate=learning_rate, identity=identity, checkpoint=checkpoint, progress=progress
    )
    return Training(start.with_vector(vector), np.inf, tuple(losses))
