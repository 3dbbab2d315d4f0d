"""The state of a search: its held-out data, results and rivals, and the reasons to reject a law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from session.base.records import Count, Key
from session.base.texts import probability, significant
from session.base.units import DEG
from tinygc.closure.problem import Problem
from tinygc.effects import Effect
from tinygc.explanation.decision import LEAST_EXCESS, tilt_rms
from tinygc.explanation.evidence import Hypothesis
from tinygc.explanation.search import rewhitened
from tinygc.features.discovery.constants import ByAxis, by_axis, gain_of, linear_coefficients
from tinygc.features.discovery.enumeration import bits
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_effect import added, as_effect, correlation, left_by_calibration
from tinygc.features.discovery.projections import Projection
from tinygc.features.discovery.screening import promised_after
from tinygc.features.discovery.selection import FormEvidence, SearchRound, believable, one_step
from tinygc.features.discovery.words import equation
from tinygc.inference.choose import STAND_IN, chi_square_above
from tinygc.inference.prove import signed_ranks_above
from tinygc.noise.components import SessionNoise, first_noise
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener

# The searched and the held-out data: a third of the turns and stills is held out, and one whole recording of several.
#
# Turns are held out in runs: the stills between two of them then belong to them alone and leave no trace in the searched data.

#: turns that are held out together, of three times as many: few enough to sample each part of a session, and enough that most of their
#: stills are their own
RUN = 4
#: searched runs of three
SEEN = 2
#: fewest turns for a test: all of four improve in one of sixteen cases by chance; a session needs three times as many
FEWEST = 5


@dataclass(frozen=True, eq=False)
class HeldOutSplit:
    """seen: the problem that is searched; parts, recording: used segments (indices) of the whole problem that are held out, in runs and as
    one whole log, whose number is ``log``; None where there is one log."""

    seen: Problem
    parts: np.ndarray
    recording: np.ndarray
    log: int | None


def parted(problem: Problem, seed: int) -> HeldOutSplit:
    """Split a problem's used segments: a random third is held out, in runs counted through all logs, or as one piece where a third of the
    runs may be too few for a test.  Of several recordings the smallest that is large enough for a test is held out whole, where the others
    suffice for the search."""
    used, rng = problem.used, np.random.default_rng(seed)
    logs = np.array([segment.log for segment in used])
    counts = np.bincount(logs)
    enough = np.flatnonzero((counts >= FEWEST) & (len(used) - counts >= 3 * FEWEST))
    whole = int(enough[np.argmin(counts[enough])]) if len(enough) else None
    recording = logs == whole if whole is not None else np.zeros(len(used), dtype=bool)
    rest, first = np.flatnonzero(~recording), int(rng.permutation(SEEN + 1)[0])
    thirds = [(np.arange(len(rest)) + shift * RUN) % (RUN * (SEEN + 1)) < RUN for shift in range(SEEN + 1)]
    if min(map(np.count_nonzero, thirds)) < FEWEST:
        thirds = [np.isin(np.arange(len(rest)), piece) for piece in np.array_split(np.arange(len(rest)), SEEN + 1)]
    held = np.zeros(len(used), dtype=bool)
    held[rest[thirds[first]]] = True
    return HeldOutSplit(problem.without(held | recording), np.flatnonzero(held), np.flatnonzero(recording), whole)


# The result of a search for an equation.


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Test on held-out data: closure (tilt, rms) rad with the catalogue's effects alone, with the law in addition, and the noise's;
    removed: share of the excess over the noise that the law removes, None where there was hardly any; p_value: of chance improving it as
    much; noise_p: of the sensor's own noise leaving as much as the law leaves; segments: how many; recording: the log that was held out
    whole, None where these are parts of each."""

    before_rad: Annotated[float, Key("before_deg", DEG)]
    after_rad: Annotated[float, Key("after_deg", DEG)]
    floor_rad: Annotated[float, Key("floor_deg", DEG)]
    removed: float | None
    p_value: float
    noise_p: float
    segments: Count
    recording: str | None = None


@dataclass(frozen=True, eq=False)
class Rival:
    """effect in the law's place, and its form, None of the catalogue's; hypothesis with it, None where only its linear columns were
    evaluated; worse: -2 log evidence; chi_worse: chi-square alone, in the noise of the law's hypothesis, without a price of coefficients,
    inf where it is unknown; correlation of the hypotheses' whole added rates beyond a calibration, 0 where it is unknown."""

    form: LawForm | None
    effect: Effect
    worse: float
    correlation: float
    chi_worse: float = np.inf
    hypothesis: Hypothesis | None = None

    @property
    def nearest(self) -> float:
        """The lesser of the disadvantages: prices may guide the search and no more."""
        return min(self.worse, self.chi_worse)


@dataclass(frozen=True, eq=False)
class Law:
    """One law: form, and as an effect with its id and equation; theta (P,) and covariance (P, P) SI, of all rows; constants_sigma: of the
    form's constants, in their order; gain: chi-square that it removes; better: -2 log evidence by which it
    is better than without it; chance_p: of the best form of all doing as much in noise; held_out: parts of each recording, and the whole
    recording that was held out, where there are several; same: forms that are the same in this recording; runners_up: others, best first;
    learnable_from: factor on its size from which this search finds it here in 19 of 20 draws of noise, None: not at any; unobserved (q, P):
    orthonormal combinations of the coefficients that the recording does not observe, which theta and covariance are without; doubt: why it
    is only a candidate by itself, or empty."""

    form: LawForm
    effect: Effect
    theta: np.ndarray
    covariance: np.ndarray
    constants_sigma: tuple[float, ...]
    gain: float
    better: float
    chance_p: float
    held_out: tuple[HeldOut, ...]
    same: tuple[LawForm, ...] = ()
    runners_up: tuple[Rival, ...] = ()
    learnable_from: float | None = None
    unobserved: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    doubt: str = ""


@dataclass(frozen=True, eq=False)
class Discovery:
    """verdict: "found": the laws are reported; "ambiguous": laws are supported, but a rival of another rate is as good, they are barely
    observable, or they leave more than noise; "none": no equation of this grammar; why: one line, of the last two.

    laws; accompanying: the catalogue's effects with them, or alone: id, parameters and their std as docs/formats.md names them; forms: how
    many were enumerated, distinct: how many of them differ in this recording; chance_promise: what the best form of all promises in
    noise alone, 95 % of the time less; best_promise: of the recording itself; learnable: quantity -> size, rms rad/s, from which a law of
    it alone is found here in 19 of 20 draws of noise, None where not at all.
    """

    verdict: str
    why: str
    laws: tuple[Law, ...]
    accompanying: tuple[dict, ...]
    forms: int
    distinct: int
    chance_promise: float
    best_promise: float
    learnable: dict[str, float | None] = field(default_factory=dict)


# Prediction of the held-out data with the law and without it.
#
# Parameters come from the searched turns alone.  Each held-out turn counts with the held-out still at its beginning, in the sigmas of the
# noise under the law's hypothesis.  Turns are paired: Wilcoxon's signed-rank test gives the probability that chance improves as many.


class Unseen:
    """A whole recording, part of which was searched.  whole: its twin; seen: the twin that was searched."""

    def __init__(self, whole: Twin, seen: Twin):
        self.whole, self.white = whole, Whitener(whole)
        self._first = first_noise(whole, self.white)
        self._sensor_sigma = self.white.with_more(self._first.covariance).sigma
        in_seen = {(log, still.start) for log, still in seen.stills}
        self._left_out = np.array([(log, still.start) not in in_seen for log, still in whole.stills], dtype=bool)

    def sigma(self, noise: SessionNoise) -> np.ndarray:
        """Sigmas (n,) of all rows, for noise that was estimated from a part of them."""
        s = np.array([noise.size(component.name) for component in self._first.components])
        return self.white.with_more(replace(self._first, s=s).covariance).sigma

    def assessed(self, without: Hypothesis, law: Hypothesis, held: np.ndarray, recording: str | None = None) -> HeldOut | None:
        """Test the law's prediction of the used segments ``held`` (indices); None where there are none."""
        if not len(held):
            return None
        sigma = self.sigma(law.noise)
        before, after = (self.whole.residuals(each.fit.state) for each in (without, law))
        gains = self._squares(before.stacked() / sigma)[held] - self._squares(after.stacked() / sigma)[held]
        white = self.whole.problem.floor.white[held]
        floor = float(np.sqrt(np.mean(white[:, 0, 0] + white[:, 1, 1])))
        rms = [tilt_rms(each.closure[held]) for each in (before, after)]
        excess = rms[0] ** 2 - floor**2
        removed = None if excess < LEAST_EXCESS * floor**2 else 1 - max(rms[1] ** 2 - floor**2, 0.0) / excess
        # Probability under white noise and the sensor's bias instability only, so that the residuals do not raise the noise
        closure = (after.stacked() / self._sensor_sigma)[self.white.parts["closure"]].reshape(len(self.whole.segments), -1)[held]
        noise_p = chi_square_above(float(np.sum(closure**2)), closure.size)
        return HeldOut(rms[0], rms[1], floor, removed, signed_ranks_above(gains), noise_p, len(held), recording)

    def _squares(self, rows: np.ndarray) -> np.ndarray:
        """Sums of squares (S,) of rows (n,) in sigmas: of each segment, with the still at its beginning where that was held out."""
        closure, still, length = (rows[part] ** 2 for part in self.white.parts.values())
        of_stills = (still.reshape(-1, 3).sum(axis=1) + length) * self._left_out
        return closure.reshape(len(self.whole.segments), -1).sum(axis=1) + of_stills[self.whole.first]


# The state of a search: the best hypothesis of catalogue effects, the best with laws, and the held-out data.

#: chance of the sensor's own noise leaving as much as the laws leave, below which the residuals exceed noise
NOISE_P = 0.01


@dataclass(frozen=True, eq=False)
class SearchState:
    """evidence of the searched data; unseen; split; names: the catalogue's effects; catalogue: the best hypothesis of them; shapes: with
    unnamed shapes in addition; best: with laws; rounds of the search; entered: each law's id -> the number of the round that added it;
    forms that were tried; why: the reason to reject a law; near: rivals of a law of a hypothesis, each computed once."""

    evidence: FormEvidence
    unseen: Unseen
    split: HeldOutSplit
    names: list[Effect]
    catalogue: Hypothesis
    shapes: Hypothesis
    best: Hypothesis
    rounds: list[SearchRound]
    entered: dict[str, int]
    forms: list[LawForm]
    why: str = ""
    near: dict[tuple[int, str], list[Rival]] = field(default_factory=dict)

    @property
    def laws(self) -> list[Effect]:
        """The forms among the best hypothesis' effects."""
        return [effect for effect in self.best.effects if effect.id in self.evidence.forms]

    def held_out_of(self, law: Effect) -> tuple[HeldOut, ...]:
        """Tests of a law on the held-out parts of each recording, and on a whole one, where there are several."""
        split, unseen, without = self.split, self.unseen, self.without(law)
        log = None if split.log is None else unseen.whole.problem.session.logs[split.log].path.name
        tests = (unseen.assessed(without, self.best, split.parts), unseen.assessed(without, self.best, split.recording, log))
        return tuple(test for test in tests if test is not None)

    def without(self, law: Effect) -> Hypothesis:
        """The best hypothesis without one of its laws."""
        return self.evidence.of(tuple(effect for effect in self.best.effects if effect is not law), self.best)

    def chance_p(self, law: Effect) -> float:
        """Probability that the best of all forms promises as much in noise alone as a law does with the rest of the hypothesis.

        The noise draws use the constants of the grid; so does the law, by the best of its neighbours there.
        """
        screening, projection = self.round_of(law).screening, self.projection_without(law)
        on_grid = screening.neighbours(self.evidence.forms[law.id])
        return screening.chance.p(max(promised_after(screening, form, projection) for form in on_grid))

    def projection_without(self, law: Effect) -> Projection:
        """Projection orthogonal to the best hypothesis without one law, in the noise estimated with all."""
        whiten = self.best.whiten
        return Projection(self.evidence.twin, whiten, rewhitened(self.without(law), whiten))

    @property
    def closes_to_noise(self) -> bool:
        """Whether the searched turns close as well as white noise and the sensor's bias instability allow."""
        whiten, twin = self.evidence.first_whiten, self.evidence.twin
        closure = (twin.residuals(self.best.fit.state).stacked() / whiten.sigma)[whiten.parts["closure"]]
        return chi_square_above(float(closure @ closure), closure.size) > NOISE_P

    def round_of(self, law: Effect) -> SearchRound:
        """The round in which a law was found: later rounds contain it and no alternatives to it."""
        return self.rounds[self.entered[law.id]]

    @property
    def tried(self) -> list[Effect]:
        """Forms that were tried in any round."""
        return list(dict.fromkeys(effect for each in self.rounds for effect in each.tried))


# Two laws that add the same rate beyond a calibration are the same.

#: correlation of the added rates above which two laws are numerically the same
EQUAL = 0.99

# Whether a law's constant differs by axis, so that a constant common to all axes makes another law of it.


def differing(searched: SearchState, law: Effect) -> ByAxis | None:
    """The best constants by axis, where they improve by as much as a rival must and add another rate; else None."""
    form, movements = searched.evidence.forms[law.id], searched.evidence.twin.movements
    responses, projection = searched.round_of(law).screening.all_responses, searched.projection_without(law)
    found = max(by_axis(form, responses, projection), key=lambda each: each.more, default=None)
    if found is None or found.more < STAND_IN:
        return None
    theta = linear_coefficients(responses.columns(form), projection)
    rates = added(as_effect(form), theta, movements), found.added(movements)
    one, other = (left_by_calibration(rate, movements) for rate in rates)
    return None if correlation(one, other) > EQUAL else found


# Whether a threshold at which a law decides for a long time is known well enough for another movement.
#
# A sign that stays changes at a few moments alone.  All thresholds between the peaks of two turns give the same rate here, and another
# movement peaks between them.  The same movement at other speeds stands for it.

#: speeds, over the recording's own
SPEEDS = tuple(np.linspace(0.8, 1.25, 10).tolist())
#: ratio up to which a threshold is moved either way, and steps of it
MOVED, MOVES = 1.3, 40


def open_threshold(searched: SearchState, law: Effect, enough: float) -> tuple[float, float] | None:
    """The range of a law's deciding threshold that the recording leaves open, in its unit, where its ends add rates to the movement at
    other speeds that correlate less than ``enough`` in the mean; else None."""
    form, movements = searched.evidence.forms[law.id], searched.evidence.twin.movements
    factors = [factor for factor in form.factors if factor.through.decided]
    if len(factors) != 1 or len(form.constants) != 1:
        return None
    responses, projection = searched.round_of(law).screening.all_responses, searched.projection_without(law)
    (own,) = form.constants

    def at(value: float) -> LawForm:
        return form.with_constants((value,))

    def gain(value: float) -> float:
        return gain_of(responses.columns(at(value)), projection)

    least, ends = gain(own) - STAND_IN, []
    for side in (-1.0, 1.0):
        end = own
        for step in range(1, MOVES + 1):
            moved = own * MOVED ** (side * step / MOVES)
            if gain(moved) < least:
                break
            end = moved
        ends.append(end)
    theta = linear_coefficients(responses.columns(form), projection)
    found = []
    for speed in SPEEDS:  # a faster movement passes a lower threshold alike
        rates = [added(as_effect(at(end / speed)), theta, movements) for end in ends]
        found.append(correlation(*(left_by_calibration(rate, movements) for rate in rates)))
    return (ends[0], ends[1]) if np.mean(found) < enough else None


# Forms and catalogue effects that could replace the law: by how much they are worse, and whether they add another rate.

#: -2 log evidence beyond the reported limit within which a rival is refitted exactly: the error of the linear approximation
MARGIN = 6.0
#: most rivals refitted exactly; further near ones are rivals of unknown rate
MOST_EXACT = 12


def rivals(evidence: FormEvidence, best: Hypothesis, law: Effect, others: list[Effect], alike: Sequence[Effect] = ()) -> list[Rival]:
    """The nearest of the other effects when they take the place of ``law``, the best first; alike: further ones, all refitted exactly."""
    rest = [other for other in dict.fromkeys([*alike, *others]) if other.id != law.id and other.id not in best.ids]
    required, own, found = set(alike), whole_added(evidence.twin, best), list[Rival]()
    guessed = [evidence.guess(best, without=law, add=other) for other in rest]
    nearest = [-np.inf if other in required else guess.score - best.score for other, guess in zip(rest, guessed, strict=True)]
    for place, number in enumerate(np.argsort(nearest, kind="stable")):
        other, weighed, correlated, chi, hypothesis = rest[number], guessed[number], 0.0, np.inf, None
        near = other in required or (place - len(required) < MOST_EXACT and nearest[number] < STAND_IN + MARGIN)
        if near and not evidence.exhausted:
            hypothesis = evidence.of((*(effect for effect in best.effects if effect is not law), other), best)
            if not believable(hypothesis, best):
                continue
            if other.id in evidence.forms:  # the law's constants are optimal, so a rival's must be
                hypothesis, other = one_step(evidence, hypothesis, other, hypothesis.score - best.score - STAND_IN)
            weighed, correlated = hypothesis, correlation(own, whole_added(evidence.twin, hypothesis))
            chi = chi_square_beyond(hypothesis, best)
        found.append(Rival(evidence.forms.get(other.id), other, weighed.score - best.score, correlated, chi, hypothesis))
    return sorted(found, key=lambda rival: rival.worse)


def chi_square_beyond(hypothesis: Hypothesis, best: Hypothesis) -> float:
    """Chi-square of a hypothesis less that of another, in the noise of the latter."""
    r = rewhitened(hypothesis, best.whiten).r
    return float(r @ r - best.fit.r @ best.fit.r)


# Forms that do the same to every turn between stills, whatever they do within it.
#
# What stands still at both ends of a turn is not in its closure: a rate y' + ω x y, y zero in every still, turns the body back.  So forms
# of quite different rates may fit alike, at any size, and the price of descriptions must not choose between them.

#: share of a law's gain that a form of its gain may lack: the error of the linear columns and of constants on a grid
MISSING_SHARE = 0.03
#: most of them that are refitted exactly, those of the fewest numbers first
MOST_ALIKE = 6


def alike(searched: SearchState, law: Effect) -> list[Effect]:
    """Effects of other forms that take up about as much by their linear columns in any of the projections, and the law without its lag."""
    evidence, screening = searched.evidence, searched.round_of(law).screening
    form = evidence.forms[law.id]
    own = [number for number, other in enumerate(screening.forms) if other.shape == form.shape]
    found: dict[LawForm, LawForm] = {}
    late = any(factor.lag_s is not None for factor in form.factors)
    if late:
        plain = LawForm(tuple(replace(factor, lag_s=None) for factor in form.factors), form.pattern)
        found[plain.shape] = plain
    if own:
        level = screening.gain[:, own].max(axis=1, keepdims=True)
        near = np.flatnonzero((screening.gain > (1 - MISSING_SHARE) * level - STAND_IN - MARGIN).any(axis=0))
        gain = screening.gain.max(axis=0)
        for number in sorted(near.tolist(), key=lambda n: (numbers_of(screening.forms[n]), -gain[n])):
            other = screening.forms[number]
            if other.shape != form.shape:
                found.setdefault(other.shape, other)
            if len(found) >= MOST_ALIKE:
                break
    return [evidence.effect_of(other) for other in found.values()]


def numbers_of(form: LawForm) -> tuple[int, int, int, float]:
    """How many constants a form has within its functions, how many numbers in all, how many factors, and its bits: fewer is plainer."""
    return len(form.constants), len(form.constants) + form.size, len(form.factors), bits(form)


def whole_added(twin: Twin, hypothesis: Hypothesis) -> np.ndarray:
    """Rate added by all effects of a hypothesis, beyond a calibration, (N, 3) rad/s."""
    movements = twin.movements
    total = np.zeros((sum(len(movement.t_s) for movement in movements), 3))
    for claim in hypothesis.fit.state.claims:
        if claim.effect.kind == "rate":
            total += added(claim.effect, claim.theta, movements)
    return left_by_calibration(total, movements)


# Reasons to reject a law.

#: largest share of searches in which chance does as well
CHANCE = 0.01
#: largest p of chance improving the held-out data as much: one-sided, as ``explain``'s own veto
HELD_OUT_P = 0.05
#: share of the excess over the noise that reported laws must remove where their residuals exceed noise: stand-ins remove about half
MOST_OF_IT = 0.9
#: the same for found laws: one whose rate correlates EQUAL with the truth's leaves 1 - EQUAL^2 of its square; a dozen turns determine
#: that share to half
ALL_OF_IT = 1 - (1 - EQUAL**2) / 2


def refused(searched: SearchState, law: Effect) -> str | None:
    """Why a law of the best hypothesis is rejected, or None."""
    best, evidence = searched.best, searched.evidence
    chance_p, text = searched.chance_p(law), equation(evidence.forms[law.id])
    if chance_p > CHANCE:
        return f"the best form does no more than chance does in {significant(100 * chance_p, 2)} % of such searches: {text}"
    if searched.catalogue.score < best.score + STAND_IN:
        names = ", ".join(sorted(searched.catalogue.ids))
        return f"on the turns that were searched {names} is of equal worth" if names else "noise alone explains the turns searched as well"
    if searched.without(law).score < best.score + STAND_IN:
        return f"the rest explains the turns that were searched as well without it: {text}"
    name = next(iter(rivals(evidence, best, law, searched.names)), None)
    if name is not None and name.worse < STAND_IN:
        return f"on the turns that were searched {name.effect.id} is of equal worth with the rest: {text}"
    if searched.shapes.score < best.score - STAND_IN:
        return f"a shape without a law does better: {', '.join(sorted(searched.shapes.ids))}"
    for test in searched.held_out_of(law):
        if test.removed is not None and test.removed <= 0:
            return f"the best form worsens the closure of the held-out segments: {text}"
        if test.p_value > HELD_OUT_P:
            return f"chance improves the held-out segments as much as the best form does ({probability(test.p_value)}): {text}"
    return None


def leaves_something(searched: SearchState) -> bool:
    """Whether a further law is to be searched; the held-out data have no part in this, as they are to test that law, too."""
    return searched.best.noise.unusual or not searched.closes_to_noise


def taken(searched: SearchState) -> float:
    """The least share of the held-out excess that a law removes; one where the residuals are the sensor's own noise."""
    tests = (test for law in searched.laws for test in searched.held_out_of(law))
    return min((test.removed for test in tests if test.removed is not None and test.noise_p < NOISE_P), default=1.0)
