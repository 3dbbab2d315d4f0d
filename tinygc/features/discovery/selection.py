"""Refit the best forms exactly, and select among them by evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from session.base.numeric import sigmas_in
from session.base.progress import Reporter
from tinygc.effects import Effect, Movement
from tinygc.explanation.evidence import Evidence, Hypothesis
from tinygc.explanation.search import rewhitened
from tinygc.features.discovery.constants import refined
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_effect import as_effect, distorted
from tinygc.features.discovery.projections import Projection
from tinygc.features.discovery.responses import Responses
from tinygc.features.discovery.screening import Screening, screened
from tinygc.inference.choose import price
from tinygc.inference.prove import signed_ranks_above
from tinygc.models.linear import MATRIX
from tinygc.noise.refit import FARTHEST, LOOSE, Refit, Replay
from tinygc.noise.turn_gravity import lever_equations
from tinygc.noise.twin import LINEAR, Twin

# The evidence of forms: as that of the catalogue's effects, each the form of one effect, that of what is not in the catalogue.

#: evaluations of laws over all samples of a recording, after which a search ends with what it has: a law as strong as what it follows takes
#: many passes to invert, so that refits of it take most of the time (benchmarks/discovery_laws.py: a minute on one core for 40 turns at
#: 104 Hz).  A count, as the answer must not depend on the computer
MOST_WORK = 6000.0
#: chance of as many turns being nearer to gravity: below it gravity decides
DECIDES = 0.01
#: prefix of a form's id, which no effect of the catalogue has
FORM = "discovered."


class FormEvidence(Evidence):
    """Evidence that includes forms, of so many, each with an id of its own during the search; spent: evaluations of laws over the
    recording, of ``MOST_WORK``, which bound the search."""

    def __init__(self, twin: Twin, count: int):
        self.count = count
        self.forms: dict[str, LawForm] = {}
        self._ids: dict[LawForm, Effect] = {}
        self.spent = 0.0
        self._left: dict[int, tuple[np.ndarray, Hypothesis]] = {}
        self._rows = sum(len(movement.t_s) for movement in twin.movements)
        super().__init__(twin)

    def effect_of(self, form: LawForm) -> Effect:
        """The form as an effect, always the same object."""
        if form not in self._ids:
            name = f"{FORM}n{len(self._ids)}"
            self.forms[name] = form
            effect = as_effect(form, name, rms_of(form, self.twin.movements), name)
            self._ids[form] = replace(effect, exact_distort=lambda movement, theta: self._distorted(form, movement, theta))
        return self._ids[form]

    def _distorted(self, form: LawForm, movement: Movement, theta: np.ndarray) -> np.ndarray:
        self.spent += len(movement.rate) / self._rows
        return distorted(form, movement, theta)

    @property
    def exhausted(self) -> bool:
        """Whether the search has done all the work that it may."""
        return self.spent > MOST_WORK

    def price(self, effect: Effect) -> float:
        """As ``Evidence.price``; a form is one of as many shapes as were screened."""
        return price(effect.parameter.size, self.count) if effect.id in self.forms else super().price(effect)

    # Closure sees the ends of a turn alone.  Within it, the accelerometer shows gravity, behind what the hand and a lever arm add: the
    # lever arm and the delay of the accelerometer are fitted for each hypothesis, and its turns are compared with those of another in
    # pairs.  A hand shakes independently from turn to turn, so Wilcoxon's signed-rank test holds whatever it does within one.

    def gravity_prefers(self, one: Hypothesis, other: Hypothesis) -> bool:
        """Whether gravity during the turns shows that ``one`` is nearer than ``other``, of hypotheses that close alike."""
        gains = self._squares_within(other) - self._squares_within(one)
        return len(gains) > 1 and bool(gains.any()) and signed_ranks_above(gains) < DECIDES

    def _squares_within(self, hypothesis: Hypothesis) -> np.ndarray:
        """Squares of what gravity leaves in each turn, computed once."""
        key = id(hypothesis)
        if key not in self._left:
            equations = lever_equations(self.twin, hypothesis.fit)
            self._left[key] = equations.left(equations.solve()), hypothesis  # which keeps its id
        return self._left[key][0]


def rms_of(form: LawForm, movements: list[Movement]) -> float:
    """Rms of the form's products over a recording."""
    squares = [np.mean(columns[columns != 0] ** 2) for m in movements if (columns := as_effect(form).columns(m)).any()]
    return float(np.sqrt(np.mean(squares))) if squares else 1.0


# Whether a fit with a law is plausible for a gyroscope, which its score alone does not show.

#: largest mean square of residuals in sigmas: one under the noise that was estimated with them, unless the fit has not converged
MOST_LEFT = 2.0
#: change of the scale factor and misalignments that a law may cause: five times the sensitivity's tolerance on the data sheet.  A rate
#: and the same rate clipped above its range are nearly collinear: each may have any size while their sum is small, and the calibration is
#: lost.  benchmarks/discover_real.py: on injected/case09 such laws took 0.4
MOST_TAKEN = 0.05
#: the same by linear columns, which are accurate to about half of it
MOST_TAKEN_LINEARLY = 2 * MOST_TAKEN


def believable(have: Hypothesis, base: Hypothesis) -> bool:
    """Whether a hypothesis with a law is plausible against one without it: its fit has converged, and the calibration stays."""
    arrived = float(have.fit.r @ have.fit.r) < MOST_LEFT * len(have.fit.r)
    return arrived and float(np.abs(have.fit.state.model.E - base.fit.state.model.E).max()) < MOST_TAKEN


def _takes_calibration(form: LawForm, responses: Responses, projection: Projection, fit: Refit) -> bool:
    """Whether a form, at its best by linear columns against a fit in a projection's noise, would replace the calibration.

    A form that differs from the rate in one turn alone fits that turn while it changes the scale factor of all others: its promise is
    large, but its refit is rejected.
    """
    columns = projection.whitened(responses.columns(form))
    theta = np.linalg.lstsq(projection.free_of(columns), projection.residual, rcond=None)[0]
    moved = np.linalg.lstsq(fit.J, columns @ theta, rcond=None)[0]
    return bool(np.abs(moved[LINEAR][MATRIX]).max() > MOST_TAKEN_LINEARLY)


# A law's constants, fitted with all else: the linear columns that refined them contain only the rate still disturbed by the law.
#
# Gauss-Newton, as for the one scanned number of a catalogue effect; a step is kept where the recording is more probable with it.
# The uncertainty of the constants widens that of the coefficients.

#: ln of a constant, for a central difference: large enough that some samples pass a moving threshold
STEP = 0.01
#: steps, and fractions of one that are tried
STEPS, SHARES = 6, (1.0, 0.3)
#: least share of the residuals' squares that a step is assumed to leave
LEAST_LEFT = 0.01
#: sigmas: a step this short is the last
ENOUGH = 0.1


@dataclass(frozen=True, eq=False)
class Constants:
    """Estimates from one fit for the K constants of one of its laws, in ln of each.

    step (K,): to the optimum of the linear columns; covariance (K, K): all else free; along (p, K): derivatives of the fit's parameters
    with respect to them; worth: -2 log evidence that the step promises, with the noise's size following the residuals.
    """

    step: np.ndarray
    covariance: np.ndarray
    along: np.ndarray
    worth: float

    @classmethod
    def of(cls, twin: Twin, have: Hypothesis, law: Effect, form: LawForm) -> Constants:
        """Estimates for a law that has constants."""
        fit, replay = have.fit, Replay(twin, have.fit)
        moves = have.whiten(_moves(twin, have, law, form, replay))
        along = fit.covariance @ (fit.J.T @ moves)
        information = moves.T @ moves - (moves.T @ fit.J) @ along + np.eye(moves.shape[1]) / LOOSE**2
        left = fit.r - fit.J @ (fit.covariance @ (fit.J.T @ fit.r))
        step = np.clip(-np.linalg.solve(information, moves.T @ left), -FARTHEST, FARTHEST)
        rows, share = len(left), float(step @ information @ step) / max(float(left @ left), 1e-300)
        return cls(step, np.linalg.inv(information), along, -rows * np.log(max(1 - share, LEAST_LEFT)))

    def sigmas(self, form: LawForm) -> tuple[float, ...]:
        """Sigma of each constant, in its unit."""
        return tuple((sigmas_in(self.covariance) * form.constants).tolist())

    def widened(self, covariance: np.ndarray) -> np.ndarray:
        """Covariance (p, p) of the fit's parameters, with the constants free."""
        return covariance + self.along @ self.covariance @ self.along.T


def exact(evidence: FormEvidence, have: Hypothesis, law: Effect) -> tuple[Hypothesis, Effect]:
    """The hypothesis with a law's constants at their optimum, and the law."""
    for _ in range(STEPS if evidence.forms[law.id].constants else 0):
        if evidence.exhausted:
            break
        known = Constants.of(evidence.twin, have, law, evidence.forms[law.id])
        if np.all(np.abs(known.step) < ENOUGH * sigmas_in(known.covariance)):
            break
        better = next((found for share in SHARES if (found := _stepped(evidence, have, law, share * known.step))), None)
        if better is None:
            break
        have, law = better
    return have, law


def one_step(evidence: FormEvidence, have: Hypothesis, law: Effect, lacking: float) -> tuple[Hypothesis, Effect]:
    """The same after one step, where it promises the lacking -2 log evidence; else unchanged."""
    form = evidence.forms[law.id]
    if not form.constants:
        return have, law
    known = Constants.of(evidence.twin, have, law, form)
    if known.worth <= max(lacking, ENOUGH**2):
        return have, law
    return _stepped(evidence, have, law, known.step) or (have, law)


def _stepped(evidence: FormEvidence, have: Hypothesis, law: Effect, step: np.ndarray) -> tuple[Hypothesis, Effect] | None:
    """The result of a step, or None where the recording is less probable with it or the fit is not plausible."""
    form = evidence.forms[law.id]
    other = evidence.effect_of(form.with_constants(form.constants * np.exp(step)))
    trial = evidence.of(tuple(other if effect is law else effect for effect in have.effects), have)
    return (trial, other) if trial.score < have.score and believable(trial, have) else None


def _moves(twin: Twin, have: Hypothesis, law: Effect, form: LawForm, replay: Replay) -> np.ndarray:
    """Derivatives (n, K) of the stacked residuals with respect to ln of each constant."""
    claim = next(claim for claim in have.fit.state.claims if claim.effect is law)
    state, found = have.fit.state, []
    for number in range(len(form.constants)):
        sides = []
        for side in (-1, 1):
            constants = np.array(form.constants)
            constants[number] *= np.exp(side * STEP)
            effect = as_effect(form.with_constants(constants), law.id)
            sides.append(twin.effect_columns(effect, state, replay.sensitivity, replay.rates).stacked() @ claim.theta)
        found.append((sides[1] - sides[0]) / (2 * STEP))
    return np.stack(found, axis=1)


# The search over forms against a hypothesis: screened linearly, refined, ranked with re-estimated noise, refitted exactly.

#: shapes that are refined and ranked by their linear columns in each projection: the law is among the first three in nearly all
#: sessions
MOST_REFINED = 14
#: most promising forms in each projection that are checked for replacing the calibration
MOST_CHECKED = 60
#: of those, plausible exact refits; and refits tried, where some are not plausible
MOST_EXACT, MOST_TRIED = 4, 12
#: exact refits for the promise alone
MOST_PROMISED = 3
#: -2 log evidence within which one more is refitted exactly
NEAR = 12.0
#: -2 log evidence by linear columns, of a form added to a hypothesis
Trial = tuple[float, Effect, Hypothesis]


@dataclass(frozen=True, eq=False)
class SearchRound:
    """best: the hypothesis with one more form, or None; screening: of all forms; tried: effects of forms that were tried as the added one,
    the best first."""

    best: Hypothesis | None
    screening: Screening
    tried: list[Effect]


def with_a_form(
    evidence: FormEvidence, forms: Sequence[LawForm], bases: Sequence[Hypothesis], seed: int, progress: Reporter
) -> SearchRound:
    """The best hypothesis with one form more than one of the bases, of which the last is the most probable."""
    whitens = [(base, whiten) for base in bases for whiten in (evidence.first_whiten, base.whiten)]
    projections = [(whiten, rewhitened(base, whiten)) for base, whiten in whitens]
    screening = screened(Replay(evidence.twin, bases[-1].fit), forms, projections, seed, progress=lambda what, done, of: progress(what))
    progress("sharpening the best forms")
    trials: list[Trial] = []
    promised: dict[str, float] = {}
    for number, (base, _) in enumerate(whitens):
        projection, fit = screening.all_projections[number], projections[number][1]
        takes = partial(_takes_calibration, responses=screening.all_responses, projection=projection, fit=fit)
        for at in _first_of_each_shape(forms, screening.promise[number], takes):
            effect = evidence.effect_of(refined(forms[at], screening.all_responses, projection))
            promised[effect.id] = float(screening.tested[at])
            trials.append((evidence.guess(base, add=effect).score, effect, base))
    trials.sort(key=lambda trial: trial[0])
    progress("refitting the best forms exactly")
    # The first of the sorted trials that differ by their constants or their base alone
    first: dict[LawForm, Trial] = {}
    for trial in trials:
        first.setdefault(evidence.forms[trial[1].id].shape, trial)
    refitted = _refitted(evidence, list(first.values()), promised)
    best = min(refitted, key=lambda h: h.score, default=None)
    stood = {effect.id for base in bases for effect in base.effects}
    new = [effect for have in refitted for effect in have.effects if effect.id in evidence.forms and effect.id not in stood]
    return SearchRound(best, screening, list(dict.fromkeys([*new, *(effect for _, effect, _ in trials)])))


def _refitted(evidence: FormEvidence, trials: list[Trial], promised: dict[str, float]) -> list[Hypothesis]:
    """Refit the best candidates exactly with their constants: by their linear columns in re-estimated noise, and by the screening's
    promise. Either ranking may be misled where a strong law bends the calibration from which all start."""
    found: list[Hypothesis] = []

    def refit(effect: Effect, base: Hypothesis) -> None:
        weighed = evidence.of((*base.effects, effect), base)
        if believable(weighed, base):
            best = min((have.score for have in found), default=weighed.score)
            found.append(one_step(evidence, weighed, effect, weighed.score - best)[0])

    for score, effect, base in trials[:MOST_TRIED]:
        if len(found) >= MOST_EXACT or (found and (evidence.exhausted or score > trials[0][0] + NEAR)):
            break
        refit(effect, base)
    for _, effect, base in sorted(trials, key=lambda trial: -promised[trial[1].id])[:MOST_PROMISED]:
        if evidence.exhausted:
            break
        refit(effect, base)
    return found


def _first_of_each_shape(forms: Sequence[LawForm], promise: np.ndarray, takes_calibration: Callable[[LawForm], bool]) -> list[int]:
    """Numbers of the most promising forms that keep the calibration; of those that differ by constants alone the first."""
    found: dict[LawForm, int] = {}
    checked = 0
    for number in np.argsort(-promise, kind="stable"):
        form = forms[number]
        if promise[number] <= 0 or len(found) >= MOST_REFINED:
            break
        if form.shape in found:
            continue
        checked += 1
        if checked > MOST_CHECKED or not takes_calibration(form):
            found[form.shape] = int(number)
    return list(found.values())
