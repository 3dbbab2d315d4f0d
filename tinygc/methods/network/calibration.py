"""The method ``tinygc``: the calibration subnet of TinyGC-Net, trained on the endpoint loss."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from tinygc.methods.held_out import MANY, Seen, held_out
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.network.training import Training, train_second_order
from tinygc.methods.options import FitOptions
from tinygc.methods.registry import Progress
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.linear import LinearModel
from tinygc.models.published_net import PublishedNet
from tinygc.problem.problem import Problem
from tinygc.problem.sequences import previous

#: how near to 1 the slopes are of a net that does not bend
STRAIGHT = 1e-6
VARIANTS: dict[str, type[CalibrationNet] | type[PublishedNet]] = {"paper": CalibrationNet, "published": PublishedNet}


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """27 parameters, or the 26 of the published code; by the second order or by AdamW.  Raises FitError where the loss is not finite."""
    return held_out("tinygc", partial(_fit, before.get("least_squares")), problem, options, progress)


def _fit(linear: MethodFit | None, seen: Seen) -> tuple[CalibrationNet | PublishedNet, dict]:
    options = seen.options
    how: dict[str, Any] = {
        "still_rates": seen.still_rates,
        "integrator": options.integrator,
        "start": VARIANTS[options.variant].identity(),
        "before": None if seen.order is None else previous(seen.order, options.parts),
    }
    trained = _by_adamw(seen, how) if options.optimizer == "adamw" else _by_second_order(linear, seen, how)
    assert isinstance(trained.net, CalibrationNet | PublishedNet)  # the kind that it began as
    tie = trained.tie if math.isfinite(trained.tie) else None  # AdamW is tied to nothing; JSON has no infinity
    return trained.net, {"optimizer": options.optimizer, "tie": tie, "loss": list(trained.loss)}


def _by_adamw(seen: Seen, how: dict[str, Any]) -> Training:
    from tinygc.methods.network.adamw_net import train_adamw

    options, checkpoint = seen.options, seen.options.checkpoint(f"tinygc_{seen.label}")
    how |= {"epochs": options.epochs, "loss": options.loss, "checkpoint": checkpoint, "progress": seen.progress}
    return train_adamw(seen.batch, seen.sigma, **how)


def _by_second_order(linear: MethodFit | None, seen: Seen, how: dict[str, Any]) -> Training:
    sigma = seen.sigma
    if seen.options.loss == "distance":
        from tinygc.methods.network.distance_loss import distance_sigma, train_distance

        # The weights settle at the linear solution; whether it should bend is asked once, with those.
        settled = train_distance(seen.batch, sigma, **how)
        sigma = distance_sigma(seen.batch, sigma, settled, how["before"])
    return train_second_order(seen.batch, sigma, **how, begin=_begin(linear, seen), progress=seen.progress)


def _begin(linear: MethodFit | None, seen: Seen) -> CalibrationNet | None:
    """Where the search of many segments may begin: at their linear solution, a fold at what all of them gave, from which it cannot be
    far; None: at the identity."""
    if len(seen.batch) <= MANY or seen.options.variant != "paper" or seen.order is not None:
        return None
    whole = seen.whole
    if whole is None:
        return CalibrationNet.from_linear(linear.model) if linear is not None and isinstance(linear.model, LinearModel) else None
    return whole if isinstance(whole, CalibrationNet) and np.abs(whole.slope - 1).max() < STRAIGHT else None
