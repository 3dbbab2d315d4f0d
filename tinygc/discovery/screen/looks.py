"""A look: the channels as one hypothesis sees them, its noise white, its calibration and its names taken out.

What is taken out is p directions of n.  Householder's reflections turn them onto the first p axes, so that the other n - p coordinates are
what is beside them: n p numbers, where a basis of the rest is n^2 of them, and n^3 of work.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tinygc.explanation.naming.selection import UNSEEN, orthonormal
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener

#: of the recording's scatter, what a form leaves at least: of one that takes up all, a logarithm is asked for
LEAST_LEFT = 1e-2


class Look:
    """whiten, fit: of one hypothesis beside which forms are looked for; rows (n,): of the stacked channels that are looked at, None: all.

    n rows in all, m of them free: beside the nuisance, which is what the fit has already.
    """

    def __init__(self, twin: Twin, whiten: Whitener, fit: Refit, rows: np.ndarray | None = None):
        self._made_of = twin, whiten, fit, rows
        total = sum(whiten.sizes)
        r, J, allowances = fit.r, fit.J, whiten.allowances
        known = np.concatenate([np.ravel(twin.batch.known), np.ones(whiten.sizes[1], bool), np.zeros(whiten.sizes[2], bool)])
        if rows is None:
            rows, own = np.arange(total), whiten
        else:
            own = whiten.only(rows)
            r, J, allowances = own(whiten.back(r)), own(whiten.back(J)), own(whiten.back(allowances))
        self._own = own
        self.q = orthonormal(J)
        n, p = self.q.shape
        self.free = n - p
        self._reflections = _reflections(self.q)
        beside = np.concatenate([_unit(J), _unit(allowances)], axis=1)
        self._wide, self._scale_rows = orthonormal(beside, UNSEEN), known[rows]
        #: directions that tell the noise's scale
        self.freedom = float(self._scale_rows.sum() - np.sum(self._wide[self._scale_rows] ** 2))
        #: (free,) of the recording, and its scatter
        self.residual, (self.scatter,) = self.free_of(r[:, None])[:, 0], self.scatters(r[:, None])

    def with_noise(self, whiten: Whitener) -> Look:
        """The same hypothesis under other noise."""
        twin, own, fit, rows = self._made_of
        return Look(twin, whiten, replace(fit, r=whiten(own.back(fit.r)), J=whiten(own.back(fit.J))), rows)

    def matrix(self) -> np.ndarray:
        """(n, rows) single precision: whitening and turning as one, for many columns; the first ``free`` rows see what the nuisance leaves.

        Made where it is asked for and kept by nobody: of a thousand turns 150 MB.
        """
        turned = self._turned(self._own.matrix())
        return np.concatenate([turned[len(turned) - self.free :], turned[: len(turned) - self.free]], dtype=np.float32, casting="same_kind")

    def free_of(self, whitened: np.ndarray) -> np.ndarray:
        """(free, …) of whitened channels (n, …), beside the nuisance."""
        return self._turned(whitened)[len(whitened) - self.free :]

    def seen(self, stacked: np.ndarray) -> np.ndarray:
        """(free, …) of stacked channels (n, …)."""
        return self.free_of(self.whitened(stacked))

    def whitened(self, stacked: np.ndarray) -> np.ndarray:
        """(n, …) of stacked channels (n, …)."""
        return self._own.own(stacked)

    def _turned(self, whitened: np.ndarray) -> np.ndarray:
        """(n, …) of whitened channels (n, …): first along the nuisance, then beside it."""
        from scipy.linalg.lapack import dormqr

        factored, tau = self._reflections
        columns = np.asfortranarray(whitened.reshape(len(whitened), -1))
        if not columns.shape[1] or not len(tau):
            return whitened
        room = int(dormqr("L", "T", factored, tau, columns, -1)[1][0])
        return dormqr("L", "T", factored, tau, columns, room)[0].reshape(whitened.shape)

    def beside(self, whitened: np.ndarray) -> np.ndarray:
        """Whitened channels (n, …) without what the nuisance takes of them."""
        return whitened - self.q @ (self.q.T @ whitened)

    def scatters(self, whitened: np.ndarray) -> np.ndarray:
        """(…,) sums of squares of residuals (n, …) over the rows that tell the noise's scale, as ``Selection`` takes them."""
        left = (whitened - self._wide @ (self._wide.T @ whitened))[self._scale_rows]
        return np.sum(left**2, axis=0)

    def studentised(self, gain: np.ndarray, rank: np.ndarray, scatter: np.ndarray | float) -> np.ndarray:
        """Gains (F, …) of forms of rank (F,) as they would be if the noise's scale were what the scatter says.

        For a normal law of unknown scale, twice the logarithm of how much likelier it is with a form than without, with Bartlett's factor,
        which makes a chi-square of it.  The scatter is that of some rows; the gain is of all, so it is held against as many as there are.
        """
        rank = np.minimum(rank, self.free / 2).reshape(-1, *(1,) * (gain.ndim - 1))
        share = gain / (np.asarray(scatter) * self.free / self.freedom)
        return -(self.free - (rank + 2) / 2) * np.log(np.maximum(1 - share, LEAST_LEFT))


def _reflections(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Householder's, that turn orthonormal columns (n, p) onto the first p axes, as LAPACK keeps them: (n, p) and (p,)."""
    from scipy.linalg.lapack import dgeqrf

    if not q.shape[1]:
        return q, np.zeros(0)
    factored, tau, *_ = dgeqrf(q)
    return factored, tau


def _unit(columns: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(columns, axis=0)
    return columns[:, size > 0] / size[size > 0]
