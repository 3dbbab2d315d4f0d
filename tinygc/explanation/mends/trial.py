"""Every proposed event on trial: is it borne out by the closure of the very segment in which it lives?

A false reading was not turned, a real knock was; a loss hides a turn, a jerk does not.  The gravity at a segment's end says which, by the
physics that the segments without any event ask for, with the noise as it is.  Where many events of one kind are borne out, one that
closure cannot decide is likelier to be one of them: the share of true events is estimated with them (a mixture's EM).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from session.detect import interpolation
from tinygc import closure
from tinygc.explanation.mends.events import FALSE, LOST, Crossing, Event, crossing
from tinygc.explanation.mends.together import Choice, chance_of_each, choices
from tinygc.explanation.naming.evidence import PRIOR_ODDS, SCALES, Hypothesis
from tinygc.explanation.noise.session_noise import first_noise
from tinygc.explanation.noise.undersampling import undersampling
from tinygc.explanation.twin.refit import design
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.problem.problem import Problem

LONGEST_LOSS_S = 0.5  #: (not critical: benchmarks/thresholds.py)
#: log of the likelihood ratio of a row that no sensor gives: it needs no closure
CERTAIN = 20.0
#: samples around a false reading over which an effect with a memory spreads it: a cubic spline forgets one by a factor of 3.7 with each
SMEARED = 10
#: passes over the events: their share settles in a few
PASSES = 6


@dataclass(frozen=True, eq=False)
class Verdict:
    """Of one id: events with the probability (E,) that each is what it looks like; probability that there are any; length of a loss, or
    0; before and tried, rms rad of tilt of the segments in which they live, as they are and
    with all of them mended; log_ratio: logarithm of the likelihood ratio of all."""

    id: str
    events: list[Event]
    chance: np.ndarray
    probability: float
    length: int
    before_rad: float
    tried_rad: float
    log_ratio: float

    @property
    def accepted(self) -> list[Event]:
        """The events that are likelier than not, if there are any of this kind at all."""
        return [event for event, chance in zip(self.events, self.chance, strict=True) if chance > 0.5] if self.probability > 0.5 else []


class Trial:
    """Segments as they close with any of the events mended.

    problem: as it was recorded; hypothesis: the physics, of a twin that has seen no event; quiet: the same problem with all false readings
    bridged, whose turns say what their undersampling is.
    """

    def __init__(self, problem: Problem, hypothesis: Hypothesis, quiet: Problem):
        self.twin = twin = Twin(problem)
        self.state = hypothesis.fit.state
        self.rates = twin.rates(self.state)
        # Bridged as readings: what undoes a delay smears a false reading over its neighbours.
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

    def segment_of(self, event: Event) -> int | None:
        """Number among the used segments of the one that an event is in; None in a rest or a rejected turn."""
        for i, segment in enumerate(self.twin.problem.used):
            if segment.log == event.log and segment.start + interpolation.SIDE <= event.row < segment.stop - interpolation.SIDE:
                return i
        return None

    def angles(self, i: int, mended: list[Event], cross: Callable[[Event], Crossing], length: int) -> np.ndarray:
        """(d,) rad that segment i misses with these of its events mended."""
        segment, batch, seen = self.twin.problem.used[i], self._batch, self.twin.segments[i]
        count = segment.stop - segment.start
        rate, dt, earth = self.rates[seen.log][seen.start : seen.stop].copy(), batch.dt[i, : count - 1], batch.earth[i, :count]
        for event in (e for e in mended if e.id == FALSE):
            first, last = event.row - self._smeared, event.row + event.samples + self._smeared
            here = slice(max(first, segment.start), min(last, segment.stop))
            rate[here.start - segment.start : here.stop - segment.start] = self._bridged[segment.log][self._calm.rows(segment.log, here)]
        for event in sorted((e for e in mended if e.id == LOST), key=lambda e: -e.row):
            at = event.row - segment.start + 1
            between = interpolation.across(rate, at - 1, at, length, cross(event).order)
            rate, earth = np.insert(rate, at, between, axis=0), np.insert(earth, at, np.repeat(earth[at : at + 1], length, axis=0), axis=0)
            dt = np.insert(dt, at, np.full(length, np.median(dt)))
        one = replace(batch.pick(slice(i, i + 1)), rate=rate[None], dt=dt[None], earth=earth[None])
        return closure.error_angles(closure.segment_residuals(one, one.rate))[0]

    def _choices(
        self, i: int, own: list[Event], others: list[Event], cross: Callable[[Event], Crossing], length: int
    ) -> dict[Choice, float]:
        """Log-likelihood of each choice of segment i's own events, with ``others`` mended in any case."""

        def value(choice: Choice) -> tuple[float, float]:
            mended = [*others, *(own[k] for k in choice)]
            angles = self.angles(i, mended, cross, length)
            C = self.covariance[i] + sum(cross(event).missed_rad ** 2 for event in mended) * np.eye(len(angles))
            likelihood = -(angles @ np.linalg.solve(C, angles)) / 2 - np.linalg.slogdet(C)[1] / 2
            likelihood += CERTAIN * sum(own[k].accel for k in choice)
            return float(likelihood), float(angles @ np.linalg.solve(self.covariance[i], angles))

        return choices(len(own), value)

    def lost_each_time(self, losses: list[Event]) -> int:
        """Samples that are missing after each of the events, the same count for all: the one that closes most of them best; 0 for none.

        For this search a loss is one long step, and each segment has one at the most, at any of its events, or has none: one without a
        loss must not decide for the others.
        """
        inside: dict[int, list[int]] = {}
        for event in losses:
            if (i := self.segment_of(event)) is not None:
                inside.setdefault(i, []).append(event.row - self.twin.problem.used[i].start)
        if not inside:
            return 0
        numbers = np.array(sorted(inside))
        part = replace(self._batch.pick(numbers), rate=self.twin.padded(self.rates)[numbers])
        inverse = np.linalg.inv(self.covariance[numbers])
        rows = [inside[int(i)] for i in numbers]

        def chi_square(count: int, turn: int) -> np.ndarray:
            dt = part.dt.copy()
            for row, events in zip(dt, rows, strict=True):
                row[events[turn % len(events)]] += count * self._period_s
            angles = closure.error_angles(closure.segment_residuals(replace(part, dt=dt), part.rate))
            return np.einsum("si,sij,sj->s", angles, inverse, angles)

        as_it_is = chi_square(0, 0)

        def cost(count: int) -> float:
            tried = [as_it_is, *(chi_square(count, turn) for turn in range(max(map(len, rows))))]
            return float(-2 * np.sum(np.logaddexp.reduce([-chi / 2 for chi in tried], axis=0)))

        return lowest(cost, round(LONGEST_LOSS_S / self._period_s))

    def _tilt_rms(self, mended: dict[int, list[Event]], cross: Callable[[Event], Crossing], length: int) -> float:
        """rad, of segments with these of their events mended."""
        squares = [np.sum(self.angles(i, events, cross, length)[:2] ** 2) for i, events in mended.items()]
        return float(np.sqrt(np.mean(squares))) if squares else 0.0

    def judge(self, name: str, events: list[Event], others: list[Event]) -> Verdict:
        """Events of one id, with ``others``, of another id, mended already."""
        length = self.lost_each_time(events) if name == LOST else 0
        where = [self.segment_of(event) for event in events]
        crossings = {event: crossing(self.twin.problem.logs[event.log].samples, event, length) for event in [*events, *others]}
        cross = crossings.__getitem__
        inside = {i: [k for k, at in enumerate(where) if at == i] for i in sorted({i for i in where if i is not None})}
        likely, can_be = {}, name == FALSE or length > 0
        if can_be:
            for i, own in inside.items():
                beside = [e for e in others if self.segment_of(e) == i]
                likely[i] = self._choices(i, [events[k] for k in own], beside, cross, length)
        share, chance = 0.5, np.zeros(len(events))
        for _ in range(PASSES if can_be else 0):
            # Where no closure decides it is what the others are, but for a row that no sensor gives.
            before, chance = chance, np.array([1.0 if event.accel else share for event in events])
            for i, own in inside.items():
                chance[own] = chance_of_each(len(own), likely[i], share)
            share = float((chance.sum() + 0.5) / (len(chance) + 1))
            if ((before > 0.5) == (chance > 0.5)).all():
                break
        accepted = [event for event, p in zip(events, chance, strict=True) if p > 0.5]
        best = {i: frozenset(n for n, k in enumerate(own) if chance[k] > 0.5) for i, own in inside.items()}
        nothing: Choice = frozenset()
        closed = sum(likely[i].get(best[i], likely[i][nothing]) - likely[i][nothing] for i in likely)
        tries = round(LONGEST_LOSS_S / self._period_s) if name == LOST else 1  # of lengths, one was the best
        in_rests = CERTAIN * sum(e.accel for e, at in zip(events, where, strict=True) if at is None and e in accepted)
        log_ratio = float(closed) + in_rests - np.log(tries)
        touched = list(inside)
        none: dict[int, list[Event]] = {i: [] for i in touched}
        all_here = {i: [e for e in events if self.segment_of(e) == i] for i in touched}
        rms = [self._tilt_rms(mended, cross, length) for mended in (none, all_here)]
        probability = 1 / (1 + np.exp(-np.clip(log_ratio - np.log(SCALES / PRIOR_ODDS), -700, 700))) if accepted else 0.0
        if not accepted:
            chance = np.zeros(len(events))
        return Verdict(name, events, chance, float(probability), length, rms[0], rms[1], log_ratio)


def lowest(cost: Callable[[int], float], most: int) -> int:
    """The count of 0 … most with the lowest cost, a valley: coarse steps first, then all between."""
    step = max(1, most // 16)
    costs = {count: cost(count) for count in range(0, most + 1, step)}
    best = min(costs, key=costs.__getitem__)
    costs |= {count: cost(count) for count in range(max(best - step + 1, 0), min(best + step, most + 1)) if count not in costs}
    return min(costs, key=costs.__getitem__)
