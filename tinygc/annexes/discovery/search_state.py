"""The state of a search: what it may see, what it found, its rivals, and why a law is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from session.detect.segments import Segment
from session.detect.stills import Still
from tinygc.annexes.discovery.constants import ByAxis, by_axis, linear_coefficients
from tinygc.annexes.discovery.equivalence import added, as_effect
from tinygc.annexes.discovery.form import LawForm
from tinygc.annexes.discovery.projections import Projection
from tinygc.annexes.discovery.screening import promised_beside
from tinygc.annexes.discovery.selection import FormEvidence, SearchRound, believable, one_step
from tinygc.annexes.discovery.words import equation
from tinygc.closure.floor import Floor
from tinygc.closure.problem import LEFT_OUT, Problem
from tinygc.closure.uncertainty import chi_square_above
from tinygc.effects import Effect, Movement
from tinygc.explanation.decision import LEAST_EXCESS, tilt_rms
from tinygc.explanation.evidence import Hypothesis
from tinygc.explanation.search import STAND_IN, rewhitened
from tinygc.noise.session_noise import SessionNoise, first_noise
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener

# What the search sees, and what it never sees: a third of the turns and stills, and of several recordings one whole.
#
# Turns are left out in runs: the stills between two of them then belong to them alone, and nothing of them is left in what is seen.

#: turns that are left out together, of three times as many: so few that each part of a session has some, so many that most of their stills
#: are their own
RUN = 4
#: of three
SEEN = 2
#: turns by which a law can be judged: all of four improve in one of sixteen cases by chance; a session needs three times so many
FEWEST = 5


@dataclass(frozen=True, eq=False)
class HeldOutSplit:
    """seen: the problem that is searched; parts, recording: used segments (indices) of the whole problem that are left out, in runs and
    with one whole log, whose number is ``log``; None where there is one log."""

    seen: Problem
    parts: np.ndarray
    recording: np.ndarray
    log: int | None


def parted(problem: Problem, seed: int) -> HeldOutSplit:
    """Of a problem's used segments; which third is left out is drawn, in runs that are counted through all logs, or, where there are so
    few that a third of runs may be too few to judge by, as one piece.  Of several recordings the smallest that is enough to judge by is
    left out whole, where the others are enough to search."""
    used, rng = problem.used, np.random.default_rng(seed)
    logs = np.array([segment.log for segment in used])
    counts = np.bincount(logs)
    enough = np.flatnonzero((counts >= FEWEST) & (len(used) - counts >= 3 * FEWEST))
    whole = int(enough[np.argmin(counts[enough])]) if np.count_nonzero(counts) > 1 and len(enough) else None
    recording = logs == whole if whole is not None else np.zeros(len(used), dtype=bool)
    rest, first = np.flatnonzero(~recording), int(rng.permutation(SEEN + 1)[0])
    thirds = [(np.arange(len(rest)) + shift * RUN) % (RUN * (SEEN + 1)) < RUN for shift in range(SEEN + 1)]
    if min(map(np.count_nonzero, thirds)) < FEWEST:
        thirds = [np.isin(np.arange(len(rest)), piece) for piece in np.array_split(np.arange(len(rest)), SEEN + 1)]
    held = np.zeros(len(used), dtype=bool)
    held[rest[thirds[first]]] = True
    return HeldOutSplit(without(problem, held | recording), np.flatnonzero(held), np.flatnonzero(recording), whole)


def without(problem: Problem, held: np.ndarray) -> Problem:
    """The problem without some of its used segments, held (S,) bool, and without the stills that no other of them touches."""
    used = problem.used
    gone = {id(used[i]) for i in np.flatnonzero(held)}
    kept_stills = {id(still) for i in np.flatnonzero(~held) for still in used[i].stills}
    ends = {id(still) for i in np.flatnonzero(held) for still in used[i].stills} - kept_stills
    at_rest = [still for log in problem.logs for still in log.stills if still.problem is None]
    stays = np.array([id(still) not in ends for still in at_rest])

    def still_of(still: Still) -> Still:
        return replace(still, problem=LEFT_OUT) if id(still) in ends else still

    def segment_of(segment: Segment) -> Segment:
        return replace(segment, problem=LEFT_OUT) if id(segment) in gone else segment

    rates = problem.still_rates
    return replace(  # its bias instability, where stills tell it, from its own stills
        problem,
        segments=[segment_of(segment) for segment in problem.segments],
        batch=problem.batch.pick(~held),
        floor=_floor(problem.floor, held),
        logs=[replace(log, stills=[still_of(still) for still in log.stills]) for log in problem.logs],
        still_rates=replace(
            rates,
            rate=rates.rate[stays],
            earth=rates.earth[stays],
            sigma=rates.sigma[stays],
            q_tb=None if rates.q_tb is None else rates.q_tb[stays],
            middle_s=None if rates.middle_s is None else rates.middle_s[stays],
        ),
    )


def _floor(floor: Floor, held: np.ndarray) -> Floor:
    """Of the segments that stay: two that were no neighbours share no still."""
    kept = np.flatnonzero(~held)
    neighbours = np.diff(kept) == 1
    shared = np.where(neighbours[:, None, None], floor.shared[kept[:-1]], 0.0)
    return replace(floor, own=floor.own[kept], shared=shared, wider=None if floor.wider is None else floor.wider[kept])


# What the search for an equation answers.

VERDICTS = ("found", "ambiguous", "none")


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Of what the search never saw: closure (tilt, rms) rad with the names alone, with the law as well, and the noise's; removed: share of
    the excess over the noise that the law takes away, None where there was none to speak of; p_value: of chance improving it as much;
    noise_p: of the sensor's own noise leaving as much as the law leaves; segments: how
    many; recording: the log that was left out whole, None where these are parts of each."""

    before_rad: float
    after_rad: float
    floor_rad: float
    removed: float | None
    p_value: float
    noise_p: float
    segments: int
    recording: str | None = None


@dataclass(frozen=True, eq=False)
class RunnerUp:
    """A form that was weighed in the law's place, or a name of the catalogue: equation; worse: -2 log evidence by which it is worse, with
    the price of descriptions or without, whichever is less; correlation of the rate that it adds with the law's, beside what a
    calibration takes up; splits: what would tell them apart."""

    form: LawForm | None
    effect: Effect
    worse: float
    correlation: float
    splits: str


@dataclass(frozen=True, eq=False)
class Law:
    """One law: form, and as an effect with its id and equation; theta (P,) and covariance (P, P) SI, of all rows; constants_sigma: of the
    form's constants, in their order; bits: of the form among all; gain: chi-square that it takes up; better: -2 log evidence by which it
    is better than without it; chance_p: of the best form of all doing as much in noise; held_out: parts of each recording, and the whole
    recording that was left out, where there are several; same: forms that are the same in this recording; runners_up: others, best first;
    learnable_from: factor on its size from which this search finds it here in 19 of 20 draws of noise, None: not at any."""

    form: LawForm
    effect: Effect
    theta: np.ndarray
    covariance: np.ndarray
    constants_sigma: tuple[float, ...]
    bits: float
    gain: float
    better: float
    chance_p: float
    held_out: tuple[HeldOut, ...]
    same: tuple[LawForm, ...] = ()
    runners_up: tuple[RunnerUp, ...] = ()
    learnable_from: float | None = None


@dataclass(frozen=True, eq=False)
class Beside:
    """An effect of the catalogue that stands beside the laws: id; parameters and their std as docs/formats.md names them."""

    id: str
    parameters: dict
    std: dict


@dataclass(frozen=True, eq=False)
class Discovery:
    """verdict: "found": the laws are said; "ambiguous": they stand, but a rival of another rate is as good, or too little is seen of them,
    or they leave more than noise; "none": no equation of this grammar; why: one line, of the last two.

    laws; beside: the catalogue's effects that stand with them, or alone; forms: how many were enumerated, distinct: how many of them differ
    in this recording; chance_promise: what the best form of all promises in noise alone, 95 % of the time less;
    best_promise: of the recording itself; learnable: quantity -> size, rms rad/s, from which a law of it alone is found here in 19 of 20
    draws of noise, None where not at all.
    """

    verdict: str
    why: str
    laws: tuple[Law, ...]
    beside: tuple[Beside, ...]
    forms: int
    distinct: int
    chance_promise: float
    best_promise: float
    learnable: dict[str, float | None] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Ids of the catalogue's effects that stand beside the laws."""
        return tuple(each.id for each in self.beside)


# What the search never saw, predicted with the law and without it.
#
# Parameters come from the seen turns alone.  Each left-out turn counts with the left-out still at its beginning, in the sigmas of the noise
# that the law's hypothesis has.  Turns are paired: Wilcoxon's signed ranks say how probable it is that chance improves as many.


class Unseen:
    """A whole recording, of which a search saw a part.  whole: its twin; seen: the twin that was searched."""

    def __init__(self, whole: Twin, seen: Twin):
        self.whole, self.white = whole, Whitener(whole)
        self._first = first_noise(whole, self.white)
        self._sensor_sigma = self.white.with_more(self._first.covariance).sigma
        in_seen = {(log, still.start) for log, still in seen.stills}
        self._left_out = np.array([(log, still.start) not in in_seen for log, still in whole.stills], dtype=bool)

    def sigma(self, noise: SessionNoise) -> np.ndarray:
        """(n,) of all rows, by noise that was estimated from a part of them."""
        s = np.array([noise.size(component.name) for component in self._first.components])
        return self.white.with_more(replace(self._first, s=s).covariance).sigma

    def assessed(self, without: Hypothesis, law: Hypothesis, held: np.ndarray, recording: str | None = None) -> HeldOut | None:
        """How the law predicts the used segments ``held`` (indices); None where there are none."""
        from scipy.stats import wilcoxon

        if not len(held):
            return None
        sigma = self.sigma(law.noise)
        before, after = (self.whole.residuals(each.fit.state) for each in (without, law))
        gains = self._squares(before.stacked() / sigma)[held] - self._squares(after.stacked() / sigma)[held]
        p_value = float(wilcoxon(gains, alternative="greater").pvalue) if np.any(gains) else 1.0
        white = self.whole.problem.floor.white[held]
        floor = float(np.sqrt(np.mean(white[:, 0, 0] + white[:, 1, 1])))
        rms = [tilt_rms(each.closure[held]) for each in (before, after)]
        excess = rms[0] ** 2 - floor**2
        removed = None if excess < LEAST_EXCESS * floor**2 else 1 - max(rms[1] ** 2 - floor**2, 0.0) / excess
        return HeldOut(rms[0], rms[1], floor, removed, p_value, self._noise_p(after.stacked(), held), len(held), recording)

    def _noise_p(self, after: np.ndarray, held: np.ndarray) -> float:
        """Of white noise and the bias instability of the sensor: nothing that the law leaves counts as noise because it is there."""
        closure = (after / self._sensor_sigma)[self.white.parts["closure"]].reshape(len(self.whole.segments), -1)[held]
        return chi_square_above(float(np.sum(closure**2)), closure.size)

    def _squares(self, rows: np.ndarray) -> np.ndarray:
        """(S,) of rows (n,) in sigmas: of each segment, and of the still at its beginning where that was left out, too."""
        closure, still, length = (rows[part] ** 2 for part in self.white.parts.values())
        of_stills = (still.reshape(-1, 3).sum(axis=1) + length) * self._left_out
        return closure.reshape(len(self.whole.segments), -1).sum(axis=1) + of_stills[self.whole.first]


# What a search has come to: the best hypothesis of names, the best with laws, and what was put away.

#: chance that the sensor's own noise leaves as much as laws leave, below which something is left
NOISE_P = 0.01


@dataclass(frozen=True, eq=False)
class SearchState:
    """evidence of what was seen; unseen; split; names: the catalogue's effects; catalogue: the best hypothesis of them; shapes: with shapes
    that have none; best: with laws; rounds of the search; entered: of each law's id, the number of the round that brought it; forms that
    were tried; why: a law was refused."""

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

    @property
    def laws(self) -> list[Effect]:
        """The forms among the best hypothesis' effects."""
        return [effect for effect in self.best.effects if effect.id in self.evidence.forms]

    def held_out_of(self, law: Effect) -> tuple[HeldOut, ...]:
        """What a law makes of the parts of each recording that were put away, and of a whole one, where there are several."""
        split, unseen, without = self.split, self.unseen, self.without(law)
        log = None if split.log is None else unseen.whole.problem.session.logs[split.log].path.name
        tests = (unseen.assessed(without, self.best, split.parts), unseen.assessed(without, self.best, split.recording, log))
        return tuple(test for test in tests if test is not None)

    def without(self, law: Effect) -> Hypothesis:
        """The best hypothesis without one of its laws."""
        return self.evidence.of(tuple(effect for effect in self.best.effects if effect is not law), self.best)

    def chance_p(self, law: Effect) -> float:
        """Probability that the best of all forms promises as much in noise alone as a law does beside all that stands with it.

        Noise was asked with the constants of the grid; so is the law, by the best of its neighbours there.
        """
        screening, projection = self.round_of(law).screening, self.projection_without(law)
        on_grid = screening.neighbours(self.evidence.forms[law.id])
        return screening.chance_p(max(promised_beside(screening, form, projection) for form in on_grid))

    def projection_without(self, law: Effect) -> Projection:
        """At all that stands but one of the laws, in the noise as it is with all."""
        whiten = self.best.whiten
        return Projection(self.evidence.twin, whiten, rewhitened(self.without(law), whiten))

    @property
    def closes_to_noise(self) -> bool:
        """Whether the turns that were searched close as well as white noise and the sensor's bias instability allow."""
        whiten, twin = self.evidence.first_whiten, self.evidence.twin
        closure = (twin.residuals(self.best.fit.state).stacked() / whiten.sigma)[whiten.parts["closure"]]
        return chi_square_above(float(closure @ closure), closure.size) > NOISE_P

    def round_of(self, law: Effect) -> SearchRound:
        """That in which a law was found: a later one has it as known, and nothing in its place."""
        return self.rounds[self.entered[law.id]]

    @property
    def tried(self) -> list[Effect]:
        """Forms that were weighed in any round."""
        return list(dict.fromkeys(effect for each in self.rounds for effect in each.tried))


# The rate that a law adds, sample by sample, beside what a calibration takes up: by this, two laws are the same or not.

#: of the rates that two laws add, from which on they are one law in numbers
EQUAL = 0.99


def beside_calibration(rate: np.ndarray, movements: Sequence[Movement]) -> np.ndarray:
    """What of an added rate (N, 3) no E m + B gives: each axis less its regression on one and the three rates."""
    measured = np.concatenate([movement.rate for movement in movements])
    q, _ = np.linalg.qr(np.column_stack([np.ones(len(measured)), measured]))
    return rate - q @ (q.T @ rate)


def correlation(first: np.ndarray, second: np.ndarray) -> float:
    """Of two added rates (N, 3), about zero, all axes together; 0 where one of them adds nothing."""
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.sum(first * second)) / size if size > 0 else 0.0


# Whether a law's constant differs by axis, so that the one that is said for all makes another law of it.


def differing(searched: SearchState, law: Effect) -> ByAxis | None:
    """The constants of each axis that take up most, where they are as much better as a rival must be and add another rate; else None."""
    form, movements = searched.evidence.forms[law.id], searched.evidence.twin.movements
    responses, projection = searched.round_of(law).screening.all_responses, searched.projection_without(law)
    found = max(by_axis(form, responses, projection), key=lambda each: each.more, default=None)
    if found is None or found.more < STAND_IN:
        return None
    theta = linear_coefficients(responses.columns(form), projection)
    rates = added(as_effect(form), theta, movements), found.added(movements)
    one, other = (beside_calibration(rate, movements) for rate in rates)
    return None if correlation(one, other) > EQUAL else found


# Which forms and names could stand in the law's place, by how much they are worse, and whether they add another rate.

#: -2 log evidence within which a rival is worth refitting exactly, beyond what is said: linear columns may misjudge it by as much
MARGIN = 6.0
#: refitted exactly, at most; more that come near are rivals of unknown rate
MOST_EXACT = 12


@dataclass(frozen=True, eq=False)
class Rival:
    """effect in the law's place; hypothesis with it, None where only its linear columns were weighed; worse: -2 log evidence; fits_worse:
    the same, had neither paid for its description; correlation of the whole rate that is added with the law's hypothesis', 0 where it is
    unknown."""

    effect: Effect
    hypothesis: Hypothesis | None
    worse: float
    fits_worse: float
    correlation: float

    @property
    def nearest(self) -> float:
        """How much worse it is by whichever is less: bits may decide what to search, and no more."""
        return min(self.worse, self.fits_worse)


def rivals(evidence: FormEvidence, best: Hypothesis, law: Effect, others: list[Effect]) -> list[Rival]:
    """Of the others, those that were weighed in the place of ``law`` and come nearest, the best first."""
    rest = [other for other in others if other.id != law.id and other.id not in best.ids]
    fits = evidence.unpriced(best)
    guessed = [evidence.guess(best, without=law, add=other) for other in rest]
    nearest = [min(guess.score - best.score, evidence.unpriced(guess) - fits) for guess in guessed]
    own, found = whole_added(evidence.twin, best), list[Rival]()
    for place, number in enumerate(np.argsort(nearest, kind="stable")):
        other, weighed, hypothesis, correlated = rest[number], guessed[number], None, 0.0
        if place < MOST_EXACT and nearest[number] < STAND_IN + MARGIN:
            effects = (*(effect for effect in best.effects if effect is not law), other)
            weighed = evidence.of(effects, best)
            if not believable(weighed, best):
                continue
            if other.id in evidence.forms:  # the law's own constants are as good as can be: so must be a rival's
                lacking = min(weighed.score - best.score, evidence.unpriced(weighed) - fits) - STAND_IN
                weighed, other = one_step(evidence, weighed, other, lacking)
            hypothesis = weighed
            correlated = correlation(own, whole_added(evidence.twin, hypothesis))
        found.append(Rival(other, hypothesis, weighed.score - best.score, evidence.unpriced(weighed) - fits, correlated))
    return sorted(found, key=lambda rival: rival.worse)


def whole_added(twin: Twin, hypothesis: Hypothesis) -> np.ndarray:
    """(N, 3) rad/s that all effects of a hypothesis add to the rate, beside what a calibration takes up."""
    movements = twin.movements
    total = np.zeros((sum(len(movement.t_s) for movement in movements), 3))
    for claim in hypothesis.fit.state.claims:
        if claim.effect.kind == "rate":
            total += added(claim.effect, claim.theta, movements)
    return beside_calibration(total, movements)


# Why a law is not said.

#: searches of which chance makes one as good, at most: benchmarks/discover.py states no law where none is hidden with it
CHANCE = 0.01
#: of chance, that what was put away improves as much: one-sided, as ``explain``'s own veto
HELD_OUT_P = 0.05
#: of the excess over the noise, that laws must take away to be said where what they leave is more than noise: stand-ins take about half
MOST_OF_IT = 0.9
#: and to be found.  A law whose rate correlates EQUAL with the truth's leaves 1 - EQUAL^2 of its square; a dozen turns
#: know that share to half
ALL_OF_IT = 1 - (1 - EQUAL**2) / 2


def refused(searched: SearchState, law: Effect) -> str | None:
    """Why a law of the best hypothesis is not said, or None."""
    best, evidence = searched.best, searched.evidence
    chance_p, said = searched.chance_p(law), equation(evidence.forms[law.id])
    if chance_p > CHANCE:
        return f"the best form does no more than chance does in {100 * chance_p:.2g} % of such searches: {said}"
    if searched.catalogue.score < best.score + STAND_IN:
        names = ", ".join(sorted(searched.catalogue.ids))
        return f"on the turns that were searched {names} is of equal worth" if names else "noise alone explains the turns searched as well"
    if searched.without(law).score < best.score + STAND_IN:
        return f"the rest explains the turns that were searched as well without it: {said}"
    name = next(iter(rivals(evidence, best, law, searched.names)), None)
    if name is not None and name.worse < STAND_IN:
        return f"on the turns that were searched {name.effect.id} is of equal worth beside the rest: {said}"
    if evidence.unpriced(searched.shapes) < evidence.unpriced(best) - STAND_IN:
        return f"a shape without a law does better: {', '.join(sorted(searched.shapes.ids))}"
    for test in searched.held_out_of(law):
        if test.removed is not None and test.removed <= 0:
            return f"the best form worsens the closure of the held-out segments: {said}"
        if test.p_value > HELD_OUT_P:
            return f"chance improves the held-out segments as much as the best form does, with p = {test.p_value:.2g}: {said}"
    return None


def leaves_something(searched: SearchState) -> bool:
    """Whether a further law is asked for; what was put away has no part in it, as it is to judge that law, too."""
    return searched.best.noise.unusual or not searched.closes_to_noise


def taken(searched: SearchState) -> float:
    """The least share of the excess that a law takes away of what was put away; one where what is left is the sensor's own noise."""
    tests = (test for law in searched.laws for test in searched.held_out_of(law))
    return min((test.removed for test in tests if test.removed is not None and test.noise_p < NOISE_P), default=1.0)
