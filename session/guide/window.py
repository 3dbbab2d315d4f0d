"""The samples since the last reference stills, and what ``session.detect.stills`` and ``session.detect.segments`` make of them.

The very code that will judge the recorded log judges it here: what the guide accepts, the fit accepts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import NS
from session.detect.blocks import block_size
from session.detect.segments import Segment, cut_segments
from session.detect.stills import MIN_STILL_FRACTION, Noise, Still, find_stills
from session.log.config import Protocol, Sensor
from session.log.samples import Samples, joined

REFERENCES = 3  #: stills that are kept: their noise is the yardstick
LONGEST_REST_S = 20.0  #: of a still that lasts, the last part is kept
SETTLED_S = 0.5  #: a still that ended longer ago is not the present one


@dataclass(frozen=True, eq=False)
class Examined:
    """The present still, or why there is none; segment that it ends, None for a log's first still; samples that both count from."""

    samples: Samples
    still: Still | None
    why: str = ""
    noise: Noise | None = None
    segment: Segment | None = None


class Window:
    """The recent part of one log.  period_s: the usual time between two samples."""

    def __init__(self, sensor: Sensor, protocol: Protocol, period_s: float):
        self._sensor, self._protocol = sensor, protocol
        self._size, self._period_s = block_size(period_s), period_s
        self._parts: list[Samples] = []
        self._starts_ns: list[int] = []  # of the reference stills in it

    @property
    def has_reference(self) -> bool:
        """Whether a still was accepted."""
        return bool(self._starts_ns)

    def feed(self, samples: Samples) -> None:
        """Later samples."""
        self._parts.append(samples)

    def examine(self) -> Examined:
        """What stands at the window's end."""
        samples = self._whole()
        stills, noise = find_stills(samples, self._protocol.still_s)
        still = stills[-1] if stills else None
        late_s = SETTLED_S + self._size * self._period_s
        if still is None or samples.t_ns[-1] - samples.t_ns[still.stop - 1] > late_s / NS:
            return Examined(samples, None, f"still for less than {MIN_STILL_FRACTION * self._protocol.still_s:.1f} s")
        if still.problem:
            return Examined(samples, None, still.problem)
        segments = cut_segments(samples, stills, self._sensor, self._protocol) if self._starts_ns else []
        return Examined(samples, still, "", noise, segments[-1] if segments else None)

    def accept(self, examined: Examined) -> None:
        """The present still is a reference from now on; what lies before the last few is forgotten."""
        assert examined.still is not None
        self._starts_ns = [*self._starts_ns, int(examined.samples.t_ns[examined.still.start])][-REFERENCES:]
        self._forget_before(self._starts_ns[0])

    def rest(self, still_s: float) -> None:
        """The present still, a reference, has lasted for still_s: of a long one only the last part is kept."""
        if still_s > 2 * LONGEST_REST_S and self._starts_ns and self.duration_s > 2 * LONGEST_REST_S:
            keep_ns = int(self._parts[-1].t_ns[-1]) - round(LONGEST_REST_S / NS)
            self._starts_ns = [keep_ns]
            self._forget_before(keep_ns)

    @property
    def duration_s(self) -> float:
        """Of what is kept, s."""
        return float(self._parts[-1].t_ns[-1] - self._parts[0].t_ns[0]) * NS if self._parts else 0.0

    def _forget_before(self, t_ns: int) -> None:
        samples = self._whole()
        first = int(np.searchsorted(samples.t_ns, t_ns)) // self._size * self._size  # blocks stay where they were
        self._parts = [samples.between(first, len(samples))]

    def _whole(self) -> Samples:
        if len(self._parts) > 1:
            self._parts = [joined(self._parts)]
        return self._parts[0]
