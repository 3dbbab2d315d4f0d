"""The paper's loss as it stands: the mean distance of the end quaternions, not its square.

A sum of distances is minimised by reweighted least squares (Weiszfeld 1937): each pass divides a segment's weight by the distance that
the last one left.  It is to the squared loss what a median is to a mean: days, or windows, that are unlike the others pull less.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tinygc import closure
from tinygc.closure import Batch

PASSES = 12
#: below this share of the median distance a segment's weight grows no further
LEAST = 0.05


def fit_distance(batch: Batch, sigma: np.ndarray, fit: Callable[[Batch, np.ndarray], Callable], passes: int = PASSES):
    """The model that ``fit(batch, sigma)`` settles at when its weights follow the distances; sigma (S, d) rad of each angle."""
    model = fit(batch, sigma)
    for _ in range(passes):
        model = fit(batch, sigma * distance_weights(batch, model)[:, None])
    return model


def distance_weights(batch: Batch, model) -> np.ndarray:
    """(S,): factors on the segments' sigmas that make a squared loss a sum of distances, where the model is."""
    distance = np.linalg.norm(closure.segment_residuals(batch, model(batch.rate)), axis=1)
    typical = max(float(np.median(distance)), 1e-12)
    return np.sqrt(np.maximum(distance / typical, LEAST))


def mean_distance(batch: Batch, model) -> float:
    """The loss, as the paper prints it: mean Euclidean distance of the end quaternions, the nearer of q and -q."""
    return float(np.mean(np.linalg.norm(closure.segment_residuals(batch, model(batch.rate)), axis=1)))
