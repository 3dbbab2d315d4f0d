"""Refit the recording with a law or its rival, and find the movement that distinguishes them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np

from session.base.units import DEG
from tinygc.effects import Effect, Movement, catalogue
from tinygc.explanation.engine import Explanation
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.result import what_next
from tinygc.features.discovery.engine import DECISIVE
from tinygc.features.discovery.form import Factor, LawForm
from tinygc.features.discovery.result import briefly
from tinygc.features.discovery.search_state import Discovery, Law
from tinygc.features.discovery.words import equation, splits
from tinygc.inference.choose import STAND_IN
from tinygc.noise.refit import Refit, Replay
from tinygc.noise.twin import Channels
from tinygc.noise.whitening import Whitener
from tinygc.planning.turns import CandidateTurn, trials

# The coefficients of a law that are drawn together: terms that add to one axis from one component of the plotted quantity.

#: displayed units of quantities: how many of them one is, times full scale for a share of it; name; unit
SHOWN: dict[str, tuple[float, bool, str, str]] = {
    "rate": (1 / DEG, True, "rate about {i}", "dps"),
    "rate_size": (1 / DEG, True, "size of the rate", "dps"),
    "acceleration": (1 / DEG, True, "angular acceleration about {i}", "dps/s"),
    "acceleration_size": (1 / DEG, True, "size of the angular acceleration", "dps/s"),
    "speed_slope": (1 / DEG, True, "rate of change of the size of the rate", "dps/s"),
    "jerk": (1 / DEG, True, "angular jerk about {i}", "dps/s²"),
    "force": (1.0, False, "specific force along {i}", "g"),
    "temperature": (1.0, False, "temperature since the first sample", "°C"),
    "temperature_rate": (60.0, False, "rate of the temperature", "°C/min"),
    "turned": (1 / DEG, False, "angle turned about {i}", "°"),
    "sense": (1.0, False, "sense of the last turn about {i}", "±1"),
}


@dataclass(frozen=True, eq=False)
class LawSeries:
    """axis that the terms add to; component of the main factor's quantity; entries: the terms' places in theta."""

    axis: int
    component: int
    entries: tuple[int, ...]


def main_of(form: LawForm) -> Factor:
    """The factor of the horizontal axis: the nonlinear one; of two alike the first."""
    return next((factor for factor in form.factors if factor.through.name != "itself"), form.factors[0])


def other_of(form: LawForm) -> Factor | None:
    """The second factor, which may be the same function of the same quantity."""
    return form.factors[_beside(form)] if len(form.factors) == 2 else None


def component_beside(form: LawForm, series: LawSeries) -> int:
    """Component of the second factor in a series' first term."""
    return form.terms()[series.entries[0]][1][_beside(form)][1]


def _beside(form: LawForm) -> int:
    return 1 - form.factors.index(main_of(form))


def series_of(form: LawForm) -> list[LawSeries]:
    """One series for every axis and component of the main factor that it follows, in the order of the form's terms."""
    main, found = main_of(form), dict[tuple[int, int], list[int]]()
    for entry, (axis, parts) in enumerate(form.terms()):
        component = next(part // main.through.phases for factor, part in parts if factor is main)
        found.setdefault((axis, component), []).append(entry)
    return [LawSeries(axis, component, tuple(entries)) for (axis, component), entries in found.items()]


def has_curve(form: LawForm) -> bool:
    """Whether the main factor can be plotted along its own quantity: it has no memory and no direction fixed in the world."""
    main = main_of(form)
    remembers = any(factor.lag_s is not None or factor.through.memory for factor in form.factors)
    return not remembers and main.of.directions == 1


def values_of(factor: Factor, movement: Movement, component: int) -> np.ndarray:
    """Values (N,) of a factor's quantity in SI, or in its own unit, without the function."""
    values = factor.of.of(movement)
    return values[:, min(component, values.shape[1] - 1)]


def curve(factor: Factor, at: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """(K,) SI of a series' law along its main quantity, theta (phases,) of its terms; times the second factor where there is one."""
    found = factor.through.of(at, factor.constant or 1.0).reshape(len(at), -1)
    return found @ theta[: found.shape[1]]


def shown_as(factor: Factor, movement: Movement) -> tuple[float, str, str]:
    """How many of the displayed unit one of the quantity is, its name with ``{i}`` for the axis, and the unit."""
    times, of_scale, words, unit = SHOWN.get(factor.quantity, (1.0, False, factor.of.words, factor.of.unit))
    return times * (movement.fs_rps if of_scale else 1.0), words, unit


def component_name(factor: Factor, component: int) -> str:
    """``x``; empty for a scalar."""
    return "xyz"[component // factor.of.directions] if factor.vector else ""


# The recording refitted with a law or with its rival, for the pictures and the next movement.


@dataclass(frozen=True, eq=False)
class Fitted:
    """effect, and its form, None for a catalogue effect; fit of the whole hypothesis with it, whiten with the noise re-estimated; theta
    (P,) of the effect; left: residuals of each channel; adds: what one SI unit of each parameter adds to each channel."""

    form: LawForm | None
    effect: Effect
    fit: Refit
    whiten: Whitener
    replay: Replay
    theta: np.ndarray
    left: Channels
    adds: Channels


@dataclass(frozen=True, eq=False)
class Pair:
    """A law with its form, and its first runner-up in its place, None where none adds to the rates."""

    law: Law
    own: Fitted
    other: Fitted | None


def pairs_of(e: Explanation, discovery: Discovery) -> list[Pair]:
    """Refit each law and its runner-up exactly, with the noise re-estimated for each."""
    known = {claim.effect.id: claim.effect for claim in e.naming.fit.state.claims}
    names = [known.get(each["id"], catalogue()[each["id"]]) for each in discovery.beside if each["id"] in catalogue()]
    names = [effect for effect in names if effect.kind not in ("register", "motion")]
    evidence, found = Evidence(e.twin), []
    for law in discovery.laws:
        beside = [*names, *(each.effect for each in discovery.laws if each is not law)]
        rival = next((each for each in law.runners_up[:1] if each.effect.kind == "rate"), None)
        other = None if rival is None else _fitted(evidence, beside, rival.form, rival.effect)
        found.append(Pair(law, _fitted(evidence, beside, law.form, law.effect), other))
    return found


def _fitted(evidence: Evidence, beside: list[Effect], form: LawForm | None, effect: Effect) -> Fitted:
    hypothesis = evidence.of((*(each for each in beside if each.id != effect.id), effect), evidence.nothing)
    fit, twin = hypothesis.fit, evidence.twin
    replay = Replay(twin, fit)
    found = replay.columns(effect)
    adds = Channels(-found.closure, -found.still, found.length)  # negative, as effects are removed
    left = twin.residuals(fit.state, replay.rates)
    # The same effects in another order are the same hypothesis.
    theta = next(claim.theta for claim in fit.state.claims if claim.effect.id == effect.id)
    return Fitted(form, effect, fit, hypothesis.whiten, replay, theta, left, adds)


# The runner-up as a curve along the law's own quantity.


def other_curve(e: Explanation, own: Fitted, other: Fitted, series: LawSeries) -> Callable[[np.ndarray], np.ndarray] | None:
    """(K,) of the quantity -> (K,) rad/s of the runner-up, with its change of the calibration; None where it follows another quantity."""
    if own.form is None or other.form is None or len(other.form.factors) != 1 or not has_curve(other.form):
        return None
    main, theirs = main_of(own.form), main_of(other.form)
    matching = next((each for each in series_of(other.form) if (each.axis, each.component) == (series.axis, series.component)), None)
    if theirs.quantity != main.quantity or matching is None:
        return None
    before, after = own.fit.state.model, other.fit.state.model
    zero = before.B[series.axis] - after.B[series.axis]
    per_rate = (before.E - after.E)[series.axis, series.component] if main.quantity == "rate" else 0.0
    theta, full_scale = other.theta[list(matching.entries)], e.twin.movements[0].fs_rps

    def said(at: np.ndarray) -> np.ndarray:
        return curve(theirs, at, theta) + zero + per_rate * full_scale * at

    return said


# The movement that distinguishes a law from its alternative: where the two change the channels by the most different amounts.
#
# Each is fitted to this recording with its own calibration and predicts the channels of another movement.  The best movement
# separates the two predictions by the most sigmas.

#: sigmas at which two laws are distinguished, over all turns
TOLD_APART = 5.0
#: most turns worth recommending: where more are needed, the condition that the grammar names is the better advice
MOST_TURNS = 25


def is_open(law: Law) -> bool:
    """Whether the law still has a plausible alternative."""
    return bool(law.runners_up) and law.runners_up[0].nearest < STAND_IN


def next_of(e: Explanation, discovery: Discovery, pairs: list[Pair]) -> str | None:
    """What to record next; None where nothing is undecided.  pairs: of the laws, where one is open."""
    for law in discovery.laws:
        if is_open(law):
            between = f"to tell {briefly(equation(law.form))} from {briefly(law.runners_up[0].effect.equation)}: "
            return between + _splitting(next(pair for pair in pairs if pair.law is law))
    if discovery.verdict == "found":
        holds = "a law holds whose numbers agree there with the file's"
        return f"record a second session with other movement, and explain it with the effect file: {holds}"
    faint = min(discovery.laws, key=lambda law: law.gain, default=None)
    if faint is not None and faint.gain < DECISIVE:
        more = ceil(DECISIVE / faint.gain + 0.5)
        return f"record {more} times as many turns, or turns in which it is larger: {splits(faint.form)}"
    if faint is not None:
        return "record a second session with other movement, and explain it with the effect file: what is left there says more"
    return what_next(e)


def _splitting(pair: Pair) -> str:
    words = pair.law.runners_up[0].effect.discriminating_motion
    best = None if pair.other is None else best_trial(pair.own, pair.other)
    if best is None:
        return words
    trial, sigmas = best
    turns = ceil((TOLD_APART / sigmas) ** 2) if sigmas > 0 else MOST_TURNS + 1
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
