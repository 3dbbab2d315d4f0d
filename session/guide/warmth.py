"""Is it worth while to wait until the board is warm?  What its bias would drift by in what is left, going on now or in some minutes.

One calibration has one bias.  What counts is how far the bias spreads over all turns of the session, those that are recorded
included: who has recorded half of it cold gains nothing by a warm second half.  The temperature is taken to settle exponentially, as its
own last minutes show; what a degree does to the bias the stills show, and until they do, a data sheet says it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from session.common.units import MDPS
from session.detect.stills import Still
from session.guide.messages import AcceptedTurn

#: rad/s rms: a drift that moves no parameter by more than its target in 9 of 10 sessions (``benchmarks/warm_up.py``)
BAR_RPS = 4 * MDPS
#: rad/s per °C, as siblings' data sheets have it; what one still's rate says of the bias, the Earth's rotation in it
TYPICAL_RPS_PER_C, STILL_SIGMA_RPS = 5 * MDPS, 4 * MDPS
WAITS_MIN = range(1, 11)  #: who would wait longer records twice instead
SETTLES_S = np.geomspace(30.0, 2400.0, 25)  #: time constants that are tried
USUALLY_S, USUALLY_FACTOR = 150.0, 2.5  #: of a small board that heats itself, until more is seen
SEGMENT_S = 8.0  #: from still to still, at the table
EVERY_S, OVER_S = 2.0, 300.0
LEAST_S = 20.0
LEAST_SIGMA_C = 0.005  #: of a mean over some hundred readings


@dataclass(frozen=True)
class Wait:
    """What waiting gains: minutes of it; rms of the bias' drift over the session, rad/s, going on now and after them; minutes left."""

    minutes: int
    now_rps: float
    then_rps: float
    left_min: float

    @property
    def words(self) -> str:
        """Both ways, in figures."""
        now, then = self.now_rps / MDPS, self.then_rps / MDPS
        return (
            f"wait {self.minutes} min, and the bias drifts by {then:.1f} mdps; going on now ({self.left_min:.0f} min), "
            f"by {now:.1f} (bar {BAR_RPS / MDPS:g})"
        )


@dataclass(frozen=True)
class Settling:
    """The temperature: now, °C; how much is still to come; time constant, s."""

    now_c: float
    to_come_c: float
    settles_s: float

    def at(self, later_s: np.ndarray) -> np.ndarray:
        """°C, so many seconds later."""
        return self.now_c - self.to_come_c * np.expm1(-later_s / self.settles_s)


class Warmth:
    """Fed with temperatures as they come; ``wait`` says whether it pays."""

    def __init__(self) -> None:
        self._temps: deque[tuple[float, float]] = deque(maxlen=round(OVER_S / EVERY_S))
        self._said: tuple[tuple[float, int, int], Wait | None] | None = None

    def feed(self, t_s: float, temp_c: float) -> None:
        """A mean over some readings."""
        if not self._temps or t_s - self._temps[-1][0] >= EVERY_S:
            self._temps.append((t_s, temp_c))

    def new_log(self) -> None:
        """The device's clock has begun anew."""
        self._temps.clear()
        self._said = None

    def wait(self, turns: Sequence[AcceptedTurn], stills: Sequence[Still], segments_left: int) -> Wait | None:
        """None where waiting gains nothing that matters, or too little is known.  Asked often, it answers anew as temperatures come."""
        if len(self._temps) < 3 or self._temps[-1][0] - self._temps[0][0] < LEAST_S or segments_left <= 0:
            return None
        about = (self._temps[-1][0], len(stills), segments_left)
        if self._said is None or self._said[0] != about:
            turned_c = np.array([np.mean([still.temp_c for still in turn.segment.stills]) for turn in turns])
            self._said = about, worth_waiting(settling(np.array(self._temps)), turned_c, rps_per_c(stills), segments_left)
        return self._said[1]


def settling(temps: np.ndarray) -> Settling:
    """From temps (N, 2), s and °C: the exponential that suits them best."""
    t_s, temp_c = temps.T
    x = np.exp(-(t_s - t_s[-1]) / SETTLES_S[:, None])
    x_mean, mean_c = x.mean(axis=1, keepdims=True), temp_c.mean()
    slope = (x - x_mean) @ (temp_c - mean_c) / np.sum((x - x_mean) ** 2, axis=1)
    misses = temp_c - mean_c - slope[:, None] * (x - x_mean)
    squares = np.sum(misses**2, axis=1)
    variance = max(LEAST_SIGMA_C**2, float(squares.min()) / max(len(temps) - 2, 1))
    best = int(np.argmin(squares / variance + (np.log(SETTLES_S / USUALLY_S) / np.log(USUALLY_FACTOR)) ** 2))
    return Settling(float(mean_c + slope[best] * (1 - x_mean[best, 0])), float(-slope[best]), float(SETTLES_S[best]))


def rps_per_c(stills: Sequence[Still]) -> float:
    """What a degree does to the bias of the axis where it does most: as the stills show it, and as typical where they do not yet."""
    stills = [still for still in stills if np.isfinite(still.temp_c)]
    temp_c = np.array([still.temp_c for still in stills])
    rate = np.array([still.gyro_mean for still in stills]).reshape(-1, 3)
    moved_c = temp_c - temp_c.mean() if len(temp_c) else temp_c
    told = float(moved_c @ moved_c) / STILL_SIGMA_RPS**2
    variance = 1 / (told + TYPICAL_RPS_PER_C**-2)
    mean = variance * (moved_c @ rate) / STILL_SIGMA_RPS**2
    return float(np.sqrt(np.max(np.abs(mean)) ** 2 + variance))


def worth_waiting(temperature: Settling, turned_c: np.ndarray, each_rps: float, segments_left: int) -> Wait | None:
    """The least whole minutes after which the drift stays within the bar, or is half; None where it does anyhow, or none will do.

    turned_c (N,): temperature of each turn that counts; each_rps: what a degree does to the bias.
    """
    turned_c = turned_c[np.isfinite(turned_c)]
    later_s = SEGMENT_S * np.arange(1, segments_left + 1)

    def drift(minutes: float) -> float:
        return each_rps * float(np.std(np.concatenate([turned_c, temperature.at(60 * minutes + later_s)])))

    now_rps = drift(0.0)
    if now_rps <= BAR_RPS:
        return None
    then_rps = np.array([drift(minutes) for minutes in WAITS_MIN])
    enough = then_rps <= (BAR_RPS if then_rps.min() <= BAR_RPS else now_rps / 2)
    if not enough.any():
        return None
    first = int(np.argmax(enough))
    return Wait(WAITS_MIN[first], now_rps, float(then_rps[first]), float(later_s[-1]) / 60)
