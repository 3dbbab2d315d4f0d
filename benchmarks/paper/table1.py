"""The paper's Table 1: absolute orientation error (AOE) over the five test sequences of EuRoC, integrated from the first true attitude.

All fits see the 243 training windows of 2 s, and of those only the raw gyro and the attitudes at their ends.  Nothing is chosen by what it
does on the test sequences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import markdown
from public.euroc import true_bias_rps
from scipy.optimize import minimize

from paper.as_in_paper import kept, trained_denoiser, trained_net
from paper.euroc import EUROC, Euroc
from session.base.units import DEG
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.problem import Problem
from tinygc.fitting.bias_of_day import from_gravity
from tinygc.methods.denoiser import of_problem, train_denoiser
from tinygc.methods.network import train_second_order
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.linear import bias_only
from tinygc.models.nets import CalibrationNet

HEADER = ("", "parameters", "MH_02", "MH_04", "V1_01", "V1_03", "V2_02", "mean")
PUBLISHED = (
    ("*paper, calibrated*", 27, (6.36, 5.32, 7.12, 3.64, 4.95)),
    ("*paper, denoised*", 195, (4.60, 4.16, 6.27, 2.23, 5.03)),
    ("*DIG*", 77052, (1.39, 1.40, 1.13, 2.70, 3.85)),
)
ORACLE_EVALUATIONS = 120


#: the training as in the paper takes minutes: it is kept
RUNS = Path(__file__).resolve().parents[2] / "build" / "paper"


def table1(euroc: Euroc, progress: Callable[[str], None]) -> str:
    """Markdown: the table, and what its footnotes rest on."""
    batch, sigma = euroc.training.batch, euroc.training.floor.sigma
    rows = []

    def row(title: str, parameters: int, model=None, published=()) -> None:
        progress(title)
        errors = published or euroc.errors_deg(model)
        rows.append((title, parameters, *(f"{error:.2f}" for error in errors), f"{np.mean(errors):.2f}"))

    def advanced(epoch: int, of: int) -> None:
        progress(f"as in the paper, epoch {epoch}")

    row("raw", 0, bias_only())
    squared, material = train_second_order(batch, sigma).net, of_problem(euroc.training)
    denoised = train_denoiser(material, squared, "endpoint")
    row("least squares", 12, fit_least_squares(batch, sigma, euroc.training.first).model)
    row("TinyGC-Net", 27, squared)
    row("… and denoised", 195, denoised)
    as_in_paper = CalibrationNet.from_vector(kept(RUNS / "calibration.npy", lambda: trained_net(batch, sigma, advanced).vector))
    row("TinyGC-Net, trained as in the paper", 27, as_in_paper)
    as_trained = kept(RUNS / "denoiser.npy", lambda: trained_denoiser(material, as_in_paper, progress=advanced).denoiser.vector)
    row("… and denoised", 195, DenoisedNet(as_in_paper, Denoiser.from_vector(as_trained), material.rate_hz))
    for title, n, errors in PUBLISHED[:2]:
        row(title, n, published=errors)
    days = train_second_order(euroc.days.batch, euroc.days.sigma).net
    row("one bias a sequence: median kept", 27, days)
    starts = {name: days.with_bias_moved(first_rest(problem, days)) for name, problem in euroc.tests.items()}
    row("… bias of the day: first rest", 27, starts)
    gravity = {
        name: days.with_bias_moved(from_gravity(problem, days, euroc.days.sigma_rps).change) for name, problem in euroc.tests.items()
    }
    row("**… bias of the day: gravity**", 27, gravity)
    both = {name: replace(denoised, calibration=model) for name, model in gravity.items()}
    row("… and denoised", 195, both)
    row(*PUBLISHED[2][:2], published=PUBLISHED[2][2])
    row("… true bias of the day (a bound)", 27, {name: true_bias(name, days) for name in euroc.tests})

    progress("footnotes")
    every, moved = euroc.with_mislabelled, np.abs(euroc.errors_deg(denoised) - euroc.errors_deg(squared)).max()
    mislabelled = euroc.errors_deg(train_second_order(every.batch, every.floor.sigma).net).mean()
    said = [
        f"With the 18 mislabelled windows, 261 in all, TinyGC-Net has {mislabelled:.2f}.",
        f"The denoiser moves no AOE by more than {moved:.3f}°.",
        f"The common bias that suits these five sequences best, chosen by their own truth, gives {best_constant(euroc, squared):.2f}.",
    ]
    means = [(*row[:2], row[-1]) for row in rows]
    return "\n\n".join([markdown(["", "parameters", "mean"], means), markdown(HEADER, rows), *said])


def first_rest(problem: Problem, model) -> np.ndarray:
    """The change (3,) rad/s that makes the rate of a sequence's first rest that of the Earth, or zero where it is not known."""
    if len(problem.still_rates.rate):
        return problem.still_rates.earth[0] - model(problem.still_rates.rate[0])
    (_, rate), *_ = (rest for log in problem.logs for rest in problem.session.reference.rests(log.samples))
    return -model(rate)


def true_bias(name: str, model):
    """An oracle: a model with the bias that a sequence's own ground truth states."""
    return model.with_bias_moved(-model(true_bias_rps(EUROC, name)))


def best_constant(euroc: Euroc, model) -> float:
    """An oracle: the least mean AOE that one bias for all five test sequences can have, chosen on their truth."""

    def cost(change_dps: np.ndarray) -> float:
        return float(euroc.errors_deg(model.with_bias_moved(change_dps * DEG)).mean())

    simplex = np.vstack([np.zeros(3), 0.05 * np.eye(3)])
    options = {"maxfev": ORACLE_EVALUATIONS, "initial_simplex": simplex}
    return float(minimize(cost, np.zeros(3), method="Nelder-Mead", options=options).fun)
