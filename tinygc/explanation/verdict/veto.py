"""A claim stays only if what the fit never saw improves with it by more than chance, paired by segments.

Each segment is left out together with the stills at its ends; all its rows are predicted with the claim and without it, everything else
fitted anew both times.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from tinygc.explanation.naming.evidence import Hypothesis
from tinygc.explanation.twin.layout import claim_slice
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.verdict.proof import left_out

#: a claim whose improvement chance makes in one recording of twenty is not borne out
BORNE_OUT_P = 0.05


def improvement_p(twin: Twin, have: Hypothesis, prior: np.ndarray, number: int) -> float:
    """Probability that chance improves the left-out segments as much as a claim does (Wilcoxon's signed ranks, one-sided).

    prior (p,): of all parameters of the hypothesis.
    """
    whiten, fit = have.whiten, have.fit
    part = claim_slice(fit.state.claims, number)
    J = fit.J * prior
    fewer = np.delete(J, part, axis=1)
    r = fit.r - fit.J[:, part] @ fit.state.claims[number].theta
    r = r - fewer @ np.linalg.solve(fewer.T @ fewer + np.eye(fewer.shape[1]), fewer.T @ r)
    gains = per_segment(twin, have, left_out(twin, whiten, r, fewer)) - per_segment(twin, have, left_out(twin, whiten, fit.r, J))
    return float(stats.wilcoxon(gains, alternative="greater").pvalue) if np.any(gains) else 1.0


def per_segment(twin: Twin, have: Hypothesis, rows: np.ndarray) -> np.ndarray:
    """(S,) squares of left-out rows (n,) in their sigmas, of each segment with the still that it begins at."""
    square = np.nan_to_num((rows / have.whiten.sigma) ** 2)
    closure, still, length = (square[part] for part in have.whiten.parts.values())
    total = closure.reshape(len(twin.segments), -1).sum(axis=1)
    if not twin.stills:
        return total
    return total + still.reshape(-1, 3).sum(axis=1)[twin.first] + length[twin.first]
