"""The recording refitted with a law, or with what was weighed in its place: what pictures and the next movement are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.judge.answer import Discovery, Law
from tinygc.effects import Effect, catalogue
from tinygc.explanation.naming.evidence import Evidence
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.twin.state import Channels
from tinygc.explanation.twin.whitening import Whitener
from tinygc.explanation.verdict.explain import Explanation


@dataclass(frozen=True, eq=False)
class Fitted:
    """effect, and its form, None of a name; fit with it and all that stands beside it, whiten with the noise as it then is; theta (P,) of
    the effect; left: what the fit leaves of each channel; adds: what one SI unit of each parameter adds to each."""

    form: Form | None
    effect: Effect
    fit: Refit
    whiten: Whitener
    replay: Replay
    theta: np.ndarray
    left: Channels
    adds: Channels


@dataclass(frozen=True, eq=False)
class Pair:
    """A law, with its form, and its first runner-up in its place, None where there is none that adds to the rates."""

    law: Law
    own: Fitted
    other: Fitted | None


def pairs_of(e: Explanation, discovery: Discovery) -> list[Pair]:
    """Of each law, refitted exactly with the noise estimated anew beside each."""
    known = {claim.effect.id: claim.effect for claim in e.naming.fit.state.claims}
    names = [known.get(name, catalogue()[name]) for name in discovery.names if name in catalogue()]
    names = [effect for effect in names if effect.kind not in ("register", "motion")]
    evidence, found = Evidence(e.twin), []
    for law in discovery.laws:
        beside = [*names, *(each.effect for each in discovery.laws if each is not law)]
        rival = next((each for each in law.runners_up[:1] if each.effect.kind == "rate"), None)
        other = None if rival is None else _fitted(evidence, beside, rival.form, rival.effect)
        found.append(Pair(law, _fitted(evidence, beside, law.form, law.effect), other))
    return found


def _fitted(evidence: Evidence, beside: list[Effect], form: Form | None, effect: Effect) -> Fitted:
    hypothesis = evidence.of((*(each for each in beside if each.id != effect.id), effect), evidence.nothing)
    fit, twin = hypothesis.fit, evidence.twin
    replay = Replay(twin, fit)
    found = replay.columns(effect)
    adds = Channels(-found.closure, -found.still, found.length)  # effects are taken off
    left = twin.residuals(fit.state, replay.rates)
    # The same effects in another order are the same hypothesis, in the order of the first.
    theta = next(claim.theta for claim in fit.state.claims if claim.effect.id == effect.id)
    return Fitted(form, effect, fit, hypothesis.whiten, replay, theta, left, adds)
