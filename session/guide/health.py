"""How the stream does: what was lost, the true data rate, the temperature and its slope."""

from __future__ import annotations

from collections import Counter, deque

import numpy as np

from session.common.units import NS
from session.detect.pace import Pace
from session.detect.segments import GAP_PERIODS
from session.guide.warmth import Warmth
from session.log.samples import Samples

SLOPE_OVER_S = 60.0
LEAST_SLOPE_S = 10.0
TEMP_EVERY_S = 1.0


class Health:
    """Counts over a session.  troubles: by kind, as the stream's decoder names them."""

    def __init__(self) -> None:
        self.samples = self.gaps = 0
        self.troubles: Counter[str] = Counter()
        self._extra = 0  # periods that the steps hold beyond one each
        self.temp_c: float | None = None
        self.warmth = Warmth()
        self.info_odr_hz: float | None = None  #: what the board says
        self.clock_ratio: float | None = None  #: seconds of device time in one of the host's
        self._periods, self._periods_s = 0, 0.0
        self._last_ns: int | None = None
        self._temps: deque[tuple[float, float]] = deque(maxlen=round(SLOPE_OVER_S / TEMP_EVERY_S))

    def feed(self, samples: Samples, pace: Pace) -> None:
        """Samples of the log, whose pace it is; those that it has had already do not count again."""
        samples = (
            samples if self._last_ns is None else samples.between(int(np.searchsorted(samples.t_ns, self._last_ns, "right")), len(samples))
        )
        if len(samples) == 0:
            return
        t_ns = samples.t_ns if self._last_ns is None else np.concatenate([[self._last_ns], samples.t_ns])
        steps = np.diff(t_ns) * NS
        steps = steps[steps > 0]
        periods, whole = pace.periods(steps), steps <= GAP_PERIODS * pace.period_s
        self.gaps += int(np.sum(~whole))
        self._extra += int(np.sum(periods - 1))
        self._periods += int(periods[whole].sum())
        self._periods_s += float(steps[whole].sum())
        self.samples, self._last_ns = self.samples + len(samples), int(samples.t_ns[-1])
        if samples.temp_c is not None:
            self._feel(samples.t_ns[-1] * NS, float(np.mean(samples.temp_c[-200:])))

    def new_log(self) -> None:
        """The device's clock has begun anew."""
        self._last_ns = None
        self._temps.clear()
        self.warmth.new_log()

    @property
    def missing(self) -> int:
        """Samples that are missing between the stamps, in gaps and singly."""
        return max(self._extra, 0)

    @property
    def odr_hz(self) -> float | None:
        """True data rate by the stamps, gaps left out."""
        return self._periods / self._periods_s if self._periods else None

    @property
    def odr_by_host_hz(self) -> float | None:
        """The same by the host's clock."""
        return self.odr_hz * self.clock_ratio if self.odr_hz and self.clock_ratio else None

    @property
    def temp_slope(self) -> float | None:
        """°C per minute over the last minute; None until there is enough of it."""
        if len(self._temps) < 3 or self._temps[-1][0] - self._temps[0][0] < LEAST_SLOPE_S:
            return None
        t_s, temp_c = np.array(self._temps).T
        centred = t_s - t_s.mean()
        return float(60 * (centred @ temp_c) / (centred @ centred))

    def _feel(self, t_s: float, temp_c: float) -> None:
        self.temp_c = temp_c if self.temp_c is None else 0.9 * self.temp_c + 0.1 * temp_c
        if not self._temps or t_s - self._temps[-1][0] >= TEMP_EVERY_S:
            self._temps.append((t_s, temp_c))
        self.warmth.feed(t_s, temp_c)
