"""Position of each unit's accelerometer on the body, from its force relative to the first unit's while the body turns.

    a_i - a_0 = alpha x r + omega x (omega x r) + offset

in the array's axes: linear in r.  The rate is the mean of all units' calibrated rates, its derivative that of a spline.  Accelerometers
have other filters than gyroscopes: the rates are read at the delay that leaves the least, since 8 ms of it (MPU-9150) moves a position by
half its length.  That delay's remaining error is one more column, and a delay of one accelerometer against the other another one: the
derivative of the force.  The covariance is from the scatter between turns (the sandwich, White 1980, turns as clusters), since errors of
filters and clocks are common to a turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from session.base.numeric import sigma_of
from session.base.rotation import cross_matrix
from session.base.units import NS
from session.detect.accelerometer import corrected as corrected_force
from session.detect.events import register_end_dps
from tinygc.features.arrays.clocks import rates_of
from tinygc.features.arrays.joint import Joint
from tinygc.features.arrays.system import force_problem
from tinygc.features.arrays.units import ArrayUnit
from tinygc.inference.solve import inverse as covariance_of

#: m: a position with a larger sigma counts as unknown
KNOWN_M = 0.05
FEWEST_TURNS = 5
#: s: the largest delay of force against rate, several times those of such sensors' filters, and how well it must be found
MOST_DELAY_S, DELAY_STEP_S = 0.02, 1e-5
#: relative error of a position from differing filters of gyroscope and accelerometer (benchmarks/array_fit.py)
FILTERS = 0.005
#: rows with a residual beyond this many typical residuals are down-weighted
BAR = 2.0
ROUNDS = 6


def positions(motion: ArrayMotion) -> list[tuple[np.ndarray, np.ndarray] | None]:
    """Return each unit's position (3,) m from the first, in the array's axes, and its covariance (3, 3) m^2.

    None where the motion does not determine it.  The first unit's is zero.
    """
    found: list[tuple[np.ndarray, np.ndarray] | None] = [(np.zeros(3), np.zeros((3, 3)))]
    begun = {i: solved for i in range(1, len(motion.force)) if (solved := _solve_position(motion.rows(i, 0.0))) is not None}
    if not begun:
        return found + [None] * (len(motion.force) - 1)
    scales = {i: BAR * float(sigma_of(np.concatenate(left))) for i, (_, left, _) in begun.items()}

    def left(delay_s: float) -> float:
        at = {i: _solve_position(motion.rows(i, delay_s)) for i in begun}
        parts = [np.inf if solved is None else np.log1p((np.concatenate(solved[1]) / scales[i]) ** 2).sum() for i, solved in at.items()]
        return float(sum(parts))

    bounds = (-MOST_DELAY_S, MOST_DELAY_S)
    delay_s = float(minimize_scalar(left, bounds=bounds, method="bounded", options={"xatol": DELAY_STEP_S}).x)
    for i in range(1, len(motion.force)):
        first = _solve_position(motion.rows(i, delay_s))
        whole = None if first is None else _solve_position(motion.rows(i, delay_s, first[0][:3]))
        found.append(whole and whole[2])
    return found


@dataclass(frozen=True, eq=False)
class ArrayMotion:
    """Splines of each unit's calibrated rate and force, by log, in the array's axes; turns: log and times (N,) s of each."""

    rate: list[list[CubicSpline]]
    force: list[list[CubicSpline]]
    turns: list[tuple[int, np.ndarray]]

    @classmethod
    def of(cls, units: list[ArrayUnit], joint: Joint) -> ArrayMotion:
        """The motion of a fitted array."""
        rate, force = ([_of_logs(unit, joint, i, what) for i, unit in enumerate(units)] for what in ("rate", "force"))
        anchor, turns = units[joint.same.anchor].problem, []
        for segment in anchor.used:
            samples = anchor.logs[segment.log].samples
            first, last = segment.stills
            turns.append((segment.log, samples.t_ns[first.stop : last.start + 1] * NS))
        return cls(rate, force, turns)

    def rows(self, i: int, delay_s: float, position: np.ndarray | None = None) -> list[tuple[np.ndarray, np.ndarray]]:
        """Design (3 N, 7) and values (3 N,) of unit i in each turn, the rates read ``delay_s`` before the forces; with a position (3,) m,
        one more column: what a longer delay changes."""
        found = []
        for log, t_s in self.turns:
            parts = [part for each in (self.rate, self.force) for part in (each[0][log], each[i][log])]
            inside = [(t_s - MOST_DELAY_S >= part.x[0]) & (t_s + MOST_DELAY_S <= part.x[-1]) for part in parts]
            t_s = t_s[np.all(inside, axis=0)]
            if len(t_s) < 4:
                continue
            splines = [each[log] for each in self.rate]
            omega, alpha, jerk = (np.mean([spline(t_s - delay_s, order) for spline in splines], axis=0) for order in range(3))
            A = cross_matrix(alpha) + cross_matrix(omega) @ cross_matrix(omega)
            columns = [A, np.broadcast_to(np.eye(3), A.shape), self.force[0][log](t_s, 1)[..., None]]
            if position is not None:
                changed = cross_matrix(jerk) + cross_matrix(alpha) @ cross_matrix(omega) + cross_matrix(omega) @ cross_matrix(alpha)
                columns.append((changed @ position)[..., None])
            values = self.force[i][log](t_s) - self.force[0][log](t_s)
            found.append((np.concatenate(columns, axis=2).reshape(values.size, -1), values.reshape(-1)))
        return found


def _of_logs(unit: ArrayUnit, joint: Joint, i: int, what: str) -> list[CubicSpline]:
    """Return splines of calibrated rate or force, in the array's axes, of each log over the array's time; invalid readings are left out."""
    M, x, model = joint.state.mountings[i], joint.state.accelerometers[i], joint.models[i]
    found = []
    for log, given in zip(unit.problem.logs, force_problem(unit).logs, strict=True):
        samples = log.samples
        good = rates_of(samples, register_end_dps(unit.problem.session.config.sensor, np.asarray(samples.gyro))).good
        t_s = samples.t_ns * NS
        values = model(np.asarray(samples.gyro)) if what == "rate" else corrected_force(x, np.asarray(given.samples.accel))
        found.append(CubicSpline(t_s[good], values[good] @ M.T))
    return found


#: numbers x (P,) of the design; residuals (n,) m/s^2 of each turn; position (3,) m with its covariance (3, 3), None where it is not
#: determined
SolvedPosition = tuple[np.ndarray, list[np.ndarray], tuple[np.ndarray, np.ndarray] | None]


def _solve_position(turns: list[tuple[np.ndarray, np.ndarray]]) -> SolvedPosition | None:
    """Solve design (n, P) and values (n,) of each turn, in m/s^2, the position (3,) m first; None with too few turns or directions."""
    if len(turns) < FEWEST_TURNS:
        return None
    design, values = zip(*turns, strict=True)
    weights = [np.ones(len(v)) for v in values]
    size = design[0].shape[1]
    x = np.zeros(size)
    for _ in range(ROUNDS):
        normal = sum((D * w[:, None]).T @ D for D, w in zip(design, weights, strict=True))
        if not np.isfinite(np.diag(covariance_of(normal))).all():
            return None
        x = np.linalg.solve(normal, sum(D.T @ (w * v) for D, v, w in zip(design, values, weights, strict=True)))
        left = [v - D @ x for D, v in zip(design, values, strict=True)]
        bar = BAR * float(sigma_of(np.concatenate(left)))
        weights = [1 / (1 + (e / max(bar, 1e-12)) ** 2) for e in left]
    scores = np.array([D.T @ (w * e) for D, w, e in zip(design, weights, left, strict=True)])
    inverse = np.linalg.inv(normal)
    count = len(turns)
    covariance = (inverse @ (scores.T @ scores) @ inverse)[:3, :3] * count / (count - 2)
    covariance += np.eye(3) * (FILTERS * float(np.linalg.norm(x[:3]))) ** 2
    known = np.sqrt(np.linalg.eigvalsh(covariance)[-1]) <= KNOWN_M
    return x, left, (x[:3], covariance) if known else None
