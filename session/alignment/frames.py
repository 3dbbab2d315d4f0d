"""Which way a truth file's quaternions turn, whose axes they are of, and which way is up in its world.

The gyro's rates tell the sense of turning and the mounting: short spans' rotation vectors, seen in the body at the span's beginning, are
the gyro's, turned by a constant rotation.  Those of an inverse attitude are the world's, which no constant rotation brings to the body.
Cells in another order are an inverse with two constant turns, so the rates alone do not tell the two apart: the least mounting does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product as combinations

import numpy as np

from session.alignment.spans import Carried, Spans, vector
from session.log.truth_reading import FRAMES, ORDERS, SENSES, TruthGiven, TruthReading, down_of, product, quaternion

#: the contract's own way is taken unless another leaves less than this share of what it leaves of rates and of gravity
MUCH_LESS = 0.5
#: two ways that differ by less, of all that turns, are one: cells in another order against an inverse
SAME = 0.02
#: cosine of the angle from the nearest axis: an up that is farther off is nobody's world
UPRIGHT = 0.9
#: of the mean specific force over its mean length: a body that a gyro can follow does not fly freely
STEADY = 0.7


@dataclass(frozen=True, eq=False)
class Way:
    """One way to read the file: misfit, the share of the truth's squared rotation that the gyro leaves; up (3,), the mean specific force
    in the file's world over its mean length, or None where the log has none; ``reading``'s mounting is the one that fits."""

    reading: TruthReading
    misfit: float
    up: np.ndarray | None

    @property
    def cost(self) -> float:
        """What rates and gravity leave together."""
        return self.misfit + (0.0 if self.up is None else max(1 - float(self.up @ self.up), 0.0))

    @property
    def mounted(self) -> float:
        """rad."""
        return float(np.linalg.norm(vector(quaternion(self.reading.mounting)[None])))


@dataclass(frozen=True, eq=False)
class Seen:
    """One log: the gyro, spans of the truth at the truth's clock, the cells as they are written (moments, 4), specific force (N, 3)."""

    gyro: Carried
    spans: Spans
    written: np.ndarray
    force: np.ndarray


def ways(seen: Sequence[Seen], given: TruthGiven, offset_s: float) -> list[Way]:
    """Every way to read the files that is not ruled out by what is given, the contract's own first."""
    told = TruthReading.of(given)
    senses = SENSES if given.sense is None else (given.sense,)
    orders = ORDERS if given.order is None else (given.order,)
    found = []
    for order, sense in combinations(orders, senses):
        reading = replace(told, order=order, sense=sense, offset_s=offset_s)
        turns = [_turns(one, replace(reading, mounting=np.eye(3))) for one in seen]
        truth, gyro, duration = (np.concatenate(part) for part in zip(*turns, strict=True))
        mounting, misfit = _mounting(truth, gyro, duration, given.mounting)
        reading = replace(reading, mounting=mounting)
        found.append(Way(reading, misfit, _up(seen, reading)))
    return found


def best_way(found: list[Way]) -> Way:
    """The contract's own, unless another is much better; of those that are as good, the one with the least mounting, then the earlier."""
    own, least = found[0], min(found, key=lambda way: way.cost)
    if least.cost > MUCH_LESS * own.cost:
        return own
    good = [way for way in found if way.cost < least.cost + SAME]
    return min(good, key=lambda way: (round(way.mounted, 1), -_upright(way)))


def frame_of(way: Way) -> str | None:
    """The world's frame by which way is up, or None where that is not known."""
    if way.up is None or np.linalg.norm(way.up) < STEADY:
        return None
    up = way.up / np.linalg.norm(way.up)
    name = min(FRAMES, key=lambda name: up @ down_of(name))
    return name if -(up @ down_of(name)) > UPRIGHT else None


def _upright(way: Way) -> float:
    """Cosine of up from the world's z axis: whoever takes the trouble to define a world has it there."""
    return 0.0 if way.up is None else float(abs(way.up[2]))


def _turns(one: Seen, reading: TruthReading) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation vectors (K, 3) rad of the truth and of the gyro, and durations (K,) s, of the spans that the log has whole."""
    begin, end = one.spans.begin_s + reading.offset_s, one.spans.end_s + reading.offset_s
    kept = one.gyro.whole(begin, end)
    truth = vector(one.spans.turned(reading.read(one.written)))
    back = one.gyro.at(begin) * [1.0, -1.0, -1.0, -1.0]
    gyro = vector(product(back, one.gyro.at(end)))
    # Near half a turn the shorter way is not the one that was gone.
    kept &= (np.linalg.norm(truth, axis=1) < np.pi / 2) & (np.linalg.norm(gyro, axis=1) < np.pi / 2)
    return truth[kept], gyro[kept], (end - begin)[kept]


def _mounting(truth: np.ndarray, gyro: np.ndarray, duration: np.ndarray, given: np.ndarray | None) -> tuple[np.ndarray, float]:
    """The rotation (3, 3) from the gyro's vectors (K, 3) to the truth's, a constant bias taken off, and the share of squares left."""
    matrix, bias = np.eye(3) if given is None else given, np.zeros(3)
    for _ in range(5):
        turned = gyro + bias * duration[:, None]
        if given is None:
            left, _, right = np.linalg.svd(truth.T @ turned)
            matrix = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
        bias = np.median((truth @ matrix - gyro) / duration[:, None], axis=0)
    apart = truth - (gyro + bias * duration[:, None]) @ matrix.T
    size = np.sum(truth**2, axis=1)
    rough = np.sum(apart**2, axis=1) > 9 * np.median(np.sum(apart**2, axis=1)) + size  # wrong moments of truth
    return matrix, float(np.sum(apart[~rough] ** 2) / max(np.sum(size[~rough]), 1e-30))


def _up(seen: Sequence[Seen], reading: TruthReading) -> np.ndarray | None:
    """(3,) in the file's world."""
    total, length = np.zeros(3), 0.0
    for one in seen:
        q = product(FRAMES[reading.frame] * [1.0, -1.0, -1.0, -1.0], reading.read(one.written))  # in the file's own world
        at = one.spans.begin_s + reading.offset_s
        force = one.force[np.clip(np.searchsorted(one.gyro.t_s, at), 0, len(one.force) - 1)]
        q = q[one.spans.first]
        has = np.abs(force).sum(axis=1) > 0
        w, v = q[has, :1], q[has, 1:]
        cross = np.cross(v, force[has])
        total += np.sum(force[has] + 2 * w * cross + 2 * np.cross(v, cross), axis=0)
        length += float(np.sum(np.linalg.norm(force[has], axis=1)))
    return total / length if length > 0 else None
