"""Train the calibration subnet on the endpoint loss."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from session.base import rotation
from session.base.errors import FitError
from session.base.numeric import rms_of
from session.base.progress import Steps, no_report
from tinygc.closure import residual
from tinygc.closure.least_squares import LinearEnds, Rows, fit_least_squares, vague
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch
from tinygc.estimation.held_out import FitInput, held_out
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.models.linear import PARAMETERS, LinearModel, bias_only
from tinygc.models.nets import TIES, CalibrationNet

# Train the calibration subnet on the endpoint loss by the second order: least squares finds the linear solution, and
# Levenberg-Marquardt goes from there along a path of weaker and weaker ties to it (prior sigmas).  The net's Jacobian is contracted with
# the closure's linear sensitivity, so one step costs about one pass over the samples.  The
# solution with the least leave-one-segment-out error on that path is kept, so that 27 parameters do not fit the noise that 12 do not.  A
# tie whose first, linear step predicts no improvement is skipped.

#: standard errors by which a looser tie must lower the left-out error to be accepted
BELIEF = 3.0
#: the improvement, in standard errors, that the first step from the linear solution must predict for a tie to be tried: what chance gives
PROMISE = 1.0
MAX_STEPS = 25
#: in units of chi-square: a step with a smaller gain is not significant; nor does it decide on a tie, for which it takes tens
ENOUGH, DECIDES = 1e-3, 0.1
#: predicted gain below which a step is not made, since rounding hides it in a sum of thousands
PROMISED = 1e-8


@dataclass(frozen=True, eq=False)
class Training:
    """The result of a training: net; selected tie (0: linear)."""

    net: CalibrationNet
    tie: float


def train_second_order(
    batch: Batch,
    sigma: np.ndarray,
    *,
    ties: tuple[float, ...] = TIES,
    begin: LinearModel | None = None,
    ends: Rows | None = None,
    progress: Steps = no_report,
) -> Training:
    """Train from the linear solution by Levenberg-Marquardt; sigma (S,) rad per angle.

    begin: a linear model near the solution, where its search begins; ends: these segments' error angles under it, and their columns under
    the net that it is, where they are known.  Raises FitError where the residuals are not finite, or there is no linear solution.
    """
    problem = _Problem(batch, sigma)
    rungs = CalibrationNet.identity().rungs(problem.typical_rps, ties)
    progress(1, len(rungs))
    near: LinearModel | Rows | None = begin
    if begin is not None and ends is not None:
        near = Rows(begin.vector, ends.angles, ends.columns[..., -PARAMETERS:])
    identity = bias_only()
    fit = fit_least_squares(batch, sigma, identity, begin=near, prior=vague(identity.vector))
    vector = CalibrationNet.from_linear(fit.model).vector
    J = problem.jacobian(vector, problem.sensitivity(vector)) if ends is None else problem.weighed(ends.columns)
    linear = _Linear(problem, vector, problem.rows(fit.rows.angles), J)
    tie = 0.0
    unbent = lowest = linear.left_out(rungs[0][1])
    best, r = (vector, linear.r, rungs[0][1]), linear.r
    for number, (looser, prior) in enumerate(rungs[1:], 1):
        progress(number + 1, len(rungs))
        if _less(linear.left_out(prior), unbent, PROMISE):
            vector, r, left_out = problem.settle(vector, r, prior, DECIDES)
            if _less(left_out, lowest, BELIEF):  # a looser tie must be significantly better
                best, tie, lowest = (vector, r, prior), looser, left_out
    if tie:
        vector, *_ = problem.settle(*best, ENOUGH)
    return Training(CalibrationNet.from_vector(vector if tie else best[0]), tie)


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
    ):
        self.batch = batch
        self.parts = [batch.pick(some) for some in residual.parts(len(batch))]
        self.weight = 1 / sigma.reshape(len(batch), -1)
        self.typical_rps = rms_of(batch.rate[..., :3])
        self.identity = CalibrationNet.identity().vector

    def residuals(self, vector: np.ndarray) -> np.ndarray:
        net = CalibrationNet.from_vector(vector)
        turn = np.concatenate([residual.turned(part, net(part.rate)) for part in self.parts])
        return self.rows(2 * residual.batch_residual(self.batch, rotation.multiply(self.batch.start, turn), turn))

    def rows(self, angles: np.ndarray) -> np.ndarray:
        """Return rows (n,) in sigmas from error angles (S, d) rad."""
        r = (angles * self.weight).ravel()
        if not np.isfinite(r).all():
            raise FitError("training left the finite numbers; are the rates in the log in the unit of its header?")
        return r

    def jacobian(self, vector: np.ndarray, sensitivity: np.ndarray) -> np.ndarray:
        net = CalibrationNet.from_vector(vector)
        of_parts = [net.columns(sensitivity[some], self.batch.rate[some]) for some in residual.parts(len(self.batch))]
        return self.weighed(np.concatenate(of_parts))

    def weighed(self, columns: np.ndarray) -> np.ndarray:
        """Return rows (n, P) in sigmas from columns (S, d, P) rad."""
        return (columns * self.weight[..., None]).reshape(-1, columns.shape[-1])

    def sensitivity(self, vector: np.ndarray) -> np.ndarray:
        net, (segments, samples), d = CalibrationNet.from_vector(vector), self.batch.rate.shape[:2], self.batch.angles
        found = np.empty((segments, d, 3, samples))  # contiguous along the samples, for sums over them
        for some, part in zip(residual.parts(segments), self.parts, strict=True):
            found[some] = residual.sensitivity(part, net(part.rate))[:, :, :d].transpose(0, 2, 3, 1)
        return found.transpose(0, 3, 1, 2)

    def settle(self, vector: np.ndarray, r: np.ndarray, prior: np.ndarray, enough: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Minimise with one prior sigma (P,) from weights whose rows are r (n,), until a step gains less than ``enough`` of chi-square;
        return the weights, their rows, and the left-out squared errors (S,)."""
        damping = 1e-6
        pull = (vector - self.identity) / prior
        cost = r @ r + pull @ pull
        turn = self.sensitivity(vector)
        for _ in range(MAX_STEPS):
            scaled = self.jacobian(vector, turn) * prior
            normal = scaled.T @ scaled + np.eye(len(vector))
            gradient = scaled.T @ r + pull
            if gradient @ np.linalg.solve(normal, gradient) < PROMISED:
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
            if gain < enough:
                break
        return vector, r, self.left_out(r, scaled, normal)

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


# The method ``tinygc``: the calibration subnet of TinyGC-Net, trained on the endpoint loss.


def run(problem: Problem, options: FitOptions, progress: Steps, before: dict[str, MethodFit]) -> MethodFit:
    """Fit 27 parameters.  Raises FitError where the loss is not finite."""
    return held_out("tinygc", partial(_fit, _Begins(before.get("least_squares"))), problem, options, progress)


class _Begins:
    """The start of a search: the linear solution of all segments, also for each fold, and its error angles and columns, which are computed
    once for the fit to all and for all folds."""

    def __init__(self, linear: MethodFit | None):
        self.model = None if linear is None else linear.linear
        self.ends: LinearEnds | None = None

    def of(self, seen: FitInput) -> dict[str, Any]:
        """Return ``begin`` and ``ends`` of a training; empty where it begins at the identity."""
        if self.model is None:
            return {}
        if seen.whole is None and seen.batch.turns is None:
            net = CalibrationNet.from_linear(self.model)
            self.ends = LinearEnds.of(net, seen.batch, net.columns)
        among = np.ones(len(seen.batch), dtype=bool) if seen.whole is None else seen.among
        if self.ends is None or among is None:
            return {"begin": self.model}
        return {"begin": self.model, "ends": self.ends.rows(seen.batch, among)}


def _fit(begins: _Begins, seen: FitInput) -> tuple[CalibrationNet, dict]:
    trained = train_second_order(seen.batch, seen.sigma, progress=seen.progress, **begins.of(seen))
    return trained.net, {}
