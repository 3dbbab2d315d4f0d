"""All forms of the grammar that a recording can be asked, each once.

One factor: every function of every quantity, and what of them may lag behind.  Two factors: the plainer functions of both, with fewer
places for constants.  Each in every pattern of axes that its factors may have.  What is the same by algebra is left out as it is built, as
far as a rule says so in a line; ``same`` finds the rest, and the form of fewest bits stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from itertools import combinations_with_replacement

from tinygc.discovery.grammar.bits import bits
from tinygc.discovery.grammar.form import Factor, Form, patterns_of
from tinygc.discovery.grammar.functions import FUNCTIONS
from tinygc.discovery.grammar.grids import FADING, constant_at
from tinygc.discovery.grammar.largest import largest_of
from tinygc.discovery.grammar.quantities import QUANTITIES
from tinygc.discovery.grammar.same import told_apart
from tinygc.discovery.grammar.some_movement import some_movement
from tinygc.discovery.grammar.vocabulary import offered

#: of the movement by which forms are told apart: of a dozen, one that knows every form that any of the others knows
SEED = 10
#: numbers of one axis that a product may have: more would be a dozen coefficients
MOST_EACH = 2

#: a factor without the recording's size of it: quantity, function, its constant's place, lag
Place = tuple[str, str, float | None, float | None]
#: factors and pattern
Plan = tuple[tuple[Place, ...], str]


def enumerated(largest: Mapping[str, float]) -> list[Form]:
    """Every form over these quantities, by name, each with its largest size in the recording; 0 where it does not vary."""
    names = tuple(name for name in QUANTITIES if largest.get(name, 0.0) > 0)
    factors = _Factors(largest)
    return [Form(tuple(factors[place] for place in places), pattern) for places, pattern in _plans(names)]


class _Factors(dict[Place, Factor]):
    """By their place, each made once for quantities of these sizes."""

    def __init__(self, largest: Mapping[str, float]):
        super().__init__()
        self.largest = largest

    def __missing__(self, place: Place) -> Factor:
        quantity, function, at, lag_s = place
        constant = None if at is None else constant_at(quantity, function, at, self.largest[quantity])
        self[place] = Factor(quantity, function, constant, lag_s)
        return self[place]


@cache
def _plans(names: tuple[str, ...]) -> tuple[Plan, ...]:
    """Of all forms over these quantities, each once, the simplest first; told apart on a movement that is drawn."""
    movement = some_movement(SEED)
    factors = _Factors(largest_of([movement]))
    plans: dict[Form, Plan | None] = {}
    products = list(_products(names))
    for plan in [*_singles(names), *products]:
        plans.setdefault(Form(tuple(factors[place] for place in plan[0]), plan[1]), plan)
    # A product whose one factor is 1 wherever the other is not 0 is no product: it is left out for that other alone, a single law near one
    # of the singles' own places.
    for place in dict.fromkeys(place for places, _ in products for place in places):
        for pattern in patterns_of((_any(*place[:2]),)):
            plans.setdefault(Form((factors[place],), pattern), None)
    found = (plans[form] for form in told_apart(sorted(plans, key=bits), [movement]))
    return tuple(plan for plan in found if plan is not None)


def _singles(names: tuple[str, ...]) -> Iterator[Plan]:
    for name in names:
        for function, at, lag_s in offered(name, few=False):
            plain = at is None and lag_s is None
            for pattern in patterns_of((_any(name, function),)):
                # A matrix over what fades or steps has no physics of its own; nor has a matrix without its diagonal.
                if pattern == "each" or plain or (pattern == "full" and QUANTITIES[name].directions * FUNCTIONS[function].phases == 1):
                    yield ((name, function, at, lag_s),), pattern


def _products(names: tuple[str, ...]) -> Iterator[Plan]:
    places = [(name, *place) for name in names for place in offered(name, few=True)]
    for one, other in combinations_with_replacement(places, 2):
        factors = (_any(*one[:2]), _any(*other[:2]))
        if factors[0].each * factors[1].each > MOST_EACH or not _sensible(one, other):
            continue
        plain = all(at is None and lag_s is None for _, _, at, lag_s in (one, other))
        for pattern in patterns_of(factors):
            if pattern in ("full", "cross") and not plain:
                continue
            yield (one, other), pattern
            if pattern == "leant" and one != other:
                yield (other, one), pattern


def _sensible(one: Place, other: Place) -> bool:
    """Whether a product is worth its place.

    A wave multiplies a quantity as it is.  Of two factors with a value on a grid one fades with time: what a motion leaves behind, and what
    a supply does as it settles, are such products; of others, two grids would be two searches in one.
    """
    if "wave" in (one[1], other[1]):
        return "itself" in (one[1], other[1]) and None in (one[3] or one[2], other[3] or other[2])
    searched = [any(value is not None for value in place[2:]) for place in (one, other)]
    return not all(searched) or (one[0] != other[0] and (_fades(one) or _fades(other)))


def _fades(place: Place) -> bool:
    return place[0] in ("time", "rest") and place[1] in FADING


@cache
def _any(quantity: str, function: str) -> Factor:
    """A factor of that kind, its constant whatever."""
    return Factor(quantity, function, None if FUNCTIONS[function].constant is None else 1.0)
