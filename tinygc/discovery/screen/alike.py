"""Forms that are the same in this recording: their columns, as a look sees them, span the same directions.

Gains in draws of noise hang on the span alone.  Of two forms of one rank, the mean square of their gains' difference is four times the sum
of the squared sines of the angles between them, so a few dozen draws tell which forms are near, whatever their columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.looks import Look
from tinygc.discovery.screen.responses import Responses
from tinygc.discovery.screen.weighing import FAINT
from tinygc.explanation.naming.selection import orthonormal

#: cosine of the largest angle between two forms that are the same
SAME = 0.99
#: mean square of the difference of their gains
NEAR = 4 * (1 - SAME**2)
#: of draws, which miss that by a quarter or so: how much farther is worth a closer look
SLACK = 3.0
#: forms that are compared at once, and those that are looked at closely
AT_ONCE, MOST_CLOSE = 1024, 400


def leaders(marks: np.ndarray, rank: np.ndarray, bits: np.ndarray) -> np.ndarray:
    """(F,) of each form the simplest that is near it; -1 where its rank is 0.  marks (F, D): gains in draws; rank, bits (F,)."""
    found = np.full(len(marks), -1)
    for own_rank in np.unique(rank[rank > 0]):
        members = np.flatnonzero(rank == own_rank)
        members = members[np.argsort(bits[members], kind="stable")]
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
    """(A, B) mean squares of the differences of rows."""
    squares = np.sum(one**2, axis=1)[:, None] + np.sum(other**2, axis=1)
    return (squares - 2 * one @ other.T) / one.shape[1]


def basis_of(form: Form, responses: Responses, look: Look) -> np.ndarray:
    """(m, r) orthonormal: what a look sees of a form."""
    return seen_basis(responses.columns(form), look)


def seen_basis(columns: np.ndarray, look: Look) -> np.ndarray:
    """(m, r) orthonormal, of stacked columns (n, P)."""
    whitened = look.whitened(columns)
    length = np.linalg.norm(whitened, axis=0)
    return orthonormal(look.free_of(whitened[:, length > 0] / length[length > 0]), FAINT, scaled=False)


def alike(
    form: Form, responses: Responses, look: Look, noise: np.ndarray, marks: np.ndarray, rank: np.ndarray, forms: Sequence[Form]
) -> list[int]:
    """Numbers of the forms that span what this one does; noise (n, D): of which marks (F, ≤ D) are the gains."""
    basis = basis_of(form, responses, look)
    if not basis.shape[1]:
        return []
    own = np.sum((basis.T @ look.free_of(noise[:, : marks.shape[1]])) ** 2, axis=0)
    distance = np.mean((marks - own) ** 2, axis=1)
    near = np.flatnonzero((rank == basis.shape[1]) & (distance < SLACK * NEAR))
    near = near[np.argsort(distance[near], kind="stable")][:MOST_CLOSE]
    return [number for number in near.tolist() if overlap(basis, basis_of(forms[number], responses, look)) > SAME]


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Cosine of the largest principal angle between orthonormal bases (m, r); 0 where they differ in rank."""
    if one.shape != other.shape or not one.shape[1]:
        return 0.0
    return float(np.linalg.svd(one.T @ other, compute_uv=False)[-1])
