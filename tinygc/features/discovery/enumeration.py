"""All forms of the grammar for a recording, each once, and the length of their descriptions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from itertools import combinations_with_replacement

import numpy as np

from tinygc.features.discovery.form import Factor, LawForm, patterns_of
from tinygc.features.discovery.quantities import FUNCTIONS, QUANTITIES

# The grid of constants before refinement: functions in units of the quantity's largest size in the recording, and lags.
#
# Every grid has the same number of places in every recording, so a form means the same and costs the same bits in all of them.
# Neighbours differ by a factor of about two: a true constant between them is visible at its neighbour, and refinement
# (``refined``) reaches it.

#: shares of the quantity's largest size: thresholds, dead zones, limits; fewer in products
SHARES, FEW_SHARES = (0.01, 0.025, 0.05, 0.1, 0.2, 0.35, 0.55, 0.8), (0.03, 0.1, 0.3, 0.6)
#: likewise for a step: a calibration leaves only the part near it, so a step a fourth off is still half correlated with it
STEPS = tuple((0.02 * 1.3 ** np.arange(15)).tolist())
#: likewise for decays: from a settling of seconds in a session of minutes to hardly more than a slope
FADES, FEW_FADES = (0.001, 0.003, 0.008, 0.02, 0.05, 0.12, 0.3, 0.7, 1.6, 4.0), (0.008, 0.03, 0.1, 0.3, 1.0)
#: s: from a filter's delay to a package's memory; of slow warming
LAGS_S = (0.05, 0.15, 0.5, 1.5, 5.0, 15.0, 50.0, 150.0)
SLOW_LAGS_S = (1.5, 5.0, 15.0, 50.0, 150.0, 500.0)
#: s: in products
FEW_LAGS_S, FEW_SLOW_LAGS_S = (0.15, 0.5, 1.5, 5.0, 15.0, 50.0), (5.0, 15.0, 50.0, 150.0)
#: cycles over twice the largest size, for a wave over a quantity of both signs
CYCLES, FEW_CYCLES = tuple(np.arange(1.0, 12.5, 0.5).tolist()), (1.0, 2.0, 4.0)
#: cycles over the session of a line, spaced at half the resolution so that refinement can reach any; of a square wave; in products
LINES = tuple(np.arange(0.5, 200.25, 0.5).tolist())
CLOCKS, FEW_LINES = LINES[1:40], LINES[:40]
#: cycles in a full turn
TIMES_A_TURN = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0)
#: a temperature at which a law of it vanishes, from the first sample's, over the largest change: beyond, the law is hardly one of it
POINTS = (0.25, 0.5, 1.0, 2.0)
#: a register's steps over the largest size: half a step changes the last threshold by no more
COUNTS = tuple(np.arange(2.0, 32.25, 0.5).tolist())

PERIODIC, FADING, STEPPED = ("wave", "clock"), ("decay", "signed_decay", "settle"), ("beyond", "signed_beyond", "above", "band", "latch")


def places(quantity: str, function: str, few: bool = False) -> tuple[float, ...]:
    """Places of a function's constant, as ``constant_at`` takes them; few: in a product."""
    if quantity == "turned" and function in PERIODIC:
        return TIMES_A_TURN
    if quantity == "time" and function in PERIODIC:
        return FEW_LINES if few else CLOCKS if function == "clock" else LINES
    if function in PERIODIC:
        return FEW_CYCLES if few else CYCLES
    if function == "saw":
        return COUNTS
    if function in ("above_point", "below_point"):
        return POINTS
    if function in FADING:
        return FEW_FADES if few else FADES
    if function in STEPPED and not few:
        return STEPS
    return FEW_SHARES if few else SHARES


def constant_at(quantity: str, function: str, place: float, largest: float) -> float:
    """The constant in the quantity's unit, for a given largest size of the quantity."""
    if quantity == "turned" and function in PERIODIC:
        return 2 * np.pi / place
    if function in PERIODIC:
        return _round((1.0 if quantity == "time" else 2.0) * largest / place)
    return _round(largest / place if function == "saw" else largest * place)


def lags_of(quantity: str, few: bool = False) -> tuple[float, ...]:
    """Lags in s for a quantity that may be lagged."""
    if quantity in ("temperature", "vibration", "temperature_rate"):
        return FEW_SLOW_LAGS_S if few else SLOW_LAGS_S
    return FEW_LAGS_S if few else LAGS_S


def _round(value: float) -> float:
    """Round to four digits: a readable constant that will be refined."""
    return float(f"{value:.4g}")


# Which functions of which quantities are tried: alone, in a product, and behind a lag.
#
# Known or possible errors of a Coriolis gyroscope and its package: nonlinearity of drive and sense (powers, roots, limits, dead zones of
# the rate), one axis' motion in another's channel (rate products, angular acceleration, jerk of a ringing mode), a skew mass (force, its
# products, force times rate), strain of the package (temperature, its rate, its lag), heat and charge left by a motion (lags of the
# rate's size and square, the decaying sense of the last turn), a supply that settles or is loaded periodically (time), hysteresis (play,
# latch), a field fixed in the world (level and world directions), and quantisation in a register (saw).

_POWERS = "itself size square signed_square cube size_cube root signed_root root_cube size_root_cube"
_LIMITS = "excess within soft beyond signed_beyond band"
_KINKS = "dead_zone excess hinge beyond above"
#: quantity -> names of functions separated by spaces
ALONE: dict[str, str] = {
    # A dead zone is the rate less the part held within it: in its own size it leaves the scale factor alone.
    "rate": f"{_POWERS} sign {_LIMITS} decay signed_decay wave saw play latch",
    "rate_size": "itself square cube root root_cube excess soft beyond decay wave",
    "force": f"{_POWERS} sign dead_zone {_LIMITS} wave play",
    "acceleration": f"{_POWERS} sign dead_zone {_LIMITS}",
    "acceleration_size": "itself square cube root root_cube excess soft beyond",
    "speed_slope": "itself size square signed_square cube",
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
    "speed_slope": "itself size",
    "jerk": "itself size",
    "temperature": "itself square size root beyond excess above_point below_point",
    "temperature_rate": "itself size",
    "time": "itself square root decay settle beyond wave",
    "rest": "itself root decay settle beyond",
    "vibration": "itself root square beyond",
    "turned": "itself wave",
    "sense": "itself",
    "level": "itself",
    "world": "",
}
#: functions that may be lagged, alone and in a product
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
    """(function, its constant's place on the grid, lag in s) for a quantity, alone or, if few, in a product."""
    plain, late = (TOGETHER, LAGGED_TOGETHER) if few else (ALONE, LAGGED)
    found: list[tuple[str, float | None, float | None]] = []
    for function in plain[quantity].split():
        grid: tuple[float | None, ...] = (None,) if FUNCTIONS[function].constant is None else places(quantity, function, few)
        found += [(function, place, None) for place in grid]
    for function in late.get(quantity, "").split():
        # Two grids at once have fewer places each.
        bent = FUNCTIONS[function].constant is not None
        at = places(quantity, function, few=True) if bent else (None,)
        found += [(function, place, lag_s) for place in at for lag_s in lags_of(quantity, few or bent)]
    return found


# The length of a form's description: the choices that the grammar offers at each place, in bits.
#
#     one factor or two | for each: quantity; itself or a function, and which; its constant's place on the grid; lag or none, and which |
#     pattern of axes, of those that such factors may have
#
# A choice among n costs log2(n); a yes or no costs one bit: a second factor, the quantity itself, a lag.  A law of one plain quantity costs
# seven bits, and a product of two lagged functions more than thirty.  The bits are those of the grammar and independent of the recording;
# constants count by their place on the grid.  Two to the power of minus the bits, summed over all forms, is below one, as for any code.


def bits(form: LawForm) -> float:
    """Description length of a form, whatever its constants are."""
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


# All forms of the grammar for a recording, each once.
#
# One factor: every function of every quantity, lagged where allowed.  Two factors: the plainer functions of both, with fewer places for
# constants.  Each comes in every pattern of axes that its factors allow.  Of forms that are equal by algebra (``LawForm.canonical``) the
# simplest is kept.  What is equal only in a recording is found there (``Screening.leaders``).

#: numbers of one axis that a product may have: more would give a dozen coefficients
MOST_EACH = 2
#: functions of the rate that are zero up to a threshold
OF_A_TURN = ("dead_zone", "excess", "beyond", "signed_beyond")

#: a factor independent of the recording: quantity, function, its constant's place, lag
Place = tuple[str, str, float | None, float | None]


def enumerated(largest: Mapping[str, float]) -> list[LawForm]:
    """Every form over these quantities, the simplest first; largest: by name, its largest size in the recording, 0 where it does not
    vary."""
    names = tuple(name for name in QUANTITIES if largest.get(name, 0.0) > 0)

    @cache
    def factor(place: Place) -> Factor:
        quantity, function, at, lag_s = place
        return Factor(quantity, function, None if at is None else constant_at(quantity, function, at, largest[quantity]), lag_s)

    forms = [LawForm(tuple(map(factor, places)), pattern) for places, pattern in (*_singles(names), *_products(names))]
    ones = (Factor("rate"),), (Factor("sense"), Factor("sense"))  # which a calibration spans
    spanned = {LawForm(factors, pattern).canonical for factors in ones for pattern in ("each", "full", "cross")}
    found: dict[tuple, LawForm] = {}
    for form in sorted(forms, key=bits):
        if form.canonical not in spanned:
            found.setdefault(form.canonical, form)
    return list(found.values())


def _singles(names: tuple[str, ...]) -> Iterator[tuple[tuple[Place, ...], str]]:
    for name in names:
        for function, at, lag_s in offered(name, few=False):
            plain = at is None and lag_s is None
            for pattern in patterns_of((_any(name, function),)):
                # A matrix over a decay or a step is not physical; nor is a matrix without its diagonal.
                if pattern == "each" or plain or (pattern == "full" and QUANTITIES[name].directions * FUNCTIONS[function].phases == 1):
                    yield ((name, function, at, lag_s),), pattern


def _products(names: tuple[str, ...]) -> Iterator[tuple[tuple[Place, ...], str]]:
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
    """Whether a product is worth enumerating.

    What follows the time since the last turn multiplies nothing that a turn alone has; a rate times the temperature from a point differs
    from that from another by a scale factor alone.  A wave multiplies a quantity as it is.  Of two factors with a constant on a grid, one
    must decay with time, as the after-effect of a motion or a settling supply does; any other pair of grids would be two searches in one.
    """
    quantities, plain = {one[0], other[0]}, ("rate", "itself", None, None)
    if "rest" in quantities and any(place[0] in ("rate", "rate_size") and place[1] in OF_A_TURN and not place[3] for place in (one, other)):
        return False
    if plain in (one, other) and {one[1], other[1]} & {"above_point", "below_point", "settle"}:
        return False
    if "wave" in (one[1], other[1]):
        return "itself" in (one[1], other[1]) and None in (one[3] or one[2], other[3] or other[2])
    searched = [any(value is not None for value in place[2:]) for place in (one, other)]
    return not all(searched) or (one[0] != other[0] and (_fades(one) or _fades(other)))


def _fades(place: Place) -> bool:
    return place[0] in ("time", "rest") and place[1] in FADING


@cache
def _any(quantity: str, function: str) -> Factor:
    """A factor of that kind with an arbitrary constant."""
    return Factor(quantity, function, None if FUNCTIONS[function].constant is None else 1.0)
