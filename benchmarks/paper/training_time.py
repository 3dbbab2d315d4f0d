"""Training time of the 27 parameters on the 243 windows, one thread: second order against AdamW, to the same held-out loss.

The held-out loss is the paper's, mean distance of the end quaternions, on the 198 windows of the test sequences.  AdamW runs its 2000
epochs with the tree product; one epoch with a loop over the samples, as the published code integrates, is timed beside it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from common import markdown
from paper.euroc import Euroc

from tinygc import closure, rotation
from tinygc.closure import Batch
from tinygc.distance import mean_distance
from tinygc.integrate import steps
from tinygc.network import CalibrationNet
from tinygc.training import TIES, train_adamw, train_second_order

TIMED_EPOCHS = 3


@dataclass(frozen=True, eq=False)
class Curve:
    """Loss by epoch or step of one training, with the seconds it took; net; held_out loss of the net at its end."""

    title: str
    loss: np.ndarray
    seconds: float
    net: CalibrationNet
    held_out: float


def curves(euroc: Euroc, epochs: int = 2000) -> list[Curve]:
    """Second order, its linear part alone, AdamW: each from the identity."""
    import torch

    torch.set_num_threads(1)
    batch, sigma = euroc.training.batch, euroc.training.floor.sigma
    found = []
    for title, train in (
        ("second order", lambda: train_second_order(batch, sigma)),
        ("second order, to its linear solution", lambda: train_second_order(batch, sigma, ties=TIES[:1])),
        (f"AdamW, {epochs} epochs", lambda: train_adamw(batch, sigma, epochs=epochs)),
    ):
        began = time.perf_counter()
        trained = train()
        seconds = time.perf_counter() - began
        found.append(Curve(title, np.array(trained.loss), seconds, trained.net, mean_distance(euroc.held_out.batch, trained.net)))
    return found


def training_time(euroc: Euroc, epochs: int = 2000) -> str:
    """Markdown."""
    found = curves(euroc, epochs)
    loop = seconds_of_loop_epoch(euroc.training.batch, euroc.training.floor.sigma)
    rows = [(c.title, f"{c.seconds:.2f}", f"{c.held_out:.6f}", f"{epochs * loop / c.seconds:.0f}") for c in found]
    rows.append((f"AdamW, {epochs} epochs, sample by sample", f"{epochs * loop:.0f}", "as the line above", "1"))
    text = markdown(("one thread, 243 windows", "seconds", "held-out loss", "times faster than the last line"), rows)
    return f"{text}\n\nThe last line: {TIMED_EPOCHS} epochs were timed, {loop:.2f} s each, and the rest is that number times {epochs}."


def seconds_of_loop_epoch(batch: Batch, sigma: np.ndarray) -> float:
    """One epoch of AdamW with a product over the samples, one after the other, forward and back."""
    import torch

    weights = torch.as_tensor(CalibrationNet.identity().vector).requires_grad_()
    optimizer = torch.optim.AdamW([weights], lr=0.01, weight_decay=0.0)
    rate, dt, start, end = (torch.as_tensor(getattr(batch, name)) for name in ("rate", "dt", "start", "end"))
    earth, weight = torch.as_tensor(batch.earth), torch.as_tensor(2 / sigma)
    began = time.perf_counter()
    for _ in range(TIMED_EPOCHS):
        optimizer.zero_grad()
        each = steps(CalibrationNet.from_vector(weights)(rate) - earth, dt)
        q = start
        for k in range(each.shape[1]):
            q = rotation.multiply(q, each[:, k])
        loss = ((closure.residual(q, end, True) * weight) ** 2).mean()
        loss.backward()
        optimizer.step()
    return (time.perf_counter() - began) / TIMED_EPOCHS
