"""The paper's optimiser: AdamW with a cosine decay, seeded and resumable."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from session.base.errors import FitError, FormatError
from session.base.progress import Steps, no_report
from session.base.records import write_whole
from session.base.results import Array, Keys, Text, read_required
from tinygc.estimation.options import Checkpoint, device

if TYPE_CHECKING:
    from torch import Tensor


# The paper's optimiser as one loop for both subnets: 2000 epochs of AdamW with a cosine decay, seeded by its start, resumable bit for bit.
#
# Only this module and its callers import torch.  A checkpoint is JSON: numbers, the losses so far, and a fingerprint of the data and
# settings, so that no run is resumed with others.  A fit consists of many trainings; the checkpoint of a finished one stays, so that
# a resumed fit repeats none.  Training runs on the device of its tensors.

SCHEMA = "tinygc-checkpoint/1"
EPOCHS = 2000
#: s between two checkpoints
EVERY_S = 5.0


def minimise(
    loss_of: Callable[[Tensor], Tensor],
    start: np.ndarray,
    *,
    learning_rate: float,
    identity: list,
    checkpoint: Checkpoint | None = None,
    progress: Steps = no_report,
) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Return the last weights, those of the least loss, and the loss before each epoch; identity: arrays and settings to be fingerprinted.

    Raises FitError where the loss is not finite, or where a checkpoint does not belong to this training.
    """
    import torch

    weights = torch.as_tensor(start, device=device()).clone().requires_grad_()
    optimizer = torch.optim.AdamW([weights], lr=learning_rate, weight_decay=0.0)
    digest = hashlib.sha256()
    for array in [start, np.array([EPOCHS, learning_rate]), *identity]:
        digest.update(np.ascontiguousarray(np.asarray(array)).tobytes())
    mark = digest.hexdigest()
    best, losses = start.copy(), []
    if checkpoint is not None and checkpoint.resume and checkpoint.path.exists():
        state = _read(checkpoint.path, mark, start.shape)
        losses, best = state["losses"], state["best"]
        moments = {name: torch.as_tensor(state[name], device=weights.device) for name in ("exp_avg", "exp_avg_sq")}
        optimizer.state[weights] = {"step": torch.tensor(float(len(losses))), **moments}
        with torch.no_grad():
            weights.copy_(torch.as_tensor(state["weights"]))
    whole: dict | None = None
    written = time.monotonic()
    try:
        for epoch in range(len(losses), EPOCHS):
            optimizer.param_groups[0]["lr"] = learning_rate * (1 + math.cos(math.pi * epoch / EPOCHS)) / 2
            optimizer.zero_grad()
            loss = loss_of(weights)
            if not torch.isfinite(loss):
                raise FitError("training left the finite numbers; are the rates in the log in the unit of its header?")
            value = float(loss.detach())
            if not losses or value < min(losses):
                best = _array(weights)
            loss.backward()
            optimizer.step()
            losses.append(value)
            if checkpoint is not None:
                whole = _state(mark, weights, best, losses, optimizer.state[weights])
                if time.monotonic() - written > EVERY_S:
                    _write(checkpoint.path, whole)
                    written = time.monotonic()
            progress(epoch + 1, EPOCHS)
    except KeyboardInterrupt:
        if checkpoint is not None and whole is not None:
            _write(checkpoint.path, whole)
        raise
    if checkpoint is not None and whole is not None:
        _write(checkpoint.path, whole)
    return _array(weights), best, losses


def _array(tensor: Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy().copy()


def _state(mark: str, weights: Tensor, best: np.ndarray, losses: list[float], adam: dict) -> dict:
    """Return the state after an epoch; it is converted to lists only when it is written."""
    moments = {name: _array(adam[name]) for name in ("exp_avg", "exp_avg_sq")}
    return {"schema": SCHEMA, "of": mark, "losses": list(losses), "weights": _array(weights), "best": best, **moments}


def _write(path: Path, state: dict) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, state)


def _read(path: Path, mark: str, shape: tuple[int, ...]) -> dict:
    arrays = {name: Array(shape) for name in ("weights", "best", "exp_avg", "exp_avg_sq")}
    wanted = Keys({"schema": Text((SCHEMA,)), "of": Text(), "losses": Array((None,)), **arrays})
    try:
        table = read_required(path, wanted, "remove it, or train without resume")
    except FormatError as error:
        raise FitError(str(error)) from None
    if table.get("of") != mark:
        raise FitError(f"{path}: a checkpoint of other data or settings; remove it, or train without resume")
    return {"losses": [float(value) for value in table["losses"]], **{name: np.asarray(table[name], dtype=float) for name in arrays}}
