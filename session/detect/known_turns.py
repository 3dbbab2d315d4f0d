"""Turns of ``turns.csv`` among a session's segments, and what the gyro reads of each.

The gyro's own angle is the integral of its rate less the bias of the stills on either side, in body axes: about a fixed axis it is that
axis times the whole angle, circles counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from session.common.units import DEG, NS
from session.detect.segments import Segment
from session.log.known_turns import KnownTurn
from session.log.samples import Samples

#: of the angle, and rad, that a gyroscope which nobody has calibrated may be off by: its sensitivity by 1 to 3 %, its clock by 5.25 %
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


def find_known_turns(
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
            found.append(FoundTurn(turn, None, None, f"there is no such turn: {_counted(count)}"))
            continue
        reads = angle_read(samples[segment.log], segment)
        problem = None if segment.accepted else f"the turn is not used: {segment.problem}"
        if problem is None and any(other.segment is segment for other in found):
            problem = "an earlier line names the same turn"
        found.append(FoundTurn(turn, segment, reads, problem or contradiction(turn, reads)))
    return found


def _counted(count: int) -> str:
    return f"{count} turns, counted from 0" if count else "no turn between two stills"


def angle_read(samples: Samples, segment: Segment) -> np.ndarray:
    """(3,) rad: the gyro's angle about each body axis from still to still, the bias of the stills taken off."""
    first, last = segment.stills
    part = slice(segment.start, segment.stop)
    t_s = (samples.t_ns[part] - samples.t_ns[segment.start]) * NS
    share = np.clip(t_s / t_s[-1], 0, 1)[:, None]
    rate = samples.gyro[part] - (first.gyro_mean * (1 - share) + last.gyro_mean * share)
    return np.trapezoid(rate, t_s, axis=0)


def contradiction(turn: KnownTurn, reads: np.ndarray) -> str | None:
    """Why a stated angle cannot be what the gyro saw, or None."""
    size = float(np.linalg.norm(reads))
    along = float(reads @ turn.axis)
    cosine = abs(along) / size if size > 0 else 0.0
    said = f"the gyro reads {along / DEG:.1f} deg about {turn.words}"
    if cosine < np.cos(AXIS_APART_RAD):
        about = ";".join(f"{x:.2f}" for x in reads / max(size, 1e-12))
        return f"the gyro turned {size / DEG:.1f} deg about {about}, not about {turn.words}"
    own = float(np.sign(along)) * size  # about its own axis: a mounting that is some degrees off loses nothing
    if _near(own, turn.angle_rad):
        return None
    if _near(own, -turn.angle_rad):
        return f"{said}: the other way round"
    circles = round((own - turn.angle_rad) / (2 * np.pi))
    if circles and _near(own, turn.angle_rad + circles * 2 * np.pi):
        count = f"{abs(circles)} full circle{'s' * (abs(circles) != 1)}"
        return f"{said}: {count} {'more' if circles > 0 else 'fewer'} than stated"
    return said


def _near(read_rad: float, angle_rad: float) -> bool:
    return abs(read_rad - angle_rad) <= min(APART_RAD + APART_SHARE * abs(angle_rad), MOST_APART_RAD)
