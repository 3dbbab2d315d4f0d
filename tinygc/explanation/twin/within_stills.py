"""What happens within each still: a constant rate with the measured noise is predicted, so no slope, and everywhere the same scatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import NS
from tinygc.explanation.twin.twin import Twin

#: s: longer than a gyro's low-pass of some 10 Hz and more remembers, short enough for ten and more in a still; as ``session.detect`` has it
BLOCK_S = 0.1
#: variance of the mean square of first differences of white noise, times the number of differences, in that mean square squared
DIFFERENCES = 3.0


@dataclass(frozen=True, eq=False)
class WithinStills:
    """slope, scatter (Q, 3): recorded less predicted in sigmas of the noise, for each still and axis."""

    slope: np.ndarray
    scatter: np.ndarray

    def rms(self, name: str) -> float:
        """Root mean square of ``slope`` or ``scatter``, in sigmas."""
        return float(np.sqrt(np.mean(getattr(self, name) ** 2)))


def within_stills(twin: Twin) -> WithinStills:
    """Slope of the rate, and mean square of the differences of 0.1 s means, against the angle random walk of the log."""
    slopes, scatters = [], []
    logs = twin.problem.logs
    as_recorded = [(log, still) for log in range(len(logs)) for still in logs[log].stills if still.problem is None and twin.stills]
    for log, still in as_recorded:
        samples, walk = logs[log].samples, logs[log].noise.angle_random_walk
        rate = samples.gyro[still.start : still.stop]
        t_s = (samples.t_ns[still.start : still.stop] - samples.t_ns[0]) * NS
        from_middle = t_s - t_s.mean()
        slope = from_middle @ rate / (from_middle @ from_middle)
        slopes.append(slope / (walk * np.sqrt(12 / still.duration_s**3)))
        size = max(round(BLOCK_S / samples.period_s), 1)
        count = len(rate) // size
        difference = np.diff(rate[: count * size].reshape(count, size, 3).mean(axis=1), axis=0)
        expected = 2 * walk**2 / (size * samples.period_s)
        ratio = np.mean(difference**2, axis=0) / expected if count > 1 else np.ones(3)
        scatters.append((ratio - 1) / np.sqrt(DIFFERENCES / max(count - 1, 1)))
    return WithinStills(np.array(slopes), np.array(scatters))
