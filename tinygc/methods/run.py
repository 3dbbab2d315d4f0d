"""The methods by name.  All minimise the same residual on the same segments, and all give a model: measured rates in, rates out."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import Batch, closure_angles
from tinygc.closure.still_rates import StillRates
from tinygc.methods.method_fit import MethodFit, Model
from tinygc.methods.names import METHODS
from tinygc.methods.options import FitOptions
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.linear import bias_only
from tinygc.models.published_net import PublishedNet
from tinygc.problem.problem import Problem
from tinygc.problem.sequences import consecutive, previous

Progress = Callable[[int, int], None]


def run_method(
    name: str,
    problem: Problem,
    options: FitOptions,
    progress: Progress = lambda done, of: None,
    before: dict[str, MethodFit] | None = None,
) -> MethodFit:
    """Fit to all segments, then to all but each fold in turn; ``before``: what was fitted already, of use to what builds upon it."""
    if name == "tinygc_denoised":
        from tinygc.methods.denoising.run import run_denoised

        calibrated = (before or {}).get("tinygc") or run_method("tinygc", problem, options, progress)
        return run_denoised(problem, options, calibrated, progress)
    still_rates = problem.still_rates if options.still_rates else None
    batch, sigma = problem.batch, problem.floor.sigma
    folds = min(options.folds, len(batch))
    steps = folds + 1
    order = consecutive(problem.used) if options.parts > 1 else None
    # The swarm's windows are exact, and so it is judged.
    integrator = "exact" if name == "pso" else options.integrator
    began = time.perf_counter()
    model, notes = _fit(
        name, problem, batch, sigma, options, still_rates, None, lambda done, of: progress(done, of * steps), "whole", order
    )
    seconds = time.perf_counter() - began
    held_out, parts = np.zeros((len(batch), batch.angles)), []
    fold = np.arange(len(batch)) % folds
    for k in range(folds):
        seen = fold != k
        part, _ = _fit(
            name,
            problem,
            batch.pick(seen),
            sigma[seen],
            options,
            still_rates,
            model,
            lambda done, of, k=k: progress((k + 1) * of + done, of * steps),
            f"fold{k}",
            None if order is None else order[seen],
        )
        parts.append(part)
        held_out[~seen] = closure_angles(batch.pick(~seen), part, integrator)
    progress(steps, steps)
    return MethodFit(name, model, closure_angles(batch, model, integrator), held_out, seconds, notes, tuple(parts))


def _fit(
    name: str,
    problem: Problem,
    batch: Batch,
    sigma: np.ndarray,
    options: FitOptions,
    still_rates: StillRates | None,
    whole: Model | None,
    progress: Progress,
    label: str,
    order: np.ndarray | None,
) -> tuple[Model, dict]:
    """``whole`` is the fit to all segments when this is one of the folds; label names the checkpoint; order (S,) as of ``parts``."""
    # A session with a truth file may never rest: then the bias that closes it stands for the first still's.
    start = bias_only(problem.still_rates.rate[0] if len(problem.still_rates.rate) else -problem.first.B)
    if name == "raw":
        return bias_only(), {}
    if name == "raw_bias_removed":
        return start, {}
    if name == "least_squares":
        fit = fit_least_squares(batch, sigma, start, still_rates=still_rates, integrator=options.integrator)
        return fit.model, {"steps": fit.steps, "unobserved": list(fit.unobserved)}
    if name == "pso":
        from tinygc.methods.pso import fit_pso

        # A fold's optimum is near the whole's: its swarm starts in a twentieth of the box, around it, and still converges by itself.
        around, box = (start, 1.0) if whole is None else (whole, 0.05)
        return fit_pso(batch, sigma, around, seed=options.seed, still_rates=still_rates, box=box, progress=progress), {}
    if name == "tinygc":
        return _train(batch, sigma, options, still_rates, progress, label, None if order is None else previous(order, options.parts))
    raise ValueError(f"method is {name!r}, expected one of {', '.join(METHODS)}")


def _train(
    batch, sigma, options: FitOptions, still_rates, progress: Progress, label: str, before
) -> tuple[CalibrationNet | PublishedNet, dict]:
    how = {
        "still_rates": still_rates,
        "integrator": options.integrator,
        "start": (PublishedNet if options.variant == "published" else CalibrationNet).identity(),
        "before": before,
        "progress": progress,
    }
    if options.optimizer == "adamw":
        from tinygc.methods.network.adamw_training import train_adamw

        checkpoint = options.checkpoint(f"tinygc_{label}")
        trained = train_adamw(batch, sigma, epochs=options.epochs, loss=options.loss, checkpoint=checkpoint, **how)
    else:
        from tinygc.methods.network.training import train_second_order

        if options.loss == "distance":
            from tinygc.methods.network.distance_loss import distance_sigma, train_distance

            # The weights settle at the linear solution; whether it should bend is asked once, with those.
            settled = train_distance(batch, sigma, **{name: value for name, value in how.items() if name != "progress"})
            sigma = distance_sigma(batch, sigma, settled, before)
        trained = train_second_order(batch, sigma, **how)
    return trained.net, {"optimizer": options.optimizer, "tie": trained.tie, "loss": list(trained.loss)}
