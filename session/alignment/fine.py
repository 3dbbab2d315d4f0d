"""Clock and mounting together with the gyro's own linear errors, by Gauss-Newton over all spans: each with its sigma.

Of a span, seen in the truth's body at its beginning, the truth's turn and the gyro's differ by

    e = M (R w_end - w_begin) s + M sum_k R_k (dE w_k + b) dt,      R_k from the body at k to the body at the beginning,

s the truth's offset, M the mounting.  The antisymmetric part of dE is a turn of M, and goes there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from session.alignment.frames import Seen
from session.alignment.spans import Carried, Spans, carried, vector
from session.log.samples import Samples
from session.log.truth_reading import TruthReading, inverse, product

#: of independent spans: 60 angles for 13 unknowns
FEWEST = 20
STEPS = 4
#: a twentieth of the session, but no shorter than two spans and no longer than a vehicle's slow errors
BLOCKS, BLOCK_S = 20, (1.0, 10.0)
#: Huber's weights, in median lengths
ROBUST, ROBUST_PASSES = 2.0, 4


@dataclass(frozen=True, eq=False)
class Fine:
    """offset_s, mounting (3, 3) and their sigmas, the mounting's (3,) rad about the gyro's axes."""

    offset_s: float
    offset_sigma_s: float
    mounting: np.ndarray
    mounting_sigma: np.ndarray


def refined(seen: Sequence[Seen], samples: Sequence[Samples], reading: TruthReading) -> Fine | None:
    """From where the ways have left it; None where there are too few spans, or they do not fix the unknowns."""
    E, b, mounting, offset_s = np.eye(3), np.zeros(3), reading.mounting, reading.offset_s
    gyro = [one.gyro for one in seen]
    for step in range(STEPS):
        if step:
            gyro = [carried(part, part.gyro @ E.T + b) for part in samples]
        now = replace(reading, mounting=mounting, offset_s=offset_s)
        rows = [_rows(one, log, now) for one, log in zip(seen, gyro, strict=True)]
        error, columns = (np.concatenate(part) for part in list(zip(*rows, strict=True))[:2])
        block = _blocks(rows)
        if len(error) < 3 or sum(_independent(part[2]) for part in rows) < FEWEST:
            return None
        solved = _solved(error, columns, block)
        if solved is None:
            return None
        theta, covariance = solved
        offset_s -= float(theta[0])
        dE = -theta[1:10].reshape(3, 3)
        turn = np.array([dE[2, 1] - dE[1, 2], dE[0, 2] - dE[2, 0], dE[1, 0] - dE[0, 1]]) / 2
        mounting = mounting @ Rotation.from_rotvec(turn).as_matrix()
        E = (np.eye(3) + (dE + dE.T) / 2) @ E
        b = (np.eye(3) + (dE + dE.T) / 2) @ b - theta[10:]
    pick = np.zeros((3, 13))
    for axis, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        pick[axis, 1 + 3 * i + j], pick[axis, 1 + 3 * j + i] = 0.5, -0.5
    sigma = np.sqrt(np.diag(pick @ covariance @ pick.T))
    return Fine(offset_s, float(np.sqrt(covariance[0, 0])), mounting, sigma)


def _rows(one: Seen, gyro: Carried, reading: TruthReading) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors (K, 3) rad about the gyro's axes at the beginning, their columns (K, 3, 13), and the spans' beginnings (K,) s."""
    spans: Spans = one.spans
    begin, end = spans.begin_s + reading.offset_s, spans.end_s + reading.offset_s
    kept = gyro.whole(begin, end)
    begin, end = begin[kept], end[kept]
    truth = spans.turned(reading.read(one.written))[kept]  # with the mounting: in the gyro's axes
    at_begin, at_end = gyro.at(begin), gyro.at(end)
    turned = product(inverse(at_begin), at_end)
    error = vector(product(turned, inverse(truth)))
    matrix = Rotation.from_quat(gyro.q, scalar_first=True).as_matrix()
    weight = np.gradient(gyro.t_s)[:, None, None]
    # What a constant error of the matrix and of the bias turns by, up to each sample, in the axes that all is carried from.
    grown = np.concatenate([np.einsum("nij,nk->nijk", matrix, gyro.rate).reshape(-1, 3, 9), matrix], axis=2) * weight
    grown = np.concatenate([np.zeros((1, 3, 12)), np.cumsum((grown[1:] + grown[:-1]) / 2, axis=0)])
    rows = [np.clip(np.searchsorted(gyro.t_s, t), 0, len(gyro.t_s) - 1) for t in (begin, end)]
    back = Rotation.from_quat(at_begin, scalar_first=True).as_matrix().transpose(0, 2, 1)
    errors = np.einsum("kij,kjp->kip", back, grown[rows[1]] - grown[rows[0]])
    spun = Rotation.from_quat(turned, scalar_first=True).apply(gyro.rate_at(end)) - gyro.rate_at(begin)
    return error, np.concatenate([spun[:, :, None], errors], axis=2), begin


def _independent(begin: np.ndarray) -> int:
    """Spans that do not overlap, of as many as there are."""
    count, free = 0, -np.inf
    for t in begin:
        if t >= free:
            count, free = count + 1, t + 0.49
    return count


def _blocks(rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> np.ndarray:
    """(K,) number of each span's block."""
    total = sum(float(begin[-1] - begin[0]) for _, _, begin in rows if len(begin))
    length = float(np.clip(total / BLOCKS, *BLOCK_S))
    numbers: list[np.ndarray] = []
    first = 0
    for _, _, begin in rows:
        own = ((begin - begin[0]) // length).astype(int) if len(begin) else np.zeros(0, dtype=int)
        numbers.append(own + first)
        first += int(own[-1]) + 1 if len(own) else 0
    return np.concatenate(numbers)


def _solved(error: np.ndarray, columns: np.ndarray, block: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """theta (13,) that takes up most of the errors, robustly, and its covariance (13, 13) by a sandwich over blocks; None where they
    are not fixed."""
    size = columns.shape[2]
    scale = np.linalg.norm(columns.reshape(-1, size), axis=0)
    if not (scale > 0).all():
        return None
    design, weight = columns / scale, np.ones(len(error))
    for _ in range(ROBUST_PASSES):
        rows = (design * weight[:, None, None]).reshape(-1, size)
        normal = rows.T @ rows
        if np.linalg.cond(normal) > 1e12:
            return None
        theta = np.linalg.solve(normal, rows.T @ (error * weight[:, None]).ravel())
        left = error - design @ theta
        length = np.linalg.norm(left, axis=1)
        weight = np.sqrt(np.minimum(1, ROBUST * np.median(length) / np.maximum(length, 1e-15)))
    score = np.einsum("kip,ki,k->kp", design, left, weight**2)
    sums = np.zeros((int(block.max()) + 1, size))
    np.add.at(sums, block, score)
    inverse_ = np.linalg.inv(normal)
    count = len(sums)
    covariance = inverse_ @ (sums.T @ sums) @ inverse_ * (count / max(count - 1, 1)) / np.outer(scale, scale)
    return theta / scale, covariance
