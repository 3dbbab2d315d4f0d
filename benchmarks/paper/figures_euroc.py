"""Figures 5 and 6 of the paper on EuRoC: how the loss falls in training, and how the orientation error grows over each test sequence."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from public.euroc import true_bias_rps

from paper.adamw_runs import adamw_run
from paper.euroc import EUROC, Euroc, euroc_folders, orientation_error, read_euroc
from session.io.units import DEG
from tinygc.estimation.bias_of_day import from_gravity
from tinygc.estimation.network import fit_distance, train_second_order

EPOCHS = 2000
EVERY = 20


@cache
def euroc() -> Euroc:
    """The recordings, read once."""
    with euroc_folders() as parent:
        return read_euroc(parent)


def figure5(folder: Path, epochs: int = EPOCHS) -> Figure:
    """Training loss by step or epoch: second order and AdamW, the paper's 27 parameters and the published 26."""
    batch, sigma = euroc().training.batch, euroc().training.floor.sigma
    figure = Figure(figsize=(7, 4), layout="constrained")
    axis = figure.subplots()
    for title, net in (("27 parameters", "27"), ("26, published", "26")):
        first = adamw_run(euroc(), net, epochs=epochs).loss
        axis.plot(np.arange(1, len(first) + 1), first, label=f"AdamW, {title}")
    linear = np.array(train_second_order(batch, sigma, ties=(0.0,)).loss)
    axis.plot(np.arange(1, len(linear) + 1), linear, "o-", label="second order, to the linear solution")
    loose = np.array(train_second_order(batch, sigma, ties=(0.0, 0.3, 3.0)).loss)
    axis.plot(np.arange(len(linear), len(loose) + 1), loose[len(linear) - 1 :], ".-", label="second order, bending ever more freely")
    axis.set(xscale="log", yscale="log", xlabel="epoch or step", ylabel="training loss, squared sigmas per angle")
    axis.set_title("243 windows of EuRoC: training loss")
    axis.legend()
    axis.grid(alpha=0.3)
    return figure


def figure6(folder: Path) -> Figure:
    """Orientation error over time, from the first true attitude, for each test sequence."""
    data = euroc()
    batch, sigma = data.training.batch, data.training.floor.sigma
    squared = train_second_order(batch, sigma).net
    distance = fit_distance(batch, sigma, lambda part, weights: train_second_order(part, weights, ties=(0.0,)).net)
    days = train_second_order(data.days.batch, data.days.sigma).net
    figure = Figure(figsize=(8, 11), layout="constrained")
    axes = figure.subplots(len(data.tests), 1, sharex=True)
    for axis, (name, problem) in zip(axes, data.tests.items(), strict=True):
        session = problem.session
        gravity = days.with_bias_moved(from_gravity(problem, days, data.days.sigma_rps).change)
        truth = days.with_bias_moved(-days(true_bias_rps(EUROC, name)))
        named = {
            "27 parameters, squared loss": squared,
            "27, the paper's loss": distance,
            "27, bias of the day from gravity": gravity,
            "27, true bias of the day": truth,
        }
        for title, model in named.items():
            t_s, error = orientation_error(session.logs[0].samples, session.truths[0], model)
            axis.plot(t_s[::EVERY], np.linalg.norm(error[::EVERY], axis=1) / DEG, label=title, linewidth=1.2)
        axis.set_title(name, loc="left", fontsize=9)
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8, ncols=2)
    figure.suptitle("Orientation error of the gyro alone, from the first true attitude")
    figure.supylabel("°")
    axes[-1].set_xlabel("s")
    return figure
