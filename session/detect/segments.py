"""Segments: from the middle of one still to the middle of the next.

Cut there, every sample is used exactly once, neighbours share no gyro noise, and a still that serves two turns gives half of itself
to each: with the protocol's still 1 s, turn 3 s, still 1 s, forty times, that is the 5 s window.  A still that is no reference is
passed over: the two turns around it become one longer segment.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from session.common.units import DEG, NS
from session.detect.clipping import clips, gyro_reach_dps
from session.detect.stills import Still
from session.log.config import Protocol, Sensor
from session.log.samples import Samples

GAP_PERIODS = 2.5  #: a longer step between two stamps is a gap
LEAST_MARGIN_S = 0.1  #: of stillness at each end of a turn that fills the window: what one block of the detector may be late
LONGEST_TURN_SEGMENTS = 6.0  #: times the protocol's segment: beyond that it is a run, not a segment


@dataclass(frozen=True, eq=False)
class Segment:
    """Samples ``start <= i < stop`` of one log between two stills (numbers into the log's list of stills).

    number counts from 0 over all logs; turn_start, turn_stop bound the movement; note says what is unusual; problem says why it is
    not used, or is None; breaks_yaw: integrating it tells nothing of the attitude after it.  first and last are None between moments of
    a truth file (``session/log/truth.py``).
    """

    number: int
    log: int
    first: Still | None
    last: Still | None
    start: int
    stop: int
    start_s: float
    duration_s: float
    turn_s: float
    turn_deg: float
    note: str | None = None
    problem: str | None = None
    breaks_yaw: bool = False

    @property
    def accepted(self) -> bool:
        """Whether it is used."""
        return self.problem is None

    @property
    def stills(self) -> tuple[Still, Still]:
        """The two between which it lies; a segment between moments of a truth file has none, and is not asked."""
        assert self.first is not None
        assert self.last is not None
        return self.first, self.last


def cut_segments(
    samples: Samples,
    stills: list[Still],
    sensor: Sensor,
    protocol: Protocol,
    *,
    log: int = 0,
    number: int = 0,
    put_in: np.ndarray | None = None,
) -> list[Segment]:
    """All segments of one log, accepted or with the reason why not, in order; ``number`` is given to the first; put_in (N,) bool: samples
    that are no readings, but what was put in their place."""
    references = [still for still in stills if still.problem is None]
    starts = [still.start for still in stills]
    segments: list[Segment] = []
    for first, last in pairwise(references):
        passed = stills[bisect_right(starts, first.start) : bisect_left(starts, last.start)]
        segments.append(_cut(samples, first, last, passed, sensor, protocol, log, number + len(segments), put_in))
    return segments


def _cut(
    samples: Samples,
    first: Still,
    last: Still,
    passed: list[Still],
    sensor: Sensor,
    protocol: Protocol,
    log: int,
    number: int,
    put_in: np.ndarray | None,
) -> Segment:
    start, stop = _window(samples, first, last, protocol)
    turn = slice(first.stop, last.start + 1)
    t_s = (samples.t_ns[turn] - samples.t_ns[first.stop - 1]) * NS
    turn_s = float(t_s[-1])
    bias = (first.gyro_mean + last.gyro_mean) / 2
    rate = np.linalg.norm(samples.gyro[turn] - bias, axis=1)
    turn_deg = float(np.trapezoid(rate, t_s)) / DEG
    duration_s = float(samples.t_ns[stop - 1] - samples.t_ns[start]) * NS
    broken = why_broken(samples, turn, sensor, put_in)
    return Segment(
        number=number,
        log=log,
        first=first,
        last=last,
        start=start,
        stop=stop,
        start_s=float(samples.t_ns[start] - samples.t_ns[0]) * NS,
        duration_s=duration_s,
        turn_s=turn_s,
        turn_deg=turn_deg,
        note=_note(passed, turn_s, turn_deg, protocol),
        problem=broken or _too_long(duration_s, protocol),
        breaks_yaw=broken is not None,
    )


def _window(samples: Samples, first: Still, last: Still, protocol: Protocol) -> tuple[int, int]:
    """The protocol's window, centred on the turn; longer where the turn is, and never beyond the middles of the stills."""
    turn_s = (samples.t_ns[last.start] - samples.t_ns[first.stop - 1]) * NS
    margin = round(max((protocol.segment_s - turn_s) / 2, LEAST_MARGIN_S) / samples.period_s)
    start = max(first.stop - 1 - margin, first.middle)
    stop = min(last.start + margin, last.middle) + 1  # neighbours share the middle sample: the step between is nobody's else
    return start, stop


def _note(passed: list[Still], turn_s: float, turn_deg: float, protocol: Protocol) -> str | None:
    if passed:
        return f"passes over a still that {passed[0].problem}"
    usual = protocol.segment_s - 2 * protocol.still_s
    if turn_deg < 2.0:
        return f"hardly a turn ({turn_deg:.1f} deg): a bump?"
    if turn_s > 2 * usual:
        return f"a long or double turn ({turn_s:.1f} s, {turn_deg:.0f} deg)"
    return None


def why_broken(samples: Samples, turn: slice, sensor: Sensor, put_in: np.ndarray | None = None) -> str | None:
    """Why the movement cannot be integrated, or None; put_in (N,) bool: samples that are no readings."""
    steps = np.diff(samples.t_ns[max(turn.start - 1, 0) : turn.stop]) * NS
    if len(steps) and (worst := steps.max()) > GAP_PERIODS * samples.period_s:
        lost = round(worst / samples.period_s) - 1
        return f"{lost} samples are missing during the turn (gap of {worst:.3f} s)"
    rate_dps = np.abs(samples.gyro[turn]) / DEG
    if put_in is not None:  # beyond the register's end, perhaps, but not clipped any more
        rate_dps = np.where(put_in[turn][:, None], 0.0, rate_dps)
    clipped = [clips(rate_dps[:, i], sensor.gyro_fs_dps, gyro_reach_dps(sensor)) for i in range(3)]
    if any(clipped):
        axes = ", ".join(axis for axis, bad in zip("xyz", clipped, strict=True) if bad)
        return f"the gyro clips at {rate_dps[:, clipped].max():.0f} dps on {axes}: turn slower or choose a larger full scale"
    return None


def _too_long(duration_s: float, protocol: Protocol) -> str | None:
    if duration_s > LONGEST_TURN_SEGMENTS * protocol.segment_s:
        return f"{duration_s:.0f} s from still to still: too long for a segment; make it a closure run"
    return None
