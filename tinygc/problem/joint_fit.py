"""What an estimation of accelerometer and gyroscope together gives, and the linear system where it ended."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.accelerometer.parameters import IDENTITY, NAMES, PARAMETERS, SCALES, corrected
from session.common.units import MG
from session.log.config import Accelerometer
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.least_squares import OBSERVED_BELOW
from tinygc.closure.residual import Batch
from tinygc.models import linear
from tinygc.models.linear import LinearModel

#: where the accelerometer's numbers, the gyroscope's and gravity's length stand among what is estimated
ACCELEROMETER = slice(0, PARAMETERS)
GYROSCOPE = slice(PARAMETERS, PARAMETERS + linear.PARAMETERS)
GRAVITY = GYROSCOPE.stop
COUNT = GRAVITY + 1
#: a number that differs from what it was by so many sigmas is said
SAID_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class System:
    """The linear system where the search ended.

    design (n, COUNT), values (n,): rows of the closure, S d of them, then of the lengths, in rad and m/s^2; root (n,) of their weights;
    prior (COUNT,) sigmas; x (COUNT,) where it was linearised, from the prior's centre; vague: whether the prior says nothing of the
    accelerometer, and only bounds what no row tells.
    """

    design: np.ndarray
    values: np.ndarray
    root: np.ndarray
    prior: np.ndarray
    x: np.ndarray
    vague: bool

    def solve(self, root: np.ndarray | None = None) -> np.ndarray:
        """(COUNT,) from the prior's centre.

        What noise alone lets a direction seem to do is no observation: where the prior is vague, it stays there.
        """
        root = self.root if root is None else root
        left, strength, right = np.linalg.svd(self.design * root[:, None] * self.prior, full_matrices=False)
        aim = left.T @ (root * (self.design @ self.x - self.values)) * strength / (strength**2 + 1)
        rank = int(np.sum(strength**2 > OBSERVED_BELOW**-2 - 1)) if self.vague else COUNT
        return self.prior * (aim[:rank] @ right[:rank])

    @property
    def covariance(self) -> np.ndarray:
        """(COUNT, COUNT), as if the rows erred independently."""
        scaled = self.design * self.root[:, None] * self.prior
        return np.linalg.inv(scaled.T @ scaled + np.eye(COUNT)) * np.outer(self.prior, self.prior)

    @property
    def response(self) -> np.ndarray:
        """(COUNT, n): how the estimate follows an error of each row."""
        return -self.covariance @ (self.design * self.root[:, None] ** 2).T

    @property
    def leaning(self) -> np.ndarray:
        """(COUNT, COUNT): how the estimate follows an error of what is known beforehand."""
        return self.covariance / self.prior**2


@dataclass(frozen=True, eq=False)
class JointFit:
    """mode: ``fit`` or ``prior``; accelerometer: what was found; x (9,): its correction of the one before; unobserved: names of the numbers
    that neither lengths nor turns tell; p_value: of a given calibration's lengths and closures by chance, None where it was not asked for;
    system; first, last (S,): the stills of each used segment; force (Q, 3) m/s^2 under the new calibration; before, after (Q,) m/s^2 by
    which lengths miss gravity's."""

    mode: str
    accelerometer: Accelerometer
    x: np.ndarray
    model: LinearModel
    unobserved: tuple[str, ...]
    p_value: float | None
    system: System
    first: np.ndarray
    last: np.ndarray
    force: np.ndarray
    before: np.ndarray
    after: np.ndarray

    @property
    def prior(self) -> np.ndarray:
        """(9,) sigmas of what is known of ``x`` beforehand."""
        return self.system.prior[ACCELEROMETER]

    @property
    def beforehand(self) -> np.ndarray:
        """(9, 10): how ``x`` follows one sigma of what is known of each of its numbers beforehand, and of gravity's length."""
        known = [*range(PARAMETERS), GRAVITY]
        return self.system.leaning[ACCELEROMETER][:, known] * self.system.prior[known]

    @property
    def covariance(self) -> np.ndarray:
        """(9, 9) of ``x``, as if lengths and turns erred independently."""
        return self.system.covariance[ACCELEROMETER, ACCELEROMETER]

    @property
    def words(self) -> str:
        """The numbers that differ from those before by more than three sigmas, mg at one g; the largest, where none does.

        Scales against their mean: what all axes share is gravity's length, which is not known as well.
        """
        told = np.eye(PARAMETERS)
        told[np.ix_(SCALES, SCALES)] -= 1 / 3
        scale = np.concatenate([np.full(6, 1e-3), np.full(3, MG)])
        off, sigma = told @ (self.x - IDENTITY) / scale, np.sqrt(np.diag(told @ self.covariance @ told.T)) / scale
        sure = np.abs(off) > SAID_SIGMAS * sigma
        sure[np.argmax(np.abs(off) / sigma)] = True
        found = zip(NAMES, off, sigma, sure, strict=True)
        return ", ".join(f"{name} by {value:.2g} ± {s:.1g} mg" for name, value, s, there in found if there)

    def moved(self, force: np.ndarray) -> np.ndarray:
        """Forces (..., 3) m/s^2 of the calibration before under the new one."""
        return corrected(self.x, force)

    def without(self, left_out: np.ndarray, batch: Batch) -> Batch:
        """A batch of the same segments with the references that an estimation without the closure of some (S,) bool gives."""
        root = self.system.root.copy()
        root[: len(left_out) * batch.angles][np.repeat(left_out, batch.angles)] = 0.0
        moved = self.system.solve(root)[ACCELEROMETER] - self.system.solve()[ACCELEROMETER]
        return bent(batch, self.first, self.last, corrected(IDENTITY + moved, self.force))


def bent(batch: Batch, first: np.ndarray, last: np.ndarray, force: np.ndarray) -> Batch:
    """A batch with the tilt at its ends that forces (Q, 3) of the stills give, each with the yaw that it had."""
    tilt = rotation.from_gravity(force)
    return replace(batch, start=closure.nearest_yaw(batch.start, tilt[first]), end=closure.nearest_yaw(batch.end, tilt[last]))
