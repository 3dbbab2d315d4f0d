"""Refit the recording with a law or its rival, and find the movement that distinguishes them."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from tinygc.effects import Effect, Movement, catalogue
from tinygc.explanation.engine import Explanation
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.result import what_next
from tinygc.features.discovery.engine import DECISIVE
from tinygc.features.discovery.result import briefly
from tinygc.features.discovery.search_state import Discovery, Law
from tinygc.features.discovery.words import equation, splits
from tinygc.inference.choose import STAND_IN
from tinygc.noise.refit import Refit, Replay
from tinygc.noise.twin import Channels
from tinygc.noise.whitening import Whitener
from tinygc.planning.turns import CandidateTurn, trials

# The recording refitted with a law or with its rival, for the pictures and the next movement.


@dataclass(frozen=True, eq=False)
class Fitted:
    """effect; fit of the whole hypothesis with it, whiten with the noise re-estimated; theta
    (P,) of the effect; left: residuals of each channel; adds: what one SI unit of each parameter adds to each channel."""

    effect: Effect
    fit: Refit
    whiten: Whitener
    replay: Replay
    theta: np.ndarray
    left: Channels
    adds: Channels


@dataclass(frozen=True, eq=False)
class Pair:
    """A law, and its first runner-up in its place, None where none adds to the rates."""

    law: Law
    own: Fitted
    other: Fitted | None


def pairs_of(e: Explanation, discovery: Discovery) -> list[Pair]:
    """Refit each law and its runner-up exactly, with the noise re-estimated for each."""
    known = {claim.effect.id: claim.effect for claim in e.naming.fit.state.claims}
    names = [known.get(each["id"], catalogue()[each["id"]]) for each in discovery.accompanying if each["id"] in catalogue()]
    names = [effect for effect in names if effect.kind not in ("register", "motion")]
    evidence, found = Evidence(e.twin), []
    for law in discovery.laws:
        others = [*names, *(each.effect for each in discovery.laws if each is not law)]
        rival = next((each for each in law.runners_up[:1] if each.effect.kind == "rate"), None)
        other = None if rival is None else _fitted(evidence, others, rival.effect)
        found.append(Pair(law, _fitted(evidence, others, law.effect), other))
    return found


def _fitted(evidence: Evidence, others: list[Effect], effect: Effect) -> Fitted:
    hypothesis = evidence.of((*(each for each in others if each.id != effect.id), effect), evidence.nothing)
    fit, twin = hypothesis.fit, evidence.twin
    replay = Replay(twin, fit)
    found = replay.columns(effect)
    adds = Channels(-found.closure, -found.still, found.length)  # negative, as effects are removed
    left = twin.residuals(fit.state, replay.rates)
    # The same effects in another order are the same hypothesis.
    theta = next(claim.theta for claim in fit.state.claims if claim.effect.id == effect.id)
    return Fitted(effect, fit, hypothesis.whiten, replay, theta, left, adds)


# The movement that distinguishes a law from its alternative: where the two change the channels by the most different amounts.
#
# Each is fitted to this recording with its own calibration and predicts the channels of another movement.  The best movement
# separates the two predictions by the most sigmas.

#: sigmas at which two laws are distinguished, over all turns
SEPARATED = 5.0
#: most turns worth recommending: where more are needed, the condition that the grammar names is the better advice
MOST_TURNS = 25


def is_open(law: Law) -> bool:
    """Whether the law still has a plausible alternative."""
    return bool(law.runners_up) and law.runners_up[0].nearest < STAND_IN


def next_of(e: Explanation, discovery: Discovery, pairs: list[Pair]) -> str | None:
    """What to record next; None where nothing is undecided.  pairs: of the laws, where one is open."""
    for law in discovery.laws:
        if is_open(law):
            between = f"to separate {briefly(equation(law.form))} from {briefly(law.runners_up[0].effect.equation)}: "
            return between + _splitting(next(pair for pair in pairs if pair.law is law))
    faint = min(discovery.laws, key=lambda law: law.gain, default=None)
    if discovery.verdict != "found" and faint is not None and faint.gain < DECISIVE:
        more = ceil(DECISIVE / faint.gain + 0.5)
        return f"record {more} times as many turns, or turns in which it is larger: {splits(faint.form)}"
    if faint is not None:
        return "record a second session with other movement; explain it with the file"
    return what_next(e)


def _splitting(pair: Pair) -> str:
    words = pair.law.runners_up[0].effect.discriminating_motion
    best = None if pair.other is None else best_trial(pair.own, pair.other)
    if best is None:
        return words
    trial, sigmas = best
    turns = ceil((SEPARATED / sigmas) ** 2) if sigmas > 0 else MOST_TURNS + 1
    if turns > MOST_TURNS:
        return words
    often = "once is enough" if turns == 1 else f"{turns} times are enough"
    return f"{trial.words}: they differ there by {sigmas:.1f} sigmas, {often}; or {words}"


def best_trial(own: Fitted, other: Fitted) -> tuple[CandidateTurn, float] | None:
    """The movement for which the two differ most, and by how many sigmas of its closure and stills, whatever the zero is then.

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
    """Rate corrected by the fit's calibration and effect, to first order, (N, 3) rad/s."""
    return by.fit.state.model(movement.rate) - by.effect.columns(by.effect.shown(movement)) @ by.theta
