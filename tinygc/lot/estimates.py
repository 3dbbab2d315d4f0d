"""What the units of a lot say of each effect, as arrays: a row for each unit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from tinygc.lot.unit_result import UnitResult, Weighed

#: units that are pooled: what is weaker than so many tell is worth nothing in any of them
MOST_UNITS = 2000
#: of a unit's estimates, m times the median sigma of the lot: such a unit has not seen the number
UNSEEN = 30.0


@dataclass(frozen=True, eq=False)
class Estimates:
    """One effect over the lot: names of its numbers (P,), x and sigma (N, P), NaN where a unit does not tell."""

    id: str
    names: tuple[str, ...]
    x: np.ndarray
    sigma: np.ndarray

    @property
    def told(self) -> np.ndarray:
        """(N,) units with all numbers."""
        return np.isfinite(self.x).all(axis=1)


def estimates_of(units: Iterable[UnitResult], seed: int = 0) -> list[Estimates]:
    """Of each effect that any unit tells of, in the order of their ids."""
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
        kept = np.isfinite(x).mean(axis=0) > 0.5  # a number that most units do not tell
        if kept.any():
            parts = tuple(name for name, keep in zip(parts, kept, strict=True) if keep)
            found.append(Estimates(effect, parts, x[:, kept], sigma[:, kept]))
    return found


def _drawn(units: Iterable[UnitResult], seed: int) -> dict[str, list[Mapping[str, Weighed]]]:
    """The sessions' effects by unit, of so many units: each as probable as any other (Vitter 1985, algorithm R), in one pass."""
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
    """(P,) twice: the mean of a unit's sessions by their sigmas, and its sigma."""
    told = [(each.estimates, each.sigmas) for each in sessions if tuple(each.estimates) == parts]
    if not told:
        return np.full(len(parts), np.nan), np.full(len(parts), np.nan)
    x, sigma = (np.array([[each[i][name] for name in parts] for each in told], dtype=float) for i in (0, 1))
    weight = np.where(np.isfinite(x) & (sigma > 0), 1 / sigma**2, 0.0)
    total = weight.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(total > 0, np.nansum(weight * x, axis=0) / total, np.nan), np.where(total > 0, total**-0.5, np.nan)
