"""Which functions of which quantities are tried: alone, in a product, and behind a lag.

What a Coriolis gyroscope and its package are known to do, or could: the drive's and the sense's nonlinearity (powers, roots, limits, dead
zones of the rate), one axis' motion in another's channel (rate products, angular acceleration, jerk of a mode that rings), a mass that
hangs askew (force, its products, force times rate), strain of the package (temperature, its rate, its lag), heat and charge that a motion
leaves behind (lags of the rate's size and square, the sense of the last turn, which fades), a supply that settles or is loaded to a
clock (time), hysteresis (play, latch), a field that is fixed in the world (level and world directions), and a register that rounds (saw).
"""

from __future__ import annotations

from tinygc.discovery.grammar.functions import FUNCTIONS
from tinygc.discovery.grammar.grids import lags_of, places

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
