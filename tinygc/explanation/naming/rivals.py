"""The names against shapes without a name: where a curve of no physics describes the recording better than all that was named, no
catalogue's word for it is the right one (docs/explain.md, prove); where it does as well, it could stand in for them.
"""

from __future__ import annotations

import numpy as np

from tinygc.effects import Effect
from tinygc.explanation.naming.forward import STAND_IN, Naming, selection_of
from tinygc.explanation.twin.refit import refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener

#: chi-square, less the price of its parameters (Schwarz 1978), by which a rival must be better: "very strong" evidence (Kass & Raftery
#: 1995)
BETTER = 10.0
#: rivals that are refitted exactly: each costs as much as a name (benchmarks/explain_speed.py)
MOST = 3


def best_rival(twin: Twin, whiten: Whitener, naming: Naming, rivals: list[Effect], seed: int) -> tuple[Effect | None, float]:
    """The shape that alone describes best what the names describe together, and by how much chi-square, with the price of its
    parameters, it is the better one; (None, -inf) if none comes near."""
    selection = selection_of(twin, whiten, naming.first, rivals, seed)
    gains = selection.gains(naming.first.r)
    guess = {number: _ahead(naming, rivals[number], naming.first.chi_square - gain) for number, gain in gains.items()}
    best, lead = None, -np.inf
    for number in sorted(guess, key=guess.__getitem__, reverse=True)[:MOST]:
        # A linear gain is a guess of the exact one: the far ones are not worth a refit.
        if guess[number] < -STAND_IN - 0.1 * gains[number]:
            continue
        ahead = _ahead(naming, rivals[number], refit(twin, whiten, [rivals[number]], twin.start()).chi_square)
        if ahead > max(lead, -STAND_IN):
            best, lead = rivals[number], ahead
    return best, lead


def _ahead(naming: Naming, rival: Effect, chi_square: float) -> float:
    """By how much chi-square, with the price of its parameters, a rival is better than the names."""
    more = _parameters(rival) - sum(_parameters(named.effect) for named in naming.named)
    ahead = naming.fit.chi_square - chi_square - np.log(len(naming.fit.r)) * more
    if rival.basis is not None:
        return ahead
    # A shape of one fixed form is no family that bends to anything: like a name it may stand in, whatever it has of parameters.
    return max(ahead, min(naming.fit.chi_square - chi_square, 0.0))


def _parameters(effect: Effect) -> int:
    return effect.parameter.size + len(effect.shape)
