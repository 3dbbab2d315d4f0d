"""How the attitudes of a truth file are to be read: which way they turn, which way is up, whose axes, whose clock.

Any file comes to ``q_nb`` (docs/formats.md) by the same four steps, each of which can be undone:

    q_nb(t + offset_s) = frame * (as written at t, its cells put in order, inverted if it takes the world to the body) * mounting
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

#: of a quaternion's cells under the header qw,qx,qy,qz
ORDERS = ("wxyz", "xyzw")
#: what the quaternion takes to what
SENSES = ("body_to_world", "world_to_body")
_HALF = np.sqrt(0.5)
#: (4,) of the turn that takes the file's world to one with z down; about the file's x axis, which keeps its heading, or else about y
FRAMES = {
    "ned": np.array([1.0, 0.0, 0.0, 0.0]),
    "enu": np.array([0.0, 1.0, 0.0, 0.0]),
    "y_down": np.array([_HALF, _HALF, 0.0, 0.0]),
    "y_up": np.array([_HALF, -_HALF, 0.0, 0.0]),
    "x_down": np.array([_HALF, 0.0, -_HALF, 0.0]),
    "x_up": np.array([_HALF, 0.0, _HALF, 0.0]),
}
#: other names of the same: only which way is down matters
SAME_FRAME = {"z_down": "ned", "z_up": "enu", "nwu": "enu", "nue": "y_up"}


@dataclass(frozen=True, eq=False)
class TruthGiven:
    """What ``[truth]`` of session.toml says; None: to be found out.  mounting (3, 3): from the IMU's axes to the truth's body."""

    offset_s: float | None = None
    frame: str | None = None
    sense: str | None = None
    order: str | None = None
    mounting: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class TruthReading:
    """One way to read a truth file; as it is made, the contract's own.

    order: one of ``ORDERS``; sense: one of ``SENSES``; frame: one of ``FRAMES``; mounting (3, 3): takes vectors from the IMU's axes to
    those of the truth's body; offset_s: added to the truth's stamps it gives the log's clock.
    """

    order: str = ORDERS[0]
    sense: str = SENSES[0]
    frame: str = "ned"
    mounting: np.ndarray = field(default_factory=lambda: np.eye(3))
    offset_s: float = 0.0

    @classmethod
    def of(cls, given: TruthGiven) -> TruthReading:
        """What is given, and the contract's own where nothing is."""
        told = {name: value for name, value in vars(given).items() if value is not None}
        return cls(**told)

    def read(self, q: np.ndarray) -> np.ndarray:
        """``q_nb`` (K, 4) of what is written, (K, 4)."""
        q = np.roll(q, 1, axis=1) if self.order == "xyzw" else q
        q = inverse(q) if self.sense == "world_to_body" else q
        return product(product(FRAMES[self.frame], q), quaternion(self.mounting))

    def written(self, q_nb: np.ndarray) -> np.ndarray:
        """What is written, (K, 4), where this reading gives ``q_nb`` (K, 4)."""
        q = product(product(inverse(FRAMES[self.frame]), q_nb), inverse(quaternion(self.mounting)))
        q = inverse(q) if self.sense == "world_to_body" else q
        return np.roll(q, -1, axis=1) if self.order == "xyzw" else q


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Hamilton product (..., 4) of quaternions, scalar first."""
    (pw, px, py, pz), (qw, qx, qy, qz) = np.moveaxis(p, -1, 0), np.moveaxis(q, -1, 0)
    return np.stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + qw * px + py * qz - pz * qy,
            pw * qy + qw * py + pz * qx - px * qz,
            pw * qz + qw * pz + px * qy - py * qx,
        ],
        axis=-1,
    )


def inverse(q: np.ndarray) -> np.ndarray:
    """Of unit quaternions (..., 4)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def down_of(frame: str) -> np.ndarray:
    """(3,): where down is in the file's world."""
    w, x, y, z = FRAMES[frame]
    return np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


def quaternion(matrix: np.ndarray) -> np.ndarray:
    """(4,) scalar first, of a rotation matrix (3, 3): the strongest of its four squares, so that nothing is divided by little."""
    m = matrix
    squares = np.array(
        [
            [1 + m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], 1 - m[0, 0] + m[1, 1] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1 - m[0, 0] - m[1, 1] + m[2, 2]],
        ]
    )
    row = squares[int(np.argmax(np.diag(squares)))]
    q = row / np.linalg.norm(row)
    return q if q[0] >= 0 else -q


#: where each part of a reading is from
GIVEN, FOUND, ASSUMED = "given", "found", "assumed"


@dataclass(frozen=True, eq=False)
class TruthAlignment:
    """How a session's truth files are read, and what the recording says of it.

    reading: as they are read; source: of each of its parts, ``given``, ``found`` in the recording, or ``assumed`` (the contract's own).
    offset_s, offset_sigma_s: of the truth's clock, as the recording shows it, whatever is given or used; nan where it does not.  turned,
    turned_sigma (3,) rad: likewise the rotation from the gyro's axes to the truth's body.  up (3,): the mean specific force in the
    file's world over its mean length, where there is one, else None; explained: share of the truth's rotations that the gyro explains.
    """

    reading: TruthReading
    source: dict[str, str]
    offset_s: float
    offset_sigma_s: float
    turned: np.ndarray
    turned_sigma: np.ndarray
    up: np.ndarray | None
    explained: float
