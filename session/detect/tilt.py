"""Does the gyroscope see the turns that the accelerometer sees?  The search for wrong axes, signs and sensitivities.

A direction that is fixed in the world, gravity's for one, seen from a body that turns with omega moves as ``d' = d x omega``.
With ``omega = k P m`` for measured rates m, a scale k and one of 48 signed permutations P, that is linear in k: all P are tried on
one 9x9 matrix of sums.  It needs no attitude, only that hand turns push the accelerometer about by little beside gravity.
The scale is then sharpened where turns lead from still to still, and gravity is known without any push.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, permutations, product

import numpy as np

from session.common.units import DEG, NS
from session.detect.segments import GAP_PERIODS
from session.detect.stills import Still
from session.log.samples import Samples

BLOCKS_S = (0.05, 0.025, 0.0125)  #: a hand turns by some degrees in the first; the others are for the fastest turns
LAG_BLOCKS = 5  #: 0.25 s: gravity has moved by more than the tremor of a hand shakes it, and not yet round a corner
ROUND_A_CORNER = 1.2  #: of gravity's unit vector: where it moves farther in a lag, in a tenth of them, the blocks are too long
LEAST_TILT_RAD = 20 * DEG  #: a turn that moves gravity by less says little of axes
LEAST_PATH_RAD = 90 * DEG  #: gravity's movement in all turns together
LEAST_TURNS = 3  #: to sharpen the scale
FORCE_RATIO = 0.2  #: specific force that differs more from gravity is not gravity's direction
COARSE, SHARP = 0.10, 0.03  #: how well the scale is known without still ends and with them
SCALES = np.geomspace(0.85, 1.18, 67)  #: about the coarse one, in steps of half a percent

#: (48, 3, 3) signed permutations: right-handed ones have determinant +1
SIGNED_PERMUTATIONS = np.array(
    [np.diag(signs)[:, list(order)] for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)]
)
IDENTITY = next(i for i, axes in enumerate(SIGNED_PERMUTATIONS) if np.trace(axes) == 3)


@dataclass(frozen=True, eq=False)
class Turns:
    """Turns in blocks.

    angle (S, B, 3) rad: integral of the rate less bias, zero where padded; down (S, B, 3) unit, or NaN where the sensor is pushed
    about; first, last (S, 3) unit: gravity in the stills around.
    """

    angle: np.ndarray
    down: np.ndarray
    first: np.ndarray
    last: np.ndarray

    def __len__(self) -> int:
        return len(self.first)

    def of(self, chosen: np.ndarray) -> Turns:
        """Some of the turns, by index or mask."""
        return Turns(self.angle[chosen], self.down[chosen], self.first[chosen], self.last[chosen])


@dataclass(frozen=True, eq=False)
class AxesAgreement:
    """How gyro and gravity agree best: ``omega = scale * axes @ m``.

    axes (3, 3) signed permutation; scale, known to about scale_std (relative); misfit: the share of gravity's movement that these
    leave unexplained, identity_misfit that of the axes as logged, at their best scale; residual: median closure of the turns from
    still to still in rad, or NaN where there are too few; turned: median angle of a turn in rad; turns: their number.
    """

    axes: np.ndarray
    scale: float
    scale_std: float
    misfit: float
    identity_misfit: float
    residual: float
    turned: float
    turns: int


def agreement(samples: Samples, stills: list[Still], skip: np.ndarray | None = None) -> AxesAgreement | None:
    """Best axes and scale of the gyro against gravity, or None where gravity hardly moves in the sensor.

    samples with the specific force in right units and pre-calibrated; skip (N,) bool: rows whose turns are left out.
    """
    turns = cut_turns(samples, stills, skip)
    if turns is None:
        return None
    scales, misfits = _regress(turns)
    misfits = np.where(scales > 0, misfits, 1.0)
    # Turns about few axes leave several orders of axes alike: then the least changed.
    alike = np.flatnonzero(misfits <= 1.5 * misfits.min() + 0.01)
    best = max(alike, key=lambda i: (np.trace(SIGNED_PERMUTATIONS[i]), -misfits[i]))
    scale, scale_std, residual = scales[best], COARSE, float("nan")
    tilted = np.arccos(np.clip((turns.first * turns.last).sum(axis=1), -1, 1)) > LEAST_TILT_RAD
    if tilted.sum() >= LEAST_TURNS and scale > 0:
        scale, residual = _sharpen(turns.of(tilted), SIGNED_PERMUTATIONS[best], scale)
        scale_std = SHARP
    return AxesAgreement(
        axes=SIGNED_PERMUTATIONS[best],
        scale=float(scale),
        scale_std=scale_std,
        misfit=float(misfits[best]),
        identity_misfit=float(misfits[IDENTITY]),
        residual=residual,
        turned=float(np.median(np.linalg.norm(scale * turns.angle, axis=-1).sum(axis=1))),
        turns=len(turns),
    )


def cut_turns(samples: Samples, stills: list[Still], skip: np.ndarray | None = None) -> Turns | None:
    """Turns between neighbouring stills, averaged over blocks; those with a gap or a row to skip, or that hardly tilt, are left out."""
    for block_s in BLOCKS_S:
        turns = _cut(samples, stills, skip, max(1, round(block_s / samples.period_s)))
        if turns is None or _lag(turns) < ROUND_A_CORNER:
            break
    return turns


def _lag(turns: Turns) -> float:
    """How far gravity's unit vector moves in a lag, in the fastest tenth of them."""
    moved = np.linalg.norm(turns.down[:, LAG_BLOCKS:] - turns.down[:, :-LAG_BLOCKS], axis=-1)
    return float(np.nanquantile(moved, 0.9)) if np.isfinite(moved).any() else 0.0


def _cut(samples: Samples, stills: list[Still], skip: np.ndarray | None, size: int) -> Turns | None:
    good = [still for still in stills if still.problem is None]
    pairs = [(a, b) for a, b in pairwise(good) if skip is None or not skip[a.stop : b.start].any()]
    parts = [part for a, b in pairs if (part := _blocks(samples, a, b, size)) is not None]
    if sum(_tilt_path(down) for _, down, _, _ in parts) < LEAST_PATH_RAD:
        return None
    longest = max(len(angle) for angle, _, _, _ in parts)

    def pad(values: np.ndarray, fill: float) -> np.ndarray:
        return np.concatenate([values, np.full((longest - len(values), 3), fill)])

    return Turns(
        np.array([pad(angle, 0.0) for angle, _, _, _ in parts]),
        np.array([pad(down, np.nan) for _, down, _, _ in parts]),
        np.array([first for _, _, first, _ in parts]),
        np.array([last for _, _, _, last in parts]),
    )


def _blocks(samples: Samples, first: Still, last: Still, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    start, stop = first.stop - 1, last.start + 1
    steps = np.diff(samples.t_ns[start:stop]) * NS
    if len(steps) < 2 * size or steps.max() > GAP_PERIODS * samples.period_s:
        return None
    t_s = (samples.t_ns[start:stop] - samples.t_ns[start]) * NS
    share = (t_s / t_s[-1])[:, None]
    rate = samples.gyro[start:stop] - (1 - share) * first.gyro_mean - share * last.gyro_mean
    edges = np.arange(0, len(steps), size)
    angle = np.add.reduceat((rate[1:] + rate[:-1]) / 2 * steps[:, None], edges)
    counts = np.diff(np.append(edges, len(steps)))[:, None]
    force = np.add.reduceat((samples.accel[start + 1 : stop] + samples.accel[start : stop - 1]) / 2, edges) / counts
    ends = [samples.accel[still.start : still.stop].mean(axis=0) for still in (first, last)]
    gravity = np.linalg.norm(ends, axis=1).mean()
    if not all(np.linalg.norm(end) > 0 for end in ends):  # an accelerometer that reads nothing knows no direction
        return None
    length = np.linalg.norm(force, axis=1, keepdims=True)
    down = np.where(np.abs(length / gravity - 1) < FORCE_RATIO, -force / np.maximum(length, 1e-9), np.nan)
    if _tilt_path(down) < LEAST_TILT_RAD:
        return None
    begin, end = (-end / np.linalg.norm(end) for end in ends)
    return angle, down, begin, end


def _tilt_path(down: np.ndarray) -> float:
    """Angle that gravity's direction travels, rad."""
    return float(np.nansum(np.linalg.norm(np.diff(down, axis=0), axis=1)))


def _regress(turns: Turns) -> tuple[np.ndarray, np.ndarray]:
    """Best scale (48,) for each signed permutation, and the share of ``sum |d'|^2`` that it leaves unexplained."""
    change = turns.down[:, LAG_BLOCKS:] - turns.down[:, :-LAG_BLOCKS]
    middle = turns.down[:, LAG_BLOCKS:] + turns.down[:, :-LAG_BLOCKS]
    middle /= np.linalg.norm(middle, axis=-1, keepdims=True)
    # Gravity is known at the blocks' middles: the first and the last block of a lag count half.
    total = np.cumsum(turns.angle, axis=1) - turns.angle / 2
    angle = total[:, LAG_BLOCKS:] - total[:, :-LAG_BLOCKS]
    seen = np.isfinite(change).all(axis=-1)
    change, middle, angle = change[seen], middle[seen], angle[seen]
    # (d x P m)_i = eps_ijk d_j P_kl m_l: linear in the nine P_kl
    levi_civita = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(2, 0, 1)
    design = np.einsum("ijk,nj,nl->nikl", levi_civita, middle, angle).reshape(-1, 9)
    normal, right, power_seen = design.T @ design, design.T @ change.ravel(), float((change**2).sum())
    flat = SIGNED_PERMUTATIONS.reshape(48, 9)
    power = np.einsum("pi,ij,pj->p", flat, normal, flat)
    scales = np.divide(flat @ right, power, out=np.zeros(48), where=power > 0)
    return scales, 1 - scales * (flat @ right) / max(power_seen, 1e-300)


def _sharpen(turns: Turns, axes: np.ndarray, scale: float) -> tuple[float, float]:
    """The scale about ``scale`` that closes best, and its residual."""
    residuals = _closures(turns, (scale * SCALES)[:, None, None] * axes)
    best = int(np.argmin(residuals))
    return float(scale * SCALES[best]), float(residuals[best])


def _closures(turns: Turns, factors: np.ndarray) -> np.ndarray:
    """(F,) rad for factors (F, 3, 3) on the rate: median closure of the turns.

    A turn's closure is the angle between gravity in the last still and where the turn takes gravity of the first.
    """
    x, y, z = (np.broadcast_to(part, (len(factors), len(turns))) for part in turns.first.T)
    for k in range(turns.angle.shape[1]):
        angle = np.einsum("fij,sj->ifs", factors, turns.angle[:, k])
        theta = np.sqrt(angle[0] ** 2 + angle[1] ** 2 + angle[2] ** 2)
        ax, ay, az = angle / np.maximum(theta, 1e-12)
        cos, sin = np.cos(theta), np.sin(theta)
        # Rodrigues, backward: a fixed direction seen from a body that turns.
        along = (ax * x + ay * y + az * z) * (1 - cos)
        cross = ay * z - az * y, az * x - ax * z, ax * y - ay * x
        x, y, z = (cos * d + along * a - sin * c for d, a, c in zip((x, y, z), (ax, ay, az), cross, strict=True))
    down = np.stack([x, y, z], axis=-1)
    sine = np.linalg.norm(_cross(down, turns.last), axis=-1)
    return np.median(np.arctan2(sine, (down * turns.last).sum(axis=-1)), axis=-1)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """np.cross for (..., 3), without its overhead on small arrays."""
    a, b = np.broadcast_arrays(a, b)
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]
