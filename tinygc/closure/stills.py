"""The stills of a log, and the attitude carried through them: tilt from gravity, yaw from the gyroscope."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from session.base import rotation
from session.base.rotation import angle_between
from session.base.units import DEG, NS
from session.detect.accelerometer import force_of
from session.detect.stills import Noise, Still, references
from session.log.logfile import Bridge
from session.log.samples import Samples
from tinygc.closure.residual import Batch, end_attitude
from tinygc.models.linear import LinearModel

if TYPE_CHECKING:
    from session.detect.segments import Segment


# The stills of one log with their attitudes.


@dataclass(frozen=True, eq=False)
class StillSet:
    """The stills of one log: noise, attitudes q_tb (Q, 4) with the yaw carried from still to still, yaw groups (Q,); bridges: repaired
    readings of its samples."""

    samples: Samples
    stills: list[Still]
    noise: Noise
    q_tb: np.ndarray
    group: np.ndarray
    bridges: tuple[Bridge, ...] = ()

    @classmethod
    def of(cls, samples: Samples, stills: list[Still], noise: Noise, bridges: tuple[Bridge, ...] = ()) -> StillSet:
        """With attitudes by gravity alone, in one group."""
        return cls(samples, stills, noise, rotation.from_gravity(force_of(stills)), np.zeros(len(stills), dtype=int), bridges)

    @property
    def references(self) -> StillSet:
        """With the stills alone that are references."""
        known = np.array([still.problem is None for still in self.stills], dtype=bool)
        return replace(self, stills=references(self.stills), q_tb=self.q_tb[known], group=self.group[known])


# The attitude through the whole recording: gravity gives the tilt in each still, the gyro carries the yaw from still to still.
#
# Where the chain breaks (samples lost or clipped in a turn, a log that does not continue the previous one) a new yaw group begins, with a
# heading of its own.  A segment excluded on request does not break the chain.

#: the table was not touched between two files if the gap in time and the change of gravity's direction are below these
UNTOUCHED_S = 600.0
UNTOUCHED_RAD = 0.1 * DEG
#: a longer time between a still and the file's end may hide a turn about the vertical, which gravity does not show
UNSEEN_S = 1.0


def goes_on(before: Samples, last: Still, after: Samples, first: Still) -> bool:
    """Whether a log continues another: the first is still to its end, the device's time continues, gravity's direction is the same."""
    pause_s = (after.t_ns[0] - before.t_ns[-1]) * NS
    moved_s = max((len(before) - last.stop) * before.period_s, first.start_s)
    turned_rad = float(angle_between(last.accel_mean, first.accel_mean))
    return 0 <= pause_s < UNTOUCHED_S and moved_s < UNSEEN_S and turned_rad < UNTOUCHED_RAD


def carry_yaw(logs: list[StillSet], segments: list[Segment], chain: Batch, model: LinearModel) -> tuple[list[StillSet], Batch]:
    """Compute the attitudes of all stills and set them at the batch's ends; yaw is 0 at the first still of each group.

    ``chain`` holds all segments in order, with the tilt at their ends (or all three angles if the table's dials are the reference).
    """
    start, end = chain.start.copy(), chain.end.copy()
    logs = [StillSet.of(log.samples, log.stills, log.noise, log.bridges) for log in logs]
    q_tb, group = [log.q_tb for log in logs], [log.group for log in logs]
    step = rotation.multiply(rotation.conjugate(chain.start), end_attitude(chain, model(chain.rate)))
    if chain.turns is not None:
        # A known turn angle carries the yaw instead of the gyro's angle.
        step = rotation.multiply(rotation.conjugate(chain.start), chain.turns.turned(chain.start, rotation.multiply(chain.start, step)))
    groups, begun, reached = 0, -1, -1
    place = {id(still): number for log in logs for number, still in enumerate(log.stills)}
    for i, segment in enumerate(segments):
        stills = logs[segment.log].stills
        first, last = place[id(segment.first)], place[id(segment.last)]
        if segment.log != begun or first != reached:  # a log begins, or turns before this one are not looked at
            previous = _end_of(logs, segment.log - 1) if segment.log != begun else None
            begins = stills[first]
            if previous is not None and goes_on(logs[segment.log - 1].samples, previous[0], logs[segment.log].samples, begins):
                _, q_before, group[segment.log][first] = previous
                q_tb[segment.log][first] = rotation.nearest_yaw(q_before, q_tb[segment.log][first])
            else:
                group[segment.log][first], groups = groups, groups + 1
            begun = segment.log
        reached = last
        if chain.yaw_known:
            q_tb[segment.log][first], q_tb[segment.log][last] = start[i], end[i]
            continue
        start[i] = q_tb[segment.log][first]
        end[i] = q_tb[segment.log][last] = rotation.nearest_yaw(rotation.multiply(start[i], step[i]), end[i])
        group[segment.log][last] = group[segment.log][first]
        if segment.breaks_yaw:
            group[segment.log][last], groups = groups, groups + 1
    return logs, replace(chain, start=start, end=end)


def _end_of(logs: list[StillSet], number: int) -> tuple[Still, np.ndarray, int] | None:
    """The last reference still of a log, with its attitude and group."""
    if number < 0:
        return None
    kept = logs[number].references
    return (kept.stills[-1], kept.q_tb[-1], int(kept.group[-1])) if kept.stills else None
