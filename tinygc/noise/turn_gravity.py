"""Gravity during the turns: the delay between gyro and accelerometer, and the lever arm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from session.base import rotation
from session.base.rotation import cross_matrix
from tinygc.closure import residual
from tinygc.inference.prove import signed_ranks_above
from tinygc.inference.solve import inverse
from tinygc.noise.refit import Refit
from tinygc.noise.twin import Twin

# The delay follows from the change of velocity between two stills, which is zero, however the hand moved and wherever the sensor sits.
# What the accelerometer integrates to is then a delay's, or a bias':
#
#     integral of R_tb f = (integral of R_tb df/dt) delay + (integral of R_tb) b,      the level components of each turn
#
# with b a bias of the accelerometer.  A fit of the specific force itself would take the hand's acceleration, which goes with the turn, for
# a delay: on ../shared/mikov 11 to 13 ms, where differences of accelerometers on the board give 7.3 to 7.8 (docs/real-recordings.md).
# The attitude within the turn takes its share of the turn's closure, as of a constant error of the rate.

#: numbers fitted to the turns: bias and delay
NUMBERS = 4
#: samples by which the sensors' filters may delay gyro and accelerometer differently
FILTERS_PERIODS = 0.5
#: false-alarm rate of a delay beyond them: a fifth of the 0.5 % at which clean sessions may get any name (benchmarks/doors.py)
ALARMS = 1e-3
#: share of a turn's greatest rate from which on it moves, and samples before and after.  What is left out shows no delay, and in it an
#: error of the tilt makes velocity all the same
MOVING, MARGIN = 0.02, 2
#: largest p-value of the held-out improvement, as for every claim
CONFIRMED_P = 0.05
#: s, length of a row of the lever arm's fit: at 200 dps gravity rotates by 5 degrees within one
ROW_S = 0.025


@dataclass(frozen=True, eq=False)
class TurnGravity:
    """Fit of gravity during turns.

    lever_m (3,); offset_s, positive if the gyro is late; sigma_s; rms of the difference between accelerometer and prediction, m/s^2, before
    and after lever arm and offset; filters_s, what filters alone may make; number of turns; held_out_p: p-value of the offset's improvement
    of held-out turns (Wilcoxon signed-rank test).
    """

    lever_m: np.ndarray
    offset_s: float
    sigma_s: float
    before_mps2: float
    after_mps2: float
    filters_s: float
    turns: int
    held_out_p: float

    @property
    def bar_s(self) -> float:
        """Offset from which on it is claimed: more than filters may make, and significant by Student's t of the turns."""
        from scipy.special import stdtrit  # late: a fit does not claim it

        return max(self.filters_s, float(stdtrit(max(self.turns - NUMBERS, 1), 1 - ALARMS / 2)) * self.sigma_s)

    @property
    def whole_sigma_s(self) -> float:
        """Sigma of the offset between the clocks: the filters' delays differ by ``filters_s`` at most, taken as three sigmas."""
        return float(np.hypot(self.sigma_s, self.filters_s / 3))

    @property
    def is_offset(self) -> bool:
        """Whether the offset between the two clocks is significant."""
        return abs(self.offset_s) > self.bar_s and self.held_out_p < CONFIRMED_P


@dataclass(frozen=True, eq=False)
class _TurnEquations:
    """Normal equations per turn of three numbers and a delay: normal (S, 4, 4), right (S, 4), square (S,) sum of squares, count (S,) of
    values.  Of ``velocity_equations`` the three are the accelerometer's bias, m/s^2, and the values level velocities, m/s."""

    normal: np.ndarray
    right: np.ndarray
    square: np.ndarray
    count: np.ndarray

    def solve(self) -> np.ndarray:
        """Solve for the three numbers and the delay, s, as (4,)."""
        return np.linalg.solve(self.normal.sum(axis=0), self.right.sum(axis=0))

    def left(self, solution: np.ndarray) -> np.ndarray:
        """(S,) residual sum of squares of each turn under a solution (4,), or each under its own (S, 4)."""
        fitted = (self.normal @ solution[..., None])[..., 0]
        return np.maximum(self.square + np.sum((fitted - 2 * self.right) * solution, axis=1), 0.0)

    def sigma_s(self) -> float:
        """Sigma of the delay: the jackknife over the turns, whose errors are independent (Efron 1982, equation 3.13)."""
        count = len(self.count)
        if count < 2:
            return np.inf
        without = self._solved_each()[:, 3]
        sigma = float(np.sqrt((count - 1) / count * np.sum((without - without.mean()) ** 2)))
        return sigma if np.isfinite(sigma) else np.inf

    def _solved_each(self) -> np.ndarray:
        """(S, 4) solutions of all turns but one; NaN where these do not determine a number."""
        normal, right = self._others()
        return np.einsum("sij,sj->si", inverse(normal), right)

    def _others(self) -> tuple[np.ndarray, np.ndarray]:
        """The sums of all turns but one, (S, 4, 4) and (S, 4)."""
        return self.normal.sum(axis=0) - self.normal, self.right.sum(axis=0) - self.right

    def improvement_p(self) -> float:
        """P-value of the delay's improvement of each turn, with all four numbers fitted to all others."""
        normal, right = self._others()
        three = np.einsum("sij,sj->si", inverse(normal[:, :3, :3]), right[:, :3])
        gains = self.left(np.pad(three, ((0, 0), (0, 1)))) - self.left(self._solved_each())
        return signed_ranks_above(gains) if len(gains) > 1 and np.isfinite(gains).all() else 1.0

    def square_at(self, offset_s: float) -> np.ndarray:
        """(S,) residual sum of squares with a given delay and the other three fitted."""
        return self.left(self.at(offset_s))

    def at(self, offset_s: float) -> np.ndarray:
        """Solve for the three numbers with a given delay; all four, (4,)."""
        three = self.normal.sum(axis=0)[:3]
        return np.append(np.linalg.solve(three[:, :3], self.right.sum(axis=0)[:3] - offset_s * three[:, 3]), offset_s)


class _Turn(NamedTuple):
    """One turn of N samples: attitude R_tb (N, 3, 3), with its share of the closure; rate (N, 3) rad/s; force (N, 3) m/s^2, as measured;
    dt_s."""

    attitude: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    dt_s: float


def _turns(twin: Twin, fit: Refit) -> Iterator[_Turn]:
    state = fit.state
    batch = twin.batch_at(state)
    padded = twin.padded(twin.rates(state))
    ends = rotation.matrix(batch.end)
    for some in residual.parts(len(batch)):
        attitudes = rotation.matrix(residual.attitudes(batch.pick(some), padded[some]))
        for i, turn in enumerate(attitudes, some.start):
            segment = twin.segments[i]
            turn = turn[: segment.stop - segment.start]
            # The rotation in the table's frame that levels the predicted end as the accelerometer does.
            vertical = turn[-1] @ ends[i, 2]
            tilt = np.array([vertical[1], -vertical[0], 0.0]) * np.linspace(0, 1, len(turn))[:, None]
            turn = turn + np.cross(tilt[:, None, :], turn, axisb=1, axisc=1)
            rate = padded[i, : len(turn)] - batch.earth[i, : len(turn)]
            force = twin.freed(state, twin.movements[segment.log].part(slice(segment.start, segment.stop)))
            yield _Turn(turn, rate, force, twin.seen.logs[segment.log].samples.period_s)


def velocity_equations(twin: Twin, fit: Refit) -> _TurnEquations:
    """Build the equations of bias and delay from the change of the level velocity in each turn, which begins and ends at rest."""
    return _equations([_velocity(turn) for turn in _turns(twin, fit)])


def _velocity(turn: _Turn) -> tuple[np.ndarray, np.ndarray]:
    attitude, rate, force, dt_s = turn
    weight = np.zeros(len(force))
    speed = np.linalg.norm(rate, axis=1)
    moving = np.flatnonzero(speed > MOVING * speed.max())
    first, last = max(moving[0] - MARGIN, 0), min(moving[-1] + MARGIN, len(weight) - 1)
    weight[first : last + 1] = dt_s
    weight[[first, last]] /= 2
    level = attitude[:, :2]
    velocity = np.einsum("t,tij,tj->i", weight, level, force)
    delayed = np.einsum("t,tij,tj->i", weight, level, np.gradient(force, dt_s, axis=0))
    return np.column_stack([np.einsum("t,tij->ij", weight, level), delayed]), velocity


def _equations(rows: Sequence[tuple[np.ndarray, np.ndarray]]) -> _TurnEquations:
    """Equations of columns (K, 4) and values (K,) of each turn."""
    return _TurnEquations(
        np.array([columns.T @ columns for columns, _ in rows]),
        np.array([columns.T @ value for columns, value in rows]),
        np.array([float(value @ value) for _, value in rows]),
        np.array([len(value) for _, value in rows]),
    )


def lever_equations(twin: Twin, fit: Refit) -> _TurnEquations:
    """Build the equations of lever arm, m, and delay from the specific force itself, in rows of ``ROW_S``.

    f(t) = -g R_bt e_down + [alpha x] r + [omega x]^2 r, read by the accelerometer later than by the gyro.  Here the hand's own acceleration
    is noise.
    """
    return _equations([_lever(turn, fit.state.gravity_mps2) for turn in _turns(twin, fit)])


def _lever(turn: _Turn, gravity_mps2: float) -> tuple[np.ndarray, np.ndarray]:
    attitude, rate, force, dt_s = turn
    alpha = np.gradient(rate, dt_s, axis=0)
    gravity = -gravity_mps2 * attitude[:, 2]
    crossed = cross_matrix(rate)
    columns = np.concatenate([cross_matrix(alpha) + crossed @ crossed, np.gradient(gravity, dt_s, axis=0)[:, :, None]], axis=-1)
    size = max(1, round(ROW_S / dt_s))
    blocks = len(force) // size

    def mean(values: np.ndarray) -> np.ndarray:
        return values[: blocks * size].reshape(blocks, size, *values.shape[1:]).mean(axis=1)

    return mean(columns).reshape(-1, 4), mean(force - gravity).ravel()


def turn_gravity(twin: Twin, fit: Refit) -> TurnGravity:
    """Estimate the delay from the velocities of all turns, and then the lever arm from the specific force with that delay."""
    rows = [(_velocity(turn), _lever(turn, fit.state.gravity_mps2)) for turn in _turns(twin, fit)]
    velocities, lever = (_equations(each) for each in zip(*rows, strict=True))
    offset_s = float(velocities.solve()[3])
    arm, count = lever.at(offset_s), lever.count.sum()
    period = float(np.median([movement.dt_s for movement in twin.movements]))
    return TurnGravity(
        lever_m=arm[:3],
        offset_s=offset_s,
        sigma_s=velocities.sigma_s(),
        before_mps2=float(np.sqrt(lever.square.sum() / count)),
        after_mps2=float(np.sqrt(lever.left(arm).sum() / count)),
        filters_s=FILTERS_PERIODS * period,
        turns=len(velocities.count),
        held_out_p=velocities.improvement_p(),
    )
