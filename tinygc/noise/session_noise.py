"""The noise of one session: its components with sizes, the covariance that they add, and the whiteners under it."""

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

# The noise of one session as it is: its components with sizes, and the covariance that they add.

#: turns that are taken together: their covariance is inverted at once (benchmarks/explain_speed.py)
BLOCK = 60
#: spreads of what is known of the bias instability, beyond which it is another thing
UNUSUAL = 3.0


@dataclass(frozen=True, eq=False)
class SessionNoise:
    """components, with s and sigma (K,) in SI; value: -2 log of the restricted likelihood; missed: what undersampling predicts."""

    components: tuple[Component, ...]
    blocks: list[np.ndarray]
    missed: Undersampling
    s: np.ndarray
    sigma: np.ndarray
    value: float = float("nan")

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) beside white noise."""
        count = sum(len(block) for block in self.blocks)  # every row is in one of them
        total = np.zeros((count, count))
        for s, component in zip(self.s, self.components, strict=True):
            V = component.V
            if isinstance(V, Sparse):
                total[V.rows, V.columns] += s**2 * V.values
            elif s > 0:
                total += s**2 * V
        return total

    def size(self, name: str) -> float:
        """s of a component, SI; 0 where there is none of this name."""
        return next((float(s) for s, c in zip(self.s, self.components, strict=True) if c.name == name), 0.0)

    @property
    def unusual(self) -> bool:
        """Whether the recording asks for more than a sensor's own noise: each turn or each still errs by more than white noise does, or
        the bias wanders far more than is known of it."""
        found = dict(zip((c.name for c in self.components), zip(self.s, self.components, strict=True), strict=True))
        for name in (TURN, STILL_RATE):
            if name in found and found[name][0] > found[name][1].usual:
                return True
        if self.size(UNDERSAMPLED) > MOST_FACTOR:
            return True
        s, wander = found.get(WANDER, (0.0, None))
        return wander is not None and wander.prior is not None and s > wander.prior.median * np.exp(UNUSUAL * wander.prior.spread)

    def unusual_p(self, whiten: Whitener, r: np.ndarray, J: np.ndarray) -> float:
        """Probability that a sensor's own noise looks as unusual; 1 where it does not.  r (n,), J (n, p): as in ``estimated``, which gave
        these sizes.

        Likelihood ratio of each component that is too large against none, whose estimate is zero half the time (Self & Liang 1987).
        """
        if not self.unusual:
            return 1.0
        most = {TURN: 1.0, STILL_RATE: 1.0, UNDERSAMPLED: MOST_FACTOR}
        large = [c.name for s, c in zip(self.s, self.components, strict=True) if c.name in most and s > most[c.name] * c.usual]
        gains = [self.without(name).estimated(whiten, r, J, self.without(name).s).value - self.value for name in large]
        # Of what is known beforehand, the prior says how rare it is.
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
        """Those that are there, in one line."""
        found = [f"{c.says} {s / c.si:.2g} {c.unit}" for s, c in zip(self.s, self.components, strict=True) if s > 0]
        return "; ".join(found) or "none"

    def without(self, name: str) -> SessionNoise:
        """The same without a component."""
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
        """The components re-estimated beside columns J (n, p), stacked, in their priors' sigmas, that leave residuals r (n,), stacked.

        A name that takes over what a component stood for leaves less of it.  start: s (K,) where the search begins; with_sigma: whether
        how well they are known is asked for.
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
    """What is known before anything is fitted: the bias instability alone.  missed: where it is known better than from this twin."""
    missed = missed or undersampling(twin)
    components = tuple(components_of(twin, whiten.sizes, missed))
    s = np.array([c.usual if c.name == WANDER and c.prior is not None else 0.0 for c in components])
    return SessionNoise(components, _blocks(twin, whiten), missed, s, np.zeros(len(s)))


def _blocks(twin: Twin, whiten: Whitener) -> list[np.ndarray]:
    """Rows of neighbouring turns with the stills at their beginnings; a session of up to ``BLOCK`` turns is one block."""
    count, d = len(twin.segments), twin.batch.angles
    parts = max(1, -(-count // BLOCK))
    edges = np.linspace(0, count, parts + 1).round().astype(int)
    # Each still goes with the turn that begins at or after it.
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
    """With what is known of a twin's noise before anything is fitted."""
    whiten = Whitener(twin)
    return whiten.with_more(first_noise(twin, whiten).covariance)


# The whiteners of one twin under the noise of each hypothesis, a few at a time.

#: whiteners that are held: of the hypothesis that a search goes on from, of the one that is weighed, and of one more
HELD = 3


class Whiteners:
    """By noise.  A factor has (n, n) elements, of 400 turns 46 MB, and each hypothesis has noise of its own; what was not asked for lately
    is factored again, to the same digits."""

    def __init__(self, twin: Twin):
        #: white noise alone
        self.white = Whitener(twin)
        self._held: dict[SessionNoise, Whitener] = {}

    def __len__(self) -> int:
        return len(self._held)

    def of(self, noise: SessionNoise) -> Whitener:
        """White noise with this on top."""
        found = self._held.pop(noise, None)
        if found is None:
            while len(self._held) >= HELD:  # before another is made: the one that was asked for longest ago
                del self._held[next(iter(self._held))]
            found = self.white.with_more(noise.covariance)
        self._held[noise] = found
        return found
