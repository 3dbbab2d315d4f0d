"""The machine's word against the sensor: where each still should lie by its angles, and how far each turn should have gone.

    force of a still:  u = F p,  p = -R_tb(angles)^T e_z       F: the mounting's error, from the stills before (Kabsch)
    turn:              the gyroscope's angles about the body's axes, against Log(R_tb(before)^T R_tb(after))

The gyroscope is not calibrated yet and the mounting is known to a degree or so.  So small errors of either cannot be told here; those are
for ``explain``.  What is told is a machine that does not do what it says.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from session.base.rotation import angle_between
from session.base.units import DEG
from tinygc.features.tables.machines.description import Description, attitudes, body_axes

#: one sigma of what a gyroscope reads of a turn before it is calibrated, of its angle
SCALE_SIGMA = 0.02
#: rad, of gravity's direction: before any still has shown the mounting; with it; more with an accelerometer that is not calibrated
MOUNTING_SIGMA_RAD, TILT_SIGMA_RAD, RAW_TILT_SIGMA_RAD = 2.5 * DEG, 0.5 * DEG, 1.2 * DEG
SIGMAS = 4.0  #: beyond so many a contradiction is no chance
FEWEST = 3  #: stills that show the mounting
STALLED = 0.1  #: of the angle: less is no turn
LEAST_RAD = 5 * DEG  #: a smaller turn is not compared
#: cosine: turns about axes further apart are about different ones
SAME_AXIS = np.cos(20 * DEG)


class WordAgainstSensor:
    """``still`` after each still of the guide; returns contradictions, each in words."""

    def __init__(self, table: Description):
        self._table = table
        self._stills: list[tuple[np.ndarray, np.ndarray]] = []  # predicted and measured up, (3,) unit
        self._before: np.ndarray | None = None  # angles in the still before

    def interrupted(self) -> None:
        """The turn to the next still was not followed."""
        self._before = None

    def begin_again(self) -> None:
        """The machine's angles have another origin from here on."""
        self._stills, self._before = [], None

    def still(self, angles: np.ndarray, accel: np.ndarray, turned: np.ndarray | None, raw: bool = False) -> list[str]:
        """Compare a still: angles (K,) rad that the machine says, accel (3,) measured; turned (3,) rad that the gyroscope saw on the way
        from the still before, None where it was not followed; raw: whether the accelerometer is not calibrated."""
        attitude = attitudes(self._table, angles[None])[0]
        up, measured = -attitude[2], accel / np.linalg.norm(accel)
        found = self._of_gravity(up, measured, raw)
        if self._before is not None and turned is not None:
            found = self._of_turn(self._before, angles, turned) + found
        if found:
            self.begin_again()
        self._stills.append((up, measured))
        self._before = np.array(angles, dtype=float)
        return found

    def _of_gravity(self, up: np.ndarray, measured: np.ndarray, raw: bool) -> list[str]:
        predicted, sigma = up, MOUNTING_SIGMA_RAD
        if len(self._stills) >= FEWEST:
            before = np.array(self._stills)
            if np.linalg.svd(before[:, 0])[1][1] > 0.5:  # not all about one direction
                predicted = Rotation.align_vectors(before[:, 1], before[:, 0])[0].apply(up)
                sigma = TILT_SIGMA_RAD
        declared = [axis.sigma_rad**2 + (axis.backlash_rad / 2) ** 2 for axis in self._table.axes]
        sigma = float(np.sqrt(sigma**2 + (RAW_TILT_SIGMA_RAD**2 if raw else 0.0) + sum(declared)))
        apart = float(angle_between(predicted, measured))
        if apart <= SIGMAS * sigma:
            return []
        way = (
            "upside down: is mounting the rotation from the sensor to the table?"
            if apart > 150 * DEG
            else "lost steps, or a wrong mounting"
        )
        return [f"gravity lies {apart / DEG:.1f} deg from where the machine's angles put it ({SIGMAS * sigma / DEG:.1f} at most): {way}"]

    def _of_turn(self, before: np.ndarray, after: np.ndarray, turned: np.ndarray) -> list[str]:
        changes = np.abs(after - before)
        moved = np.flatnonzero(changes > LEAST_RAD)
        seen, says = float(np.linalg.norm(turned)), float(changes.sum())
        if not len(moved):
            return [] if seen < LEAST_RAD else [f"the gyroscope turned by {seen / DEG:.0f} deg, and the machine says that it rested"]
        names = " and ".join(self._table.axes[k].name for k in moved)
        if seen < STALLED * float(changes.max()):
            return [
                f"{names}: the machine says {says / DEG:.0f} deg, the gyroscope saw {seen / DEG:.1f}: it is stalled, or its coupling slips"
            ]
        if len(moved) > 1:  # the sum of two turns is compared by the attitude alone
            return []
        (axis,) = moved
        change = float(after[axis] - before[axis])
        along = float(turned @ body_axes(self._table, after[None])[0, axis]) * np.sign(change)
        if along < -SAME_AXIS * seen:
            return [f"{names}: the gyroscope turned the other way round: the sign of the axis, or the mounting, is wrong"]
        if along < SAME_AXIS * seen:
            return [f"{names}: the gyroscope turned about another axis: direction or mounting is wrong in table.toml"]
        of = self._table.axes[axis]
        sigma = float(np.sqrt((SCALE_SIGMA * change) ** 2 + of.sigma_rad**2 * 2 + of.backlash_rad**2))
        if abs(seen - abs(change)) > SIGMAS * sigma:
            return [f"{names}: the machine says {abs(change) / DEG:.1f} deg, the gyroscope saw {seen / DEG:.1f}: lost steps?"]
        return []
