"""A claim stays only if what the fit never saw improves with it by more than chance, paired by segments.

Each segment is left out together with the stills at its ends; all its rows are predicted with the claim and without it, everything else
fitted anew both times.  A scanned shape (the moment of a step, the frequency of a line) is searched for anew, too: one that was found with
the left-out rows improves them by chance.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

import numpy as np
from scipy import stats

from tinygc.explanation.naming.candidates import scanned
from tinygc.explanation.naming.evidence import Evidence, Hypothesis
from tinygc.explanation.twin.layout import claim_slice
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import TOGETHER, Whitener
from tinygc.explanation.verdict.proof import fold_rows, folds_of, left_out

#: a claim whose improvement chance makes in one recording of twenty is not borne out
BORNE_OUT_P = 0.05


def borne_out(evidence: Evidence, have: Hypothesis, number: int) -> bool:
    """Whether a claim of a hypothesis improves what was left out."""
    effect, prior = have.effects[number], evidence.prior(have.fit)
    shapes = None
    if effect.scan is not None:
        shapes = have.whiten.each(map(evidence.columns, effect.variants(scanned(evidence.twin, effect))))
    return improvement_p(evidence.twin, have, prior, number, shapes) < BORNE_OUT_P


def improvement_p(twin: Twin, have: Hypothesis, prior: np.ndarray, number: int, shapes: Iterable[np.ndarray] | None = None) -> float:
    """Probability that chance improves the left-out segments as much as a claim does (Wilcoxon's signed ranks, one-sided).

    prior (p,): of all parameters of the hypothesis.  shapes: whitened columns (n, P) of every shape that the claim might have had.
    """
    whiten, fit = have.whiten, have.fit
    part = claim_slice(fit.state.claims, number)
    J = fit.J * prior
    fewer = np.delete(J, part, axis=1)
    r = fit.r - fit.J[:, part] @ fit.state.claims[number].theta
    r = r - fewer @ np.linalg.solve(fewer.T @ fewer + np.eye(fewer.shape[1]), fewer.T @ r)
    if shapes is not None:
        with_it = _left_out_and_searched(twin, whiten, r, fewer, (shape * prior[part] for shape in shapes))
    else:
        with_it = left_out(twin, whiten, fit.r, J)
    gains = per_segment(twin, have, left_out(twin, whiten, r, fewer)) - per_segment(twin, have, with_it)
    return float(stats.wilcoxon(gains, alternative="greater").pvalue) if np.any(gains) else 1.0


def _left_out_and_searched(twin: Twin, whiten: Whitener, r: np.ndarray, J: np.ndarray, shapes: Iterable[np.ndarray]) -> np.ndarray:
    """(n,) stacked, as ``left_out``, with columns J (n, p) and that one of the shapes, each (n, P), that the seen rows ask for most."""
    folds = [_Fold(twin, whiten, r, J, held) for held in folds_of(len(twin.segments))]
    stacked_J, stacked_r = whiten.back(J), whiten.back(r)
    shapes = iter(shapes)
    while some := list(islice(shapes, TOGETHER)):  # there may be thousands
        columns = np.concatenate(some, axis=1)
        pulled, stacked = whiten.pulled(columns), whiten.back(columns)
        for fold in folds:
            fold.try_shapes(columns, pulled, stacked, some[0].shape[1])
    found = np.full(len(r), np.nan)
    for fold in folds:
        found[fold.rows] = stacked_r[fold.rows] - stacked_J[fold.rows] @ fold.theta_J - fold.of_shape
    return found


class _Fold:
    """What the rows that one fold sees ask for: theta_J (p,) of the columns J, and of_shape (k,), the best shape so far in the k rows that
    it does not see, stacked."""

    def __init__(self, twin: Twin, whiten: Whitener, r: np.ndarray, J: np.ndarray, held: np.ndarray):
        self.rows = rows = np.flatnonzero(~fold_rows(twin, whiten, held))
        # Inner products of the seen rows alone: each held-out row has a free number of its own.
        self._precision = whiten.precision[np.ix_(rows, rows)]
        self._r, self._J, self._pulled_J = r, J, whiten.pulled(J)[rows]
        free = np.linalg.solve(self._precision, np.column_stack([self._pulled_J, whiten.pulled(r)[rows]]))
        self._free_r = free[:, -1]
        self._inverse = np.linalg.inv(J.T @ J - self._pulled_J.T @ free[:, :-1] + np.eye(J.shape[1]))
        self._right_J = J.T @ r - self._pulled_J.T @ self._free_r
        self.theta_J, self.of_shape, self._least = self._inverse @ self._right_J, np.zeros(len(rows)), 0.0

    def try_shapes(self, columns: np.ndarray, pulled: np.ndarray, stacked: np.ndarray, size: int) -> None:
        """Whitened columns (n, V size) of V shapes, pulled and stacked: whether one is asked for more than those before."""
        pulled, free = pulled[self.rows], np.linalg.solve(self._precision, pulled[self.rows])
        common = self._J.T @ columns - self._pulled_J.T @ free
        right = columns.T @ self._r - pulled.T @ self._free_r
        for first in range(0, columns.shape[1], size):
            own = slice(first, first + size)
            across = self._inverse @ common[:, own]
            normal = columns[:, own].T @ columns[:, own] - pulled[:, own].T @ free[:, own] - common[:, own].T @ across + np.eye(size)
            pull = right[own] - across.T @ self._right_J
            theta = np.linalg.solve(normal, pull)
            if pull @ theta > self._least:
                self._least = float(pull @ theta)
                self.theta_J = self._inverse @ self._right_J - across @ theta
                self.of_shape = stacked[self.rows, own] @ theta


def per_segment(twin: Twin, have: Hypothesis, rows: np.ndarray) -> np.ndarray:
    """(S,) squares of left-out rows (n,) in their sigmas, of each segment with the still that it begins at."""
    square = np.nan_to_num((rows / have.whiten.sigma) ** 2)
    closure, still, length = (square[part] for part in have.whiten.parts.values())
    total = closure.reshape(len(twin.segments), -1).sum(axis=1)
    if not twin.stills:
        return total
    return total + still.reshape(-1, 3).sum(axis=1)[twin.first] + length[twin.first]
