"""Segments (from the middle of one still to the middle of the next), the pace of the stamps, and known turns among them."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from session.base.progress import Reporter, no_report
from session.base.rotation import angle_between
from session.base.texts import command_line
from session.base.units import DEG, NS
from session.detect.events import clips, gyro_reach_dps
from session.detect.stills import BY_HAND, LogStills, SessionStills, Still, references
from session.log.config import ByHand, LeftOut, Protocol, Sensor
from session.log.folder import Session
from session.log.logfile import KnownTurn, Log
from session.log.samples import Samples

# Segments: from the middle of one still to the middle of the next.
#
# Cut there, every sample is used exactly once, neighbours share no gyro noise, and a still that serves two turns gives half of itself
# to each: with the protocol's still 1 s, turn 3 s, still 1 s, forty times, that is the 5 s window.  A still that is no reference is
# passed over: the two turns around it become one longer segment.

LEAST_MARGIN_S = 0.1  #: of stillness at each end of a turn that fills the window: what one block of the detector may be late
LONGEST_TURN_SEGMENTS = 6.0  #: times the protocol's segment: beyond that it is a run, not a segment


#: the stills before and after a turn
Ends = tuple[Still, Still]


@dataclass(frozen=True, eq=False)
class Segment:
    """Samples ``start <= i < stop`` of one log between two stills (numbers into the log's list of stills).

    number counts from 0 over all logs; turn_start, turn_stop bound the movement; note states what is unusual; problem states why it is
    not used, or is None; breaks_yaw: integrating it shows nothing of the attitude after it.  first and last are None between moments of
    a further reference (``Session.reference``).
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
    def stills(self) -> Ends:
        """The two between which it lies; a segment between moments of a further reference has none."""
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
    starts = [still.start for still in stills]
    segments: list[Segment] = []
    for first, last in pairwise(references(stills)):
        passed = stills[bisect_right(starts, first.start) : bisect_left(starts, last.start)]
        start, stop = _window(samples, first, last, protocol)
        turn = slice(first.stop, last.start + 1)
        t_s = (samples.t_ns[turn] - samples.t_ns[first.stop - 1]) * NS
        rate = np.linalg.norm(samples.gyro[turn] - (first.gyro_mean + last.gyro_mean) / 2, axis=1)
        turn_s, turn_deg = float(t_s[-1]), float(np.trapezoid(rate, t_s)) / DEG
        duration_s = float(samples.t_ns[stop - 1] - samples.t_ns[start]) * NS
        problem = broken = why_broken(samples, turn, sensor, put_in)
        if problem is None and duration_s > LONGEST_TURN_SEGMENTS * protocol.segment_s:
            problem = f"{duration_s:.0f} s from still to still: too long for a segment; make it a closure run"
        segment = Segment(
            number=number + len(segments),
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
            problem=problem,
            breaks_yaw=broken is not None,
        )
        segments.append(segment)
    return without_leaps(segments, samples)


# A turn whose movement is missing: gravity lies elsewhere after it, and no rate shows how it came there.
#
# Gravity moves in the sensor by no more than the sensor turns: its angle from still to still is at most the way of the rate between them.
# In the 56 recordings of xsens, mikov and mimu (also wild/mimu) it exceeds that by 0.2 degrees at most.

#: of the turns: more that move gravity by more than they turn are no missing movements, but rates of another scale
MOST_LEAPS = 0.25


def without_leaps(segments: list[Segment], samples: Samples) -> list[Segment]:
    """The segments of one log; those in which gravity leaps farther than the gyroscope turned have a problem."""
    ends = np.array([[still.accel_mean for still in segment.stills] for segment in segments]).reshape(-1, 2, 3)
    tilt = angle_between(ends[:, 0], ends[:, 1])
    way = np.array([segment.turn_deg * DEG for segment in segments])
    missing = tilt > APART_RAD + (1 + APART_SHARE) * way
    if not 0 < np.count_nonzero(missing) <= MOST_LEAPS * len(segments):
        return segments
    return [
        replace(segment, problem=_leap_text(segment, samples, angle), breaks_yaw=True) if gone and segment.accepted else segment
        for segment, gone, angle in zip(segments, missing, tilt, strict=True)
    ]


def _leap_text(segment: Segment, samples: Samples, tilt: float) -> str:
    first, last = segment.stills
    force = samples.accel[first.stop - 1 : last.start + 1]
    step = np.linalg.norm(np.diff(force, axis=0), axis=1)
    at_s = samples.at_s(first.stop - 1 + int(np.argmax(step))) if len(step) else segment.start_s
    turned = f"the gyro turned by {segment.turn_deg:.1f} deg"
    return f"{LEAPS} by {tilt / DEG:.0f} deg, most of it at {at_s:.2f} s, and {turned}: samples are missing"


#: begins the problem of a turn without its movement
LEAPS = "gravity leaps"


def _window(samples: Samples, first: Still, last: Still, protocol: Protocol) -> tuple[int, int]:
    """The protocol's window, centred on the turn; longer where the turn is, and never beyond the middles of the stills."""
    turn_s = (samples.t_ns[last.start] - samples.t_ns[first.stop - 1]) * NS
    margin = round(max((protocol.segment_s - turn_s) / 2, LEAST_MARGIN_S) / samples.period_s)
    start = max(first.stop - 1 - margin, first.middle)
    stop = min(last.start + margin, last.middle) + 1  # neighbours share the middle sample: the step between belongs to no other
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
    inside = (samples.gaps >= max(turn.start - 1, 0)) & (samples.gaps < turn.stop - 1)
    if inside.any():
        rows = samples.gaps[inside]
        worst = float((samples.t_ns[rows + 1] - samples.t_ns[rows]).max()) * NS
        lost = round(worst / samples.period_s) - 1
        return f"{lost} samples are missing during the turn (gap of {worst:.3f} s)"
    rate_dps = np.abs(samples.gyro[turn]) / DEG
    if put_in is not None:  # beyond the register's end, perhaps, but not clipped any more
        rate_dps = np.where(put_in[turn][:, None], 0.0, rate_dps)
    reach_dps = gyro_reach_dps(sensor)
    clipped = [clips(axis, sensor.gyro_fs_dps, reach_dps) for axis in rate_dps.T]
    if any(clipped):
        axes = ", ".join(axis for axis, bad in zip("xyz", clipped, strict=True) if bad)
        return f"the gyro clips at {rate_dps[:, clipped].max():.0f} dps on {axes}: turn slower or choose a larger full scale"
    return None


# The two ends of a closure run: a still, a long turn, a still in the same attitude.  Evaluated here while it is recorded, and by ``fit``.

#: a table is set back by hand to a dial: closer than this is "the same attitude"
RETURN_RAD = 0.5 * DEG


@dataclass(frozen=True, eq=False)
class RunEnds:
    """Stills at the beginning and the end; away_rad: between gravity in one and the other; broken: why it cannot be integrated."""

    first: Still
    last: Still
    away_rad: float
    broken: str | None

    @property
    def returned(self) -> bool:
        """Whether it ends in the attitude that it began in, as far as gravity sees it."""
        return self.away_rad <= RETURN_RAD


def run_ends(samples: Samples, stills: list[Still], sensor: Sensor, put_in: np.ndarray | None = None) -> RunEnds | None:
    """Of a log's samples and stills; None where there are not two stills.  Stills between the two are passed over.

    put_in (N,) bool: samples that are no readings.
    """
    good = references(stills)
    if len(good) < 2:
        return None
    first, last = good[0], good[-1]
    return RunEnds(
        first,
        last,
        float(angle_between(first.accel_mean, last.accel_mean)),
        why_broken(samples, slice(first.stop, last.start + 1), sensor, put_in),
    )


# Turns that ``session.toml`` leaves out: each is found again by a moment in which it moved, whatever its number is.


def without_excluded(segments: list[Segment], samples: Samples, log: Path, rows: Sequence[LeftOut]) -> list[Segment]:
    """The segments of one log; those that hold one of its moments have a problem."""
    moments = moments_of(log, rows)
    return [replace(s, problem=f"it {BY_HAND}") if any(moved_at(s, samples, at_s) for at_s in moments) else s for s in segments]


def moments_of(log: Path, rows: Sequence[ByHand]) -> list[float]:
    """Of one log, packed or not, s of its clock."""
    return [row.at_s for row in rows if row.log.removesuffix(".gz") == log.name.removesuffix(".gz")]


def moved_at(segment: Segment, samples: Samples, at_s: float) -> bool:
    """Whether a moment of the samples' clock lies between its two stills; in all of it where it lies between no stills."""
    start, stop = segment.start, segment.stop - 1
    if segment.first is not None and segment.last is not None:
        start, stop = segment.first.stop - 1, segment.last.start
    return bool(samples.t_ns[start] * NS <= at_s <= samples.t_ns[stop] * NS)


# The segments of a session, and whether they are enough: ``check`` looks at the turns that ``fit`` uses, and refuses where it refuses.

#: a linear fit with 12 parameters and two angles a segment needs at least this many
FEWEST_SEGMENTS = 7
#: the smallest singular value of three axes at right angles is 1, of three in a plane 0
AXES_APART = 0.3


@dataclass(frozen=True, eq=False)
class LogSegments:
    """A log, what is found in it, its stills, those known not to be at rest with a problem, and its segments, used or with the reason
    why not."""

    log: Log
    found: LogStills
    stills: list[Still]
    segments: list[Segment]


def session_segments(
    session: Session, found: SessionStills, moving: Collection[int] = (), progress: Reporter = no_report
) -> list[LogSegments]:
    """Cut the segments of a session, numbered over all logs; a log without a still has none, and is not counted.

    found: the session's stills; moving: numbers of stills, over all logs, that are known not to be at rest.
    """
    parts: list[LogSegments] = []
    stills_before = segments_before = 0
    for log in session.logs:
        progress(f"stills of {log.path.name}")
        here = found.of(log)
        if here.noise is None:
            continue
        stills = [replace(s, problem="turns about the vertical") if stills_before + i in moving else s for i, s in enumerate(here.stills)]
        sensor, protocol = session.config.sensor, session.config.protocol
        cut = cut_segments(here.samples, stills, sensor, protocol, log=len(parts), number=segments_before, put_in=log.put_in)
        parts.append(LogSegments(log, here, stills, without_excluded(cut, here.samples, log.path, session.config.exclude)))
        stills_before, segments_before = stills_before + len(stills), segments_before + len(cut)
    return parts


def why_too_few(stills: Sequence[Still], segments: Sequence[Segment], turns: Sequence[FoundTurn], still_s: float) -> str | None:
    """State why a session's segments fix no calibration, or None; turns: of known angle, which may need fewer."""
    if not stills:
        return f"no still phase of {still_s:g} s found; was the table ever left alone? See `{command_line('check')}`"
    if not segments:
        bad = next((still.problem for still in stills if still.problem), None)
        return (
            f"{len(stills)} still phase{'s' * (len(stills) != 1)} but no turn between two that are usable"
            + (f" ({bad})" if bad else "")
            + "; record still - turn - still"
        )
    used = [segment for segment in segments if segment.accepted]
    if not used:
        return f"all {len(segments)} segments are rejected, the first because {segments[0].problem}"
    if len(used) >= FEWEST_SEGMENTS or _span_space(turns):
        return None
    return (
        f"{len(used)} usable segments, expected at least {FEWEST_SEGMENTS} for a fit; "
        f"the last ends at {used[-1].start_s + used[-1].duration_s:.0f} s: record more turns"
        + next((f"; turns.csv, {turn.known.name}: {turn.problem}" for turn in turns if turn.problem), "")
    )


def _span_space(turns: Sequence[FoundTurn]) -> bool:
    """Whether the axes of the known turns span space, so that every scale factor is observed."""
    axes = np.array([turn.axis for turn in turns if turn.problem is None]).reshape(-1, 3)
    return len(axes) >= 3 and float(np.linalg.svd(axes, compute_uv=False)[2]) > AXES_APART


# Turns of ``turns.csv`` among a session's segments, and what the gyro reads of each.
#
# The gyro's own angle is the integral of its rate less the bias of the stills on either side, in body axes: about a fixed axis it is that
# axis times the whole angle, circles counted.

#: of the angle, and rad, that an uncalibrated gyroscope may be off by: its sensitivity by 1 to 3 %, its clock by 5.25 %
#: (docs/sensor.md); never so much that a circle more or less could be meant
APART_SHARE, APART_RAD, MOST_APART_RAD = 0.10, 5 * DEG, 150 * DEG
#: between the axis that was written and the one that the gyro turned about: "mounted by hand" ends here
AXIS_APART_RAD = 30 * DEG


@dataclass(frozen=True, eq=False)
class FoundTurn:
    """A known turn and its segment, or why it is not used.

    segment: None where there is no such turn; reads (3,) rad: the gyro's angle about each body axis; problem: None where it is used.
    """

    known: KnownTurn
    segment: Segment | None
    reads: np.ndarray | None
    problem: str | None

    @property
    def axis(self) -> np.ndarray:
        """(3,) unit, body axes: about which the gyro turned, in the sense in which the stated angle is positive."""
        assert self.reads is not None
        return np.sign(self.known.angle_rad) * self.reads / np.linalg.norm(self.reads)

    @property
    def along_rad(self) -> float:
        """What the gyro reads about the stated axis."""
        assert self.reads is not None
        return float(self.reads @ self.known.axis)


def _find_known_turns(
    known: Sequence[KnownTurn], segments: Sequence[Segment], samples: Sequence[Samples], names: Sequence[str]
) -> list[FoundTurn]:
    """Each known turn with its segment; samples and names of the logs that ``Segment.log`` counts."""
    first = {log: next(s.number for s in segments if s.log == log) for log in {s.log for s in segments}}
    found: list[FoundTurn] = []
    for turn in known:
        number: int | None = turn.turn
        if turn.log is not None:
            log = names.index(turn.log) if turn.log in names else -1
            own = [s for s in segments if s.log == log]
            number = first[log] + turn.turn if turn.turn < len(own) else None
        segment = next((s for s in segments if s.number == number), None)
        if segment is None:
            count = len(segments) if turn.log is None else len(own)
            turns = f"{count} turns, counted from 0" if count else "no turn between two stills"
            found.append(FoundTurn(turn, None, None, f"there is no such turn: {turns}"))
            continue
        reads = angle_read(samples[segment.log], segment)
        problem = None if segment.accepted else f"the turn is not used: {segment.problem}"
        if problem is None and any(other.segment is segment for other in found):
            problem = "an earlier line names the same turn"
        found.append(FoundTurn(turn, segment, reads, problem or contradiction(turn, reads)))
    return found


def known_turns(session: Session, parts: Sequence[LogSegments]) -> list[FoundTurn]:
    """Match the session's known turns to its segments; none where none is known."""
    segments = [segment for part in parts for segment in part.segments]
    names = [part.log.path.name for part in parts]
    return _find_known_turns(session.turns, segments, [part.found.samples for part in parts], names) if session.turns else []


def rate_in(samples: Samples, segment: Segment) -> tuple[np.ndarray, np.ndarray]:
    """(N,) s from a segment's beginning, and the rate (N, 3) rad/s, the bias of its stills taken off."""
    first, last = segment.stills
    part = slice(segment.start, segment.stop)
    t_s = (samples.t_ns[part] - samples.t_ns[segment.start]) * NS
    share = (t_s / t_s[-1])[:, None]
    return t_s, samples.gyro[part] - (first.gyro_mean * (1 - share) + last.gyro_mean * share)


def angle_read(samples: Samples, segment: Segment) -> np.ndarray:
    """(3,) rad: the gyro's angle about each body axis from still to still."""
    t_s, rate = rate_in(samples, segment)
    return np.trapezoid(rate, t_s, axis=0)


def contradiction(turn: KnownTurn, reads: np.ndarray) -> str | None:
    """Why a stated angle cannot be what the gyro saw, or None."""
    size = float(np.linalg.norm(reads))
    along = float(reads @ turn.axis)
    cosine = abs(along) / size if size > 0 else 0.0
    reading = f"the gyro reads {along / DEG:.1f} deg about {turn.words}"
    if cosine < np.cos(AXIS_APART_RAD):
        about = ";".join(f"{x:.2f}" for x in reads / max(size, 1e-12))
        return f"the gyro turned {size / DEG:.1f} deg about {about}, not about {turn.words}"
    own = float(np.sign(along)) * size  # about its own axis: a mounting that is some degrees off loses nothing
    if _near(own, turn.angle_rad):
        return None
    if _near(own, -turn.angle_rad):
        return f"{reading}: the other way round"
    circles = round((own - turn.angle_rad) / (2 * np.pi))
    if circles and _near(own, turn.angle_rad + circles * 2 * np.pi):
        count = f"{abs(circles)} full circle{'s' * (abs(circles) != 1)}"
        return f"{reading}: {count} {'more' if circles * turn.angle_rad > 0 else 'fewer'} than stated"
    return reading


def _near(read_rad: float, angle_rad: float) -> bool:
    return abs(read_rad - angle_rad) <= min(APART_RAD + APART_SHARE * abs(angle_rad), MOST_APART_RAD)
