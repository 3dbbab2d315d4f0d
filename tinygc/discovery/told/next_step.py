"""The movement that tells a law from what else it could be: where the two make the channels differ most.

Each is fitted to this recording, with a calibration of its own.  Whatever the two then make of another movement are their predictions
there; the movement for which these lie most sigmas apart splits them.
"""

from __future__ import annotations

from math import ceil

import numpy as np

from tinygc.discovery.grammar.words import equation, splits
from tinygc.discovery.judge.answer import Discovery, Law
from tinygc.discovery.judge.verdict import DECISIVE
from tinygc.discovery.told.as_json import briefly, other_equation
from tinygc.discovery.told.fits import Fitted, Pair
from tinygc.effects import Movement
from tinygc.explanation.naming.naming import STAND_IN
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.next_step import what_next
from tinygc.plan.splitting import Trial, trials

#: sigmas at which two laws are told apart, all turns together
TOLD_APART = 5.0
#: turns that anybody would do for it: where more are needed, the condition that the grammar names is worth more
MOST_TURNS = 25


def is_open(law: Law) -> bool:
    """Whether something else could still stand in the law's place."""
    return bool(law.runners_up) and law.runners_up[0].worse < STAND_IN


def next_of(e: Explanation, discovery: Discovery, pairs: list[Pair]) -> str | None:
    """What to record next; None where nothing is left to tell.  pairs: of the laws, where one is open."""
    for law in discovery.laws:
        if is_open(law):
            between = f"to tell {briefly(equation(law.form))} from {briefly(other_equation(law.runners_up[0]))}: "
            return between + _splitting(next(pair for pair in pairs if pair.law is law))
    if discovery.verdict == "found":
        return "record a second session with other movement, and explain it with the effect file: a law that is named there holds"
    faint = min(discovery.laws, key=lambda law: law.gain, default=None)
    if faint is not None and faint.gain < DECISIVE:
        more = ceil(DECISIVE / faint.gain + 0.5)
        return f"record {more} times as many turns, or turns in which it is larger: {splits(faint.form)}"
    if faint is not None:
        return "record a second session with other movement, and explain it with the effect file: what is left there says more"
    return what_next(e)


def _splitting(pair: Pair) -> str:
    words = pair.law.runners_up[0].splits
    best = None if pair.other is None else best_trial(pair.own, pair.other)
    if best is None:
        return words
    trial, sigmas = best
    turns = ceil((TOLD_APART / sigmas) ** 2) if sigmas > 0 else MOST_TURNS + 1
    if turns > MOST_TURNS:
        return words
    often = "once is enough" if turns == 1 else f"{turns} times are enough"
    return f"{trial.words}: they differ there by {sigmas:.1f} sigmas, {often}; or {words}"


def best_trial(own: Fitted, other: Fitted) -> tuple[Trial, float] | None:
    """The movement for which the two differ most, and by how many sigmas: of its closure and of its stills, whatever the zero is then.

    None where the gyroscope's range is too small for any.
    """
    whiten, tried = own.whiten, trials(own.replay.twin.movements[0])
    of_closure, of_still = (float(np.median(whiten.sigma[whiten.parts[name]])) for name in ("closure", "still"))
    found = []
    for trial in tried:
        less = _corrected(other, trial.movement) - _corrected(own, trial.movement)
        closes = np.einsum("tdi,ti->d", trial.sensitivity, less) / of_closure
        rests = [less[rows].mean(axis=0) / of_still for rows in trial.stills]
        bias = np.concatenate([trial.sensitivity.sum(axis=0) / of_closure, *[np.eye(3) / of_still] * len(rests)])
        seen = np.concatenate([closes, *rests])
        found.append(float(np.linalg.norm(seen - bias @ np.linalg.lstsq(bias, seen, rcond=None)[0])))
    best = int(np.argmax(found)) if found else None
    return None if best is None else (tried[best], found[best])


def _corrected(by: Fitted, movement: Movement) -> np.ndarray:
    """(N, 3) rad/s, to first order: the rate by the fit's calibration, its effect taken off."""
    return by.fit.state.model(movement.rate) - by.effect.columns(by.effect.shown(movement)) @ by.theta
