"""The closure of linear models near one, without its samples: second order in what they differ by.

A rate error delta_omega turns the end attitude, in the table frame, by the rotation vector (Magnus; its second term is the coning of Bortz)

    Omega = Phi + X / 2,    Phi = int u dt,    X = int_{t1 < t2} u(t1) x u(t2) dt1 dt2,    u = R_tb delta_omega.

For omega = E m + B, u is linear in the 12 parameters: Phi has 12 columns, X has 78, and none of them depends on how far a model is away.
So a swarm evaluates 90 numbers an angle instead of a thousand samples.  What is left out is of third order: an angle of 0.07 rad (a scale
factor wrong by 1 % over a turn of 270 degrees and more) errs by 1e-5 rad, one of 0.007 rad by 1e-8.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.residual import Batch
from tinygc.models.linear import PARAMETERS, LinearModel

#: pairs of parameters, each once
FIRST, SECOND = np.triu_indices(PARAMETERS)
#: segments whose columns along the way are held at once: some megabytes
TOGETHER = 4
#: segments that a swarm is looked at with at once: what is multiplied stays in the processor's cache
AT_ONCE = 100


@dataclass(frozen=True, eq=False)
class Nearby:
    """About a vector (12,): end (S, 4) q_tb, phi (12, S 3) rad and half_x (78, S 3) rad, of a batch of S segments."""

    vector: np.ndarray
    end: np.ndarray
    phi: np.ndarray
    half_x: np.ndarray
    batch: Batch

    @classmethod
    def about(cls, model: LinearModel, batch: Batch) -> Nearby:
        """Of a batch, about a model."""
        # In the table frame: known angles are measured about axes of their own.
        end, sensitivity = closure.end_and_sensitivity(replace(batch, turns=None), model(batch.rate))
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

    def residuals(self, vectors: np.ndarray) -> np.ndarray:
        """Closure residuals (P, S, 2 or 3) of models (P, 12)."""
        delta = vectors - self.vector
        omega = delta @ self.phi + (delta[:, FIRST] * delta[:, SECOND]) @ self.half_x
        turns, found = omega.reshape(len(vectors), -1, 3), []
        for first in range(0, len(self.batch), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            ends = rotation.multiply(rotation.exp(turns[:, some]), self.end[some])
            found.append(closure.batch_residual(self.batch.pick(some), ends))
        return np.concatenate(found, axis=1)


def _along(sensitivity: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """(S, 3, 12, T) rad per unit: what each parameter turns during each sample; sensitivity (S, T, 3, 3), measured rates (S, T, 3)."""
    by_time = sensitivity.transpose(0, 2, 3, 1)  # (S, 3, 3, T)
    measured = rate.transpose(0, 2, 1)[:, None, None]
    matrix = (by_time[:, :, :, None] * measured).reshape(len(rate), 3, 9, -1)
    return np.concatenate([matrix, by_time], axis=2)


def _crossed(u: np.ndarray) -> np.ndarray:
    """(S, 3, 78) of X: the coefficient of each pair's product."""
    count, _, parameters, samples = u.shape
    before = np.cumsum(u, axis=-1) - u / 2
    rows = (count, 3 * parameters, samples)
    product = (before.reshape(rows) @ u.reshape(rows).swapaxes(1, 2)).reshape(count, 3, parameters, 3, parameters)
    crossed = np.stack([product[:, j, :, k] - product[:, k, :, j] for j, k in ((1, 2), (2, 0), (0, 1))], axis=1)
    both = crossed + crossed.swapaxes(2, 3)
    both[:, :, range(parameters), range(parameters)] /= 2
    return both[:, :, FIRST, SECOND]
