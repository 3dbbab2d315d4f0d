"""The stills of a log, and the attitude carried through them: tilt from gravity, yaw from the gyroscope."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from session.detect.stills import Noise, Still
from session.detect.truth_segments import Rest, find_rests
from session.io.logfile import Bridge
from session.io.samples import Samples
from session.io.units import DEG, NS
from tinygc.attitude import rotation
from tinygc.closure.residual import Batch, end_attitude, nearest_yaw
from tinygc.models.linear import LinearModel

if TYPE_CHECKING:
    from session.detect.segments import Segment


# The stills of one log, with the attitudes that are carried through them.


@dataclass(frozen=True, eq=False)
class StillSet:
    """The stills of one log: their noise, attitudes q_tb (Q, 4), the yaw carried from still to still, and yaw groups (Q,); bridges:
    readings of its samples that were put in."""

    samples: Samples
    stills: list[Still]
    noise: Noise
    q_tb: np.ndarray
    group: np.ndarray
    bridges: tuple[Bridge, ...] = ()

    @cached_property
    def rests(self) -> list[Rest]:
        """Phases in which a vehicle stands, though its motors may shake it; looked for once."""
        return find_rests(self.samples)


# The attitude carried through the whole recording: gravity gives the tilt in each still, the gyro the yaw from still to still.
#
# Where the chain breaks (samples lost or clipped in a turn, a log that does not go on where the last one ended) a new yaw group begins,
# with a heading of its own.  A segment that was only left out by request does not break it.

#: the table has not been touched between two files if time goes on within this, and gravity is where it was to this
UNTOUCHED_S = 600.0
UNTOUCHED_RAD = 0.1 * DEG
#: more than this between a still and the file's end may be a turn about the vertical, which gravity does not see
UNSEEN_S = 1.0


def goes_on(before: Samples, last: Still, after: Samples, first: Still) -> bool:
    """Whether one log begins where another ended: still to its end, the device's time goes on, and gravity is where it was."""
    pause_s = (after.t_ns[0] - before.t_ns[-1]) * NS
    moved_s = max((len(before) - last.stop) * before.period_s, first.start_s)
    return 0 <= pause_s < UNTOUCHED_S and moved_s < UNSEEN_S and angle_between(last.accel_mean, first.accel_mean) < UNTOUCHED_RAD


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    """rad between two vectors (3,)."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def carry_yaw(logs: list[StillSet], segments: list[Segment], chain: Batch, model: LinearModel) -> tuple[list[StillSet], Batch]:
    """Attitudes of all stills, and the batch with them at its ends; yaw is 0 at the first still of each group.

    ``chain`` holds all segments, in order, with their ends' tilt (or all three angles, where the table's dials are the reference).
    """
    start, end = chain.start.copy(), chain.end.copy()
    q_tb = [rotation.from_gravity(np.array([still.accel_mean for still in log.stills]).reshape(-1, 3)) for log in logs]
    group = [np.zeros(len(log.stills), dtype=int) for log in logs]
    step = rotation.multiply(rotation.conjugate(chain.start), end_attitude(chain, model(chain.rate)))
    if chain.turns is not None:
        # Where a turn's angle is known, it is that, not the gyro's, which carries the yaw.
        step = rotation.multiply(rotation.conjugate(chain.start), chain.turns.turned(chain.start, rotation.multiply(chain.start, step)))
    groups, begun = 0, -1
    place = {id(still): number for log in logs for number, still in enumerate(log.stills)}
    for i, segment in enumerate(segments):
        stills = logs[segment.log].stills
        first, last = (place[id(still)] for still in segment.stills)
        if segment.log != begun:
            previous = _end_of(logs, q_tb, group, segment.log - 1)
            begins = stills[first]
            if previous is not None and goes_on(logs[segment.log - 1].samples, previous[0], logs[segment.log].samples, begins):
                _, q_before, group[segment.log][first] = previous
                q_tb[segment.log][first] = nearest_yaw(q_before, q_tb[segment.log][first])
            else:
                group[segment.log][first], groups = groups, groups + 1
            begun = segment.log
        if chain.yaw_known:
            q_tb[segment.log][first], q_tb[segment.log][last] = start[i], end[i]
            continue
        start[i] = q_tb[segment.log][first]
        end[i] = q_tb[segment.log][last] = nearest_yaw(rotation.multiply(start[i], step[i]), end[i])
        group[segment.log][last] = group[segment.log][first]
        if segment.breaks_yaw:
            group[segment.log][last], groups = groups, groups + 1
    carried = [replace(log, q_tb=q, group=g) for log, q, g in zip(logs, q_tb, group, strict=True)]
    return carried, replace(chain, start=start, end=end)


def _end_of(logs: list[StillSet], q_tb: list[np.ndarray], group: list[np.ndarray], number: int) -> tuple[Still, np.ndarray, int] | None:
    """The last reference still of a log, with its attitude and group."""
    if number < 0:
        return None
    references = [i for i, still in enumerate(logs[number].stills) if still.problem is None]
    if not references:
        return None
    last = references[-1]
    return logs[number].stills[last], q_tb[number][last], int(group[number][last])
