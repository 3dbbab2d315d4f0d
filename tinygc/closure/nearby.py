"""The closure of linear models near one, without its samples: second order in what they differ by.

A rate error delta_omega turns the end attitude, in the table frame, by the rotation vector (Magnus; its second term is the coning of Bortz)

    Omega = Phi + X / 2,    Phi = int u dt,    X = int_{t1 < t2} u(t1) x u(t2) dt1 dt2,    u = R_tb delta_omega.

For omega = E m + B, u is linear in the 12 parameters: Phi has 12 columns, X has 78, and none of them depends on how far a model is away.
So a swarm evaluates 90 numbers an angle instead of a thousand samples.  What is left out is of third order: an angle of 0.07 rad (a scale
factor wrong by 1 % over a turn of 270 degrees and more) errs by 1e-5 rad, one of 0.007 rad by 1e-8.
"""

from __future__ import annotations

from collections.abc import Callable
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
#: rad: a further turn by which derivatives are told; rounding and what is left out are both below 1e-8 of them
STEP_RAD = 2e-4
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

    def gathered(self, weight: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """(P, 12) to (P,): the weighted sum of squares of ``residuals``, weight (S, 2 or 3); they are taken to second order as well.

        So it is one quadratic form of 91 numbers, whatever the number of segments.
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
        """The residual (S, d) that the ends leave, and how it follows a small further turn of them: (S, d, 3) and (S, d, 3, 3)."""
        step = np.eye(3) * STEP_RAD

        def at(turn: np.ndarray) -> np.ndarray:
            return closure.batch_residual(self.batch, rotation.multiply(rotation.exp(turn), self.end))

        value = at(np.zeros(3))
        up, down = (np.stack([at(sign * one) for one in step], axis=-1) for sign in (1, -1))
        bend = np.empty((*value.shape, 3, 3))
        for i, j in zip(*np.triu_indices(3), strict=True):
            both = at(step[i] + step[j]) - at(step[i] - step[j]) - at(step[j] - step[i]) + at(-step[i] - step[j])
            bend[..., i, j] = bend[..., j, i] = both / (4 * STEP_RAD**2)
        return value, (up - down) / (2 * STEP_RAD), bend

    def with_references(self, batch: Batch) -> Nearby:
        """Of the same rates between the references of another batch: what a rate turns in the body, it turns there as well."""
        turn = rotation.multiply(batch.start, rotation.conjugate(self.batch.start))
        matrix = rotation.matrix(turn)
        phi, half_x = ((matrix @ of.T.reshape(-1, 3, len(of))).reshape(-1, len(of)).T.copy() for of in (self.phi, self.half_x))
        return Nearby(self.vector, rotation.multiply(turn, self.end), phi, half_x, batch)

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
