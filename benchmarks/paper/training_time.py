"""Training time of the 27 parameters on the 243 windows, one thread: second order against AdamW, to the same held-out loss.

The held-out loss is the paper's, mean distance of the end quaternions, on the 198 windows of the test sequences.  Each optimiser is shown
with the squared loss and with the paper's own; the aim is the held-out loss that 2000 epochs of AdamW reach on the paper's.  AdamW runs
with the tree product (its seconds may be of an earlier run, see adamw_runs); one epoch with a loop over the samples, as the published
code integrates, is timed beside the second order.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from common import markdown

from paper.adamw_runs import adamw_run
from paper.euroc import Euroc
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.attitude.rotation import steps
from tinygc.closure.residual import Batch
from tinygc.estimation.network import distance_pass, mean_distance, train_second_order
from tinygc.models.nets import TIES, CalibrationNet

TIMED_EPOCHS = 3
PASSES, SHOWN = 15, 5
#: of the tie to the linear solution, where the net may bend as AdamW's does
FREE = 1.0
#: losses that differ by less are the same
SAME = 1e-3


@dataclass(frozen=True, eq=False)
class Curve:
    """The CPU seconds that one training took, and the held-out loss of its net."""

    title: str
    seconds: float
    held_out: float


def second_order_curves(euroc: Euroc) -> list[Curve]:
    """Second order from the identity: as it comes, and on the paper's unsquared loss, a step to each reweighting."""
    batch, sigma = euroc.training.batch, euroc.training.floor.sigma
    began = time.process_time()
    net = train_second_order(batch, sigma).net
    found = [Curve("second order, squared loss, its choice of bend", time.process_time() - began, _held_out(euroc, net))]
    for tie, words in ((0.0, "linear"), (FREE, "free to bend, no proof asked for")):
        began = time.process_time()
        net = train_second_order(batch, sigma, ties=TIES[:1]).net
        seconds = time.process_time() - began
        if tie == 0:
            found.append(Curve("second order, squared loss, linear", seconds, _held_out(euroc, net)))
        for number in range(1, PASSES + 1):
            began = time.process_time()
            net = distance_pass(batch, sigma, net, tie=tie)
            seconds += time.process_time() - began  # what is only looked at is not timed
            if number % SHOWN == 0:
                found.append(Curve(f"second order, the paper's loss, {words}, {number} steps", seconds, _held_out(euroc, net)))
    return found


def _held_out(euroc: Euroc, net) -> float:
    return mean_distance(euroc.held_out.batch, net)


def training_time(euroc: Euroc, epochs: int = 2000) -> str:
    """Markdown."""
    import torch

    torch.set_num_threads(1)
    second = second_order_curves(euroc)
    loop = seconds_of_loop_epoch(euroc.training.batch, euroc.training.floor.sigma)
    adamw = []
    for loss, words in (("squared", "squared loss"), ("distance", "the paper's loss")):
        run = adamw_run(euroc, "27", loss, epochs)
        adamw.append(Curve(f"AdamW, {epochs} epochs, {words}, tree product", run.seconds, _held_out(euroc, run.net)))
    aim = adamw[-1].held_out
    rows = [(c.title, f"{c.seconds:.2f}", f"{c.held_out:.6f}", f"{epochs * loop / c.seconds:.0f}") for c in [*second, *adamw]]
    rows.append((f"AdamW, {epochs} epochs, the paper's loss, sample by sample", f"{epochs * loop:.0f}", f"{aim:.6f}", "1"))
    text = markdown(("one thread, 243 windows", "CPU seconds", "held-out loss", "times faster than the last line"), rows)
    first = next((c for c in second if c.held_out <= aim * (1 + SAME)), None)
    nearest = min(second, key=lambda c: c.held_out)
    reached = (
        f"AdamW's held-out loss is not reached: {100 * (nearest.held_out / aim - 1):.2f} % above it after {nearest.seconds:.2f} s"
        if first is None
        else f"AdamW's held-out loss is reached, to {100 * (first.held_out / aim - 1):+.2f} %, after {first.seconds:.2f} s"
    )
    return f"{text}\n\n{reached}. The last line: {TIMED_EPOCHS} epochs were timed, {loop:.2f} s each, and the rest is that times {epochs}."


def seconds_of_loop_epoch(batch: Batch, sigma: np.ndarray) -> float:
    """One epoch of AdamW with a product over the samples, one after the other, forward and back."""
    import torch

    weights = torch.as_tensor(CalibrationNet.identity().vector).requires_grad_()
    optimizer = torch.optim.AdamW([weights], lr=0.01, weight_decay=0.0)
    rate, dt, start, end = (torch.as_tensor(getattr(batch, name)) for name in ("rate", "dt", "start", "end"))
    earth, weight = torch.as_tensor(batch.earth), torch.as_tensor(2 / sigma)
    began = time.process_time()
    for _ in range(TIMED_EPOCHS):
        optimizer.zero_grad()
        each = steps(CalibrationNet.from_vector(weights)(rate) - earth, dt)
        q = start
        for k in range(each.shape[1]):
            q = rotation.multiply(q, each[:, k])
        loss = ((closure.residual(q, end, True) * weight) ** 2).mean()
        loss.backward()
        optimizer.step()
    return (time.process_time() - began) / TIMED_EPOCHS
