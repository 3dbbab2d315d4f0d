"""The paper's loss as it stands: the mean distance of the end quaternions, not its square.

A sum of distances is minimised by reweighted least squares (Weiszfeld 1937): each pass divides a segment's weight by the distance that
the last one left.  Segments that fit badly count less than in the squared loss, as outliers do in a median: a day, or a window, that
is unlike the others pulls the result less.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from tinygc import closure
from tinygc.closure.residual import Batch, RateMap
from tinygc.methods.network.training import TrainableNet, train_second_order
from tinygc.problem import sequences

PASSES = 12
#: below this share of the median distance a segment's weight grows no further
LEAST = 0.05

#: whatever map of rates is fitted
Map = TypeVar("Map", bound=RateMap)


def fit_distance(
    batch: Batch,
    sigma: np.ndarray,
    fit: Callable[[Batch, np.ndarray], Map],
    passes: int = PASSES,
) -> Map:
    """The model that ``fit(batch, sigma)`` settles at when its weights follow the distances; sigma (S, d) rad of each angle."""
    model = fit(batch, sigma)
    for _ in range(passes):
        model = fit(batch, distance_sigma(batch, sigma, model))
    return model


def train_distance(
    batch: Batch, sigma: np.ndarray, *, tie: float = 0.0, passes: int = PASSES, before: np.ndarray | None = None, **how: Any
) -> TrainableNet:
    """The same for a net by the second order, one step to each pass, from the squared loss's linear solution; as fast as it gets.

    tie: how freely it may bend (0: linear), with no proof asked for.  ``how``: as of ``train_second_order``.
    """
    net = train_second_order(batch, sigma, ties=(0.0,), before=before, **how).net
    for _ in range(passes):
        net = distance_pass(batch, sigma, net, tie=tie, before=before, **how)
    return net


def distance_pass(
    batch: Batch, sigma: np.ndarray, net: TrainableNet, *, tie: float = 0.0, before: np.ndarray | None = None, **how: Any
) -> TrainableNet:
    """One pass of ``train_distance``."""
    weights = distance_sigma(batch, sigma, net, before)
    return train_second_order(batch, weights, ties=(tie,), begin=net, steps=1, before=before, **how).net


def distance_sigma(batch: Batch, sigma: np.ndarray, model: RateMap, before: np.ndarray | None = None) -> np.ndarray:
    """(S, d) rad: sigmas (S,) or (S, d) with the factors of ``distance_weights``.  before (S,): the part that each goes on from."""
    return sigma.reshape(len(batch), -1) * distance_weights(batch, model, before)[:, None]


def distance_weights(batch: Batch, model: RateMap, before: np.ndarray | None = None) -> np.ndarray:
    """(S,): factors on the segments' sigmas that make a squared loss a sum of distances, where the model is."""
    before = np.full(len(batch), -1) if before is None else before
    distance = np.linalg.norm(sequences.residuals(batch, model(batch.rate), before), axis=1)
    typical = max(float(np.median(distance)), 1e-12)
    return np.sqrt(np.maximum(distance / typical, LEAST))


def mean_distance(batch: Batch, model: RateMap) -> float:
    """The loss, as the paper prints it: mean Euclidean distance of the end quaternions, the nearer of q and -q."""
    return float(np.mean(np.linalg.norm(closure.segment_residuals(batch, model(batch.rate)), axis=1)))
