"""Prove: closure on segments that the refit never saw, before, after, and the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.detect.segments import Segment
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import closure_angles, sensitivity
from tinygc.explanation.noise.session_noise import known_whitener
from tinygc.explanation.twin.refit import Refit, prior_sigmas, refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.models import linear
from tinygc.problem.problem import Problem

#: ten-fold cross-validation, stratified in time (Kohavi 1995)
FOLDS = 10
#: Gauss-Newton from the whole fit, of which a fold lacks a tenth: iterations, not a bar
FOLD_STEPS = 3
#: times the floor's variance, below which a share of the excess is a share of noise: 80 angles know their variance to 16 %; three of that
LEAST_EXCESS = 0.5


@dataclass(frozen=True, eq=False)
class Proof:
    """Held-out error angles (S, d) rad: before with the linear model alone, after with what is named; floor_rms rad of tilt; changed:
    whether anything is mended or named between them.

    before and after may have different segments: what cannot be mended (clipped turns) is left out of after.  Both are numbered as
    before.
    """

    before: np.ndarray
    after: np.ndarray
    before_numbers: list[int]
    after_numbers: list[int]
    floor_rms: float
    changed: bool

    @property
    def removed(self) -> float | None:
        """Share of the excess over the floor that is gone; None where there was none to speak of, or nothing was changed.  What chance
        leaves below the floor is no more than all of it."""
        floor = self.floor_rms**2
        excess = tilt_rms(self.before) ** 2 - floor
        return None if excess < LEAST_EXCESS * floor or not self.changed else 1 - max(tilt_rms(self.after) ** 2 - floor, 0.0) / excess


def tilt_rms(angles: np.ndarray) -> float:
    """rad."""
    return float(np.sqrt(np.mean(np.sum(angles[:, :2] ** 2, axis=1))))


def prove(original: Problem, twin: Twin, whiten: Whitener, fit: Refit, before: np.ndarray | None = None) -> Proof:
    """Hold out every tenth segment, with the stills at its ends, in turn.  before (S, d) rad: of the linear model, where it is known."""
    changed = bool(fit.state.claims) or twin.problem is not original
    if changed and (before is None or twin.problem is not original):
        before = linear_held_out(original, twin, whiten)
    after = held_out(twin, whiten, fit)
    return Proof(
        before=before if changed and before is not None else after,
        after=after,
        before_numbers=[segment.number for segment in original.used],
        after_numbers=_numbers_before(original, twin),
        floor_rms=twin.problem.floor.tilt_rms,
        changed=changed,
    )


def _numbers_before(original: Problem, twin: Twin) -> list[int]:
    """Numbers that the twin's segments had before mending: a still that is none any more joins two turns, and shifts those behind it."""

    def middle(segment: Segment) -> float:
        return segment.start_s + segment.duration_s / 2

    numbers = []
    for segment in twin.segments:
        same_log = [other for other in original.segments if other.log == segment.log] or original.segments
        numbers.append(min(same_log, key=lambda other: abs(middle(other) - middle(segment))).number)
    return numbers


def linear_held_out(original: Problem, twin: Twin, whiten: Whitener) -> np.ndarray:
    """By the linear model: fitted to the ends alone, or to all that ``after`` is fitted to, whichever closes better; the rates of the
    stills make any fit better, and are not to be credited to what is named."""
    if twin.problem is not original:
        twin = Twin(original)
        whiten = known_whitener(twin)
    alike = held_out(twin, whiten, refit(twin, whiten, [], twin.start()))
    return min(_by_ends(original), alike, key=tilt_rms)


def _by_ends(problem: Problem) -> np.ndarray:
    """(S, d) rad: by the model of the other folds' ends, linear around that of all, from which a fold is not far."""
    batch, sigma = problem.batch, problem.floor.sigma
    model = fit_least_squares(batch, sigma, problem.first).model
    angles = closure_angles(batch, model)
    columns = linear.columns(sensitivity(batch, model(batch.rate)), batch.rate)[:, : batch.angles] * linear.PRIOR_SIGMA
    weighted, weight = columns / sigma.reshape(len(batch), -1, 1), 1 / sigma.reshape(len(batch), -1)
    normal = np.einsum("sai,saj->ij", weighted, weighted) + np.eye(linear.PARAMETERS)
    found = np.zeros_like(angles)
    for held in folds_of(len(batch)):
        own = weighted[held].reshape(-1, linear.PARAMETERS)
        # The whole fit stands where nothing pulls; without these rows it moves by what they pulled.
        moved = np.linalg.solve(normal - own.T @ own, own.T @ (angles[held] * weight[held]).ravel())
        found[held] = angles[held] + columns[held] @ moved
    return found


def held_out(twin: Twin, whiten: Whitener, fit: Refit) -> np.ndarray:
    """(S, d) rad of each segment, by the parameters that all rows but its fold's ask for."""
    prior = prior_sigmas(twin, [claim.effect for claim in fit.state.claims])
    return left_out(twin, whiten, fit.r, fit.J * prior)[whiten.parts["closure"]].reshape(-1, twin.batch.angles)


def left_out(twin: Twin, whiten: Whitener, r: np.ndarray, J: np.ndarray) -> np.ndarray:
    """(n,) stacked: every row as the parameters predict it that the rows of other folds ask for; a still's by the last of its folds.

    r (n,) and J (n, p) are whitened, at the fit of all rows, J in its priors' sigmas.  Leaving rows out is the same as giving each a free
    number of its own: d = P_kk^-1 P_k r, with P the precision of the residuals beside the columns; the parameters then move by what the
    rows no longer pull.  Linear around the whole fit, from which a fold is not far.
    """
    inverse = np.linalg.inv(J.T @ J + np.eye(J.shape[1]))
    stacked_J, stacked_r = whiten.back(J), whiten.back(r)
    pulled_J, pulled_r, gradient = whiten.pulled(J), whiten.pulled(r), J.T @ r
    found = np.full(len(r), np.nan)
    for held in folds_of(len(twin.segments)):
        rows = np.flatnonzero(~fold_rows(twin, whiten, held))
        across = pulled_J[rows]
        precision = whiten.precision[np.ix_(rows, rows)] - across @ inverse @ across.T
        taken = np.linalg.solve(precision, pulled_r[rows] - across @ (inverse @ gradient))
        # The whole fit stands where J' r is balanced by the priors, so only what the left-out rows pulled moves it.
        found[rows] = stacked_r[rows] + stacked_J[rows] @ (inverse @ (across.T @ taken))
    return found


def folds_of(count: int, folds: int = FOLDS) -> list[np.ndarray]:
    """Indices of the segments that are held out together: every so-many-th."""
    return [np.arange(k, count, folds) for k in range(min(folds, count))]


def fold_rows(twin: Twin, whiten: Whitener, held: np.ndarray) -> np.ndarray:
    """Rows (n,) bool of the channels that say nothing of the held-out segments: neither them nor the stills at their ends."""
    d = twin.batch.angles
    still = np.arange(whiten.parts["still"].start, whiten.parts["still"].stop).reshape(-1, 3)
    rows = np.ones(whiten.parts["length"].stop, dtype=bool)
    rows[(held[:, None] * d + np.arange(d)).ravel()] = False
    if twin.stills:
        ends = np.unique([twin.first[held], twin.last[held]])
        rows[still[ends].ravel()] = False
        rows[whiten.parts["length"].start + ends] = False
    return rows
