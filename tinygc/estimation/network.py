"""Train the calibration subnet on the endpoint loss, or on the paper's loss of distances."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from session.io.errors import FitError
from tinygc import closure
from tinygc.closure.least_squares import LinearEnds, Rows, StillRates
from tinygc.closure.problem import Problem, carried, carried_sigma, previous, residuals, residuals_of_turns
from tinygc.closure.residual import Batch, RateMap
from tinygc.estimation.adamw import device, minimise
from tinygc.estimation.held_out import MANY, FitInput, held_out
from tinygc.estimation.options import Checkpoint, FitOptions, MethodFit, Progress
from tinygc.models.linear import LinearModel
from tinygc.models.nets import TIES, CalibrationNet, PublishedNet

if TYPE_CHECKING:
    from torch import Tensor


# Train the calibration subnet on the endpoint loss: one net, one residual, in NumPy or in PyTorch.
#
# Second order (the default): Levenberg-Marquardt.  The net's Jacobian is contracted with the closure's linear sensitivity, so one step
# costs about one epoch.  It leads from the identity to the linear solution, and from there along a path of weaker and weaker ties to it
# (prior sigmas).  The solution with the least leave-one-segment-out error on that path is kept, so that 27 parameters do not fit the
# noise that 12 do not.  A tie whose first, linear step predicts no improvement is skipped.
#
# First order: the paper's AdamW at 0.01 in PyTorch (``adamw.py``), differentiating through the tree product.  Only that imports
# torch, which takes seconds; the second order needs no autograd.

#: standard errors by which a looser tie must lower the left-out error to be accepted
BELIEF = 3.0
#: the improvement that the first step from the linear solution must predict for a tie to be tried (benchmarks/ties.py)
PROMISE = 1.0
MAX_STEPS = 25
#: in units of chi-square: a step with a smaller gain is not significant
ENOUGH = 1e-3
#: predicted gain below which a step is not made, since rounding hides it in a sum of thousands
PROMISED = 1e-8


class TrainableNet(Protocol):
    """The interface that training requires of a net."""

    @property
    def vector(self) -> Any:
        """The weights (P,)."""

    def with_vector(self, vector: Any) -> TrainableNet:
        """Return the same kind of net with other weights (P,)."""

    def rungs(self, typical_rps: float, ties: tuple[float, ...]) -> list[tuple[float, np.ndarray]]:
        """Return pairs of a tie and the prior sigma (P,) of the weights around the identity, from the linear model to a free one."""

    def __call__(self, rate: Any, /) -> Any:
        """Return the calibrated rate (..., 3) rad/s from the inputs (..., 3 + K), the measured rate first."""

    def columns(self, sensitivity: np.ndarray, rate: np.ndarray, /) -> np.ndarray:
        """Return the derivative (S, d, P) of the end attitude by each weight, from sensitivity (S, T, d, 3) and inputs (S, T, 3 + K)."""


@dataclass(frozen=True, eq=False)
class Training:
    """The result of a training: net; selected tie (0: linear); loss after each step or epoch, the mean squared residual in sigmas."""

    net: TrainableNet
    tie: float
    loss: tuple[float, ...]


def train_second_order(
    batch: Batch,
    sigma: np.ndarray,
    *,
    still_rates: StillRates | None = None,
    ties: tuple[float, ...] = TIES,
    integrator: str = "exact",
    start: TrainableNet | None = None,
    begin: TrainableNet | None = None,
    begins: Rows | None = None,
    steps: int = MAX_STEPS,
    before: np.ndarray | None = None,
    progress: Callable[[int, int], None] = lambda step, steps: None,
) -> Training:
    """Train by Levenberg-Marquardt from ``start``, the identity of the desired kind of net (the paper's); sigma (S,) rad per angle.

    begin: a net of that kind near the solution, where the search begins with a constant Jacobian; the ties still refer to the identity;
    begins: its error angles and columns on these segments, where they are known and each segment stands by itself;
    steps: at most so many with each tie; before (S,): the part that each continues; None where each segment stands by itself.
    Raises FitError where the residuals are not finite.
    """
    problem = _Problem(batch, sigma, still_rates, integrator, start or CalibrationNet.identity(), before)
    vector, losses = problem.identity if begin is None else begin.vector, []
    chosen: tuple[np.ndarray, float] | None = None
    lowest = unbent = np.empty(0)
    rungs = problem.start.rungs(problem.typical_rps, ties)
    linear: _Linear | None = None
    near: np.ndarray | None = None
    r: np.ndarray | None = None
    if begins is not None:
        r, near = problem.rows(vector, begins.angles), problem.weighed(vector, begins.columns)
    elif begin is not None:
        near = problem.jacobian(vector, problem.sensitivity(vector))
    for number, (tie, prior) in enumerate(rungs):
        progress(number + 1, len(rungs))
        if linear is not None and not _less(linear.left_out(prior), unbent, PROMISE):
            continue
        vector, r, left_out, trace = problem.settle(vector, prior, steps, *((near, r) if number == 0 else ()))
        losses += trace
        # The first is the linear solution; a looser tie must be significantly better.
        if chosen is None or _less(left_out, lowest, BELIEF):
            chosen, lowest = (vector, tie), left_out
        if linear is None:
            linear, unbent = problem.linear(vector, r, near), left_out
    assert chosen is not None  # there is at least the linear rung
    return Training(problem.net(chosen[0]), chosen[1], tuple(losses))


def _less(trial: np.ndarray, best: np.ndarray, sigmas: float) -> bool:
    """Whether squared errors (S,) of the same segments are smaller by so many standard errors of the paired differences."""
    gain = best - trial
    return bool(gain.mean() > sigmas * gain.std(ddof=1) / np.sqrt(len(gain)))


class _Problem:
    """The residuals of the net as rows in sigmas, with their Jacobian."""

    def __init__(
        self,
        batch: Batch,
        sigma: np.ndarray,
        still_rates: StillRates | None,
        integrator: str,
        start: TrainableNet,
        before: np.ndarray | None,
    ):
        self.integrator, self.start = integrator, start
        self.before = np.full(len(batch), -1) if before is None else before
        self.batch, self.still_rates = batch, still_rates
        self.parts = [batch.pick(some) for some in closure.parts(len(batch))]
        self.weight = 1 / carried_sigma(sigma.reshape(len(batch), -1), self.before, batch.turns is not None)
        self.typical_rps = float(np.sqrt(np.mean(batch.rate[..., :3] ** 2)))
        self.identity = start.vector

    def net(self, vector: np.ndarray) -> TrainableNet:
        return self.start.with_vector(vector)

    def residuals(self, vector: np.ndarray) -> np.ndarray:
        net = self.net(vector)
        turns = [closure.turned(part, net(part.rate), self.integrator) for part in self.parts]
        return self.rows(vector, 2 * residuals_of_turns(self.batch, np.concatenate(turns), self.before))

    def rows(self, vector: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Return rows (n,) in sigmas from error angles (S, d) rad."""
        rows = [(angles * self.weight).ravel()]
        if self.still_rates is not None:
            rows.append(self.still_rates.residuals(self.net(vector)))
        r = np.concatenate(rows)
        if not np.isfinite(r).all():
            raise FitError("training left the finite numbers; are the rates in the log in the unit that its header says?")
        return r

    def jacobian(self, vector: np.ndarray, sensitivity: np.ndarray) -> np.ndarray:
        net = self.net(vector)
        of_parts = [net.columns(sensitivity[some], self.batch.rate[some]) for some in closure.parts(len(self.batch))]
        return self.weighed(vector, carried(np.concatenate(of_parts), self.before, self.batch.turns is not None))

    def weighed(self, vector: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return rows (n, P) in sigmas from columns (S, d, P) rad."""
        net = self.net(vector)
        rows = [(columns * self.weight[..., None]).reshape(-1, len(vector))]
        if self.still_rates is not None:
            each = np.eye(3)[None, None] / self.still_rates.sigma[:, None, :, None]
            rows.append(net.columns(each, self.still_rates.rate[:, None]).reshape(-1, len(vector)))
        return np.concatenate(rows)

    def sensitivity(self, vector: np.ndarray) -> np.ndarray:
        net, (segments, samples), d = self.net(vector), self.batch.rate.shape[:2], self.batch.angles
        found = np.empty((segments, d, 3, samples))  # contiguous along the samples, for sums over them
        for some, part in zip(closure.parts(segments), self.parts, strict=True):
            found[some] = closure.sensitivity(part, net(part.rate))[:, :, :d].transpose(0, 2, 3, 1)
        return found.transpose(0, 3, 1, 2)

    def settle(
        self, vector: np.ndarray, prior: np.ndarray, steps: int, near: np.ndarray | None = None, r: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[float]]:
        """Minimise with one prior sigma (P,); return the weights, their rows (n,), the left-out squared errors (S,), and the
        loss after each step.

        near: the Jacobian at the start, if that is so near the solution that it stays constant; r: the rows there, if they are known.
        """
        damping, losses = 1e-6, []
        r = self.residuals(vector) if r is None else r
        pull = (vector - self.identity) / prior
        cost = r @ r + pull @ pull
        turn = self.sensitivity(vector) if near is None else np.empty(0)
        for step in range(steps):
            if step == 1 and near is None:
                # The first step from the identity moves attitudes by degrees; later ones by hundredths.
                turn = self.sensitivity(vector)
            scaled = (self.jacobian(vector, turn) if near is None else near) * prior
            normal = scaled.T @ scaled + np.eye(len(vector))
            gradient = scaled.T @ r + pull
            if gradient @ np.linalg.solve(normal, gradient) < PROMISED:
                losses.append(float(r @ r / len(r)))
                break
            while True:
                trial_vector = vector - np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient) * prior
                trial = self.residuals(trial_vector)
                trial_pull = (trial_vector - self.identity) / prior
                trial_cost = trial @ trial + trial_pull @ trial_pull
                if trial_cost <= cost or damping > 1e3:
                    break
                damping *= 10
            gain = cost - trial_cost
            if gain > 0:
                vector, r, pull, cost, damping = trial_vector, trial, trial_pull, trial_cost, max(damping / 10, 1e-9)
            losses.append(float(r @ r / len(r)))
            if gain < ENOUGH:
                break
        return vector, r, self.left_out(r, scaled, normal), losses

    def linear(self, vector: np.ndarray, r: np.ndarray, near: np.ndarray | None = None) -> _Linear:
        """Linearise about these weights, whose rows are r (n,); near: the Jacobian, if it is known."""
        J = self.jacobian(vector, self.sensitivity(vector)) if near is None else near
        return _Linear(self, vector, r, J)

    def left_out(self, r: np.ndarray, scaled: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Return the squared residual (S,) of each segment when left out of the fit (PRESS; Allen 1974), in the linear approximation."""
        d, count = self.batch.angles, len(self.batch)
        rows = scaled[: d * count].reshape(count, d, -1)
        hat = rows @ np.linalg.solve(normal, rows.transpose(0, 2, 1))
        left_out = np.linalg.solve(np.eye(d) - np.minimum(hat, 1 - 1e-6), r[: d * count].reshape(count, d, 1))
        return np.sum(left_out[..., 0] ** 2, axis=-1)


@dataclass(frozen=True, eq=False)
class _Linear:
    """The rows (n,) at some weights (P,), and their Jacobian (n, P), for a first step from there with any prior."""

    problem: _Problem
    vector: np.ndarray
    r: np.ndarray
    J: np.ndarray

    def left_out(self, prior: np.ndarray) -> np.ndarray:
        """Return ``_Problem.left_out`` (S,) after that step; prior (P,)."""
        scaled = self.J * prior
        normal = scaled.T @ scaled + np.eye(len(prior))
        step = np.linalg.solve(normal, scaled.T @ self.r + (self.vector - self.problem.identity) / prior)
        return self.problem.left_out(self.r - scaled @ step, scaled, normal)


# The paper's loss: the mean distance of the end quaternions, not its square.
#
# A sum of distances is minimised by reweighted least squares (Weiszfeld 1937): each pass divides a segment's weight by the distance after
# the last one.  Outlying segments, or days, have less weight than in the squared loss, as in a median.

PASSES = 12
#: below this share of the median distance a segment's weight grows no further
LEAST = 0.05

#: the type of the fitted rate map
Map = TypeVar("Map", bound=RateMap)


def fit_distance(
    batch: Batch,
    sigma: np.ndarray,
    fit: Callable[[Batch, np.ndarray], Map],
    passes: int = PASSES,
) -> Map:
    """Return the model at which ``fit(batch, sigma)`` converges with weights by the distances; sigma (S, d) rad of each angle."""
    model = fit(batch, sigma)
    for _ in range(passes):
        model = fit(batch, distance_sigma(batch, sigma, model))
    return model


def train_distance(
    batch: Batch, sigma: np.ndarray, *, tie: float = 0.0, passes: int = PASSES, before: np.ndarray | None = None, **how: Any
) -> TrainableNet:
    """Train a net on distances by the second order, one step in each pass, from the squared loss's linear solution.

    tie: its freedom from the linear solution (0: linear), without model selection.  ``how``: as in ``train_second_order``.
    """
    net = train_second_order(batch, sigma, ties=(0.0,), before=before, **how).net
    for _ in range(passes):
        net = distance_pass(batch, sigma, net, tie=tie, before=before, **how)
    return net


def distance_pass(
    batch: Batch, sigma: np.ndarray, net: TrainableNet, *, tie: float = 0.0, before: np.ndarray | None = None, **how: Any
) -> TrainableNet:
    """Make one pass of ``train_distance``."""
    weights = distance_sigma(batch, sigma, net, before)
    return train_second_order(batch, weights, ties=(tie,), begin=net, steps=1, before=before, **how).net


def distance_sigma(batch: Batch, sigma: np.ndarray, model: RateMap, before: np.ndarray | None = None) -> np.ndarray:
    """Return sigmas (S,) or (S, d) with the factors of ``distance_weights``, (S, d) rad.  before (S,): the part that each continues."""
    return sigma.reshape(len(batch), -1) * distance_weights(batch, model, before)[:, None]


def distance_weights(batch: Batch, model: RateMap, before: np.ndarray | None = None) -> np.ndarray:
    """Return factors (S,) on the segments' sigmas that make a squared loss a sum of distances at the model."""
    before = np.full(len(batch), -1) if before is None else before
    distance = np.linalg.norm(residuals(batch, model(batch.rate), before), axis=1)
    typical = max(float(np.median(distance)), 1e-12)
    return np.sqrt(np.maximum(distance / typical, LEAST))


def mean_distance(batch: Batch, model: RateMap) -> float:
    """Return the paper's loss: the mean Euclidean distance of the end quaternions, the nearer of q and -q."""
    return float(np.mean(np.linalg.norm(closure.segment_residuals(batch, model(batch.rate)), axis=1)))


# The method ``tinygc``: the calibration subnet of TinyGC-Net, trained on the endpoint loss.

#: difference of the slopes from 1 below which a net is linear
STRAIGHT = 1e-6
VARIANTS: dict[str, type[CalibrationNet] | type[PublishedNet]] = {"paper": CalibrationNet, "published": PublishedNet}


# First order: the paper's AdamW at 0.01 on the whole batch, differentiating through the tree product.
#
# The loss is the mean square of the residuals in sigmas, or, as the paper states it, a mean of distances: of segment i, its residual in
# sigmas over sigma_i, which has the minimum of the reweighting in ``fit_distance``.

#: in sigmas: distances are smoothed below it, so that the gradient exists at zero
SHORTEST = 1e-3


def train_adamw(
    batch: Batch,
    sigma: np.ndarray,
    *,
    epochs: int = 2000,
    learning_rate: float = 0.01,
    loss: str = "squared",
    integrator: str = "exact",
    still_rates: StillRates | None = None,
    start: TrainableNet | None = None,
    before: np.ndarray | None = None,
    checkpoint: Checkpoint | None = None,
    progress: Callable[[int, int], None] = lambda step, steps: None,
) -> Training:
    """Train by AdamW from ``start``, the identity of the desired kind of net (the paper's), with a cosine decay.

    before (S,): the part that each continues, as in ``train_second_order``; loss: "squared" or "distance".
    Raises FitError where the loss is not finite, or where a checkpoint to resume belongs to other data or settings.
    """
    where = device()
    import torch

    start = start or CalibrationNet.identity()
    before = np.full(len(batch), -1) if before is None else before
    spread_of_rows = carried_sigma(sigma.reshape(len(batch), -1), before, batch.turns is not None)
    weights_of_rows = 2 / spread_of_rows
    trust = 1 / np.sqrt((np.broadcast_to(spread_of_rows, (len(batch), batch.angles)) ** 2).mean(axis=1, where=batch.known))
    rate, weight, trust = (torch.as_tensor(array, device=where) for array in (batch.rate, weights_of_rows, trust / trust.mean()))
    settings = np.array(list((integrator + loss).encode()))
    identity = [before, batch.rate, batch.dt, batch.earth, batch.start, batch.end, sigma, settings]
    if still_rates is not None:
        still, earth, spread = (torch.as_tensor(array, device=where) for array in (still_rates.rate, still_rates.earth, still_rates.sigma))
        identity += [still_rates.rate, still_rates.earth, still_rates.sigma]

    def loss_of(weights: Tensor) -> Tensor:
        net = start.with_vector(weights)
        r = residuals(batch, net(rate), before, integrator) * weight
        total = (r**2).sum() if loss == "squared" else ((r**2).sum(-1) + SHORTEST**2).sqrt() @ trust * batch.angles
        if still_rates is None:
            return total / r.numel()
        rows = (net(still) - earth) / spread
        return (total + (rows**2).sum()) / (r.numel() + rows.numel())

    vector, _, losses = minimise(
        loss_of, start.vector, epochs=epochs, learning_rate=learning_rate, identity=identity, checkpoint=checkpoint, progress=progress
    )
    return Training(start.with_vector(vector), np.inf, tuple(losses))


def run(problem: Problem, options: FitOptions, progress: Progress, before: dict[str, MethodFit]) -> MethodFit:
    """Fit 27 parameters, or the 26 of the published code, by the second order or AdamW.  Raises FitError where the loss is not finite."""
    return held_out("tinygc", partial(_fit, _Begins(before.get("least_squares"))), problem, options, progress)


class _Begins:
    """The start of a search over many segments: their linear solution, also for each fold, and its error angles and columns, which are
    computed once for the fit to all and for all folds."""

    def __init__(self, linear: MethodFit | None):
        self.linear = linear
        self.net: CalibrationNet | None = None
        self.ends: LinearEnds | None = None

    def of(self, seen: FitInput) -> dict[str, Any]:
        """Return ``begin`` and ``begins`` of a training; empty where it begins at the identity."""
        if len(seen.batch) <= MANY or seen.options.variant != "paper" or seen.order is not None:
            return {}
        if seen.whole is None:
            if self.linear is None or not isinstance(self.linear.model, LinearModel):
                return {}
            self.net = CalibrationNet.from_linear(self.linear.model)
            if seen.batch.turns is None and seen.options.integrator == "exact":
                self.ends = LinearEnds.of(self.net, seen.batch, self.net.columns)
        elif not isinstance(seen.whole, CalibrationNet) or np.abs(seen.whole.slope - 1).max() >= STRAIGHT:
            return {}
        if self.net is None or self.ends is None:
            return {"begin": seen.whole or self.net}
        among = np.ones(len(seen.batch), dtype=bool) if seen.among is None else seen.among
        return {"begin": self.net, "begins": self.ends.rows(seen.batch, among)}


def _fit(begins: _Begins, seen: FitInput) -> tuple[CalibrationNet | PublishedNet, dict]:
    options = seen.options
    how: dict[str, Any] = {
        "still_rates": seen.still_rates,
        "integrator": options.integrator,
        "start": VARIANTS[options.variant].identity(),
        "before": None if seen.order is None else previous(seen.order, options.parts),
    }
    trained = _by_adamw(seen, how) if options.optimizer == "adamw" else _by_second_order(begins, seen, how)
    assert isinstance(trained.net, CalibrationNet | PublishedNet)  # training keeps the type
    tie = trained.tie if math.isfinite(trained.tie) else None  # AdamW has no tie; JSON has no infinity
    return trained.net, {"optimizer": options.optimizer, "tie": tie, "loss": list(trained.loss)}


def _by_adamw(seen: FitInput, how: dict[str, Any]) -> Training:
    options, checkpoint = seen.options, seen.options.checkpoint(f"tinygc_{seen.label}")
    how |= {"epochs": options.epochs, "loss": options.loss, "checkpoint": checkpoint, "progress": seen.progress}
    return train_adamw(seen.batch, seen.sigma, **how)


def _by_second_order(begins: _Begins, seen: FitInput, how: dict[str, Any]) -> Training:
    sigma = seen.sigma
    if seen.options.loss == "distance":
        # The weights converge at the linear solution; the tie is then selected once, with those weights.
        settled = train_distance(seen.batch, sigma, **how)
        sigma = distance_sigma(seen.batch, sigma, settled, how["before"])
    return train_second_order(seen.batch, sigma, **how, **begins.of(seen), progress=seen.progress)
