"""The vote itself, over consecutive samples for as long as nobody's standing changes.  The exported C does the same, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from tinygc.array.fused.medians import weighted_median
from tinygc.deploy.array.voting import ASIDE, BACK, DEAD, DIFFERS, FAST, FEWEST, IN, SLOW, SOON_STUCK, STUCK, Tables


@dataclass(frozen=True, eq=False)
class State:
    """Between two samples: why (N,) each unit is out, 0 for in; disagree: two units do; missing, same, agreed (N,) samples in a row without
    a reading, with the same one, and in agreement; last (N, 3) reading; middle (3,) of the units' last rates and change2 of the one
    before it, (rad/s)^2; mean (N, 3), allowed (N,) and square (N,): of d, of its allowance, and of u."""

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
    def start(cls, count: int) -> State:
        """All units believed, nothing seen."""
        whole, none = np.zeros(count, dtype=int), np.zeros((count, 3))
        return cls(whole, False, whole, whole, whole, none + np.nan, np.full(3, np.nan), 0.0, none, np.zeros(count), np.zeros(count))


@dataclass(frozen=True)
class Change:
    """Of one standing: index of the unit, None where two disagree; what, as ``Event`` has it; why."""

    unit: int | None
    what: str
    why: int


@dataclass(frozen=True, eq=False)
class Seen:
    """Of T samples by one standing: calibrated (T, N, 3); usable (T, N); used (T, N); at_end (T,); middle (T, 3); change2 (T,); apart
    (T, N, 3) = d; allowed (T,), the variance that motion adds; u (T, N); missing, same (T, N);
    disagreement (T, 3) of two units that differ, else None."""

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
    """Of the same samples: mean (T, N, 3) of d, allowed (T, N) of its allowance, square (T, N) of u; score (T, N): 1 at the bar."""

    mean: np.ndarray
    allowed: np.ndarray
    square: np.ndarray
    score: np.ndarray

    def size(self, tables: Tables, seen: Seen, unit: int | None, row: int) -> tuple[float, float]:
        """Of a difference, rad/s: how great, and its bar.  The mean one where that is beyond, else the root of the mean square."""
        i = int(np.argmax(self.score[row])) if unit is None else unit
        variance = tables.noise[i] * tables.share_of_noise + tables.fixed[i] + self.allowed[row, i]
        axis = int(np.argmax(self.mean[row, i] ** 2 / variance))
        size, bar = abs(float(self.mean[row, i, axis])), SLOW * float(np.sqrt(variance[axis]))
        if size > bar:
            return size, bar
        one = float(np.sqrt(np.max(tables.noise[i] + tables.fixed[i]) + seen.allowed[row]))
        return float(np.sqrt(self.square[row, i])) * one, float(np.sqrt(FAST)) * one


def look(tables: Tables, state: State, raw: np.ndarray, vote: bool) -> Seen:
    """Consecutive samples (T, N, 3) rad/s by the standing before them."""
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


def means(tables: Tables, state: State, seen: Seen) -> Means:
    """The running means of every unit, which stand still where it gives nothing to compare."""
    shape = seen.u.shape
    mean, allowed, square = np.empty((*shape, 3)), np.empty(shape), np.empty(shape)
    limit = ASIDE**2
    for i in range(shape[1]):
        use = seen.usable[:, i]
        u = seen.u[use, i]
        # a false reading beyond the limit counts as the limit does, and less in the mean the farther it is
        shrunk = seen.apart[use, i] * np.minimum(1.0, limit / np.maximum(u, 1e-30))[:, None]
        mean[:, i] = _followed(shrunk, state.mean[i], use, tables.alpha)
        allowed[:, i] = _followed(seen.allowed[use], state.allowed[i], use, tables.alpha)
        square[:, i] = _followed(np.minimum(u, limit), state.square[i], use, tables.alpha)
    variance = tables.noise * tables.share_of_noise + tables.fixed + allowed[..., None]
    slow = (mean**2 / variance).max(axis=2) / SLOW**2
    return Means(mean, allowed, square, np.maximum(slow, square / FAST))


def settle(tables: Tables, state: State, seen: Seen, means: Means) -> tuple[int, State, list[Change]]:
    """``(samples taken, state behind them, changes)``: up to and with the first sample that changes a standing."""
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
    if lies[row, worst] and not fails[row, worst]:  # one at a time: without it the median is another, and so is what is said of the rest
        told.append(Change(worst, "out", STUCK if seen.same[row, worst] >= SOON_STUCK else DIFFERS))
    if turned[row]:
        told.append(Change(None, "agree" if state.disagree else "disagree", DIFFERS))
    why, agreed_now = state.why.copy(), agreed[row].copy()
    for change in told:
        if change.unit is not None:
            why[change.unit] = change.why
            agreed_now[change.unit] = 0
    behind = State(
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
    """(T, ...): the running mean at every sample, of values (K, ...) at those with use (T,)."""
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
    """(T, N): for how many samples in a row something happens, begun with before (N,); where it holds, the count stands."""
    counts = np.empty(happens.shape, dtype=int)
    now = before
    for t in range(len(happens)):
        following = np.where(happens[t], now + 1, 0)
        now = following if holds is None else np.where(holds[t], now, following)
        counts[t] = now
    return counts


def _kept(middle: np.ndarray, before: np.ndarray) -> np.ndarray:
    """(T, 3): the last known median where a sample has none, so that what comes behind a gap is held against something."""
    whole = np.vstack([before, middle])
    known = np.isfinite(whole).all(axis=1)
    at = np.maximum.accumulate(np.where(known, np.arange(len(whole)), 0))
    return whole[at][1:]
