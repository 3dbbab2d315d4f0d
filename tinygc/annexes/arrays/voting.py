"""Fault detection in an array: which units are used, sample by sample and live."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from session.io.errors import CalibrationError
from tinygc.annexes.arrays.fusion import ends, fixed_variance, sample_variance, vote_weights
from tinygc.annexes.arrays.model import ArrayModel, combined, weighted_median

# Fault detection: limits, tables for the vote, and its events.
#
# Each unit's rate is compared with the units' weighted median. The allowance is one sample's noise, the units' disagreement in the
# calibration (bias, scale times rate, delay times the rate's change), and the median's own noise; d^2 over that variance, the greatest of
# the axes, is a sample's ``u``. Two means over ``MEMORY_S`` follow each unit: of d (which shows an offset below the noise), and of u.

#: s, time constant of the means; a fault of 5 limits is found in about a tenth of it
MEMORY_S = 0.5
#: sigmas from the median beyond which a sample is rejected at once (benchmarks/array_votes.py)
ASIDE = 6.0
#: limits of the mean difference, in sigmas, and of the mean of u, beyond which a unit is out (benchmarks/array_votes.py)
SLOW, FAST = 6.0, 9.0
#: share of both limits, in squared sigmas, below which a unit agrees again, and s that it has to (benchmarks/array_votes.py)
BACK, HOLD_S = 0.5, 1.0
#: s without a sample, and of identical readings on all axes, after which a unit is dead or stuck
DEAD_S, STUCK_S = 0.1, 0.5
#: number of identical readings after which a unit that differs is reported as stuck
SOON_STUCK = 4
#: ratio of the median's variance to the mean's, for many normal units
MEDIAN = np.pi / 2
#: fewest units among which the faulty one can be identified
FEWEST = 3

#: reasons why a unit is out
IN, DIFFERS, DEAD, STUCK = 0, 1, 2, 3
REASONS = {DIFFERS: "differs from the others", DEAD: "gives no samples", STUCK: "gives one and the same reading"}
BETWEEN_TWO = "two units differ: which one lies nobody can say"


@dataclass(frozen=True, eq=False)
class Tables:
    """Tables of fault detection, computed from a model, SI.

    matrix (N, 3, 3) and offset (N, 3) take the measured rate to the array's frame; weights (N, 3, 3); share (N,) in the median; noise (N,
    3) variance of a sample with the median's; fixed (N, 3) variance of constant errors: bias of the disagreement, bias instability,
    parameters; spread (N, 3, 3), each unit's part of a sample's variance of the combination; own (3,) variance of the combination by its
    parameters at rest; end (N,); scale2, delay2 of the disagreement, the last over the squared period; alpha of the means; dead, stuck,
    hold in samples.
    """

    matrix: np.ndarray
    offset: np.ndarray
    weights: np.ndarray
    share: np.ndarray
    noise: np.ndarray
    fixed: np.ndarray
    spread: np.ndarray
    own: np.ndarray
    end: np.ndarray
    scale2: float
    delay2: float
    alpha: float
    dead: int
    stuck: int
    hold: int

    @classmethod
    def of(cls, model: ArrayModel) -> Tables:
        """Compute the tables of a model."""
        rate, apart = model.rate_hz, model.disagreement
        own = model.parameter_sigma()
        white = model.density * rate / 2
        alone = np.stack([white[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(len(model))])
        spread = model.weights @ alone @ model.weights.transpose(0, 2, 1)
        # the contribution of correlation to the total is shared equally by all units
        spread *= np.trace(combined(model.weights, white)) / np.trace(spread.sum(axis=0))
        noise = sample_variance(model)
        return cls(
            model.matrices,
            model.offsets,
            model.weights,
            vote_weights(model),
            noise + MEDIAN * np.diag(spread.sum(axis=0)),
            fixed_variance(model),
            spread,
            np.zeros(3) if own is None else np.square(own),
            ends(model),
            apart.scale**2,
            (apart.delay_s * rate) ** 2,
            min(1 / (MEMORY_S * rate), 1 / 16),
            max(round(DEAD_S * rate), 2),
            max(round(STUCK_S * rate), 4),
            max(round(HOLD_S * rate), 4),
        )

    @property
    def share_of_noise(self) -> float:
        """Return the variance of a mean of white noise, relative to a sample's."""
        return self.alpha / (2 - self.alpha)


@dataclass(frozen=True)
class VotingEvent:
    """Change of a unit's status.

    sample (from 0) after which a unit (its number; None where two disagree and the faulty one is unknown) is ``out``, ``in`` again, or
    units ``disagree`` or ``agree`` again; reason; size and bar, rad/s, of the difference, NaN of others.
    """

    sample: int
    unit: int | None
    what: str
    reason: str = ""
    size_rps: float = float("nan")
    bar_rps: float = float("nan")


# The vote over consecutive samples, up to the first change of a unit's status. The exported C does the same, sample by sample.


@dataclass(frozen=True, eq=False)
class VotingState:
    """State between two samples.

    why (N,) each unit is out, 0 for in; disagree: two units do; missing, same, agreed (N,) consecutive samples without a reading, with the
    same one, and in agreement; last (N, 3) reading; middle (3,) of the units' last rates and change2 of the one before it, (rad/s)^2; mean
    (N, 3), allowed (N,) and square (N,): of d, of its allowance, and of u.
    """

    why: np.ndarray
    disagree: bool
    missing: np.ndarray
    same: np.ndarray
    agreed: np.ndarray
    last: np.ndarray
    middle: np.ndarray
    change2: float
    mean: np.ndarray
    allowed: np.ndarray
    square: np.ndarray

    @classmethod
    def start(cls, count: int) -> VotingState:
        """Return the initial state: all units in, no samples."""
        whole, none = np.zeros(count, dtype=int), np.zeros((count, 3))
        return cls(whole, False, whole, whole, whole, none + np.nan, np.full(3, np.nan), 0.0, none, np.zeros(count), np.zeros(count))


@dataclass(frozen=True)
class Change:
    """Change of one status: index of the unit, None where two disagree; what, as in ``VotingEvent``; why."""

    unit: int | None
    what: str
    why: int


@dataclass(frozen=True, eq=False)
class Seen:
    """Quantities of T samples with one status of all units.

    calibrated (T, N, 3); usable (T, N); used (T, N); at_end (T,); middle (T, 3); change2 (T,); apart (T, N, 3) = d; allowed (T,), the
    variance that motion adds; u (T, N); missing, same (T, N); disagreement (T, 3) of two units that differ, else None.
    """

    raw: np.ndarray
    calibrated: np.ndarray
    usable: np.ndarray
    used: np.ndarray
    at_end: np.ndarray
    middle: np.ndarray
    change2: np.ndarray
    apart: np.ndarray
    allowed: np.ndarray
    u: np.ndarray
    missing: np.ndarray
    same: np.ndarray
    disagreement: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Means:
    """Running means of the same samples: mean (T, N, 3) of d, allowed (T, N) of its allowance, square (T, N) of u; score (T, N): 1 at the
    limit."""

    mean: np.ndarray
    allowed: np.ndarray
    square: np.ndarray
    score: np.ndarray

    def size(self, tables: Tables, seen: Seen, unit: int | None, row: int) -> tuple[float, float]:
        """Return a difference and its limit, rad/s: the mean difference where it exceeds the limit, else the root of the mean square."""
        i = int(np.argmax(self.score[row])) if unit is None else unit
        variance = tables.noise[i] * tables.share_of_noise + tables.fixed[i] + self.allowed[row, i]
        axis = int(np.argmax(self.mean[row, i] ** 2 / variance))
        size, bar = abs(float(self.mean[row, i, axis])), SLOW * float(np.sqrt(variance[axis]))
        if size > bar:
            return size, bar
        one = float(np.sqrt(np.max(tables.noise[i] + tables.fixed[i]) + seen.allowed[row]))
        return float(np.sqrt(self.square[row, i])) * one, float(np.sqrt(FAST)) * one


def look(tables: Tables, state: VotingState, raw: np.ndarray, vote: bool) -> Seen:
    """Evaluate consecutive samples (T, N, 3) rad/s with the status before them."""
    believed = state.why == IN
    calibrated = np.einsum("nij,tnj->tni", tables.matrix, raw) + tables.offset
    present = np.isfinite(raw).all(axis=2)
    with np.errstate(invalid="ignore"):
        clipped = (np.abs(raw) >= tables.end[:, None]).any(axis=2)
    before = np.concatenate([state.last[None], raw[:-1]])
    same = _in_a_row(present & ~clipped & (raw == before).all(axis=2), state.same)
    missing = _in_a_row(~present, state.missing)
    usable = present & ~clipped
    middle = weighted_median(calibrated, usable & believed, tables.share)
    middle = _kept(middle, state.middle)
    step2 = np.square(np.diff(np.vstack([state.middle, middle]), axis=0)).sum(axis=1)
    step2[~np.isfinite(step2)] = 0.0
    change2 = np.maximum(step2, np.concatenate([[state.change2], step2[:-1]]))
    with np.errstate(invalid="ignore"):
        apart = calibrated - middle[:, None]
        allowed = tables.scale2 * np.square(middle).sum(axis=1) + tables.delay2 * change2
        u = (apart**2 / (tables.noise + tables.fixed + allowed[:, None, None])).max(axis=2)
    known = usable & np.isfinite(u)
    counted = (known & believed).sum(axis=1)
    trusted = usable & believed if vote else present & ~clipped
    aside = known & (u > ASIDE**2) & (counted >= FEWEST)[:, None] if vote else np.zeros_like(known)
    used = trusted & ~aside
    used = np.where(used.any(axis=1)[:, None], used, trusted)
    at_end = ~used.any(axis=1) & (present & believed).any(axis=1)
    used = np.where(at_end[:, None], present & believed, used)
    disagreement = None
    if vote and state.disagree:
        disagreement = np.where((known & believed)[..., None], np.abs(apart), 0.0).max(axis=1)
    u = np.where(known, u, np.nan)
    return Seen(raw, calibrated, known, used, at_end, middle, step2, apart, allowed, u, missing, same, disagreement)


def means(tables: Tables, state: VotingState, seen: Seen) -> Means:
    """Return the running means of every unit, which are held while it gives nothing to compare."""
    shape = seen.u.shape
    mean, allowed, square = np.empty((*shape, 3)), np.empty(shape), np.empty(shape)
    limit = ASIDE**2
    for i in range(shape[1]):
        use = seen.usable[:, i]
        u = seen.u[use, i]
        # a false reading beyond the limit counts as the limit, and less in the mean the farther it is
        shrunk = seen.apart[use, i] * np.minimum(1.0, limit / np.maximum(u, 1e-30))[:, None]
        mean[:, i] = _followed(shrunk, state.mean[i], use, tables.alpha)
        allowed[:, i] = _followed(seen.allowed[use], state.allowed[i], use, tables.alpha)
        square[:, i] = _followed(np.minimum(u, limit), state.square[i], use, tables.alpha)
    variance = tables.noise * tables.share_of_noise + tables.fixed + allowed[..., None]
    slow = (mean**2 / variance).max(axis=2) / SLOW**2
    return Means(mean, allowed, square, np.maximum(slow, square / FAST))


def settle(tables: Tables, state: VotingState, seen: Seen, means: Means) -> tuple[int, VotingState, list[Change]]:
    """Return ``(samples taken, state after them, changes)``: up to and with the first sample that changes a status."""
    believed = state.why == IN
    dead, stuck = seen.missing >= tables.dead, seen.same >= tables.stuck
    differs = (means.score > 1) & seen.usable & believed
    holds = ~seen.usable & (seen.missing < tables.dead)
    agreed = _in_a_row((means.score < BACK) & ~dead & ~stuck & seen.usable, state.agreed, holds)
    counted = (seen.usable & believed).sum(axis=1)
    lies = differs & (counted >= FEWEST)[:, None]
    fails = (dead | stuck) & believed
    back = ~believed & (agreed >= tables.hold)
    two = counted == FEWEST - 1
    agree = ~two | ((means.score < BACK) | ~believed).all(axis=1)
    turned = agree if state.disagree else two & differs.any(axis=1)
    changes = (lies | fails | back).any(axis=1) | turned
    row = int(np.argmax(changes)) if changes.any() else len(changes) - 1
    told = [Change(int(i), "out", DEAD if dead[row, i] else STUCK) for i in np.flatnonzero(fails[row])]
    told += [Change(int(i), "in", IN) for i in np.flatnonzero(back[row])]
    worst = int(np.argmax(np.where(lies[row] & ~fails[row], means.score[row], -1.0)))
    if lies[row, worst] and not fails[row, worst]:  # one at a time: without it the median changes, and all differences with it
        told.append(Change(worst, "out", STUCK if seen.same[row, worst] >= SOON_STUCK else DIFFERS))
    if turned[row]:
        told.append(Change(None, "agree" if state.disagree else "disagree", DIFFERS))
    why, agreed_now = state.why.copy(), agreed[row].copy()
    for change in told:
        if change.unit is not None:
            why[change.unit] = change.why
            agreed_now[change.unit] = 0
    behind = VotingState(
        why=why,
        disagree=state.disagree != bool(turned[row]),
        missing=seen.missing[row],
        same=seen.same[row],
        agreed=agreed_now,
        last=seen.raw[row],
        middle=seen.middle[row],
        change2=float(seen.change2[row]),
        mean=means.mean[row],
        allowed=means.allowed[row],
        square=means.square[row],
    )
    return row + 1, behind, told


def _followed(values: np.ndarray, before: np.ndarray, use: np.ndarray, alpha: float) -> np.ndarray:
    """Return the running mean (T, ...) at every sample, of values (K, ...) at those with use (T,)."""
    before = np.asarray(before)
    out = np.empty((len(use), *before.shape))
    if len(values):
        start = ((1 - alpha) * before)[None]
        mean, _ = lfilter([alpha], [1, alpha - 1], values, axis=0, zi=start)
        whole = np.concatenate([before[None], mean])
    else:
        whole = before[None]
    out[:] = whole[np.cumsum(use)]
    return out


def _in_a_row(happens: np.ndarray, before: np.ndarray, holds: np.ndarray | None = None) -> np.ndarray:
    """Return (T, N), the consecutive samples with an event, starting from before (N,); where it holds, the count is kept."""
    counts = np.empty(happens.shape, dtype=int)
    now = before
    for t in range(len(happens)):
        following = np.where(happens[t], now + 1, 0)
        now = following if holds is None else np.where(holds[t], now, following)
        counts[t] = now
    return counts


def _kept(middle: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return (T, 3): the last known median where a sample has none, as reference after a gap."""
    whole = np.vstack([before, middle])
    known = np.isfinite(whole).all(axis=1)
    at = np.maximum.accumulate(np.where(known, np.arange(len(whole)), 0))
    return whole[at][1:]


# Live fusion: the units' rates in; one rate, its sigma, and the excluded units with reasons out.

#: most samples evaluated together
BLOCK = 2048


@dataclass(frozen=True, eq=False)
class Fused:
    """Output of the fusion.

    rate (T, 3) rad/s in the array's frame, NaN where no unit gave one; sigma (T, 3) rad/s, infinite where every unit is saturated; used (T,
    N): units in the rate; events, in their order.
    """

    rate: np.ndarray
    sigma: np.ndarray
    used: np.ndarray
    events: tuple[VotingEvent, ...]


class LiveArray:
    """One stream of an array; after a pause, begin a new one.

    live = LiveArray(model)
    fused = live(raw)        # raw (N, 3) rad/s of one moment, a row NaN where a unit has none; or (T, N, 3) of consecutive ones
    """

    def __init__(self, model: ArrayModel, *, vote: bool = True):
        """vote: False uses every unit that gives a finite sample."""
        self.model, self.tables, self._vote = model, Tables.of(model), vote
        self._state = VotingState.start(len(model))
        self._sample = 0

    @property
    def out(self) -> dict[int, str]:
        """Return the number of each unit that is voted out, and why."""
        return {self.model.numbers[i]: REASONS[int(why)] for i, why in enumerate(self._state.why) if why != IN}

    @property
    def standing(self) -> dict[int, int]:
        """Return the number of each unit, and its status: ``IN``, ``DIFFERS``, ``DEAD`` or ``STUCK``, as in the exported C."""
        return {number: int(why) for number, why in zip(self.model.numbers, self._state.why, strict=True)}

    @property
    def disagree(self) -> bool:
        """Return whether the only two units left differ, so that the faulty one is unknown."""
        return self._state.disagree

    def __call__(self, raw: ArrayLike) -> Fused:
        """Combine the next samples: raw (N, 3) or (T, N, 3) rad/s as measured.  Raises CalibrationError for another shape."""
        rates = np.asarray(raw, dtype=float)
        if rates.shape[-2:] != (len(self.model), 3) or rates.ndim not in (2, 3):
            raise CalibrationError(f"raw has shape {rates.shape}, expected ({len(self.model)}, 3) or (T, {len(self.model)}, 3), rad/s")
        rates = rates.reshape(-1, len(self.model), 3)
        parts: list[Fused] = []
        at = 0
        while at < len(rates):
            part = self._block(rates[at : at + BLOCK])
            at += len(part.rate)
            parts.append(part)
        if not parts:
            nothing = np.zeros((0, 3))
            return Fused(nothing, nothing, np.zeros((0, len(self.model)), dtype=bool), ())
        rate, sigma, used = (np.concatenate(each) for each in zip(*((part.rate, part.sigma, part.used) for part in parts), strict=True))
        return Fused(rate, sigma, used, tuple(event for part in parts for event in part.events))

    def _block(self, rates: np.ndarray) -> Fused:
        """Process samples up to and with the one that changes a unit's status."""
        seen = look(self.tables, self._state, rates, self._vote)
        count = len(rates)
        events: list[VotingEvent] = []
        if self._vote:
            running = means(self.tables, self._state, seen)
            count, self._state, told = settle(self.tables, self._state, seen, running)
            events = [self._event(change, seen, running, count - 1) for change in told]
        self._sample += count
        used = seen.used[:count]
        rate, sigma = combine(self.tables, seen.calibrated[:count], used)
        sigma[seen.at_end[:count]] = np.inf
        if seen.disagreement is not None:
            sigma = np.sqrt(sigma**2 + seen.disagreement[:count] ** 2)
        return Fused(rate, sigma, used, tuple(events))

    def _event(self, change: Change, seen: Seen, running: Means, row: int) -> VotingEvent:
        number = None if change.unit is None else self.model.numbers[change.unit]
        nothing = (float("nan"), float("nan"))
        differs = change.why in (DIFFERS, STUCK) and change.what in ("out", "disagree")
        size, bar = running.size(self.tables, seen, change.unit, row) if differs else nothing
        reason = "" if change.what in ("in", "agree") else BETWEEN_TWO if change.unit is None else REASONS[change.why]
        return VotingEvent(self._sample + row, number, change.what, reason, size, bar)


def combine(tables: Tables, calibrated: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``(rate (T, 3), sigma (T, 3))`` rad/s of rates (T, N, 3) in the array's frame, those with used (T, N).

    The weights of the used units are renormalised, ``(sum of theirs)^-1 W_i``, which is optimal where noise is independent.
    """
    rate, sigma = np.full((len(used), 3), np.nan), np.full((len(used), 3), np.nan)
    kinds, which = np.unique(used, axis=0, return_inverse=True)
    which = which.reshape(-1)
    for kind, mask in enumerate(kinds):
        if not mask.any():
            continue
        rows = which == kind
        undo = np.linalg.inv(tables.weights[mask].sum(axis=0))
        rate[rows] = np.einsum("nij,tnj->ti", undo @ tables.weights[mask], calibrated[rows][:, mask])
        spread = undo @ tables.spread[mask].sum(axis=0) @ undo.T
        sigma[rows] = np.sqrt(np.diag(spread) + tables.own)
    return rate, sigma
