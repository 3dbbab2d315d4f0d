"""Gauss-Newton on the linear sensitivity: 12 columns, no autograd, a covariance for every parameter.

Minimises sum_s |r_s|^2 / (sigma_s / 2)^2 plus a prior so weak that it only matters where the data say nothing: a fit must not
wander along a direction that no segment observes.  (r is half an angle, hence the half.)  Instead of it there may be what a lot of units
tells of this one (``tinygc/lot/prior.py``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from session.common.errors import FitError
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.residual import Batch
from tinygc.closure.still_rates import StillRates
from tinygc.lot.prior import Prior
from tinygc.models import linear
from tinygc.models.linear import PRIOR_SIGMA, LinearModel

#: a parameter whose sigma is not at least this much below its prior's was not observed
OBSERVED_BELOW = 0.1
MAX_STEPS = 50
#: of a parameter's prior: what is held
HELD = 1e-9
#: rad: a step that changes no residual by more than this ends the search
TOLERANCE = 1e-9
#: rad: after a step that changes none by more than this the columns stay: they are wrong by this share, and so is the next step, which is
#: as small.  What they shift the answer by is this share of a sigma (tests/test_least_squares.py)
COLUMNS_STAY = 1e-5


@dataclass(frozen=True, eq=False)
class Rows:
    """Error angles (S, d) rad that a model with this vector (P,) leaves on each segment, and their columns (S, d, P)."""

    vector: np.ndarray
    angles: np.ndarray
    columns: np.ndarray

    def pick(self, which: np.ndarray) -> Rows:
        """Of some of the segments, by index or mask."""
        return Rows(self.vector, self.angles[which], self.columns[which])


@dataclass(frozen=True, eq=False)
class Ends:
    """What a model with this vector (P,), the 12 of a linear one or a net's, makes of the segments of a batch: end (S, 4) q_tb, and how
    each parameter turns it, columns (S, 3, P) rad about the table's axes."""

    vector: np.ndarray
    end: np.ndarray
    columns: np.ndarray
    batch: Batch

    @classmethod
    def of(cls, model: Any, batch: Batch, columns_of: Callable[[np.ndarray, np.ndarray], np.ndarray] = linear.columns) -> Ends:
        """Of a model, by the exact integrator; columns_of sensitivity (S, T, 3, 3) and measured rates (S, T, 3): its columns (S, 3, P)."""
        batch = replace(batch, turns=None)
        end, columns = np.empty((len(batch), 4)), np.empty((len(batch), 3, len(model.vector)))
        for some in closure.parts(len(batch)):
            part = batch.pick(some)
            end[some], sensitivity = closure.end_and_sensitivity(part, model(part.rate))
            columns[some] = columns_of(sensitivity, part.rate)
        return cls(model.vector, end, columns, batch)

    def rows(self, batch: Batch, which: np.ndarray) -> Rows:
        """Of the segments which (S,) bool, between the references of another batch of them: the same rates turn the body as much."""
        turn = rotation.multiply(batch.start, rotation.conjugate(self.batch.start[which]))
        angles = 2 * closure.batch_residual(batch, rotation.multiply(turn, self.end[which]))
        return Rows(self.vector, angles, (rotation.matrix(turn) @ self.columns[which])[:, : batch.angles])


@dataclass(frozen=True, eq=False)
class LeastSquaresFit:
    """model; covariance (12, 12) in the units of ``LinearModel.vector``; unobserved: names of the parameters no segment sees; rows:
    where the last step began, which is the answer to within ``TOLERANCE``; with ``rest_rps``, about that bias."""

    model: LinearModel
    covariance: np.ndarray
    unobserved: tuple[str, ...]
    steps: int
    rows: Rows


def fit_least_squares(
    batch: Batch,
    sigma: np.ndarray,
    start: LinearModel,
    *,
    still_rates: StillRates | None = None,
    integrator: str = "exact",
    rest_rps: np.ndarray | None = None,
    begin: LinearModel | Rows | None = None,
    prior: Prior | None = None,
) -> LeastSquaresFit:
    """Fit the 12 parameters to a batch with sigma (S,) rad of each segment, or (S, d) of each angle, from a start.

    rest_rps (3,): the bias as it is measured at rest, where it is known: then E alone is fitted, and B = -E rest_rps.
    begin: a model near the answer, or ``rows`` of these segments from a fit to more of them, where the search then begins; the prior stays
    around ``start``, or is the one that is given.

    Raises FitError where the search does not settle (residuals that are not finite, or no segments).
    The covariance returned is that of independent residuals with these sigmas; ``uncertainty.parameter_covariance`` refines it.
    """
    if len(batch) == 0:
        raise FitError("no segments to fit; see the reasons for which they were rejected")
    if rest_rps is not None:
        batch, start = replace(batch, rate=batch.rate - rest_rps), replace(start, B=np.zeros(3))
        if isinstance(begin, LinearModel):
            begin = replace(begin, B=np.zeros(3))
    centre, root = _prior(start, prior, held=rest_rps is not None)
    at = begin if isinstance(begin, Rows) else _rows(batch, (begin or start).vector, integrator, None)
    vector, weight = at.vector, 1 / sigma.reshape(len(batch), -1)
    rank = linear.PARAMETERS
    for steps in range(1, MAX_STEPS + 1):  # noqa: B007 (reported)
        angles, design = at.angles, at.columns
        if not np.isfinite(angles).all():
            raise FitError("least squares left the finite numbers; are the rates in the log in the unit that its header says?")
        rows = [(design * weight[..., None]).reshape(-1, linear.PARAMETERS)]
        values = [(angles * weight).ravel()]
        if still_rates is not None:
            rows.append(still_rates.columns())
            values.append(still_rates.residuals(LinearModel.from_vector(vector)))
        jacobian, r = np.concatenate(rows) @ root, np.concatenate(values)
        left, strength, right = np.linalg.svd(jacobian, full_matrices=False)
        # What noise alone lets a direction seem to do is no observation: it stays at the prior instead of fitting that noise.
        rank = min(rank, int(np.sum(strength**2 > OBSERVED_BELOW**-2 - 1))) if prior is None else len(strength)
        aim = left.T @ (jacobian @ np.linalg.solve(root, vector - centre) - r) * strength / (strength**2 + 1)
        change = centre + root @ (aim[:rank] @ right[:rank]) - vector
        vector = vector + change
        moved = float(np.abs(design @ change).max())
        if moved < TOLERANCE:
            break
        at = _rows(batch, vector, integrator, design if moved < COLUMNS_STAY else None)
    else:
        raise FitError(f"least squares did not settle in {MAX_STEPS} steps; look at `calibrate.py check` for what is wrong with the data")
    covariance = root @ np.linalg.inv(jacobian.T @ jacobian + np.eye(linear.PARAMETERS)) @ root.T
    seen = np.sqrt(np.diag(covariance)) < OBSERVED_BELOW * PRIOR_SIGMA
    if rest_rps is not None:
        seen[linear.BIAS] = True
        model = LinearModel.from_vector(vector)
        vector = replace(model, B=-model.E @ rest_rps).vector
    unobserved = tuple(name for name, ok in zip(linear.NAMES, seen, strict=True) if not ok)
    return LeastSquaresFit(LinearModel.from_vector(vector), covariance, unobserved, steps, at)


def _prior(start: LinearModel, prior: Prior | None, held: bool) -> tuple[np.ndarray, np.ndarray]:
    """Centre (12,) and a root (12, 12) of the covariance; held: the bias is known."""
    centre, root = (start.vector, np.diag(PRIOR_SIGMA)) if prior is None else (prior.centre.copy(), prior.root)
    if held:
        root = np.diag(PRIOR_SIGMA * HELD)
        root[linear.MATRIX, linear.MATRIX] = (
            np.diag(PRIOR_SIGMA[linear.MATRIX])
            if prior is None
            else np.linalg.cholesky((prior.covariance / prior.weight)[linear.MATRIX, linear.MATRIX])
        )
        centre[linear.BIAS] = 0.0
    return centre, root


def _rows(batch: Batch, vector: np.ndarray, integrator: str, columns: np.ndarray | None) -> Rows:
    """Of a linear model; columns: those of one so near that they are the same."""
    model = LinearModel.from_vector(vector)
    angles = np.empty((len(batch), batch.angles))
    design = np.empty((len(batch), batch.angles, linear.PARAMETERS)) if columns is None else columns
    for some in closure.parts(len(batch)):  # what is between them stays in the processor's cache
        part = batch.pick(some)
        rate = model(part.rate)
        if columns is not None:
            angles[some] = 2 * closure.segment_residuals(part, rate, integrator)
            continue
        end, sensitivity = closure.end_and_sensitivity(part, rate)
        if integrator != "exact":
            end = closure.end_attitude(part, rate, integrator)
        angles[some] = 2 * closure.batch_residual(part, end)
        design[some] = linear.columns(sensitivity, part.rate)[:, : batch.angles]
    return Rows(vector, angles, design)
