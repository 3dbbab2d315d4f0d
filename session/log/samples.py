"""The plain record that everything else works on.  A simulated one cannot be told from a recorded one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from session.common.units import NS
from session.log.readings import pick


@dataclass(frozen=True, eq=False)
class Samples:
    """Consecutive readings of one log, in the order of time.

    t_ns (N,) int64, device time, increasing; gyro (N, 3) rad/s, measured rate m; accel (N, 3) m/s^2, specific force as
    measured or, after ``with_accel``, as pre-calibrated; temp_c (N,) degC, or None where the log has none.  Of a file the last three are
    ``Readings``, which act as such arrays: what is done to a whole log goes through their ``pieces``.
    """

    t_ns: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    temp_c: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"<Samples {len(self)}, {self.duration_s:.1f} s>"

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def dt_s(self) -> np.ndarray:
        """(N-1,) s between neighbouring samples."""
        return np.diff(self.t_ns) * NS

    @property
    def t_s(self) -> np.ndarray:
        """(N,) s since the first sample."""
        return (self.t_ns - self.t_ns[0]) * NS if len(self) else np.zeros(0)

    @cached_property
    def period_s(self) -> float:
        """The usual time between two samples (median), in s; looked up often, computed once."""
        return float(np.median(np.diff(self.t_ns))) * NS

    @property
    def duration_s(self) -> float:
        """From the first sample to the last, s."""
        return float(self.t_ns[-1] - self.t_ns[0]) * NS if len(self) else 0.0

    def with_accel(self, accel: np.ndarray) -> Samples:
        """The same samples with another specific force (N, 3)."""
        return replace(self, accel=accel)

    def between(self, start: int, stop: int) -> Samples:
        """Samples start <= i < stop."""
        part = slice(start, stop)
        return Samples(self.t_ns[part], self.gyro[part], self.accel[part], None if self.temp_c is None else self.temp_c[part])

    def pick(self, which: np.ndarray) -> Samples:
        """Some of them, by mask or index, kept as they are kept."""
        temp_c = None if self.temp_c is None else pick(self.temp_c, which)
        return Samples(self.t_ns[which], pick(self.gyro, which), pick(self.accel, which), temp_c)


def start_times(logs: Iterable[Samples]) -> np.ndarray:
    """(L + 1,) s of the session at which each log begins, laid one after the other, and at which the last one ends."""
    return np.cumsum([0.0] + [samples.duration_s for samples in logs])


def joined(parts: list[Samples]) -> Samples:
    """Parts of one log, in their order, as one."""
    temps = [part.temp_c for part in parts if part.temp_c is not None]
    temp_c = np.concatenate(temps) if len(temps) == len(parts) else None
    t_ns, gyro, accel = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t_ns", "gyro", "accel"))
    return Samples(t_ns, gyro, accel, temp_c)
