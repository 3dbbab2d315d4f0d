"""What the search sees, and what it never sees: a third of the turns and stills, and of several recordings one whole.

Turns are left out in runs: the stills between two of them then belong to them alone, and nothing of them is left in what is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.detect.segments import Segment
from session.detect.stills import Still
from tinygc.closure.floor import Floor
from tinygc.problem.problem import Problem
from tinygc.problem.rejections import LEFT_OUT

#: turns that are left out together, of three times as many: so few that each part of a session has some, so many that most of their stills
#: are their own
RUN = 4
#: of three
SEEN = 2
#: turns by which a law can be judged: all of four improve in one of sixteen cases by chance; a session needs three times so many
FEWEST = 5


@dataclass(frozen=True, eq=False)
class Parts:
    """seen: the problem that is searched; parts, recording: used segments (indices) of the whole problem that are left out, in runs and
    with one whole log, whose number is ``log``; None where there is one log."""

    seen: Problem
    parts: np.ndarray
    recording: np.ndarray
    log: int | None


def parted(problem: Problem, seed: int) -> Parts:
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
    return Parts(without(problem, held | recording), np.flatnonzero(held), np.flatnonzero(recording), whole)


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
