"""The names against shapes without a name: where a curve of no physics describes the recording better than all that was named, no
catalogue's word for it is the right one (DESIGN, prove: better than every rival); where it does as well, it could stand in for them.
"""

from __future__ import annotations

import numpy as np

from tinygc.effects._effect import Effect
from tinygc.explain.naming import STAND_IN, Naming, selection_of
from tinygc.explain.refit import refit
from tinygc.explain.twin import Twin
from tinygc.explain.whitening import Whitener

#: chi-square, less the price of its parameters (Schwarz 1978), by which a rival must be better: by chance once in some thousand sessions
BETTER = 10.0
#: rivals that are refitted exactly
MOST = 3


def best_rival(twin: Twin, whiten: Whitener, naming: Naming, rivals: list[Effect], seed: int) -> tuple[Effect | None, float]:
    """The shape that alone describes best what the names describe together, and by how much chi-square, with the price of its
    parameters, it is the better one; (None, -inf) if none comes near."""
    price = np.log(len(naming.fit.r))
    own = naming.fit.chi_square + price * sum(_parameters(named.effect) for named in naming.named)
    selection = selection_of(twin, whiten, naming.first, rivals, seed)
    gains = selection.gains(naming.first.r)
    score = {number: naming.first.chi_square - gain + price * _parameters(rivals[number]) for number, gain in gains.items()}
    best, lead = None, -np.inf
    for number in sorted(score, key=score.get)[:MOST]:
        # A linear gain is a guess of the exact one: the far ones are not worth a refit.
        if score[number] > own + STAND_IN + 0.1 * gains[number]:
            continue
        exact = refit(twin, whiten, [rivals[number]], twin.start()).chi_square + price * _parameters(rivals[number])
        if own - exact > max(lead, -STAND_IN):
            best, lead = rivals[number], own - exact
    return best, lead


def _parameters(effect: Effect) -> int:
    return effect.parameter.size + len(effect.shape)
