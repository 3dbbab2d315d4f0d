"""Rows of an array's linear system: the closure of every unit's turns, the force of every unit's stills, and what all units share.

The array's body has one attitude in each still; every unit's gyroscope must lead from one to the next, and every unit's gravity must point
down in it.  Tilt is what all accelerometers say together; yaw at a turn's end is unknown, but one for all units: there they are each
other's reference.  To first order, about the table's axes, of a turn from still a to still b and a force f in still q::

    e + A dtheta_i + (R_a - R_b) mu_i + delta_a - delta_b + gamma_ab = the unit's own error          (3 rows)
    R_q M_i f + g z + dx columns + (mu_i, delta_q turned) + level_q = the unit's own error           (3 rows)

gamma, the tilt by which all units miss a turn alike, and level, the acceleration that all feel in a still, are random: they have rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.accelerometer.parameters import IDENTITY, corrected, force_columns, units
from session.common.units import G
from tinygc import closure
from tinygc.array.joint.same_stills import SameStills
from tinygc.array.joint.state import ACCELEROMETER, GYROSCOPE, MOUNTING, PER_UNIT, Layout, State
from tinygc.array.joint.system import System
from tinygc.attitude import rotation
from tinygc.closure.residual import Batch
from tinygc.models import linear
from tinygc.models.linear import PRIOR_SIGMA

#: rad: nothing is known of an attitude, nor of a mounting, beyond where it was linearised
ATTITUDE_RAD, MOUNTING_RAD = 1.0, 1.0
HELD = 1e-9
DOWN = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class UnitRows:
    """What a unit brings: batch of its turns that are the array's, ends by number of still; floor (S, 3) rad^2 of its gyro's white noise;
    stills (K,) numbers of those that it has, their mean force (K, 3) and its white variance (K,); rest (3,) where its bias is taken from
    the stills, else None; prior (9,) sigmas of its accelerometer's numbers; centre (12,) of its gyroscope's."""

    batch: Batch
    first: np.ndarray
    last: np.ndarray
    floor: np.ndarray
    stills: np.ndarray
    force: np.ndarray
    white: np.ndarray
    rest: np.ndarray | None
    prior: np.ndarray
    centre: np.ndarray


@dataclass(frozen=True, eq=False)
class RowMap:
    """Where rows stand: of each unit its closure (S, 3) and forces (K, 3); common (Q-1, 2) and level (Q, 2) rows.  names of the components,
    in the order of ``System.V``."""

    closure: tuple[np.ndarray, ...]
    force: tuple[np.ndarray, ...]
    common: np.ndarray
    level: np.ndarray
    names: tuple[str, ...]


def row_map(rows: list[UnitRows], stills: int) -> RowMap:
    """Closure rows of all units, then forces, then what is shared."""
    at, closures, forces = 0, [], []
    for unit in rows:
        closures.append(at + np.arange(3 * len(unit.batch)).reshape(-1, 3))
        at += 3 * len(unit.batch)
    for unit in rows:
        forces.append(at + np.arange(3 * len(unit.stills)).reshape(-1, 3))
        at += 3 * len(unit.stills)
    common = at + np.arange(2 * (stills - 1)).reshape(-1, 2)
    level = common.size + at + np.arange(2 * stills).reshape(-1, 2)
    own = [f"{what}.{i}" for what in ("turn", "force") for i in range(len(rows))]
    return RowMap(tuple(closures), tuple(forces), common, level, (*own, "common.turn", "common.undersampled", "common.level"))


def array_system(
    state: State, start: State, rows: list[UnitRows], same: SameStills, missed_rad: np.ndarray, gravity_sigma: float
) -> tuple[System, RowMap]:
    """Linearised at a state; start: the centre of what is known beforehand; missed_rad (Q-1,): the tilt that fast motion is predicted to
    make all units miss between two stills; gravity_sigma m/s^2."""
    layout, where = Layout(len(rows), len(same)), row_map(rows, len(same))
    count = int(where.level[-1, -1]) + 1
    design, values, base = np.zeros((count, layout.count)), np.zeros(count), np.zeros(count)
    V = np.zeros((len(where.names), count))
    R = rotation.matrix(state.q_tb)
    attitude, level, common = (np.arange(layout.count)[part] for part in (layout.attitudes, layout.level, layout.common))
    attitude, level, common = attitude.reshape(-1, 3), level.reshape(-1, 2), common.reshape(-1, 2)
    for i, unit in enumerate(rows):
        M = state.mountings[i]
        q_bu = rotation_of(M)
        batch = replace(
            unit.batch, start=rotation.multiply(state.q_tb[unit.first], q_bu), end=rotation.multiply(state.q_tb[unit.last], q_bu)
        )
        end, sensitivity = closure.end_and_sensitivity(batch, state.models[i](batch.rate))
        at = where.closure[i]
        values[at] = closure.error_angles(closure.batch_residual(batch, end))
        base[at] = unit.floor
        V[i, at] = 1.0
        put(design, at, layout.unit(i, GYROSCOPE), linear.columns(sensitivity, batch.rate))
        put(design, at, layout.unit(i, MOUNTING), R[unit.first] - R[unit.last])
        for s, (a, b) in enumerate(zip(unit.first, unit.last, strict=True)):
            design[at[s], attitude[a]] += 1.0
            design[at[s], attitude[b]] -= 1.0
            for k in range(a, b):
                design[at[s][:2], common[k]] += 1.0
        at = where.force[i]
        seen = corrected(state.accelerometers[i], unit.force) @ M.T
        R_q = R[unit.stills]
        level_force = np.einsum("qij,qj->qi", R_q, seen)
        values[at] = level_force + state.gravity_mps2 * DOWN
        base[at] = unit.white[:, None]
        V[len(rows) + i, at] = 1.0
        put(design, at, layout.unit(i, ACCELEROMETER), R_q @ M @ force_columns(state.accelerometers[i], unit.force))
        put(design, at, layout.unit(i, MOUNTING), -R_q @ cross(seen))
        turned = -cross(level_force)
        for k, q in enumerate(unit.stills):
            design[np.ix_(at[k], attitude[q])] = turned[k]
            design[at[k][:2], level[q]] = 1.0
        design[at[:, 2], layout.gravity] = 1.0
    design[where.common, common] = 1.0
    design[where.level, level] = 1.0
    V[-3, where.common] = 1.0
    V[-2, where.common] = missed_rad[:, None] ** 2
    V[-1, where.level] = 1.0
    base[where.common], base[where.level] = 1e-16, 1e-12  # rad^2 and (m/s^2)^2: a component of nothing is still a number
    prior, pull = _priors(state, start, rows, same, layout, gravity_sigma)
    return System(design, values, base, V, prior, pull, np.zeros(count, dtype=bool)), where


def _priors(
    state: State, start: State, rows: list[UnitRows], same: SameStills, layout: Layout, gravity_sigma: float
) -> tuple[np.ndarray, np.ndarray]:
    prior, pull = np.full(layout.count, 1e3), np.zeros(layout.count)
    for i, unit in enumerate(rows):
        gyroscope = PRIOR_SIGMA.copy()
        if unit.rest is not None:
            gyroscope[linear.BIAS] *= HELD
        prior[layout.unit(i)] = np.concatenate([gyroscope, unit.prior, np.full(3, HELD if i == 0 else MOUNTING_RAD)])
        pull[layout.unit(i)][: PER_UNIT - 3] = np.concatenate([unit.centre - state.models[i].vector, IDENTITY - state.accelerometers[i]])
    prior[layout.gravity] = gravity_sigma
    pull[layout.gravity] = start.gravity_mps2 - state.gravity_mps2
    attitude = np.full((len(same), 3), ATTITUDE_RAD)
    attitude[np.unique(same.group, return_index=True)[1], 2] = HELD  # the yaw of a group's first still is its frame's
    prior[layout.attitudes] = attitude.ravel()
    prior[layout.level], prior[layout.common] = G, 1.0
    return prior, pull


def accelerometer_prior(spread_mps2: np.ndarray, gravity_mps2: float) -> np.ndarray:
    """(9,) sigmas in each number's own unit, of sigmas in m/s^2 at one g."""
    return spread_mps2 * units(gravity_mps2)


def put(design: np.ndarray, rows: np.ndarray, columns: slice, blocks: np.ndarray) -> None:
    """Blocks (B, d, p) into rows (B, d) and p columns."""
    design[rows.ravel(), columns] = blocks.reshape(rows.size, -1)


def cross(v: np.ndarray) -> np.ndarray:
    """(..., 3, 3): what takes w to v x w."""
    found = np.zeros((*v.shape, 3))
    x, y, z = np.moveaxis(v, -1, 0)
    found[..., 0, 1], found[..., 0, 2], found[..., 1, 2] = -z, y, -x
    found[..., 1, 0], found[..., 2, 0], found[..., 2, 1] = z, -y, x
    return found


def rotation_of(matrix: np.ndarray) -> np.ndarray:
    """(4,) scalar first of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(matrix).as_quat(scalar_first=True))
