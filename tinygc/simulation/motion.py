"""Where the table is and how it turns: exact kinematics of three gimbals, no integration anywhere.

The outer gimbal turns about the table's vertical, the middle one about the outer's y, the inner one about the middle's x; the
body is on the inner.  So their angles psi, theta, phi are yaw, pitch, roll: ``R_tb = Rz(psi) Ry(theta) Rx(phi)``, any angle
allowed.  The rate of b against t, in b (the textbooks' Euler angle kinematics; the acceleration is its derivative)::

    p = phi' - psi' sin(theta)
    q = theta' cos(phi) + psi' sin(phi) cos(theta)
    r = -theta' sin(phi) + psi' cos(phi) cos(theta)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import EARTH_RATE_RPS
from tinygc.simulation.stroke import gimbal_angles
from tinygc.simulation.table_movement import Plan


@dataclass(frozen=True, eq=False)
class Motion:
    """The body's motion against the table.

    t_s (N,); angles (3, N) rad, outer middle inner; rate, acceleration (N, 3): of b against t, in b, rad/s and rad/s^2.
    """

    t_s: np.ndarray
    angles: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray


def move(plan: Plan, t_s: np.ndarray) -> Motion:
    """The plan's motion at times t_s (N,) s, increasing."""
    angles, rates, accelerations = gimbal_angles(plan.start_rad, plan.strokes, t_s)
    _, sin_theta, sin_phi = np.sin(angles)
    _, cos_theta, cos_phi = np.cos(angles)
    psi1, theta1, phi1 = rates
    psi2, theta2, phi2 = accelerations
    # The vertical in b is (-sin theta, side, down); its derivative follows.
    side, down = sin_phi * cos_theta, cos_phi * cos_theta
    side1 = phi1 * down - theta1 * sin_phi * sin_theta
    down1 = -phi1 * side - theta1 * cos_phi * sin_theta
    rate = np.stack([phi1 - psi1 * sin_theta, theta1 * cos_phi + psi1 * side, -theta1 * sin_phi + psi1 * down], axis=-1)
    acceleration = np.stack(
        [
            phi2 - psi2 * sin_theta - psi1 * theta1 * cos_theta,
            theta2 * cos_phi - theta1 * phi1 * sin_phi + psi2 * side + psi1 * side1,
            -theta2 * sin_phi - theta1 * phi1 * cos_phi + psi2 * down + psi1 * down1,
        ],
        axis=-1,
    )
    return Motion(t_s, angles, rate, acceleration)


def table_to_body(angles: np.ndarray, vector_t: np.ndarray) -> np.ndarray:
    """A vector fixed in the table, seen from the body: ``R_tb^T v``.  angles (3, N) rad, vector_t (3,).  Returns (N, 3)."""
    (sin_psi, sin_theta, sin_phi), (cos_psi, cos_theta, cos_phi) = np.sin(angles), np.cos(angles)
    x, y, z = vector_t
    x, y = cos_psi * x + sin_psi * y, cos_psi * y - sin_psi * x
    x, z = cos_theta * x - sin_theta * z, sin_theta * x + cos_theta * z
    y, z = cos_phi * y + sin_phi * z, cos_phi * z - sin_phi * y
    return np.stack([x, y, z], axis=-1)


def earth_rate_table(latitude_rad: float, heading_rad: float) -> np.ndarray:
    """The Earth's rotation in t (3,) rad/s; heading from true north to t's x axis, ``R_nt = Rz(heading)``."""
    north, down = EARTH_RATE_RPS * np.cos(latitude_rad), -EARTH_RATE_RPS * np.sin(latitude_rad)
    return np.array([north * np.cos(heading_rad), -north * np.sin(heading_rad), down])


def specific_force(motion: Motion, gravity_mps2: float, lever_m: np.ndarray) -> np.ndarray:
    """Specific force (N, 3) m/s^2 in b at lever_m (3,) m in b from the gimbals' crossing, which stands still.

    ``f = R_bn (a - g)``, a = alpha x r + omega x (omega x r).  Coriolis from the Earth's rotation (below 1 ug here) is left out.
    """
    centripetal = np.cross(motion.rate, np.cross(motion.rate, lever_m))
    tangential = np.cross(motion.acceleration, lever_m)
    return table_to_body(motion.angles, np.array([0.0, 0.0, -gravity_mps2])) + tangential + centripetal
