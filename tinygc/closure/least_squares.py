"""Gauss-Newton on the linear sensitivity of the closure: 12 columns and a covariance of all parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from session.base import rotation
from session.base.errors import FitError
from session.base.numeric import sigmas_in
from session.base.units import DEG
from session.detect.accelerometer import OBSERVED_BELOW
from session.detect.axes import CLOSES_WITHIN
from session.detect.segments import Segment
from tinygc.closure import residual
from tinygc.closure.residual import Batch, RateMap
from tinygc.models import linear
from tinygc.models.linear import BIAS, PARAMETERS, PRIOR_SIGMA, LinearModel

# A Gaussian prior of the gyroscope's linear model, and the use that a fit made of one.
#
# Least squares accepts any such prior; its origin, does not matter here.


@dataclass(frozen=True, eq=False)
class GaussianPrior:
    """Mean and covariance of the 12 parameters of ``LinearModel.vector`` before the session.

    centre (12,); covariance (12, 12); known (12,) bool: the parameters with prior knowledge; the others have wide sigmas, as without
    a prior.  weight: the ratio of the fit's noise variance to its floor's.  The fit weights its segments by the floor alone and divides
    the prior's covariance by this weight, so that the prior keeps its influence.
    """

    centre: np.ndarray
    covariance: np.ndarray
    known: np.ndarray
    weight: float = 1.0

    @property
    def root(self) -> np.ndarray:
        """(12, 12) lower triangular root of the covariance, as weighted by the fit."""
        return np.linalg.cholesky(self.covariance / self.weight)

    @property
    def information(self) -> np.ndarray:
        """(12, 12) inverse of the covariance, as weighted by the fit."""
        return np.linalg.inv(self.covariance / self.weight)

    def weighed(self, weight: float) -> GaussianPrior:
        """The prior with another weight."""
        return replace(self, weight=weight)

    def scaled(self, factor: float) -> GaussianPrior:
        """The prior with its covariance times a factor."""
        return replace(self, covariance=self.covariance * factor)


#: function from a first model's vector (12,), the centre of the parameters without prior knowledge, to the prior of a unit
PriorOf = Callable[[np.ndarray], GaussianPrior]


def vague(start: np.ndarray) -> GaussianPrior:
    """Prior of an unknown unit: wide sigmas about a start (12,).  A fit to a few turns needs it explicitly."""
    return GaussianPrior(start, np.diag(PRIOR_SIGMA**2), np.zeros(PARAMETERS, dtype=bool))


class PriorUse(Protocol):
    """How a fit used an external prior."""

    @property
    def used(self) -> str:
        """``yes``, ``no``, or ``partly`` if it is undecided whether the prior applies to this unit."""

    @property
    def source(self) -> str:
        """What the addition to the covariance is called."""

    @property
    def more(self) -> np.ndarray:
        """(12, 12) addition to the covariance of the fit, due to the prior or to doubt about it."""

    @property
    def words(self) -> str:
        """One line for the report."""

    def to_json(self) -> dict:
        """Keys of ``tinygc-fit/2`` of it."""

    def of_model(self) -> dict:
        """Keys of the file of the least-squares model of it."""


# The mean rates of the stills as data: a body at rest turns with the Earth, so E m + B = R_bt w_earth.


@dataclass(frozen=True, eq=False)
class StillRates:
    """Mean rates of Q stills.

    rate (Q, 3) measured, earth (Q, 3) the Earth's rate in body axes, sigma (Q, 3) of the mean, all rad/s; attitudes q_tb (Q, 4) and moments
    middle_s (Q,) s, for uncertainties.
    """

    rate: np.ndarray
    earth: np.ndarray
    sigma: np.ndarray
    q_tb: np.ndarray | None = None
    middle_s: np.ndarray | None = None

    def pick(self, which: np.ndarray) -> StillRates:
        """The rates of some stills (Q,) bool."""
        return replace(self, **{name: values[which] for name, values in vars(self).items() if values is not None})

    def residuals(self, model: RateMap) -> np.ndarray:
        """(3 Q,) residuals in sigmas."""
        return ((model(self.rate) - self.earth) / self.sigma).ravel()

    def columns(self) -> np.ndarray:
        """(3 Q, 12) Jacobian of the residuals of the linear model."""
        count = len(self.rate)
        design = np.zeros((count, 3, PARAMETERS))
        for axis in range(3):
            design[:, axis, 3 * axis : 3 * axis + 3] = self.rate
            design[:, axis, BIAS.start + axis] = 1.0
        return (design / self.sigma[..., None]).reshape(3 * count, PARAMETERS)


# Gauss-Newton on the linear sensitivity: 12 columns, no autograd, a covariance of all parameters.
#
# It minimises sum_s |r_s|^2 / (sigma_s / 2)^2 plus a weak prior, which matters only along directions that no segment observes.  (r is half
# an angle, hence the half.)  A ``GaussianPrior`` may replace the weak prior.

MAX_STEPS = 50
#: a direction that the segments determine no more than three times better than one that is not observed is hardly bound
WEAK = 3 / OBSERVED_BELOW
#: longer paths are mostly noise
MOST_TURNED_RAD = 4 * np.pi
#: segments in one line; a parameter has a share in a direction from half of the greatest on
MOST_NAMED, HALF = 3, 0.5
#: factor on the prior's sigma of a fixed parameter
HELD = 1e-9
#: rad: the search ends when a step changes no residual by more than this
TOLERANCE = 1e-9
#: rad: it ends, too, when the next step is foreseen to change none by more than this
FORESEEN = 1e-11
#: rad: the columns are kept after a step that changes no residual by more than this: their relative error, that of the next step, and the
#: shift of the answer in sigmas are all of this size (tests/test_least_squares_physics.py)
COLUMNS_STAY = 1e-5


@dataclass(frozen=True, eq=False)
class Rows:
    """Error angles (S, d) rad of the segments under a model with this vector (P,), and their Jacobian columns (S, d, P); ends: those that
    the columns are of, where they are known."""

    vector: np.ndarray
    angles: np.ndarray
    columns: np.ndarray
    ends: LinearEnds | None = None

    def pick(self, which: np.ndarray) -> Rows:
        """Select segments by index or mask."""
        return Rows(self.vector, self.angles[which], self.columns[which])


@dataclass(frozen=True, eq=False)
class LinearEnds:
    """Predicted ends of a batch's segments under a model with this vector (P,), linear or a net.

    end (S, 4) q_tb; columns (S, 3, P) rad: its rotation per parameter, about the table's axes.
    """

    vector: np.ndarray
    end: np.ndarray
    columns: np.ndarray
    batch: Batch

    @classmethod
    def of(cls, model: Any, batch: Batch, columns_of: Callable[[np.ndarray, np.ndarray], np.ndarray] = linear.columns) -> LinearEnds:
        """Compute the ends; columns_of(sensitivity (S, T, 3, 3), rates (S, T, 3)) gives columns (S, 3, P)."""
        batch = replace(batch, turns=None)
        end, columns = np.empty((len(batch), 4)), np.empty((len(batch), 3, len(model.vector)))
        for some in residual.parts(len(batch)):
            part = batch.pick(some)
            end[some], sensitivity = residual.end_and_sensitivity(part, model(part.rate))
            columns[some] = columns_of(sensitivity, part.rate)
        return cls(model.vector, end, columns, batch)

    def rows(self, batch: Batch, which: np.ndarray) -> Rows:
        """Rows of the segments ``which`` (S,) bool between the references of another batch: the body turns by the same angles."""
        turn = rotation.multiply(batch.start, rotation.conjugate(self.batch.start[which]))
        angles = 2 * residual.batch_residual(batch, rotation.multiply(turn, self.end[which]))
        return Rows(self.vector, angles, (rotation.matrix(turn) @ self.columns[which])[:, : batch.angles], self)


@dataclass(frozen=True, eq=False)
class LeastSquaresFit:
    """Result of a least-squares fit.

    model; covariance (12, 12) in the units of ``LinearModel.vector``; unobserved: names of the parameters that no segment observes; rows:
    at the start of the last step, behind which none is foreseen that counts; relative to the bias ``rest_rps`` where it is given.
    """

    model: LinearModel
    covariance: np.ndarray
    unobserved: tuple[str, ...]
    rows: Rows


def fit_least_squares(
    batch: Batch,
    sigma: np.ndarray,
    start: LinearModel,
    *,
    still_rates: StillRates | None = None,
    rest_rps: np.ndarray | None = None,
    begin: LinearModel | Rows | None = None,
    prior: GaussianPrior | None = None,
    settled: float = FORESEEN,
) -> LeastSquaresFit:
    """Fit the 12 parameters to a batch with sigma (S,) rad of each segment, or (S, d) of each angle, from a start.

    rest_rps (3,): the bias measured at rest, if known: then E alone is fitted, and B = -E rest_rps.
    begin: where the search starts, a model near the answer or ``rows`` of these segments from a fit to more of them; the prior stays
    around ``start``, or is ``prior``.  settled: rad; it ends where the next step is foreseen to change no residual by more.

    Raises FitError if the search does not converge, for residuals that are not finite, or without segments.
    The covariance returned is that of independent residuals with these sigmas; ``uncertainty.covariance_parts`` refines it.
    """
    if len(batch) == 0:
        raise FitError("no segments to fit; see the reasons for which they were rejected")
    if rest_rps is not None:
        batch, start = replace(batch, rate=batch.rate - rest_rps), replace(start, B=np.zeros(3))
        if isinstance(begin, LinearModel):
            begin = replace(begin, B=np.zeros(3))
    centre, root = _prior(start, prior, held=rest_rps is not None)
    at = begin if isinstance(begin, Rows) else _rows(batch, (begin or start).vector, None)
    vector, weight = at.vector, 1 / sigma.reshape(len(batch), -1)
    rank, before = linear.PARAMETERS, 0.0
    for _ in range(MAX_STEPS):
        angles, design = at.angles, at.columns
        if not np.isfinite(angles).all():
            raise FitError("least squares left the finite numbers; are the rates in the log in the unit of its header?")
        rows = [(design * weight[..., None]).reshape(-1, linear.PARAMETERS)]
        values = [(angles * weight).ravel()]
        if still_rates is not None:
            rows.append(still_rates.columns())
            values.append(still_rates.residuals(LinearModel.from_vector(vector)))
        jacobian, r = np.concatenate(rows) @ root, np.concatenate(values)
        left, strength, right = np.linalg.svd(jacobian, full_matrices=False)
        # A direction not observed above the noise stays at the prior.
        rank = min(rank, int(np.sum(strength**2 > OBSERVED_BELOW**-2 - 1))) if prior is None else len(strength)
        aim = left.T @ (jacobian @ np.linalg.solve(root, vector - centre) - r) * strength / (strength**2 + 1)
        change = centre + root @ (aim[:rank] @ right[:rank]) - vector
        vector = vector + change
        moved = float(np.abs(design @ change).max())
        # What a step leaves is of second order, in itself and in the residuals that bend the columns; or steps
        # shrink as they did before.
        shrinks = min(moved + float(np.abs(angles).max()), moved / before if before else np.inf)
        if moved < TOLERANCE or moved * shrinks < settled:
            break
        before = moved
        at = _rows(batch, vector, at if moved < COLUMNS_STAY else None)
    else:
        # The direction that still moves, in sigmas of the prior: a weak one is not bound by the data, a strong one torn by its turns.
        restless = int(np.argmax(np.abs(right[:rank] @ np.linalg.solve(root, change))))
        loose = combination(right[restless]) if strength[restless] < WEAK else ""
        off = np.linalg.norm(_rows(batch, start.vector, None).angles, axis=1)
        turned = np.sum(np.linalg.norm(start(batch.rate[:, 1:]), axis=2) * batch.dt, axis=1)
        raise _NotSettled(off, off > CLOSES_WITHIN * np.minimum(turned, MOST_TURNED_RAD), loose)
    covariance = root @ np.linalg.inv(jacobian.T @ jacobian + np.eye(linear.PARAMETERS)) @ root.T
    seen = sigmas_in(covariance) < OBSERVED_BELOW * PRIOR_SIGMA
    if rest_rps is not None:
        seen[linear.BIAS] = True
        model = LinearModel.from_vector(vector)
        vector = replace(model, B=-model.E @ rest_rps).vector
    unobserved = tuple(name for name, ok in zip(linear.NAMES, seen, strict=True) if not ok)
    return LeastSquaresFit(LinearModel.from_vector(vector), covariance, unobserved, at)


class _NotSettled(FitError):
    """The search did not converge.

    off_rad (S,): what each of the S segments leaves of its reference where the search starts; too_far (S,) bool: whether that is more than
    any gyroscope is off by; loose: the combination of parameters that the segments hardly bind, or nothing.
    """

    def __init__(self, off_rad: np.ndarray, too_far: np.ndarray, loose: str):
        self.off_rad, self.too_far, self.loose = off_rad, too_far, loose
        super().__init__(self.words([f"turn {row} of those used" for row in range(len(off_rad))]))

    def words(self, names: Sequence[str]) -> str:
        """State what does not fit; names: of the S segments."""
        words = f"least squares did not settle in {MAX_STEPS} steps: "
        count, usual = int(self.too_far.sum()), f"{float(np.median(self.off_rad)) / DEG:.1f} deg"
        if count > len(names) / 2:
            return (
                f"{words}{count} of {len(names)} turns miss gravity by more than {CLOSES_WITHIN:.0%} of their angle, the median turn by "
                f"{usual}; are gyro and accelerometer of one board, with one clock? are samples lost?"
            )
        if self.loose:
            return f"{words}the turns hardly bind {self.loose}; turn about more axes, both ways"
        worst = np.argsort(-self.off_rad * (self.too_far if count else 1))[: min(count, MOST_NAMED) or 1]
        listed = ", ".join(f"{names[row]} by {self.off_rad[row] / DEG:.1f} deg" for row in worst)
        return f"{words}gravity is missed in {listed}, in the median turn by {usual}; leave out what is wrong (--exclude), or record again"


@contextmanager
def naming_segments(segments: Sequence[Segment]) -> Iterator[None]:
    """State for which segments a fit does not settle; segments: those of the batch, in its order."""
    try:
        yield
    except _NotSettled as error:
        raise FitError(error.words([f"segment {s.number} at {s.start_s:.0f} s" for s in segments])) from None


def combination(direction: np.ndarray) -> str:
    """Name the parameters in a direction (12,), in units of the prior."""
    sizes = direction / np.abs(direction).max()
    parts = [(name, size) for name, size in zip(linear.NAMES, sizes, strict=True) if abs(size) > HALF]
    return " ".join(f"{'-' if size * parts[0][1] < 0 else '+'} {name}" for name, size in parts).removeprefix("+ ")


def _prior(start: LinearModel, prior: GaussianPrior | None, held: bool) -> tuple[np.ndarray, np.ndarray]:
    """Centre (12,) of the prior and a root (12, 12) of its covariance; held: whether the bias is fixed."""
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


def _rows(batch: Batch, vector: np.ndarray, near: Rows | None) -> Rows:
    """Rows of a linear model; near: those of a nearby one, whose columns are kept."""
    model = LinearModel.from_vector(vector)
    if near is None and batch.turns is None:
        return LinearEnds.of(model, batch).rows(batch, np.ones(len(batch), dtype=bool))
    angles = np.empty((len(batch), batch.angles))
    design = np.empty((len(batch), batch.angles, linear.PARAMETERS)) if near is None else near.columns
    for some in residual.parts(len(batch)):  # intermediate results stay in the processor's cache
        part = batch.pick(some)
        rate = model(part.rate)
        if near is not None:
            angles[some] = 2 * residual.segment_residuals(part, rate)
            continue
        end, sensitivity = residual.end_and_sensitivity(part, rate)
        angles[some] = 2 * residual.batch_residual(part, end)
        design[some] = linear.columns(sensitivity, part.rate)[:, : batch.angles]
    return Rows(vector, angles, design, None if near is None else near.ends)


# The closure of linear models near a given one without its samples, to second order in their difference.
#
# A rate error delta_omega turns the end attitude, in the table frame, by the rotation vector (Magnus; its second term is the coning of
# Bortz)
#
#     Omega = Phi + X / 2,    Phi = int u dt,    X = int_{t1 < t2} u(t1) x u(t2) dt1 dt2,    u = R_tb delta_omega.
#
# For omega = E m + B, u is linear in the 12 parameters: Phi has 12 columns, X has 78, and none depends on the model's distance.  So a swarm
# evaluates 90 numbers per angle instead of a thousand samples, or one form of them for all angles.  The error is of third order: 1e-5 rad
# at an angle of 0.07 rad (a scale error of 1 % over a turn of 270 degrees and more), 1e-8 rad at 0.007 rad.

#: pairs of parameters, each once
FIRST, SECOND = np.triu_indices(PARAMETERS)
#: segments whose columns at every sample are held at once: some megabytes
TOGETHER = 4
#: rad: step of the finite differences; rounding and truncation errors are both below 1e-8 of the derivatives
STEP_RAD = 2e-4


@dataclass(frozen=True, eq=False)
class Nearby:
    """Expansion of S segments' closure about a vector (12,): end (S, 4) q_tb, phi (12, S 3) rad and half_x (78, S 3) rad."""

    vector: np.ndarray
    end: np.ndarray
    phi: np.ndarray
    half_x: np.ndarray
    batch: Batch

    @classmethod
    def about(cls, model: LinearModel, batch: Batch) -> Nearby:
        """Expand a batch about a model."""
        # Without known angles, which are measured about axes other than the table's.
        end, sensitivity = residual.end_and_sensitivity(replace(batch, turns=None), model(batch.rate))
        count = len(batch)
        phi, pairs = np.empty((count, 3, PARAMETERS)), np.empty((count, 3, len(FIRST)))
        for first in range(0, count, TOGETHER):
            some = slice(first, first + TOGETHER)
            u = _along(sensitivity[some], batch.rate[some])
            phi[some], pairs[some] = u.sum(axis=-1), _crossed(u)
        return cls(model.vector, end, phi.reshape(-1, PARAMETERS).T.copy(), pairs.reshape(-1, len(FIRST)).T / 2, batch)

    def pick(self, which: np.ndarray) -> Nearby:
        """Some of the segments, by mask (S,)."""
        rows = np.repeat(which, 3)
        return Nearby(self.vector, self.end[which], self.phi[:, rows], self.half_x[:, rows], self.batch.pick(which))

    def gathered(self, weight: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Function of models (P, 12): the sum of squares (P,) of ``residuals`` to second order, with weight (S, 2 or 3).

        It is one quadratic form of 91 numbers for any number of segments.
        """
        value, slope, bend = self._of_turns()
        phi, half_x = self.phi.T.reshape(-1, 3, PARAMETERS), self.half_x.T.reshape(-1, 3, len(FIRST))
        linear = slope @ phi
        bent = phi.transpose(0, 2, 1)[:, None] @ bend @ phi[:, None]
        bent[..., range(PARAMETERS), range(PARAMETERS)] /= 2
        whole = np.concatenate([value[..., None], linear, slope @ half_x + bent[..., FIRST, SECOND]], axis=-1)
        rows = (whole * np.sqrt(weight)[..., None]).reshape(-1, whole.shape[-1])
        form = rows.T @ rows

        def cost(vectors: np.ndarray) -> np.ndarray:
            delta = vectors - self.vector
            f = np.concatenate([np.ones((len(delta), 1)), delta, delta[:, FIRST] * delta[:, SECOND]], axis=1)
            return np.sum(f @ form * f, axis=1)

        return cost

    def _of_turns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The residual (S, d) at the ends, and its first and second derivatives with a small rotation: (S, d, 3), (S, d, 3, 3)."""
        step = np.eye(3) * STEP_RAD

        def at(turn: np.ndarray) -> np.ndarray:
            return residual.batch_residual(self.batch, rotation.multiply(rotation.exp(turn), self.end))

        value = at(np.zeros(3))
        up, down = (np.stack([at(sign * one) for one in step], axis=-1) for sign in (1, -1))
        bend = np.empty((*value.shape, 3, 3))
        for i, j in zip(*np.triu_indices(3), strict=True):
            both = at(step[i] + step[j]) - at(step[i] - step[j]) - at(step[j] - step[i]) + at(-step[i] - step[j])
            bend[..., i, j] = bend[..., j, i] = both / (4 * STEP_RAD**2)
        return value, (up - down) / (2 * STEP_RAD), bend

    def with_references(self, batch: Batch) -> Nearby:
        """The expansion for the references of another batch with the same rates: the rotations of the body are the same."""
        turn = rotation.multiply(batch.start, rotation.conjugate(self.batch.start))
        matrix = rotation.matrix(turn)
        phi, half_x = ((matrix @ of.T.reshape(-1, 3, len(of))).reshape(-1, len(of)).T.copy() for of in (self.phi, self.half_x))
        return Nearby(self.vector, rotation.multiply(turn, self.end), phi, half_x, batch)

    def residuals(self, vectors: np.ndarray) -> np.ndarray:
        """Closure residuals (P, S, 2 or 3) of models (P, 12)."""
        delta = vectors - self.vector
        omega = delta @ self.phi + (delta[:, FIRST] * delta[:, SECOND]) @ self.half_x
        ends = rotation.multiply(rotation.exp(omega.reshape(len(vectors), -1, 3)), self.end)
        return residual.batch_residual(self.batch, ends)


def _along(sensitivity: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """(S, 3, 12, T) rad per unit: rotation per parameter in each sample; sensitivity (S, T, 3, 3), measured rates (S, T, 3)."""
    by_time = sensitivity.transpose(0, 2, 3, 1)  # (S, 3, 3, T)
    measured = rate.transpose(0, 2, 1)[:, None, None]
    matrix = (by_time[:, :, :, None] * measured).reshape(len(rate), 3, 9, -1)
    return np.concatenate([matrix, by_time], axis=2)


def _crossed(u: np.ndarray) -> np.ndarray:
    """(S, 3, 78) coefficients of X: one for the product of each pair of parameters."""
    count, _, parameters, samples = u.shape
    before = np.cumsum(u, axis=-1) - u / 2
    rows = (count, 3 * parameters, samples)
    product = (before.reshape(rows) @ u.reshape(rows).swapaxes(1, 2)).reshape(count, 3, parameters, 3, parameters)
    crossed = np.stack([product[:, j, :, k] - product[:, k, :, j] for j, k in ((1, 2), (2, 0), (0, 1))], axis=1)
    both = crossed + crossed.swapaxes(2, 3)
    both[:, :, range(parameters), range(parameters)] /= 2
    return both[:, :, FIRST, SECOND]
