"""Known turns of a session as the third angle of its batch (``session/detect/known_turns.py``, ``tinygc/closure/known_turns.py``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from session.common.units import EARTH_RATE_RPS
from session.detect.known_turns import FoundTurn, find_known_turns
from session.detect.segments import Segment, cut_segments
from session.detect.session_stills import SessionStills
from session.log.folder import Session
from tinygc.closure.floor import Floor
from tinygc.closure.known_turns import KnownTurns
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import Batch, closure_angles
from tinygc.closure.still_rates import StillRates
from tinygc.models.linear import PARAMETERS, LinearModel
from tinygc.problem.still_set import StillSet

#: the smallest singular value of three axes at right angles is 1, of three in a plane 0
AXES_APART = 0.3


def known_turns_of(session: Session, found: SessionStills, segments: Sequence[Segment]) -> tuple[FoundTurn, ...]:
    """The session's known turns among its segments.

    They are counted as ``check`` counts them.  Where stills have since been taken for none, two turns may have become one: then neither is
    a turn of known angle.
    """
    if not session.turns:
        return ()
    here = [(log, found.of(log)) for log in session.logs]
    here = [(log, stills) for log, stills in here if stills.noise is not None]
    counted: list[Segment] = []
    config = session.config
    for number, (_, stills) in enumerate(here):
        counted += cut_segments(stills.samples, stills.stills, config.sensor, config.protocol, log=number, number=len(counted))
    names, samples = [log.path.name for log, _ in here], [stills.samples for _, stills in here]
    now = {(s.log, s.stills[0].start, s.stills[1].start): s for s in segments}
    turns = []
    for turn in find_known_turns(session.turns, counted, samples, names):
        if turn.segment is None:
            turns.append(turn)
            continue
        first, last = turn.segment.stills
        segment = now.get((turn.segment.log, first.start, last.start))
        if segment is None:
            turns.append(replace(turn, segment=None, problem="a still at one of its ends is none"))
        else:
            problem = turn.problem or (None if segment.accepted else f"the turn is not used: {segment.problem}")
            turns.append(replace(turn, segment=segment, problem=problem))
    return tuple(turns)


def as_reference(turns: Sequence[FoundTurn], count: int, segments: Sequence[Segment]) -> KnownTurns | None:
    """Of ``count`` segments; None where no turn's angle is known."""
    used = [turn for turn in turns if turn.problem is None]
    if not used:
        return None
    rows = {segment.number: row for row, segment in enumerate(segments)}
    angle, sigma, axis = np.full(count, np.nan), np.full(count, np.nan), np.tile([1.0, 0.0, 0.0], (count, 1))
    for turn in used:
        assert turn.segment is not None
        row = rows[turn.segment.number]
        angle[row], sigma[row], axis[row] = turn.known.angle_rad, turn.known.sigma_rad, turn.axis
    return KnownTurns(angle, sigma, axis)


def span_space(turns: Sequence[FoundTurn]) -> bool:
    """Whether turns of known angle are about three axes that lie apart: then each scale factor has one of its own."""
    axes = np.array([turn.axis for turn in turns if turn.problem is None]).reshape(-1, 3)
    return len(axes) >= 3 and float(np.linalg.svd(axes, compute_uv=False)[2]) > AXES_APART


def tilt_excess(batch: Batch, floor: Floor, start: LinearModel, at_rest: StillRates | None) -> float:
    """Factor, 1 or more, by which the tilt at the ends misses more than its floor: what a hand, a data rate, or an accelerometer leaves.

    By the model of these ends alone: a stop's error must not count as theirs.  1 where they are no more than the model's parameters.
    """
    angles = 2 * len(batch)
    if angles <= PARAMETERS:
        return 1.0
    tilt, sigma = replace(batch, turns=None), floor.sigma[:, :2]
    model = fit_least_squares(tilt, sigma, start, still_rates=at_rest).model
    missed = closure_angles(tilt, model) / sigma
    return max(1.0, float(np.sqrt(np.sum(missed**2) / (angles - PARAMETERS))))


def rates_at_rest(logs: Sequence[StillSet]) -> StillRates:
    """The mean rates of the stills as the bias, to the Earth's rate, whose direction nobody knows yet.

    A turn about one axis by one angle cannot tell a scale error from a bias.
    """
    rows = [(still, log.noise) for log in logs for still in log.stills if still.problem is None]
    rate = np.array([still.gyro_mean for still, _ in rows])
    sigma = np.array([np.hypot(noise.angle_random_walk / np.sqrt(still.duration_s), EARTH_RATE_RPS) for still, noise in rows])
    return StillRates(rate, np.zeros_like(rate), sigma)
