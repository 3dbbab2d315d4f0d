"""The noise at rest that units share: what all read alike is the body's motion, what each reads by itself is its sensor's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.special import ndtr

from session.base.numeric import sigmas_in
from session.base.units import NS
from session.detect.stills import BLOCK_S, SessionStills, references
from session.log.folder import Session
from tinygc.features.arrays.clocks import UnitClock
from tinygc.inference.choose import ONE_SIDED, Statement, standing_of

#: most groups of stills that are left out in turn
GROUPS = 20
#: variance of a correlation of N differences of white noise, times N: 1 + 2 * 0.5^2, as neighbours are correlated by -0.5
OF_DIFFERENCES = 1.5
#: fewest differences: with 50 a correlation is known to 0.17
FEWEST = 50
#: share above which noise is mostly the one's or the other's
HALF = 0.5


@dataclass(frozen=True, eq=False)
class SharedNoise:
    """Correlation of noise at rest between units, in the band of means of 0.1 s.

    value: mean of all pairs of units, over all axes, and its sigma.
    """

    value: float
    sigma: float

    @property
    def p_value(self) -> float:
        """Of as much by chance, one-sided."""
        return float(ndtr(-self.value / self.sigma))

    @property
    def upper(self) -> float:
        """Upper 95 % limit."""
        return min(max(self.value, 0.0) + ONE_SIDED * self.sigma, 1.0)

    @property
    def is_own(self) -> bool:
        """Whether less than half of the noise is common, with 95 %."""
        return self.upper < HALF

    @property
    def is_common(self) -> bool:
        """Whether more than half of the noise is common, with 95 %."""
        return self.value - ONE_SIDED * self.sigma > HALF

    def statement(self, what: str) -> Statement:
        """Return the standing of a motion of the body in the noise of ``what``; half of its power is what matters."""
        standing = standing_of(self.p_value, upper=self.upper, matters=HALF)
        size = f"{100 * self.value:.1f} ± {100 * self.sigma:.1f} % of its power"
        test = "correlation between units"
        return Statement(f"motion of the body in the {what} noise at rest", standing, test, self.p_value, size, f"{100 * self.upper:.1f} %")

    @property
    def source(self) -> str:
        """Whose noise it is, in words no stronger than the limits."""
        if self.is_own:
            return "it is mostly the sensors' own"
        if self.is_common:
            return "it is mostly the body's motion: a table, a floor or a hand moves it"
        return "whether it is the sensors' or the body's is not told"


def shared_noise(
    sessions: Sequence[Session], clocks: Sequence[UnitClock], maps: Sequence[np.ndarray], accelerometer: bool
) -> SharedNoise | None:
    """Correlate the units' readings in the first one's stills; None where these are too short."""
    groups: list[list[np.ndarray]] = []
    first = SessionStills(sessions[0])
    for number, log in enumerate(sessions[0].logs):
        if any(number >= len(session.logs) for session in sessions):
            continue
        totals = []  # times (N,) s, and the integral of the readings (N, 3) over them, of each unit
        for session, clock, matrix in zip(sessions, clocks, maps, strict=True):
            samples = session.logs[number].samples
            t_s, readings = clock.array_time(samples.t_ns * NS), np.asarray(samples.accel if accelerometer else samples.gyro)
            totals.append((t_s, cumulative_trapezoid(readings @ matrix.T, t_s, axis=0, initial=0.0)))
        begins_s = float(log.samples.t_ns[0]) * NS
        for still in references(first.of(log).stills):
            edges = begins_s + still.start_s + np.arange(0, still.duration_s, BLOCK_S)
            if len(edges) > 2 and all(t_s[0] <= edges[0] and edges[-1] <= t_s[-1] for t_s, _ in totals):
                at = [np.column_stack([np.interp(edges, t_s, axis) for axis in total.T]) for t_s, total in totals]
                groups.append([np.diff(np.diff(each, axis=0) / BLOCK_S, axis=0) for each in at])
    return None if not groups else correlated(groups)


def noise_at_rest(
    sessions: Sequence[Session], clocks: Sequence[UnitClock], gyros: Sequence[np.ndarray], accelerometers: Sequence[np.ndarray]
) -> dict[str, SharedNoise]:
    """Return what the noise at rest of the units has in common, by sensor; without those whose stills are too short.

    gyros, accelerometers: of each unit (3, 3), from its readings to one set of axes.
    """
    found = {
        "gyro": shared_noise(sessions, clocks, gyros, accelerometer=False),
        "accelerometer": shared_noise(sessions, clocks, accelerometers, accelerometer=True),
    }
    return {name: each for name, each in found.items() if each is not None}


def correlated(groups: Sequence[Sequence[np.ndarray]]) -> SharedNoise | None:
    """Correlate differences (M, 3) of each unit, in each of several groups (stills); the sigma is the jackknife's over the groups, and at
    least that of white noise without correlation."""
    units = len(groups[0])
    products = np.array([[[np.sum(a * b) for b in group] for a in group] for group in groups])
    count = sum(len(group[0]) for group in groups)
    if count < FEWEST:
        return None
    above = np.triu_indices(units, 1)
    value = float(_correlation(products.sum(axis=0))[above].mean())
    parts = np.array([part.sum(axis=0) for part in np.array_split(products, min(GROUPS, len(products)))])
    without = np.array([_correlation(products.sum(axis=0) - part)[above].mean() for part in parts]) if len(parts) > 1 else np.array([value])
    spread = np.sqrt((len(without) - 1) / len(without) * np.sum((without - without.mean()) ** 2))
    chance = np.sqrt(OF_DIFFERENCES / (3 * count * len(above[0])))
    return SharedNoise(value, float(max(spread, chance)))


def _correlation(products: np.ndarray) -> np.ndarray:
    size = sigmas_in(products)
    return products / np.maximum(np.outer(size, size), 1e-300)
