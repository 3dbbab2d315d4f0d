"""What the best of all forms promises in noise alone, for this very recording."""

from __future__ import annotations

import numpy as np

#: share of the draws that tell the tail
TAIL = 0.2
#: the tail's scale in promise, where nothing else is known: that of the chi-square's, e^(-gain/2)
USUAL_SCALE = 2.0
#: draws that this is worth: a scale from so few exceedances is no better
WORTH = 20


class Chance:
    """drawn: the best studentised promise of all forms, of each draw.

    Beyond the upper fifth of them the tail is exponential: the promise is a logarithm of odds, whose tail is e^(-promise/2) whatever the
    forms (Markov's bound; Gumbel's law for the largest of many), so the scale that the draws show is held near that.
    """

    def __init__(self, drawn: np.ndarray):
        self.drawn = np.sort(drawn)
        count = max(int(TAIL * len(drawn)), 1)
        self._from = float(self.drawn[-count])
        self._share = count / (len(drawn) + 1)
        beyond = self.drawn[-count:] - self._from
        self._scale = float((beyond.sum() + WORTH * USUAL_SCALE) / (count - 1 + WORTH))

    def p(self, promise: float) -> float:
        """Probability that noise alone promises as much, over the whole search."""
        if promise < self._from:
            return float((1 + np.sum(self.drawn >= promise)) / (len(self.drawn) + 1))
        return self._share * float(np.exp(-(promise - self._from) / self._scale))

    def level(self, share: float) -> float:
        """The promise that noise alone exceeds in this share of cases."""
        if share <= self._share:
            return self._from + self._scale * float(np.log(self._share / share))
        return float(np.quantile(self.drawn, 1 - share))
