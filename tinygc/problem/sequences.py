"""Sequences of m parts with an end reference each (the paper's Figure 4): the attitude is carried from part to part, not begun anew.

A part is a segment; parts are joined where one begins where the other has ended.  A single segment is a sequence of one part.
Carried, an error that each part leaves adds up where a segment alone would show it once, and what the inner references cost in noise
is spent once; no reference is new.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from session.detect.segments import Segment
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.attitude.rotation import Array
from tinygc.closure.residual import Batch


def consecutive(segments: Sequence[Segment]) -> np.ndarray:
    """(S,) numbers that count on by one where a segment begins with the still, or the moment, that the one before ended with."""
    numbers = [0]
    for before, after in pairwise(segments):
        joined = before.log == after.log and (before.last is after.first if after.first is not None else before.stop == after.start + 1)
        numbers.append(numbers[-1] + (1 if joined else 2))
    return np.array(numbers[: len(segments)], dtype=int)


def previous(order: np.ndarray, parts: int) -> np.ndarray:
    """(S,) the row that each part goes on from, -1 where a sequence begins: at every ``parts``-th number, and after a gap."""
    rows = np.arange(len(order))
    joined = np.zeros(len(order), dtype=bool)
    joined[1:] = (np.diff(order) == 1) & (order[1:] % parts != 0)
    return np.where(joined, rows - 1, -1)


def place(before: np.ndarray) -> np.ndarray:
    """(S,) the place of each part within its sequence, from 0."""
    at = np.zeros(len(before), dtype=int)
    for row, one in enumerate(before):
        at[row] = 0 if one < 0 else at[one] + 1
    return at


def residuals(batch: Batch, rate: Array, before: np.ndarray, integrator: str = "exact") -> Array:
    """As ``closure.segment_residuals``, each part begun at the attitude that the one before was predicted to end with; NumPy or torch."""
    return residuals_of_turns(batch, closure.turned(batch, rate, integrator), before)


def residuals_of_turns(batch: Batch, turn: Array, before: np.ndarray) -> Array:
    """The same of what the body turns by (S, 4) in each part."""
    start, first = (closure.like(turn, array) for array in (batch.start, (before < 0)[:, None]))
    end = rotation.multiply(start, turn)
    xp = rotation.namespace(turn)
    rows = np.maximum(before, 0)
    for _ in range(int(place(before).max())):
        end = rotation.multiply(xp.where(first > 0, start, end[rows]), turn)
    return closure.batch_residual(batch, end, turn)


def carried(design: np.ndarray, before: np.ndarray, turns_known: bool = False) -> np.ndarray:
    """(S, d, P) of each part with what it carries from those before: errors add up in the table frame, to first order.

    turns_known: the third component is a turn's angle about its own axis, which carries nothing.
    """
    total, d = design.copy(), 2 if turns_known else design.shape[1]
    for row, one in enumerate(before):
        if one >= 0:
            total[row, :d] += total[one, :d]
    return total


def carried_sigma(sigma: np.ndarray, before: np.ndarray, turns_known: bool = False) -> np.ndarray:
    """(S, …) rad: as if the parts' noises were independent."""
    return np.sqrt(carried(sigma**2, before, turns_known))
