"""The noise of one session: its components with sizes, their covariance, and the whiteners for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from tinygc.closure.uncertainty import chi_square_above, normal_above
from tinygc.noise.components import (
    MOST_FACTOR,
    SCORING_STEPS,
    STILL_RATE,
    TURN,
    UNDERSAMPLED,
    WANDER,
    Component,
    Undersampling,
    components_of,
    estimate,
    undersampling,
)
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Sparse, Whitener

# The noise of one session: its components with sizes, and their covariance.

#: turns in a block, whose covariance is inverted at once (benchmarks/explain_speed.py)
BLOCK = 60
#: spreads of the bias instability's prior beyond which its size is unusual
UNUSUAL = 3.0


@dataclass(frozen=True, eq=False)
class SessionNoise:
    """Components with s and sigma (K,) in SI; value: -2 log of the restricted likelihood; missed: the predicted undersampling."""

    components: tuple[Component, ...]
    blocks: list[np.ndarray]
    missed: Undersampling
    s: np.ndarray
    sigma: np.ndarray
    value: float = float("nan")

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) covariance in addition to white noise."""
        count = sum(len(block) for block in self.blocks)  # every row is in one block
        total = np.zeros((count, count))
        for s, component in zip(self.s, self.components, strict=True):
            V = component.V
            if isinstance(V, Sparse):
                total[V.rows, V.columns] += s**2 * V.values
            elif s > 0:
                total += s**2 * V
        return total

    def size(self, name: str) -> float:
        """Size s of a component, SI; 0 if it is absent."""
        return next((float(s) for s, c in zip(self.s, self.components, strict=True) if c.name == name), 0.0)

    @property
    def unusual(self) -> bool:
        """Whether the noise exceeds that of a sensor: turns or stills have errors above white noise, undersampling exceeds its prediction,
        or the bias drift far exceeds its prior."""
        found = dict(zip((c.name for c in self.components), zip(self.s, self.components, strict=True), strict=True))
        for name in (TURN, STILL_RATE):
            if name in found and found[name][0] > found[name][1].usual:
                return True
        if self.size(UNDERSAMPLED) > MOST_FACTOR:
            return True
        s, wander = found.get(WANDER, (0.0, None))
        return wander is not None and wander.prior is not None and s > wander.prior.median * np.exp(UNUSUAL * wander.prior.spread)

    def unusual_p(self, whiten: Whitener, r: np.ndarray, J: np.ndarray) -> float:
        """P-value of unusual noise; 1 if it is not unusual.  r (n,), J (n, p): as passed to ``estimated``, which gave these sizes.

        It is the likelihood ratio of each large component against none, whose estimate is zero half the time (Self & Liang 1987).
        """
        if not self.unusual:
            return 1.0
        most = {TURN: 1.0, STILL_RATE: 1.0, UNDERSAMPLED: MOST_FACTOR}
        large = [c.name for s, c in zip(self.s, self.components, strict=True) if c.name in most and s > most[c.name] * c.usual]
        gains = [self.without(name).estimated(whiten, r, J, self.without(name).s).value - self.value for name in large]
        # For a component with a prior, the prior gives the probability.
        p = [chi_square_above(max(gain, 0.0), 1) / 2 for gain in gains] or [2 * normal_above(UNUSUAL)]
        return min(1.0, len(p) * min(p))

    def to_json(self) -> list[dict]:
        """``noise.components`` of explain.json and fit.json."""
        return [
            {
                "name": c.name,
                "size": float(s / c.si),
                "sigma": float(sigma / c.si) if np.isfinite(sigma) else None,
                "unit": c.unit,
                "says": c.says,
            }
            for s, sigma, c in zip(self.s, self.sigma, self.components, strict=True)
        ]

    @property
    def words(self) -> str:
        """The components present, in one line."""
        found = [f"{c.says} {s / c.si:.2g} {c.unit}" for s, c in zip(self.s, self.components, strict=True) if s > 0]
        return "; ".join(found) or "none"

    def without(self, name: str) -> SessionNoise:
        """Remove a component."""
        kept = [i for i, c in enumerate(self.components) if c.name != name]
        return replace(self, components=tuple(self.components[i] for i in kept), s=self.s[kept], sigma=self.sigma[kept])

    def estimated(
        self,
        whiten: Whitener,
        r: np.ndarray,
        J: np.ndarray,
        start: np.ndarray | None = None,
        with_sigma: bool = False,
        steps: int = SCORING_STEPS,
    ) -> SessionNoise:
        """Re-estimate the components with columns J (n, p), stacked, in units of their priors' sigmas, and residuals r (n,), stacked.

        An effect that explains part of a component reduces it.  start: s (K,) at which the search starts; with_sigma: whether to compute
        the sigmas.
        """
        found = estimate(
            r,
            J,
            whiten.white,
            [c.V for c in self.components],
            np.array([c.usual for c in self.components]),
            [c.prior for c in self.components],
            self.blocks,
            start,
            with_sigma,
            steps,
        )
        return replace(self, s=found.s, sigma=found.sigma, value=found.value)


def first_noise(twin: Twin, whiten: Whitener, missed: Undersampling | None = None) -> SessionNoise:
    """Noise before any fit: the bias instability alone.  missed: undersampling, if better known than from this twin."""
    missed = missed or undersampling(twin)
    components = tuple(components_of(twin, whiten.sizes, missed))
    s = np.array([c.usual if c.name == WANDER and c.prior is not None else 0.0 for c in components])
    return SessionNoise(components, _blocks(twin, whiten), missed, s, np.zeros(len(s)))


def _blocks(twin: Twin, whiten: Whitener) -> list[np.ndarray]:
    """Rows of blocks of neighbouring turns with the stills before them; a session of up to ``BLOCK`` turns is one block."""
    count, d = len(twin.segments), twin.batch.angles
    parts = max(1, -(-count // BLOCK))
    edges = np.linspace(0, count, parts + 1).round().astype(int)
    # Each still belongs to the turn that begins at or after it.
    owner = np.searchsorted(twin.first, np.arange(len(twin.stills)))
    found = []
    for start, stop in pairwise(edges):
        last = stop == count
        stills = np.flatnonzero((owner >= start) & ((owner < stop) | last))
        found.append(
            np.concatenate(
                [
                    np.arange(start * d, stop * d),
                    whiten.sizes[0] + (stills[:, None] * 3 + np.arange(3)).ravel(),
                    whiten.sizes[0] + whiten.sizes[1] + stills,
                ]
            )
        )
    return found


def known_whitener(twin: Twin) -> Whitener:
    """Whitener with a twin's noise before any fit."""
    whiten = Whitener(twin)
    return whiten.with_more(first_noise(twin, whiten).covariance)


# A cache of a twin's whiteners for the noise of each hypothesis.

#: whiteners kept: for a search's current hypothesis, for the candidate, and one more
HELD = 3


class Whiteners:
    """Cache of whiteners by noise.  A factor has (n, n) elements, 46 MB for 400 turns, and each hypothesis has its own noise; those not
    used recently are factored again, with identical results."""

    def __init__(self, twin: Twin):
        #: white noise alone
        self.white = Whitener(twin)
        self._held: dict[SessionNoise, Whitener] = {}

    def __len__(self) -> int:
        return len(self._held)

    def of(self, noise: SessionNoise) -> Whitener:
        """Whitener for white noise and this noise."""
        found = self._held.pop(noise, None)
        if found is None:
            while len(self._held) >= HELD:  # drop the least recently used before computing another
                del self._held[next(iter(self._held))]
            found = self.white.with_more(noise.covariance)
        self._held[noise] = found
        return found
