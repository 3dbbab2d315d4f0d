"""All forms of the grammar that a recording can be asked, each once, and how long its description is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from itertools import combinations_with_replacement

import numpy as np

from tinygc.annexes.discovery.equivalence import distinct_forms, some_movement
from tinygc.annexes.discovery.form import Factor, LawForm, patterns_of
from tinygc.annexes.discovery.quantities import FUNCTIONS, QUANTITIES, largest_of

# The constants that are tried before they are sharpened: of functions by the quantity's own size in the recording, and of lags.
#
# Every grid has the same number of places whatever the recording, so that a form means the same, and costs the same bits, in all of them.
# Neighbours differ by two or so: a true constant between them is near enough for the one beside it to be seen, and sharpening
# (``screen``) ends at it.

#: of the quantity's largest size: thresholds, dead zones, limits; in products fewer
SHARES, FEW_SHARES = (0.01, 0.025, 0.05, 0.1, 0.2, 0.35, 0.55, 0.8), (0.03, 0.1, 0.3, 0.6)
#: likewise, of a step, of which a calibration leaves no more than what is near it: a step a fourth off is still half like it
STEPS = tuple((0.02 * 1.3 ** np.arange(15)).tolist())
#: likewise, of what fades: from a settling of seconds in a session of minutes to one that is hardly more than a slope
FADES, FEW_FADES = (0.001, 0.003, 0.008, 0.02, 0.05, 0.12, 0.3, 0.7, 1.6, 4.0), (0.008, 0.03, 0.1, 0.3, 1.0)
#: s: from what a filter does to what a package remembers; of what warms up slowly
LAGS_S = (0.05, 0.15, 0.5, 1.5, 5.0, 15.0, 50.0, 150.0)
SLOW_LAGS_S = (1.5, 5.0, 15.0, 50.0, 150.0, 500.0)
#: s: in products
FEW_LAGS_S, FEW_SLOW_LAGS_S = (0.15, 0.5, 1.5, 5.0, 15.0, 50.0), (5.0, 15.0, 50.0, 150.0)
#: cycles over twice the largest size, of a wave over a quantity with both signs
CYCLES, FEW_CYCLES = tuple(np.arange(1.0, 12.5, 0.5).tolist()), (1.0, 2.0, 4.0)
#: cycles over the session, of a line: closer than half of what it tells apart they are sharpened; of a square wave; in products
LINES = tuple(np.arange(0.5, 200.25, 0.5).tolist())
CLOCKS, FEW_LINES = LINES[1:40], LINES[:40]
#: times in a full turn
TIMES_A_TURN = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0)
#: of a register, over the largest size: half a step more or less moves the last by no more
COUNTS = tuple(np.arange(2.0, 32.25, 0.5).tolist())

PERIODIC, FADING, STEPPED = ("wave", "clock"), ("decay", "signed_decay", "settle"), ("beyond", "signed_beyond", "above", "band", "latch")


def places(quantity: str, function: str, few: bool = False) -> tuple[float, ...]:
    """Of a function's constant, as ``constant_at`` takes them; few: in a product."""
    if quantity == "turned" and function in PERIODIC:
        return TIMES_A_TURN
    if quantity == "time" and function in PERIODIC:
        return FEW_LINES if few else CLOCKS if function == "clock" else LINES
    if function in PERIODIC:
        return FEW_CYCLES if few else CYCLES
    if function == "saw":
        return COUNTS
    if function in FADING:
        return FEW_FADES if few else FADES
    if function in STEPPED and not few:
        return STEPS
    return FEW_SHARES if few else SHARES


def constant_at(quantity: str, function: str, place: float, largest: float) -> float:
    """In the quantity's unit, of one whose largest size is given."""
    if quantity == "turned" and function in PERIODIC:
        return 2 * np.pi / place
    if function in PERIODIC:
        return _round((1.0 if quantity == "time" else 2.0) * largest / place)
    return _round(largest / place if function == "saw" else largest * place)


def lags_of(quantity: str, few: bool = False) -> tuple[float, ...]:
    """s, of a quantity that may be looked at behind a lag."""
    if quantity in ("temperature", "vibration", "temperature_rate"):
        return FEW_SLOW_LAGS_S if few else SLOW_LAGS_S
    return FEW_LAGS_S if few else LAGS_S


def _round(value: float) -> float:
    """To four digits: a constant that a person can read, which is to be sharpened."""
    return float(f"{value:.4g}")


# Which functions of which quantities are tried: alone, in a product, and behind a lag.
#
# What a Coriolis gyroscope and its package are known to do, or could: the drive's and the sense's nonlinearity (powers, roots, limits, dead
# zones of the rate), one axis' motion in another's channel (rate products, angular acceleration, jerk of a mode that rings), a mass that
# hangs askew (force, its products, force times rate), strain of the package (temperature, its rate, its lag), heat and charge that a motion
# leaves behind (lags of the rate's size and square, the sense of the last turn, which fades), a supply that settles or is loaded to a
# clock (time), hysteresis (play, latch), a field that is fixed in the world (level and world directions), and a register that rounds (saw).

_POWERS = "itself size square signed_square cube size_cube root signed_root root_cube size_root_cube"
_LIMITS = "excess within soft beyond signed_beyond band"
_KINKS = "dead_zone excess hinge beyond above"
#: of each quantity, names of functions with a space between
ALONE: dict[str, str] = {
    # A dead zone is the rate less what is held within it: in its own size it leaves the scale factor alone.
    "rate": f"{_POWERS} sign {_LIMITS} decay signed_decay wave saw play latch",
    "rate_size": "itself square cube root root_cube excess soft beyond decay wave",
    "force": f"{_POWERS} sign dead_zone {_LIMITS} wave play",
    "acceleration": f"{_POWERS} sign dead_zone {_LIMITS}",
    "acceleration_size": "itself square cube root root_cube excess soft beyond",
    "jerk": "itself size square signed_square cube root signed_root sign dead_zone excess soft beyond",
    "temperature": f"itself size square signed_square cube root signed_root root_cube {_KINKS} decay soft wave play",
    "temperature_rate": "itself size square signed_square cube root signed_root sign dead_zone beyond",
    "time": "itself square cube root root_cube excess beyond decay wave clock",
    "rest": "itself square cube root root_cube excess beyond decay",
    "vibration": "itself square cube root root_cube excess beyond soft",
    "turned": "itself size square signed_square cube root signed_root wave clock play",
    "sense": "itself",
    "level": "itself",
    "world": "itself",
}
TOGETHER: dict[str, str] = {
    "rate": "itself size square signed_square cube root_cube signed_root sign dead_zone beyond signed_beyond",
    "rate_size": "itself square root beyond excess decay",
    "force": "itself size square signed_square sign",
    "acceleration": "itself size square sign",
    "acceleration_size": "itself square",
    "jerk": "itself size",
    "temperature": "itself square size root beyond excess",
    "temperature_rate": "itself size",
    "time": "itself square root decay settle beyond wave",
    "rest": "itself root decay settle beyond",
    "vibration": "itself root square beyond",
    "turned": "itself wave",
    "sense": "itself",
    "level": "itself",
    "world": "",
}
#: functions that may be looked at behind a lag, alone and in a product
LAGGED: dict[str, str] = {
    "rate": "itself size square signed_square sign cube dead_zone excess beyond",
    "rate_size": "itself square excess beyond",
    "force": "itself size square",
    "acceleration": "size square",
    "acceleration_size": "itself square",
    "temperature": "itself square",
    "temperature_rate": "itself size",
    "vibration": "itself root",
    "sense": "itself",
}
LAGGED_TOGETHER: dict[str, str] = {
    "rate": "itself size square",
    "rate_size": "itself square",
    "force": "itself",
    "temperature": "itself",
    "vibration": "itself",
    "sense": "itself",
}


def offered(quantity: str, few: bool) -> list[tuple[str, float | None, float | None]]:
    """(function, its constant's place on the grid, lag in s) of a quantity, alone or, few, in a product."""
    plain, late = (TOGETHER, LAGGED_TOGETHER) if few else (ALONE, LAGGED)
    found: list[tuple[str, float | None, float | None]] = []
    for function in plain[quantity].split():
        grid: tuple[float | None, ...] = (None,) if FUNCTIONS[function].constant is None else places(quantity, function, few)
        found += [(function, place, None) for place in grid]
    for function in late.get(quantity, "").split():
        # Two grids at once: fewer places on both.
        bent = FUNCTIONS[function].constant is not None
        at = places(quantity, function, few=True) if bent else (None,)
        found += [(function, place, lag_s) for place in at for lag_s in lags_of(quantity, few or bent)]
    return found


# How long a form's description is: the choices that the grammar offers at each place, in bits.
#
#     one factor or two | of each: quantity; itself or a function, and which; its constant's place on the grid; lag or none, and which |
#     pattern of axes, of those that such factors may have
#
# A choice among n costs log2(n).  What is asked with yes or no costs one bit: is there a second factor, is it the quantity itself, is there
# a lag.  So a law of one quantity as it is costs seven bits, and a product of two functions behind lags more than thirty.  The bits are
# those of the grammar, whatever a recording has; constants count by their place on the grid.  Two to the power of minus the bits, summed
# over all forms, is below one, as of any code.


def bits(form: LawForm) -> float:
    """Of a form, whatever its constants are."""
    factors = sum(_of_factor(f.quantity, f.function, f.constant is not None, f.lag_s is not None) for f in form.factors)
    return 1.0 + factors + float(np.log2(len(patterns_of(form.factors))))


@cache
def _of_factor(quantity: str, function: str, constant: bool, lag: bool) -> float:
    found = float(np.log2(len(QUANTITIES))) + 2.0
    if function != "itself":
        found += float(np.log2(len(FUNCTIONS) - 1))
    if constant:
        found += float(np.log2(len(places(quantity, function))))
    return found + (float(np.log2(len(lags_of(quantity)))) if lag else 0.0)


# All forms of the grammar that a recording can be asked, each once.
#
# One factor: every function of every quantity, and what of them may lag behind.  Two factors: the plainer functions of both, with fewer
# places for constants.  Each in every pattern of axes that its factors may have.  What is the same by algebra is left out as it is built,
# as far as a rule says so in a line; ``same`` finds the rest, and the form of fewest bits stays.

#: of the movement by which forms are told apart: of a dozen, one that knows every form that any of the others knows
SEED = 10
#: numbers of one axis that a product may have: more would be a dozen coefficients
MOST_EACH = 2

#: a factor without the recording's size of it: quantity, function, its constant's place, lag
Place = tuple[str, str, float | None, float | None]
#: factors and pattern
Plan = tuple[tuple[Place, ...], str]


def enumerated(largest: Mapping[str, float]) -> list[LawForm]:
    """Every form over these quantities, by name, each with its largest size in the recording; 0 where it does not vary."""
    names = tuple(name for name in QUANTITIES if largest.get(name, 0.0) > 0)
    factors = _Factors(largest)
    return [LawForm(tuple(factors[place] for place in places), pattern) for places, pattern in _plans(names)]


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
    plans: dict[LawForm, Plan | None] = {}
    products = list(_products(names))
    for plan in [*_singles(names), *products]:
        plans.setdefault(LawForm(tuple(factors[place] for place in plan[0]), plan[1]), plan)
    # A product whose one factor is 1 wherever the other is not 0 is no product: it is left out for that other alone, a single law near one
    # of the singles' own places.
    for place in dict.fromkeys(place for places, _ in products for place in places):
        for pattern in patterns_of((_any(*place[:2]),)):
            plans.setdefault(LawForm((factors[place],), pattern), None)
    found = (plans[form] for form in distinct_forms(sorted(plans, key=bits), [movement]))
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
