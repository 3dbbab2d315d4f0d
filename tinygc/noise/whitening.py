"""The covariance of all channels together, and whitening with it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from copy import copy
from functools import cached_property
from itertools import islice

import numpy as np

from session.base import rotation
from session.base.units import MG
from tinygc.inference.noise import Banded, Sparse
from tinygc.inference.solve import inverse_lower, solve_lower
from tinygc.noise.twin import Twin

# Sparse covariances: importing ``scipy.sparse`` takes longer than a fit.


# The covariance of all channels together, and whitening with it.
#
# Gyro and accelerometer noise are measured in the short-time scatter of the stills.  The segments contain part of the stills at their ends,
# so they share gyro noise.  Non-white noise is added as further covariance (``tinygc/noise/components.py``).

#: drift of a MEMS accelerometer of this class within minutes; it limits the information in the length of gravity.  It is conservative:
#: lengths scatter less in benchmarks/doors.py, so it causes no false alarm
ACCEL_INSTABILITY_MPS2 = 0.03 * MG
#: sigma of a pre-calibration, at zero g and at one g: the zero-g level alone changes by 0.1 mg per degC (data sheet)
PRECALIBRATION_MPS2 = 0.1 * MG
#: m/s^2: prior of accelerometer parameters that were estimated from the same stills, far above their uncertainty
OPEN_MPS2 = 100 * PRECALIBRATION_MPS2
#: groups of columns that are whitened at once (benchmarks/whole_process.py)
TOGETHER = 64
#: rows from which on a covariance is factored in its own place, at 40 % of the time: its import takes longer than fewer rows do
MANY_ROWS = 1500


class Whitener:
    """Cholesky factor of the covariance of ``Channels.stacked()``; sizes of the three channels.

    base: white noise and the pre-calibration's allowance.
    """

    def __init__(self, twin: Twin):
        s, d, q = len(twin.segments), twin.batch.angles, len(twin.stills)
        self.sizes = s * d, 3 * q, q
        self.parts = {"closure": slice(0, s * d), "still": slice(s * d, s * d + 3 * q), "length": slice(s * d + 3 * q, s * d + 4 * q)}
        self._allowances = _precalibration(twin)
        self.base = Banded(Sparse.of(_covariance(twin)), self._allowances)
        self._rows: slice | np.ndarray = slice(None)

    @property
    def white(self) -> np.ndarray:
        """(n, n) of ``base``, a copy."""
        return self.base.dense()

    @cached_property
    def _factor(self) -> np.ndarray:
        return _factored(self.white)

    @cached_property
    def allowances(self) -> np.ndarray:
        """(n, m) whitened: directions in which the covariance is larger than most recordings need."""
        return self(self._allowances)

    def __call__(self, stacked: np.ndarray) -> np.ndarray:
        """Rows of unit variance, uncorrelated."""
        return self.own(stacked[self._rows])

    def own(self, rows: np.ndarray) -> np.ndarray:
        """Whiten the selected rows alone (``only``)."""
        return solve_lower(self._factor, rows)

    def matrix(self) -> np.ndarray:
        """(n, n) ``own`` as a lower triangular matrix, recomputed on each call."""
        return inverse_lower(self._factor)

    def back(self, whitened: np.ndarray) -> np.ndarray:
        """Invert the whitening of stacked channels (n,) or (n, m)."""
        return self._factor @ whitened

    def with_more(self, more: np.ndarray) -> Whitener:
        """Replace the covariance (n, n) added to white noise, an array that is used up: with many turns, each further one is as much
        memory as all else."""
        other = copy(self)
        for name in ("allowances", "_own_factors", "precision"):
            other.__dict__.pop(name, None)
        self.base.add_to(more)
        other._factor = _factored(more)
        return other

    def each(self, columns: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
        """Whiten columns (n, P) in groups, which is several times faster than one by one."""
        groups = iter(columns)
        while some := list(islice(groups, TOGETHER)):
            edges = np.cumsum([each.shape[1] for each in some])[:-1]
            yield from np.split(self(np.concatenate(some, axis=1)), edges, axis=1)

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) covariance of the stacked channels."""
        return self._factor @ self._factor.T

    def carried(self, response: np.ndarray) -> np.ndarray:
        """Covariance (k, k) of what responds by ``response`` (k, n) to the stacked channels."""
        root = response @ self._factor
        return root @ root.T

    @cached_property
    def precision(self) -> np.ndarray:
        """(n, n), the inverse of the covariance."""
        from scipy.linalg.lapack import dpotri

        lower, _ = dpotri(self._factor, lower=True)
        return np.tril(lower) + np.tril(lower, -1).T

    def pulled(self, whitened: np.ndarray) -> np.ndarray:
        """The precision times stacked channels, from the whitened ones (n,) or (n, m)."""
        from scipy.linalg import solve_triangular

        return solve_triangular(self._factor, whitened, lower=True, trans="T", check_finite=False)

    def by_channel(self, whitened: np.ndarray) -> np.ndarray:
        """Convert rows (n,) or (n, m) from joint whitening to whitening by each channel's own covariance."""
        stacked = self.back(whitened)
        alone = np.empty_like(stacked)
        for name, part in self.parts.items():
            alone[part] = solve_lower(self._own_factors[name], stacked[part])
        return alone

    @cached_property
    def _own_factors(self) -> dict[str, np.ndarray]:
        roots = {name: self._factor[part, : part.stop] for name, part in self.parts.items()}
        return {name: np.linalg.cholesky(root @ root.T) for name, root in roots.items()}

    def only(self, rows: np.ndarray) -> Whitener:
        """A whitener of the selected rows (n,) bool alone; the others are marginalised."""
        part = copy(self)
        part._rows = rows
        part.__dict__.pop("allowances", None)
        part._factor = np.linalg.cholesky(self._factor[rows] @ self._factor[rows].T)
        return part

    @property
    def sigma(self) -> np.ndarray:
        """(n,) standard deviation of each row before whitening."""
        return np.sqrt(np.sum(self._factor**2, axis=1))


def _factored(covariance: np.ndarray) -> np.ndarray:
    """Lower Cholesky factor (n, n) of a covariance, which is used up."""
    if len(covariance) < MANY_ROWS:
        return np.linalg.cholesky(covariance)
    from scipy.linalg import cholesky

    return cholesky(covariance.T, overwrite_a=True, check_finite=False).T


def _covariance(twin: Twin) -> np.ndarray:
    problem, batch = twin.problem, twin.batch
    s, d, q = len(twin.segments), batch.angles, len(twin.stills)
    full = np.zeros((s * d + 4 * q, s * d + 4 * q))
    full[: s * d, : s * d] = problem.floor.dense()
    if not q:
        return full
    turn = rotation.matrix(twin.q_tb)
    walk = np.array([problem.logs[log].noise.angle_random_walk ** 2 for log, _ in twin.stills])
    duration = np.array([still.duration_s for _, still in twin.stills])
    for number in range(q):
        at = s * d + 3 * number
        full[at : at + 3, at : at + 3] += np.diag(walk[number] / duration[number])
    for i, segment in enumerate(twin.segments):
        for number in (twin.first[i], twin.last[i]):
            log, still = twin.stills[number]
            period = problem.logs[log].samples.period_s
            shared_s = max(0, min(segment.stop, still.stop) - max(segment.start, still.start)) * period
            block = (twin.axes[i, :d] @ turn[number] * walk[number]) * shared_s / duration[number]
            rows, at = slice(i * d, i * d + d), s * d + 3 * number
            full[rows, at : at + 3] += block
            full[at : at + 3, rows] += block.T
    for number, (log, still) in enumerate(twin.stills):
        variance = float(np.mean(problem.logs[log].noise.velocity_random_walk ** 2)) / still.duration_s + ACCEL_INSTABILITY_MPS2**2
        full[s * d + 3 * q + number, s * d + 3 * q + number] = variance
    return full


def _precalibration(twin: Twin) -> np.ndarray:
    """(n, 12) effect of one sigma each of the accelerometer's bias and matrix errors, constant over the session."""
    start = twin.start()
    if not twin.stills:
        return np.zeros((len(twin.segments) * twin.batch.angles, 0))
    return twin.precalibration_columns(start, twin.rates(start)).stacked() * PRECALIBRATION_MPS2
