"""From sums and block means to the groups of contrasts that the likelihood takes; what is left out on the way.

Left out: a knock (a block with a reading far from its mean, or a mean far from its neighbours'), a spell that is noisier than the rest,
a register that stands still.  Limits are the recording's own: chance reaches them in one recording of a thousand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtri, fdtrc, ndtri

from session.base import features
from session.base.numeric import runs_of
from session.base.texts import measured, significant
from session.log.rests import RestLog
from tinygc.features.noise.summary import CHANNELS, MOST_WINDOW, Blocks, RestSums, contrasts, ratios_of

#: means of the coarsest level, which is one vector: the likelihood's cost goes with its cube, what more would give is below 3 %
#: (benchmarks/noise_terms.py)
TOP = 64
#: probability of a limit that chance exceeds somewhere in a recording
BY_CHANCE = 1e-3
#: on the limit of a peak: the noise of a real sensor has heavier tails (a tenth of a percent of the blocks of ADIS16405 at rest exceed 1)
HEAVIER = 1.25
#: a spell is noisier than the rest if its variance exceeds it by this share; less shows in the excess of the fit
NOISIER = 0.25
#: of a recording: more noisy spells than this are its noise, not spells
MOST_LEFT_OUT = 0.2
#: probability of a difference between halves as large by chance, below which it is reported; windows of a half
STEADY, FEWEST_WINDOWS = 1e-4, 8
#: windows of the finest scale in a rest that is compared with another
MANY_WINDOWS = 1000
#: times by which the halves differ where it is worth a sentence
WORTH_REPORTING = 1.25
#: of a block's readings that repeat all six before them: it stands still
STUCK = 0.9
#: blocks in a row in which one channel's readings are all equal; share of a rest above which its register has but few steps
STILL_BLOCKS, MOST_STILL = 10, 0.5
#: of a window's means that must be there for the mean of the window
PRESENT = 0.75


@dataclass(frozen=True, eq=False)
class Group:
    """Windows of one scale.

    size: samples of each mean; at (M,): places of the means in a window, in their own lengths; basis (M, d): contrasts; S (d, d): sum of
    products over the windows; count: how many; top: whether it is a rest's coarsest vector; middle (M,): times of its means, in their own
    lengths, of which some lack a part.
    """

    size: int
    at: np.ndarray
    basis: np.ndarray
    S: np.ndarray
    count: float
    top: bool = False
    middle: np.ndarray | None = None

    def t(self) -> np.ndarray:
        """Return the contrasts (d,) of a ramp of 1 from one mean to the next."""
        return np.asarray(self.basis.T @ (self.at if self.middle is None else self.middle))


@dataclass(frozen=True, eq=False)
class Rest:
    """One rest, ready: blocks; bad (B,): left out; counted (B,): whose readings are in the sums; sums and counts by chunk, of these;
    seconds: left out, by kind; first_s: when that began; unsteady: whether its noise differs between spells."""

    blocks: Blocks
    bad: np.ndarray
    counted: np.ndarray
    sums: list[np.ndarray]
    counts: np.ndarray
    block_s: float
    seconds: dict[str, float]
    first_s: dict[str, float]
    unsteady: bool

    @property
    def left_out_s(self) -> float:
        """Time of the bad blocks, s."""
        return float(np.count_nonzero(self.bad)) * self.block_s


def rest_of(sums: RestSums) -> Rest:
    """Find what is to be left out."""
    blocks, by_level, counts = sums.ended()
    block_s = blocks.size * sums.period_s
    kinds: dict[str, np.ndarray] = {}
    if len(blocks):
        # Blocks of spells in which one channel, which moves elsewhere, does not
        found = np.zeros(len(blocks), bool)
        for channel in range(CHANNELS):
            still = blocks.peak[:, channel] == 0
            if not still.any() or np.mean(still) > MOST_STILL:
                continue
            for start, stop in zip(*runs_of(still), strict=True):
                if stop - start >= STILL_BLOCKS:
                    found[start:stop] = True
        kinds["stuck"] = (blocks.stuck >= STUCK * (blocks.size - 1)) | found
        peak = np.zeros(len(blocks), bool)
        for channel in range(CHANNELS):
            peak |= above_chance(blocks.peak[:, channel].astype(float), kinds["stuck"], blocks.size)
        kinds["knock"] = (peak | _leaps(blocks, kinds["stuck"])) & ~kinds["stuck"]
    bad = np.logical_or.reduce([*kinds.values()]) if kinds else np.zeros(0, bool)
    out = np.zeros(len(counts), bool)
    out[blocks.chunk[bad]] = True
    noisy = _noisy_chunks(by_level[0], counts[:, 0], out)
    if noisy.any():
        spell = noisy[blocks.chunk]
        if counts[noisy].sum() <= MOST_LEFT_OUT * counts.sum():
            kinds["noisier"] = spell & ~bad
            bad, out = bad | spell, out | noisy
    seconds = {kind: float(np.count_nonzero(mask)) * block_s for kind, mask in kinds.items() if mask.any()}
    first_s = {kind: float(blocks.number[np.argmax(kinds[kind])]) * block_s for kind in seconds}
    unsteady = bool(noisy.any()) and "noisier" not in kinds
    return Rest(blocks, bad, ~out[blocks.chunk], [level[:, ~out] for level in by_level], counts[~out], block_s, seconds, first_s, unsteady)


#: what is left out, in words
WORDS = {"stuck": "Readings stand still", "knock": "Knocks", "noisier": "Spells noisier than the rest"}


def left_out(rests: Sequence[Rest]) -> list[str]:
    """What was left out of all rests together, and when it began where there is one rest."""
    remarks = []
    for kind, words in WORDS.items():
        if seconds := sum(rest.seconds.get(kind, 0.0) for rest in rests):
            when = f" (from {measured(rests[0].first_s[kind])} s on)" if len(rests) == 1 else ""
            remarks.append(f"{words}: {significant(seconds)} s left out{when}.")
    if any(rest.unsteady for rest in rests):
        remarks.append("The noise is not steady: it differs between spells by more than chance, and the figures are its mean.")
    return remarks


def above_chance(peaks: np.ndarray, but: np.ndarray, size: int) -> np.ndarray:
    """Return which largest deviations (n,) of blocks of ``size`` readings are larger than Gaussian noise reaches in one recording of 1000.

    The scale, and an excess of the spread, are the recording's own: by the median and the upper quartile of the peaks.
    """
    if np.count_nonzero(~but) < 8 or not np.isfinite(peaks).all():
        return np.zeros(len(peaks), bool)
    middle, high = np.quantile(peaks[~but], (0.5, 0.75))
    sigmas = {p: -ndtri((1 - p ** (1 / size)) / 2) for p in (0.5, 0.75)}
    far = -ndtri(BY_CHANCE / (2 * size * len(peaks)))
    limit = middle + (high - middle) * (far - sigmas[0.5]) / (sigmas[0.75] - sigmas[0.5])
    return np.asarray(peaks > HEAVIER * limit)


def _leaps(blocks: Blocks, but: np.ndarray) -> np.ndarray:
    """Blocks whose mean is far from the mean of both neighbours: second differences beyond a Gaussian's by chance."""
    found = np.zeros(len(blocks), bool)
    if len(blocks) < 16:
        return found
    second = np.zeros(blocks.mean.shape)
    second[1:-1] = blocks.mean[1:-1] - (blocks.mean[2:] + blocks.mean[:-2]) / 2
    joined = np.zeros(len(blocks), bool)
    joined[1:-1] = (blocks.number[2:] - blocks.number[:-2] == 2) & ~(but[2:] | but[:-2] | but[1:-1])
    if not joined.any():
        return found
    limit = np.sqrt(2 * np.log(len(blocks) / BY_CHANCE))
    for channel in range(CHANNELS):
        size = np.abs(second[:, channel])
        sigma = float(np.median(size[joined])) / 0.6745
        if np.isfinite(sigma) and sigma > 0:
            found |= joined & (size > limit * sigma)
    return found


def _noisy_chunks(sums: np.ndarray, windows: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Chunks whose variance at the finest level exceeds the usual one on some channel by ``NOISIER`` and by more than chance."""
    found = np.zeros(len(windows), bool)
    whole = (windows >= np.median(windows[~out]) / 2) & ~out if np.any(~out) else out
    if np.count_nonzero(whole) < 8:
        return found
    variance = np.trace(sums, axis1=2, axis2=3) / np.maximum(windows * sums.shape[2], 1)
    for own in variance:
        usual = float(np.median(own[whole]))
        if not np.isfinite(usual) or usual <= 0:
            continue
        spread = float(np.median(np.abs(own[whole] / usual - 1))) / 0.6745
        # A variance scatters as chi-square; one that scatters more, as chi-square of fewer degrees of freedom.
        freedom = np.minimum(windows * sums.shape[2], 2 / max(spread, 1e-6) ** 2)
        chance = chdtri(np.maximum(freedom, 1e-3), BY_CHANCE / len(variance) / len(windows)) / np.maximum(freedom, 1e-3)
        found |= (windows > 0) & (own > np.maximum(1 + NOISIER, chance) * usual)
    return found & ~out


def groups_of(rests: Sequence[Rest], channel: int, residuals: Sequence[np.ndarray], regressors: Sequence[np.ndarray]) -> list[Group]:
    """Return the groups of one channel.

    residuals: of each rest, its block means (B,) less what temperature explains; regressors: of each rest, columns (B, p) whose
    coefficients were estimated: they are projected out of the coarsest vector.
    """
    fine: dict[tuple[int, int], Group] = {}
    for rest, means in zip(rests, residuals, strict=True):
        slopes = _slopes_within(rest, channel, means)
        for level, (size, ratio) in enumerate(_sizes(rest.blocks.size)):
            if not (count := float(rest.counts[:, level].sum())):
                continue
            ramp = contrasts(ratio).T @ (np.arange(ratio) * size)
            windows = rest.blocks.size / (size * ratio)
            S = rest.sums[level][channel].sum(axis=0) - slopes * windows * np.outer(ramp, ramp)
            before = fine.get((size, ratio))
            fine[size, ratio] = (
                Group(size, np.arange(ratio), contrasts(ratio), S, count)
                if before is None
                else replace(before, S=before.S + S, count=before.count + count)
            )
    found = list(fine.values())
    coarse: dict[tuple[int, int], list[np.ndarray]] = {}
    tops = []
    for rest, means, columns in zip(rests, residuals, regressors, strict=True):
        levels, top = _coarse(rest, means, columns)
        for key, z in levels:
            coarse.setdefault(key, []).append(z)
        tops += [top] if top is not None else []
    for (size, ratio), parts in coarse.items():
        z = np.concatenate(parts)
        found.append(Group(size, np.arange(ratio), contrasts(ratio), z.T @ z, len(z)))
    pooled: dict[tuple[int, bytes, bytes], Group] = {}
    for top in tops:  # stills of one length are windows of one scale
        shape = (top.size, top.at.tobytes(), top.basis.tobytes())
        before = pooled.get(shape)
        pooled[shape] = top if before is None else replace(before, S=before.S + top.S, count=before.count + 1)
    return found + list(pooled.values())


def _slopes_within(rest: Rest, channel: int, residual: np.ndarray) -> float:
    """Sum over the counted blocks of the square of what temperature adds from one sample to the next: it is in their windows, too."""
    explained = rest.blocks.mean[:, channel] - residual
    if not explained.any():
        return 0.0
    good = ~rest.bad
    slope = np.interp(
        rest.blocks.number, rest.blocks.number[good], np.gradient(explained[good], rest.blocks.number[good] * rest.blocks.size)
    )
    return float(np.sum(slope[rest.counted] ** 2))


def _sizes(block: int) -> list[tuple[int, int]]:
    sizes, size = [], 1
    for ratio in ratios_of(block):
        sizes.append((size, ratio))
        size *= ratio
    return sizes


def _coarse(rest: Rest, means: np.ndarray, columns: np.ndarray) -> tuple[list[tuple[tuple[int, int], np.ndarray]], Group | None]:
    """Return the levels above a block, (size, ratio) and contrasts (n, M - 1), and the coarsest vector; None for less than two means."""
    size, good = rest.blocks.size, ~rest.bad
    number, y, X = rest.blocks.number[good], means[good], columns[good]
    middle = number.astype(float)
    found = []
    while len(y) > TOP:
        ratio = min(MOST_WINDOW // 2, 2 ** int(np.ceil(np.log2(len(y) / TOP))))
        window, starts, counts = np.unique(number // ratio, return_index=True, return_counts=True)
        whole = starts[counts == ratio]
        found.append(((size, ratio), y[whole[:, None] + np.arange(ratio)] @ contrasts(ratio)))
        kept = counts >= PRESENT * ratio
        y = (np.add.reduceat(y, starts) / counts)[kept]
        X = (np.add.reduceat(X, starts, axis=0) / counts[:, None])[kept]
        middle = ((np.add.reduceat(middle, starts) / counts - (ratio - 1) / 2) / ratio)[kept]
        number, size = window[kept], size * ratio
    if len(y) < 2:
        return found, None
    basis = _without(np.column_stack([np.ones(len(y)), X]))
    if not basis.shape[1]:
        return found, None
    z = basis.T @ y
    return found, Group(size, number - number[0], basis, np.outer(z, z), 1.0, top=True, middle=middle - number[0])


#: what the figures are where the noise differs
MEAN = "; the figures are their mean."


def unsteady(rests: Sequence[Rest], channel: int, residuals: Sequence[np.ndarray], period_s: float) -> list[str]:
    """Where a channel's noise differs by more than chance: between the halves of a rest, at the scale that shows it best, as in a
    warming sensor or a spell of draught; and between long rests, which are one estimate all the same."""
    remarks, whole = [], []
    for rest, means in zip(rests, residuals, strict=True):
        sums = rest.sums[0][channel]
        ratio = sums.shape[1] + 1
        fine = np.trace(sums, axis1=1, axis2=2), rest.counts[:, 0] * (ratio - 1)
        whole.append(np.sum(fine, axis=1))
        coarse, _ = _coarse(rest, means, np.zeros((len(means), 0)))
        levels = [(ratio, *fine)] + [(size * each, np.sum(z**2, axis=1), np.full(len(z), z.shape[1])) for (size, each), z in coarse]
        looks = [
            (*_apart(np.add.reduceat(squares, [0, half]), np.add.reduceat(freedom, [0, half])), samples)
            for samples, squares, freedom in levels
            if (half := len(squares) // 2) >= FEWEST_WINDOWS
        ]
        p_value, noisier, times, samples = min(looks, default=(1.0, 0, 1.0, 0))
        if p_value * max(len(looks), 1) < STEADY:
            over, which = measured(float(f"{samples / 2 * period_s:.3g}")), ("first", "second")[noisier]
            remarks.append(f"over {over} s, the noise of its {which} half is {significant(times, 2)} times that of the other{MEAN}")
    long = [k for k, rest in enumerate(rests) if rest.counts[:, 0].sum() >= MANY_WINDOWS]
    if len(long) > 1:
        squares, freedom = np.array(whole)[long].T
        ends = np.argsort(squares / freedom)[[0, -1]]
        p_value, _, times = _apart(squares[ends], freedom[ends])
        if p_value < STEADY:
            low, high = (long[end] + 1 for end in ends)
            remarks.append(f"log {high} is {significant(times, 2)} times as noisy as log {low}{MEAN}")
    return remarks


def _apart(squares: np.ndarray, freedom: np.ndarray) -> tuple[float, int, float]:
    """Chance of two variances as different, of sums of squares (2,) with degrees of freedom (2,), 1 where that is not worth a sentence;
    which one is larger, and by how many times its root."""
    variance = squares / np.maximum(freedom, 1)
    high = int(np.argmax(variance))
    share = float(variance[high] / variance[1 - high]) if variance.min() > 0 else 1.0  # of an axis that does not change here: nothing
    return (2 * float(fdtrc(freedom[high], freedom[1 - high], share)) if share > WORTH_REPORTING**2 else 1.0), high, share**0.5


def _without(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (n, n - rank) of what is orthogonal to columns (n, p)."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    u, size, _ = np.linalg.svd(scaled, full_matrices=True)
    return u[:, int(np.count_nonzero(size > 1e-9)) :]


# What of a rest goes with its temperature: it is no noise, and is taken off before the slow terms are estimated.

#: degC: a smaller range shows nothing, and the self-heating of a switched-on sensor is larger
LEAST_RANGE_C = 1.0
#: blocks of a long rest, at least
LEAST_BLOCKS = 100


def is_long(rest: Rest) -> bool:
    """Whether a rest is long enough to be moved by temperature: a still is not."""
    return int(np.count_nonzero(~rest.bad)) >= LEAST_BLOCKS


def knots_of(rests: Sequence[Rest]) -> Any:
    """Return the long rests' good blocks over temperature; None where one has no temperature, where it hardly changes, or without a feature
    that knows what a zero does over temperature."""
    logs = []
    for rest in filter(is_long, rests):
        good, blocks = ~rest.bad, rest.blocks
        if not np.isfinite(blocks.temp_c[good]).all():
            return None
        none = np.zeros((int(np.count_nonzero(good)), 3))
        means = blocks.mean[good]
        count = np.full(len(none), blocks.size)
        number, temp_c, rates, forces = blocks.number[good], blocks.temp_c[good], means[:, :3], means[:, 3:]
        logs.append(RestLog(Path("rest"), number, rest.block_s, temp_c, rates, forces, none, none, count, 0, 1.0, grid=blocks.grid))
    model = next(features.each("zero over temperature"), None)
    if not logs or max(float(np.ptp(log.temp_c)) for log in logs) < LEAST_RANGE_C or model is None:
        return None
    return model.knots_of(logs)


def temperature_part(rests: Sequence[Rest], channel: int, knots: Any) -> tuple[list[np.ndarray], list[np.ndarray], float]:
    """Fit the channel's zero over temperature with its lag; without knots there is no part.

    Returns, of each rest, its block means (B,) less the part, and columns (B, p) of what was estimated; and the part's rms, SI.
    """
    raw = [rest.blocks.mean[:, channel] for rest in rests]
    none = raw, [np.zeros((len(own), 0)) for own in raw], 0.0
    if knots is None:
        return none
    if not all(np.isfinite(own).all() for own in raw):  # of an accelerometer that is not there
        return none
    kept = [~rest.bad if is_long(rest) else np.zeros(len(rest.bad), bool) for rest in rests]
    means = np.concatenate([own[mask] for own, mask in zip(raw, kept, strict=True)])
    if (part := next(features.each("zero over temperature")).part_of(knots, means)) is None:
        return none
    zero, powers = part
    edges = np.cumsum([np.count_nonzero(mask) for mask in kept])[:-1]
    residuals, columns = [], []
    for own, mask, of_zero, of_powers in zip(raw, kept, np.split(zero, edges), np.split(powers, edges), strict=True):
        less, wide = own.copy(), np.zeros((len(own), powers.shape[1]))
        less[mask] -= of_zero
        wide[mask] = of_powers
        residuals.append(less)
        columns.append(wide)
    return residuals, columns, float(np.std(zero))
