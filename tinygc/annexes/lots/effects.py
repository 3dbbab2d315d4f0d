"""Effects of a lot, found by pooling weak estimates of many units (random effects)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from tinygc.annexes.lots.lot import PooledEffect, UnitResult, Weighed

# Estimates of each effect over the units of a lot, as arrays with a row for each unit.

#: most units that are pooled: an effect too weak for this many is negligible in any unit
MOST_UNITS = 2000
#: limit of a unit's sigma, in median sigmas of the lot; beyond it, the unit does not determine the number
UNSEEN = 30.0


@dataclass(frozen=True, eq=False)
class Estimates:
    """One effect over the lot: names of its numbers (P,), x and sigma (N, P), NaN where a unit does not determine it."""

    id: str
    names: tuple[str, ...]
    x: np.ndarray
    sigma: np.ndarray

    @property
    def told(self) -> np.ndarray:
        """Return (N,): which units have all numbers."""
        return np.isfinite(self.x).all(axis=1)


def estimates_of(units: Iterable[UnitResult], seed: int = 0) -> list[Estimates]:
    """Collect the estimates of each effect that any unit has, in the order of their ids."""
    by_unit = _drawn(units, seed)
    names: dict[str, tuple[str, ...]] = {}
    for sessions in by_unit.values():
        for effects in sessions:
            for effect, weighed in effects.items():
                names.setdefault(effect, tuple(weighed.estimates))
    found = []
    for effect, parts in sorted(names.items()):
        rows = [_of_unit([each[effect] for each in sessions if effect in each], parts) for sessions in by_unit.values()]
        x, sigma = (np.array([row[i] for row in rows]) for i in (0, 1))
        told = np.isfinite(sigma).any(axis=0)
        usual = np.array([np.nanmedian(column) if there else np.nan for column, there in zip(sigma.T, told, strict=True)])
        blind = ~(sigma <= UNSEEN * usual)
        x[blind], sigma[blind] = np.nan, np.nan
        kept = np.isfinite(x).mean(axis=0) > 0.5  # drops a number that most units do not determine
        if kept.any():
            parts = tuple(name for name, keep in zip(parts, kept, strict=True) if keep)
            found.append(Estimates(effect, parts, x[:, kept], sigma[:, kept]))
    return found


def _drawn(units: Iterable[UnitResult], seed: int) -> dict[str, list[Mapping[str, Weighed]]]:
    """Draw this many units with equal probability (Vitter 1985, algorithm R), in one pass, and return their sessions' effects by unit."""
    rng, found = np.random.default_rng(seed), dict[str, list[Mapping[str, Weighed]]]()
    seen, places = dict[str, bool](), list[str]()
    for number, unit in enumerate(units):
        name = unit.serial or f"\0{number}"
        if name not in seen:
            place = len(places) if len(places) < MOST_UNITS else int(rng.integers(len(seen) + 1))
            seen[name] = place < MOST_UNITS
            if place == len(places):
                places.append(name)
            elif place < MOST_UNITS:
                found.pop(places[place], None)
                seen[places[place]] = False
                places[place] = name
        if seen[name] and unit.effects:
            found.setdefault(name, []).append(unit.effects)
    return found


def _of_unit(sessions: list[Weighed], parts: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the weighted mean (P,) of a unit's sessions, and its sigma (P,)."""
    told = [(each.estimates, each.sigmas) for each in sessions if tuple(each.estimates) == parts]
    if not told:
        return np.full(len(parts), np.nan), np.full(len(parts), np.nan)
    x, sigma = (np.array([[each[i][name] for name in parts] for each in told], dtype=float) for i in (0, 1))
    weight = np.where(np.isfinite(x) & (sigma > 0), 1 / sigma**2, 0.0)
    total = weight.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(total > 0, np.nansum(weight * x, axis=0) / total, np.nan), np.where(total > 0, total**-0.5, np.nan)


# Effects of a lot: one that is weak in each of many units, found by pooling them (random effects).
#
# Each unit's session gives an estimate of every effect of the catalogue, with its sigma and without selection (``Weighed``). Without an
# effect, the estimates of a unit have a symmetric distribution, jointly for all effects. So a mean is tested against the same lot with
# random signs of its units, which holds whatever the errors of the sigmas and the correlations of effects; the largest of all effects is
# compared with the largest of each draw, so that the level is that of the catalogue (Westfall & Young 1993). The mean must also be
# significant by the stated sigmas: a smaller common part may be the table's, or the method's. An effect with either sign has no mean; the
# spread of its estimates is tested against that of the whole catalogue.
#
# An effect leaks into the columns of another in each unit. So after one effect is reported, another is tested for what remains in a unit
# without the first.

#: level of the catalogue, for one lot (benchmarks/lot_effects.py: how often a lot without effects reports one)
FAMILY_WISE = 0.05
#: random draws of the units' signs
DRAWS = 4000
#: sigmas at which a unit's estimate is clipped, so that one outlier does not dominate the lot
MOST_SIGMAS = 3.0
#: fewest units: with N units the smallest p-value is 2^-N
FEWEST = 8
#: -2 log likelihood within which an effect is equivalent to another (Kass & Raftery 1995: "very strong" beyond)
STAND_IN = 10.0
#: grid of shares and spreads for the mixture
GRID = 41
#: log likelihood within which all units are taken to have an effect, rather than a share of them: half of chi-square's 5 %, for one more
#: number
ALIKE = 1.92


def pooled(units: Iterable[UnitResult], seed: int = 0) -> dict[str, PooledEffect]:
    """Return the effects that a lot has, by id; none where none is significant.

    Several sessions of a unit count as one; of more than ``MOST_UNITS`` units that many are drawn.
    """
    effects = [each for each in estimates_of(units, seed) if each.told.sum() >= FEWEST]
    if not effects:
        return {}
    found: dict[str, PooledEffect] = {}
    scores = [scores_of(each) for each in effects]
    first = corrected_p(effects, scores, seed)
    strength = {each.id: -2 * log_p for each, (_, log_p) in zip(effects, first, strict=True)}
    p_values = {each.id: p for each, (p, _) in zip(effects, first, strict=True)}
    leaders: list[Estimates] = []
    left = {each.id: each for each in effects if p_values[each.id] <= FAMILY_WISE}
    while left:
        best = max(left.values(), key=lambda each: strength[each.id]) if not leaders else None
        p_value = 0.0
        if best is None:
            beside = {name: min(1.0, len(effects) * beside_leaders(each, leaders)) for name, each in left.items()}
            name = min(beside, key=lambda name: beside[name])
            if beside[name] > FAMILY_WISE:
                break
            best, p_value = left[name], beside[name]
        del left[best.id]
        leaders.append(best)
        found[best.id] = _pooled(best, max(p_values[best.id], p_value))
    for name in left:  # effects explained by the reported ones are equivalent where the estimates cannot separate them
        for leader in leaders:
            if strength[name] > strength[leader.id] - STAND_IN:
                found[leader.id] = replace(found[leader.id], equivalent=(*found[leader.id].equivalent, name))
    return found


def scores_of(effect: Estimates) -> np.ndarray:
    """Return (N, P): each unit's contribution to the mean, odd in its sign, bounded; zero for a unit that does not determine it."""
    x, sigma = effect.x[effect.told], effect.sigma[effect.told]
    wide = np.hypot(sigma, np.sqrt(spread_about(x, sigma, 0.0)))
    found = np.zeros(effect.x.shape)
    found[effect.told] = np.clip(x / wide, -MOST_SIGMAS, MOST_SIGMAS) * (np.median(wide, axis=0) / wide)
    return found


def spread_about(x: np.ndarray, sigma: np.ndarray, mean: np.ndarray | float) -> np.ndarray:
    """Return (P,) variance between units about a mean, by the median of squares: half of the units lie within 0.67 sigmas."""
    excess = (x - mean) ** 2 / stats.chi2.ppf(0.5, 1) - sigma**2
    return np.maximum(np.median(excess, axis=0), 0.0)


def corrected_p(effects: list[Estimates], scores: list[np.ndarray], seed: int) -> list[tuple[float, float]]:
    """Return for each effect the p-value that no unit has it, corrected for the catalogue, and the logarithm of its own."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (DRAWS, len(scores[0])))
    drawn = np.array([log_p(score, signs) for score in scores])
    lowest = np.sort(drawn.min(axis=0))
    found = []
    spread = spread_log_p(effects)
    for each, score, wide in zip(effects, scores, spread, strict=True):
        mean = float(log_p(score, np.ones((1, len(score))))[0])
        chance = float((1 + np.searchsorted(lowest, mean, side="right")) / (DRAWS + 1))
        if chance <= 2 / (DRAWS + 1):  # below the resolution of the draws: corrected as for this many independent tests (Sidak)
            tests = np.log1p(-0.1) / np.log1p(-np.exp(lowest[DRAWS // 10]))
            chance = min(chance, float(-np.expm1(tests * np.log1p(-np.exp(max(mean, -700.0))))))
        chance = max(chance, min(1.0, len(effects) * stated_p(each)))
        by_spread = min(1.0, len(effects) * float(np.exp(wide)))
        found.append((min(1.0, 2 * min(chance, by_spread)), min(mean, wide)))
    return found


def stated_p(effect: Estimates) -> float:
    """Return the p-value of so large a mean in one of its numbers, by the stated sigmas."""
    x, sigma = effect.x[effect.told], effect.sigma[effect.told]
    z = np.sum(x / sigma**2, axis=0) / np.sqrt(np.sum(sigma**-2.0, axis=0))
    return min(1.0, len(effect.names) * float(2 * stats.norm.sf(np.abs(z).max())))


def log_p(score: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """Return (draws,) log probability of so large a mean: Hotelling's square with the scores' second moment, which signs do not change."""
    moment = score.T @ score
    size, axes = np.linalg.eigh(moment)
    seen = size > 1e-6 * max(float(size[-1]), 1e-300)
    if not seen.any():  # no unit has an estimate
        return np.zeros(len(signs))
    means = signs @ (score @ (axes[:, seen] / np.sqrt(size[seen])))
    return np.asarray(stats.chi2.logsf(np.sum(means**2, axis=1), int(seen.sum())))


def spread_log_p(effects: list[Estimates]) -> list[float]:
    """Test for each effect whether its mean square exceeds the whole catalogue's, relative to its own scatter over the units."""
    squares = []
    for each in effects:
        z = np.clip(each.x[each.told] / each.sigma[each.told], -MOST_SIGMAS, MOST_SIGMAS)
        squares.append(np.mean(z**2, axis=1))  # a unit's numbers are averaged, since they are correlated
    usual = max(float(np.median([np.mean(each) for each in squares])), stats.chi2.mean(1) * _BOUNDED)
    found = []
    for each in squares:
        scatter = max(float(np.std(each, ddof=1)), 1e-12)
        t = (float(np.mean(each)) - usual) / (scatter / np.sqrt(len(each)))
        found.append(float(stats.t.logsf(t, len(each) - 1)))
    return found


#: mean square of a unit normal that is bounded at MOST_SIGMAS
_BOUNDED = float(stats.norm.expect(lambda z: min(z * z, MOST_SIGMAS**2)))


def along(effect: Estimates) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return each unit's share (N,) of the lot's mean, its sigma (N,), and the mean (P,)."""
    told = effect.told
    x, sigma = effect.x[told], effect.sigma[told]
    mean = mean_of(x, sigma)
    centred = (x - mean) / sigma
    correlation = correlation_of(np.clip(centred, -MOST_SIGMAS, MOST_SIGMAS))
    share, of_share = np.full(len(effect.x), np.nan), np.full(len(effect.x), np.nan)
    inverse = np.linalg.inv(correlation)
    toward = mean / sigma
    weight = np.einsum("np,pq,nq->n", toward, inverse, toward)
    share[told] = np.einsum("np,pq,nq->n", toward, inverse, x / sigma) / weight
    of_share[told] = 1 / np.sqrt(weight)
    return share, of_share, mean


def correlation_of(z: np.ndarray) -> np.ndarray:
    """Return (P, P), the correlation of the estimates' errors over the units, shrunk towards zero for few units."""
    raw = np.atleast_2d(np.corrcoef(z.T)) if z.shape[1] > 1 else np.eye(1)
    keep = len(z) / (len(z) + 4.0 * z.shape[1])
    return np.asarray(keep * np.nan_to_num(raw) + (1 - keep) * np.eye(z.shape[1]))


def mean_of(x: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return (P,), the mean weighted by sigma and spread; outlying units are clipped (Huber)."""
    mean = np.median(x, axis=0)
    for _ in range(20):
        wide = np.hypot(sigma, np.sqrt(spread_about(x, sigma, mean)))
        z = (x - mean) / wide
        weight = MOST_SIGMAS / np.maximum(np.abs(z), MOST_SIGMAS) / wide**2
        mean = np.sum(weight * x, axis=0) / np.sum(weight, axis=0)
    return np.asarray(mean)


def beside_leaders(effect: Estimates, leaders: list[Estimates]) -> float:
    """Return the p-value of no effect in a unit without the leaders: the intercept of a regression on them."""
    shares = [along(leader)[0] for leader in leaders]
    told = effect.told & np.isfinite(shares).all(axis=0)
    design = np.column_stack([np.ones(told.sum()), *(np.clip(share[told], -9, 9) for share in shares)])
    spare = len(design) - design.shape[1] - len(effect.names)
    if spare < 2:
        return 1.0
    z = np.clip(effect.x[told] / np.median(effect.sigma[told], axis=0), -9, 9)
    fitted, *_ = np.linalg.lstsq(design, z, rcond=None)
    residual = z - design @ fitted
    size = np.linalg.inv(design.T @ design)[0, 0]
    covariance = residual.T @ residual / (len(design) - design.shape[1])
    values, axes = np.linalg.eigh(covariance)
    seen = values > 1e-6 * max(float(values[-1]), 1e-300)
    rank = int(seen.sum())
    square = float(np.sum((axes[:, seen].T @ fitted[0]) ** 2 / values[seen])) / size
    freedom = len(design) - design.shape[1]
    return float(stats.f.sf(square * (freedom - rank + 1) / (freedom * rank), rank, freedom - rank + 1))


def _pooled(effect: Estimates, p_value: float) -> PooledEffect:
    """Estimate the share of units, and mean and spread among them, by a maximum-likelihood mixture: zero, or a part of the mean."""
    told = effect.told
    share, of_share, mean = along(effect)
    y, s = share[told], of_share[told]
    x, sigma = effect.x[told], effect.sigma[told]
    # an effect of either sign has no mean to take a part of
    of_units, about, wide = mixture(y, s) if stated_p(effect) <= FAMILY_WISE else (1.0, 1.0, 0.0)
    among = np.sqrt(spread_about(x, sigma, mean))
    found = mean * about
    if of_units < 1:  # units without the effect do not add to the spread of those with it
        among = np.minimum(among, np.hypot(np.abs(found) * wide, among * of_units))
    of = lambda values: dict(zip(effect.names, map(float, values), strict=True))  # noqa: E731
    return PooledEffect(float(of_units), of(found), of(among), p_value, int(told.sum()))


def mixture(y: np.ndarray, s: np.ndarray) -> tuple[float, float, float]:
    """Return the share of units with a part y of the mean that is normal about ``about`` with ``wide`` times it; the others have zero.

    Where the share is not significantly below one (chi-square of 5 %), all units are taken to have it, as the simplest model.
    """
    shares = np.linspace(1 / GRID, 1, GRID)
    best: list[tuple[float, float, float, float]] = []
    with_none = stats.norm.logpdf(y, 0.0, s)
    for part in shares:
        for wide in (0.0, 0.2, 0.5, 1.0):
            about = 1 / part  # normalises the mean over all units to one
            with_it = stats.norm.logpdf(y, about, np.hypot(s, wide * about))
            with np.errstate(divide="ignore"):
                each = np.logaddexp(np.log(part) + with_it, np.log1p(-part) + with_none if part < 1 else -np.inf)
            best.append((float(each.sum()), float(part), float(about), wide))
    likeliest, whole = max(best), max(each for each in best if each[1] == shares[-1])
    _, part, about, wide = whole if whole[0] > likeliest[0] - ALIKE else likeliest
    return part, about, wide
