"""Responses of the channels to products of factors, for all forms at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from session.base.numeric import running_sum
from tinygc.features.discovery.form import Factor, LawForm
from tinygc.features.discovery.quantities import QUANTITIES
from tinygc.noise.refit import Replay

# The products of factors that the forms need, ordered so that each factor is evaluated about once and most work is matrix products.
#
# A form's coefficient adds a product of one component of each of its factors.  Of two factors, the one that comes first in all forms is the
# hub: the hub times the channels' sensitivity is a small matrix, and one matrix product gives its products with all partners.  A form of
# one factor has the hub ``ONE``, which is 1.

#: the hub of forms that have one factor
ONE = 0


class Wiring(NamedTuple):
    """Terms of all forms of one pattern over factors of the same kind: axis (P,), and the component (P,) of the hub and of the partner, of
    each coefficient."""

    axis: np.ndarray
    hub: np.ndarray
    partner: np.ndarray


@dataclass(frozen=True, eq=False)
class ColumnPlan:
    """factors: each once, the first is ``ONE``; width (factors,): components of each; hub, partner (F,): of each form; wiring (F,): its
    index among the wirings; wirings."""

    factors: tuple[Factor | None, ...]
    width: np.ndarray
    hub: np.ndarray
    partner: np.ndarray
    wiring: np.ndarray
    wirings: tuple[Wiring, ...]

    @property
    def sizes(self) -> np.ndarray:
        """(F,) coefficients of each form."""
        return np.array([len(axis) for axis, _, _ in self.wirings])[self.wiring]

    def tiles(self, most: int) -> list[np.ndarray]:
        """Partners in tiles of about so many components."""
        order = np.unique(self.partner)
        ends = np.cumsum(self.width[order])
        return np.split(order, np.flatnonzero(np.diff(ends // most)) + 1)


def planned(forms: Sequence[LawForm]) -> ColumnPlan:
    """The column plan of these forms."""
    numbers: dict[Factor | None, int] = {None: ONE}
    pairs = np.empty((len(forms), 2), dtype=int)
    for row, form in zip(pairs, forms, strict=True):
        row[0] = numbers.setdefault(form.factors[0], len(numbers))
        row[1] = numbers.setdefault(form.factors[1], len(numbers)) if len(form.factors) == 2 else ONE
    factors = tuple(numbers)
    first_is_hub = (pairs[:, 0] <= pairs[:, 1]) & (pairs[:, 1] != ONE)
    made: dict[tuple, int] = {}
    wirings: list[Wiring] = []
    which = np.empty(len(forms), dtype=int)
    for number, (form, turned) in enumerate(zip(forms, first_is_hub.tolist(), strict=True)):
        # A form's terms depend on its pattern and on its factors' numbers of components alone.
        key = (form.pattern, turned, *((factor.of.components, factor.through.phases) for factor in form.factors))
        if key not in made:
            made[key] = len(wirings)
            wirings.append(_wiring(form, turned))
        which[number] = made[key]
    hub = np.where(first_is_hub, pairs[:, 0], pairs[:, 1])
    partner = np.where(first_is_hub, pairs[:, 1], pairs[:, 0])
    width = np.array([1 if factor is None else factor.of.components * factor.through.phases for factor in factors])
    return ColumnPlan(factors, width, hub, partner, which, tuple(wirings))


def _wiring(form: LawForm, first_is_hub: bool) -> Wiring:
    terms = form.terms()
    axis = np.array([axis for axis, _ in terms])
    first, *second = np.array([[component for _, component in parts] for _, parts in terms]).T
    if not second:
        return Wiring(axis, np.zeros(len(terms), dtype=int), first)
    return Wiring(axis, first, second[0]) if first_is_hub else Wiring(axis, second[0], first)


# Values of factors over all samples of a recording, each quantity computed once.


class SessionValues:
    """Values over a replay's movement: its logs concatenated, as the twin has them."""

    def __init__(self, replay: Replay):
        self.movements = [movement.with_rate(rate) for movement, rate in zip(replay.twin.movements, replay.rates, strict=True)]
        #: samples of all logs together
        self.samples = sum(len(movement.t_s) for movement in self.movements)
        self._quantities: dict[str, list[np.ndarray]] = {}

    def quantity(self, name: str) -> list[np.ndarray]:
        """Values of a quantity in each log, (N, components)."""
        if name not in self._quantities:
            self._quantities[name] = [QUANTITIES[name].of(movement) for movement in self.movements]
        return self._quantities[name]

    def of(self, factor: Factor | None) -> np.ndarray:
        """Values of a factor, (components, N) float64, as ``Factor.values``; ones for ``ONE``."""
        if factor is None:
            return np.ones((1, self.samples))
        logs = zip(self.movements, self.quantity(factor.quantity), strict=True)
        return np.concatenate([factor.values(movement, known) for movement, known in logs]).T

    def single(self, factor: Factor | None) -> tuple[np.ndarray, float]:
        """Values (components, N) float32 as shares of the largest, and the largest: 0, and zeros, where it is 0 or not finite."""
        values = self.of(factor)
        largest = float(np.abs(values).max(initial=0.0))
        if not np.isfinite(largest) or largest == 0:
            return np.zeros(values.shape, dtype=np.float32), 0.0
        return (values / largest).astype(np.float32, order="C"), largest


# Effects of products of factors on the channels: the columns of all forms at once, as ``Twin.effect_columns`` for one effect.
#
# A product's rate, added to an axis, moves the closure of a segment by the sum over its samples of sensitivity times product, the mean rate
# of a still by its mean there, and no length of gravity.  Sums over all forms are single precision, which is enough for ranking: they are
# accurate to some 1e-6 of the largest, where ``evidence.UNSEEN`` drops less than 1e-4.


#: of a hub's components times partners' components: of the closure (S, d, 3, H, K), the third the axis that is added to; of the stills
#: (Q, H, K), the same for every axis
ResponseBlock = tuple[np.ndarray, np.ndarray]


class Responses:
    """Responses of one replay; segments, stills: numbers of those that are used, all where None; values: of the replay, where known."""

    def __init__(
        self, replay: Replay, segments: np.ndarray | None = None, stills: np.ndarray | None = None, values: SessionValues | None = None
    ):
        twin = self.twin = replay.twin
        self.values = SessionValues(replay) if values is None else values
        self.angles = twin.batch.angles
        self.segments = np.arange(len(twin.segments)) if segments is None else segments
        self.stills = np.arange(len(twin.stills)) if stills is None else stills
        starts = running_sum([len(movement.t_s) for movement in twin.movements])
        self._turns, self._sensitivity, self._rests, self._weights = [], [], [], []
        for number in self.segments:
            segment = twin.segments[number]
            count, begin = segment.stop - segment.start, starts[segment.log] + segment.start
            self._turns.append(slice(begin, begin + count))
            # Negative, as corrections are in the twin.
            turn = -replay.sensitivity[number, :count].reshape(count, -1).T
            self._sensitivity.append(np.ascontiguousarray(turn))
        for number in self.stills:
            log, still = twin.stills[number]
            begin = starts[log] + still.start
            counts = twin.counts(log)
            weight = np.ones(still.stop - still.start) if counts is None else counts[still.start : still.stop]
            self._rests.append(slice(begin, begin + still.stop - still.start))
            self._weights.append(-weight / weight.sum())
        self._single = [each.astype(np.float32) for each in self._sensitivity], [each.astype(np.float32) for each in self._weights]

    @property
    def channels(self) -> int:
        """Rows of the stacked channels that are used."""
        return len(self.segments) * self.angles + 4 * len(self.stills)

    def block(self, hub: np.ndarray, partners: np.ndarray) -> ResponseBlock:
        """Responses of every product of hub (H, N) and partners (K, N), in their precision."""
        sensitivity, weights = self._single if partners.dtype == np.float32 else (self._sensitivity, self._weights)
        closure = np.empty((len(self._turns), 3 * self.angles * len(hub), len(partners)), dtype=partners.dtype)
        for row, rows, turn in zip(closure, self._turns, sensitivity, strict=True):
            own = (turn[:, None] * hub[None, :, rows]).reshape(-1, turn.shape[1])
            np.matmul(own, partners[:, rows].T, out=row)
        still = np.empty((len(self._rests), len(hub), len(partners)), dtype=partners.dtype)
        for row, rows, weight in zip(still, self._rests, weights, strict=True):
            np.matmul(hub[:, rows] * weight, partners[:, rows].T, out=row)
        return closure.reshape(-1, self.angles, 3, len(hub), len(partners)), still

    def columns(self, form: LawForm) -> np.ndarray:
        """Stacked columns (n, P) of one form, in double precision."""
        plan = planned([form])
        ((axis, hub, partner),) = plan.wirings
        closure, of_stills = self.block(*(self.values.of(plan.factors[which[0]]) for which in (plan.hub, plan.partner)))
        s, q = len(self.segments), len(self.stills)
        closure = closure[:, :, axis, hub, partner].reshape(s * self.angles, len(axis))
        still = np.zeros((q, 3, len(axis)))
        still[:, axis, np.arange(len(axis))] = of_stills[:, hub, partner]
        return np.concatenate([closure, still.reshape(3 * q, len(axis)), np.zeros((q, len(axis)))])
