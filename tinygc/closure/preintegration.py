"""Rotation of a linear model omega = E m + b over short windows, without its samples.

A window's rotation vector to second order in the angle (Bortz; Savage 1998) is sum_k theta_k + 1/2 sum_{j<k} theta_j x theta_k.  With
theta_k = E a_k + b h_k, a_k the integral of m over step k of length h_k, it is a function of E, b and four sums that do not depend
on them:

    theta = E alpha + b tau + cof(E) beta + 1/2 (E gamma) x b

    alpha = sum a_k,  tau = sum h_k,  beta = 1/2 sum_{j<k} a_j x a_k + coning within the steps,  gamma = sum_{j<k} (a_j h_k - a_k h_j).

So a swarm evaluates some 60 windows a segment instead of a thousand samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc import closure
from tinygc.attitude import rotation
from tinygc.attitude.integrate import CONING, cross
from tinygc.closure.residual import Batch

#: a window ends when the measured angle or the time reaches this
WINDOW_RAD = 0.1
WINDOW_S = 0.4


@dataclass(frozen=True, eq=False)
class Windows:
    """Sums (S, W, …) over the windows of S segments, padded with empty ones, and the segments' batch."""

    alpha: np.ndarray
    tau: np.ndarray
    beta: np.ndarray
    gamma: np.ndarray
    earth: np.ndarray
    batch: Batch

    def residuals(self, E: np.ndarray, B: np.ndarray) -> np.ndarray:
        """Closure residuals (P, S, 2 or 3) of P linear models, E (P, 3, 3), B (P, 3)."""
        b = B[:, None, None] - self.earth
        Et = E.transpose(0, 2, 1)[:, None]
        cofactor_t = np.linalg.inv(E)[:, None] * np.linalg.det(E)[:, None, None, None]
        theta = self.alpha @ Et + b * self.tau[..., None] + self.beta @ cofactor_t + cross(self.gamma @ Et, b) / 2
        q_pred = rotation.multiply(
            np.broadcast_to(self.batch.start, (len(E), *self.batch.start.shape)), rotation.compose(rotation.exp(theta))
        )
        return closure.batch_residual(self.batch, q_pred)


def preintegrate(batch: Batch) -> Windows:
    """The windows of a batch."""
    m, h = batch.rate, batch.dt
    a = (m[:, :-1] + m[:, 1:]) / 2 * h[..., None]
    within = cross(m[:, :-1], m[:, 1:]) * (h**2 * CONING)[..., None]
    progress = np.cumsum(np.linalg.norm(a, axis=-1) / WINDOW_RAD + h / WINDOW_S, axis=1)
    window = np.floor(np.minimum(progress, progress[:, -1:] - 1e-9)).astype(int)
    count = int(window.max()) + 1
    sums = [_sums(window[s], a[s], h[s], within[s], batch.earth[s], count) for s in range(len(batch))]
    alpha, tau, beta, gamma, earth = (np.stack(column) for column in zip(*sums, strict=True))
    return Windows(alpha, tau, beta, gamma, earth, batch)


def _sums(window: np.ndarray, a: np.ndarray, h: np.ndarray, within: np.ndarray, earth: np.ndarray, count: int) -> tuple[np.ndarray, ...]:
    """alpha, tau, beta, gamma and the mean Earth's rate (count, …) of one segment's windows, from its T-1 steps."""

    def add(values: np.ndarray) -> np.ndarray:
        total = np.zeros((count, *values.shape[1:]))
        np.add.at(total, window, values)
        return total

    alpha, tau = add(a), add(h)
    # What came before each step within its own window: running totals less the total at the window's start.
    before_a = np.cumsum(a, axis=0) - a - (np.cumsum(alpha, axis=0) - alpha)[window]
    before_h = np.cumsum(h) - h - (np.cumsum(tau) - tau)[window]
    beta = add(cross(before_a, a) / 2 + within)
    gamma = add(before_a * h[:, None] - a * before_h[:, None])
    mean_earth = add(earth[:-1] * h[:, None]) / np.where(tau > 0, tau, 1)[:, None]
    return alpha, tau, beta, gamma, mean_earth
