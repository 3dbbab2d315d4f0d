"""Which products of factors the forms need, sorted so that each factor is evaluated once or so and most of the work is matrix products.

A form's coefficient adds a product of one component of each of its factors.  Of two factors, the one with more partners is the hub: the
hub times the channels' sensitivity is a small matrix, and its products with all partners at once are one matrix product.  A form of one
factor has the hub ``ONE``, which is 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.discovery.grammar.form import Factor, Form

#: the hub of forms that have one factor
ONE = 0


@dataclass(frozen=True, eq=False)
class Wiring:
    """Of all forms of one pattern over factors of the same kind: axis (P,), and the component (P,) of the hub and of the partner, of each
    coefficient."""

    axis: np.ndarray
    hub: np.ndarray
    partner: np.ndarray

    @property
    def size(self) -> int:
        """Coefficients."""
        return len(self.axis)


@dataclass(frozen=True, eq=False)
class Plan:
    """factors: each once, the first is ``ONE``; width (factors,): components of each; hub, partner (F,): of each form; wiring (F,): which
    of the wirings it has; wirings."""

    factors: tuple[Factor | None, ...]
    width: np.ndarray
    hub: np.ndarray
    partner: np.ndarray
    wiring: np.ndarray
    wirings: tuple[Wiring, ...]

    @property
    def sizes(self) -> np.ndarray:
        """(F,) coefficients of each form."""
        return np.array([wiring.size for wiring in self.wirings])[self.wiring]

    def tiles(self, most: int) -> Iterator[np.ndarray]:
        """The partners, so many components of them at a time, neighbours sharing their hubs as far as can be."""
        order = self._order()
        ends = np.cumsum(self.width[order])
        first = 0
        while first < len(order):
            begun = ends[first] - self.width[order[first]]
            stop = max(int(np.searchsorted(ends, begun + most, side="right")), first + 1)
            yield order[first:stop]
            first = stop

    def _order(self) -> np.ndarray:
        hubs: dict[int, set[int]] = {}
        for hub, partner in zip(self.hub.tolist(), self.partner.tolist(), strict=True):
            hubs.setdefault(partner, set()).add(hub)
        return np.array(sorted(hubs, key=lambda partner: (sorted(hubs[partner]), partner)), dtype=int)


def planned(forms: Sequence[Form]) -> Plan:
    """Of these forms.  ValueError for one of more than two factors."""
    numbers: dict[Factor | None, int] = {None: ONE}
    pairs = np.empty((len(forms), 2), dtype=int)
    for row, form in zip(pairs, forms, strict=True):
        if not 1 <= len(form.factors) <= 2:
            raise ValueError(f"a form has one factor or two, got {len(form.factors)}: {form}")
        row[0] = numbers.setdefault(form.factors[0], len(numbers))
        row[1] = numbers.setdefault(form.factors[1], len(numbers)) if len(form.factors) == 2 else ONE
    factors = tuple(numbers)
    first_is_hub = _first_is_hub(pairs, len(factors))
    made: dict[tuple, int] = {}
    wirings: list[Wiring] = []
    which = np.empty(len(forms), dtype=int)
    for number, (form, turned) in enumerate(zip(forms, first_is_hub.tolist(), strict=True)):
        # What the terms of a form are depends on its pattern and on how many numbers its factors have, never on which they are.
        key = (form.pattern, turned, *((factor.of.components, factor.through.phases) for factor in form.factors))
        if key not in made:
            made[key] = len(wirings)
            wirings.append(_wiring(form, turned))
        which[number] = made[key]
    hub = np.where(first_is_hub, pairs[:, 0], pairs[:, 1])
    partner = np.where(first_is_hub, pairs[:, 1], pairs[:, 0])
    width = np.array([1 if factor is None else factor.of.components * factor.through.phases for factor in factors])
    return Plan(factors, width, hub, partner, which, tuple(wirings))


def _first_is_hub(pairs: np.ndarray, factors: int) -> np.ndarray:
    """(F,) whether the first of a form's factors has more partners; of forms with one, never: ``ONE`` has."""
    distinct = np.unique(np.sort(pairs, axis=1), axis=0)
    partners = np.bincount(distinct[:, 0], minlength=factors) + np.bincount(distinct[:, 1], minlength=factors)
    partners[ONE] = len(pairs) + 1
    first, second = pairs.T
    ahead = (partners[first] > partners[second]) | ((partners[first] == partners[second]) & (first <= second))
    return ahead & (second != ONE)


def _wiring(form: Form, first_is_hub: bool) -> Wiring:
    terms = form.terms()
    axis = np.array([term.axis for term in terms])
    if len(form.factors) == 1:
        return Wiring(axis, np.zeros(len(terms), dtype=int), np.array([term.parts[0][1] for term in terms]))
    components = np.array([[component for _, component in term.parts] for term in terms])
    for term in terms:
        if tuple(factor for factor, _ in term.parts) != form.factors:
            raise ValueError(f"parts of a term stand in the order of the form's factors: {form}")
    first, second = components.T
    return Wiring(axis, first, second) if first_is_hub else Wiring(axis, second, first)
