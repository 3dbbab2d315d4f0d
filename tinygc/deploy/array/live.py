"""An array live: the units' rates of a moment in, one rate out, its sigma, and who is not believed, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from session.common.errors import CalibrationError
from tinygc.array.fused.model import ArrayModel
from tinygc.deploy.array.one_vote import Change, Means, Seen, State, look, means, settle
from tinygc.deploy.array.voting import BETWEEN_TWO, DIFFERS, IN, REASONS, STUCK, Event, Tables

#: samples that are looked at together; an event begins anew behind it
BLOCK = 2048


@dataclass(frozen=True, eq=False)
class Fused:
    """rate (T, 3) rad/s in the array's frame, NaN where no unit gave one; sigma (T, 3) rad/s, infinite where every unit reads its end;
    used (T, N): whose rates are in it; events, in their order."""

    rate: np.ndarray
    sigma: np.ndarray
    used: np.ndarray
    events: tuple[Event, ...]


class LiveArray:
    """One stream of an array; after a pause, begin a new one.

    live = LiveArray(model)
    fused = live(raw)        # raw (N, 3) rad/s of one moment, a row NaN where a unit has none; or (T, N, 3) of consecutive ones
    """

    def __init__(self, model: ArrayModel, *, vote: bool = True):
        """vote: False believes every unit that gives a finite sample."""
        self.model, self.tables, self._vote = model, Tables.of(model), vote
        self._state = State.start(len(model))
        self._sample = 0

    @property
    def out(self) -> dict[int, str]:
        """Number of each unit that is voted out, and why."""
        return {self.model.numbers[i]: REASONS[int(why)] for i, why in enumerate(self._state.why) if why != IN}

    @property
    def standing(self) -> dict[int, int]:
        """Number of each unit, and why it is out: ``IN``, ``DIFFERS``, ``DEAD`` or ``STUCK``, as the exported C has them."""
        return {number: int(why) for number, why in zip(self.model.numbers, self._state.why, strict=True)}

    @property
    def disagree(self) -> bool:
        """Whether the only two units left differ, so that nobody knows which is right."""
        return self._state.disagree

    def __call__(self, raw: ArrayLike) -> Fused:
        """The combination of the next samples: raw (N, 3) or (T, N, 3) rad/s as measured.  CalibrationError for another shape."""
        rates = np.asarray(raw, dtype=float)
        if rates.shape[-2:] != (len(self.model), 3) or rates.ndim not in (2, 3):
            raise CalibrationError(f"raw has shape {rates.shape}, expected ({len(self.model)}, 3) or (T, {len(self.model)}, 3), rad/s")
        rates = rates.reshape(-1, len(self.model), 3)
        parts: list[Fused] = []
        at = 0
        while at < len(rates):
            part = self._block(rates[at : at + BLOCK])
            at += len(part.rate)
            parts.append(part)
        if not parts:
            nothing = np.zeros((0, 3))
            return Fused(nothing, nothing, np.zeros((0, len(self.model)), dtype=bool), ())
        rate, sigma, used = (np.concatenate(each) for each in zip(*((part.rate, part.sigma, part.used) for part in parts), strict=True))
        return Fused(rate, sigma, used, tuple(event for part in parts for event in part.events))

    def _block(self, rates: np.ndarray) -> Fused:
        """As many of the samples as pass before somebody's standing changes, that sample included."""
        seen = look(self.tables, self._state, rates, self._vote)
        count = len(rates)
        events: list[Event] = []
        if self._vote:
            running = means(self.tables, self._state, seen)
            count, self._state, told = settle(self.tables, self._state, seen, running)
            events = [self._event(change, seen, running, count - 1) for change in told]
        self._sample += count
        used = seen.used[:count]
        rate, sigma = combine(self.tables, seen.calibrated[:count], used)
        sigma[seen.at_end[:count]] = np.inf
        if seen.disagreement is not None:
            sigma = np.sqrt(sigma**2 + seen.disagreement[:count] ** 2)
        return Fused(rate, sigma, used, tuple(events))

    def _event(self, change: Change, seen: Seen, running: Means, row: int) -> Event:
        number = None if change.unit is None else self.model.numbers[change.unit]
        nothing = (float("nan"), float("nan"))
        differs = change.why in (DIFFERS, STUCK) and change.what in ("out", "disagree")
        size, bar = running.size(self.tables, seen, change.unit, row) if differs else nothing
        reason = "" if change.what in ("in", "agree") else BETWEEN_TWO if change.unit is None else REASONS[change.why]
        return Event(self._sample + row, number, change.what, reason, size, bar)


def combine(tables: Tables, calibrated: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``(rate (T, 3), sigma (T, 3))`` rad/s of rates (T, N, 3) in the array's frame, those with used (T, N): the weights are shared out
    among them anew, ``(sum of theirs)^-1 W_i``, which is best again where noise is independent."""
    rate, sigma = np.full((len(used), 3), np.nan), np.full((len(used), 3), np.nan)
    kinds, which = np.unique(used, axis=0, return_inverse=True)
    which = which.reshape(-1)
    for kind, mask in enumerate(kinds):
        if not mask.any():
            continue
        rows = which == kind
        undo = np.linalg.inv(tables.weights[mask].sum(axis=0))
        rate[rows] = np.einsum("nij,tnj->ti", undo @ tables.weights[mask], calibrated[rows][:, mask])
        spread = undo @ tables.spread[mask].sum(axis=0) @ undo.T
        sigma[rows] = np.sqrt(np.diag(spread) + tables.own)
    return rate, sigma
