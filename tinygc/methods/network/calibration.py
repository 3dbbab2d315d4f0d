"""The method ``tinygc``: the calibration subnet of TinyGC-Net, trained on the endpoint loss."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tinygc.methods.held_out import Seen, held_out
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.network.training import Training, train_second_order
from tinygc.methods.options import FitOptions
from tinygc.methods.registry import Progress
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.published_net import PublishedNet
from tinygc.problem.problem import Problem
from tinygc.problem.sequences import previous

#: segments from which on a fold begins where the whole ended (benchmarks/long_sessions.py), where that does not bend
MANY, STRAIGHT = 400, 1e-6
VARIANTS: dict[str, type[CalibrationNet] | type[PublishedNet]] = {"paper": CalibrationNet, "published": PublishedNet}


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """27 parameters, or the 26 of the published code; by the second order or by AdamW.  Raises FitError where the loss is not finite."""
    return held_out("tinygc", _fit, problem, options, progress)


def _fit(seen: Seen) -> tuple[CalibrationNet | PublishedNet, dict]:
    options = seen.options
    how: dict[str, Any] = {
        "still_rates": seen.still_rates,
        "integrator": options.integrator,
        "start": VARIANTS[options.variant].identity(),
        "before": None if seen.order is None else previous(seen.order, options.parts),
    }
    trained = _by_adamw(seen, how) if options.optimizer == "adamw" else _by_second_order(seen, how)
    assert isinstance(trained.net, CalibrationNet | PublishedNet)  # the kind that it began as
    tie = trained.tie if math.isfinite(trained.tie) else None  # AdamW is tied to nothing; JSON has no infinity
    return trained.net, {"optimizer": options.optimizer, "tie": tie, "loss": list(trained.loss)}


def _by_adamw(seen: Seen, how: dict[str, Any]) -> Training:
    from tinygc.methods.network.adamw_net import train_adamw

    options, checkpoint = seen.options, seen.options.checkpoint(f"tinygc_{seen.label}")
    how |= {"epochs": options.epochs, "loss": options.loss, "checkpoint": checkpoint, "progress": seen.progress}
    return train_adamw(seen.batch, seen.sigma, **how)


def _by_second_order(seen: Seen, how: dict[str, Any]) -> Training:
    sigma = seen.sigma
    if seen.options.loss == "distance":
        from tinygc.methods.network.distance_loss import distance_sigma, train_distance

        # The weights settle at the linear solution; whether it should bend is asked once, with those.
        settled = train_distance(seen.batch, sigma, **how)
        sigma = distance_sigma(seen.batch, sigma, settled, how["before"])
    return train_second_order(seen.batch, sigma, **how, begin=_begin(seen), progress=seen.progress)


def _begin(seen: Seen) -> CalibrationNet | None:
    """Where a fold of many segments may begin: at what all of them gave, from which it cannot be far; None: at the identity."""
    whole = seen.whole
    if len(seen.batch) > MANY and isinstance(whole, CalibrationNet) and np.abs(whole.slope - 1).max() < STRAIGHT:
        return whole
    return None
