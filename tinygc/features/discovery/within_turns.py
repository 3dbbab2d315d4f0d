"""Gravity during the turns as a judge between hypotheses that close alike."""

from __future__ import annotations

import numpy as np

from tinygc.closure.uncertainty import signed_ranks_above
from tinygc.explanation.evidence import Hypothesis
from tinygc.noise.turn_gravity import lever_equations
from tinygc.noise.twin import Twin

# Closure sees the ends of a turn alone.  Within it, the accelerometer shows gravity, behind what the hand and a lever arm add: the lever
# arm and the delay of the accelerometer are fitted for each hypothesis, and its turns are compared with those of another in pairs.  A
# hand shakes independently from turn to turn, so Wilcoxon's signed-rank test holds whatever it does within one.

#: chance of as many turns being nearer to gravity: below it gravity decides
DECIDES = 0.01


class WithinTurns:
    """Gravity during the turns of one twin; squares of each hypothesis are computed once."""

    def __init__(self, twin: Twin):
        self.twin = twin
        self._left: dict[int, tuple[np.ndarray, Hypothesis]] = {}

    def prefers(self, one: Hypothesis, other: Hypothesis) -> bool:
        """Whether gravity during the turns tells that ``one`` is nearer than ``other``."""
        gains = self._squares(other) - self._squares(one)
        return len(gains) > 1 and bool(gains.any()) and signed_ranks_above(gains) < DECIDES

    def _squares(self, hypothesis: Hypothesis) -> np.ndarray:
        key = id(hypothesis)
        if key not in self._left:
            equations = lever_equations(self.twin, hypothesis.fit)
            self._left[key] = equations.left(equations.solve()), hypothesis  # which keeps its id
        return self._left[key][0]
