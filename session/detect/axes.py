"""Check the axes: does the gyroscope see the turns that the accelerometer sees?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations
from itertools import product as every

import numpy as np

from session.base import rotation
from session.base.numeric import smallest_step
from session.base.texts import measured
from session.base.units import DEG, MDPS, NS
from session.detect.findings import Axes, Correction, Finding
from session.detect.segments import Ends
from session.detect.stills import Still, references
from session.log.config import Config, Sensor
from session.log.logfile import Log
from session.log.samples import Samples
from session.log.sensors import Profile

# Does the gyroscope see the turns that the accelerometer sees?  The search for wrong axes, signs and sensitivities.
#
# A direction that is fixed in the world, gravity's for one, seen from a body that turns with omega moves as ``d' = d x omega``.
# With ``omega = k P m`` for measured rates m, a scale k and one of 48 signed permutations P, that is linear in k: all P are tried on
# one 9x9 matrix of sums.  It needs no attitude, only that hand turns accelerate the sensor by little against gravity.
# The scale is then sharpened where turns lead from still to still, and gravity is known without any push.

BLOCKS_S = (0.05, 0.025, 0.0125)  #: a hand turns by some degrees in the first; the others are for the fastest turns
LAG_BLOCKS = 5  #: 0.25 s: gravity has moved by more than the tremor of a hand shakes it, and not yet round a corner
ROUND_A_CORNER = 1.2  #: of gravity's unit vector: where it moves farther in a lag, in a tenth of them, the blocks are too long
LEAST_TILT_RAD = 20 * DEG  #: a turn that moves gravity by less shows little of the axes
LEAST_PATH_RAD = 90 * DEG  #: gravity's movement in all turns together
LEAST_TURNS = 3  #: from still to still, to identify axes and to sharpen the scale
#: orders that close best at their own coarse scale, of which each is sharpened; the right one is the first or second of all recordings
SHARPENED = 4
#: an order fits, too, where it misses the ends by so many times as much as the best, or by that share of the turn.  Of 48 sessions with
#: turns between stills (data/session1, and xsens, injected, mikov, concealed and closure of ../shared), the best misses by 0.4 to 4.2 % of
#: the turn, and the second by 9 times as much or more
FITS_TOO, FITS_WITHIN = 2.0, 0.01
FORCE_RATIO = 0.2  #: specific force that differs more from gravity is not gravity's direction
COARSE, SHARP = 0.10, 0.03  #: how well the scale is known without still ends and with them
SCALES = np.geomspace(0.85, 1.18, 67)  #: about the coarse one, in steps of half a percent

#: (48, 3, 3) signed permutations: right-handed ones have determinant +1
_SIGNED_PERMUTATIONS = np.array(
    [np.diag(signs)[:, list(order)] for order in permutations(range(3)) for signs in every((1.0, -1.0), repeat=3)]
)
IDENTITY = next(i for i, axes in enumerate(_SIGNED_PERMUTATIONS) if np.trace(axes) == 3)


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
    still to still in rad, or NaN where there are too few, identity_residual that of the axes as logged; others: orders that fit as well,
    none where the axes as logged do; turned: median angle of a turn in rad; turns: their number, ends: of those from still to still.
    """

    axes: np.ndarray
    scale: float
    scale_std: float
    misfit: float
    identity_misfit: float
    residual: float
    identity_residual: float
    others: tuple[np.ndarray, ...]
    turned: float
    turns: int
    ends: int


def agreement(samples: Samples, stills: list[Still], between: Sequence[Ends] | None = None) -> AxesAgreement | None:
    """Best axes and scale of the gyro against gravity, or None where gravity hardly moves in the sensor.

    samples with the specific force in right units and pre-calibrated; between: the stills of each turn to look at, all neighbours if None.
    """
    turns = _cut_turns(samples, list(pairwise(references(stills))) if between is None else between)
    if turns is None:
        return None
    scales, misfits = _regress(turns)
    misfits = np.where(scales > 0, misfits, 1.0)
    tilted = turns.of(np.arccos(np.clip((turns.first * turns.last).sum(axis=1), -1, 1)) > LEAST_TILT_RAD)
    residuals, scale_std = np.full(len(scales), np.nan), COARSE
    if len(tilted) >= LEAST_TURNS:
        # A push moves gravity between two moments of a turn, and not from still to still.
        coarse, residuals, scale_std = scales.copy(), np.full(len(scales), np.inf), SHARP
        path = float(np.median(np.linalg.norm(tilted.angle, axis=-1).sum(axis=1)))

        def sharpen(sharp: np.ndarray) -> None:
            scales[sharp], residuals[sharp] = _refined(tilted, _SIGNED_PERMUTATIONS[sharp], coarse[sharp])

        if coarse[IDENTITY] > 0:
            sharpen(np.array([IDENTITY]))
        best, fits = IDENTITY, np.array([IDENTITY])
        if not residuals[IDENTITY] <= FITS_WITHIN * scales[IDENTITY] * path:  # else it fits, whatever others do
            residuals = np.where(coarse > 0, _closures(tilted, coarse[:, None, None] * _SIGNED_PERMUTATIONS), np.inf)
            sharpen(np.array([i for i in {*np.argsort(residuals)[:SHARPENED].tolist(), IDENTITY} if coarse[i] > 0], dtype=int))
            best = int(np.argmin(residuals))
            fits = np.flatnonzero(residuals <= max(FITS_TOO * residuals[best], FITS_WITHIN * scales[best] * path))
    else:
        best = int(np.argmin(misfits))
        fits = np.flatnonzero(misfits <= 1.5 * misfits[best] + 0.01)
        shown = turns.of(_shows_scale(turns, scales[best] * _SIGNED_PERMUTATIONS[best]))
        if len(shown) >= LEAST_TURNS and scales[best] > 0:
            scales[[best]], _ = _refined(shown, _SIGNED_PERMUTATIONS[[best]], scales[[best]])
            scale_std = SHARP
    if IDENTITY in fits:
        best, fits = IDENTITY, fits[:0]
    return AxesAgreement(
        axes=_SIGNED_PERMUTATIONS[best],
        scale=float(scales[best]),
        scale_std=scale_std,
        misfit=float(misfits[best]),
        identity_misfit=float(misfits[IDENTITY]),
        residual=float(residuals[best]),
        identity_residual=float(residuals[IDENTITY]),
        others=tuple(_SIGNED_PERMUTATIONS[i] for i in fits if i != best),
        turned=float(np.median(np.linalg.norm(scales[best] * turns.angle, axis=-1).sum(axis=1))),
        turns=len(turns),
        ends=len(tilted),
    )


def _cut_turns(samples: Samples, between: Sequence[Ends]) -> Turns | None:
    """Turns between two stills each, averaged over blocks; those with a gap, or that hardly tilt, are left out."""
    for block_s in BLOCKS_S:
        turns = _cut(samples, between, max(1, round(block_s / samples.period_s)))
        if turns is None or _lag(turns) < ROUND_A_CORNER:
            break
    return turns


def _lag(turns: Turns) -> float:
    """How far gravity's unit vector moves in a lag, in the fastest tenth of them."""
    moved = np.linalg.norm(turns.down[:, LAG_BLOCKS:] - turns.down[:, :-LAG_BLOCKS], axis=-1)
    return float(np.nanquantile(moved, 0.9)) if np.isfinite(moved).any() else 0.0


def _cut(samples: Samples, between: Sequence[Ends], size: int) -> Turns | None:
    parts = [part for a, b in between if (part := _blocks(samples, a, b, size)) is not None]
    parts = [part for part in parts if _tilt_path(part[1]) >= LEAST_TILT_RAD]
    return _padded(parts) if sum(_tilt_path(down) for _, down, _, _ in parts) >= LEAST_PATH_RAD else None


def _padded(parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]) -> Turns:
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
    if len(steps) < 2 * size or ((samples.gaps >= start) & (samples.gaps < stop - 1)).any():
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
    flat = _SIGNED_PERMUTATIONS.reshape(48, 9)
    power = np.einsum("pi,ij,pj->p", flat, normal, flat)
    scales = np.divide(flat @ right, power, out=np.zeros(48), where=power > 0)
    return scales, 1 - scales * (flat @ right) / max(power_seen, 1e-300)


def _refined(turns: Turns, axes: np.ndarray, scales: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each of orders (P, 3, 3), the scale (P,) about its own one that closes best, and its residual (P,): all in one walk."""
    tried = scales[:, None] * SCALES
    residuals = _closures(turns, (tried[..., None, None] * axes[:, None]).reshape(-1, 3, 3)).reshape(tried.shape)
    best = np.arange(len(tried)), np.argmin(residuals, axis=1)
    return tried[best], residuals[best]


def _shows_scale(turns: Turns, factor: np.ndarray) -> np.ndarray:
    """(S,) bool: turns whose end moves with the scale, as that of a whole circle does, too; none that goes out and back."""
    down = _carried(turns, np.array([[[1.0]], [[1 + COARSE]]]) * factor)
    return np.arccos(np.clip((down[0] * down[1]).sum(axis=-1), -1, 1)) > COARSE * LEAST_TILT_RAD


#: blocks that are carried at once: intermediate results stay in the processor's cache
AT_ONCE = 1 << 15


def _closures(turns: Turns, factors: np.ndarray) -> np.ndarray:
    """(F,) rad for factors (F, 3, 3) on the rate: median closure of the turns.

    A turn's closure is the angle between gravity in the last still and where the turn takes gravity of the first.
    """
    down = np.empty((len(factors), len(turns), 3))
    # Turns of like lengths together.  Padded to a power of two, they are multiplied as if padded to more.
    blocks = turns.angle.shape[1] - np.argmax(turns.angle[:, ::-1].any(axis=-1), axis=1)
    powers = np.frexp(blocks - 1)[1]
    for power in np.unique(powers):
        some = turns.of(powers == power)
        some = replace(some, angle=some.angle[:, : 1 << power])
        size = max(1, AT_ONCE // some.angle[..., 0].size)
        for k in range(0, len(factors), size):
            down[k : k + size, powers == power] = _carried(some, factors[k : k + size])
    sine = np.linalg.norm(np.cross(down, turns.last), axis=-1)
    return np.median(np.arctan2(sine, (down * turns.last).sum(axis=-1)), axis=-1)


def _carried(turns: Turns, factors: np.ndarray, last: bool = True) -> np.ndarray:
    """Gravity's direction (F, S, 3) at the end of each turn, carried by the rates from the first still; (F, S, B, 3) after each block where
    not the last alone is requested."""
    angle = np.einsum("fij,sbj->fsbi", factors, turns.angle)
    half = np.sqrt(np.sum(angle**2, axis=-1, keepdims=True)) / 2
    turned = rotation.accumulate(np.concatenate([np.cos(half), angle * (np.sinc(half / np.pi) / 2)], axis=-1))
    w, v, first = turned[..., :1], turned[..., 1:], turns.first[:, None]
    if last:
        w, v, first = w[..., -1, :], v[..., -1, :], turns.first
    # A fixed direction seen from a body that turns.
    cross = np.cross(v, first)
    return np.asarray(first - 2 * w * cross + 2 * np.cross(v, cross))


# Checks of the gyroscope against gravity: axes and signs, then the sensitivity.

CLEARLY = 0.5  #: another order of axes must halve what is unexplained
EXPLAINED = 0.5  #: of gravity's movement, or the axes are not reported
SCALE_OK = 0.05  #: a gyro's sensitivity tolerance, misalignment and this coarse look together
NAMED_WITHIN = 0.05
ENDS_ALONE = 8  #: turns from still to still that identify axes where a hand's pushes hide gravity within them
CLOSES_WITHIN = 0.10  #: of the angle turned: beyond what tolerances and misalignment of some percent leave
#: ST's sensitivity against full scale / 2^15, which most other makers have: 17.5 mdps for 500 dps / 32768, the same for all ranges
ST_OVER_FULL_SCALE = 17.5e-3 * 32768 / 500
#: of a step of the registers: data sheets round it by as much (65.5 LSB/dps, not 65.536)
SAME_STEP = 2e-3


def check_axes(log: Log, samples: Samples, between: Sequence[Ends], config: Config) -> list[Finding]:
    """The movement of gravity that the accelerometer shows must be the one that the gyro's rates make.

    48 signed orders of the gyro's axes are tried, each with the scale that suits it best: by how the turns end from still to still, and
    where they end as they began, by gravity within them.  Then another than x, y, z must leave less than half of the misfit to be
    believed.  Where two others fit, none is named.  The scale is compared with the usual mistakes.  samples: of the log, with the
    specific force in right units; between: the stills of each turn.
    """
    where = log.path.name
    found = agreement(samples, [], between)
    if found is None:
        text = "gravity hardly moves in the sensor, or all turns hold gaps: it cannot test the gyro's axes and units"
        return [Finding("note", where, "gyro against gravity", text, "turn about horizontal axes as well")]
    turns = f"{found.turns} turn{'s' if found.turns > 1 else ''} of {found.turned / DEG:.0f} deg"
    unclosed = np.isfinite(found.residual) and found.residual > CLOSES_WITHIN * found.turned
    # A hand that pushes hides gravity within a turn.  Enough ends are no chance of 48 orders.
    closes = found.ends >= ENDS_ALONE and not unclosed
    if (found.misfit > EXPLAINED and not closes) or unclosed:
        text = f"{turns}: gravity's movement is explained to {1 - found.misfit:.0%} (bar {EXPLAINED:.0%})"
        if unclosed:
            text += f", and missed by {found.residual / DEG:.1f} deg at the end (bar {CLOSES_WITHIN:.0%} of the turn)"
        do = "are gyro and accelerometer of one board, with one clock? are samples lost, does the gyro clip?"
        text += ", whatever the order, signs and scale of the gyro's axes"
        return [Finding("warning", where, "gyro against gravity", text, do)]
    axes = _axes_finding(where, found, turns)
    return [axes] if found.others else [axes, _scale_finding(log, found, turns, config)]


#: share of gravity's movement by the rates, at least: an accelerometer that follows is off by some per cent
FOLLOWS = 0.1


def check_gravity_moves(where: str, samples: Samples, between: Sequence[Ends]) -> list[Finding]:
    """Gravity must move in the sensor where the rates turn it: against an accelerometer that stays level any gyroscope closes, with a scale
    factor of nothing.  between: the stills of each turn."""
    size = max(1, round(BLOCKS_S[0] / samples.period_s))
    parts = [part for a, b in between if (part := _blocks(samples, a, b, size)) is not None]
    if not parts:
        return []
    turns = _padded(parts)
    cosines = np.einsum("sbi,si->sb", _carried(turns, np.eye(3)[None], last=False)[0], turns.first)
    by_rates = np.arccos(np.clip(cosines.min(axis=1), -1, 1))
    seen = np.einsum("sbi,si->sb", turns.down, turns.first)
    moved = np.arccos(np.clip(np.nanmin(np.column_stack([seen, np.ones(len(turns))]), axis=1), -1, 1))
    tilted = by_rates > LEAST_TILT_RAD
    stays = tilted & (moved < FOLLOWS * by_rates)
    if 2 * stays.sum() <= tilted.sum() or (moved > LEAST_TILT_RAD).any():  # it does answer: rather the rates' axes or units are wrong
        return []
    turned = f"{stays.sum()} of {tilted.sum()} turns in which the rates tilt it by {np.median(by_rates[stays]) / DEG:.0f} deg"
    do = "does the accelerometer answer at all, and is it on the board that was turned? else the rates are far too large"
    return [Finding("error", where, "gravity moves", f"stays within {np.max(moved[stays]) / DEG:.2g} deg in {turned}", do)]


def _axes_finding(where: str, found: AxesAgreement, turns: str) -> Finding:
    has_ends = np.isfinite(found.residual)
    ends = f", ends to {found.residual / DEG:.2f} deg" if has_ends else ""
    other = (found.axes != np.eye(3)).any() if has_ends else found.misfit < CLEARLY * found.identity_misfit
    if not other:
        return Finding("ok", where, "axes", f"the gyro explains gravity's movement to {1 - found.identity_misfit:.0%}{ends} ({turns})")
    text = f"explains gravity's movement to {1 - found.misfit:.0%}{ends}, as logged to {1 - found.identity_misfit:.0%}"
    text += f" and {found.identity_residual / DEG:.2f} deg" if np.isfinite(found.identity_residual) else ""
    if found.others:
        orders = [_axes_in_words(axes) for axes in (found.axes, *found.others)]
        text = f"not as logged: {' - or: '.join(orders[:2])}: {text} ({turns}); {len(orders)} orders fit alike, and none is chosen"
        return Finding("error", where, "axes", text, "turn about the third axis as well; correct the columns where the log is written")
    text = f"{_axes_in_words(found.axes)}: {text} ({turns})"
    gyro = Correction(_axes_in_words(found.axes), "gyro", axes=_rows(found.axes))
    do = "correct the columns or their signs where the log is written; a rotation of the board cannot do this"
    if np.linalg.det(found.axes) < 0:
        return Finding("error", where, "axes", text, do, (gyro,))
    # A gyro mirrored alone is the gyro's fault; a turned one can be the accelerometer's: d' = det(Q) d x Q'm if d is Q d.  Gravity's sign
    # does not show (d and -d move alike), so of Q and -Q the one that changes less is named.
    axes = max((found.axes.T, -found.axes.T), key=np.trace)
    other = _axes_in_words(axes).replace("gyro", "accelerometer").replace("; its triad is left-handed", "")
    do = f"correct the columns where the log is written; or it is the accelerometer: {other}"
    return Finding("error", where, "axes", text, do, (gyro, Correction(other, "accel", axes=_rows(axes))))


def _axes_in_words(axes: np.ndarray) -> str:
    """What is wrong with the gyro's columns, where ``omega = axes @ m`` for a signed permutation: one sentence part."""
    source, signs = np.argmax(np.abs(axes), axis=1), axes.sum(axis=1)
    flipped = ["xyz"[i] for i in range(3) if source[i] == i and signs[i] < 0]
    moved = [i for i in range(3) if source[i] != i]
    texts = []
    if len(moved) == 2:
        texts.append(f"the gyro's {'xyz'[moved[0]]} and {'xyz'[moved[1]]} are exchanged")
    elif moved:
        texts.append("the gyro's axes are in a wrong order")
    if len(flipped) == 3:
        texts.append("all three axes of the gyro have the wrong sign")
    elif flipped:
        of = "" if moved else "the gyro's "
        texts.append(f"{of}{' and '.join(flipped)} {'have' if len(flipped) > 1 else 'has'} the wrong sign")
    if moved:
        logged = [f"{'-' if signs[i] < 0 else '+'}{'xyz'[source[i]]}" for i in range(3)]
        texts.append("true " + ", ".join(f"{'xyz'[i]} is the logged {logged[i]}" for i in range(3)))
    if np.linalg.det(axes) < 0:
        texts.append("its triad is left-handed")
    return "; ".join(texts)


def _rows(axes: np.ndarray) -> Axes:
    return tuple((int(x), int(y), int(z)) for x, y, z in axes)


def _scale_finding(log: Log, found: AxesAgreement, turns: str, config: Config) -> Finding:
    """The factor that the rates need, against the factors of the usual mistakes."""
    where = log.path.name
    # By gravity within the turns alone, twice what a hand's pushes usually make of it.
    k, bar = found.scale, SCALE_OK if found.scale_std <= SCALE_OK else 2 * found.scale_std
    text = f"gravity requires rates x {measured(float(f'{k:.3g}'))} (bar 1 ± {bar:g}, {turns})"
    if abs(k - 1) <= bar:
        return Finding("ok", where, "gyro scale", text)
    step_mdps = min(smallest_step(axis) for axis in log.samples.gyro.T) / MDPS
    mistakes, within = _mistakes(config.sensor, log.raw, step_mdps), max(NAMED_WITHIN, found.scale_std)
    nearest = min(mistakes, key=lambda factor: abs(np.log(k / factor)))
    if abs(np.log(k / nearest)) <= within:
        causes = [_scale_correction(factor, config.sensor, log.raw) for factor in mistakes if abs(np.log(k / factor)) <= within]
        counted = [_counted_at(nearest, config.sensor)] if log.counted else []
        return Finding("error", where, "gyro scale", text, mistakes[nearest], tuple(each for each in [*causes, *counted] if each))
    profile, rate_hz = config.sensor.profile, config.sensor.odr_hz / k
    near = profile.nearest_hz(rate_hz) if log.counted and profile is not None else None
    level = "error" if abs(np.log(k)) > np.log(1.2) else "warning"
    explained = near is not None and abs(near / rate_hz - 1) <= within
    rates = (_counted_at(config.sensor.odr_hz / near, config.sensor),) if near is not None and explained else ()
    return Finding(level, where, "gyro scale", text, "no usual mistake has this factor; are the stamps the device's own time?", rates)


def _scale_correction(factor: float, sensor: Sensor, raw: bool) -> Correction | None:
    """What reverses a usual mistake by its factor; None where no setting of the sensor can."""
    full_scale = factor * sensor.gyro_fs_dps
    power = float(np.log2(factor)).is_integer()
    if raw:
        profile = sensor.profile
        if not power or (profile is not None and profile.gyro is not None and full_scale not in profile.gyro):
            return None
        settings = [("gyro_fs_dps", full_scale)]
        if sensor.gyro_mdps_per_lsb is not None:
            settings.append(("gyro_mdps_per_lsb", factor * sensor.gyro_mdps_per_lsb))
        return Correction(f"gyro_fs_dps is {full_scale:g}, not {sensor.gyro_fs_dps:g}", settings=tuple(settings))
    if power:
        text = f"the rates are {1 / factor:g} times the true ones: the full scale is {full_scale:g} dps, not {sensor.gyro_fs_dps:g}"
        return Correction(text, "gyro", factor, settings=(("gyro_fs_dps", full_scale),))
    if factor in (DEG, 1 / DEG):
        have, stated = ("deg/s", "rad/s") if factor == DEG else ("rad/s", "deg/s")
        return Correction(f"the rates are in {have}, and are read as {stated}", "gyro", factor)
    return Correction(f"the rates are {1 / factor:.5g} times the true ones", "gyro", factor)


def _counted_at(factor: float, sensor: Sensor) -> Correction:
    """Samples that were counted at a wrong rate turn as far as others with a wrong full scale."""
    rate_hz = sensor.odr_hz / factor
    return Correction(
        f"the samples were counted at {sensor.odr_hz:g} Hz, and came at {rate_hz:g}", "time", factor, settings=(("odr_hz", rate_hz),)
    )


def _mistakes(sensor: Sensor, raw: bool, step_mdps: float) -> dict[float, str]:
    """Correction factor -> what went wrong; step_mdps: of the readings, which shows by what a register was multiplied."""
    full_scale_dps, profile = sensor.gyro_fs_dps, sensor.profile
    mistakes = {
        DEG: "the rates are in deg/s, but are read as rad/s: name the columns gx_dps, gy_dps, gz_dps",
        1 / DEG: "the rates are in rad/s, but are read as dps: name the columns gx_rps, gy_rps, gz_rps",
        1e-3: "the rates are in mdps: divide by 1000; or time runs 1000 times too slowly: is it ns that are read as us?",
        1e3: "time runs 1000 times too fast: is it us that are read as ns? or the rates are 1000 times too small",
    }
    by_step = {1 / ST_OVER_FULL_SCALE: full_scale_dps / 32.768, ST_OVER_FULL_SCALE: ST_OVER_FULL_SCALE * full_scale_dps / 32.768}
    for factor, text in _sensitivities(full_scale_dps, profile).items():
        if abs(step_mdps / by_step[factor] - 1) > SAME_STEP:  # else they are multiplied by what they should be by this mistake
            mistakes[factor] = text
    for power in (-5, -4, -3, -2, -1, 1, 2, 3, 4, 5):
        factor = 2.0**power
        fits = factor * full_scale_dps
        has = profile is None or profile.gyro is None or fits in profile.gyro
        there = "" if has or not raw else " (which the sensor does not have)"
        do = "correct gyro_fs_dps in session.toml" if raw else "correct what converted the log"
        mistakes[factor] = f"wrong full scale: {fits:g} dps would match{there}, not {full_scale_dps:g}; {do}"
    return mistakes


def _sensitivities(full_scale_dps: float, profile: Profile | None) -> dict[float, str]:
    """ST's sensitivity taken for the full scale's at 32768 counts, which most others have, or the reverse."""
    to_span, st = (factor * full_scale_dps / 32768 * 1e3 for factor in (1.0, ST_OVER_FULL_SCALE))
    own = None if profile is None or profile.gyro is None else profile.gyro.get(full_scale_dps)
    if profile is not None and own is not None and abs(own / st - 1) < 1e-3:
        return {
            1 / ST_OVER_FULL_SCALE: (
                f"sensitivity: this sensor's is full scale / 32768 = {to_span:.3f} mdps per LSB, not the {profile.name}'s {st:.2f}"
            ),
            ST_OVER_FULL_SCALE: f"sensitivity: converted with full scale / 32768 = {to_span:.3f} mdps per LSB; the datasheet has {st:.2f}",
        }
    return {
        1 / ST_OVER_FULL_SCALE: (
            f"sensitivity: converted with ST's {st:.2f} mdps per LSB; most other sensors have full scale / 32768 = {to_span:.3f}"
        ),
        ST_OVER_FULL_SCALE: (
            f"sensitivity: converted with full scale / 32768 = {to_span:.3f} mdps per LSB; "
            f"ST's sensors have {st:.2f}: is sensor.model right?"
        ),
    }
