"""A stored calibration in a new session: E is kept, the bias is estimated again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from session.base import rotation
from session.base.errors import FitError, SegmentError
from session.base.numeric import runs_of, sigmas_in
from session.base.rotation import steps
from session.base.units import DEG, NS, STANDARD_GRAVITY_MPS2
from session.detect.stills import BLOCK_S
from session.log.folder import Session
from session.log.samples import Samples
from tinygc.closure.problem import Problem
from tinygc.closure.stills import StillSet
from tinygc.estimation.spread import USUAL, ZERO
from tinygc.models.model import Model

# The bias of the day, from gravity over a whole run: slow, and robust to motion.
#
# A calibration's E is stable; its bias changes at each switch-on.  It is observable from the accelerometer even while the sensor moves:
# with the right bias, the specific force in the navigation frame (by the gyro's attitude) and gravity integrate to a velocity that
# stays small, because no tested object keeps accelerating.  With a bias error db the velocity grows as g db t^2 / 2.
#
# Unknowns: the bias as a slow random walk about its mean, a bias of the accelerometer, the tilt of the first attitude, a velocity at the
# start of each uninterrupted piece.  Data: the velocity every tenth of a second, modelled (and whitened) as an Ornstein-Uhlenbeck process;
# the mean rate at rest, if the run has rests, with a loose sigma, because a gyro has another bias under vibration.
# A prior near the stored bias constrains the rotation about the vertical, which gravity does not observe.  The solver is Gauss-Newton;
# all but the attitude is linear.

#: the vehicle's or the hand's own velocity, and its correlation time (by benchmarks/paper_tables.py, the EuRoC training sequences)
VELOCITY_MPS, VELOCITY_DECAY_S = 0.5, 2.0
#: random walk of a bias, rad/s/sqrt(s) (by the same); time between knots, in which that is 0.005 dps; more of them only cost time
WALK, KNOT_S, MOST_KNOTS = 3e-5, 10.0, 40
#: uncertainty of the accelerometer, 10 mg, a data sheet's typical zero-g offset; and of the first attitude's tilt, which follows from it
ACCEL_BIAS_MPS2, TILT_RAD = 0.1, 0.5 * DEG
#: difference of a gyro's bias at rest and in motion (up to 0.06 dps on the EuRoC vehicle, paper_tables.py --only explain)
REST_SIGMA_RPS = 0.05 * DEG
#: rad/s, least sigma of a stored bias
LEAST_SIGMA_RPS = 1e-6
#: an uninterrupted piece shorter than the correlation time of velocity contains no information
SHORTEST_S = 2.0
#: Gauss-Newton: number of steps, and the tolerance, 0.002 degrees an hour
MAX_STEPS = 8
TOLERANCE_RPS = 1e-8


@dataclass(frozen=True, eq=False)
class _BiasOfDay:
    """The change (3,) rad/s to add to the calibrated rate, as the run's mean; sigma (3,); walk (K, 3) rad/s, the change at knots_s (K,)."""

    change: np.ndarray
    sigma: np.ndarray
    knots_s: np.ndarray
    walk: np.ndarray

    @property
    def excess(self) -> float:
        """The ratio, at least 1, of the estimated walk to that of a bias; a wrong E makes it larger."""
        steps = np.diff(self.walk, axis=0) / (WALK * np.sqrt(np.diff(self.knots_s)))[:, None]
        return float(np.sqrt(max(1.0, float(np.mean(steps**2))))) if steps.size else 1.0


def _bias_from_gravity(
    samples: Samples,
    rate: np.ndarray,
    q_first: np.ndarray,
    *,
    prior: np.ndarray | float = USUAL.scatter[ZERO],
    rest: np.ndarray | None = None,
    rest_sigma: np.ndarray | float = REST_SIGMA_RPS,
    earth_n: np.ndarray | None = None,
    gravity_mps2: float = STANDARD_GRAVITY_MPS2,
) -> _BiasOfDay:
    """Estimate the bias from samples with pre-calibrated specific force, calibrated rates (N, 3) rad/s with the stored bias, and the
    first attitude q_nb (4,).

    prior (3,) rad/s: sigma of the stored bias.  rest (3,) rad/s: the change estimated from the run's rests, whose bias differs
    from that in motion by rest_sigma.  earth_n (3,) rad/s: the Earth's rate in the frame of q_first.  A specific force of exactly zero
    marks a row without one.  Raises FitError if no piece of the run has a specific force.
    """
    run = _SmoothedRun(samples, rate, np.asarray(q_first, dtype=float), earth_n, gravity_mps2)
    knots = run.knots
    count = 3 * len(knots)
    size = count + 5 + 3 * len(run.pieces)
    precision, mean = _prior(knots, np.broadcast_to(prior, 3), size, run)
    target = np.zeros(size)
    if rest is not None:
        weight = 1 / np.broadcast_to(rest_sigma, 3) ** 2
        precision += mean.T @ (mean * weight[:, None])
        target += mean.T @ (weight * rest)
    x = np.zeros(size)
    for _ in range(MAX_STEPS):
        jacobian, r = run.linearised(x)
        step = np.linalg.solve(precision + jacobian.T @ jacobian, target - precision @ x - jacobian.T @ r)
        x = x + step
        if np.abs(step[:count]).max() < TOLERANCE_RPS:
            break
    covariance = mean @ np.linalg.inv(precision + jacobian.T @ jacobian) @ mean.T
    if not (np.isfinite(x).all() and np.isfinite(covariance).all()):
        raise FitError("the bias from gravity left the finite numbers; are rate and specific force in the units of the header?")
    return _BiasOfDay(mean @ x, sigmas_in(covariance), knots, x[:count].reshape(-1, 3))


def _prior(knots: np.ndarray, sigma: np.ndarray, size: int, run: _SmoothedRun) -> tuple[np.ndarray, np.ndarray]:
    """Return the precision (P, P) of all unknowns, and the matrix (3, P) from them to the mean bias."""
    precision, mean = np.zeros((size, size)), np.zeros((3, size))
    for knot in range(len(knots)):
        mean[:, 3 * knot : 3 * knot + 3] = np.eye(3) * run.share[knot]
    precision += mean.T @ (mean / sigma[:, None] ** 2)
    for knot in range(len(knots) - 1):
        step = np.zeros((3, size))
        step[:, 3 * knot : 3 * knot + 6] = np.concatenate([-np.eye(3), np.eye(3)], axis=1)
        precision += step.T @ step / (WALK**2 * (knots[knot + 1] - knots[knot]))
    rest = np.array([ACCEL_BIAS_MPS2] * 3 + [TILT_RAD] * 2 + [2 * VELOCITY_MPS] * 3 * len(run.pieces))
    precision[3 * len(knots) :, 3 * len(knots) :] += np.diag(1 / rest**2)
    return precision, mean


class _SmoothedRun:
    """A run in blocks: the quantities that are constant over the iterations."""

    def __init__(self, samples: Samples, rate: np.ndarray, q_first: np.ndarray, earth_n: np.ndarray | None, gravity_mps2: float):
        self.earth_n = earth_n
        self.earth_b: np.ndarray | float = 0.0
        self.rate, self.dt, self.q_first, self.gravity = rate, samples.dt_s, q_first, gravity_mps2
        self.force, self.t_s = samples.accel, samples.t_s
        self.size = max(1, round(BLOCK_S / samples.period_s))
        self.blocks = len(samples) // self.size
        duration = samples.duration_s
        self.knots = np.linspace(0, duration, min(max(2, round(duration / KNOT_S) + 1), MOST_KNOTS))
        hats = np.eye(len(self.knots))
        self.hat = np.stack([np.interp(self._blocked(self.t_s), self.knots, hat) for hat in hats], axis=-1)
        self.hat_each = np.stack([np.interp(self.t_s, self.knots, hat) for hat in hats], axis=-1)
        self.share = self.hat.mean(axis=0)
        first, last = self.t_s[: self.blocks * self.size : self.size], self.t_s[self.size - 1 : self.blocks * self.size : self.size]
        self.span = last - first + samples.period_s
        whole = np.abs(self.force[: self.blocks * self.size]).sum(axis=1) > 0
        self.pieces = self._pieces(whole.reshape(self.blocks, self.size).all(axis=1), samples)
        if not self.pieces:
            raise FitError(f"no {SHORTEST_S:g} s of the run have a specific force throughout: the bias cannot be had from gravity")

    def _blocked(self, values: np.ndarray) -> np.ndarray:
        part = values[: self.blocks * self.size]
        return part.reshape(self.blocks, self.size, *values.shape[1:]).mean(axis=1)

    def _pieces(self, whole: np.ndarray, samples: Samples) -> list[slice]:
        """Return blocks without a gap in stamps or in specific force."""
        late = np.diff(samples.t_ns[: self.blocks * self.size : self.size]) * NS > 1.5 * self.size * samples.period_s
        found = []
        for start, stop in zip(*runs_of(whole), strict=True):
            inner = [start, *(int(k) + 1 for k in np.flatnonzero(late) if start <= k < stop - 1), stop]
            found += [slice(int(a), int(b)) for a, b in pairwise(inner)]
        return [piece for piece in found if self.span[piece].sum() >= SHORTEST_S]

    def linearised(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return columns (n, P) and residuals (n,) of the whitened velocities."""
        knots = len(self.knots)
        bias = self.hat_each @ x[: 3 * knots].reshape(knots, 3)
        at = 3 * knots
        accel_bias, tilt = x[at : at + 3], np.array([*x[at + 3 : at + 5], 0.0])
        q = rotation.accumulate(steps(self.rate + bias - self.earth_b, self.dt))
        q = np.concatenate([self.q_first[None], rotation.multiply(self.q_first, q)])
        if self.earth_n is not None:  # by the attitude before this step, which is accurate enough here
            self.earth_b = np.einsum("tji,j->ti", rotation.matrix(q), self.earth_n)
        turn = rotation.matrix(rotation.exp(tilt)) @ rotation.matrix(q)
        force = self._blocked(np.einsum("tij,tj->ti", turn, self.force - accel_bias))
        turn = self._blocked(turn)
        # An error of the rate rotates the attitude, in navigation axes, by its integral; so does an error of the first attitude.
        turned = np.cumsum(turn[:, :, None, :] * self.hat[:, None, :, None] * self.span[:, None, None, None], axis=0)
        columns = np.concatenate([turned.reshape(len(turn), 3, -1), np.broadcast_to(np.eye(3)[:, :2], (len(turn), 3, 2))], axis=-1)
        moved = -np.cross(force[:, :, None], columns, axis=1)
        accelerated = np.concatenate([moved[..., :-2], -turn, moved[..., -2:]], axis=-1)
        rows, values = [], []
        for number, piece in enumerate(self.pieces):
            span = self.span[piece]
            r = np.cumsum((force[piece] + [0, 0, self.gravity]) * span[:, None], axis=0)
            J = np.zeros((len(span), 3, len(x)))
            J[..., : at + 5] = np.cumsum(accelerated[piece] * span[:, None, None], axis=0)
            J[..., at + 5 + 3 * number : at + 8 + 3 * number] = np.eye(3)
            r = r + x[at + 5 + 3 * number : at + 8 + 3 * number]
            rows.append(_whitened(J, span).reshape(-1, len(x)))
            values.append(_whitened(r, span).ravel())
        return np.concatenate(rows), np.concatenate(values)


def _whitened(velocity: np.ndarray, span: np.ndarray) -> np.ndarray:
    """Whiten an Ornstein-Uhlenbeck process (n, …) to units of its innovations."""
    keep = np.exp(-span[1:] / VELOCITY_DECAY_S).reshape(-1, *[1] * (velocity.ndim - 1))
    innovations = (velocity[1:] - keep * velocity[:-1]) / np.sqrt(1 - keep**2)
    return np.concatenate([velocity[:1], innovations]) / VELOCITY_MPS


# A stored calibration in a new session: E is kept, the bias is taken from gravity.


def from_gravity(problem: Problem, model: Model, prior: np.ndarray) -> _BiasOfDay:
    """Estimate the bias from all logs of a session in order: the result of one is the prior of the next."""
    # A denoised rate is delayed, which would appear as a bias against the accelerometer; the denoiser itself has no bias.
    model = model.without_denoiser()
    change, sigma, found, excess = np.zeros(3), prior, None, 1.0
    g = problem.session.config.site.expected_gravity_mps2
    for number, log in enumerate(problem.logs):
        row, q_first, earth_n = _first_attitude(problem, number)
        samples = log.samples.between(row, len(log.samples))
        rate = np.asarray(model(samples.gyro)) + change
        found = _bias_from_gravity(
            samples, rate, q_first, prior=sigma, rest=_rest_change(problem.session, log, model, change), earth_n=earth_n, gravity_mps2=g
        )
        change, sigma, excess = change + found.change, found.sigma, max(excess, found.excess)
    assert found is not None  # a session has a log
    # A wrong E gives each turn a bias of its own: their scatter exceeds the bias walk, and so does the error of their mean.
    return replace(found, change=change, sigma=found.sigma * excess)


def _first_attitude(problem: Problem, number: int) -> tuple[int, np.ndarray, np.ndarray]:
    """Return the row of a log from which its attitude is known, q (4,) there, and the Earth's rate (3,) in that frame."""
    session, log = problem.session, problem.logs[number]
    if session.reference is not None:
        rows, q = session.reference.attitudes(number, log.samples)
        return int(rows[0]), q[0], problem.earth.rate_t
    first = next((i for i, still in enumerate(log.stills) if still.problem is None), None)
    if first is None:
        raise SegmentError(f"{session.folder}: a log without a still: from where should its attitude be carried?")
    still = log.stills[first]
    return still.middle, log.q_tb[first], problem.earths[int(log.group[first])].rate_t


def _rest_change(session: Session, log: StillSet, model: Model, change: np.ndarray) -> np.ndarray | None:
    """Return the median change (3,) over a log's rests, since a slowly moving hand may be detected as a rest."""
    rates = [still.gyro_mean for still in log.stills if still.problem is None] or [rate for _, rate in session.reference.rests(log.samples)]
    if not rates:
        return None
    return -np.median([model(rate[None])[0] for rate in rates], axis=0) - change
