"""The method ``tinygc``: the calibration subnet of TinyGC-Net, trained on the endpoint loss."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from tinygc.closure.least_squares import Ends
from tinygc.closure.problem import Problem, previous
from tinygc.estimation.held_out import MANY, Seen, held_out
from tinygc.estimation.network_training import Training, train_second_order
from tinygc.estimation.options import FitOptions, MethodFit, Progress
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet, PublishedNet

#: how near to 1 the slopes are of a net that does not bend
STRAIGHT = 1e-6
VARIANTS: dict[str, type[CalibrationNet] | type[PublishedNet]] = {"paper": CalibrationNet, "published": PublishedNet}


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """27 parameters, or the 26 of the published code; by the second order or by AdamW.  Raises FitError where the loss is not finite."""
    return held_out("tinygc", partial(_fit, _Begins(before.get("least_squares"))), problem, options, progress)


class _Begins:
    """Where the search of many segments may begin: at their linear solution, a fold where all of them began, from which it cannot be
    far; and what that leaves on the segments, which is looked at once for the fit to all and for all folds."""

    def __init__(self, linear: MethodFit | None):
        self.linear = linear
        self.net: CalibrationNet | None = None
        self.ends: Ends | None = None

    def of(self, seen: Seen) -> dict[str, Any]:
        """``begin`` and ``begins`` of a training; none where it is to begin at the identity."""
        if len(seen.batch) <= MANY or seen.options.variant != "paper" or seen.order is not None:
            return {}
        if seen.whole is None:
            if self.linear is None or not isinstance(self.linear.model, LinearModel):
                return {}
            self.net = CalibrationNet.from_linear(self.linear.model)
            if seen.batch.turns is None and seen.options.integrator == "exact":
                self.ends = Ends.of(self.net, seen.batch, self.net.columns)
        elif not isinstance(seen.whole, CalibrationNet) or np.abs(seen.whole.slope - 1).max() >= STRAIGHT:
            return {}
        if self.net is None or self.ends is None:
            return {"begin": seen.whole or self.net}
        among = np.ones(len(seen.batch), dtype=bool) if seen.among is None else seen.among
        return {"begin": self.net, "begins": self.ends.rows(seen.batch, among)}


def _fit(begins: _Begins, seen: Seen) -> tuple[CalibrationNet | PublishedNet, dict]:
    options = seen.options
    how: dict[str, Any] = {
        "still_rates": seen.still_rates,
        "integrator": options.integrator,
        "start": VARIANTS[options.variant].identity(),
        "before": None if seen.order is None else previous(seen.order, options.parts),
    }
    trained = _by_adamw(seen, how) if options.optimizer == "adamw" else _by_second_order(begins, seen, how)
    assert isinstance(trained.net, CalibrationNet | PublishedNet)  # the kind that it began as
    tie = trained.tie if math.isfinite(trained.tie) else None  # AdamW is tied to nothing; JSON has no infinity
    return trained.net, {"optimizer": options.optimizer, "tie": tie, "loss": list(trained.loss)}


def _by_adamw(seen: Seen, how: dict[str, Any]) -> Training:
    from tinygc.estimation.adamw import train_adamw

    options, checkpoint = seen.options, seen.options.checkpoint(f"tinygc_{seen.label}")
    how |= {"epochs": options.epochs, "loss": options.loss, "checkpoint": checkpoint, "progress": seen.progress}
    return train_adamw(seen.batch, seen.sigma, **how)


def _by_second_order(begins: _Begins, seen: Seen, how: dict[str, Any]) -> Training:
    sigma = seen.sigma
    if seen.options.loss == "distance":
        from tinygc.estimation.network_training import distance_sigma, train_distance

        # The weights settle at the linear solution; whether it should bend is asked once, with those.
        settled = train_distance(seen.batch, sigma, **how)
        sigma = distance_sigma(seen.batch, sigma, settled, how["before"])
    return train_second_order(seen.batch, sigma, **how, **begins.of(seen), progress=seen.progress)
