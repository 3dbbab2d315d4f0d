"""What stills and turns show of a law: the remainder without it, with it, and with what was weighed in its place.

A still shows a rate of its own.  Of a turn's closure the share counts that a constant rate about one axis would make; where the law does
not hold still within a turn, it is the part along what the law makes of the closure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from session.common.units import DEG
from tinygc.discovery.grammar.form import Factor
from tinygc.discovery.told.fits import Fitted, Pair
from tinygc.discovery.told.series import Series, component_beside, curve, has_curve, main_of, other_of, values_of
from tinygc.effects import Movement
from tinygc.explanation.pictures.turn_values import one_way, projector, telling
from tinygc.explanation.verdict.explain import Explanation

#: quantities that hardly move within a turn
SLOW = ("temperature", "temperature_rate", "time", "vibration", "rest", "sense")
#: of the largest level of the other factor: below it a turn has no place along the main one
LEVEL = 0.15
#: of what the points reach, to either side: how far the place of one is looked up on the curve
ROOM = 0.3
#: points of a curve on which it is looked up
GRID = 801


@dataclass(frozen=True, eq=False)
class Points:
    """Of one series, n stills or turns.

    x (n,): of the quantity, in its own unit, or what the law says where ``along_law``; without, left, other_left (n,): the remainder
    without the law, with it, and with the runner-up in its place, None where there is none; sigma (n,) of noise; level (n,): of the other
    factor, None where there is none.  In dps, or of turns that are drawn along the law in degrees of closure.
    """

    series: Series
    x: np.ndarray
    without: np.ndarray
    left: np.ndarray
    other_left: np.ndarray | None
    sigma: np.ndarray
    level: np.ndarray | None
    along_law: bool
    still: bool

    @property
    def other_says(self) -> np.ndarray | None:
        """(n,) what the runner-up says, with what its calibration changes beside it."""
        return None if self.other_left is None else self.without - self.other_left

    def some(self, keep: np.ndarray) -> Points:
        """Those of a mask (n,)."""
        other_left, level = (None if values is None else values[keep] for values in (self.other_left, self.level))
        x, without, left, sigma = (values[keep] for values in (self.x, self.without, self.left, self.sigma))
        return Points(self.series, x, without, left, other_left, sigma, level, self.along_law, self.still)


def of_stills(e: Explanation, pair: Pair, series: Series) -> Points:
    """Mean rates of the stills, dps."""
    law, other, form = pair.own, pair.other, pair.law.form
    entries, movements = list(series.entries), _movements(e, law)

    def mean(of: Callable[[Movement], np.ndarray]) -> np.ndarray:
        by_log = [of(movement) for movement in movements]
        return np.array([by_log[log][still.start : still.stop].mean() for log, still in e.twin.stills])

    said = law.adds.still[:, series.axis][:, entries] @ law.theta[entries]
    left = law.left.still[:, series.axis]
    other_left = None if other is None else other.left.still[:, series.axis] / DEG
    sigma = law.whiten.sigma[law.whiten.parts["still"]].reshape(-1, 3)[:, series.axis]
    along = not has_curve(form)
    level = None if along else _level(pair, series, mean)
    x = said / DEG if along else mean(lambda movement: values_of(main_of(form), movement, series.component))
    if not along and level is None:
        x = _placed(pair, series, x, said, np.ones(len(x), dtype=bool))
    return Points(series, x, (said + left) / DEG, left / DEG, other_left, sigma / DEG, level, along, still=True)


def of_turns(e: Explanation, pair: Pair, series: Series) -> Points:
    """What turns ask for: dps about the axis, or degrees along what the law makes of their closure."""
    law, other, form = pair.own, pair.other, pair.law.form
    entries, beside = list(series.entries), other_of(form)
    said = law.adds.closure[:, :, entries] @ law.theta[entries]
    angles = [said + law.left.closure, law.left.closure, *([] if other is None else [other.left.closure])]
    if not has_curve(form) or (beside is not None and beside.quantity not in SLOW):
        return _along_law(series, said, angles, e.twin.problem.floor.sigma)
    of_samples = law.replay.sensitivity[:, :, :, series.axis]
    share, sigma = projector(of_samples.sum(axis=1), e.twin.problem.floor.sigma)
    weight = np.einsum("sd,std->st", share, of_samples)
    movements = _movements(e, law)

    def sampled(of: Callable[[Movement], np.ndarray]) -> np.ndarray:
        return e.twin.padded([np.repeat(of(movement)[:, None], 3, axis=1) for movement in movements])[:, :, 0]

    along = sampled(lambda movement: values_of(main_of(form), movement, series.component))
    x = np.sum(weight * along, axis=1)
    level = _level(pair, series, lambda of: np.sum(weight * sampled(of), axis=1))
    keep = telling(sigma) & np.isfinite(x) & one_way(weight, along, x)
    asked = np.einsum("sd,sd->s", share, said)
    if level is not None:
        strong = np.abs(level) > LEVEL * np.max(np.abs(level), initial=0.0)
        keep &= strong
        asked = np.divide(asked, level, out=np.zeros_like(level), where=strong)
    x = _placed(pair, series, x, asked, keep)
    without, left, *more = (np.einsum("sd,sd->s", share, each) / DEG for each in angles)
    return Points(series, x, without, left, more[0] if more else None, sigma / DEG, level, along_law=False, still=False).some(keep)


def _along_law(series: Series, said: np.ndarray, angles: list[np.ndarray], sigma: np.ndarray) -> Points:
    """Each turn along the direction in which the law moves its closure: a line of slope one, if it is the cause."""
    size = np.linalg.norm(said, axis=1)
    largest = said[np.arange(len(said)), np.argmax(np.abs(said), axis=1)]
    ahead = np.divide(said, (size * np.sign(largest))[:, None], out=np.zeros_like(said), where=size[:, None] > 0)
    law, without, left, *more = (np.einsum("sd,sd->s", ahead, each) / DEG for each in (said, *angles))
    noise = np.sqrt(np.sum((ahead * sigma) ** 2, axis=1)) / DEG
    return Points(series, law, without, left, more[0] if more else None, noise, None, along_law=True, still=False).some(size > 0)


def _movements(e: Explanation, law: Fitted) -> list[Movement]:
    return [movement.with_rate(rate) for movement, rate in zip(e.twin.movements, law.replay.rates, strict=True)]


def _level(pair: Pair, series: Series, mean: Callable[[Callable[[Movement], np.ndarray]], np.ndarray]) -> np.ndarray | None:
    """(n,) of the other factor through its function, as it stands in the series' first term; None where there is none."""
    form = pair.law.form
    beside: Factor | None = other_of(form)
    if beside is None:
        return None
    component = component_beside(form, form.terms()[series.entries[0]])
    return mean(lambda movement: beside.values(movement)[:, component])


def _placed(pair: Pair, series: Series, x: np.ndarray, said: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """(n,) where on the curve what the law says stands, on the side of zero on which x is; x itself where the curve does not tell."""
    form = pair.law.form
    found = x.copy()
    low, high = (x[keep].min(), x[keep].max()) if keep.any() else (0.0, 0.0)
    room, main, theta = ROOM * (high - low), main_of(form), pair.own.theta[list(series.entries)]
    # A quantity that has no sign gets none.
    for side, begin, end in ((-1, low - room, min(high, 0.0)), (1, max(low - room, 0.0), high + room)):
        if not end > begin or (side < 0 and low >= 0):
            continue
        at = np.linspace(begin, end, GRID)
        values = curve(main, at, theta)
        if values[0] > values[-1]:
            at, values = at[::-1], values[::-1]
        rises = np.concatenate([[True], np.diff(values) > 0])
        if np.any(np.diff(values) < 0) or rises.sum() < 2:
            continue
        # Where it is level, as within a dead zone, it tells no place.
        here = (np.sign(x) == side) & (said > values[0]) & (said < values[-1])
        found[here] = np.interp(said[here], values[rises], at[rises])
    return found
