"""Turns between two rests as closures: the integrated attitude against gravity at both ends.

    tilt    y = f_start x R f_end / g^2                                     R: integrated rotation, body at the end to body at the start
            = across gravity: integral R (dE m) dt + [f_start]x (R - 1) b / g + seconds a + noise

dE (9) and the accelerometer's zero b (3) are one draw for all turns of a stream, so a Kalman filter whitens y; a CUSUM looks for a scatter
of twice the stated sigma.  a is what each turn has of its own, mostly the Earth's rate across the vertical: that turns the reference too,
and no rest shows it without its azimuth.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from session.base import rotation
from session.base.units import DEG
from tinygc.features.unit.watch.bars import bar_of, squares_run_length
from tinygc.features.unit.watch.expectation import TESTS, Expectation
from tinygc.models.linear import MATRIX

#: sigma of the tilt's scatter that the test looks for, over the stated
RATIO = 2.0
#: chi-square of one turn that counts: one turn alone never reaches a bar
MOST_SQUARE = 25.0
#: one sigma by which E's elements differ between two days: scale factors change by some 20 ppm/K
USUAL_MATRIX = 2e-4
#: s and rad: the drift of a longer turn, and a smaller one, show nothing of E
LONGEST_S, LEAST_RAD = 600.0, 10 * DEG


class Turn:
    """One turn while it goes on: rotation q (4,) of the body to its start, derivative of the attitude by E (3, 9), seconds, angle rad.

    applied (9,): error of E that earlier turns show, which is taken off the rates, so that what is left is small and linear.
    """

    def __init__(self, applied: np.ndarray | None = None) -> None:
        self.applied = np.zeros(9) if applied is None else applied
        self.q = np.array([1.0, 0.0, 0.0, 0.0])
        self.slope = np.zeros((3, 9))
        self.lever = np.zeros((3, 3))  # of a zero error, s
        self.seconds = self.angle = 0.0
        self._last: tuple[np.ndarray, np.ndarray] | None = None  # sample from which the next step goes

    def add(self, omega: np.ndarray, measured: np.ndarray, dt: np.ndarray) -> None:
        """Add samples: calibrated and measured rate (N, 3) rad/s, both less that of the rest; dt (N,) s since the sample before each."""
        omega = omega - measured @ self.applied.reshape(3, 3).T
        if self._last is None:
            dt = dt[1:]
        else:
            omega, measured = (np.concatenate([last[None], new]) for last, new in zip(self._last, (omega, measured), strict=True))
        self._last = omega[-1], measured[-1]
        if not len(dt):
            return
        partial = rotation.multiply(self.q, rotation.accumulate(rotation.steps(omega, dt)))
        turn = rotation.matrix(np.concatenate([self.q[None], partial[:-1]])) * dt[:, None, None]
        self.q = partial[-1] / np.linalg.norm(partial[-1])
        self.slope += np.einsum("nij,nk->ijk", turn, (measured[:-1] + measured[1:]) / 2).reshape(3, 9)
        self.lever += turn.sum(axis=0)
        self.seconds += float(dt.sum())
        self.angle += float(np.sum(np.linalg.norm(omega[1:], axis=1) * dt))


class Closure(NamedTuple):
    """A tested turn: tilt_rad (3,) across gravity, axes of its start; sigma_rad, stated, of each of its two components; square: chi-square
    of 2 degrees of freedom; alarm: whether the test has passed its bar."""

    tilt_rad: np.ndarray
    sigma_rad: float
    square: float
    alarm: bool


class TurnTest:
    """Tests one turn after another."""

    def __init__(self, expected: Expectation, windows_to_alarm: float):
        """windows_to_alarm: mean number of windows to a false alarm of all tests; there are no more turns than windows."""
        own = expected.parameters[MATRIX, MATRIX] + USUAL_MATRIX**2 * np.eye(9)
        self._prior = np.zeros((12, 12))
        self._prior[:9, :9] = own
        self._prior[9:, 9:] = np.diag(expected.accel.offset**2)
        self._expected, self.P, self.x = expected, self._prior.copy(), np.zeros(12)
        self.bar, self.sum = bar_of(squares_run_length, TESTS * windows_to_alarm, RATIO, 2), 0.0
        self._share = 0.0

    def evaluate(self, turn: Turn, start: np.ndarray, end: np.ndarray, zero_variance: float, window_s: float) -> Closure:
        """Test a turn; start, end (3,): force of the rests, in g; zero_variance (rad/s)^2 of each axis; window_s: of a rest's mean."""
        e = self._expected
        R = rotation.matrix(turn.q)
        up = start / np.linalg.norm(start)
        tilt = np.cross(up, R @ (end / np.linalg.norm(end)))
        across = np.linalg.svd(up[None])[2][1:]  # (2, 3) two directions across gravity
        y = across @ tilt
        H = np.column_stack([across @ turn.slope, across @ rotation.cross_matrix(up) @ (R - np.eye(3)) / e.gravity_mps2])
        readings = 2 * (np.max(np.square(e.accel.attitude)) + np.max(e.accel.white**2) / window_s) / e.gravity_mps2**2
        own = np.max(e.gyro.white**2) * turn.seconds + np.max(np.square(e.gyro.attitude)) * turn.seconds**2 + e.turn_rad**2 + readings
        lever = across @ turn.lever
        noise = own * np.eye(2) + zero_variance * lever @ lever.T
        S = self._expected_scatter(turn, H, noise)
        innovation = y - H @ (self.x - np.r_[turn.applied, np.zeros(3)])
        square = float(innovation @ np.linalg.solve(S, innovation))
        # how much larger than the prior E's error is, in variance, if it is E: of the worst of the turns that the sum is of
        of_prior = max(float(np.trace(H[:, :9] @ self._prior[:9, :9] @ H[:, :9].T)), 1e-12)
        own_share = float(innovation @ innovation) / of_prior
        self._share = max(own_share, self._share if self.sum > 0 else 0.0)
        self.sum = max(0.0, self.sum + min(square, MOST_SQUARE) * (1 - RATIO**-2) / 2 - 2 * np.log(RATIO))
        alarm = self.sum >= self.bar
        stated_rad = float(np.sqrt(np.trace(S) / 2))
        if alarm:  # E, or the accelerometer's zero, is another one, by as much as these turns show
            self.sum, self.P = 0.0, self.P + self._share * self._prior
            S = self._expected_scatter(turn, H, noise)
        if alarm or square < MOST_SQUARE:
            gain = np.linalg.solve(S, H @ self.P).T
            self.x = self.x + gain @ innovation
            left = np.eye(12) - gain @ H
            self.P = left @ self.P @ left.T + gain @ (S - H @ self.P @ H.T) @ gain.T
        return Closure(tilt, stated_rad, square, bool(alarm))

    def _expected_scatter(self, turn: Turn, H: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """(2, 2) covariance of the innovation: what P leaves open, in first and second order, and noise."""
        unknown = np.trace(turn.slope @ self.P[:9, :9] @ turn.slope.T)  # rad^2, of the attitude
        return H @ self.P @ H.T + noise + unknown**2 * np.eye(2)
