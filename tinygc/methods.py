"""The methods by name.  All minimise the same residual on the same segments, and all give a model: measured rates in, rates out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tinygc import closure
from tinygc.closure import Batch
from tinygc.denoising.denoiser import DenoisedNet
from tinygc.denoising.training import DenoiseOptions
from tinygc.least_squares import fit_least_squares
from tinygc.linear import LinearModel, bias_only
from tinygc.network.published import PublishedNet
from tinygc.network.subnet import CalibrationNet
from tinygc.parts import consecutive, previous
from tinygc.problem import Problem
from tinygc.still_rates import StillRates

Model = LinearModel | CalibrationNet | PublishedNet | DenoisedNet
Progress = Callable[[int, int], None]
METHODS = ("raw", "raw_bias_removed", "least_squares", "pso", "tinygc", "tinygc_denoised")
PARAMETERS = {"raw": 0, "raw_bias_removed": 3, "least_squares": 12, "pso": 12}
LOSSES = ("squared", "distance")


@dataclass(frozen=True)
class FitOptions:
    """methods in the order of the report; folds of the held-out closure; seed of the swarm; still_rates as further data;
    integrator; optimizer, epochs and loss of the network ("distance": the paper's, not squared); earth: whether its rotation is taken
    off; exclude: numbers of segments to leave out; physics: ids of effects to fit as well, ("auto",) for what `explain` would name, None
    for none; denoise: of tinygc_denoised; variant of the calibration subnet; parts: segments that its training carries the attitude
    through; conditions that a further net is told; checkpoints: folder where AdamW leaves what it can go on from, and resume: whether
    it does; bias_per_log: each log has a bias of its own, and the median is kept."""

    methods: tuple[str, ...] = METHODS
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

    def checkpoint(self, name: str):
        """Of one training, or None."""
        if self.checkpoints is None or self.optimizer != "adamw":
            return None
        from tinygc.network.adamw import NAME, Checkpoint

        return Checkpoint(self.checkpoints / NAME.format(name), self.resume)


@dataclass(frozen=True, eq=False)
class MethodFit:
    """One method's model; angles (S, d) rad it leaves on the segments it was fitted to, and held_out (S, d) on those it never saw;
    seconds that the fit to all segments took; parts: the model of each fold."""

    name: str
    model: Model
    angles: np.ndarray
    held_out: np.ndarray
    seconds: float
    notes: dict = field(default_factory=dict)
    parts: tuple[Model, ...] = ()

    @property
    def parameters(self) -> int:
        if self.name == "tinygc":
            return len(self.model.vector)
        return PARAMETERS.get(self.name) or getattr(self.model, "parameters", 0)


def run_method(
    name: str,
    problem: Problem,
    options: FitOptions,
    progress: Progress = lambda done, of: None,
    before: dict[str, MethodFit] | None = None,
) -> MethodFit:
    """Fit to all segments, then to all but each fold in turn; ``before``: what was fitted already, of use to what builds upon it."""
    if name == "tinygc_denoised":
        from tinygc.denoising.method import run_denoised

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


def closure_angles(batch: Batch, model: Model, integrator: str = "exact") -> np.ndarray:
    """Error angles (S, d) rad that a model leaves."""
    return closure.error_angles(closure.segment_residuals(batch, model(batch.rate), integrator))


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
        from tinygc.pso import fit_pso

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
        from tinygc.network.training_adamw import train_adamw

        checkpoint = options.checkpoint(f"tinygc_{label}")
        trained = train_adamw(batch, sigma, epochs=options.epochs, loss=options.loss, checkpoint=checkpoint, **how)
    else:
        from tinygc.network.training import train_second_order

        if options.loss == "distance":
            from tinygc.distance import distance_sigma, train_distance

            # The weights settle at the linear solution; whether it should bend is asked once, with those.
            settled = train_distance(batch, sigma, **{name: value for name, value in how.items() if name != "progress"})
            sigma = distance_sigma(batch, sigma, settled, before)
        trained = train_second_order(batch, sigma, **how)
    return trained.net, {"optimizer": options.optimizer, "tie": trained.tie, "loss": list(trained.loss)}
