"""The paper's Table 1: absolute orientation error (AOE) over the five test sequences of EuRoC, integrated from the first true attitude.

All fits see the 243 training windows of 2 s, and of those only the raw gyro and the attitudes at their ends.  Nothing is chosen by what it
does on the test sequences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from common import markdown
from public.euroc import true_bias_rps
from scipy.optimize import minimize

from paper.adamw_runs import adamw_run
from paper.euroc import EUROC, TEST, Euroc
from session.io.units import DEG
from tinygc.closure.least_squares import fit_least_squares
from tinygc.estimation.bias_of_day import from_gravity, from_start
from tinygc.estimation.denoiser import of_problem, train_denoiser
from tinygc.estimation.network import fit_distance, train_second_order
from tinygc.estimation.options import DenoiseOptions
from tinygc.models.linear import LinearModel, bias_only
from tinygc.models.nets import PublishedNet

HEADER = ("", "par.", "test inputs", *TEST, "mean")
PUBLISHED = (
    ("paper, calibrated", 27, "gyro", (6.36, 5.32, 7.12, 3.64, 4.95)),
    ("paper, denoised", 195, "gyro", (4.60, 4.16, 6.27, 2.23, 5.03)),
    ("DIG", 77052, "gyro, accelerometer", (1.39, 1.40, 1.13, 2.70, 3.85)),
)
ORACLE_EVALUATIONS = 120


def table1(euroc: Euroc, progress: Callable[[str], None] = lambda what: None, *, epochs: int = 2000) -> str:
    """Markdown: the table, and what its footnotes rest on."""
    batch, sigma = euroc.training.batch, euroc.training.floor.sigma
    rows = []

    def row(title: str, parameters: int, inputs: str, model) -> None:
        progress(title)
        errors = euroc.errors_deg(model)
        rows.append((title, parameters, inputs, *(f"{error:.2f}" for error in errors), f"{errors.mean():.2f}"))

    row("raw", 0, "gyro", bias_only())
    squared = train_second_order(batch, sigma).net
    row("least squares, squared loss", 12, "gyro", fit_least_squares(batch, sigma, euroc.training.first).model)
    row("TinyGC-Net, squared loss", 27, "gyro", squared)
    by_adamw = f"… by AdamW, {epochs} epochs"
    row(by_adamw, 27, "gyro", adamw_run(euroc, "27", "squared", epochs).net)
    row("authors' variant, squared loss", 26, "gyro", train_second_order(batch, sigma, start=PublishedNet.identity()).net)
    row(by_adamw, 26, "gyro", adamw_run(euroc, "26", "squared", epochs).net)
    row(
        f"authors' variant and training: the paper's loss, AdamW, {epochs} epochs",
        26,
        "gyro",
        adamw_run(euroc, "26", "distance", epochs).net,
    )
    row("TinyGC-Net, the paper's loss, AdamW", 27, "gyro", adamw_run(euroc, "27", "distance", epochs).net)
    distance = fit_distance(batch, sigma, lambda part, weights: train_second_order(part, weights, ties=(0.0, 1.0)).net)
    row("**TinyGC-Net, the paper's loss, second order**", 27, "gyro", distance)
    # The losses that reward smoothing take motion for slow beside the noise; a rotor's shaking is neither.  The endpoint is the paper's.
    denoised = train_denoiser(of_problem(euroc.training), distance, DenoiseOptions(loss="endpoint")).model
    row("**… and denoised**", 195, "gyro", denoised)
    rows += [
        (f"*{title}*", n, inputs, *(f"{e:.2f}" for e in errors), f"{np.mean(errors):.2f}") for title, n, inputs, errors in PUBLISHED[:2]
    ]

    days = train_second_order(euroc.days.batch, euroc.days.sigma).net
    row("one bias a sequence in training: its median kept", 27, "gyro", days)
    starts = {name: days.with_bias_moved(from_start(problem, days)[0]) for name, problem in euroc.tests.items()}
    row("… bias of the day: first rest", 27, "gyro, accelerometer", starts)
    gravity = {
        name: days.with_bias_moved(from_gravity(problem, days, euroc.days.sigma_rps).change) for name, problem in euroc.tests.items()
    }
    row("**… bias of the day: gravity**", 27, "gyro, accelerometer", gravity)
    both = {name: replace(denoised, calibration=model) for name, model in gravity.items()}
    row("… and denoised", 195, "gyro, accelerometer", both)
    title, n, inputs, errors = PUBLISHED[2]
    rows.append((f"*{title}*", n, inputs, *(f"{e:.2f}" for e in errors), f"{np.mean(errors):.2f}"))
    row("… true bias of the day", 27, "gyro, its true bias", {name: true_bias(name, days) for name in euroc.tests})
    row("raw, true bias of the day", 0, "gyro, its true bias", {name: true_bias(name, bias_only()) for name in euroc.tests})

    progress("footnotes")
    return "\n\n".join([markdown(HEADER, rows), *_footnotes(euroc, distance, denoised)])


def true_bias(name: str, model):
    """An oracle: a model with the bias that a sequence's own ground truth states."""
    return model.with_bias_moved(-model(true_bias_rps(EUROC, name)))


def _footnotes(euroc: Euroc, distance, denoised) -> list[str]:
    every = euroc.with_mislabelled
    mislabelled = [
        train_second_order(every.batch, every.floor.sigma).net,
        fit_distance(every.batch, every.floor.sigma, lambda part, weights: train_second_order(part, weights, ties=(0.0,)).net),
    ]
    means = [euroc.errors_deg(net).mean() for net in mislabelled]
    moved = np.abs(euroc.errors_deg(denoised) - euroc.errors_deg(distance))
    oracle = best_constant(euroc, distance)
    return [
        f"With the 18 mislabelled windows, 261 in all: squared loss {means[0]:.2f}, the paper's loss {means[1]:.2f}.",
        f"The denoiser moves no AOE by more than {moved.max():.3f}°: its gain at a constant rate is 1, so it cannot move the bias, and "
        "what an open-loop attitude is wrong by after a minute is the bias. A causal filter for each axis that is *not* of gain 1 is a "
        "change of scale and bias; the common bias that suits these five sequences best, chosen by their own truth, gives "
        f"{oracle:.2f}.",
    ]


def best_constant(euroc: Euroc, model) -> float:
    """An oracle: the least mean AOE that one bias for all five test sequences can have, chosen on their truth."""
    linear = LinearModel(np.eye(3), np.zeros(3)) if model is None else model

    def cost(change_dps: np.ndarray) -> float:
        return float(euroc.errors_deg(linear.with_bias_moved(change_dps * DEG)).mean())

    simplex = np.vstack([np.zeros(3), 0.05 * np.eye(3)])
    options = {"maxfev": ORACLE_EVALUATIONS, "initial_simplex": simplex}
    return float(minimize(cost, np.zeros(3), method="Nelder-Mead", options=options).fun)
