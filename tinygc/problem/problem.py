"""What every method solves: the same segments, references, Earth and floor for all."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from session.detect.known_turns import FoundTurn
from session.detect.segments import Segment
from session.detect.session_stills import SessionStills
from session.detect.stills import Noise, Still
from session.detect.unused_rests import UnusedRest
from session.log.folder import Session
from session.log.samples import start_times
from tinygc.attitude.earth import EarthRate
from tinygc.closure.bias_wander import BiasInstability, BiasWander
from tinygc.closure.floor import Floor
from tinygc.closure.residual import Batch
from tinygc.closure.still_rates import StillRates
from tinygc.lot.prior import Prior
from tinygc.models.linear import LinearModel
from tinygc.problem.bias_instability import bias_instability_of
from tinygc.problem.joint_fit import JointFit
from tinygc.problem.still_set import StillSet
from tinygc.problem.widened import Widening


@dataclass(frozen=True, eq=False)
class Problem:
    """What is fitted.

    segments: all of them, accepted or not; batch: the accepted ones, in order; floor of the batch; earths by yaw group; logs: stills
    by log; first: the linear fit that carried the yaw; still_rates of every reference still; found: the session's stills as they were
    found, for its closure runs; rest_rps: the mean bias (3,) rad/s, as it is measured, where the batch has every turn at it by the
    stills on either side (``still_bias.py``), else None; joint: the estimation of both sensors that its references are of, if there
    was one; known_turns: those of ``turns.csv``, used or with the reason why not; widened: used segments that are less certain than
    their noise, and why; prior: what a lot tells of the gyroscope beforehand, None for no more than that a fit must not wander.
    """

    session: Session
    segments: list[Segment]
    batch: Batch
    floor: Floor
    earths: dict[int, EarthRate]
    logs: list[StillSet]
    first: LinearModel
    still_rates: StillRates
    found: SessionStills
    rest_rps: np.ndarray | None = None
    joint: JointFit | None = None
    known_turns: tuple[FoundTurn, ...] = ()
    widened: tuple[Widening, ...] = ()
    prior: Prior | None = None

    def __repr__(self) -> str:
        return f"<Problem {self.session.name}: {len(self.stills)} stills, {len(self.used)} of {len(self.segments)} segments used>"

    @property
    def earth(self) -> EarthRate:
        """Of the yaw group with the most stills."""
        groups = np.concatenate([log.group[[still.problem is None for still in log.stills]] for log in self.logs])
        return self.earths[int(np.bincount(groups, minlength=1).argmax())]

    @property
    def used(self) -> list[Segment]:
        """The accepted segments, in order."""
        return [segment for segment in self.segments if segment.accepted]

    @property
    def began_s(self) -> np.ndarray:
        """(logs + 1,) s of the session at which each log begins, and at which the last one ends."""
        return start_times(log.samples for log in self.logs)

    @property
    def middle_s(self) -> np.ndarray:
        """(S,) s of the session at the middle of each used segment, logs one after the other."""
        began = self.began_s
        return np.array([began[segment.log] + segment.start_s + segment.duration_s / 2 for segment in self.used])

    @cached_property
    def instability(self) -> BiasInstability:
        """Of the gyro's bias: given, typical of the model, or estimated from the stills."""
        return bias_instability_of(self.session.config.sensor, self.logs, self.earths)

    def changed(self, **fields: Any) -> Problem:
        """Of the same recording, whose bias instability it shares if that is known already."""
        other = replace(self, **fields)
        if "instability" in self.__dict__:
            other.__dict__["instability"] = self.instability
        return other

    @property
    def wander(self) -> BiasWander:
        """Of the bias between the used segments."""
        return BiasWander(self.middle_s, self.instability.rps)

    @property
    def stills(self) -> list[Still]:
        """Of all logs, in order."""
        return [still for log in self.logs for still in log.stills]

    @property
    def unused_rests(self) -> list[tuple[str, UnusedRest]]:
        """Rests of the logs that are no reference, with their log's file, in order; none where the reference is a truth file."""
        if self.session.truths is not None:
            return []
        return [(log.path.name, rest) for log in self.session.logs for rest in self.found.of(log).unused]

    @property
    def noise(self) -> Noise:
        """Of all logs together, by how much stillness each has, or all alike where there is none."""
        weights = [sum(still.duration_s for still in log.stills) for log in self.logs]
        weights = weights if any(weights) else [1.0] * len(weights)
        power = (np.average([getattr(log.noise, name) ** 2 for log in self.logs], axis=0, weights=weights) for name in ("gyro", "accel"))
        return Noise(*map(np.sqrt, power))
