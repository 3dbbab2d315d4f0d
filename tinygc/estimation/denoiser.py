"""The method ``tinygc_denoised``: the calibration as ``tinygc`` found it, frozen, and the denoising subnet behind it."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial

import numpy as np

from tinygc import closure
from tinygc.closure.problem import Problem
from tinygc.estimation.denoiser_training import Material, of_problem, train_denoiser, train_smoothing
from tinygc.estimation.held_out import run_method, tell
from tinygc.estimation.options import FitOptions, MethodFit, Progress
from tinygc.models.denoiser import DenoisedNet


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """The calibration of ``tinygc``, fitted first where it is not among ``before``, and the denoiser behind it.

    Trained on all segments, then on all but each fold with that fold's calibration, which saw none of it either.  A fold's search begins
    at what smooths best; that has seen all rates, but no attitude.
    """
    calibrated = before.get("tinygc") or run_method("tinygc", problem, options, progress)
    material = of_problem(problem)
    how = replace(options.denoise, optimizer=options.optimizer, seed=options.seed)
    if not material.stills or problem.session.truths is not None:
        # A session that never rests shows no noise to learn from, and a vehicle's few stills not the noise of its flight.
        how = replace(how, loss="endpoint")
    steps = len(calibrated.fold_models) + 1
    began = time.perf_counter()
    trained = train_denoiser(
        material.enough(), calibrated.model, how, partial(tell, progress, 0, steps), options.checkpoint("denoiser_whole")
    )
    seconds = time.perf_counter() - began
    smooth = train_smoothing(material.enough(), calibrated.model, how)
    held_out = np.zeros_like(calibrated.held_out)
    fold = np.arange(len(problem.batch)) % len(calibrated.fold_models)
    for k, calibration in enumerate(calibrated.fold_models):
        told = partial(tell, progress, k + 1, steps)
        seen, checkpoint = material.pick(fold != k).enough(), options.checkpoint(f"denoiser_fold{k}")
        part = train_denoiser(seen, calibration, how, told, checkpoint, smooth)
        held_out[fold == k] = denoised_angles(material.pick(fold == k), part.model, options.integrator)
    notes = {"loss": list(trained.loss), "denoiser": figures(material, trained.model) | {"loss": how.loss}}
    angles = denoised_angles(material, trained.model, options.integrator)
    return MethodFit("tinygc_denoised", trained.model, angles, held_out, calibrated.seconds + seconds, notes)


def denoised_angles(material: Material, model: DenoisedNet, integrator: str = "exact") -> np.ndarray:
    """Error angles (S, d) rad that the whole net leaves, its delay allowed for."""
    return closure.error_angles(closure.segment_residuals(material.batch, material.rate(model), integrator))


def figures(material: Material, model: DenoisedNet) -> dict:
    """What a user must know: noise_reduction (3,), by how much the standard deviation in the stills falls (None where no
    still is as long as the window); delay_s; delay_samples."""
    before, after = [], []
    for still in material.stills:
        rate = model.calibration(still)
        filtered = model.denoiser.windowed(rate)
        if len(filtered) > 1:
            before.append(rate[model.denoiser.reach :] - rate.mean(axis=0))
            after.append(filtered - filtered.mean(axis=0))
    ratio = None
    if before:
        ratio = (np.concatenate(before).std(axis=0) / np.concatenate(after).std(axis=0)).tolist()
    return {"noise_reduction": ratio, "delay_s": model.delay_s, "delay_samples": model.delay_samples}
