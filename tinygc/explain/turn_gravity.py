"""Gravity during the turns: what the gyro predicts for the accelerometer, with a fitted lever arm.

    f(t) = -g R_bt(t) e_down + [alpha x] r + [omega x]^2 r,   read `offset` later by the accelerometer

Lever arm r and offset are linear in the difference; the scatter from segment to segment is their uncertainty, because the hand shakes
the table by far more than the sensors' noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc import closure, rotation
from tinygc.explain.refit import Refit
from tinygc.explain.twin import Twin

BLOCK_S = 0.025
#: the sensors' filters delay gyro and accelerometer differently by up to half a sample; more is not theirs
FILTERS_PERIODS = 0.5
SIGMAS = 5.0


@dataclass(frozen=True, eq=False)
class TurnGravity:
    """lever_m (3,); offset_s, positive where the gyro is late; sigma_s; rms of the difference before and after, m/s^2; bar_s."""

    lever_m: np.ndarray
    offset_s: float
    sigma_s: float
    before_mps2: float
    after_mps2: float
    bar_s: float

    @property
    def is_offset(self) -> bool:
        return abs(self.offset_s) > self.bar_s


def turn_gravity(twin: Twin, fit: Refit) -> TurnGravity:
    """Fit lever arm and offset to all turns."""
    state = fit.state
    batch = twin.batch_at(state)
    padded = twin.padded(fit.rates)
    turn = rotation.matrix(closure.attitudes(batch, padded))
    normal, right, square, count = [], [], 0.0, 0
    for i, segment in enumerate(twin.segments):
        samples = twin.problem.logs[segment.log].samples
        length, dt = segment.stop - segment.start, samples.period_s
        omega = padded[i, :length] - batch.earth[i, :length]
        alpha = np.gradient(omega, dt, axis=0)
        gravity = -state.gravity_mps2 * turn[i, :length, 2, :]
        arm = _cross_matrix(alpha) + _cross_matrix(omega) @ _cross_matrix(omega)
        columns = np.concatenate([arm, np.gradient(gravity, dt, axis=0)[:, :, None]], axis=-1)
        size = max(1, round(BLOCK_S / dt))
        blocks = length // size
        columns = columns[: blocks * size].reshape(blocks, size, 3, 4).mean(axis=1).reshape(-1, 4)
        value = (samples.accel[segment.start : segment.stop] - state.force_bias - gravity)[: blocks * size]
        value = value.reshape(blocks, size, 3).mean(axis=1).ravel()
        normal.append(columns.T @ columns)
        right.append(columns.T @ value)
        square += float(value @ value)
        count += len(value)
    normal, right = np.array(normal), np.array(right)
    solution = np.linalg.solve(normal.sum(axis=0), right.sum(axis=0))
    # Sandwich over the segments: each is one draw of the hand's shaking.
    score = right - normal @ solution
    inverse = np.linalg.inv(normal.sum(axis=0))
    covariance = inverse @ (score.T @ score) @ inverse
    left = square - 2 * solution @ right.sum(axis=0) + solution @ normal.sum(axis=0) @ solution
    sigma = float(np.sqrt(covariance[3, 3]))
    period = float(np.median([movement.dt_s for movement in twin.movements]))
    return TurnGravity(
        lever_m=solution[:3],
        offset_s=float(solution[3]),
        sigma_s=sigma,
        before_mps2=float(np.sqrt(square / count)),
        after_mps2=float(np.sqrt(max(left, 0.0) / count)),
        bar_s=max(FILTERS_PERIODS * period, SIGMAS * sigma),
    )


def _cross_matrix(vectors: np.ndarray) -> np.ndarray:
    """(N, 3, 3) so that matrix @ r = vector x r."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)]
    return np.stack(rows, axis=1)
