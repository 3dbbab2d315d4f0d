"""The search for an equation, from an explanation to a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from session.base.progress import Progress, Reporter, no_report
from tinygc.effects import Effect, Movement, catalogue
from tinygc.explanation.claims import readable
from tinygc.explanation.engine import Explanation
from tinygc.explanation.evidence import Hypothesis
from tinygc.explanation.search import exchanged, search, slow_candidates, without_idle
from tinygc.features.discovery.constants import ByAxis
from tinygc.features.discovery.detection_limits import learnable, learnable_from
from tinygc.features.discovery.enumeration import enumerated
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_effect import added, as_effect, correlation, left_by_calibration
from tinygc.features.discovery.quantities import largest_of
from tinygc.features.discovery.search_state import (
    ALL_OF_IT,
    CHANCE,
    EQUAL,
    FEWEST,
    MOST_OF_IT,
    Discovery,
    Law,
    Rival,
    SearchState,
    Unseen,
    alike,
    chi_square_beyond,
    differing,
    leaves_something,
    numbers_of,
    open_threshold,
    parted,
    refused,
    rivals,
    taken,
    whole_added,
)
from tinygc.features.discovery.selection import FORM, Constants, FormEvidence, SearchRound, believable, exact, rms_of, with_a_form
from tinygc.features.discovery.words import constant_of, equation, what
from tinygc.inference.choose import ONE_SIDED, STAND_IN
from tinygc.noise.refit import candidates
from tinygc.noise.twin import Twin, claim_slice

# The result of a search: the accepted laws and their possible alternatives.

#: chi-square that a law must gain to be distinguished from any other whose added rate correlates less than EQUAL with its own: the share
#: that the other would leave, whether or not the grammar contains it
DECISIVE = STAND_IN / (1 - EQUAL**2)
#: correlation of the added rates from which on a form that bends the law by more numbers, and is no more probable, is no alternative:
#: either explains 95 % of the other's rate
NEARLY = 0.975
#: runners-up that are listed
MOST_RUNNERS_UP = 4
#: s: a lag is over after three of them; the low-pass of a gyroscope, and the hand that stops, take up to 0.3 s
SETTLED_S = 0.1


def answer(explanation: Explanation, searched: SearchState, progress: Reporter) -> Discovery:
    """The result of a search."""
    first = searched.rounds[0].screening
    common: dict[str, Any] = {
        "forms": len(searched.forms),
        "distinct": first.distinct,
        "chance_promise": first.chance.level(0.05),
        "best_promise": first.best_after_last,
    }
    share = taken(searched)
    if not searched.laws or share < MOST_OF_IT:
        progress("what could have been found")
        names = _catalogue_effects(searched.catalogue)
        together = f", with {', '.join(name['id'] for name in names)}" if names else ""
        none = f"refitted exactly{together}, no form makes the recording as much more probable as its description costs"
        laws_text = " and ".join(equation(searched.evidence.forms[law.id]) for law in searched.laws)
        little = f"{laws_text} takes away {100 * share:.0f} % of what is left out, and the rest is no noise" if laws_text else ""
        why = little or searched.why or none
        # The share of chi-square that belongs to the screened turns.
        screened = len(first.responses.segments) / len(explanation.twin.segments)
        limits = learnable(first, CHANCE, DECISIVE * screened)
        return Discovery("none", why, (), names, learnable=limits, **common)
    progress("rivals, and from what size it could have been found")
    evidence = FormEvidence(explanation.twin, len(searched.forms))
    effects = [evidence.effect_of(searched.evidence.forms[law.id]) for law in searched.laws]
    named = [effect for effect in searched.best.effects if effect not in searched.laws]
    have = evidence.of((*named, *effects), evidence.nothing)
    for number, law in enumerate(effects):
        have, effects[number] = exact(evidence, have, law)
    # The selected hypothesis refitted on the whole recording: constants common to all axes
    names, laws = _catalogue_effects(have, frozenset(evidence.forms)), list[Law]()
    for law, effect in zip(searched.laws, effects, strict=True):
        laws.append(_law(searched, law, evidence, have, effect, [each.effect.id for each in laws]))
    why = _undecided(laws, share) or ("the search has come to the end of its work" if searched.evidence.exhausted else "")
    return Discovery("ambiguous" if why else "found", why, tuple(laws), names, **common)


def _undecided(laws: Sequence[Law], share: float) -> str:
    """Why the laws are not found and only candidates are reported; empty where they are found."""
    if doubt := next((law.doubt for law in laws if law.doubt), ""):
        return doubt
    faint = min(laws, key=lambda law: law.gain)
    if faint.gain < DECISIVE:
        return (
            f"too little is seen of it to separate it from an equation not tried: chi-square {faint.gain:.0f}, "
            f"and {DECISIVE:.0f} would separate it from all that add less than {100 * EQUAL:.0f} % the same rate"
        )
    if share < ALL_OF_IT:
        rest = "the rest is no noise: a near relative of it is left out, or something else is there too"
        return f"{100 * share:.1f} % of the excess goes with it, and {rest}"
    return ""


def _doubt(
    form: LawForm, others: int, axes: ByAxis | None, threshold: tuple[float, float] | None, against_gravity: bool, lacking: float
) -> str:
    """Why a law is only a candidate by itself; empty where nothing speaks against it.  others: how many rivals add a different rate; axes:
    its constants by axis, where these differ; threshold: the range of one that the recording leaves open, where it matters;
    against_gravity: whether gravity during the turns is nearer without it; lacking: as ``share_lacking``."""
    if others:
        return f"{others + 1} forms of equal worth add different rates"
    if axes is not None:
        word, own = constant_of(form, axes.constant)
        values = ", ".join(f"{value:.3g}" for value in axes.values * own)
        return f"its {word} seems to differ by axis ({values}; chi-square {axes.more:.0f}), and one for all makes another rate of it"
    if threshold is not None:
        word, own = constant_of(form, 0)
        low, high = (f"{value * own:.3g}" for value in threshold)
        return f"its {word} may be from {low} to {high}: no turn peaks between them, and another movement may"
    if against_gravity:
        return "the turns close with it, and within them gravity is nearer without it: another rate does the same to their ends"
    if any(factor.lag_s is not None and factor.lag_s < SETTLED_S for factor in form.factors):
        return f"a lag below {SETTLED_S:g} s is over before a still is: a filter that settles looks alike"
    if lacking > MOST_LACKING:
        return (
            f"its numbers are not known well enough: in {100 * lacking:.0f} of 100 of what they may be, its rate differs by more "
            f"than {100 * LACKING:.0f} % of its variance from the stated one"
        )
    return ""


def _near(searched: SearchState, law: Effect) -> list[Rival]:
    """Rivals that fit about as well, the nearest first, less those that gravity during the turns refutes."""
    evidence, best = searched.evidence, searched.best
    key = id(best), law.id  # the evidence keeps every hypothesis
    if key not in searched.near:
        weighed = sorted(rivals(evidence, best, law, searched.tried, alike(searched, law)), key=lambda rival: rival.nearest)
        searched.near[key] = [
            rival
            for rival in weighed
            if rival.nearest < STAND_IN and (rival.hypothesis is None or not evidence.gravity_prefers(best, rival.hypothesis))
        ]
    return searched.near[key]


def _plainest(searched: SearchState, law: Effect) -> SearchState:
    """The search with the plainest of the forms that cannot be separated in a law's place: that of the fewest constants, then numbers.

    One that gravity during the turns prefers comes first.
    """
    evidence = searched.evidence
    for _ in range(MOST_EXCHANGES):
        if evidence.exhausted:
            break
        forms = [rival for rival in _near(searched, law) if rival.effect.id in evidence.forms and rival.hypothesis is not None]
        preferred = [rival for rival in forms if rival.hypothesis and evidence.gravity_prefers(rival.hypothesis, searched.best)]
        plainer = [rival for rival in forms if numbers_of(evidence.forms[rival.effect.id]) < numbers_of(evidence.forms[law.id])]
        if not preferred and not plainer:
            break
        chosen = min(preferred or plainer, key=lambda rival: (*numbers_of(evidence.forms[rival.effect.id]), rival.nearest))
        assert chosen.hypothesis is not None
        entered = searched.entered | {chosen.effect.id: searched.entered[law.id]}
        searched, law = replace(searched, best=chosen.hypothesis, entered=entered), chosen.effect
    return searched


def _near_on_all(form: LawForm, near: Sequence[Rival], evidence: FormEvidence, have: Hypothesis, law: Effect) -> list[Rival]:
    """The law's rivals that stay near, with another rate, on the whole recording: a law is tested on what the search never saw, and then
    all of it separates the law from its rivals."""
    own, found = whole_added(evidence.twin, have), []
    for rival in near:
        if evidence.exhausted:
            found.append(rival)
            continue
        other = rival.effect if rival.form is None else evidence.effect_of(rival.form)
        trial = evidence.of(tuple(other if effect is law else effect for effect in have.effects), have)
        if not believable(trial, have):
            continue
        trial, other = (trial, other) if rival.form is None else exact(evidence, trial, other)
        correlated = correlation(own, whole_added(evidence.twin, trial))
        again = replace(rival, worse=trial.score - have.score, chi_worse=chi_square_beyond(trial, have), correlation=correlated)
        bent = rival.form is not None and numbers_of(rival.form)[1] > numbers_of(form)[1] and again.worse > 0
        alike_enough = NEARLY if bent else EQUAL
        if again.nearest < STAND_IN and again.correlation <= alike_enough and not evidence.gravity_prefers(have, trial):
            found.append(again)
    return sorted(found, key=lambda rival: rival.nearest)


def _catalogue_effects(have: Hypothesis, laws: frozenset[str] = frozenset()) -> tuple[dict, ...]:
    """The catalogue's effects of a hypothesis."""
    claims = [(number, claim) for number, claim in enumerate(have.fit.state.claims) if claim.effect.id not in laws]
    read = [(claim.effect.id, *readable(claim, have.fit.theta_covariance(number))[1:]) for number, claim in claims]
    return tuple({"id": name, "parameters": parameters, "std": std} for name, parameters, std in read)


def _free_id(form: LawForm, taken: Sequence[str]) -> str:
    """``discovered.…`` with the first free number where the name alone is in the catalogue or taken."""
    name, number, others = f"{FORM}{what(form)}", 1, {*catalogue(), *taken}
    while (found := name if number == 1 else f"{name}_{number}") in others:
        number += 1
    return found


def _law(searched: SearchState, law: Effect, evidence: FormEvidence, have: Hypothesis, own: Effect, ids: list[str]) -> Law:
    """A law of the search as an effect of a hypothesis on the whole recording, where it is ``own``; ids: of the laws before it."""
    seen, best, screening, near = searched.evidence, searched.best, searched.round_of(law).screening, _near(searched, law)
    form, fit, at = evidence.forms[own.id], have.fit, next(i for i, effect in enumerate(have.effects) if effect is own)
    theta, part = fit.state.claims[at].theta, claim_slice(fit.state.claims, at)
    held, constants = fit.covariance, Constants.of(evidence.twin, have, own, form) if form.constants else None
    covariance = (held if constants is None else constants.widened(held))[part, part]
    gain = float(theta @ np.linalg.solve(held[part, part], theta))
    unobserved = not_observed(theta, covariance)
    known = None if constants is None else (constants.covariance, constants.along[part])
    projection = observed(unobserved) if len(unobserved) else np.eye(len(theta))
    lacking = share_lacking(form, theta, held[part, part], known, projection, evidence.twin.movements, len(ids))
    theta, covariance = projection @ theta, projection @ covariance @ projection.T
    shown, without = learnable_from(screening, form, theta, CHANCE, best.whiten), searched.without(law)
    others = _near_on_all(form, [rival for rival in near if rival.correlation <= EQUAL], evidence, have, own)
    against = differing(searched, law), open_threshold(searched, law, NEARLY), seen.gravity_prefers(without, best)
    # Forms that this recording cannot distinguish from the law, by their columns or by the rate that they add
    weighed = [rival.form for rival in near if rival.correlation > EQUAL and rival.form is not None]
    same: dict[LawForm, LawForm] = {}  # the first of the forms that differ by constants alone
    for other in [*screening.same_as(seen.forms[law.id]), *weighed]:
        if other.shape != form.shape:
            same.setdefault(other.shape, other)
    return Law(
        form,
        as_effect(form, _free_id(form, ids), rms_of(form, seen.twin.movements), equation(form)),
        theta,
        covariance,
        () if constants is None else constants.sigmas(form),
        gain,
        without.score - best.score,
        searched.chance_p(law),
        searched.held_out_of(law),
        tuple(same.values()),
        tuple(replace(rival, hypothesis=None, effect=_with_equation(rival)) for rival in others[:MOST_RUNNERS_UP]),
        None if shown is None or gain <= 0 else max(shown, float((np.sqrt(DECISIVE) + ONE_SIDED) / np.sqrt(gain))),
        unobserved,
        _doubt(form, len(others), *against, lacking),
    )


def _with_equation(rival: Rival) -> Effect:
    """A rival's effect, with its equation."""
    return rival.effect if rival.form is None else replace(rival.effect, equation=equation(rival.form))


# A law's gauge, from its own null space.
#
# Closure against gravity does not see every rate: ``ω_i += c |u| f_i``, the same c for all axes, turns the body about the vertical alone.
# The covariance of the coefficients, with the calibration free, shows which of their combinations a recording leaves open.  Such a
# combination is set to zero, the least value, and neither stated nor applied.  In the eigenvectors of the covariance the estimates are
# independent, so what is observed stays the best fit.

#: sigma of a combination, over the law's own rms coefficient, from which on it is not observed: the data then reduce the variance of a
#: prior of the law's size by less than a factor of four (benchmarks/discovery_laws.py)
OPEN = 0.5
#: squared sigmas of an estimate that is kept however large its sigma is
SIGNIFICANT = 10.0


def not_observed(theta: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Orthonormal directions (q, P) of coefficients theta (P,) with covariance (P, P) that are not observed; q is below P."""
    variance, directions = np.linalg.eigh(covariance)
    along = directions.T @ theta
    seen = np.ones(len(theta), dtype=bool)
    for place in np.argsort(-variance)[:-1]:  # the widest first; the narrowest stays
        others = seen.copy()
        others[place] = False
        size = float(np.sum(along[others] ** 2)) / len(theta)
        wide = variance[place] > OPEN**2 * size and along[place] ** 2 < SIGNIFICANT * variance[place]
        if not wide:
            break
        seen = others
    return directions.T[~seen]


def observed(directions: np.ndarray) -> np.ndarray:
    """Projection (P, P) onto what is observed, without these directions (q, P)."""
    return np.eye(directions.shape[1]) - directions.T @ directions


# A law may be the right one and its numbers too wide for use: a threshold between two gains, a sum of nine coefficients.
#
# Numbers are drawn from their joint covariance; the rate of each draw is compared with the stated one over the recording, beyond a
# calibration and in the part that is observed.  Source: the posterior predictive check, with the normal approximation of the fit.

#: draws, for a share of a twentieth that is known to 3 %
DRAWS = 64
#: share of the variance of the stated rate that a draw may lack, and share of draws that may lack more
LACKING, MOST_LACKING = 0.05, 0.05


def share_lacking(
    form: LawForm,
    theta: np.ndarray,
    covariance: np.ndarray,
    constants: tuple[np.ndarray, np.ndarray] | None,
    observed: np.ndarray,
    movements: Sequence[Movement],
    seed: int = 0,
) -> float:
    """Share of draws whose rate misses more than ``LACKING`` of the stated one's variance.

    theta (P,) with covariance (P, P) at fixed constants; constants: the covariance (K, K) of their logarithms, and along (P, K): by how
    much theta falls with each; observed (P, P): the projection onto the observed part of theta.
    """
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) * np.eye(len(theta)))
    drawn = theta + rng.standard_normal((DRAWS, len(theta))) @ root.T
    logs = np.zeros((DRAWS, 0))
    if constants is not None:
        spread, along = constants
        logs = rng.multivariate_normal(np.zeros(len(spread)), spread, DRAWS, method="eigh")
        drawn = drawn - logs @ along.T
    stated = left_by_calibration(added(as_effect(form), observed @ theta, movements), movements)
    size, missing = float(np.sum(stated**2)), []
    columns = [left_by_calibration(added(as_effect(form), one, movements), movements).ravel() for one in observed] if not logs.size else []
    normal = np.array(columns) @ np.array(columns).T if columns else np.zeros((0, 0))
    for one, log in zip(drawn, logs, strict=True):
        if columns:
            missing.append(float((one - theta) @ normal @ (one - theta)))
            continue
        other = form.with_constants(np.array(form.constants) * np.exp(log))
        rate = left_by_calibration(added(as_effect(other), observed @ one, movements), movements)
        missing.append(float(np.sum((rate - stated) ** 2)))
    return float(np.mean(np.array(missing) > LACKING * size))


# The search for an equation, from an explanation to an answer.
#
# 1. A third of the turns and stills is held out (``parted``); the following steps use the rest alone.
# 2. The catalogue is searched first: the hypothesis of its effects with the most evidence.
# 3. All forms of the grammar are screened against it and against no effects at all, as a catalogue effect may have stood in for the law.
# 4. The best forms are refined, compared with the noise re-estimated, and refitted exactly with their constants (``exact``); effects
#    that the law makes redundant are removed.
# 5. A second law may be added to the first.
# 6. Each law is tested on the held-out data (``refused``); what is accepted is refitted on the whole recording.

#: laws of one answer: each takes a pass over all forms
MOST_LAWS = 2
#: catalogue effects that a law may uncover
MOST_NAMES = 2
#: forms that may replace a law in turn
MOST_EXCHANGES = 3
#: unnamed shapes that are tried in the place of a law
MOST_SHAPES = 2
#: steps of the whole, for progress
STEPS = 7


def discover(
    explanation: Explanation,
    *,
    seed: int = 0,
    progress: Progress = no_report,
) -> Discovery:
    """Search a session's residuals for the missing equation; the explanation lists the catalogue's effects.

    seed: of the held-out split and of all random draws.
    """
    whole = explanation.twin
    if len(whole.segments) < 3 * FEWEST:
        few = f"a third of {len(whole.segments)} turns is too few for an equation: record {3 * FEWEST} or more"
        return Discovery("none", few, (), (), forms=0, distinct=0, chance_promise=0.0, best_promise=0.0)
    split = parted(whole.problem, seed)
    twin = Twin(split.seen)
    progress("discover: the catalogue on what is seen", 0, STEPS)
    forms = enumerated(largest_of(twin.movements))
    evidence, tried = FormEvidence(twin, len(forms)), candidates(twin)
    # The catalogue effects, except those whose shape (such as the moment of a step) was fitted with held-out turns.
    named = [one.effect for one in explanation.naming.named if one.effect.scan is None]
    begin = evidence.of(tuple(named), evidence.nothing)
    start = min(begin, evidence.nothing, key=lambda h: h.score)
    catalogue = exchanged(evidence, tried, search(evidence, tried, start))
    shapes = search(evidence, slow_candidates(twin), catalogue, most=MOST_SHAPES)
    bases = [evidence.nothing, catalogue] if catalogue.effects else [catalogue]
    rounds: list[SearchRound] = []
    searched = SearchState(evidence, Unseen(whole, twin), split, tried, catalogue, shapes, catalogue, rounds, {}, forms)
    while len(rounds) < MOST_LAWS:
        step = 1 + 2 * len(rounds)
        found = with_a_form(evidence, forms, bases, seed, partial(lambda step, what: progress(f"discover: {what}", step, STEPS), step))
        rounds.append(found)
        if found.best is None or found.best.score >= searched.best.score:
            break
        progress("discover: refitting the constants", step, STEPS)
        further = _exactly(searched, _settled(evidence, tried, found, searched.laws))
        for law in further.laws:
            if law not in searched.laws and further.entered[law.id] == len(rounds) - 1:
                further = _plainest(further, law)
        why = next((why for law in further.laws if (why := refused(further, law))), None)
        if why is not None:
            searched = replace(searched, why=searched.why or why)
            break
        searched = further
        if evidence.exhausted or not leaves_something(searched):
            break
        bases = [searched.best]
    return answer(explanation, searched, lambda what: progress(f"discover: {what}", STEPS - 1, STEPS))


def _exactly(searched: SearchState, have: Hypothesis) -> SearchState:
    """Refit the constants of all laws of a hypothesis exactly; its new laws come from the last round."""
    evidence, last, entered = searched.evidence, len(searched.rounds) - 1, dict[str, int]()
    for law in [effect for effect in have.effects if effect.id in evidence.forms]:
        have, own = exact(evidence, have, law)
        entered[own.id] = searched.entered.get(law.id, last)
    return replace(searched, best=have, entered=entered)


def _settled(evidence: FormEvidence, tried: list[Effect], found: SearchRound, before: list[Effect]) -> Hypothesis:
    """Settle the catalogue effects around the laws: drop those made redundant, add those uncovered.  Where the linear approximation
    ranked a form wrongly, the best form replaces the law; before: laws of earlier rounds, which stay."""
    assert found.best is not None
    have = without_idle(evidence, found.best)
    have = without_idle(evidence, exchanged(evidence, tried, search(evidence, tried, have, most=MOST_NAMES)))
    for _ in range(MOST_EXCHANGES):
        if evidence.exhausted:
            break
        law = next((effect for effect in have.effects if effect.id in evidence.forms and effect not in before), None)
        if law is None:
            break
        nearest = next((rival for rival in rivals(evidence, have, law, found.tried) if rival.hypothesis is not None), None)
        if nearest is None or nearest.hypothesis is None or nearest.worse >= 0:
            break
        have = without_idle(evidence, nearest.hypothesis)
    return have
