"""The log that grows at this moment: its first second is looked at, then it is taken block by block."""

from __future__ import annotations

from collections.abc import Iterator

from session.common.units import NS
from session.detect.blocks import block_size
from session.detect.pace import Pace, pace_of
from session.guide.stillness import Block, Stillness
from session.guide.stream_check import CHECK_S, FEWEST, stream_problem
from session.guide.turn_in_progress import TurnInProgress
from session.guide.window import Examined, Window
from session.log.config import Protocol, Sensor
from session.log.samples import Samples, joined


class PresentLog:
    """turn: what the table does now; why: what its last block showed; peak_ns: when the present turn was fastest; began_ns: the first
    sample; dropped_ns: moments of turns that will not count; refused: whether the last turn does not."""

    def __init__(self) -> None:
        self.turn = TurnInProgress()
        self.why = ""
        self.began_ns = self.peak_ns = self._now_ns = 0
        self.dropped_ns: list[int] = []
        self.refused = False
        self._period_s = 0.0
        self._pace: Pace | None = None
        self._pending: list[Samples] = []
        self._window: Window | None = None
        self._stillness: Stillness | None = None

    @property
    def now_s(self) -> float:
        """Since it began."""
        return (self._now_ns - self.began_ns) * NS

    @property
    def checked_s(self) -> float:
        """Of samples that wait to be looked at."""
        return sum(part.duration_s for part in self._pending)

    @property
    def window(self) -> Window:
        """The recent part of the log; there is one as soon as its stream has been looked at."""
        assert self._window is not None
        return self._window

    @property
    def pace(self) -> Pace:
        """Of its stamps, there as soon."""
        assert self._pace is not None
        return self._pace

    @property
    def _at_rest(self) -> Stillness:
        """The judge of blocks, there as soon."""
        assert self._stillness is not None
        return self._stillness

    def add(self, samples: Samples) -> None:
        """Samples that have come."""
        self._pending.append(samples)

    @property
    def pending(self) -> Samples:
        """What has come, and is not in a block yet."""
        return joined(self._pending)

    def look(self, sensor: Sensor, protocol: Protocol, calibrated: bool) -> str | None:
        """What is wrong with the stream, which then is looked at anew; empty where nothing is; None while too little has come."""
        pending = self.pending
        if pending.duration_s < CHECK_S or len(pending) < FEWEST:
            return None
        if problem := stream_problem(pending, sensor.odr_hz, sensor.accel_fs_g, calibrated):
            self._pending = []
            return problem
        if self._window is None:
            self._period_s, self.began_ns, self._now_ns = pending.period_s, int(pending.t_ns[0]), int(pending.t_ns[0])
            self._pace = pace_of(pending.t_ns)
            self._window = Window(sensor, protocol, self._period_s)
            self._stillness = Stillness(self._period_s)
        return ""

    def blocks(self) -> Iterator[Samples]:
        """Whole blocks of what has come; the rest waits."""
        pending, size = self.pending, block_size(self._period_s)
        whole = len(pending) // size * size
        self._pending = [pending.between(whole, len(pending))]
        for first in range(0, whole, size):
            yield pending.between(first, first + size)

    def take(self, samples: Samples, remember: bool) -> tuple[Block, float]:
        """A block: what it shows, and how long the still was that it ends, or 0.  remember: it may be part of a segment."""
        self._now_ns = int(samples.t_ns[-1])
        if remember:
            self.window.feed(samples)
        block = self._at_rest.feed(samples)
        self.why = block.why
        ended_s = self.turn.feed(block, self._at_rest.zero_rps)
        if block.peak_rps == self.turn.peak_rps:
            self.peak_ns = int(samples.t_ns[len(samples) // 2])
        return block, ended_s

    def accept(self, examined: Examined) -> None:
        """The present still is a reference."""
        assert examined.still is not None
        self.window.accept(examined)
        self._at_rest.zero_rps = examined.still.gyro_mean
        self.turn.accepted_still()
