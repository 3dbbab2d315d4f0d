"""A session of a few turns in two logs, made directly from arrays: stills, segments, batch, floor, Earth; no files, no simulation."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, GRAVITY, config, wxyz
from scipy.spatial.transform import Rotation
from small_turns import TRUE, angles_by_scipy, with_known_angles

from session.detect.segments import Segment
from session.detect.stills import Noise, Still
from session.log.config import Accelerometer
from session.log.folder import Session
from session.log.samples import Samples
from tinygc.closure.earth import EarthRate
from tinygc.closure.floor import BiasInstability, Floor
from tinygc.closure.least_squares import StillRates
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch
from tinygc.closure.stills import StillSet

DPH = DEG / 3600
#: one-sided densities of each log, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz)
GYRO = [np.array([0.9, 1.0, 1.1]) * 5e-5, np.array([1.3, 0.8, 1.0]) * 8e-5]
ACCEL = [np.array([1.0, 1.2, 0.8]) * 3e-4, np.array([0.7, 1.0, 1.1]) * 5e-4]
#: samples of a still and of a turn; half a still is at either end of a segment
STILL, TURN = 8, 24
EARTH_T = np.array([0.05, 0.03, -0.04])  # a thousand times as fast as ours


def small_session(
    turns=(4, 3),
    kind="tilt",
    source="estimated",
    instability=None,
    noise=1.0,
    seed=0,
    floor_rad=5e-4,
    triangle=False,
    truths=False,
):
    """Turns of each log, with a still before and behind each; the first log has a still more that is no reference, and a rejected segment.

    kind: ``tilt``, ``yaw`` (three angles are known) or ``known`` (net angles are stated); source: of the Earth's rate; noise: of ends,
    rates and lengths, in their sigmas; triangle: whether the accelerometer's matrix is of its own stills; truths: no still is a reference.
    """
    rng = np.random.default_rng(seed)
    logs, segments, parts = [], [], []
    q = Rotation.random(random_state=seed)
    for number, count in enumerate(turns):
        lengths = [TURN + 3 * (turn % 2) for turn in range(count)]
        starts = [STILL * k + sum(lengths[:k]) for k in range(count + 1)]
        rows = starts[-1] + STILL
        dt = rng.uniform(0.03, 0.04, rows)
        t_ns = np.rint(np.cumsum(dt) * 1e9).astype(np.int64) + 10**9 * 7
        steps = np.diff(t_ns) * 1e-9
        body = np.zeros((rows, 3))
        for turn in range(count):
            first, last = starts[turn] + STILL, starts[turn + 1]
            bell = np.sin(np.pi * (np.arange(last - first) + 0.5) / (last - first))[:, None] ** 2
            body[first:last] = bell * rng.normal(size=(1, 3)) * 3
        q = attitudes_by_scipy(q, body, steps)
        earth = q.inv().apply(EARTH_T)
        measured = np.linalg.solve(TRUE.E, (body + earth - TRUE.B).T).T
        measured += noise * GYRO[number] / np.sqrt(2 * 0.035) * rng.normal(size=measured.shape)
        accel = q.inv().apply([0, 0, -GRAVITY])
        stills = [_still(s, t_ns, measured, accel, number, noise, rng) for s in starts]
        own = [*stills]
        if number == 0:
            own.insert(1, replace(stills[0], start=2, stop=6, problem="creeps"))
        for k, (a, b) in enumerate(pairwise(stills)):
            begin, stop = starts[k] + STILL // 2, starts[k + 1] + STILL // 2 + 1
            where = dict(start_s=(t_ns[begin] - t_ns[0]) * 1e-9, duration_s=(t_ns[stop - 1] - t_ns[begin]) * 1e-9)
            made = Segment(len(segments), number, a, b, begin, stop, **where, turn_s=1.0, turn_deg=90.0)
            segments.append(replace(made, first=None, last=None) if truths else made)
        if number == 0:
            segments.insert(1, replace(segments[0], problem="left out"))
        there = wxyz(q[[still.start for still in own]])
        samples = Samples(t_ns, measured, accel, np.full(rows, 25.0))
        logs.append(StillSet(samples, own, Noise(GYRO[number], ACCEL[number]), there, np.full(len(own), 0)))
        parts.append((measured, steps, earth, q, starts))
        q = q[-1]
    used = [s for s in segments if s.accepted]
    longest = max(s.stop - s.start for s in used)
    rate, earth, dt = np.zeros((len(used), longest, 3)), np.zeros((len(used), longest, 3)), np.zeros((len(used), longest - 1))
    start, end = np.zeros((2, len(used), 4))
    for i, s in enumerate(used):
        measured, steps, turning, q, _ = parts[s.log]
        count = s.stop - s.start
        rate[i, :count], earth[i, :count] = measured[s.start : s.stop], turning[s.start : s.stop]
        rate[i, count:], dt[i, : count - 1] = rate[i, count - 1], steps[s.start : s.stop - 1]
        start[i], end[i] = wxyz(q[s.start]), wxyz(q[s.stop - 1])
    ends = Rotation.from_rotvec(noise * floor_rad * rng.normal(size=(len(used), 3)) * [1, 1, kind == "yaw"])
    end = wxyz(ends * Rotation.from_quat(end, scalar_first=True))
    batch = Batch(rate, dt, earth, start, end, kind == "yaw")
    batch = with_known_angles(batch) if kind == "known" else batch
    d = batch.angles
    own = np.array([_spd(rng, d) for _ in used]) * floor_rad**2
    shared = -0.1 * floor_rad**2 * np.array([np.eye(d) + 0.1 * rng.normal(size=(d, d)) for _ in used[1:]])
    floor = Floor(own, shared, 1.3, 0.3 * own)
    references = [
        (n, still, at) for n, log in enumerate(logs) for still, at in zip(log.stills, log.q_tb, strict=True) if still.problem is None
    ]
    began = np.cumsum([0.0, *(log.samples.duration_s for log in logs)])
    rates = StillRates(
        np.array([still.gyro_mean for _, still, _ in references]),
        Rotation.from_quat([at for *_, at in references], scalar_first=True).inv().apply(EARTH_T),
        np.array([logs[n].noise.angle_random_walk / np.sqrt(still.duration_s) for n, still, _ in references]),
        np.array([at for *_, at in references]),
        np.array([began[n] + still.start_s + still.duration_s / 2 for n, still, _ in references]),
    )
    made = config()
    upper = np.array([[1.0, 0.01, 0.0], [0, 1.0, 0.0], [0, 0, 1.0]]) if triangle else np.eye(3) + 0.01
    made = replace(made, accelerometer=replace(Accelerometer(), matrix=upper), site=replace(made.site, gravity_mps2=GRAVITY))
    session = Session(Path("made"), made, (), ())
    if truths:
        files = pytest.importorskip("tinygc.features.truth.points", reason="the feature that reads truth files is not there")
        session = replace(session, reference=files.TruthFiles((None,), made.protocol.truth_sigma_deg))
    earths = {0: EarthRate(EARTH_T, 0.5, 0.02, source)}
    problem = Problem(session, segments, batch, floor, earths, logs, TRUE, rates, None)
    problem.__dict__["instability"] = instability or BiasInstability(20 * DPH, "given")
    return problem


def attitudes_by_scipy(q, body, dt):
    """Attitudes (N) from the first one, body rates (N, 3) and steps (N - 1,) s."""
    vectors = (body[1:] + body[:-1]) / 2 * dt[:, None] + dt[:, None] ** 2 / 6 * np.cross(body[:-1], body[1:])
    found = [q]
    for step in Rotation.from_rotvec(vectors):
        found.append(found[-1] * step)
    return Rotation.concatenate(found)


def _still(start, t_ns, measured, accel, number, noise, rng):
    stop = start + STILL
    duration_s = (t_ns[stop - 1] - t_ns[start]) * 1e-9 * STILL / (STILL - 1)
    force = accel[start] + noise * ACCEL[number] / np.sqrt(2 * duration_s) * rng.normal(size=3)
    none = np.zeros(3)
    start_s = (t_ns[start] - t_ns[0]) * 1e-9
    return Still(start, stop, start_s, duration_s, measured[start:stop].mean(axis=0), none, force, none, none, 25.0)


def _spd(rng, d):
    root = np.eye(d) + 0.2 * rng.normal(size=(d, d))
    return root @ root.T


def closure_of(problem):
    """The closure's angles (S d,) as a function of the model's vector (12,), by scipy."""
    return lambda vector: angles_by_scipy(problem.batch, vector).ravel()


def tilted_stills(problem, by):
    """The references at the ends of all turns rotated by vectors (Q, 3) rad about the table's axes, Q reference stills."""
    number = {id(still): k for k, still in enumerate(still for still in problem.stills if still.problem is None)}
    first, last = (np.array([number[id(s.stills[end])] for s in problem.used]) for end in (0, 1))
    batch = problem.batch
    start, end = (
        wxyz(Rotation.from_rotvec(by[which]) * Rotation.from_quat(q, scalar_first=True))
        for q, which in ((batch.start, first), (batch.end, last))
    )
    return replace(problem, batch=replace(batch, start=start, end=end))
