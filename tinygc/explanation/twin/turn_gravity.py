"""Gravity during the turns: what the gyro predicts for the accelerometer, with a fitted lever arm.

    f(t) = -g R_bt(t) e_down + [alpha x] r + [omega x]^2 r,   read `offset` later by the accelerometer

Lever arm r and offset are linear in the difference; the scatter from segment to segment is their uncertainty, because the hand shakes
the table by far more than the sensors' noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from tinygc import closure
from tinygc.attitude import rotation
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.twin import Twin

#: rows of a fortieth of a second: at 200 dps gravity turns by 5 degrees within one
BLOCK_S = 0.025
#: the sensors' filters delay gyro and accelerometer differently by up to half a sample; more is not theirs
FILTERS_PERIODS = 0.5
#: of a sandwich over some 40 segments, whose tails are Student's: once in 100 000
SIGMAS = 5.0
#: as of every other claim (``verdict/veto.py``)
BORNE_OUT_P = 0.05


@dataclass(frozen=True, eq=False)
class TurnGravity:
    """lever_m (3,); offset_s, positive where the gyro is late; sigma_s; rms of the difference before and after, m/s^2; bar_s; turns, how
    many; held_out_p: chance that the offset improves turns that were left out as much (Wilcoxon's signed ranks)."""

    lever_m: np.ndarray
    offset_s: float
    sigma_s: float
    before_mps2: float
    after_mps2: float
    bar_s: float
    turns: int
    held_out_p: float

    @property
    def is_offset(self) -> bool:
        """Whether the two clocks differ by more than chance."""
        return abs(self.offset_s) > self.bar_s and self.held_out_p < BORNE_OUT_P


@dataclass(frozen=True, eq=False)
class TurnEquations:
    """Normal equations of lever arm and offset, turn by turn: normal (S, 4, 4), right (S, 4), square (S,) of what they should explain,
    from count (S,) values."""

    normal: np.ndarray
    right: np.ndarray
    square: np.ndarray
    count: np.ndarray

    def solve(self) -> np.ndarray:
        """(4,) lever arm, m, and offset, s."""
        return np.linalg.solve(self.normal.sum(axis=0), self.right.sum(axis=0))

    def left(self, solution: np.ndarray) -> np.ndarray:
        """(S,) what a solution leaves of each square."""
        left = self.square - 2 * self.right @ solution + np.einsum("sij,i,j->s", self.normal, solution, solution)
        return np.maximum(left, 0.0)

    def improvement_p(self) -> float:
        """Probability that chance makes the offset improve each turn as much, lever arm and offset fitted to all others."""
        normal, right = self.normal.sum(axis=0) - self.normal, self.right.sum(axis=0) - self.right
        arm = np.einsum("sij,sj->si", np.linalg.pinv(normal[:, :3, :3], hermitian=True), right[:, :3])
        both = np.einsum("sij,sj->si", np.linalg.pinv(normal, hermitian=True), right)
        gains = self._left_each(np.pad(arm, ((0, 0), (0, 1)))) - self._left_each(both)
        return float(stats.wilcoxon(gains, alternative="greater").pvalue) if len(gains) > 1 and np.any(gains) else 1.0

    def _left_each(self, solutions: np.ndarray) -> np.ndarray:
        """(S,) what each turn's own solution (S, 4) leaves of its square."""
        squares = np.einsum("sij,si,sj->s", self.normal, solutions, solutions)
        return self.square - 2 * np.einsum("si,si->s", self.right, solutions) + squares

    def square_at(self, offset_s: float) -> np.ndarray:
        """(S,) what is left with a given offset, the lever arm fitted to it."""
        arm = self.normal.sum(axis=0)[:3]
        lever = np.linalg.solve(arm[:, :3], self.right.sum(axis=0)[:3] - offset_s * arm[:, 3])
        return self.left(np.append(lever, offset_s))


def turn_equations(twin: Twin, fit: Refit) -> TurnEquations:
    """What gravity in the turns says of lever arm and offset."""
    state = fit.state
    batch = twin.batch_at(state)
    padded = twin.padded(twin.rates(state))
    turn = rotation.matrix(closure.attitudes(batch, padded))
    normal, right, square, count = [], [], [], []
    for i, segment in enumerate(twin.segments):
        samples = twin.seen.logs[segment.log].samples
        length, dt = segment.stop - segment.start, samples.period_s
        omega = padded[i, :length] - batch.earth[i, :length]
        alpha = np.gradient(omega, dt, axis=0)
        gravity = -state.gravity_mps2 * turn[i, :length, 2, :]
        arm = _cross_matrix(alpha) + _cross_matrix(omega) @ _cross_matrix(omega)
        columns = np.concatenate([arm, np.gradient(gravity, dt, axis=0)[:, :, None]], axis=-1)
        size = max(1, round(BLOCK_S / dt))
        blocks = length // size
        columns = columns[: blocks * size].reshape(blocks, size, 3, 4).mean(axis=1).reshape(-1, 4)
        value = (state.freed(samples.accel[segment.start : segment.stop]) - gravity)[: blocks * size]
        value = value.reshape(blocks, size, 3).mean(axis=1).ravel()
        normal.append(columns.T @ columns)
        right.append(columns.T @ value)
        square.append(float(value @ value))
        count.append(len(value))
    return TurnEquations(np.array(normal), np.array(right), np.array(square), np.array(count))


def turn_gravity(twin: Twin, fit: Refit) -> TurnGravity:
    """Fit lever arm and offset to all turns."""
    equations = turn_equations(twin, fit)
    solution = equations.solve()
    # Sandwich over the segments: each is one draw of the hand's shaking.
    score = equations.right - equations.normal @ solution
    inverse = np.linalg.inv(equations.normal.sum(axis=0))
    covariance = inverse @ (score.T @ score) @ inverse
    sigma = float(np.sqrt(covariance[3, 3]))
    count = equations.count.sum()
    period = float(np.median([movement.dt_s for movement in twin.movements]))
    return TurnGravity(
        lever_m=solution[:3],
        offset_s=float(solution[3]),
        sigma_s=sigma,
        before_mps2=float(np.sqrt(equations.square.sum() / count)),
        after_mps2=float(np.sqrt(equations.left(solution).sum() / count)),
        bar_s=max(FILTERS_PERIODS * period, SIGMAS * sigma),
        turns=len(equations.count),
        held_out_p=equations.improvement_p(),
    )


def _cross_matrix(vectors: np.ndarray) -> np.ndarray:
    """(N, 3, 3) so that matrix @ r = vector x r."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)]
    return np.stack(rows, axis=1)
