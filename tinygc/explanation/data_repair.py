"""Data repair: detectors propose events, and the closure of the segments concerned decides which are repaired."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy.special import chdtrc, chdtri

from session.base.errors import CalibrationError
from session.base.progress import Reporter, no_report
from session.base.units import DEG, NS_PER_S
from session.detect import bridging
from session.detect.segments import Segment
from session.detect.stills import BY_HAND, SessionStills
from session.log.folder import Session
from tinygc.closure import residual
from tinygc.closure.build import build_problem
from tinygc.closure.problem import CLIPPED, LEFT_OUT, Problem
from tinygc.effects import Effect, catalogue
from tinygc.explanation.claims import CERTAIN, Claim, Considered
from tinygc.explanation.clipped_turns import FEWEST_WHOLE, Clipping, about_the_vertical, chance_of_creep, closure_over_floor, find_clipping
from tinygc.explanation.evidence import Evidence, Hypothesis
from tinygc.explanation.faulty_readings import FALSE, LOST, Crossing, RegisterFault, crossings, proposed, without_false_readings
from tinygc.explanation.search import search
from tinygc.inference.choose import PRIOR_ODDS, SCALES, level_of_each, weights_of
from tinygc.noise.components import first_noise, undersampling
from tinygc.noise.refit import candidates, design
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener

# Events of one turn are tested jointly: if two are false, repairing either one alone does not close the turn.

#: events in one turn of which every combination is tried, sixty-four in all; with more, only those that a search visits
_EVERY_CHOICE = 6

#: the events of a turn that are repaired
Choice = frozenset[int]


def choices(count: int, value: Callable[[Choice], tuple[float, float]]) -> dict[Choice, float]:
    """Log-likelihood of every admissible choice among ``count`` events.

    value(choice) -> its log-likelihood, and the misfit of the turn's closure.  A choice is inadmissible if a part of it fits as well: the
    allowance for the bridged gaps raises the likelihood without reducing the misfit.
    """
    seen: dict[Choice, tuple[float, float]] = {}

    def known(choice: Choice) -> tuple[float, float]:
        if choice not in seen:
            seen[choice] = value(choice)
        return seen[choice]

    if count <= _EVERY_CHOICE:
        tried = [frozenset(some) for size in range(count + 1) for some in combinations(range(count), size)]
    else:
        nothing: Choice = frozenset()
        tried = [*_climb(nothing, count, known), *_climb(frozenset(range(count)), count, known)]
    worth = [choice for choice in tried if all(known(choice)[1] < known(choice - {one})[1] for one in choice)]
    return {choice: known(choice)[0] for choice in worth}


def _climb(begin: Choice, count: int, known: Callable[[Choice], tuple[float, float]]) -> list[Choice]:
    """Hill climbing by the best change of one or two events, until none is better; returns every choice visited."""
    changes = [frozenset(some) for size in (1, 2) for some in combinations(range(count), size)]
    passed = [begin]
    while True:
        best = max((passed[-1] ^ change for change in changes), key=lambda choice: known(choice)[0])
        if known(best)[0] <= known(passed[-1])[0]:
            return passed
        passed.append(best)


def _chance_of_each(count: int, likelihood: dict[Choice, float], share: float) -> np.ndarray:
    """(count,) posterior probability of each event, given the prior share of true events."""
    scores = [-2 * (L + len(c) * np.log(share) + (count - len(c)) * np.log1p(-share)) for c, L in likelihood.items()]
    return np.asarray(weights_of(scores) @ np.array([[one in choice for one in range(count)] for choice in likelihood], dtype=float))


# Each proposed event is tested by the closure of the segment in which it lies.
#
# A false reading was not a rotation, a real knock was; a loss hides rotation, a jerk does not.  The gravity at the segment's ends decides,
# with the effects fitted to the segments without any event and the estimated noise.  If many events of one kind are accepted, one that
# closure cannot decide is more likely to be true: the share of true events is estimated with them (EM of a mixture).

LONGEST_LOSS_S = 0.5  #: (not critical: benchmarks/thresholds.py)
#: log-likelihood ratio of a row that no sensor can output, which needs no closure
IMPOSSIBLE = 20.0
#: samples around a false reading over which an effect with memory spreads it: a cubic spline decays by a factor of 3.7 per sample
SMEARED = 10
#: passes over the events: their share converges in a few
PASSES = 6
#: log-likelihood ratio, with one covariance, from which on a repair moves the closure: 20 to 1, "strong" (Kass & Raftery 1995)
MOVED = float(np.log(20))
#: probability that any of the turns in which every event is repaired closes worse than is taken for closed
OPEN_P = 0.01
#: turns without an event from which on their median is how a turn without one closes
FEWEST_WITHOUT = 5


@dataclass(frozen=True, eq=False)
class Verdict:
    """The test result for one id: events with the probability (E,) that each is real; probability that there are any; length of a loss, or
    0; before_rad and tried_rad, rms rad of tilt of the segments concerned, as recorded and with all events repaired; log_ratio:
    log-likelihood ratio of all."""

    id: str
    events: list[RegisterFault]
    chance: np.ndarray
    probability: float
    length: int
    before_rad: float
    tried_rad: float
    log_ratio: float

    @property
    def accepted(self) -> list[RegisterFault]:
        """The events with a probability above one half, if this kind of event is present at all."""
        return [event for event, chance in zip(self.events, self.chance, strict=True) if chance > 0.5] if self.probability > 0.5 else []


class ClosureTrial:
    """Closure of segments with any of the events repaired.

    problem: as recorded; hypothesis: the effects, fitted without the events; quiet: the same problem with all false readings bridged, whose
    turns give the undersampling.
    """

    def __init__(self, problem: Problem, hypothesis: Hypothesis, quiet: Problem):
        self.twin = twin = Twin(problem)
        self.state = hypothesis.fit.state
        self.rates = twin.rates(self.state)
        # Bridge the raw readings: undoing a delay spreads a false reading over its neighbours.
        calm = Twin(quiet)
        self._calm, self._bridged = calm, calm.rates(self.state)
        self._smeared = SMEARED if any(claim.effect.reach for claim in self.state.claims) else 0
        whiten = Whitener(twin)
        noise = first_noise(twin, whiten, undersampling(calm) if len(quiet.used) == len(problem.used) else None)
        noise = replace(noise, s=np.array([hypothesis.noise.size(c.name) for c in noise.components]))
        whiten = whiten.with_more(noise.covariance)
        columns = whiten.back(design(twin, whiten, self.state, self.rates)[0])[whiten.parts["closure"]]
        known = columns @ hypothesis.fit.covariance @ columns.T
        d, count = twin.batch.angles, len(twin.segments)
        full = (whiten.covariance[whiten.parts["closure"], whiten.parts["closure"]] + known).reshape(count, d, count, d)
        self.covariance = full[np.arange(count), :, np.arange(count)]
        self._batch = twin.batch_at(self.state)
        self._period_s = float(np.median([movement.dt_s for movement in twin.movements]))

    def segment_of(self, event: RegisterFault) -> int | None:
        """Index of an event's segment among the used ones; None in a rest or a rejected turn."""
        for i, segment in enumerate(self.twin.problem.used):
            if segment.log == event.log and segment.start + bridging.SIDE <= event.row < segment.stop - bridging.SIDE:
                return i
        return None

    def angles(self, i: int, repaired: list[RegisterFault], cross: Callable[[RegisterFault], Crossing], length: int) -> np.ndarray:
        """(d,) rad closure of segment i with these of its events repaired."""
        segment, batch, seen = self.twin.problem.used[i], self._batch, self.twin.segments[i]
        count = segment.stop - segment.start
        rate, dt, earth = self.rates[seen.log][seen.start : seen.stop].copy(), batch.dt[i, : count - 1], batch.earth[i, :count]
        for event in (e for e in repaired if e.id == FALSE):
            first, last = event.row - self._smeared, event.row + event.samples + self._smeared
            here = slice(max(first, segment.start), min(last, segment.stop))
            rate[here.start - segment.start : here.stop - segment.start] = self._bridged[segment.log][self._calm.rows(segment.log, here)]
        for event in sorted((e for e in repaired if e.id == LOST), key=lambda e: -e.row):
            at = event.row - segment.start + 1
            between = bridging.across(rate, at - 1, at, length, cross(event).order)
            rate, earth = np.insert(rate, at, between, axis=0), np.insert(earth, at, np.repeat(earth[at : at + 1], length, axis=0), axis=0)
            dt = np.insert(dt, at, np.full(length, np.median(dt)))
        one = replace(batch.pick(slice(i, i + 1)), rate=rate[None], dt=dt[None], earth=earth[None])
        return residual.error_angles(residual.segment_residuals(one, one.rate))[0]

    def likelihood(self, i: int, angles: np.ndarray, variance: float = 0.0) -> tuple[float, float]:
        """Log-likelihood of error angles (d,) of segment i, and their chi-square; variance: of what its bridges may have missed, rad^2."""
        C = self.covariance[i] + variance * np.eye(len(angles))
        chi_square = float(angles @ np.linalg.solve(C, angles))
        return float(-chi_square - np.linalg.slogdet(C)[1]) / 2, chi_square

    def likelihoods(
        self,
        i: int,
        own: list[RegisterFault],
        others: list[RegisterFault],
        cross: Callable[[RegisterFault], Crossing],
        length: int,
        most: float = np.inf,
    ) -> dict[Choice, float]:
        """Log-likelihood of each choice of segment i's own events, with ``others`` always repaired; most: chi-square of a closed turn.

        A choice whose repair hardly moves the closure gains no more than that: a bridge is uncertain, and that alone would excuse a turn
        that is open for another reason.  This bounds a choice as a whole.  Nor is it one where the turn stays open, unless no
        sensor outputs such rows.
        """
        open_still: set[Choice] = set()
        as_recorded = self.angles(i, others, cross, length)
        bridged = sum(cross(event).missed_rad ** 2 for event in others)

        unrepaired, _ = self.likelihood(i, as_recorded, bridged)

        def value(choice: Choice) -> tuple[float, float]:
            chosen = [own[k] for k in choice]
            angles = self.angles(i, [*others, *chosen], cross, length)
            variance = bridged + sum(cross(event).missed_rad ** 2 for event in chosen)
            repaired, chi_square = self.likelihood(i, angles, variance)
            gain, moved = repaired - unrepaired, repaired - self.likelihood(i, as_recorded, variance)[0]
            gain = gain if moved > MOVED else min(gain, moved)
            if chi_square > most and not all(e.accel for e in chosen):
                open_still.add(choice)
            return unrepaired + gain + IMPOSSIBLE * sum(e.accel for e in chosen), self.likelihood(i, angles)[1]

        return {choice: each for choice, each in choices(len(own), value).items() if choice not in open_still}

    def closed_below(self, events: list[RegisterFault], cross: Callable[[RegisterFault], Crossing]) -> float:
        """Chi-square above which the closure of a turn is open: that of noise, times the median excess of the turns without an event,
        whose effects may be unknown.  Where these miss by much, no turn is open."""
        freedom = self.twin.batch.angles
        touched = {self.segment_of(event) for event in events}
        whole = [i for i in range(len(self.covariance)) if i not in touched]
        excess = 1.0
        if len(whole) >= FEWEST_WITHOUT:
            chi_square = [self.likelihood(i, self.angles(i, [], cross, 0))[1] for i in whole]
            excess = max(1.0, float(np.median(chi_square)) / float(chdtri(freedom, 0.5)))
        return excess * float(chdtri(freedom, level_of_each(OPEN_P, len(touched - {None}))))

    def lost_each_time(self, losses: list[RegisterFault]) -> int:
        """Number of samples missing after each event, common to all: the one whose bridges close most segments best; 0 for none.

        Each segment has at most one loss, at any of its events, or none, so that one without does not decide for the others.
        """
        inside = [(event, i) for event in losses if (i := self.segment_of(event)) is not None]
        logs = [log.samples for log in self.twin.problem.logs]

        def cost(count: int) -> float:
            total, cross = dict(whole), crossings(logs, losses, count).__getitem__
            for event, i in inside:
                # What a bridge may have missed is no reason for a longer one.
                angles = self.angles(i, [event], cross, count)
                total[i] = float(np.logaddexp(total[i], self.likelihood(i, angles)[0]))
            return -sum(total.values())

        whole = {i: self.likelihood(i, self.angles(i, [], lambda event: Crossing(1, 0.0), 0))[0] for _, i in inside}

        return lowest(cost, round(LONGEST_LOSS_S / self._period_s)) if inside else 0

    def tilt_rms(self, repaired: dict[int, list[RegisterFault]], cross: Callable[[RegisterFault], Crossing], length: int) -> float:
        """rms tilt, rad, of segments with these of their events repaired."""
        squares = [np.sum(self.angles(i, events, cross, length)[:2] ** 2) for i, events in repaired.items()]
        return float(np.sqrt(np.mean(squares))) if squares else 0.0

    def test(self, name: str, events: list[RegisterFault], others: list[RegisterFault]) -> Verdict:
        """Test the events of one id, with ``others``, of another id, already repaired."""
        length = self.lost_each_time(events) if name == LOST else 0
        where = [self.segment_of(event) for event in events]
        cross = crossings([log.samples for log in self.twin.problem.logs], [*events, *others], length).__getitem__
        inside = {i: [k for k, at in enumerate(where) if at == i] for i in sorted({i for i in where if i is not None})}
        likely, can_be = {}, name == FALSE or length > 0
        if can_be:
            most = self.closed_below([*events, *others], cross)
            for i, own in inside.items():
                further = [e for e in others if self.segment_of(e) == i]
                likely[i] = self.likelihoods(i, [events[k] for k in own], further, cross, length, most)
        share, chance = 0.5, np.zeros(len(events))
        for _ in range(PASSES if can_be else 0):
            # An event that closure cannot decide gets the share of the others, except a row that no sensor can output.
            before, chance = chance, np.array([1.0 if event.accel else share for event in events])
            for i, own in inside.items():
                chance[own] = _chance_of_each(len(own), likely[i], share)
            share = float((chance.sum() + 0.5) / (len(chance) + 1))
            if ((before > 0.5) == (chance > 0.5)).all():
                break
        accepted = [event for event, p in zip(events, chance, strict=True) if p > 0.5]
        best = {i: frozenset(n for n, k in enumerate(own) if chance[k] > 0.5) for i, own in inside.items()}
        nothing: Choice = frozenset()
        closed = sum(likely[i].get(best[i], likely[i][nothing]) - likely[i][nothing] for i in likely)
        tries = round(LONGEST_LOSS_S / self._period_s) if name == LOST else 1  # lengths tried, of which the best was taken
        in_rests = IMPOSSIBLE * sum(e.accel for e, at in zip(events, where, strict=True) if at is None and e in accepted)
        log_ratio = float(closed) + in_rests - np.log(tries)
        touched = list(inside)
        none: dict[int, list[RegisterFault]] = {i: [] for i in touched}
        all_here = {i: [e for e in events if self.segment_of(e) == i] for i in touched}
        rms = [self.tilt_rms(repaired, cross, length) for repaired in (none, all_here)]
        probability = 1 / (1 + np.exp(-np.clip(log_ratio - np.log(SCALES / PRIOR_ODDS), -700, 700))) if accepted else 0.0
        if not accepted:
            chance = np.zeros(len(events))
        return Verdict(name, events, chance, float(probability), length, rms[0], rms[1], log_ratio)


def lowest(cost: Callable[[int], float], most: int) -> int:
    """Minimize a unimodal cost over the counts 0 … most: coarse steps first, then every count between."""
    step = max(1, most // 16)
    costs = {count: cost(count) for count in range(0, most + 1, step)}
    best = min(costs, key=costs.__getitem__)
    costs |= {count: cost(count) for count in range(max(best - step + 1, 0), min(best + step, most + 1)) if count not in costs}
    return min(costs, key=costs.__getitem__)


# Number of samples lost each time, when nearly every turn has a loss: each count is fitted with its own linear model.


def _common_count(problem: Problem, losses: list[RegisterFault]) -> int:
    """Number of samples missing after each event, common to all, by the closure of all segments.

    For this search a loss is one long step.
    """
    steps = [
        [e.row - segment.start for e in losses if e.log == segment.log and segment.start <= e.row < segment.stop - 1]
        for segment in problem.used
    ]
    period_s = float(np.median([log.samples.period_s for log in problem.session.logs]))

    def cost(count: int) -> float:
        dt = problem.batch.dt.copy()
        for row, inside in zip(dt, steps, strict=True):
            row[inside] += count * period_s
        with suppress(CalibrationError):  # an absurd count has no model
            return float(np.sum(closure_over_floor(problem, np.arange(len(dt)), replace(problem.batch, dt=dt)) ** 2))
        return np.inf

    return lowest(cost, round(LONGEST_LOSS_S / period_s)) if any(steps) else 0


# Turns with an event that close much worse than most are left out of the fit with which events are tested.
#
# Least trimmed squares (Rousseeuw 1984): fit the segments that close best, found by concentration steps (Rousseeuw and Van Driessen 1999):
# fit, keep the segments that close best with this fit, and repeat.

#: times the typical closure; with noise alone, and a fit to the few best segments, one turn in fifty exceeds 3.5 and none this
OPEN = 5.0
#: share of the segments kept at first, and the ratio of the typical closure among these to that of all, for normal errors
KEPT, SIZE_OF_KEPT = 0.6, 0.71
#: concentration steps, which converge in a few
ROUNDS = 12


def left_open(problem: Problem, touched: np.ndarray) -> np.ndarray:
    """(S,) bool of the touched (S,) segments that close far worse than most."""
    count = min(max(round(KEPT * len(touched)), FEWEST_WHOLE), len(touched))
    starts = [np.arange(len(touched)), np.flatnonzero(~touched)]
    sizes = [_concentrated(problem, start, count) for start in starts if len(start) >= count or start is starts[0]]
    size = min(sizes, key=lambda each: np.sum(np.sort(each)[:count] ** 2))
    found = touched & (size > OPEN * np.median(np.sort(size)[:count]) / SIZE_OF_KEPT)
    size = closure_over_floor(problem, np.flatnonzero(~found))  # refit with more: the few kept segments are easily overfitted
    return found & (size > OPEN * np.median(size[~found]))


def _concentrated(problem: Problem, kept: np.ndarray, count: int) -> np.ndarray:
    """(S,) ``closure_over_floor`` by the fit of the ``count`` segments that close best, starting from ``kept``."""
    size = np.zeros(len(problem.batch))
    for _ in range(ROUNDS):
        size = closure_over_floor(problem, kept)
        best = np.sort(np.argsort(size)[:count])
        if np.array_equal(best, kept):
            break
        kept = best
    return size


# Detectors propose repairs of registers and stills; the closure of the segments concerned decides.

#: ids of what a detector's threshold finds in registers and stills
CLIPPED_RATE, CREEPING = "gyro.saturation", "reference.not_still"


@dataclass(frozen=True, eq=False)
class RepairedProblem:
    """The result of data repair.

    problem: the repaired problem, to be explained. found: effect id -> its claim. reference: effects found in the segments without any
    event. considered: moments that were proposed and rejected. recorded: the problem with the reference as recorded, where ``fit`` has
    repaired it already.
    """

    problem: Problem
    found: dict[str, Claim]
    reference: tuple[Effect, ...] = ()
    considered: list[Considered] = field(default_factory=list)
    recorded: Problem | None = None


def repair(problem: Problem, progress: Reporter = no_report) -> RepairedProblem:
    """Repair clipping, then false readings and losses, then creeping stills: each is proposed, tested, and repaired if closure accepts
    it.  A further reference finds its own errors."""
    if problem.session.reference is not None:
        repaired: RepairedProblem = problem.session.reference.repaired(problem)
        return repaired
    found: dict[str, Claim] = {}
    progress("registers")
    clipping = find_clipping(problem)
    if clipping is not None and clipping.confirmed:
        level = {"dps": clipping.level / DEG}, {"dps": clipping.known_to / DEG}
        found[CLIPPED_RATE] = _claim(CLIPPED_RATE, clipping.level, *level, clipping.chance, is_bound=True)
        with suppress(CalibrationError):  # too few segments are left: the clipped ones stay, marked as clipped
            problem = rebuilt(problem, problem.session, clipped=tuple(clipping.numbers))
    verdicts, reference = tried_events(problem, clipping, progress)
    problem = _with_accepted(problem, verdicts, found)
    progress("stills")
    problem = without_creeping(problem, found)
    left = [(v, len(v.events) - len(v.accepted)) for v in verdicts]
    considered = [Considered(v.id, 0.0 if v.accepted else v.probability, count, (v.before_rad, v.tried_rad)) for v, count in left if count]
    if clipping is not None and not clipping.confirmed and np.isfinite(clipping.excess):
        considered.append(Considered(CLIPPED_RATE, 0.0, len(clipping.numbers)))
    return RepairedProblem(problem, found, reference, considered)


def _claim(name: str, theta: float, parameters: dict, std: dict, p_value: float, chance: float = CERTAIN, is_bound: bool = False) -> Claim:
    effect = catalogue()[name]
    return Claim(effect, parameters, std, p_value, effect.describe(np.array([theta])), p_is_bound=is_bound, probability=chance)


def tried_events(problem: Problem, clipping: Clipping | None, progress: Reporter) -> tuple[list[Verdict], tuple[Effect, ...]]:
    """Verdicts on false readings and losses, in this order, and the effects used in the tests.  Events in clipped turns are not tested."""
    clipped = [] if clipping is None else [s for s in problem.segments if s.number in clipping.numbers]
    events = [e for e in proposed(problem.session) if not any(s.log == e.log and s.start <= e.row < s.stop for s in clipped)]
    if not events:
        return [], ()
    progress("events on trial")
    false, lost = ([e for e in events if e.id == name] for name in (FALSE, LOST))
    quiet = rebuilt(problem, without_false_readings(problem.session, false)) if false else problem
    reference = reference_effects(problem, quiet, false, lost)
    trial = ClosureTrial(problem, reference, quiet)
    verdicts = [trial.test(FALSE, false, [])] if false else []
    if lost:
        verdicts.append(trial.test(LOST, lost, [e for v in verdicts for e in v.accepted]))
    return verdicts, reference.effects


def reference_effects(problem: Problem, quiet: Problem, false: list[RegisterFault], lost: list[RegisterFault]) -> Hypothesis:
    """The effects with which events are tested, from the segments that close, with or without an event.  If those are few, or their noise
    is unlike a sensor's, all segments are tried as well, as recorded and with everything repaired; the fit with the greatest evidence per
    value is used."""
    inside = {e: [s.number for s in problem.used if s.log == e.log and s.start <= e.row < s.stop] for e in (*false, *lost)}
    touched = {number for numbers in inside.values() for number in numbers}
    in_rests = [e for e in false if not inside[e]]
    tried = []
    with suppress(CalibrationError):  # the remaining segments cannot be fitted
        is_open = left_open(problem, np.array([s.number in touched for s in problem.used]))
        if (~is_open).sum() >= FEWEST_WHOLE:
            open_ones = tuple(s.number for s, each in zip(problem.used, is_open, strict=True) if each)
            tried.append(_searched(rebuilt(problem, without_false_readings(problem.session, in_rests), left_out=open_ones)))
    if not tried or tried[0].noise.unusual:
        session, count = quiet.session, _common_count(quiet, lost) if lost else 0
        if count:
            session = session_with_lost(session, lost, count)
        tried += [_searched(problem), _searched(rebuilt(problem, session))]
    return min(tried, key=lambda h: h.score / max(len(h.fit.r), 1))


def _searched(problem: Problem) -> Hypothesis:
    evidence = Evidence(Twin(problem))
    return search(evidence, candidates(evidence.twin), evidence.nothing)


def _with_accepted(problem: Problem, verdicts: list[Verdict], found: dict[str, Claim]) -> Problem:
    """The problem with the accepted events repaired."""
    false, lost = ([e for v in verdicts if v.id == name for e in v.accepted] for name in (FALSE, LOST))
    if not false and not lost:
        return problem
    by_id: dict[str, tuple[dict, dict]] = {}
    if false:
        at = [sum(len(log.samples) for log in problem.session.logs[: e.log]) + e.row for e in false]  # counted over all logs
        by_id[FALSE] = ({"at": at, "samples": int(np.median([e.samples for e in false]))}, {})  # a count has no std
    session = without_false_readings(problem.session, false)
    if lost:
        (length,) = (v.length for v in verdicts if v.id == LOST)
        began, times = 0.0, []
        for number, log in enumerate(problem.session.logs):
            rows = [e.row for e in lost if e.log == number]
            times += [began + float(log.samples.t_s[row]) + i * length * log.samples.period_s for i, row in enumerate(rows)]
            began += log.samples.duration_s + len(rows) * length * log.samples.period_s  # including inserted samples
        by_id[LOST] = ({"at_s": [round(time, 3) for time in times], "length": length}, {"length": 0.5})  # whole samples: half a sample
        session = session_with_lost(session, lost, length)
    for v in verdicts:
        if v.accepted:
            p_value = min(1.0, len(v.events) * float(chdtrc(len(v.accepted), max(2 * v.log_ratio, 0.0))))
            found[v.id] = _claim(v.id, len(v.accepted), *by_id[v.id], p_value, v.probability)
    return rebuilt(problem, session)


def session_with_lost(session: Session, lost: list[RegisterFault], length: int) -> Session:
    """The session with ``length`` samples, and their time, put in after each of the events."""
    logs = []
    for number, log in enumerate(session.logs):
        rows = np.array([e.row for e in lost if e.log == number], dtype=int)
        if len(rows):
            late_ns = length * round(log.samples.period_s * NS_PER_S) * np.searchsorted(rows, np.arange(len(log.samples)))
            samples, gaps = bridging.filled(replace(log.samples, t_ns=log.samples.t_ns + late_ns), rows, np.full(len(rows), length))
            moved = [replace(each, row=each.row + length * int(np.sum(rows < each.row))) for each in log.bridges]
            log = replace(log, samples=samples, bridges=tuple(sorted((*moved, *gaps), key=lambda bridge: bridge.row)))
        logs.append(log)
    return replace(session, logs=tuple(logs))


def rebuilt(
    problem: Problem, session: Session, *, clipped: tuple[int, ...] = (), moving: tuple[int, ...] = (), left_out: tuple[int, ...] = ()
) -> Problem:
    """Rebuild the problem for a repaired session, or with clipped segments or moving stills, keeping earlier exclusions."""
    out = {why: [segment for segment in problem.segments if segment.problem == why] for why in (LEFT_OUT, CLIPPED)}
    found = SessionStills(session, problem.found)
    if moving:  # rejecting a still joins two turns and shifts the numbers after it
        segments = build_problem(session, use_earth=False, moving=moving, found=found).segments
        out = {why: [new for new in segments if any(is_inside(old, new) for old in gone)] for why, gone in out.items()}
    excluded, at_level = (tuple(segment.number for segment in out[why]) for why in (LEFT_OUT, CLIPPED))
    use_earth = problem.earth.source != "none"
    exclude, clipped = excluded + left_out, clipped + at_level
    built = build_problem(session, use_earth=use_earth, exclude=exclude, clipped=clipped, moving=moving, found=found)
    return built.changed(at_rest=problem.at_rest)


def is_inside(old: Segment, new: Segment) -> bool:
    """Whether the middle of a segment lies in another of the same log."""
    return old.log == new.log and new.start <= (old.start + old.stop) // 2 < new.stop


def without_creeping(problem: Problem, found: dict[str, Claim]) -> Problem:
    """Reject creeping stills: the detector found those in which gravity moves; those that turn about the vertical show in the gyro's
    rate."""
    numbers = [i for i, still in enumerate(problem.stills) if still.problem not in (None, BY_HAND)]
    if not numbers:
        return problem
    turning = about_the_vertical(problem)
    moving = sorted(numbers + turning)
    found[CREEPING] = _claim(CREEPING, len(moving), {"stills": moving}, {}, chance_of_creep(problem), is_bound=True)
    return rebuilt(problem, problem.session, moving=tuple(turning)) if turning else problem
