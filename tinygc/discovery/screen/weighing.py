"""From a form's columns to what it promises."""

from __future__ import annotations

import numpy as np

from tinygc.explanation.naming.evidence import PRIOR_ODDS, SCALES

#: a direction that the nuisance leaves less of than this is not seen.  What is left of a rate that a calibration takes up is the noise of
#: the rate itself, 2e-4, which is in the residuals, too; of the faintest law beside it, a dead zone of a hundredth of the range, 2e-2
FAINT = 5e-3


def price(bits: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Twice the logarithm of what forms cost before they are looked at, as ``evidence.price``: bits (F,), sizes (F,) coefficients."""
    return 2 * (np.log(2) * bits + np.log(SCALES / PRIOR_ODDS)) + sizes


def promise(gain: np.ndarray, rank: np.ndarray, price: np.ndarray) -> np.ndarray:
    """Twice the logarithm of the evidence that forms would add, as ``search.promises``: gain (F, …), rank (F,), price (F,)."""
    rank, price = (each.reshape(-1, *(1,) * (gain.ndim - 1)) for each in (np.maximum(rank, 1), price))
    return gain - rank * np.log(np.maximum(gain / rank, 1.0)) - price


def seen_directions(free: np.ndarray, length: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """weights (F, P, P), rank (F,) and left (F,) of forms' columns: free (F, P, m) beside the nuisance, length (F, P) with it.

    ``weights @ free`` are orthonormal rows, then zeros: a direction is dropped that the nuisance leaves less than ``FAINT`` of, as
    ``selection.left_of`` drops one; left: the share of the columns' squared length that is seen.
    """
    length = np.where(length > 0, length, 1.0).astype(float)
    unit = free / length[:, :, None]
    size, turn = np.linalg.eigh(unit @ unit.transpose(0, 2, 1))
    size, turn = size[:, ::-1], turn[:, :, ::-1]
    kept = size > FAINT**2
    scale = np.where(kept, 1 / np.sqrt(np.where(kept, size, 1.0)), 0.0)
    weights = (turn * scale[:, None, :] / length[:, :, None]).transpose(0, 2, 1)
    return weights, kept.sum(axis=1), np.sum(size * kept, axis=1) / size.shape[1]
