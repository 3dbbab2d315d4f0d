"""Lookahead of a machine: of the best next turns, the one behind which the session ends soonest (a rollout).

A greedy choice takes the turn of the most gain per time, and leaves to chance how long the rest takes: criteria that differ slightly end
a tenth of the session apart.  Here each of the best next turns is followed to the end of the session by greedy choices, and the soonest
end wins.  The turns kept from the last choice are followed as well, so that a choice is never given up for a later end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.planning.turns import Turn

BRANCHES = 6  #: next turns that are followed: what a table of three axes has time for during a move
MOST_TURNS = 60  #: a session that needs more counts as one that does not end
SAME_RAD = 0.01  #: two moves to angles that differ by less are one


@dataclass(frozen=True, eq=False)
class Place:
    """Where a session stands: information (P, P) in units of the targets; force (3,) m/s^2 and angles (K,) rad, None: the present ones."""

    information: np.ndarray
    force: np.ndarray
    angles: np.ndarray | None

    def after(self, turn: Turn, rows: np.ndarray) -> Place:
        """The place that a turn leads to; rows (2 or 3, P): what it adds."""
        return Place(self.information + rows.T @ rows, turn.carries(self.force), turn.angles)


@dataclass(frozen=True, eq=False)
class Rated:
    """The turns from a place, their rows (M, 2 or 3, P) and ratings (M,): gain per time; reached: whether every target is met there."""

    turns: list[Turn]
    rows: np.ndarray
    rating: np.ndarray
    reached: bool

    def first(self, kept: Sequence[Turn] = ()) -> tuple[Turn, np.ndarray]:
        """Return the first of the kept turns where it is one of these, else the best rated one, and its rows."""
        number = self.number_of(kept[0]) if kept else None
        number = int(np.argmax(self.rating)) if number is None else number
        return self.turns[number], self.rows[number]

    def number_of(self, turn: Turn) -> int | None:
        """Return which of these has the moves of a turn."""
        return next((number for number, each in enumerate(self.turns) if _same(each, turn)), None)


Rate = Callable[[Place], Rated]


def to_the_end(rate: Rate, place: Place, until_s: float = np.inf) -> tuple[list[Turn], float]:
    """The best rated turns one after the other, and their time, s; infinite where it is not below until_s, or does not end."""
    turns, lasts_s = list[Turn](), 0.0
    while lasts_s < until_s:
        rated = rate(place)
        if rated.reached:
            return turns, lasts_s
        if len(turns) == MOST_TURNS:
            break
        turn, rows = rated.first()
        turns.append(turn)
        lasts_s += turn.cost_s
        place = place.after(turn, rows)
    return turns, np.inf


def followed(rate: Rate, place: Place, sequence: list[Turn], until_s: float = np.inf) -> tuple[list[Turn], float]:
    """The turns of a sequence that are needed from a place, then the best rated ones, as ``to_the_end``."""
    turns, lasts_s = list[Turn](), 0.0
    for turn in sequence:
        rated = rate(place)
        number = rated.number_of(turn)
        if rated.reached or number is None:
            break
        turns.append(rated.turns[number])
        lasts_s += turn.cost_s
        place = place.after(turn, rated.rows[number])
    more, more_s = to_the_end(rate, place, until_s - lasts_s)
    return [*turns, *more], lasts_s + more_s


def soonest(rate: Rate, place: Place, kept: list[Turn]) -> list[Turn]:
    """Return the turns to the end that take least time, of the kept sequence and each of the best next turns; empty where none ends."""
    best, best_s = followed(rate, place, kept)
    rated = rate(place)
    if rated.reached or not np.isfinite(best_s):
        return []
    for number in np.argsort(-rated.rating)[:BRANCHES].tolist():
        turn = rated.turns[number]
        more, more_s = to_the_end(rate, place.after(turn, rated.rows[number]), best_s - turn.cost_s)
        if turn.cost_s + more_s < best_s:
            best, best_s = [turn, *more], turn.cost_s + more_s
    return best


def _same(one: Turn, other: Turn) -> bool:
    pairs = zip(one.moves, other.moves, strict=False)
    return len(one.moves) == len(other.moves) and all(a.axis == b.axis and abs(a.angle_rad - b.angle_rad) < SAME_RAD for a, b in pairs)
