"""Options of a simulated rest log."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite

from session.base.errors import CalibrationError
from tinygc.simulation.options import choice

#: beyond any sensor; larger values would overflow
LARGEST = {
    "zero_dps": 1e4,
    "slope_dps_per_c": 100.0,
    "bend_dps_per_c2": 10.0,
    "lag_s": 1e5,
    "hysteresis_dps": 1e4,
    "random_walk_dps_rts": 100.0,
}
MOST_KNOCKS = 100_000


@dataclass(frozen=True)
class RestOptions:
    """Options of one simulated rest log; temperature effects have the same size on every axis, with the signs +, −, + for x, y, z."""

    cycles: float = choice(0.0, "of the temperature in the rest log; 0: a session with turns is simulated")
    cycle_s: float = choice(3600.0, "s, length of a cycle")
    cold_c: float = choice(-10.0, "degC, coldest, where it begins")
    warm_c: float = choice(70.0, "degC, warmest")
    zero_dps: tuple[float, float, float] = choice((0.5, -0.3, 0.6), "dps, the zero in the middle of the range")
    slope_dps_per_c: float = choice(0.03, "dps/degC, how the zero follows the element's temperature")
    bend_dps_per_c2: float = choice(2e-4, "dps/degC^2, its curvature")
    lag_s: float = choice(0.0, "s, by which the element is behind the temperature reading; negative: ahead of it")
    hysteresis_dps: float = choice(0.0, "dps, between the way up and the way down")
    random_walk_dps_rts: float = choice(0.0, "dps/sqrt(s), how the zero wanders besides")
    noise_per_c: float = choice(0.0, "1/degC, how the white noise grows with temperature")
    knocks: int = choice(0, "blows of a tenth of a second")

    def __post_init__(self) -> None:
        for option in fields(self):
            value = getattr(self, option.name)
            numbers = value if isinstance(value, tuple) else (value,)
            self._require(all(isfinite(number) for number in numbers), option.name, "finite numbers")
        self._require(0 <= self.cycles <= 1000, "cycles", "0 to 1000")
        self._require(10 <= self.cycle_s <= 1e7, "cycle_s", "10 to 1e7")
        self._require(-40 <= self.cold_c <= self.warm_c <= 105, "cold_c", "at most warm_c, both within the sensor's range, -40 to 105 degC")
        for name, most in LARGEST.items():
            value = getattr(self, name)
            fine = all(abs(number) <= most for number in (value if isinstance(value, tuple) else (value,)))
            self._require(fine, name, f"within {most:g}")
        self._require(self.random_walk_dps_rts >= 0, "random_walk_dps_rts", "0 or more")
        self._require(abs(self.noise_per_c) * (self.warm_c - self.cold_c) < 2, "noise_per_c", "less: the noise would be negative")
        self._require(0 <= self.knocks <= MOST_KNOCKS, "knocks", f"0 to {MOST_KNOCKS}")

    def _require(self, fine: bool, name: str, expected: str) -> None:
        if not fine:
            raise CalibrationError(f"{rest_flag(name)} is {getattr(self, name)!r}, expected {expected}")


def rest_flag(name: str) -> str:
    """Return the command line's flag of an option."""
    return "--rest-" + name.replace("_", "-")
