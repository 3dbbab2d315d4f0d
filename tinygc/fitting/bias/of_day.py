"""The bias of the day, from gravity over a whole run: slow, and robust to motion.

A calibration's E lasts; its bias is another one after each switch-on.  The accelerometer tells it even while the sensor moves: with the
right bias, the specific force that is carried to the navigation frame by the gyro's attitude adds up, with gravity, to a velocity that
stays small, because nothing that is tested keeps accelerating.  With a bias wrong by db it runs off as g db t^2 / 2.

Unknowns: the bias as a slow walk about its mean, a bias of the accelerometer, the tilt of the first attitude, a velocity at the start of
each uninterrupted piece.  Data: the velocity every tenth of a second, which is taken for an Ornstein-Uhlenbeck process (whitened as
such); the mean rate at rest, if the run has rests, which is only loosely that of the run, because a gyro that shakes has another zero.
A prior holds what gravity cannot see, the turn about the vertical, near the stored bias.  Gauss-Newton; everything is linear but the
attitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from session.common.errors import FitError
from session.common.runs import runs_of
from session.common.units import DEG, NS, STANDARD_GRAVITY_MPS2
from session.log.samples import Samples
from tinygc.attitude import rotation
from tinygc.attitude.integrate import steps

#: velocities are summed over it: a twentieth of what a velocity lasts, so that it is constant within
BLOCK_S = 0.1
#: the vehicle's or the hand's own velocity, and how long it lasts (by benchmarks/paper_tables.py, the EuRoC training sequences)
VELOCITY_MPS, VELOCITY_LASTS_S = 0.5, 2.0
#: how fast a bias walks, rad/s/sqrt(s) (by the same); knots, between which that is 0.005 dps; more of them cost time only
WALK, KNOT_S, MOST_KNOTS = 3e-5, 10.0, 40
#: what is not known of the accelerometer: 10 mg, a data sheet's typical zero-g offset; of the first attitude's tilt: what they turn it by
ACCEL_BIAS_MPS2, TILT_RAD = 0.1, 0.5 * DEG
#: zero of a gyro at rest against its zero in motion (up to 0.06 dps on the EuRoC vehicle, paper_tables.py --only explain)
REST_SIGMA_RPS = 0.05 * DEG
#: of a stored bias, where nothing better is known: the EuRoC days' spread is 0.03 to 0.14 dps (paper_tables.py --only table1)
DAY_SIGMA_RPS = 0.1 * DEG
#: an uninterrupted piece shorter than a velocity lasts says nothing
SHORTEST_S = 2.0
#: Gauss-Newton: steps, and where they end, 0.002 degrees an hour
MAX_STEPS = 8
TOLERANCE_RPS = 1e-8


@dataclass(frozen=True, eq=False)
class BiasOfDay:
    """change (3,) rad/s to add to the calibrated rate, over the run's mean; sigma (3,); directions (3, 3), rows in body axes from the
    best known to the least, with their sigmas direction_sigma (3,); walk (K, 3) rad/s, the change at knots_s (K,)."""

    change: np.ndarray
    sigma: np.ndarray
    directions: np.ndarray
    direction_sigma: np.ndarray
    knots_s: np.ndarray
    walk: np.ndarray

    @property
    def excess(self) -> float:
        """How much farther the bias walked than a bias does, as a factor of at least 1: what a wrong E leaves looks like it."""
        steps = np.diff(self.walk, axis=0) / (WALK * np.sqrt(np.diff(self.knots_s)))[:, None]
        return float(np.sqrt(max(1.0, float(np.mean(steps**2))))) if steps.size else 1.0


def bias_from_gravity(
    samples: Samples,
    rate: np.ndarray,
    q_first: np.ndarray,
    *,
    prior: np.ndarray | float = DAY_SIGMA_RPS,
    rest: np.ndarray | None = None,
    rest_sigma: np.ndarray | float = REST_SIGMA_RPS,
    earth_n: np.ndarray | None = None,
    gravity_mps2: float = STANDARD_GRAVITY_MPS2,
) -> BiasOfDay:
    """From samples with pre-calibrated specific force, calibrated rates (N, 3) rad/s with the stored bias, and q_nb (4,) at the first.

    prior (3,) rad/s: how much the stored bias may be off.  rest (3,) rad/s: the change that the run's rests ask for, whose zero differs
    from the one in motion by rest_sigma.  earth_n (3,) rad/s: the Earth's rate in the frame of q_first.  Rows whose specific force is
    exactly zero have none.  Raises FitError if no piece of the run has a specific force.
    """
    run = _Run(samples, rate, np.asarray(q_first, dtype=float), earth_n, gravity_mps2)
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
        raise FitError("the bias from gravity left the finite numbers; are rate and specific force in the units that the header says?")
    variance, directions = np.linalg.eigh(covariance)
    walk = x[:count].reshape(-1, 3)
    return BiasOfDay(mean @ x, np.sqrt(np.diag(covariance)), directions.T, np.sqrt(variance), knots, walk)


def _prior(knots: np.ndarray, sigma: np.ndarray, size: int, run: _Run) -> tuple[np.ndarray, np.ndarray]:
    """Precision (P, P) of all unknowns, and what takes them to the bias's mean (3, P)."""
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


class _Run:
    """A run in blocks: what does not change from step to step."""

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
        """Blocks that follow one another without a gap, in stamps or in specific force."""
        late = np.diff(samples.t_ns[: self.blocks * self.size : self.size]) * NS > 1.5 * self.size * samples.period_s
        found = []
        for start, stop in zip(*runs_of(whole), strict=True):
            inner = [start, *(int(k) + 1 for k in np.flatnonzero(late) if start <= k < stop - 1), stop]
            found += [slice(int(a), int(b)) for a, b in pairwise(inner)]
        return [piece for piece in found if self.span[piece].sum() >= SHORTEST_S]

    def linearised(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Columns (n, P) and residuals (n,) of the whitened velocities."""
        knots = len(self.knots)
        bias = self.hat_each @ x[: 3 * knots].reshape(knots, 3)
        at = 3 * knots
        accel_bias, tilt = x[at : at + 3], np.array([*x[at + 3 : at + 5], 0.0])
        q = rotation.accumulate(steps(self.rate + bias - self.earth_b, self.dt))
        q = np.concatenate([self.q_first[None], rotation.multiply(self.q_first, q)])
        if self.earth_n is not None:  # of the attitude before this step: they differ by far less than the Earth's rate would notice
            self.earth_b = np.einsum("tji,j->ti", rotation.matrix(q), self.earth_n)
        turn = rotation.matrix(rotation.exp(tilt)) @ rotation.matrix(q)
        force = self._blocked(np.einsum("tij,tj->ti", turn, self.force - accel_bias))
        turn = self._blocked(turn)
        # An error of the rate turns the attitude, in navigation axes, by what it adds up to; so does the first attitude's.
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
    """(n, …): an Ornstein-Uhlenbeck process in units of its own innovations."""
    keep = np.exp(-span[1:] / VELOCITY_LASTS_S).reshape(-1, *[1] * (velocity.ndim - 1))
    innovations = (velocity[1:] - keep * velocity[:-1]) / np.sqrt(1 - keep**2)
    return np.concatenate([velocity[:1], innovations]) / VELOCITY_MPS
