"""A claim stays only if what the fit never saw improves with it by more than chance, paired by segments.

Each segment is left out together with the stills at its ends; all its rows are predicted with the claim and without it, everything else
fitted anew both times.  A scanned shape (the moment of a step, the frequency of a line) is searched for anew, too: one that was found with
the left-out rows improves them by chance.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from tinygc.explanation.naming.candidates import scanned
from tinygc.explanation.naming.evidence import Evidence, Hypothesis
from tinygc.explanation.twin.layout import claim_slice
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.explanation.verdict.proof import fold_rows, folds_of, left_out

#: a claim whose improvement chance makes in one recording of twenty is not borne out
BORNE_OUT_P = 0.05


def borne_out(evidence: Evidence, have: Hypothesis, number: int) -> bool:
    """Whether a claim of a hypothesis improves what was left out."""
    effect, prior = have.effects[number], evidence.prior(have.fit)
    scan = effect.variants(scanned(evidence.twin, effect)) if effect.scan is not None else []
    shapes = list(have.whiten.each(map(evidence.columns, scan)))
    return improvement_p(evidence.twin, have, prior, number, shapes) < BORNE_OUT_P


def improvement_p(twin: Twin, have: Hypothesis, prior: np.ndarray, number: int, shapes: list[np.ndarray] | None = None) -> float:
    """Probability that chance improves the left-out segments as much as a claim does (Wilcoxon's signed ranks, one-sided).

    prior (p,): of all parameters of the hypothesis.  shapes: whitened columns (n, P) of every shape that the claim might have had.
    """
    whiten, fit = have.whiten, have.fit
    part = claim_slice(fit.state.claims, number)
    J = fit.J * prior
    fewer = np.delete(J, part, axis=1)
    r = fit.r - fit.J[:, part] @ fit.state.claims[number].theta
    r = r - fewer @ np.linalg.solve(fewer.T @ fewer + np.eye(fewer.shape[1]), fewer.T @ r)
    if shapes:
        scaled = np.stack(shapes) * prior[part]
        with_it = _left_out_and_searched(twin, whiten, r, fewer, scaled)
    else:
        with_it = left_out(twin, whiten, fit.r, J)
    gains = per_segment(twin, have, left_out(twin, whiten, r, fewer)) - per_segment(twin, have, with_it)
    return float(stats.wilcoxon(gains, alternative="greater").pvalue) if np.any(gains) else 1.0


def _left_out_and_searched(twin: Twin, whiten: Whitener, r: np.ndarray, J: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """(n,) stacked, as ``left_out``, with columns J (n, p) and that one of the shapes (V, n, P) that the seen rows ask for most."""
    columns = np.concatenate([J, np.moveaxis(shapes, 0, 1).reshape(len(r), -1)], axis=1)
    pulled, pulled_r, p, size = whiten.pulled(columns), whiten.pulled(r), J.shape[1], shapes.shape[2]
    stacked, stacked_r = whiten.back(columns), whiten.back(r)
    found = np.full(len(r), np.nan)
    for held in folds_of(len(twin.segments)):
        rows = np.flatnonzero(~fold_rows(twin, whiten, held))
        # Inner products of the seen rows alone: each held-out row has a free number of its own.
        free = np.linalg.solve(whiten.precision[np.ix_(rows, rows)], np.column_stack([pulled[rows], pulled_r[rows]]))
        common = columns[:, :p].T @ columns - pulled[rows, :p].T @ free[:, :-1]
        right = columns.T @ r - pulled[rows].T @ free[:, -1]
        inverse = np.linalg.inv(common[:, :p] + np.eye(p))
        best, least = np.zeros(0), 0.0
        for first in range(p, columns.shape[1], size):
            own = slice(first, first + size)
            across = inverse @ common[:, own]
            normal = columns[:, own].T @ columns[:, own] - pulled[rows, own].T @ free[:, own] - common[:, own].T @ across + np.eye(size)
            pull = right[own] - across.T @ right[:p]
            theta = np.linalg.solve(normal, pull)
            if pull @ theta > least:
                least = float(pull @ theta)
                best = stacked[rows, :p] @ (inverse @ right[:p] - across @ theta) + stacked[rows, own] @ theta
        found[rows] = stacked_r[rows] - (best if least > 0 else stacked[rows, :p] @ (inverse @ right[:p]))
    return found


def per_segment(twin: Twin, have: Hypothesis, rows: np.ndarray) -> np.ndarray:
    """(S,) squares of left-out rows (n,) in their sigmas, of each segment with the still that it begins at."""
    square = np.nan_to_num((rows / have.whiten.sigma) ** 2)
    closure, still, length = (square[part] for part in have.whiten.parts.values())
    total = closure.reshape(len(twin.segments), -1).sum(axis=1)
    if not twin.stills:
        return total
    return total + still.reshape(-1, 3).sum(axis=1)[twin.first] + length[twin.first]
