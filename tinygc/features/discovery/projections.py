"""Project the channels orthogonally to a hypothesis, and find forms that are the same there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tinygc.features.discovery.enumeration import bits
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.responses import Responses
from tinygc.inference.choose import price, promised
from tinygc.inference.solve import UNSEEN, orthonormal, unit_columns
from tinygc.noise.refit import Refit
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener

# A projection: the channels under one hypothesis, whitened, without the span of its calibration and effects.
#
# The removed span has p directions of n.  Householder reflections turn it onto the first p axes, so the other n - p coordinates are the
# orthogonal complement: n p numbers, where a basis of the complement takes n^2 numbers and n^3 of work.

#: least share of the recording's scatter that a form leaves, so that the logarithm is finite
LEAST_LEFT = 1e-2


class Projection:
    """whiten, fit: of the hypothesis against which forms are tested; rows (n,): of the stacked channels that are used, None: all.

    n rows in all, m of them free: orthogonal to the nuisance parameters, which are those of the fit.
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
        known_columns = np.concatenate([unit_columns(J), unit_columns(allowances)], axis=1)
        self._wide, self._scale_rows = orthonormal(known_columns, UNSEEN), known[rows]
        #: directions that determine the noise's scale
        self.freedom = float(self._scale_rows.sum() - np.sum(self._wide[self._scale_rows] ** 2))
        #: (free,) of the recording, and its scatter
        self.residual, (self.scatter,) = self.free_of(r[:, None])[:, 0], self.scatters(r[:, None])

    def with_noise(self, whiten: Whitener) -> Projection:
        """The same hypothesis under other noise."""
        twin, own, fit, rows = self._made_of
        return Projection(twin, whiten, replace(fit, r=whiten(own.back(fit.r)), J=whiten(own.back(fit.J))), rows)

    def matrix(self) -> np.ndarray:
        """(n, rows) single precision: whitening and rotation as one, for many columns; the first ``free`` are orthogonal to the nuisance.

        Computed on demand and not cached: 150 MB for a thousand turns.
        """
        turned = self._turned(self._own.matrix())
        return np.concatenate([turned[len(turned) - self.free :], turned[: len(turned) - self.free]], dtype=np.float32, casting="same_kind")

    def free_of(self, whitened: np.ndarray) -> np.ndarray:
        """Project whitened channels (n, …) orthogonally to the nuisance, (free, …)."""
        return self._turned(whitened)[len(whitened) - self.free :]

    def seen(self, stacked: np.ndarray) -> np.ndarray:
        """Whiten and project stacked channels (n, …), (free, …)."""
        return self.free_of(self.whitened(stacked))

    def whitened(self, stacked: np.ndarray) -> np.ndarray:
        """Whiten stacked channels (n, …)."""
        return self._own.own(stacked)

    def _turned(self, whitened: np.ndarray) -> np.ndarray:
        """Rotate whitened channels (n, …): first the rows along the nuisance, then those orthogonal to it."""
        from scipy.linalg.lapack import dormqr

        factored, tau = self._reflections
        columns = np.asfortranarray(whitened.reshape(len(whitened), -1))
        if not columns.shape[1] or not len(tau):
            return whitened
        room = int(dormqr("L", "T", factored, tau, columns, -1)[1][0])
        return dormqr("L", "T", factored, tau, columns, room)[0].reshape(whitened.shape)

    def left_of(self, whitened: np.ndarray) -> np.ndarray:
        """Whitened channels (n, …) without their part along the nuisance."""
        return whitened - self.q @ (self.q.T @ whitened)

    def scatters(self, whitened: np.ndarray) -> np.ndarray:
        """Sums of squares (…,) of residuals (n, …) over the rows that determine the noise's scale, as ``Selection`` takes them."""
        left = (whitened - self._wide @ (self._wide.T @ whitened))[self._scale_rows]
        return np.sum(left**2, axis=0)

    def studentised(self, gain: np.ndarray, rank: np.ndarray, scatter: np.ndarray | float) -> np.ndarray:
        """Gains (F, …) of forms of rank (F,) with the noise's scale estimated from the scatter.

        This is twice the log likelihood ratio of a normal law of unknown scale with and without the form, with Bartlett's factor, which
        makes it a chi-square.  The scatter is of some rows and the gain of all, so the scatter is scaled to the number of rows.
        """
        rank = np.minimum(rank, self.free / 2).reshape(-1, *(1,) * (gain.ndim - 1))
        share = gain / (np.asarray(scatter) * self.free / self.freedom)
        return -(self.free - (rank + 2) / 2) * np.log(np.maximum(1 - share, LEAST_LEFT))


def _reflections(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Householder reflections that turn orthonormal columns (n, p) onto the first p axes, in LAPACK's form: (n, p) and (p,)."""
    from scipy.linalg.lapack import dgeqrf

    if not q.shape[1]:
        return q, np.zeros(0)
    factored, tau, *_ = dgeqrf(q)
    return factored, tau


# From a form's columns to its promise.

#: least share of a direction outside the nuisance for it to be visible.  Beyond a calibration, a rate leaves its own noise, 2e-4, which is
#: also in the residuals; the faintest law, a dead zone of a hundredth of the range, leaves 2e-2
FAINT = 5e-3


def price_of(form: LawForm) -> float:
    """What the evidence pays for a form, which its description finds among two to the power of its bits; constants cost their grid alone.

    It guides the search: a law that is put in is found from half the size on, against one price for all forms.
    """
    return float(price(form.size, 2 ** bits(form)))


def promise(gain: np.ndarray, rank: np.ndarray, price: np.ndarray) -> np.ndarray:
    """Twice the logarithm of the evidence that forms would add: gain (F, …), rank (F,), price (F,)."""
    rank, price = (each.reshape(-1, *(1,) * (gain.ndim - 1)) for each in (np.maximum(rank, 1), price))
    return np.asarray(promised(gain, rank) - price)


def seen_directions(free: np.ndarray, length: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """weights (F, P, P), rank (F,) and left (F,) of forms' columns: free (F, P, m) orthogonal to the nuisance, length (F, P) with it.

    ``weights @ free`` are orthonormal rows, then zeros: a direction of which less than ``FAINT`` is outside the nuisance is dropped, as
    ``evidence.left_of`` does; left: the visible share of the columns' squared length.
    """
    length = np.where(length > 0, length, 1.0).astype(float)
    unit = free / length[:, :, None]
    size, turn = np.linalg.eigh(unit @ unit.transpose(0, 2, 1))
    size, turn = size[:, ::-1], turn[:, :, ::-1]
    kept = size > FAINT**2
    scale = np.where(kept, 1 / np.sqrt(np.where(kept, size, 1.0)), 0.0)
    weights = (turn * scale[:, None, :] / length[:, :, None]).transpose(0, 2, 1)
    return weights, kept.sum(axis=1), np.sum(size * kept, axis=1) / size.shape[1]


# Forms that are the same in this recording: their projected columns span the same directions.
#
# Gains in draws of noise depend on the span alone.  For two forms of one rank, the mean square of their gains' difference is four times
# the sum of the squared sines of the angles between them, so a few dozen draws show which forms are near, whatever their columns.

#: cosine of the largest angle between two forms that are the same
SAME = 0.99
#: mean square of the difference of their gains
NEAR = 4 * (1 - SAME**2)
#: margin on that for its sampling error of about a quarter: pairs within it are compared exactly
SLACK = 3.0
#: forms that are compared at once, and those that are compared exactly
AT_ONCE, MOST_CLOSE = 1024, 400


def leaders(marks: np.ndarray, rank: np.ndarray) -> np.ndarray:
    """Number (F,) of the first form near each form; -1 where its rank is 0.  marks (F, D): gains in draws; rank (F,)."""
    found = np.full(len(marks), -1)
    for own_rank in np.unique(rank[rank > 0]):
        members = np.flatnonzero(rank == own_rank)
        led = np.zeros(0, dtype=int)
        for first in range(0, len(members), AT_ONCE):
            some = members[first : first + AT_ONCE]
            if len(led):
                distance = _distances(marks[some], marks[led])
                nearest = np.argmin(distance, axis=1)
                near = distance[np.arange(len(some)), nearest] < NEAR
                found[some[near]] = led[nearest[near]]
                some = some[~near]
            close = _distances(marks[some], marks[some]) < NEAR
            new = []
            for number, form in enumerate(some.tolist()):
                if found[form] < 0:
                    new.append(form)
                    free = close[number] & (found[some] < 0)
                    found[some[free]] = form
            led = np.concatenate([led, np.array(new, dtype=int)])
    return found


def _distances(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Mean squares (A, B) of the differences of rows."""
    squares = np.sum(one**2, axis=1)[:, None] + np.sum(other**2, axis=1)
    return (squares - 2 * one @ other.T) / one.shape[1]


def basis_of(form: LawForm, responses: Responses, projection: Projection) -> np.ndarray:
    """Orthonormal basis (m, r) of a form's span in a projection."""
    return seen_basis(responses.columns(form), projection)


def seen_basis(columns: np.ndarray, projection: Projection) -> np.ndarray:
    """Orthonormal basis (m, r) of the projected span of stacked columns (n, P)."""
    whitened = projection.whitened(columns)
    length = np.linalg.norm(whitened, axis=0)
    return orthonormal(projection.free_of(whitened[:, length > 0] / length[length > 0]), FAINT, scaled=False)


def equivalent_forms(
    form: LawForm,
    responses: Responses,
    projection: Projection,
    noise: np.ndarray,
    marks: np.ndarray,
    rank: np.ndarray,
    forms: Sequence[LawForm],
) -> list[int]:
    """Numbers of the forms with the same span as this one; noise (n, D): the draws whose gains are marks (F, ≤ D)."""
    basis = basis_of(form, responses, projection)
    if not basis.shape[1]:
        return []
    own = np.sum((basis.T @ projection.free_of(noise[:, : marks.shape[1]])) ** 2, axis=0)
    distance = np.mean((marks - own) ** 2, axis=1)
    near = np.flatnonzero((rank == basis.shape[1]) & (distance < SLACK * NEAR))
    near = near[np.argsort(distance[near], kind="stable")][:MOST_CLOSE]
    return [number for number in near.tolist() if overlap(basis, basis_of(forms[number], responses, projection)) > SAME]


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Cosine of the largest principal angle between orthonormal bases (m, r); 0 where they differ in rank."""
    if one.shape != other.shape or not one.shape[1]:
        return 0.0
    return float(np.linalg.svd(one.T @ other, compute_uv=False)[-1])
