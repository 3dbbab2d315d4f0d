"""Where each unit's accelerometer is on the body, from what it feels beyond the first one while the body turns.

a_i - a_0 = alpha x r + omega x (omega x r) + offset, in the array's axes: linear in r.  A force that lags behind the rate is one more
column, its derivative.  The rate is the mean of all units' calibrated rates, its derivative that of a spline.  Covariance by the scatter
from turn to turn (the sandwich, White 1980, turns as clusters): what filters and clocks leave is alike within a turn.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from session.accelerometer.parameters import corrected
from session.common.robust import sigma_of
from session.common.units import NS
from session.detect.clipping import register_end_dps
from tinygc.array.joint.joint import Joint
from tinygc.array.joint.rows import cross
from tinygc.array.joint.unit_rows import force_problem
from tinygc.array.joint.units import ArrayUnit
from tinygc.array.places.rates import rates_of

#: m: a position known worse than this is not known
KNOWN_M = 0.05
FEWEST_TURNS = 5
#: of its length: what filters of gyroscope and accelerometer that differ make of a position (benchmarks/array_fit.py)
FILTERS = 0.005
#: rows that miss by more than this many typical misses count less
BAR = 2.0
ROUNDS = 6


def positions(units: list[ArrayUnit], joint: Joint) -> list[tuple[np.ndarray, np.ndarray] | None]:
    """Of each unit: position (3,) m from the first, in the array's axes, and its covariance (3, 3) m^2; None where the motion does not
    tell.  The first unit's is zero."""
    rate, force, turns = [], [], []
    for i, unit in enumerate(units):
        rate.append(_of_logs(unit, joint, i, "rate"))
        force.append(_of_logs(unit, joint, i, "force"))
    anchor = units[joint.same.anchor].problem
    for segment in anchor.used:
        samples = anchor.logs[segment.log].samples
        first, last = segment.stills
        turns.append((segment.log, samples.t_ns[first.stop : last.start + 1] * NS))
    found: list[tuple[np.ndarray, np.ndarray] | None] = [(np.zeros(3), np.zeros((3, 3)))]
    for i in range(1, len(units)):
        rows = []
        for log, t_s in turns:
            parts = [part for each in (rate, force) for part in (each[0][log], each[i][log])]
            t_s = t_s[np.all([(t_s >= part.x[0]) & (t_s <= part.x[-1]) for part in parts], axis=0)]
            if len(t_s) < 4:
                continue
            splines = [each[log] for each in rate]
            omega = np.mean([spline(t_s) for spline in splines], axis=0)
            alpha = np.mean([spline(t_s, 1) for spline in splines], axis=0)
            A = cross(alpha) + cross(omega) @ cross(omega)
            beyond = force[i][log](t_s) - force[0][log](t_s)
            later = force[i][log](t_s, 1) - force[0][log](t_s, 1)
            columns = np.concatenate([A, np.broadcast_to(np.eye(3), A.shape), later[..., None]], axis=2)
            rows.append((columns.reshape(-1, 7), beyond.reshape(-1)))
        found.append(_solved(rows))
    return found


def _of_logs(unit: ArrayUnit, joint: Joint, i: int, what: str) -> list[CubicSpline]:
    """Calibrated rate or force, in the array's axes, of each log over the array's time; readings that are none are left out."""
    M, x, model = joint.state.mountings[i], joint.state.accelerometers[i], joint.models[i]
    found = []
    for log, given in zip(unit.problem.logs, force_problem(unit).logs, strict=True):
        samples = log.samples
        good = rates_of(samples, register_end_dps(unit.problem.session.config.sensor, np.asarray(samples.gyro))).good
        t_s = samples.t_ns * NS
        values = model(np.asarray(samples.gyro)) if what == "rate" else corrected(x, np.asarray(given.samples.accel))
        found.append(CubicSpline(t_s[good], values[good] @ M.T))
    return found


def _solved(turns: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray] | None:
    if len(turns) < FEWEST_TURNS:
        return None
    design, values = zip(*turns, strict=True)
    weights = [np.ones(len(v)) for v in values]
    x = np.zeros(7)
    for _ in range(ROUNDS):
        normal = sum((D * w[:, None]).T @ D for D, w in zip(design, weights, strict=True))
        if np.linalg.matrix_rank(normal) < 7:
            return None
        x = np.linalg.solve(normal, sum(D.T @ (w * v) for D, v, w in zip(design, values, weights, strict=True)))
        left = [v - D @ x for D, v in zip(design, values, strict=True)]
        bar = BAR * float(sigma_of(np.concatenate(left)))
        weights = [1 / (1 + (e / max(bar, 1e-12)) ** 2) for e in left]
    scores = np.array([D.T @ (w * e) for D, w, e in zip(design, weights, left, strict=True)])
    inverse = np.linalg.inv(normal)
    count = len(turns)
    covariance = (inverse @ (scores.T @ scores) @ inverse)[:3, :3] * count / max(count - 2, 1)
    covariance += np.eye(3) * (FILTERS * float(np.linalg.norm(x[:3]))) ** 2
    if np.sqrt(np.linalg.eigvalsh(covariance)[-1]) > KNOWN_M:
        return None
    return x[:3], covariance
