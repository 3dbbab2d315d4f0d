"""A problem with another calibration of its accelerometer: the same stills and turns, with other references."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.detect.stills import Still
from tinygc.attitude import rotation
from tinygc.closure.residual import nearest_yaw
from tinygc.problem.joint_fit import JointFit, bent
from tinygc.problem.known_turns import tilt_excess
from tinygc.problem.problem import Problem


def recalibrated(problem: Problem, joint: JointFit) -> Problem:
    """The problem under the accelerometer that a joint fit found, and with its linear model.

    A calibration is affine, so a still's mean moves as each of its samples does; which samples are still does not depend on it.
    """
    session = replace(problem.session, config=replace(problem.session.config, accelerometer=joint.accelerometer))
    found = problem.found.recalibrated(session)
    samples = dict(zip(map(id, problem.found.samples()), found.samples(), strict=True))
    logs = []
    now: dict[int, Still] = {}
    for log in problem.logs:
        stills = [replace(still, accel_mean=joint.moved(still.accel_mean)) for still in log.stills]
        now |= {id(old): new for old, new in zip(log.stills, stills, strict=True)}
        q_tb = nearest_yaw(log.q_tb, rotation.from_gravity(np.array([still.accel_mean for still in stills])))
        logs.append(replace(log, samples=samples[id(log.samples)], stills=stills, q_tb=q_tb))
    segments = [replace(s, first=now[id(s.first)], last=now[id(s.last)]) for s in problem.segments]
    references = np.concatenate([log.q_tb[[still.problem is None for still in log.stills]] for log in logs])
    batch, floor = bent(problem.batch, joint.first, joint.last, joint.force), problem.floor
    if batch.turns is not None:
        floor = replace(floor, tilt_excess=1.0)
        floor = replace(floor, tilt_excess=tilt_excess(batch, floor, joint.model, problem.still_rates))
    return replace(
        problem,
        session=session,
        segments=segments,
        batch=batch,
        floor=floor,
        logs=logs,
        first=joint.model,
        still_rates=replace(problem.still_rates, q_tb=references),
        found=found,
        joint=joint,
    )
